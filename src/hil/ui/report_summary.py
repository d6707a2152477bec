"""The ten lines that sum up a run, for page and terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from hil.config import RigFile
from hil.runs import Run
from hil.ui.report_data import Quantity, RunView, signal, view


def summary_lines(run: Run) -> list[str]:
    """Ten lines, each `label: text`."""
    return [f"{label}: {text}" for label, text in summary(view(run))]


def summary(shown: RunView) -> list[tuple[str, str]]:
    """Ten pairs of label and text."""
    run = shown.run
    return [
        ("rig", _rig(run)),
        ("recording", _extent(run)),
        ("states", _states(shown)),
        ("pose error", _errors(shown.coordinates)),
        ("actuator error", _errors(shown.actuators)),
        ("force", _forces(shown)),
        ("bus", _bus(run)),
        ("loop", _loop(shown)),
        ("events", _events(run)),
        ("limits", _limits(shown)),
    ]


def _rig(run: Run) -> str:
    kind = f" ({run.rig.kind})" if run.rig else ""
    when = f", {run.meta.started:%Y-%m-%d %H:%M:%S} UTC" if run.meta.started else ""
    given = "ridden" if run.meta.mode == "ride" else f"drives given {run.meta.mode}s"
    return f"{run.meta.rig}{kind}, {given}{when}"


def _extent(run: Run) -> str:
    samples = int(run.table.drop(columns="t").notna().to_numpy().sum())
    text = f"{run.duration_s:.1f} s, {samples} samples of {run.table.shape[1] - 1} signals"
    return f"{text}; damaged: {run.damage}" if run.damage else text


def _states(shown: RunView) -> str:
    if not shown.stays:
        return "not recorded"
    parts = [f"{s.state} {s.end_s - s.start_s:.1f} s" for s in shown.stays]
    if len(parts) > 12:
        parts = [*parts[:6], f"({len(parts) - 11} more)", *parts[-5:]]
    return " → ".join(parts)


def _errors(quantities: Iterable[Quantity]) -> str:
    parts = []
    for q in quantities:
        e = q.error.values
        if len(e):
            rms, worst = float(np.sqrt(np.mean(e**2))), float(np.abs(e).max())
            parts.append(f"{q.name} {rms:.3f}/{worst:.3f} {q.unit}")
    return "rms/max " + ", ".join(parts) if parts else "no setpoint and position to compare"


def _forces(shown: RunView) -> str:
    rig = shown.run.rig
    parts = []
    for name, force in shown.forces.items():
        if not len(force.t):
            continue
        worst = float(np.abs(force.values).max())
        share = ""
        if rig is not None:
            limit = rig.actuators[rig.actuator_names.index(name)].force_max
            share = f" ({100.0 * worst / limit:.0f} %)"
        parts.append(f"{name} {worst:.0f} {force.unit}{share}")
    return "largest " + ", ".join(parts) if parts else "not recorded"


def _bus(run: Run) -> str:
    if "slot_use" not in run.states.columns:
        return "not recorded"
    slots = run.states["slot_use"].iloc[-1]
    load = run.states["bus_load"]
    return (
        f"slot use {100.0 * slots:.2f} %, load {load.mean():.0%} on average, {load.max():.0%} most"
    )


def _loop(shown: RunView) -> str:
    late = shown.lateness_us
    if not len(late):
        return "not recorded"
    p50, p99, worst = np.percentile(late, [50, 99, 100])
    overruns = int(shown.run.states["overruns"].max())
    return (
        f"lateness p50 {p50:.0f} µs, p99 {p99:.0f} µs, max {worst:.0f} µs; "
        f"{overruns} overruns in {len(late)} cycles"
    )


def _events(run: Run) -> str:
    if not run.events:
        return "none"
    kinds = Counter(e.severity for e in run.events)
    counts = ", ".join(f"{kinds[k]} {k}" for k in ("fault", "warning", "info") if kinds[k])
    names = Counter(e.name for e in run.events if e.severity != "info")
    worst = ", ".join(f"{n} × {name}" if n > 1 else name for name, n in names.most_common(5))
    return f"{counts}: {worst}" if worst else counts


def _limits(shown: RunView) -> str:
    rig = shown.run.rig
    if shown.run.meta.mode == "ride":
        return "none: nothing drives it; `hil bicycle analyse` computes what acts on it"
    if rig is None:
        return "unknown without a rig file"
    hits = [*_pose_limits(shown, rig), *_actuator_limits(shown, rig)]
    return "; ".join(hits) if hits else "none hit"


def _pose_limits(shown: RunView, rig: RigFile) -> Iterable[str]:
    for name, limit in zip(rig.coordinates, rig.limits, strict=True):
        cue = signal(shown.run.table, f"cue.{name}").values
        beyond = np.abs(cue) > limit
        if beyond.any():
            yield f"cue {name} beyond ±{limit:g} in {beyond.mean():.1%} of its poses"


def _actuator_limits(shown: RunView, rig: RigFile) -> Iterable[str]:
    for a in rig.actuators:
        low, high = a.stroke
        margin = rig.safety.stroke_margin
        position = signal(shown.run.table, f"{a.name}.position").values
        if ((position < low + margin) | (position > high - margin)).any():
            yield f"{a.name} within {1000.0 * margin:g} mm of its stroke's end"
        force = signal(shown.run.table, f"{a.name}.force").values
        full = np.abs(force) >= 0.99 * a.force_max
        if full.any():
            yield f"{a.name} at its largest force in {full.mean():.1%} of its answers"
        sent = signal(shown.run.table, f"{a.name}.setpoint")
        steps = np.diff(sent.t)
        if len(steps) and (np.abs(np.diff(sent.values)) > 1.001 * a.velocity_max * steps).any():
            yield f"{a.name} asked for more than {a.velocity_max:g} m/s"
