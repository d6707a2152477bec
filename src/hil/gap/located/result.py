"""What `locate` answers: the gap by signal and place, with intervals, and everything it took to say so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from hil.gap.floor.noise import NoiseModel
from hil.gap.located.cells import Cells
from hil.gap.located.residual import Fitted
from hil.gap.located.sanity import Finding
from hil.gap.record.problem import Problem
from hil.units import quantity_unit

Array = NDArray[np.float64]
METRIC = "rms over judged samples, signals weighed by their floor"
RATIO: Final = 1.5
"""Within this ratio of the floor there is nothing to explain (the contract's own number)."""


@dataclass(frozen=True, slots=True)
class SignalGap:
    """One signal: root mean square of the residual beside the floor's, in its unit."""

    signal: str
    unit: str
    before: float
    before_ci: tuple[float, float]
    noise_floor: float
    score: float
    """-log10 of the chance that noise makes its most conspicuous band."""
    share: float
    """Of the whole explainable gap."""

    @property
    def ratio(self) -> float:
        """Before over floor."""
        return self.before / self.noise_floor


@dataclass(frozen=True, slots=True)
class Place:
    """A signal, a band and a region in which a part of the gap stands."""

    signal: str
    band_hz: tuple[float, float]
    region: str
    share: float
    """Of the whole explainable gap (noise weighed, above the floor)."""
    share_ci: tuple[float, float]
    """90 %, by resampling blocks of time."""
    time_share: float
    """Part of the signal's judged samples that lies in the region."""
    rms: float
    """Of the band's residual there, in the signal's unit."""
    noise_floor: float

    @property
    def text(self) -> str:
        """Signal, region and band in words."""
        region = self.region.replace("_", " ")
        where = "over the whole motion" if region == "everywhere" else f"at {region}"
        return f"{self.signal} {where}, {self.band_hz[0]:g} to {self.band_hz[1]:.3g} Hz"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the answer was computed from: for pictures, and for whoever goes on from here."""

    problem: Problem
    noise: NoiseModel
    vector: Array
    """The twin's parameters after the refit."""
    residual: Array
    """(N,) measured minus twin."""
    jacobian: Array
    """(N, K) of the nuisances."""
    motion: tuple[dict[str, Array], ...]
    """The twin's own motion in each stretch (`Problem.motion`)."""
    cells: Cells


@dataclass(frozen=True, slots=True)
class Located:
    """Where the twin differs from the rig."""

    rig: str
    runs: tuple[str, ...]
    before: float
    noise_floor: float
    before_ci: tuple[float, float]
    is_gap: bool
    """False: what is left is noise."""
    sentence: str
    signals: tuple[SignalGap, ...]
    where: tuple[Place, ...]
    nuisances: tuple[Fitted, ...]
    floor_text: str
    findings: tuple[Finding, ...]
    evidence: Evidence

    @property
    def roughness(self) -> dict[str, float]:
        """By signal, how many floors a gap stands at, and 1 at least: on references what no calibration and
        nothing known explains."""
        return {s.signal: max(s.ratio, 1.0) for s in self.signals if self.is_gap}

    def tables(self) -> dict[str, Any]:
        """The `gap` and `where` parts of hil-diagnosis/1 and how they came about, as plain tables."""
        return {
            "format": "hil-diagnosis/1",
            "rig": self.rig,
            "runs": list(self.runs),
            "verdict": None if self.is_gap else "no_gap",
            "gap": {
                "metric": METRIC,
                "before": self.before,
                "before_ci": list(self.before_ci),
                "noise_floor": self.noise_floor,
                "signals": {
                    s.signal: {
                        "before": s.before, "before_ci": list(s.before_ci),
                        "noise_floor": s.noise_floor, "unit": s.unit, "share": s.share,
                    }
                    for s in self.signals
                },
            },
            "where": [
                {
                    "signal": p.signal, "band_hz": list(p.band_hz), "region": p.region,
                    "share": p.share, "share_ci": list(p.share_ci), "time_share": p.time_share,
                    "rms": p.rms, "noise_floor": p.noise_floor,
                }
                for p in self.where
            ],
            "sentence": self.sentence,
            "noise": self.floor_text,
            "nuisances": [
                {"name": f.name, "change": f.change, "sd": f.sd, "prior_sd": f.prior_sd,
                 "unit": f.unit, "at_bound": f.at_bound}
                for f in self.nuisances
            ],
            "findings": [
                {"severity": f.severity, "subject": f.subject, "text": f.text}
                | ({} if f.belongs is None else {"belongs": f.belongs})
                for f in self.findings
            ],
        }  # fmt: skip

    def to_json(self) -> bytes:
        """`tables` as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self.tables()), indent=2)


def unit_of(signal: str, *, is_rotary: bool) -> str:
    """Unit of a judged signal, of a rig whose actuator turns or not."""
    place, _, quantity = signal.rpartition(".")
    return "N·m" if place == "bicycle" else quantity_unit(quantity, is_rotary=is_rotary)


def interval(values: Array) -> tuple[float, float]:
    """90 % interval of resampled values."""
    low, high = np.quantile(values, [0.05, 0.95])
    return float(low), float(high)
