"""The page about the bicycle: the paper's ride simulated with what its bicycle had and its model has not."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.bicycle.analysis import Analysis, analyse
from hil.bicycle.manoeuvres import manoeuvre
from hil.bicycle.recorded import prepare
from hil.bicycle.simulated import save
from hil.bicycle.weave import SteerControl, fit_impulses, read_windows
from hil.bicycle.weave_causes import diagnose_weave
from hil.config import BicycleFile
from hil.configfile import find_rig_file, load_bicycle, parse_any_rig
from hil.gap.apply import applied_text
from hil.gap.bicycle import diagnose_rides
from hil.runs import Run, load_run
from hil.ui.bicycle.figures import force_figure, imu_figure, path_figure, torque_figure
from hil.ui.reproduce import bicycle_prose as prose
from hil.ui.reproduce.report import Report, Section, Table, write_report
from hil.units import with_unit

Progress = Callable[[str], None]

FORK: Final = {"stiffness": 9e3, "damping": 400.0}
TYRES: Final = {"stiffness": 1.2e5, "damping": 250.0}
ROAD_M: Final = 0.0006
SEED: Final = 8
STEERED: Final = SteerControl(2.0, 6.5)
"""Of the measured bicycle, by its authors."""


def bicycle_report(out_html: Path, runs: Path, measured: Path | None, progress: Progress) -> Report:
    """Ride, analyse, diagnose, write. `runs`: where the rides are kept; `measured`: a folder with
    impulse_windows.json and logs/, or None. RunError where a file cannot be read or written."""
    rig = load_bicycle("bicycle")
    progress("riding there and back, and a slalom")
    rides = [_ridden(rig, track, runs) for track in ("u-turns", "slalom")]
    progress("analysing")
    a = analyse(prepare(rides[0], rig))
    n = a.numbers()
    sections = [_path(a, n), _rates(a, n), _accelerations(a), _torques(a, n), _forces(a, n)]
    progress("looking for what the model lacks")
    sections.append(_gap(rides, rig))
    if measured is not None:
        progress("fitting the measured weave")
        sections.append(_weave(measured))
    opening = prose.OPENING.format(
        rig="configs/bicycle.toml", fork=FORK["stiffness"] / 1e3, tyre=TYRES["stiffness"] / 1e3,
        road=1e3 * ROAD_M,
    )  # fmt: skip
    return write_report(out_html, prose.PAPER, "The ride of section 8", opening, sections)


def _ridden(rig: BicycleFile, track: str, runs: Path) -> Run:
    tables = rig.model_dump()
    tables["effects"] = [
        {"effect": "front_suspension", "location": "bicycle", "parameters": FORK},
        {"effect": "tyre_compliance", "location": "bicycle", "parameters": TYRES},
    ]
    real = BicycleFile.model_validate(tables)
    folder = save(
        manoeuvre(track).ride(real, SEED, road_m=ROAD_M), runs / track, f"reproduce: {track}"
    )
    return load_run(folder, rig)


def _path(a: Analysis, n: dict[str, Any]) -> Section:
    d = n["drift"]
    closing = ""
    if d["closing_steer_bias"] is not None:
        closing = (
            f" A steer bias of {np.degrees(d['closing_steer_bias']):+.2f}° takes the end to "
            f"{d['closing_gap_m']:.2f} m."
        )
    words = prose.PATH.filled(
        end=d["end_distance_m"], integration=1e3 * d["integration_m"], steer=d["steer_bias_one_step_m"],
        lean=d["lean_bias_one_degree_m"], radius=d["wheel_radius_one_percent_m"], closing=closing,
    )  # fmt: skip
    facts = {
        "end_m": d["end_distance_m"],
        "integration_m": d["integration_m"],
        "steer_step_m": d["steer_bias_one_step_m"],
        "lean_degree_m": d["lean_bias_one_degree_m"],
    }
    return Section(words, (path_figure(a),), None, facts)


def _rates(a: Analysis, n: dict[str, Any]) -> Section:
    c = {x.signal: x for x in a.compared if x.filtered}
    pitch, yaw = c["imu.gyro_y"], c["imu.gyro_z"]
    seen, model = a.filtered["imu.gyro_y"]
    larger = float(np.std(seen) / np.std(model))
    words = prose.RATES.filled(
        yaw=yaw.rms, yaw_explained=100.0 * yaw.explained, pitch=pitch.rms,
        pitch_explained=100.0 * pitch.explained, larger=larger,
    )  # fmt: skip
    figure = imu_figure(a, (("imu.gyro_y", "pitch rate, rad/s"), ("imu.gyro_z", "yaw rate, rad/s")))
    facts = {"pitch_rms": pitch.rms, "yaw_rms": yaw.rms, "pitch_larger": larger}
    return Section(words, () if figure is None else (figure,), None, facts)


def _accelerations(a: Analysis) -> Section:
    raw = {x.signal: x for x in a.compared if not x.filtered}
    soft = {x.signal: x for x in a.compared if x.filtered}
    model = a.filtered["imu.accel_z"][1]
    forward, vertical = raw["imu.accel_x"], raw["imu.accel_z"]
    words = prose.ACCELERATIONS.filled(
        forward=forward.rms, forward_soft=soft["imu.accel_x"].rms, vertical_seen=vertical.spread,
        vertical_model=float(np.std(model)),
    )  # fmt: skip
    figure = imu_figure(a, (("imu.accel_x", "forward, m/s²"), ("imu.accel_z", "vertical, m/s²")))
    facts = {"forward_rms": forward.rms, "forward_filtered_rms": soft["imu.accel_x"].rms,
             "vertical_spread": vertical.spread}  # fmt: skip
    return Section(words, () if figure is None else (figure,), None, facts)


def _torques(a: Analysis, n: dict[str, Any]) -> Section:
    off = n["drive_torque_off_reduced_inertia_rms"]
    words = prose.TORQUES.filled(
        drive=n["drive_torque_rms"],
        off=off,
        lean=n["lean_torque_rms"],
        noise=n["lean_torque_noise_rms"],
    )
    facts = {"drive_torque_rms": n["drive_torque_rms"], "reduced_inertia_off_rms": off,
             "lean_torque_rms": n["lean_torque_rms"]}  # fmt: skip
    return Section(words, (torque_figure(a),), None, facts)


def _forces(a: Analysis, n: dict[str, Any]) -> Section:
    front = n["normal_front"]
    words = prose.FORCES.filled(
        low=front["lowest"], high=front["highest"], mean=front["mean"],
        front=n["friction_demand_front"]["peak"], rear=n["friction_demand_rear"]["peak"],
    )  # fmt: skip
    facts = {
        "front_normal_mean": front["mean"],
        "friction_front": n["friction_demand_front"]["peak"],
    }
    return Section(words, (force_figure(a),), None, facts)


def _gap(rides: list[Run], rig: BicycleFile) -> Section:
    found = diagnose_rides(rides, rig)
    rows = tuple(
        (
            f"{c.effect.replace('_', ' ')} at {c.location}",
            f"{c.probability:.3f}",
            ", ".join(
                with_unit(f"{k} {v.value:.4g} ({v.ci[0]:.4g} … {v.ci[1]:.4g})", v.unit)
                for k, v in c.parameters.items()
            ),
            "" if c.shrink is None else f"{100.0 * c.shrink:.0f} %",
        )
        for c in found.causes[:4]
    )  # fmt: skip
    before = _pitch(rides[1], rig)
    after = before
    if found.verdict == "identified":
        answer = json.loads(found.to_json())
        text = find_rig_file("bicycle").read_text(encoding="utf-8")
        applied = parse_any_rig(
            tomllib.loads(applied_text(text, answer, when="reproduced")), "applied"
        )
        assert isinstance(applied, BicycleFile)
        after = _pitch(rides[1], applied)
    named = {c.effect for c in found.effects}
    tyres = (
        ""
        if "tyre_compliance" in named
        else "The tyres, far stiffer, stand behind it: their part of the pitch goes into the suspension's "
        "stiffness, and their own mark, the vertical acceleration, lies below the floor at these "
        "frequencies."
    )
    words = prose.GAP.filled(sentence=found.sentence, before=before, after=after, tyres=tyres)
    facts = {"pitch_before": before, "pitch_after": after}
    if found.score is not None and found.score.shrink is not None:
        facts["shrink"] = found.score.shrink
    head = ("cause", "probability", "parameters (90 %)", "shrink")
    return Section(words, (), Table(head, rows), facts)


def _pitch(run: Run, rig: BicycleFile) -> float:
    a = analyse(prepare(run, rig))
    return next(c.rms for c in a.compared if c.filtered and c.signal == "imu.gyro_y")


def _weave(folder: Path) -> Section:
    windows = [w for w in read_windows(folder / "impulse_windows.json") if w.group.endswith("OFF")]
    impulses = fit_impulses(windows, folder / "logs")
    found = diagnose_weave(impulses, load_bicycle("bicycle_delft"), STEERED)
    gain, offset = found.speed_gain or (float("nan"), float("nan"))
    words = prose.WEAVE.filled(
        count=found.impulses, sentence=found.sentence, gain=gain, offset=offset, whole=found.whole
    )
    rows = tuple(
        (
            c.name,
            ", ".join(f"{k} {v:.3g}" for k, v in c.values.items()),
            f"{c.after:.3f}",
            "not excited" if c.shrink is None else f"{100.0 * c.shrink:.0f} %",
        )
        for c in found.causes
    )
    facts = {"weave_whole": found.whole, "weave_before": found.before, "speed_gain": gain}
    facts |= {f"weave_after_{c.name.replace(' ', '_')}": c.after for c in found.causes}
    head = ("cause", "values", "unseen impulses, 1/s", "shrink")
    return Section(words, (), Table(head, rows), facts)
