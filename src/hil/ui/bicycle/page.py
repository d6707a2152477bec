"""The page of a ride: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from hil.bicycle.analysis import Analysis
from hil.rigs.bicycle import canonical
from hil.ui.bicycle.animation import animation
from hil.ui.bicycle.figures import (
    force_figure,
    imu_figure,
    path_figure,
    told_figure,
    torque_figure,
)
from hil.ui.page import page

RATES = (("imu.gyro_y", "pitch rate, rad/s"), ("imu.gyro_z", "yaw rate, rad/s"),
         ("imu.gyro_x", "roll rate, rad/s"))  # fmt: skip
ACCELERATIONS = (("imu.accel_x", "forward, m/s²"), ("imu.accel_z", "vertical, m/s²"),
                 ("imu.accel_y", "to the left, m/s²"))  # fmt: skip
NUMBERS: Final = (
    "By noise alone: what the sensors' noise, by the rig file, would leave of a perfect model, filtered. "
    "Explained: share of the variance of what the sensor gave, both filtered; where noise is larger than all "
    "that was measured it is too quiet to judge."
)


def ride_page(a: Analysis, out_html: Path) -> Path:
    """Write the page of an analysed ride; RunError where it cannot be written."""
    n = a.numbers()
    cutoff = a.ride.rig.conditioning.cutoff
    sections = [
        ("The ride", "Drag to turn, scroll to come nearer.", animation(a)),
        ("Numbers", _findings(a), _numbers(a)),
        ("Path", _drift(a), path_figure(a)),
        (
            "What was measured",
            f"Smooth: Butterworth low-pass at {cutoff:g} Hz, no delay.",
            told_figure(a),
        ),
    ]
    note = (
        "The gyroscope and accelerometer took no part in the computation. Blue and red went through the same "
        f"filter at {cutoff:g} Hz; pale is what the sensor gave."
    )
    rates, accelerations = imu_figure(a, RATES), imu_figure(a, ACCELERATIONS)
    if rates is not None:
        sections.append(("Angular rates: model and gyroscope", note, rates))
    if accelerations is not None:
        sections.append(("Accelerations: model and accelerometer", note, accelerations))
    if n["imu"]:
        sections.append(("Model and IMU in numbers", NUMBERS, _imu_table(a)))
    share = (
        f" ({n['lean_torque_noise_rms']:.1f} of {n['lean_torque_rms']:.1f} N·m rms)"
        if a.rolls.any()
        else ""
    )
    sections += [
        (
            "Torques",
            "Of the rider, from the multipliers. No lean torque acts on a free bicycle: what is left is "
            f"noise{share}, a foot on the ground, or motion that the model has not.",
            torque_figure(a),
        ),
        (
            "Forces on the road",
            "Friction demand: tangential over normal force; the road must give so much.",
            force_figure(a),
        ),
        ("Stability", "", _stability(a)),
    ]
    title = f"Ride of {escape(a.ride.rig.name)}"
    length = f"{n['duration_s']:.1f} s, {n['distance_m']:.0f} m, up to {n['speed_max']:.2f} m/s"
    subtitle = f"{escape(a.ride.name)}: {length}"
    return page(out_html, title, subtitle, sections)


def _findings(a: Analysis) -> str:
    return "<br>".join(escape(f"{f.verdict}: {f.subject}: {f.text}") for f in a.findings)


def _drift(a: Analysis) -> str:
    d = a.drift.numbers()
    closing = ""
    if a.drift.closing_steer is not None:
        closing = (
            f" If the ride did end where it began, a steer bias of {np.rad2deg(a.drift.closing_steer):+.3f}° "
            f"accounts for it, {a.drift.closing_gap:.2f} m apart."
        )
    return (
        f"The path ends {d['end_distance_m']:.2f} m from its start. Integration moved the end by "
        f"{1e3 * d['integration_m']:.2g} mm; one step of a steer encoder (0.15°) would by "
        f"{d['steer_bias_one_step_m']:.2f} m, a degree of lean by {d['lean_bias_one_degree_m']:.2f} m, one "
        f"percent of wheel radius by {d['wheel_radius_one_percent_m']:.2f} m.{closing}"
    )


def _numbers(a: Analysis) -> str:
    n, m = a.numbers(), a.motion

    def span(key: str, unit: str, digits: int = 2) -> str:
        return f"{n[key]['lowest']:.{digits}f} … {n[key]['highest']:.{digits}f} {unit}"

    front, rear = n["friction_demand_front"], n["friction_demand_rear"]
    rows = [
        ("lean (right +)", span("lean", "rad", 3)),
        ("steer (left +)", span("steer", "rad", 3)),
        ("pitch of the frame", span("frame_pitch", "rad", 4)),
        ("steer torque (left +)", span("steer_torque", "N·m")),
        ("drive torque", span("drive_torque", "N·m", 1)),
        (
            "normal force, front",
            f"{span('normal_front', 'N', 0)}, mean {n['normal_front']['mean']:.1f} N",
        ),
        ("normal force, rear", span("normal_rear", "N", 0)),
        (
            "constraint of the contact's slope",
            f"{np.abs(m.multipliers[:, 1]).max():.1e} N·m, must be 0",
        ),
    ]
    if a.rolls.any():
        rows += [
            (
                "drive torque off the reduced inertia's",
                f"{n['drive_torque_off_reduced_inertia_rms']:.2f} of {n['drive_torque_rms']:.2f} N·m rms "
                f"({n['reduced_inertia']:.3f} kg·m², with drag)",
            ),
            ("friction demand, front", f"{front['peak']:.2f} at {front['t_s']:.2f} s"),
            ("friction demand, rear", f"{rear['peak']:.2f} at {rear['t_s']:.2f} s"),
            (
                "lean torque left, rolling",
                f"{n['lean_torque_rms']:.2f} N·m rms, by noise alone {n['lean_torque_noise_rms']:.2f}",
            ),
        ]
    return _table([("", ""), *rows])


def _imu_table(a: Analysis) -> str:
    rows = [
        (
            "signal",
            "off, raw",
            "off, filtered",
            "by noise alone",
            "bias",
            "correlation",
            "explained",
        )
    ]
    by = {(c.signal, c.filtered): c for c in a.compared}
    for signal in dict.fromkeys(c.signal for c in a.compared):
        raw, soft = by[signal, False], by[signal, True]
        rows.append(
            (
                signal,
                f"{raw.rms:.4f} {raw.unit}",
                f"{soft.rms:.4f}",
                f"{soft.floor:.4f}",
                f"{soft.bias:+.4f}",
                f"{soft.correlation:.3f}",
                soft.said,
            )
        )
    return _table(rows)


def _stability(a: Analysis) -> str:
    linear = canonical(a.bicycle)
    stable = linear.stable_range()
    said = (
        "it is at no speed up to 15 m/s"
        if stable is None
        else f"{stable[0]:.2f} to {stable[1]:.2f} m/s"
    )
    rows = [("speed", "eigenvalues near straight running, 1/s")]
    for speed in (2.0, 4.0, 6.0, 8.0):
        values = linear.eigenvalues(speed)[0]
        text = ", ".join(
            f"{v.real:.2f} ± {v.imag:.2f}i" if v.imag > 1e-9 else f"{v.real:.2f}"
            for v in values
            if v.imag >= -1e-9
        )
        rows.append((f"{speed:g} m/s", text))
    return f"<p class='note'>Stable by itself: {said}.</p>" + _table(rows)


def _table(rows: Sequence[tuple[str, ...]]) -> str:
    head, *body = rows
    out = ["<table>"]
    if any(head):
        out.append("<tr>" + "".join(f"<th>{escape(h)}</th>" for h in head) + "</tr>")
    out += ["<tr>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>" for row in body]
    return "".join([*out, "</table>"])
