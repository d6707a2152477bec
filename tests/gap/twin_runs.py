"""Short records of the axis, made by its own twin with effects switched on, with noise and rounding."""

from __future__ import annotations

import numpy as np
import pandas as pd

from hil.config import Effect, RigFile
from hil.configfile import load_rig
from hil.sim import Twin

AXIS = load_rig("axis")


def effect(name: str, location: str = "axis", /, **parameters: float) -> Effect:
    """A line of a rig file's effects."""
    return Effect(effect=name, location=location, parameters=parameters)


def record(
    *effects: Effect,
    rig: RigFile = AXIS,
    duration_s: float = 14.0,
    seed: int = 1,
    share: float = 1.0,
    step_m: float | None = None,
    asked_s: float = 0.0012,
    jitter_s: float = 0.0,
) -> pd.DataFrame:
    """What the axis with `effects` would have recorded: slow reversals, then a sum of faster sines; a drive
    that rounds its setpoints to `step_m`, where that is given. Setpoints are sent up to `jitter_s` late.

    Each drive answers position and force in turn, 20 ms apart each, as its rig file's bus does, sampled
    `asked_s` after a setpoint was sent.
    """
    rng = np.random.default_rng(seed)
    sent = np.arange(0.0, duration_s, rig.bus.cycle)
    fade = np.clip((sent - 1.0) / 1.5, 0.0, 1.0)
    phase = 2.0 * np.pi * rng.uniform(size=5)
    lines = [(0.09, 0.21), (0.04, 0.47), (0.012, 1.3), (0.003, 3.1), (0.001, 6.3)]
    told = sum(a * np.sin(2 * np.pi * f * sent + p) for (a, f), p in zip(lines, phase, strict=True))
    told = share * fade * (told - told[0])
    answered = sent + rig.bus.answer_delay + asked_s
    stamps = {"axis.position": answered[::2], "axis.force": answered[1::2]}
    sent = sent + jitter_s * rng.uniform(size=len(sent)) if jitter_s else sent
    twin = Twin(rig.model_copy(update={"effects": effects}))
    heard = told if step_m is None else step_m * np.round(told / step_m)
    values = twin.replay({"axis": (sent, heard)}, stamps)
    columns = [pd.DataFrame({"t": sent, "axis.setpoint": told})]
    for name, t in stamps.items():
        spread, step = (
            (rig.noise.position, rig.noise.position_step)
            if name.endswith("position")
            else (rig.noise.force, rig.noise.force_step)
        )
        noisy = values[name] + spread * rng.standard_normal(len(t))
        columns.append(pd.DataFrame({"t": t, name: step * np.round(noisy / step)}))
    return pd.concat(columns).sort_values("t", kind="stable", ignore_index=True)


def jittered(*effects: Effect, share: float = 1.0, seed: int = 3) -> pd.DataFrame:
    """The same record of an axis whose setpoints come anywhere in a tick of its drive and act at the next;
    its sensors have `share` of a usual noise."""
    rng = np.random.default_rng(seed)
    frame = record(*effects)
    told = frame.dropna(subset=["axis.setpoint"])
    sent = told["t"].to_numpy() + rng.uniform(0.0, 9e-4, len(told))
    noise = {"axis.position": 2e-5, "axis.force": 4.0}
    stamps = {s: frame.loc[frame[s].notna(), "t"].to_numpy() for s in noise}
    twin = Twin(AXIS.model_copy(update={"effects": effects}))
    values = twin.replay({"axis": (sent, told["axis.setpoint"].to_numpy())}, stamps)
    frame.loc[told.index, "t"] = sent
    for s, v in values.items():
        noisy = v + share * noise[s] * rng.standard_normal(len(v))
        frame.loc[frame[s].notna(), s] = noisy
    return frame.sort_values("t", kind="stable", ignore_index=True)
