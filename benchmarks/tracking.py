"""How well a leg follows in each control mode, through the whole daemon in simulated time.

A shaped step of 1 cm and a chirp from 0.1 to 5 Hz of one leg, as in "Parameters Identification for
Motorcycle Simulator's Platform Characterization", figures 5 and 6, and a second chirp up to 20 Hz for the
bandwidth. Wanted is the leg's position after shaping, measured is what its drive answered over the bus:
slots, delays, jitter, noise and quantisation included.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.figure import Cell, Options, Table
from benchmarks.rigs import profiles, variant
from hil.config import RigFile
from hil.control.streaming import AHEAD_S, cues
from hil.daemon.records import Record, SampleRecord, StateRecord
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.drives.profile import LustProfile
from hil.drives.profiles import Profiles
from hil.rigs import build_rig

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]
"""Displacement of the leg (k,), m, at times (k,), s."""

LEG = 0
REST_S = 3.0
"""At neutral before anything is measured: the soft start is over by then."""
STEP_M = 0.01
SETTLED = 0.02
"""Share of the step within which it counts as settled."""
CHIRP_M = 0.003
"""5 Hz of it asks 0.17 rad/s and 4.2 rad/s² of roll: inside the cue limits, so nothing is held back."""
WIDE_M_S2 = 0.8
"""Acceleration of the leg that the wide chirp's amplitude falls with, where CHIRP_M would ask more."""


class Ridden(Protocol):
    """A rig in a control mode, with its drive files."""

    def rig(self) -> RigFile:
        """The rig in this mode."""

    def profiles(self) -> Profiles:
        """Its drive files."""


@dataclass(frozen=True, slots=True)
class Mode:
    """A way to control the rig: keys of its [control] table, and whether drives take torques."""

    name: str
    mode: str
    precontrol: bool = False
    torque_reference: bool = True

    def rig(self) -> RigFile:
        """The motorcycle rig in this mode."""
        return variant("motorcycle", control={"mode": self.mode, "precontrol": self.precontrol})

    def profiles(self) -> dict[str, LustProfile]:
        """Its drive files."""
        return profiles(layout={"torque_reference": self.torque_reference})


MODES = (
    Mode("drive", "drive"),
    Mode("drive, pre-control", "drive", precontrol=True),
    Mode("cascade", "cascade"),
    Mode("computed torque", "computed_torque"),
    Mode("computed torque, no torque reference", "computed_torque", torque_reference=False),
)


@dataclass(frozen=True, slots=True)
class Trace:
    """One run: times of the leg's answers (k,), s from the motion's start; wanted, measured (k,), m."""

    t_s: Array
    wanted_m: Array
    measured_m: Array

    @property
    def error_m(self) -> Array:
        """Wanted minus measured."""
        return self.wanted_m - self.measured_m


def session_of(mode: Ridden, seed: int = 0) -> SimulatedSession:
    """An armed rig in this mode."""
    session = SimulatedSession(mode.rig(), mode.profiles(), seed=seed)
    session.arm()
    return session


def ride(mode: Ridden, motion: Motion, duration_s: float, *, is_known_ahead: bool = True) -> Trace:
    """Let one leg do `motion` for `duration_s`, the others stand."""
    session = session_of(mode)
    rig, manipulator = session.rig, build_rig(session.rig)
    home = manipulator.inverse(manipulator.neutral)
    records: list[Record] = []
    session.on_record = records.append

    def poses(t_s: Array) -> Array:
        asked_s = t_s if is_known_ahead else np.full_like(t_s, t_s[0])
        lengths = np.repeat(home[None], len(t_s), axis=0)
        lengths[:, LEG] += motion(asked_s - REST_S)
        return np.array([manipulator.forward(row) for row in lengths])

    start_s = session.now_s
    for cue in cues(poses, 0.0, REST_S + duration_s, "benchmark", ahead_s=AHEAD_S):
        session.cue(cue_at(cue, start_s))
    return _trace(rig, records, start_s + REST_S, duration_s)


def _trace(rig: RigFile, records: list[Record], zero_s: float, duration_s: float) -> Trace:
    """The leg's answers beside what was wanted of it at those instants."""
    manipulator = build_rig(rig)
    states = [r for r in records if isinstance(r, StateRecord) and not math.isnan(r.setpoint[0])]
    # A cycle's reference is the motion wanted at the end of that cycle.
    at_s = np.array([r.t_s - r.lateness_s + rig.bus.cycle for r in states])
    wanted = np.array([manipulator.inverse(r.setpoint)[LEG] for r in states])
    answers = [
        (r.sampled_s, r.value)
        for r in records
        if isinstance(r, SampleRecord) and r.source == LEG and r.quantity == "position"
    ]
    t_s, measured = np.array(answers).T
    kept = (t_s > max(at_s[0], zero_s - 0.5)) & (t_s < min(at_s[-1], zero_s + duration_s))
    home = manipulator.inverse(manipulator.neutral)[LEG]
    return Trace(
        t_s[kept] - zero_s, CubicSpline(at_s, wanted)(t_s[kept]) - home, measured[kept] - home
    )


# the step


def step_figures(trace: Trace) -> tuple[Cell, ...]:
    """Rise 10-90 %, settling, overshoot, RMS and largest error of a step at t = 0."""
    t, y = trace.t_s, trace.measured_m / STEP_M
    error = trace.error_m[t >= 0.0]
    return (
        1e3 * (_reaches(t, y, 0.9) - _reaches(t, y, 0.1)),
        1e3 * _settles(t, y),
        100.0 * max(float(y.max()) - 1.0, 0.0),
        1e3 * _rms(error),
        1e3 * float(np.abs(error).max()),
    )


def _reaches(t: Array, y: Array, level: float) -> float:
    """When y first rises through `level`, between its samples."""
    k = int(np.argmax(y >= level))
    return float(np.interp(level, y[k - 1 : k + 1], t[k - 1 : k + 1]))


def _settles(t: Array, y: Array) -> float:
    """When y has come within SETTLED of 1 for good; NaN if it never does."""
    out = np.flatnonzero(np.abs(y - 1.0) > SETTLED)
    return float("nan") if out[-1] == len(t) - 1 else float(t[out[-1] + 1])


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


# the chirps


@dataclass(frozen=True, slots=True)
class Chirp:
    """Exponential sine sweep of the leg from `low_hz` to `high_hz`; fades in over its first second."""

    low_hz: float
    high_hz: float
    duration_s: float

    @property
    def _rate(self) -> float:
        return math.log(self.high_hz / self.low_hz) / self.duration_s

    def frequency(self, t_s: Array) -> Array:
        """Hz at each time."""
        return np.asarray(self.low_hz * np.exp(self._rate * t_s))

    def phase(self, t_s: Array) -> Array:
        """Phase of the sine at each time, rad."""
        return np.asarray(2.0 * np.pi * (self.frequency(t_s) - self.low_hz) / self._rate)

    def __call__(self, t_s: Array) -> Array:
        """Displacement (k,), m."""
        t = np.clip(t_s, 0.0, self.duration_s)
        u = np.minimum(t, 1.0)
        omega = 2.0 * np.pi * self.frequency(t)
        amplitude = np.minimum(CHIRP_M, WIDE_M_S2 / omega**2) if self.high_hz > 5.0 else CHIRP_M
        fade = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        return np.asarray(amplitude * fade * np.sin(self.phase(t)))


def chirp_figures(trace: Trace) -> tuple[Cell, ...]:
    """RMS and largest error after the first second."""
    error = trace.error_m[trace.t_s > 1.0]
    return 1e3 * _rms(error), 1e3 * float(np.abs(error).max())


def response(trace: Trace, chirp: Chirp) -> tuple[Array, NDArray[np.complex128]]:
    """Frequencies (m,), Hz, and the response (m,) from wanted to measured position.

    In windows a fifth of an octave wide or four periods long, whichever is longer, offset, slope, cosine
    and sine of the sweep's own phase are fitted to both by least squares; their ratio is the response.
    """
    f = chirp.frequency(trace.t_s)
    phase = chirp.phase(trace.t_s)
    found_hz, ratios = [], []
    for centre in np.geomspace(1.3 * chirp.low_hz, chirp.high_hz / 1.1, 60):
        at = math.log(centre / chirp.low_hz) / chirp._rate
        half_s = max(2.0 / centre, 0.5 * math.log(2.0**0.2) / chirp._rate)
        part = (np.abs(trace.t_s - at) < half_s) & (trace.t_s > 1.0)
        if np.count_nonzero(part) < 12 or f[part].max() < centre:
            continue
        t = trace.t_s[part] - at
        basis = np.column_stack([np.ones_like(t), t, np.cos(phase[part]), np.sin(phase[part])])
        both = np.column_stack([trace.wanted_m[part], trace.measured_m[part]])
        fit = np.linalg.lstsq(basis, both, rcond=None)[0]
        wanted, measured = fit[2] - 1j * fit[3]
        found_hz.append(centre)
        ratios.append(measured / wanted)
    return np.array(found_hz), np.array(ratios)


def bandwidths(frequency_hz: Array, ratio: NDArray[np.complex128]) -> tuple[Cell, ...]:
    """-3 dB and -90° frequencies, Hz; "> ..." where the sweep ends before."""
    gain = np.abs(ratio)
    phase = np.unwrap(np.angle(ratio))
    return tuple(
        _crossing(frequency_hz, values, level)
        for values, level in ((gain, 10.0 ** (-3.0 / 20.0)), (phase, -0.5 * np.pi))
    )


def _crossing(f: Array, values: Array, level: float) -> Cell:
    below = np.flatnonzero(values < level)
    if below.size == 0:
        return f"> {f[-1]:.0f}"
    k = max(int(below[0]), 1)
    return float(np.interp(level, [values[k], values[k - 1]], [f[k], f[k - 1]]))


# all of it


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Step, chirp and bandwidth in every mode, and what computed torque gains."""
    modes = MODES if not options.quick else (MODES[0], MODES[1], MODES[3])
    narrow = Chirp(0.1, 5.0, 8.0 if options.quick else 30.0)
    wide = Chirp(1.0, 20.0, 6.0 if options.quick else 30.0)
    steps, chirps, responses = {}, {}, {}
    for mode in modes:
        steps[mode.name] = ride(mode, _step, 1.5, is_known_ahead=False)
        chirps[mode.name] = ride(mode, narrow, narrow.duration_s)
        responses[mode.name] = response(ride(mode, wide, wide.duration_s), wide)
    step = Table(
        "1 cm step of a leg, shaped; wanted to measured",
        ("rise 10-90 %, ms", "settled 2 %, ms", "overshoot, %", "RMS error, mm", "max error, mm"),
        {"wanted": step_figures(_ideal(steps["drive"]))}
        | {name: step_figures(trace) for name, trace in steps.items()},
        "rise and settling include the shaped motion itself, the row `wanted`; settling counts from the cue",
    )
    chirp = Table(
        "chirp 0.1-5 Hz, 3 mm of a leg; bandwidth from a chirp 1-20 Hz",
        ("RMS error, mm", "max error, mm", "-3 dB, Hz", "-90°, Hz"),
        {n: (*chirp_figures(t), *bandwidths(*responses[n])) for n, t in chirps.items()},
    )
    columns = ("step RMS", "step max", "chirp RMS", "chirp max")
    errors = {n: np.array([*step.rows[n][3:], *chirp.rows[n][:2]], dtype=float) for n in chirp.rows}
    best = errors["computed torque"]
    gain = Table(
        "error of each mode, as a multiple of computed torque's",
        columns,
        {n: tuple((e / best).tolist()) for n, e in errors.items() if e is not best},
    )
    if options.plots is not None:
        plot(options.plots / "tracking.html", steps, chirps, responses)
    return [step, chirp, gain]


def _step(t_s: Array) -> Array:
    return np.where(t_s >= 0.0, STEP_M, 0.0)


def _ideal(trace: Trace) -> Trace:
    return Trace(trace.t_s, trace.wanted_m, trace.wanted_m)


def plot(
    path: Path,
    steps: dict[str, Trace],
    chirps: dict[str, Trace],
    responses: dict[str, tuple[Array, NDArray[np.complex128]]],
) -> None:
    """Step, its error, the chirp's error and the responses, as a page of plotly."""
    from plotly import graph_objects as go
    from plotly.colors import qualitative
    from plotly.subplots import make_subplots

    titles = ("step, mm", "error of the step, mm", "error of the chirp, mm", "gain, dB", "phase, °")
    figure = make_subplots(rows=5, cols=1, subplot_titles=titles, vertical_spacing=0.05)

    def line(row: int, x: Array, y: Array, name: str, colour: str, shown: bool = False) -> None:
        figure.add_trace(
            go.Scatter(x=x, y=y, name=name, legendgroup=name, showlegend=shown, line_color=colour),
            row=row,
            col=1,
        )

    first = next(iter(steps.values()))
    line(1, first.t_s, 1e3 * first.wanted_m, "wanted", "#94a3b8", True)
    for colour, name in zip(qualitative.D3, steps, strict=False):
        step, chirp = steps[name], chirps[name]
        line(1, step.t_s, 1e3 * step.measured_m, name, colour, True)
        line(2, step.t_s, 1e3 * step.error_m, name, colour)
        line(3, chirp.t_s, 1e3 * chirp.error_m, name, colour)
        f, ratio = responses[name]
        line(4, f, 20.0 * np.log10(np.abs(ratio)), name, colour)
        line(5, f, np.degrees(np.unwrap(np.angle(ratio))), name, colour)
    for row, label in ((1, "s"), (2, "s"), (3, "s"), (4, "Hz"), (5, "Hz")):
        figure.update_xaxes(title_text=label, type="log" if row > 3 else "linear", row=row, col=1)
    figure.update_layout(height=1600, template="plotly_white", hovermode="x unified")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.write_html(path)
