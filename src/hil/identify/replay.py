"""A run as arrays: what each drive was told and what it answered, ready for estimators and the twin."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.errors import IdentificationError
from hil.runs import Run
from hil.sim.twin import Payload, Replay, Twin

Array = NDArray[np.float64]
Series = tuple[Array, Array]
"""Instants (s, rising) and values of one signal."""

SILENCE_S: Final = 0.25
"""Setpoints this far apart end a stretch: in between the drives may have been off."""
SHORTEST_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """One uninterrupted piece of a run under control; times s as the run's table has them."""

    name: str
    """Run and, where it has several, number of the stretch."""
    setpoints: dict[str, Series]
    """By actuator: send instants and setpoints, m (N in mode "force"); empty for a bare log."""
    samples: dict[str, Series]
    """By signal (`leg1.position`, `imu.gyro_x`): receive instants and values."""
    mode: Literal["position", "force"] = "position"
    payload: Payload | None = None
    stamped: Stretch | None = None
    """The stretch as the record has it, where its samples and setpoints were moved to when they happened."""
    late_s: Mapping[str, float] = field(default_factory=dict)
    """By actuator: how much later than stamps or the bus's traffic say its setpoints were found to act."""
    ticked: Collection[str] = ()
    """The actuators whose setpoints are told as their drives' own ticks take them."""

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last instant of any sample."""
        ends = [(t[0], t[-1]) for t, _ in self.samples.values() if len(t)]
        return min(a for a, _ in ends), max(b for _, b in ends)

    def until(self, end_s: float) -> Stretch:
        """The stretch up to `end_s`."""
        return replace(
            self,
            setpoints={a: _cut(s, -np.inf, end_s) for a, s in self.setpoints.items()},
            samples={c: _cut(s, -np.inf, end_s) for c, s in self.samples.items()},
        )

    def with_samples(self, samples: Mapping[str, Array]) -> Stretch:
        """The same stretch with other values at the same instants, for the signals given."""
        return replace(self, samples={s: (self.samples[s][0], v) for s, v in samples.items()})


def stretches(run: Run) -> list[Stretch]:
    """The pieces of `run` in which setpoints went out without a pause; the whole run where it holds none.

    IdentificationError where no piece lasts SHORTEST_S.
    """
    name = run.path.name
    if run.meta.mode == "ride":
        raise IdentificationError(
            f"{name}: is a ride of a bicycle; parameters of a rig need a run of the rig"
        )
    payload = None
    if run.meta.payload is not None:
        p = run.meta.payload
        payload = Payload(p.mass, (p.x, p.y, p.z))
    kind = ".setpoint" if run.meta.mode == "position" else ".force_setpoint"
    columns = [str(c) for c in run.table.columns if c != "t"]
    series = {c: _series(run, c) for c in columns}
    told = {c.removesuffix(kind): series[c] for c in columns if c.endswith(kind)}
    answers = {
        c: s
        for c, s in series.items()
        if not c.startswith("cue.") and not c.endswith(("setpoint", ".force_setpoint"))
    }
    spans = _spans(told.values()) or [(-np.inf, np.inf)]
    pieces = [
        Stretch(
            name if len(spans) == 1 else f"{name} ({k})",
            {a: _cut(s, *span) for a, s in told.items()},
            {c: _cut(s, *span) for c, s in answers.items() if len(_cut(s, *span)[0])},
            run.meta.mode,
            payload,
        )
        for k, span in enumerate(spans, start=1)
    ]
    long = [p for p in pieces if p.samples and p.span_s[1] - p.span_s[0] >= SHORTEST_S]
    if not long:
        raise IdentificationError(
            f"{name}: no stretch under control lasts {SHORTEST_S:g} s: record a longer motion"
        )
    return long


def replay_of(twin: Twin, stretch: Stretch, signals: Iterable[str]) -> Replay:
    """`stretch` packed for the twin, answering `signals` at the instants at which they were received.

    IdentificationError where the stretch holds no setpoints to replay.
    """
    if not all(len(stretch.setpoints.get(a, ((), ()))[0]) for a in twin.rig.actuator_names):
        raise IdentificationError(
            f"{stretch.name}: holds no setpoints of every actuator, so the twin cannot replay it: "
            "record <actuator>.setpoint, or identify by least squares (--method wls)"
        )
    stamps = {s: stretch.samples[s][0] for s in signals}
    return twin.record(stretch.setpoints, stamps, mode=stretch.mode)


def _series(run: Run, column: str) -> Series:
    values = run.table[column].to_numpy(dtype=float)
    there = ~np.isnan(values)
    return run.table["t"].to_numpy(dtype=float)[there], values[there]


def _cut(series: Series, start_s: float, end_s: float) -> Series:
    t, values = series
    inside = (t >= start_s) & (t <= end_s)
    return t[inside], values[inside]


def _spans(told: Iterable[Series]) -> list[tuple[float, float]]:
    """Spans of time between pauses of the setpoints, all actuators together."""
    instants = np.sort(np.concatenate([t for t, _ in told] or [np.empty(0)]))
    if not len(instants):
        return []
    breaks = np.flatnonzero(np.diff(instants) > SILENCE_S)
    starts = instants[np.concatenate([[0], breaks + 1])]
    ends = instants[np.concatenate([breaks, [len(instants) - 1]])]
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
