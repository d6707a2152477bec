"""The motorcycle platform's figures 5 and 6: a leg's step and chirp under two controllers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.experiments import Chirp, Step
from hil.identify.frequency.frf import analyse
from hil.identify.frequency.response import FrequencyResponse
from hil.ui.page import PALETTE
from hil.ui.reproduce import motorcycle_prose as prose
from hil.ui.reproduce.bench import Job, Played, variant
from hil.ui.reproduce.curves import COMMANDED, Curve, Panel, panels
from hil.ui.reproduce.report import Lengths, Section, Table

Array = NDArray[np.float64]
LEG: Final = "leg1"
STEP_M: Final = 0.01
CHIRP_RAD: Final = 0.003
"""Of pitch: 3 mm of either leg. At 5 Hz that is 3 rad/s² and 93 rad/s³, which shaping leaves alone."""
HIGH_HZ: Final = 5.0
AT_HZ: Final = (1.0, 3.0, 4.5)
FADE_S: Final = 1.5
SETTLED: Final = 0.05
BESIDE_HZ: Final = 0.2
"""So far from the outermost line of a response its value still stands for the frequency asked for."""
SURE: Final = 0.3
"""Lines whose 95 % disc is wider than this share of the response are not shown."""


@dataclass(frozen=True, slots=True)
class Mode:
    """One way of control; `short` names its recordings."""

    short: str
    name: str
    mode: str
    precontrol: bool
    colour: str


SERVO: Final = Mode("servo", "servocontroller loops (VC)", "drive", False, PALETTE[1])
TORQUE: Final = Mode("torque", "computed torque (CT)", "computed_torque", False, PALETTE[0])
CASCADE: Final = Mode("cascade", "P/PI loops in the daemon", "cascade", False, PALETTE[2])
AHEAD: Final = Mode("ahead", "servocontroller loops, pre-control on", "drive", True, PALETTE[3])
MODES: Final = (SERVO, TORQUE, CASCADE, AHEAD)


def jobs(rig: RigFile, lengths: Lengths) -> list[Job]:
    """A step of one leg and a chirp of pitch in every mode."""
    out = []
    for mode in MODES:
        own = variant(rig, control={"mode": mode.mode, "precontrol": mode.precontrol})
        step = Step(actuators=(LEG,), size=STEP_M, count=1, hold_s=1.0)
        chirp = Chirp(
            coordinates=("pitch",),
            amplitude=(CHIRP_RAD,),
            f_min=0.2,
            f_max=HIGH_HZ,
            duration_s=lengths.chirp_s,
            fade_s=FADE_S,
        )
        out += [Job(f"step_{mode.short}", step, own), Job(f"chirp_{mode.short}", chirp, own)]
    return out


@dataclass(frozen=True, slots=True)
class Trace:
    """Of one leg, s from the motion's first row, mm from where it stood."""

    t_s: Array
    wanted_mm: Array
    measured_mm: Array

    @property
    def error_mm(self) -> Array:
        """Wanted minus measured."""
        return self.wanted_mm - self.measured_mm

    @property
    def rms_mm(self) -> float:
        """Root mean square of the error."""
        return float(np.sqrt(np.mean(self.error_mm**2)))


def trace_of(played: Played) -> Trace:
    """The leg's samples beside what was asked of it at those instants."""
    t, x = played.samples(f"{LEG}.position")
    home = played.lengths(LEG, np.array([played.start_s]))[0]
    wanted = played.lengths(LEG, t)
    return Trace(t - played.start_s, 1e3 * (wanted - home), 1e3 * (x - home))


def step_section(played: Mapping[str, Played]) -> Section:
    """Figure 5."""
    traces = {m: trace_of(played[f"step_{m.short}"]) for m in MODES}
    segment = played["step_servo"].description.segments[0]
    part = {
        m: _cut(t, segment.start_s - 0.1, segment.end_s, segment.start_s) for m, t in traces.items()
    }
    wanted = part[SERVO]
    curves = [Curve("asked for", wanted.t_s, wanted.wanted_mm, COMMANDED, "dash")]
    curves += [Curve(m.name, t.t_s, t.measured_mm, m.colour) for m, t in part.items()]
    # the daemon's own cascade is off the scale of the others
    errors = [
        Curve(m.name, t.t_s, t.error_mm, m.colour) for m, t in part.items() if m is not CASCADE
    ]
    figure = panels(
        [
            Panel("leg 1, from its rest", "t, s", "mm", curves),
            Panel("asked for − measured", "t, s", "mm", errors),
        ],
        columns=2,
        height=330,
    )
    rows = [("asked for", *_step_row(wanted.t_s, wanted.wanted_mm), "", "")]
    for m, t in part.items():
        rows.append(
            (
                m.name,
                *_step_row(t.t_s, t.measured_mm),
                f"{t.rms_mm:.3f}",
                f"{np.abs(t.error_mm).max():.2f}",
            )
        )
    servo, torque = part[SERVO], part[TORQUE]
    facts = {f"step_rms_{m.short}_mm": t.rms_mm for m, t in part.items()}
    words = prose.STEP.filled(
        torque=torque.rms_mm, servo=servo.rms_mm, ratio=servo.rms_mm / torque.rms_mm
    )
    head = (
        "",
        "rise 10–90 %, ms",
        "within 5 %, ms",
        "overshoot, %",
        "RMS error, mm",
        "largest, mm",
    )
    return Section(words, (figure,), Table(head, tuple(rows)), facts)


def chirp_section(played: Mapping[str, Played]) -> Section:
    """Figure 6."""
    traces = {m: trace_of(played[f"chirp_{m.short}"]) for m in MODES}
    responses = {m: _response(played[f"chirp_{m.short}"]) for m in MODES}
    end_s = played["chirp_servo"].description.segments[0].end_s
    parts = []
    for what, low_s, high_s in (("whole", 0.0, np.inf), ("its end", end_s - 1.5, end_s)):
        for m in (TORQUE, SERVO):
            t = _cut(traces[m], low_s, high_s)
            curves = [
                Curve(m.name, t.t_s, t.measured_mm, m.colour),
                Curve("asked for", t.t_s, t.wanted_mm, COMMANDED, "dash"),
            ]
            title = f"{'(a)' if m is TORQUE else '(b)'} {m.name}: {what}"
            parts.append(Panel(title, "t, s", "leg 1, mm", curves))
    gain = [Curve(m.name, r.hz, r.gain_db, m.colour) for m, r in responses.items()]
    phase = [Curve(m.name, r.hz, r.phase_deg, m.colour) for m, r in responses.items()]
    parts += [
        Panel("pitch asked for → measured: gain", "Hz", "dB", gain, log_x=True),
        Panel("phase", "Hz", "°", phase, log_x=True),
    ]
    rows: list[tuple[str, ...]] = []
    facts: dict[str, float] = {}
    for m, t in traces.items():
        r = responses[m]
        at = {f: _at(r, f) for f in AT_HZ}
        three = at[3.0]
        delay_ms = np.nan if three is None else -1e3 * np.angle(three) / (2.0 * np.pi * 3.0)
        facts |= {f"chirp_rms_{m.short}_mm": t.rms_mm, f"chirp_lag_{m.short}_s": 1e-3 * delay_ms}
        cells = [
            "not told"
            if g is None
            else f"{20.0 * np.log10(abs(g)):+.2f} / {_round(np.degrees(np.angle(g)), 0)}"
            for g in at.values()
        ]
        rows.append((m.name, f"{t.rms_mm:.3f}", *cells, _round(delay_ms, 1)))
    servo, torque = traces[SERVO], traces[TORQUE]
    words = prose.CHIRP.filled(
        size=1e3 * CHIRP_RAD,
        high=HIGH_HZ,
        torque=torque.rms_mm,
        servo=servo.rms_mm,
        torque_ms=_round(1e3 * facts["chirp_lag_torque_s"], 1),
        servo_ms=_round(1e3 * facts["chirp_lag_servo_s"], 1),
    )
    head = ("", "RMS error, mm", *(f"{f:g} Hz: dB / °" for f in AT_HZ), "lag at 3 Hz, ms")
    return Section(words, (panels(parts, columns=2, height=240),), Table(head, tuple(rows)), facts)


def _cut(t: Trace, start_s: float, end_s: float, zero_s: float = 0.0) -> Trace:
    inside = (t.t_s >= start_s) & (t.t_s <= end_s)
    return Trace(t.t_s[inside] - zero_s, t.wanted_mm[inside], t.measured_mm[inside])


def _step_row(t: Array, y_mm: Array) -> tuple[str, str, str]:
    """Rise, settling and overshoot of a step at t = 0, as text."""
    y = y_mm / (1e3 * STEP_M)
    rise_s = _reaches(t, y, 0.9) - _reaches(t, y, 0.1)
    out = np.flatnonzero(np.abs(y - 1.0) > SETTLED)
    settled = f"{1e3 * t[out[-1] + 1]:.0f}" if out[-1] + 1 < len(t) else "not"
    return f"{1e3 * rise_s:.0f}", settled, f"{100.0 * max(float(y.max()) - 1.0, 0.0):.1f}"


def _reaches(t: Array, y: Array, level: float) -> float:
    k = int(np.argmax(y >= level))
    return float(np.interp(level, y[k - 1 : k + 1], t[k - 1 : k + 1])) if k else float("nan")


def _response(p: Played) -> FrequencyResponse:
    """Of pitch to its cue, up to where the chirp begins to fade."""
    plan = p.description.plan
    assert isinstance(plan, Chirp)
    whole_hz = plan.f_max - (plan.f_max - plan.f_min) * plan.fade_s / plan.duration_s
    found = analyse([p.run], p.job.rig, output_name="pitch", method="local", highest_hz=whole_hz)
    r = found.response
    sure = r.radius < SURE * np.abs(r.value)
    return replace(
        r,
        hz=r.hz[sure],
        value=r.value[sure],
        std=r.std[sure],
        freedom=r.freedom[sure],
        coherence=r.coherence[sure],
    )


def _round(value: float, digits: int) -> str:
    """Without a minus before zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def _at(response: FrequencyResponse, hz: float) -> complex | None:
    """The response there; None beyond its lines."""
    if not response.hz[0] - BESIDE_HZ <= hz <= response.hz[-1] + BESIDE_HZ:
        return None
    real = np.interp(hz, response.hz, response.value.real)
    return complex(real, np.interp(hz, response.hz, response.value.imag))
