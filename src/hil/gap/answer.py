"""The file of a diagnosis, hil-diagnosis/1: plain JSON whatever kind of number it was computed with."""

from __future__ import annotations

import msgspec
import numpy as np

from hil.gap.diagnosis import Diagnosis


def answer_json(found: Diagnosis) -> bytes:
    """`found.tables()` as indented JSON with a line end."""
    data = msgspec.json.encode(found.tables(), enc_hook=_plain)
    return msgspec.json.format(data, indent=2) + b"\n"


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"{type(value).__name__} does not go into JSON")
