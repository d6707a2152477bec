"""The platform's inertial sensor against differentiated poses and a filter of scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import ConfigError
from hil.rigs import build_rig
from hil.sim.imu import filter_coefficients, filter_step, group_delay_s
from hil.sim.plant import Plant
from tests.sim.rigs import changed, effect, with_effects


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    def turn(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        out = np.eye(3)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        out[a, a], out[a, b], out[b, a], out[b, b] = c, -s, s, c
        return out

    return turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def test_the_filter_answers_a_step_as_the_analogue_butterworth_filter_does() -> None:
    h, coefficients = 0.00025, np.empty((4, 4))
    imu = np.array([*[0.0] * 12, 150.0, 0.0, 0.0, 0.0, 0.05])
    filter_coefficients(imu, h, coefficients)
    state, seen = np.zeros(18), []
    for _ in range(100):
        filter_step(coefficients, imu, state, np.ones(6))
        seen.append(state[2])
    b, a = signal.butter(2, 2 * np.pi * 150.0, analog=True)
    _, exact = signal.step((b, a), T=np.arange(0, 101) * h)
    np.testing.assert_allclose(seen, exact[1:], atol=1e-9)
    w, phase = signal.freqs(b, a, worN=[2 * np.pi * 0.1, 2 * np.pi * 0.2])
    delay = -np.diff(np.angle(phase))[0] / np.diff(w)[0]
    assert group_delay_s(150.0) == pytest.approx(delay, rel=1e-4)


def test_a_mount_swings_along_its_axes_as_a_mass_on_a_spring_and_a_damper_does() -> None:
    """Beside a filter of 20 kHz: specific force read is f (2 d w s + w²) / (s² + 2 d w s + w²)."""
    h, coefficients, d, w = 0.00025, np.empty((4, 4)), 0.08, 2 * np.pi * 60.0
    imu = np.array([*[0.0] * 12, 2e4, 60.0, 0.0, 60.0, d])
    filter_coefficients(imu, h, coefficients)
    state, seen = np.zeros(18), []
    for _ in range(400):
        filter_step(coefficients, imu, state, np.ones(6))
        seen.append(state[:6].copy())
    _, exact = signal.step(([2 * d * w, w * w], [1.0, 2 * d * w, w * w]), T=np.arange(401) * h)
    for axis in (3, 5):
        np.testing.assert_allclose(np.array(seen)[10:, axis], exact[11:], atol=1e-3)
    np.testing.assert_allclose(np.array(seen)[10:, [0, 1, 2, 4]], 1.0, atol=1e-6)


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
def test_rate_and_specific_force_are_those_of_the_sensors_own_motion(name: str) -> None:
    mounting = (0.3, -0.2, 0.4)
    rig = changed(load_rig(name), imu={"bandwidth": 1500.0, "orientation": mounting})
    assert rig.imu is not None
    model, plant = build_rig(rig), Plant(rig)
    plant.reset(mode="position")
    dt = 0.00025
    poses, seen = [], []
    t = np.arange(0.0, 1.0, dt)
    for k, now in enumerate(t):
        if k % 40 == 0:
            pose = np.array(rig.limits) * 0.2 * np.sin(2 * np.pi * 1.2 * now + np.arange(model.n))
            pose *= min(now / 0.4, 1.0)
            for i, x in enumerate(model.inverse(pose)):
                plant.set_setpoint(i, float(x), now)
        plant.advance(now)
        poses.append(plant.pose())
        seen.append(plant.imu())
    R, place = zip(*(sensor_at(rig, q) for q in poses), strict=True)
    R, place, values = np.array(R), np.array(place), np.array(seen)
    inner = np.arange(2400, len(t) - 20)
    expected = []
    for k in inner:
        acceleration = (place[k + 1] - 2 * place[k] + place[k - 1]) / dt**2
        spin = R[k].T @ (R[k + 1] - R[k - 1]) / (2 * dt)
        gyro = [spin[2, 1], spin[0, 2], spin[1, 0]]
        expected.append([*gyro, *(R[k].T @ (acceleration + np.array([0.0, 0.0, 9.81])))])
    late = t[inner] + group_delay_s(1500.0)
    cycle = np.ones(40) / 40.0  # means over a bus cycle: in between, accelerations jump
    for channel, tolerance in enumerate([2e-4] * 3 + [0.01] * 3):
        measured = np.interp(late, t, values[:, channel])
        np.testing.assert_allclose(
            np.convolve(measured, cycle, "valid"),
            np.convolve(np.array(expected)[:, channel], cycle, "valid"),
            atol=tolerance,
        )


def sensor_at(rig: RigFile, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orientation (3, 3) and place (3,) of the sensor in the base frame at pose q."""
    motion = build_rig(rig).platform_motion(q, 0 * q, 0 * q)
    assert rig.imu is not None
    place = motion.position + motion.R @ np.array(rig.imu.position)
    return motion.R @ rotation(*rig.imu.orientation), place


def test_a_tilted_base_tilts_gravity_and_nothing_else() -> None:
    rig = with_effects(load_rig("axis"), effect("base_tilt", "platform", roll=0.1, pitch=-0.2))
    plant = Plant(rig)
    plant.advance(0.1)
    expected = rotation(0.1, -0.2, 0.0).T @ np.array([0.0, 0.0, 9.81])
    np.testing.assert_allclose(plant.imu(), [0.0, 0.0, 0.0, *expected], atol=1e-12)


def test_a_misaligned_sensor_reads_in_turned_axes() -> None:
    turn = np.array([0.02, -0.03, 0.05])
    line = effect("sensor_misalignment", "imu", x=turn[0], y=turn[1], z=turn[2])
    rig = changed(load_rig("axis"), imu={"orientation": (0.4, 0.2, -0.7)})
    plant, straight = Plant(with_effects(rig, line)), Plant(rig)
    angle = np.linalg.norm(turn)
    n = turn / angle
    skew = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    rodrigues = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    np.testing.assert_allclose(plant.imu()[3:], rodrigues.T @ straight.imu()[3:], atol=1e-12)


def test_a_rig_without_an_imu_says_so() -> None:
    plant = Plant(changed(load_rig("axis"), imu=None))
    plant.advance(0.1)
    with pytest.raises(ConfigError, match="has no imu"):
        plant.imu()
