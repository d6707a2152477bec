"""All frames of a cycle that a bus loses, and those that a host which stalls sends late."""

import numpy as np
import pandas as pd
import pytest

from hil.configfile import load_rig
from hil.gap.fits import frames
from hil.gap.fits.frames import SETPOINTS, fit_lost_frames
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin
from hil.gap.located.locate import locate
from hil.gap.rounds.question import nuisances_of
from hil.sim import Twin

RIG = load_rig("motorcycle")
CYCLES = 1400
GONE = slice(150, CYCLES, 61)
STALL_S = 0.017


def record(*, stalls: bool, gone: slice = GONE) -> pd.DataFrame:
    """A motorcycle platform whose drives never saw what was sent in cycles `gone`; `stalls`: saw it, and what
    follows within STALL_S, that much after the first of it was sent."""
    rng, bus = np.random.default_rng(4), RIG.bus
    t = np.arange(CYCLES) * bus.cycle
    fade = np.clip((t - 1.0) / 1.5, 0.0, 1.0)
    sent, told, heard, stamps = {}, {}, {}, {}
    for k, a in enumerate(RIG.actuators):
        sent[a.name] = t + 0.001 * k + bus.jitter * np.abs(rng.standard_normal(CYCLES))
        way = sum(
            s * np.sin(2.0 * np.pi * f * (t + 0.3 * k)) for s, f in ((0.03, 0.4), (0.006, 1.7))
        )
        told[a.name] = a.home + fade * (way - way[0])
        if stalls:
            begins = t[GONE][np.searchsorted(t[GONE], sent[a.name], side="right") - 1]
            waits = (sent[a.name] >= t[GONE][0]) & (sent[a.name] < begins + STALL_S)
            heard[a.name] = np.where(waits, begins + STALL_S + 1e-4 * k, sent[a.name]), told[a.name]
        else:
            seen = np.ones(CYCLES, dtype=bool)
            seen[gone] = False
            heard[a.name] = sent[a.name][seen], told[a.name][seen]
        for q, late_s in (("position", 0.0031), ("force", 0.0044)):
            stamps[f"{a.name}.{q}"] = t + 0.001 * k + late_s
    values = Twin(RIG).replay(heard, stamps)
    parts = [pd.DataFrame({"t": sent[a], f"{a}.setpoint": told[a]}) for a in sent]
    for name, v in values.items():
        spread = getattr(RIG.noise, name.partition(".")[2])
        parts.append(
            pd.DataFrame({"t": stamps[name], name: v + spread * rng.standard_normal(CYCLES)})
        )
    return pd.concat(parts).sort_values("t", kind="stable", ignore_index=True)


@pytest.mark.parametrize("stalls", [False, True])
def test_whole_cycles_that_a_bus_loses_are_lost_frames_and_what_a_host_sends_late_is_not(stalls):
    e = locate(record(stalls=stalls), RIG).evidence
    c, none = begin(e, split(e.problem, e.noise, e.residual), nuisances_of(e.problem), {}, 0)
    found = fit_lost_frames(c, none)
    if stalls:
        assert found is None
    else:
        assert found is not None
        share = found.values[found.names.index(SETPOINTS)]
        assert share == pytest.approx(len(range(CYCLES)[GONE]) / CYCLES, rel=0.3)


def test_frames_that_take_a_drive_further_from_where_it_stood_were_not_lost(monkeypatch):
    e = locate(record(stalls=False, gone=slice(0)), RIG).evidence
    c, none = begin(e, split(e.problem, e.noise, e.residual), nuisances_of(e.problem), {}, 0)
    wrong = {a: np.empty(0, dtype=np.int64) for a in RIG.actuator_names}
    wrong["leg1"] = np.arange(405, 410)
    monkeypatch.setattr(frames, "_find", lambda c, base: ([wrong], [wrong]))
    assert fit_lost_frames(c, none) is None
