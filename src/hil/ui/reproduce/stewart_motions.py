"""The Stewart platform's figures 5 to 8: circle, sweep of yaw, and heave that no fit has seen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.rigs import build_rig
from hil.ui.page import PALETTE
from hil.ui.reproduce import stewart_prose as prose
from hil.ui.reproduce.bench import Played
from hil.ui.reproduce.curves import COMMANDED, MEASURED, SIMULATED, Curve, Panel, panels
from hil.ui.reproduce.poses import Motions, following_error, motions_of, replayed
from hil.ui.reproduce.prose import Prose
from hil.ui.reproduce.report import Section, Table
from hil.ui.reproduce.stewart_fit import TwoStage
from hil.ui.reproduce.stewart_rig import HYSTERESIS

Array = NDArray[np.float64]
LEG: Final = "leg1"
MARKS: Final = 8
"""Instants marked along the circle."""
BESIDE_S: Final = (0.3, 1.2)
"""From a turn of a leg: where the following error is read on either side."""
EXPLAINED: Final = 0.5
"""An axis is met where less than this share of its spread is left."""


def circle_section(played: Mapping[str, Played], stages: TwoStage) -> Section:
    """Figure 5."""
    p = played["circle"]
    rig = p.job.rig
    moved = motions_of(p, stages.model)
    segment = p.description.segments[0]
    x, y = moved.measured[:, 0], moved.measured[:, 1]
    at = np.linspace(segment.start_s, segment.end_s, MARKS, endpoint=False)
    marks = np.searchsorted(moved.t_s, at)
    plan = Panel(
        "(a) trajectory, measured",
        "sway y, m",
        "surge x, m",
        [
            Curve("path", y, x, MEASURED),
            Curve("marked instants", y[marks], x[marks], PALETTE[2], "markers"),
        ],
    )
    t, length, error = following_error(p, LEG, stages.delay_s)
    simulated = _simulated_error(p, stages)
    smooth = _running_mean(t, error, 0.3)
    k = rig.actuator_names.index(LEG)
    own = rig.actuators[k]
    static = [
        (1.0 - own.static_ff) * build_rig(rig).static_forces(q)[k] / own.position_gain
        for q in moved.measured[::10]
    ]
    parts = [
        Panel(f"(b) length of {LEG}", "t, s", "m", [Curve("measured", t, length, MEASURED)]),
        Panel(
            "following error, commanded − measured",
            "t, s",
            "µm",
            [
                Curve("each sample", t, 1e6 * error, "#fdba74"),
                Curve("measured", t, 1e6 * smooth, MEASURED),
                Curve("simulated", simulated[0], 1e6 * simulated[1], SIMULATED),
                Curve(
                    "static: (1 − K_s) F / K_p",
                    moved.t_s[::10],
                    1e6 * np.array(static),
                    COMMANDED,
                    "dash",
                ),
            ],
        ),
    ]
    trajectory = panels([plan], height=400)
    trajectory.update_layout(width=520)
    trajectory.update_yaxes(scaleanchor="x", scaleratio=1.0)
    trajectory.update_xaxes(autorange="reversed")
    for m, t_s in zip(marks, moved.t_s[marks], strict=True):
        trajectory.add_annotation(
            x=float(y[m]), y=float(x[m]), text=f"{t_s:.0f} s", ax=26 * np.sign(-y[m]), ay=-16,
            arrowwidth=0.6, font={"size": 11},
        )  # fmt: skip
    steady = (t > segment.start_s) & (t < segment.end_s)
    offset_m = float(np.mean(error[steady]))
    jump_m = _jump(t[steady], length[steady], error[steady])
    peak_m = float(np.ptp(smooth[steady]))
    rows = (
        ("length of leg 1, m", f"{length[steady].min():.3f} … {length[steady].max():.3f}"),
        ("mean following error, µm", f"{1e6 * offset_m:.1f}"),
        ("(1 − K_s) F / K_p, mean, µm", f"{1e6 * float(np.mean(static)):.1f}"),
        ("lengthening minus shortening at its turns, µm", f"{1e6 * jump_m:.1f}"),
        ("range of the smoothed error, µm", f"{1e6 * peak_m:.1f}"),
    )
    facts = {
        "leg1_low_m": float(length[steady].min()),
        "leg1_high_m": float(length[steady].max()),
        "following_mean_m": offset_m,
        "following_static_m": float(np.mean(static)),
        "following_jump_m": jump_m,
    }
    words = prose.CIRCLE.filled(
        mean=1e6 * offset_m,
        static=1e6 * float(np.mean(static)),
        jump=1e6 * jump_m,
        friction=2e6 * (own.coulomb + HYSTERESIS["force"]) / own.position_gain,
    )
    table = Table((f"{LEG} on the circle", ""), rows)
    return Section(words, (trajectory, panels(parts, height=230)), table, facts)


def circle_pose_section(played: Mapping[str, Played], stages: TwoStage) -> Section:
    """Figure 6."""
    moved = motions_of(played["circle"], stages.model)
    left = moved.rms(moved.simulated)
    words = prose.CIRCLE_POSE.filled(
        surge=1e6 * left[0],
        sway=1e6 * left[1],
        sag=-1e6 * float(np.mean(moved.measured[:, 2])),
        roll=1e3 * np.degrees(left[3]),
    )
    return _pose_section(words, moved, "circle")


def yaw_section(played: Mapping[str, Played], stages: TwoStage) -> Section:
    """Figure 7."""
    moved = motions_of(played["yaw"], stages.model)
    left = moved.rms(moved.simulated)
    spread = np.std(moved.measured, axis=0)
    moment = stages.values["mass.inertia.zz"]
    words = prose.YAW.filled(
        yaw=100.0 * left[5] / spread[5],
        surge=1e6 * spread[0],
        sway=1e6 * spread[1],
        surge_left=1e6 * left[0],
        sway_left=1e6 * left[1],
        verdict=_verdict(stages, left, spread),
        moment=moment.value,
        half=moment.half,
    )
    return _pose_section(words, moved, "yaw")


def heave_section(played: Mapping[str, Played], stages: TwoStage) -> Section:
    """Figure 8."""
    moved = motions_of(played["heave"], stages.model)
    left = moved.rms(moved.simulated)
    spread = np.std(moved.measured, axis=0)
    words = prose.HEAVE.filled(
        heave=100.0 * left[2] / spread[2],
        micro=1e6 * left[2],
        yaw=1e3 * np.degrees(np.ptp(moved.measured[:, 5])),
        yaw_model=1e3 * np.degrees(np.ptp(moved.simulated[:, 5])),
    )
    return _pose_section(words, moved, "heave")


def _pose_section(words: Prose, moved: Motions, name: str) -> Section:
    left = moved.rms(moved.simulated)
    facts = {f"{name}_{c}_left": float(x) for c, x in zip(moved.coordinates, left, strict=True)} | {
        f"{name}_{c}_spread": float(x)
        for c, x in zip(moved.coordinates, np.std(moved.measured, axis=0), strict=True)
    }
    return Section(words, (panels(moved.panels(), columns=3, height=210),), moved.table(), facts)


def _simulated_error(p: Played, stages: TwoStage) -> tuple[Array, Array]:
    """(t, following error) of the twin, by the same reckoning."""
    t, x = replayed(p, stages.model)[LEG]
    _, measured, error = following_error(p, LEG, stages.delay_s)
    at, _ = p.samples(f"{LEG}.position")
    commanded = measured + error
    answer = np.interp(at, t, x)
    return at - p.start_s, _running_mean(at, commanded - answer, 0.3)


def _running_mean(t: Array, values: Array, over_s: float) -> Array:
    count = max(1, round(over_s / float(np.median(np.diff(t)))))
    kernel = np.ones(count)
    return np.asarray(
        np.convolve(values, kernel, "same") / np.convolve(np.ones_like(values), kernel, "same")
    )


def _verdict(stages: TwoStage, left: Array, spread: Array) -> str:
    """In words: which of the undriven axes the circle's CoG explains; surge goes with y, sway with x."""
    said = []
    for axis, k, c in (("sway", 1, "x"), ("surge", 0, "y")):
        found = stages.values[f"mass.cog.{c}"]
        where = f"{c}_cog, {found.text(0, 1e3)} mm by the circle"
        if left[k] < EXPLAINED * spread[k]:
            said.append(f"{axis.capitalize()} goes with {where}, and is met.")
        else:
            said.append(
                f"{axis.capitalize()} goes with {where}, and is not met: the circle has not told it well "
                "enough, and the sweep could tell it better."
            )
    return " ".join(said)


def _jump(t: Array, length: Array, error: Array) -> float:
    """Following error just before and after the leg turns: lengthening minus shortening, mean of turns, m.

    Close to the turn speed is small, so neither a delay nor viscous friction is in it.
    """
    speed = np.gradient(_running_mean(t, length, 0.5), t)
    turns = t[1:][np.diff(np.sign(speed)) != 0.0]
    jumps = []
    for turn in turns[(turns > t[0] + BESIDE_S[1]) & (turns < t[-1] - BESIDE_S[1])]:
        before, after = (
            float(np.mean(error[(way > BESIDE_S[0]) & (way < BESIDE_S[1])]))
            for way in (turn - t, t - turn)
        )
        was_growing = float(np.interp(turn - BESIDE_S[0], t, speed)) > 0.0
        jumps.append(before - after if was_growing else after - before)
    return float(np.mean(jumps)) if jumps else float("nan")
