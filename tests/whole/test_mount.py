"""An IMU that swings on its mount is a healthy rig's; what swings the load is a spring (decision 8)."""

import numpy as np
import pandas as pd
import pytest

from hil.config import ImuMount
from hil.gap.diagnose import diagnose
from hil.gap.located.locate import locate
from hil.gap.located.mount import mount_of
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect

SPRING = effect("compliance", stiffness=2e6, damping=1500.0)
AXES = "xyz"


def on_mount(hz):
    mount = ImuMount(frequency=(hz, 0.0, 0.0), damping=0.06)
    return AXIS.model_copy(update={"imu": AXIS.imu.model_copy(update={"mount": mount})})


def record(rig, *effects, duration_s=14.0, seed=1):
    """What the bench records on sines up to 11 Hz, its IMU's six channels in one row."""
    rng = np.random.default_rng(seed)
    sent = np.arange(0.0, duration_s, rig.bus.cycle)
    lines = [(0.09, 0.21), (0.04, 0.47), (0.012, 1.3), (0.003, 3.1), (0.001, 6.3), (0.0004, 11.0)]
    phase = 2.0 * np.pi * rng.uniform(size=len(lines))
    told = sum(a * np.sin(2 * np.pi * f * sent + p) for (a, f), p in zip(lines, phase, strict=True))
    told = np.clip((sent - 1.0) / 1.5, 0.0, 1.0) * told
    answered = sent + rig.bus.answer_delay + 0.0012
    inertial = np.arange(0.0103, duration_s, 1.0 / rig.imu.rate)
    stamps = {"axis.position": answered[::2], "axis.force": answered[1::2]}
    stamps |= {f"imu.{q}_{a}": inertial for q in ("gyro", "accel") for a in AXES}
    values = Twin(rig.model_copy(update={"effects": effects})).replay(
        {"axis": (sent, told)}, stamps
    )

    def read(name):
        quantity = name.partition(".")[2].partition("_")[0]
        spread, step = getattr(rig.noise, quantity), getattr(rig.noise, f"{quantity}_step")
        noisy = values[name] + spread * rng.standard_normal(len(values[name]))
        return step * np.round(noisy / step)

    parts = [pd.DataFrame({"t": sent, "axis.setpoint": told})]
    parts += [pd.DataFrame({"t": stamps[s], s: read(s)}) for s in stamps if s.startswith("axis")]
    parts.append(
        pd.DataFrame({"t": inertial} | {s: read(s) for s in stamps if s.startswith("imu")})
    )
    return pd.concat(parts).sort_values("t", kind="stable", ignore_index=True)


@pytest.mark.parametrize("hz", [45.0, 70.0])
def test_a_healthy_imu_on_a_bracket_is_no_gap_and_the_reader_is_told(hz):
    answer = diagnose(record(on_mount(hz)), AXIS)
    assert answer.verdict == "no_gap"
    assert answer.located.evidence.problem.rig.imu.mount.frequency[0] == pytest.approx(hz, rel=0.05)
    (told,) = [f for f in answer.located.findings if f.subject == "imu.mount"]
    assert told.belongs["frequency"][0] == pytest.approx(hz, rel=0.05)


def test_friction_is_named_beside_a_mount():
    answer = diagnose(record(on_mount(60.0), effect("coulomb_friction", force=60.0)), AXIS)
    assert [(x.effect, x.location) for x in answer.effects] == [("coulomb_friction", "axis")]


def test_a_mount_of_the_references_is_the_runs_too():
    run = record(on_mount(60.0), effect("coulomb_friction", force=60.0), seed=2)
    answer = diagnose(run, AXIS, references=record(on_mount(60.0)))
    assert any(f.subject == "imu.mount" for f in answer.located.findings)
    assert [(x.effect, x.location) for x in answer.effects] == [("coulomb_friction", "axis")]


@pytest.mark.parametrize("effects", [(), (SPRING,), (effect("backlash", gap=2e-4),)])
def test_what_shakes_the_load_is_no_mount(effects):
    assert mount_of(locate(record(AXIS, *effects), AXIS)) is None


def test_a_rig_file_whose_imu_swings_is_asked_no_more():
    rig = on_mount(60.0)
    assert mount_of(locate(record(rig), rig)) is None
