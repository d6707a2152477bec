"""The Stewart platform's figure 2: the describing function in heave, and the filter found from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.identify.frequency.frf import FrfAnalysis, analyse
from hil.identify.frequency.parametric import (
    NAMES,
    SecondOrderFit,
    fit_second_order,
    second_order,
)
from hil.identify.frequency.response import ComplexArray, FrequencyResponse
from hil.ui.page import PALETTE
from hil.ui.reproduce import stewart_prose as prose
from hil.ui.reproduce.bench import Played
from hil.ui.reproduce.curves import COMMANDED, Curve, Panel, panels
from hil.ui.reproduce.report import Lengths, Section, Table
from hil.ui.reproduce.stewart_rig import IMU_HZ, IN_STEP, SIX_HZ

SIGNALS: Final = ("five", "six")
POSE: Final = "filter by measured pose"
TOLD: Final = "filter by setpoints"
IMU: Final = "imu.accel_z"
SENSORS: Final = {"heave": "encoders, by forward kinematics", IMU: "IMU, vertical"}
ROWS: Final = {
    TOLD: "found: cue → recorded setpoints",
    "heave": "found: cue → pose by encoders",
    IMU: "found: cue → IMU",
    IN_STEP: "found: cue → IMU in step with the setpoints",
}
EQUAL: Final = {"damping": 1.0}
DELAY_ALONE: Final = {"gain": 1.0, "damping": 1.0, "frequency": 1.0e6}


def filter_section(played: Mapping[str, Played], lengths: Lengths) -> Section:
    """Figure 2."""
    rig = played["five"].job.rig
    assert rig.control.platform_filter is not None
    own = rig.control.platform_filter
    analysed = {s: [_analysed(played[x], rig, lengths, s) for x in SIGNALS] for s in SENSORS}
    poses = analysed["heave"]
    whole, command = ({f: k for a in poses for f, k in _known(a, name)} for name in (POSE, TOLD))
    found = {s: joined([a.response for a in parts]) for s, parts in analysed.items()}
    found[IMU] = _as_position(found[IMU])
    told = joined([a.links["cue to setpoints"] for a in poses])
    fits = {TOLD: fit_second_order(told, _at(command, told), EQUAL)}
    fits |= {s: fit_second_order(r, _at(whole, r), EQUAL) for s, r in found.items()}
    fits[IN_STEP] = _in_step(played[IN_STEP], lengths, fits[TOLD].parameters["frequency"].value)
    drives = joined([a.links["setpoints to pose"] for a in poses])
    late = fit_second_order(drives, _at(whole, drives) / _at(command, drives), DELAY_ALONE)
    clock_s = late.parameters["delay"]
    hz = np.geomspace(0.1, 10.0, 200)
    asked = second_order(hz, 1.0, own.frequency, 1.0, own.delay)
    gain, phase = _pictures(found, whole, hz, asked)
    figure = panels([gain, phase], columns=2, height=330)
    rows = [("given to the simulated rig", f"{own.frequency:g}", f"{1e3 * own.delay:g}", "1", "")]
    facts = {
        "delay_true_s": own.delay,
        "frequency_true_hz": own.frequency,
        "clock_delay_s": clock_s.value,
    }
    for name, fit in fits.items():
        p = fit.parameters
        rows.append(
            (
                ROWS[name],
                _with_interval(fit, "frequency") if name != IN_STEP else "held",
                _with_interval(fit, "delay", 1e3),
                _with_interval(fit, "gain", digits=4),
                f"{fit.misfit:.1f}",
            )
        )
        key = {TOLD: "setpoints", "heave": "pose", IMU: "imu"}.get(name, name)
        for what, unit in (("delay", "_s"), ("frequency", "_hz"), ("gain", "")):
            if what in p:
                low, high = p[what].interval
                facts[f"{what}_{key}{unit}"] = p[what].value
                facts[f"{what}_{key}_low{unit}"], facts[f"{what}_{key}_high{unit}"] = low, high
    rows.append(
        ("the drives' clock, setpoints → pose", "", _with_interval(late, "delay", 1e3), "", "")
    )
    words = prose.FILTER.filled(
        delay=1e3 * fits[TOLD].parameters["delay"].value,
        frequency=fits[TOLD].parameters["frequency"].value,
        pose=1e3 * fits["heave"].parameters["delay"].value,
        clock=1e3 * clock_s.value,
        highest=max(SIX_HZ),
        imu_hz=IMU_HZ,
        locked_hz=played[IN_STEP].job.rig.imu.rate if played[IN_STEP].job.rig.imu else 0.0,
        imu_gain=100.0 * (fits[IMU].parameters["gain"].value - 1.0),
        locked_gain=100.0 * (fits[IN_STEP].parameters["gain"].value - 1.0),
        periods=lengths.periods,
    )
    head = ("", "break frequency, Hz (95 %)", "delay, ms (95 %)", "gain (95 %)", "misfit / noise")
    return Section(words, (figure,), Table(head, tuple(rows)), facts)


def joined(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """The lines of several responses as one, by frequency."""
    hz = np.concatenate([p.hz for p in parts])
    order = np.argsort(hz)
    return replace(
        parts[0],
        hz=hz[order],
        value=np.concatenate([p.value for p in parts])[order],
        std=np.concatenate([p.std for p in parts])[order],
        freedom=np.concatenate([p.freedom for p in parts])[order],
        coherence=np.concatenate([p.coherence for p in parts])[order],
        extra_std={},
    )


def _analysed(played: Played, rig: RigFile, lengths: Lengths, sensor: str) -> FrfAnalysis:
    return analyse(
        [played.run],
        rig,
        input_name="cue.heave",
        output_name=sensor,
        period_s=lengths.multisine_s,
        highest_hz=max(SIX_HZ) + 0.4,
    )


def _known(found: FrfAnalysis, name: str) -> list[tuple[float, complex]]:
    """By line: what stands beside the filter, as the analysis reckons with it in its fit `name`."""
    fit = found.fits.get(name)
    if fit is None:
        raise IdentificationError(f"no model of the platform filter: {'; '.join(found.notes)}")
    own = second_order(fit.hz, *(fit.parameters[n].value for n in NAMES))
    factor: ComplexArray = fit.model / own
    return list(zip(fit.hz.tolist(), factor.tolist(), strict=True))


def _at(known: Mapping[float, complex], response: FrequencyResponse) -> ComplexArray:
    return np.array([known[f] for f in response.hz])


def _pictures(
    found: Mapping[str, FrequencyResponse],
    known: Mapping[float, complex],
    hz: np.ndarray,
    asked: ComplexArray,
) -> tuple[Panel, Panel]:
    """Gain and phase over rad/s, as the paper draws them: analytic H and what was measured of it."""
    omega = 2.0 * np.pi * hz
    gains = [Curve("H, analytic", omega, 20.0 * np.log10(np.abs(asked)), COMMANDED)]
    phases = [Curve("H, analytic", omega, np.degrees(np.unwrap(np.angle(asked))), COMMANDED)]
    for (sensor, r), colour in zip(found.items(), (PALETTE[0], PALETTE[1]), strict=True):
        bare = replace(r, value=r.value / _at(known, r))
        low, high = bare.gain_band_db
        name = f"measured: {SENSORS[sensor]}"
        w = 2.0 * np.pi * r.hz
        gains.append(Curve(name, w, bare.gain_db, colour, "markers", 0.5 * (high - low)))
        low, high = bare.phase_band_deg
        phases.append(Curve(name, w, bare.phase_deg, colour, "markers", 0.5 * (high - low)))
    return (
        Panel("|H|", "ω, rad/s", "dB", gains, log_x=True),
        Panel("phase of H", "ω, rad/s", "°", phases, log_x=True),
    )


def _in_step(played: Played, lengths: Lengths, frequency_hz: float) -> SecondOrderFit:
    """Gain and delay by an IMU that samples in step with the setpoints, the filter's frequency known."""
    rig = played.job.rig
    known = dict(_known(_analysed(played, rig, lengths, "heave"), POSE))
    response = _as_position(_analysed(played, rig, lengths, IMU).response)
    return fit_second_order(response, _at(known, response), {**EQUAL, "frequency": frequency_hz})


def _as_position(acceleration: FrequencyResponse) -> FrequencyResponse:
    """The response of the position whose acceleration was measured."""
    twice = (2j * np.pi * acceleration.hz) ** 2
    return replace(
        acceleration, value=acceleration.value / twice, std=acceleration.std / np.abs(twice)
    )


def _with_interval(fit: SecondOrderFit, name: str, factor: float = 1.0, digits: int = 2) -> str:
    p = fit.parameters[name]
    low, high = (f"{factor * x:.{digits}f}" for x in p.interval)
    return f"{factor * p.value:.{digits}f} ({low} … {high})"
