"""MAT files of MATLAB and Simulink, up to version 7: variables, fields of structs, columns of matrices.

Names are written as in MATLAB: `qm`, `log.time`, `log.signals(2).values`, `data(:,3)`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from hil.errors import RunError
from hil.runs.importing.source import Array, Column, Stamps, no_such

_STEP: Final = re.compile(r"\.?([A-Za-z]\w*)|\(\s*(\d+)\s*\)|\(\s*:\s*,\s*(\d+)\s*\)")


class MatSource:
    """Variables of one MAT file."""

    row_word = "sample"

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
        except NotImplementedError:
            raise RunError(
                f"{path}: is a MAT file of version 7.3; save it with -v7 in MATLAB, or export CSV"
            ) from None
        except Exception as error:  # whatever SciPy comes upon in a file that is hurt
            raise RunError(f"{path}: cannot be read as a MAT file: {error}") from error
        self._variables = {k: v for k, v in content.items() if not k.startswith("__")}

    def column(self, name: str) -> Column:
        """Numbers of a variable; one number for a scalar."""
        found = self._find(name)
        values = np.asarray(found)
        if values.dtype.kind not in "biuf" or values.ndim > 1:
            shape = " x ".join(map(str, values.shape))
            hint = f"; name one of its columns, as in {name}(:,1)" if values.ndim == 2 else ""
            raise RunError(f"{self.path}: {name} is no row of numbers ({shape or found!r}){hint}")
        numbers: Array = np.atleast_1d(values).astype(np.float64)
        wrong = np.flatnonzero(np.isinf(numbers))
        if wrong.size:
            raise RunError(
                f"{self.path}: column {name}, sample {int(wrong[0]) + 1}: is not a finite number"
            )
        return Column(numbers)

    def stamps(self, name: str | None, group: str, *, dates: bool) -> Stamps:
        """The time variable; integers stay integers."""
        if name is None:
            raise RunError(
                f"{self.path}: a MAT file has no clock of its own: give the map [time] column or rate"
            )
        if dates:
            raise RunError(f'{self.path}: {name}: unit "datetime" is for text and parquet, not MAT')
        values = np.atleast_1d(np.asarray(self._find(name)))
        if values.dtype.kind in "iu" and values.ndim == 1:
            return values.astype(np.int64)
        return self.column(name).values

    def unit_of(self, name: str) -> str | None:
        """MAT files do not say."""
        return None

    def notes(self) -> Iterable[str]:
        """Nothing is passed over."""
        return ()

    def _find(self, name: str) -> Any:
        here: Any = None
        at = 0
        for step in _STEP.finditer(name):
            if step.start() != at:
                break
            at = step.end()
            field, index, matrix_column = step.groups()
            if field is not None:
                here = self._field(here, field, name)
            else:
                here = self._element(here, index, matrix_column, name)
        if at != len(name) or not name:
            raise RunError(
                f"{self.path}: {name!r} is no name of a variable, as in qm, log.time, data(:,3)"
            )
        return here

    def _field(self, here: Any, field: str, name: str) -> Any:
        if here is None:
            if field not in self._variables:
                raise no_such(self.path, "variable", field, self._variables)
            return self._variables[field]
        fields = getattr(here, "_fieldnames", None)
        if fields is None or field not in fields:
            raise no_such(self.path, f"field of {name!r},", field, fields or ())
        return getattr(here, field)

    def _element(self, here: Any, index: str | None, matrix_column: str | None, name: str) -> Any:
        values = np.atleast_1d(here) if index is not None else np.asarray(here)
        k = int(index or matrix_column or 0) - 1
        axis = 0 if index is not None else 1
        if values.ndim <= axis or not 0 <= k < values.shape[axis]:
            shape = " x ".join(map(str, np.shape(here))) or "1"
            raise RunError(f"{self.path}: {name}: there is no element {k + 1} in {shape}")
        return values[k] if axis == 0 else values[:, k]
