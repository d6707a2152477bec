"""Records of fast buses are judged by every so many answers."""

from __future__ import annotations

import numpy as np

from hil.configfile import load_rig
from hil.gap.located.locate import locate
from hil.gap.record.thin import ENOUGH_HZ, thinned
from hil.identify.replay import Stretch
from tests.gap.twin_runs import AXIS, record

HEXAPOD = load_rig("stewart")


def stretch(each_hz: float, duration_s: float = 4.0) -> Stretch:
    """All drives of a hexapod, asked for position and force `each_hz` times a second, and an IMU."""
    t = np.arange(0.0, duration_s, 1.0 / each_hz)
    signals = [f"leg{k}.{q}" for k in range(1, 7) for q in ("position", "force")]
    samples = {s: (t, np.arange(len(t), dtype=float)) for s in signals}
    samples["imu.gyro_x"] = (t, np.zeros(len(t)))
    return Stretch("fast", {"leg1": (t, np.zeros(len(t)))}, samples)


def test_a_slotted_channel_is_judged_whole() -> None:
    piece = stretch(50.0)
    (kept,), every = thinned(HEXAPOD, [piece])
    assert every == 1
    assert all(np.array_equal(kept.samples[s][1], v) for s, (_, v) in piece.samples.items())


def test_of_a_fast_bus_every_so_many_answers_of_each_drive_are_judged() -> None:
    piece = stretch(500.0)
    (kept, _), every = thinned(HEXAPOD, [piece, stretch(50.0)])
    assert every == 5
    for signal, (t, values) in kept.samples.items():
        step = 1 if signal.startswith("imu") else every
        assert np.array_equal(values, piece.samples[signal][1][::step])
        assert np.array_equal(t, piece.samples[signal][0][::step])
    assert kept.setpoints is piece.setpoints
    drives = sum(len(t) for s, (t, _) in kept.samples.items() if s.startswith("leg"))
    assert ENOUGH_HZ <= drives / 4.0 < 2.0 * ENOUGH_HZ


def test_the_reader_is_told_that_answers_were_left_out() -> None:
    fast = AXIS.model_copy(update={"bus": AXIS.bus.model_copy(update={"cycle": 0.0004})})
    told = record(rig=fast, duration_s=6.0)
    found = locate(told, fast)
    assert any("one in 2 of each signal" in f.text for f in found.findings)
    judged = sum(x.part.stop - x.part.start for x in found.evidence.problem.series)
    answered = int(told[["axis.position", "axis.force"]].notna().sum().sum())
    assert abs(judged - answered / 2) < 4
    assert not found.is_gap
