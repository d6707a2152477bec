"""What `diagnose` answers: verdict, causes, parameters, and how far the gap shrinks; hil-diagnosis/1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import Score
from hil.gap.located.result import METRIC, Located

Array = NDArray[np.float64]
Verdict = Literal["identified", "ambiguous", "unknown", "no_gap"]


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """A parameter of an effect with its 90 % interval."""

    value: float
    ci: tuple[float, float]
    unit: str
    at_bound: bool


@dataclass(frozen=True, slots=True)
class Cause:
    """A candidate that was weighed."""

    effect: str
    location: str
    probability: float
    """That it is among the effects that act."""
    group: int
    """Number of its class: candidates of one class cannot be told apart on these data."""
    parameters: dict[str, ParameterValue]
    shrink: float | None
    """On held-out data."""
    gain: float
    """Nats that the training data speak for it over no effect at all."""
    fit: Fit

    def table(self) -> dict[str, Any]:
        """As in the answer file."""
        return {
            "effect": self.effect,
            "location": self.location,
            "probability": self.probability,
            "class": self.group,
            "parameters": {
                k: {"value": p.value, "ci": list(p.ci), "unit": p.unit, "at_bound": p.at_bound}
                for k, p in self.parameters.items()
            },
            "shrink": self.shrink,
            "gain": self.gain,
        }


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The whole answer. `tables()` is its file."""

    located: Located
    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...]
    effects: tuple[Cause, ...]
    """The set that the verdict stands for."""
    unknown: float
    """Probability that it is none of the causes: nothing in the catalogue, or an effect not tried."""
    score: Score | None
    """Of the verdict's set, over the signals that it touches."""
    score_all: Score | None
    """The same over all signals."""
    held_out: str
    not_excited: tuple[str, ...]
    """`location.effect` of candidates that these data could not show."""
    best: Fit | None
    """The twin with the verdict's set."""
    none: Fit | None
    """The twin with nothing but its nuisances refitted."""
    calibrated: Calibrated | None
    next_experiment: dict[str, Any] | None = None

    def tables(self) -> dict[str, Any]:
        """Plain tables in format hil-diagnosis/1."""
        out = self.located.tables()
        out["verdict"] = self.verdict
        out["sentence"] = self.sentence
        out["gap"] = self._gap(out["gap"])
        out["causes"] = [c.table() for c in self.causes]
        out["effects"] = [c.table() for c in self.effects]
        out["unknown_probability"] = self.unknown
        out["not_excited"] = list(self.not_excited)
        out["classes"] = self._classes()
        out["next_experiment"] = self.next_experiment
        return out

    def _gap(self, located: dict[str, Any]) -> dict[str, Any]:
        gap: dict[str, Any] = {
            "metric": METRIC,
            "before": located["before"],
            "after": located["before"],
            "noise_floor": located["noise_floor"],
            "shrink": None,
            "shrink_ci": None,
            "held_out": self.held_out,
            "signals": located["signals"],
        }
        if self.score is None:
            return gap
        s = self.score
        gap.update(
            before=s.before, after=s.after, noise_floor=s.floor, shrink=s.shrink,
            shrink_ci=None if s.shrink_ci is None else list(s.shrink_ci), touched=list(s.signals),
        )  # fmt: skip
        if self.score_all is not None:
            a = self.score_all
            gap["all_signals"] = {
                "before": a.before, "after": a.after, "noise_floor": a.floor, "shrink": a.shrink,
            }  # fmt: skip
        for signal, after in self._after().items():
            gap["signals"][signal]["after"] = after
        return gap

    def _after(self) -> dict[str, float]:
        c, best = self.calibrated, self.best
        if c is None or best is None:
            return {}
        out: dict[str, list[Array]] = {}
        judged = {s.signal for s in self.located.signals}  # none of an actuator that never moves
        for x in c.problem.series:
            kept = c.problem.kept[x.part]
            if x.signal in judged:
                out.setdefault(x.signal, []).append(best.residual[x.part][kept])
        return {k: float(np.sqrt(np.mean(np.concatenate(v) ** 2))) for k, v in out.items()}

    def _classes(self) -> list[list[str]]:
        groups: dict[int, list[str]] = {}
        for c in self.causes:
            groups.setdefault(c.group, []).append(f"{c.location}.{c.effect}")
        return list(groups.values())

    def to_json(self) -> bytes:
        """`tables` as indented JSON."""
        return msgspec.json.format(msgspec.json.encode(self.tables()), indent=2)
