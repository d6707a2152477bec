"""Output error: how far the twin's answers are from the rig's, as a function of any parameters.

Parameters are numbers of the rig file (`names`) and effects of the model (`hil.sim.parameters`) by name.
Batches of parameter vectors replay in parallel; sensitivities are differences over steps large enough to
see past stick and slip and the drives' ticks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import ConfigError, IdentificationError
from hil.identify.estimate.names import Number, is_rig_number, number, unknown, with_numbers
from hil.identify.replay import Stretch, replay_of
from hil.sim import layout as lay
from hil.sim.known import pack_known
from hil.sim.model import add_payload, split
from hil.sim.parameters import ParameterTable
from hil.sim.twin import Twin

Array = NDArray[np.float64]
STEP = 0.02
"""Of a number's scale, for differences."""
APART_S = 10.0
"""Between two stretches in `TwinProblem.times_s`: nothing correlates across."""


class TwinProblem:
    """Measured and predicted samples of some stretches, flat; N samples, P parameters."""

    def __init__(
        self,
        rig: RigFile,
        pieces: Sequence[Stretch],
        names: Sequence[str],
        quantities: Sequence[str] = ("position", "force"),
    ) -> None:
        """`quantities`: position, velocity, force, current of the drives and "imu", where recorded."""
        self.rig = rig
        self.names = tuple(names)
        self.table = ParameterTable(rig)
        self._smooth = any("delay" in name for name in names)
        self.numbers: tuple[Number, ...] = tuple(self._number(name) for name in names)
        if not names or len(set(names)) != len(names):
            raise ConfigError(f"{rig.name}: name each parameter to fit once, at least one")
        self._jobs = []
        self.signals: list[tuple[str, slice]] = []
        measured, times = [], []
        size, after_s = 0, 0.0
        for piece in pieces:
            signals = [s for s in piece.samples if _wanted(s, quantities)]
            if not signals:
                raise IdentificationError(
                    f"{piece.name}: holds no samples of {', '.join(quantities)} to fit the twin to"
                )
            job = replay_of(Twin(rig, payload=piece.payload), piece, signals)
            self._jobs.append((job, piece))
            for s in signals:
                part = job.slices[s]
                self.signals.append((s, slice(size + part.start, size + part.stop)))
                measured.append(piece.samples[s][1])
                times.append(piece.samples[s][0] - piece.span_s[0] + after_s)
            size += job.size
            after_s += piece.span_s[1] - piece.span_s[0] + APART_S
        self.measured: Array = np.concatenate(measured)
        self.times_s: Array = np.concatenate(times)
        """(N,) instants, stretch after stretch, `APART_S` apart."""

    @property
    def kinds(self) -> dict[str, NDArray[np.bool_]]:
        """By kind of signal ("position", "imu"): (N,) which samples are of it."""
        found: dict[str, NDArray[np.bool_]] = {}
        for name, part in self.signals:
            place, _, quantity = name.rpartition(".")
            kind = "imu" if place == "imu" else quantity
            found.setdefault(kind, np.zeros(len(self.measured), dtype=bool))[part] = True
        return found

    @property
    def start(self) -> Array:
        """(P,) the rig file's values."""
        return np.array([x.value for x in self.numbers])

    @property
    def scale(self) -> Array:
        """(P,) sizes at which the parameters matter."""
        return np.array([x.scale for x in self.numbers])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """(P,) each."""
        return np.array([x.lower for x in self.numbers]), np.array([x.upper for x in self.numbers])

    def predict(self, rows: Array) -> Array:
        """(B, N) samples for B parameter vectors; NaN where the rig cannot stand where it began."""
        rigs, vectors = zip(
            *(self._model(dict(zip(self.names, r, strict=True))) for r in rows), strict=True
        )
        return self._run(rigs, vectors)

    def force_scale(self, values: Array, factor: float) -> Array:
        """(N,) the answers when all that is a force or a mass, fitted or not, is `factor` as large.

        Where that changes nothing, positions alone cannot tell how large any of them is.
        """
        rig, vector = self._model(dict(zip(self.names, values, strict=True)))
        for i, p in enumerate(self.table.entries):
            if p.unit.startswith(("N", "kg")) and not p.location.endswith((".force", ".current")):
                vector[i] *= factor
        flat: Array = self._run((rig,), (vector,), factor)[0]
        return flat

    def jacobian(self, values: Array) -> Array:
        """(N, P) by central differences, to one side at a bound; all replays in one batch."""
        lower, upper = self.bounds
        rows, spans = [], []
        for k, x in enumerate(self.numbers):
            step = (
                STEP * x.scale
                if is_rig_number(self.rig, x.name)
                else self.table[x.name].search_step
            )
            ends = [min(max(values[k] + s * step, lower[k]), upper[k]) for s in (1.0, -1.0)]
            spans.append(ends[0] - ends[1])
            for end in ends:
                row = np.array(values)
                row[k] = end
                rows.append(row)
        flat = self.predict(np.array(rows))
        slopes: Array = ((flat[0::2] - flat[1::2]) / np.array(spans)[:, None]).T
        return slopes

    def stretch_samples(self, values: Array) -> list[dict[str, Array]]:
        """What the twin answers with `values`, by signal, stretch after stretch."""
        flat, at, out = self.predict(values[None, :])[0], 0, []
        for job, _ in self._jobs:
            out.append(job.by_signal(flat[at : at + job.size]))
            at += job.size
        return out

    def _number(self, name: str) -> Number:
        if is_rig_number(self.rig, name):
            return number(self.rig, name)
        entries = {p.name: p for p in self.table.entries}
        if name not in entries:
            raise unknown(self.rig, name, entries)
        p = entries[name]
        if p.search != "linear":
            raise ConfigError(
                f"{self.rig.name}: {name} is infinite where it vanishes; the gap diagnosis fits it"
            )
        value = float(self.table.from_effects(self.rig.effects)[self.table.index(name)])
        return Number(name, p.unit, value, p.lower, p.upper, p.scale)

    def _model(self, values: Mapping[str, float]) -> tuple[RigFile, Array]:
        own = {k: v for k, v in values.items() if is_rig_number(self.rig, k)}
        vector = self.table.from_effects(self.rig.effects)
        for k, v in values.items():
            if k not in own:
                vector[self.table.index(k)] = v
        return with_numbers(self.rig, own), vector

    def _run(self, rigs: Sequence[RigFile], vectors: Sequence[Array], factor: float = 1.0) -> Array:
        parts = []
        for job, piece in self._jobs:
            models = [pack_known(rig, smooth=self._smooth) for rig in rigs]
            for model in models:
                if factor != 1.0:
                    _scale_forces(model, factor)
                if piece.payload is not None:
                    add_payload(model, piece.payload.mass, piece.payload.position)
            parts.append(job.run_many(np.array(vectors), models=models))
        return np.concatenate(parts, axis=1)


def _scale_forces(model: Array, factor: float) -> None:
    """Everything in a packed model that carries N or kg, times `factor`."""
    act, _, _, body, nominal, _, _, legs, _, _ = split(model, int(model[lay.H_N]))
    is_pd = act[lay.A_PD] != 0.0
    act[lay.A_KP, is_pd] *= factor
    for row in (
        lay.A_KV, lay.A_KI, lay.A_REFLECTED, lay.A_VISCOUS, lay.A_COULOMB_POS, lay.A_COULOMB_NEG,
        lay.A_FMAX, lay.A_MEFF, lay.A_BRAKE, lay.A_FF_VISCOUS, lay.A_FF_COULOMB,
    ):  # fmt: skip
        act[row] *= factor
    for part in (body, nominal):
        part[0] *= factor
        part[4:] *= factor
    legs[:, [0, 2, 3, 5]] *= factor


def _wanted(signal: str, quantities: Sequence[str]) -> bool:
    place, _, quantity = signal.rpartition(".")
    return "imu" in quantities if place == "imu" else quantity in quantities
