"""The twin: the model of a rig that replays what a rig was told and answers what it would have measured."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import RunError
from hil.sim import layout as lay
from hil.sim.catalogue import IMU_CHANNELS, QUANTITIES
from hil.sim.known import pack_known
from hil.sim.model import add_payload
from hil.sim.parameters import ParameterTable
from hil.sim.replay import replay

Array = NDArray[np.float64]
Series = tuple[Array, Array]
"""Instants (s, rising) and values of one signal."""
MODES: Final = {"position": lay.MODE_POSITION, "force": lay.MODE_FORCE}
LEAD_W: Final = 10.0
"""rad/s: faster than a platform falls over, slower than what effects do to a motion."""
LEAD_TURN: Final = 0.3
"""rad of that between two samples, at most."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A point mass that the operator bolted on: kg, and its place in the platform frame, m."""

    mass: float
    position: tuple[float, float, float]


class Twin:
    """Forward model of a rig file with its `effects`.

    Signals: `<actuator>.position|velocity|force|current`, `imu.gyro_x` .. `imu.accel_z`, and the true
    `pose.<coordinate>`, which no sensor effect touches.

    `substeps` divides the speed loop's period for a finer plant. `smooth`: setpoints act between the ticks of
    the position loop, so that answers depend smoothly on delays: for fits of delays; without it the drives'
    ticks are kept and a simulated record comes out to the last digit.
    """

    def __init__(
        self,
        rig: RigFile,
        *,
        substeps: int = 1,
        smooth: bool = False,
        payload: Payload | None = None,
    ) -> None:
        self.rig = rig
        self.table = ParameterTable(rig)
        self.parameters = self.table.from_effects(rig.effects)
        self.model = pack_known(rig, substeps, smooth=smooth)
        if payload is not None:
            add_payload(self.model, payload.mass, payload.position)
        names = [f"{a}.{q}" for q in QUANTITIES for a in rig.actuator_names]
        names += [f"imu.{c}" for c in IMU_CHANNELS] + [f"pose.{c}" for c in rig.coordinates]
        self.signals: dict[str, int] = {name: k for k, name in enumerate(names)}

    def record(
        self,
        setpoints: Mapping[str, Series],
        samples: Mapping[str, Array],
        *,
        mode: Literal["position", "force"] = "position",
        start: Sequence[float] | None = None,
        guess: Sequence[float] | None = None,
        lead: Mapping[str, Series] | None = None,
        ticked: Collection[str] = (),
    ) -> Replay:
        """A record to replay, packed once for many runs.

        `setpoints`: by actuator, send instants and values (m, or N in mode "force"). `samples`: by signal,
        the stamps at which its answers were received, s (for `pose.*` the instants themselves). `start`:
        the positions that the drives held before the first setpoint; default: the first setpoints in mode
        "position", home in mode "force". `guess`: a pose near the start, default neutral. `lead`: by
        actuator, measured positions (stamps and values) that the model is led to by a soft spring: by forces
        alone a platform falls over. `ticked`: the actuators whose setpoints a smooth twin is told as their
        drives' own ticks take them, half a tick after they arrive; their position loops count from there.
        RunError names a signal whose stamps run back or that does not exist.
        """
        return Replay(self, setpoints, samples, mode, start, guess, lead or {}, ticked)

    def replay(
        self,
        setpoints: Mapping[str, Series],
        samples: Mapping[str, Array],
        parameters: Array | None = None,
        *,
        mode: Literal["position", "force"] = "position",
        start: Sequence[float] | None = None,
        ticked: Collection[str] = (),
    ) -> dict[str, Array]:
        """The value of each signal at its stamps; arguments as `record`, `parameters` a table's vector."""
        job = self.record(setpoints, samples, mode=mode, start=start, ticked=ticked)
        return job.by_signal(job.run(parameters))


class Replay:
    """One record, packed: `run` answers all samples as one flat array (N,), signal after signal."""

    def __init__(
        self,
        twin: Twin,
        setpoints: Mapping[str, Series],
        samples: Mapping[str, Array],
        mode: Literal["position", "force"],
        start: Sequence[float] | None,
        guess: Sequence[float] | None,
        lead: Mapping[str, Series],
        ticked: Collection[str],
    ) -> None:
        self.twin = twin
        rig, n = twin.rig, len(twin.rig.actuators)
        unknown = [a for a in setpoints if a not in rig.actuator_names]
        unknown += [s for s in samples if s not in twin.signals]
        if unknown:
            raise RunError(f"{rig.name}: the twin has no signals {unknown}")
        self.slices: dict[str, slice] = {}
        if any(s.startswith("imu.") for s in samples) and rig.imu is None:
            raise RunError(f"{rig.name}: IMU signals in the record, no imu in the rig file")
        for i, a in enumerate(rig.actuators):
            if f"{a.name}.current" in samples and a.force_per_ampere is None:
                raise RunError(
                    f"{rig.name}: {a.name}.current in the record; the rig file's actuators[{i}] needs "
                    "torque_constant and transmission for it"
                )
        empty = (np.empty(0), np.empty(0))
        events = [setpoints.get(a, empty) for a in rig.actuator_names]
        for name, (t, value) in zip(rig.actuator_names, events, strict=True):
            _check(f"{name}.setpoint", t, value)
        for name, t in samples.items():
            _check(name, t)
        stamps = [np.asarray(t, dtype=float) for t in samples.values()]
        first = [t[0] for t, _ in events if len(t)] + [t[0] for t in stamps if len(t)]
        period = rig.bus.position_loop
        # Whole loop periods keep the drives' ticks where they were in a simulated record.
        self.origin_s = float(np.floor(min(first, default=0.0) / period) * period)
        position = 0
        for name, t in zip(samples, stamps, strict=True):
            self.slices[name] = slice(position, position + len(t))
            position += len(t)
        self.size = position
        for name, (t, value) in lead.items():
            _check(f"{name}.position", t, value)
        led = [(name, t, value) for name, (t, value) in lead.items() if len(t) > 1]
        seen = [np.asarray(value, dtype=float) for _, _, value in led]
        stamps += [np.asarray(t, dtype=float) for _, t, _ in led]
        signals = [*samples, *(f"{name}.position" for name, _, _ in led)]
        self._count = position + sum(len(value) for value in seen)
        if start is None:
            start = [
                float(value[0]) if len(value) and mode == "position" else a.home
                for a, (_, value) in zip(rig.actuators, events, strict=True)
            ]
        self._arguments = (
            np.array(start, dtype=float),
            np.full(n, float(MODES[mode])),
            tuple(float(a in ticked) for a in rig.actuator_names),
            np.zeros(n) if guess is None else np.array(guess, dtype=float),
            np.cumsum([0] + [len(t) for t, _ in events]),
            np.concatenate([np.asarray(t, dtype=float) for t, _ in events]) - self.origin_s,
            np.concatenate([np.asarray(v, dtype=float) for _, v in events]),
            np.cumsum([0] + [len(t) for t in stamps]),
            np.concatenate([*stamps, np.empty(0)]) - self.origin_s,
            np.array([twin.signals[name] for name in signals], dtype=np.int64),
            np.concatenate([*seen, np.empty(0)]),
            min((lead_w(t) for _, t, _ in led), default=LEAD_W),
        )

    @cached_property
    def _content(self) -> bytes:
        """Digest of all that its answers depend on but the parameters."""
        digest = hashlib.blake2b()
        for x in (self.twin.model, *self._arguments):
            values = np.ascontiguousarray(x)
            digest.update(f"{values.dtype} {values.shape}".encode() + values.tobytes())
        return digest.digest()

    def __eq__(self, other: object) -> bool:
        """Whether it is the same record of the same twin."""
        return isinstance(other, Replay) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def run(self, parameters: Array | None = None) -> Array:
        """All samples (N,) with the parameter vector `parameters` (default: the rig file's); NaN where no
        pose closes the mechanism. RunError where the vector is not as long as the twin's table."""
        out = np.empty(self._count)
        # A copy: of one type whether its source may be written or not, for which `replay` is compiled once.
        vector = np.array(self.twin.parameters if parameters is None else parameters, dtype=float)
        self._check_rows(vector[None])
        replay(self.twin.model, vector, *self._arguments, out)
        return out[: self.size]

    def run_many(
        self, parameters: Array, workers: int | None = None, models: Sequence[Array] | None = None
    ) -> Array:
        """`run` for each row of `parameters` (B, P) → (B, N), on all cores: compiled code holds no lock.

        `models`: a packed model for each row, where rows also differ in numbers of the rig file.
        """
        rows = np.array(parameters, dtype=float, order="C")
        self._check_rows(rows)
        out = np.empty((len(rows), self._count))
        bases = [self.twin.model] * len(rows) if models is None else models

        def one(b: int) -> None:
            replay(bases[b], rows[b], *self._arguments, out[b])

        with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
            list(pool.map(one, range(len(rows))))
        return out[:, : self.size]

    def _check_rows(self, rows: Array) -> None:
        """Compiled code reads whatever lies behind a row that is too short."""
        count = len(self.twin.parameters)
        if rows.ndim != 2 or rows.shape[1] != count:
            raise RunError(
                f"{self.twin.rig.name}: the twin has {count} parameters, the vectors given have shape "
                f"{rows.shape}: build them from `twin.parameters`"
            )

    def by_signal(self, flat: Array) -> dict[str, Array]:
        """The flat samples as one array a signal."""
        return {name: flat[part] for name, part in self.slices.items()}

    def sensitivities(self, names: Sequence[str], parameters: Array | None = None) -> Array:
        """(N, len(names)): change of all samples per unit of each parameter's search coordinate.

        Differences over the table's `search_step`, central, or to one side where a bound is in the way.
        The search coordinate is the parameter itself, or 1 / stiffness for a stiffness (0 = rigid).
        """
        at = np.array(self.twin.parameters if parameters is None else parameters, dtype=float)
        rows, spans = [], []
        for name in names:
            i = self.twin.table.index(name)
            p = self.twin.table.entries[i]
            z, bounds = p.to_search(at[i]), sorted((p.to_search(p.lower), p.to_search(p.upper)))
            ends = [min(max(z + s * p.search_step, bounds[0]), bounds[1]) for s in (1.0, -1.0)]
            spans.append(ends[0] - ends[1])
            for end in ends:
                row = at.copy()
                row[i] = p.from_search(end) if p.search == "reciprocal" else end
                rows.append(row)
        values = self.run_many(np.array(rows).reshape(len(rows), len(at)))
        slopes: Array = ((values[0::2] - values[1::2]) / np.array(spans)[:, None]).T
        return slopes


def lead_w(t: Array) -> float:
    """rad/s with which positions sampled at `t` lead a model: slower where they are far apart, as a force
    that is held between two samples acts late."""
    return min(LEAD_W, LEAD_TURN / float(np.median(np.diff(t))))


def _check(name: str, t: Array, value: Array | None = None) -> None:
    t = np.asarray(t, dtype=float)
    if t.ndim != 1 or not np.all(np.isfinite(t)):
        raise RunError(f"{name}: stamps must be one row of finite numbers")
    back = np.flatnonzero(np.diff(t) < 0.0)
    if len(back):
        raise RunError(f"{name}: time runs back after sample {back[0]} (t = {t[back[0]]:.6f} s)")
    if value is not None and (np.shape(value) != t.shape or not np.all(np.isfinite(value))):
        raise RunError(f"{name}: needs one finite value for each of its {len(t)} stamps")
