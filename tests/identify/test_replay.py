"""The twin answers what rig and daemon recorded, at the very instants, with the effects it is told of."""

from __future__ import annotations

import numpy as np
import pytest

from hil.cli.cue import ride_cues
from hil.config import Effect, RigFile
from hil.configfile import parse_settings, rig_toml
from hil.daemon.simulated import record_ride
from hil.identify.replay import replay_of, stretches
from hil.runs import load_run
from hil.sim.twin import Twin
from tests.daemon.simulated_rig import PROFILES, rig_file

FRICTION = Effect(
    effect="coulomb_friction", location="leg1", parameters={"force": 120.0}, provenance="test"
)


def with_effects(rig: RigFile, *effects: Effect) -> RigFile:
    tables = rig.model_dump()
    tables["effects"] = [effect.model_dump() for effect in effects]
    return parse_settings(tables, RigFile, rig.name)


def residuals(rig: RigFile, twin_of: RigFile, folder) -> dict[str, np.ndarray]:
    path = record_ride(rig, rig_toml(rig), PROFILES, ride_cues(rig, 5.0), folder)
    (stretch,) = stretches(load_run(path))
    twin = Twin(twin_of)
    replay = replay_of(twin, stretch, stretch.samples)
    answers = replay.by_signal(replay.run(twin.parameters))
    later = {s: t > t[0] + 0.5 for s, (t, _) in stretch.samples.items()}
    return {s: (v - answers[s])[later[s]] for s, (_, v) in stretch.samples.items()}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart"])
def test_a_healthy_rig_is_answered_to_the_sensors_noise_and_the_buses_jitter(name, tmp_path):
    rig = rig_file(name)
    left = residuals(rig, rig, tmp_path)
    for actuator in rig.actuator_names:
        # A setpoint that waits for another frame may reach the drive one 1 ms tick later than reckoned.
        assert rms(left[f"{actuator}.position"]) < 5.0 * rig.noise.position
        assert rms(left[f"{actuator}.force"]) < 0.02 * rig.actuators[0].force_max
    assert rms(left["imu.gyro_y"]) < 1.3 * rig.noise.gyro


def test_an_effect_shows_until_the_twin_is_told_of_it(tmp_path):
    healthy = rig_file("motorcycle")
    worn = with_effects(healthy, FRICTION)
    ignorant = residuals(worn, healthy, tmp_path / "a")
    told = residuals(worn, worn, tmp_path / "b")
    assert rms(ignorant["leg1.force"]) > 80.0
    assert rms(told["leg1.force"]) < 0.5 * rms(ignorant["leg1.force"])
    assert rms(ignorant["slide.force"]) < 1.3 * rms(told["slide.force"])
