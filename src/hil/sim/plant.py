"""The simulated rig's plant with its drives' loops, driven by events in injected time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import Effect, RigFile
from hil.errors import ConfigError, KinematicsError
from hil.rigs import build_rig
from hil.signals import Quantity
from hil.sim import layout as lay
from hil.sim.catalogue import QUANTITIES
from hil.sim.drive_loops import set_mode as switch
from hil.sim.known import pack_known
from hil.sim.model import actuator_rows, apply_parameters
from hil.sim.parameters import ParameterTable
from hil.sim.rest import REST_M, rest, state_size
from hil.sim.run import advance, look_up, put_outputs
from hil.sim.sensors import is_lost, reading, sensor_constants

Array = NDArray[np.float64]
DriveMode = Literal["off", "position", "force"]
MODES: Final[dict[str, int]] = {
    "off": lay.MODE_OFF,
    "position": lay.MODE_POSITION,
    "force": lay.MODE_FORCE,
}
GAIN_ROWS: Final = {
    "position_gain": lay.A_KP,
    "speed_gain": lay.A_KV,
    "integral_gain": lay.A_KI,
    "velocity_ff": lay.A_KFV,
    "acceleration_ff": lay.A_KFA,
    "friction_ff": lay.A_KFF,
    "effective_mass": lay.A_MEFF,
}
MEMORY_TICKS: Final = 2048
"""Ticks of outputs kept for answers from the past: half a second at the usual 0.25 ms."""
EVENTS: Final = 256


class Plant:
    """Platform, actuators and drive loops of a rig file with its `effects`, one compiled model.

    Starts at rest at t = 0 in the parked pose, drives off, brakes closed. A call costs microseconds.
    Deterministic: `seed` only picks which frames the effect `lost_frames` loses. Noise belongs to those who
    answer. `hidden` are effects that the rig has and its file does not know of.
    """

    def __init__(
        self, rig: RigFile, seed: int = 0, *, substeps: int = 1, hidden: Sequence[Effect] = ()
    ) -> None:
        self.rig = rig
        self.table = ParameterTable(rig)
        self.parameters = self.table.from_effects((*rig.effects, *hidden))
        self.n = len(rig.actuators)
        self._manipulator = build_rig(rig)
        self._base = pack_known(rig, substeps)
        self._model = np.empty_like(self._base)
        self._state = np.zeros(state_size(self.n))
        self._tail = self._state[lay.S_ROWS * self.n :]
        self._rows = self._state[: lay.S_ROWS * self.n].reshape(lay.S_ROWS, self.n)
        self._dt_s = rig.bus.speed_loop
        self._ring = np.zeros((MEMORY_TICKS, 4 * self.n + 6))
        self._events = np.zeros((EVENTS, 3))
        self._waiting = 0
        self._sensors = np.zeros((4 * self.n + 6, 5))
        self._homes = [a.home for a in rig.actuators]
        self._seed = abs(seed) % 2**20
        self._sent = 0
        self._answered = 0
        self.now_s = 0.0
        apply_parameters(self._base, self.parameters, self._model)
        self._act = actuator_rows(self._model)
        self._delay_s = (rig.bus.setpoint_delay + self._act[lay.A_DELAY]).tolist()
        for signal, row in enumerate(self._sensors):
            sensor_constants(self.parameters, self.n, signal, row)
        at = self.n * lay.ACTUATOR_BLOCK + lay.BUS_AT
        self._lost_setpoints, self._lost_answers = self.parameters[at : at + 2].tolist()
        self.reset()

    def reset(self, pose: tuple[float, ...] | None = None, mode: DriveMode = "off") -> None:
        """At rest at t = 0 in `pose` (default: parked) by the nominal geometry, all drives in `mode`.

        KinematicsError where the rig with its effects cannot stand there.
        """
        pose = self.rig.parked_pose if pose is None else pose
        target = self._manipulator.inverse(pose)
        modes = np.full(self.n, float(MODES[mode]))
        error = rest(self._model, target, modes, np.array(pose, dtype=float), self._state)
        if not error < REST_M:
            raise KinematicsError(
                f"{self.rig.name}: no rest at pose {pose}: {error:.3g} m of actuator position are left"
            )
        self._waiting = 0
        self.now_s = 0.0
        put_outputs(self._rows, self._tail, self._ring[0])

    def advance(self, to_s: float) -> None:
        """Let time pass to `to_s`; an earlier instant than now changes nothing."""
        if to_s <= self.now_s:
            return
        self._waiting = advance(
            self._model, self._state, self._events, self._waiting, self._ring, float(to_s)
        )
        self.now_s = to_s

    def set_mode(self, i: int, mode: DriveMode) -> None:
        """Switch drive i: "off" closes the holding brake; "position" holds where it stands; "force" opens
        the brake at its first setpoint."""
        switch(self._act, self._rows, i, MODES[mode])

    def mode(self, i: int) -> DriveMode:
        """Mode of drive i."""
        code = int(self._rows[lay.S_MODE, i])
        return "off" if code == 0 else "position" if code == 1 else "force"

    def set_setpoint(self, i: int, value: float, at_s: float) -> None:
        """A setpoint (m or N, as the drive's mode says) whose frame was sent at `at_s`; the drive acts on it
        `bus.setpoint_delay` and its `transport_delay` later."""
        if self._waiting == EVENTS:
            raise RuntimeError(f"{EVENTS} setpoints wait for the plant: advance it")
        self._sent += 1
        if is_lost(2 * self._seed, self._sent, self._lost_setpoints):
            return
        self._events[self._waiting] = (at_s + self._delay_s[i], i, value)
        self._waiting += 1

    def set_gains(self, i: int, **gains: float) -> None:
        """Change gains of drive i by their names in the rig file (position_gain, velocity_ff ...)."""
        rows = actuator_rows(self._base)
        for name, value in gains.items():
            if name not in GAIN_ROWS:
                raise ConfigError(f"{name} is no gain of a drive; gains are {', '.join(GAIN_ROWS)}")
            rows[GAIN_ROWS[name], i] = value
        apply_parameters(self._base, self.parameters, self._model)

    def position(self, i: int) -> float:
        """Motor encoder of drive i, at the output, m or rad."""
        return self._look(i)

    def velocity(self, i: int) -> float:
        """Speed of drive i's motor at the output, m/s or rad/s."""
        return self._look(self.n + i)

    def force(self, i: int) -> float:
        """Force that drive i's current stands for, N or N·m."""
        return self._look(2 * self.n + i)

    def current(self, i: int) -> float:
        """Torque-producing current of drive i, A; ConfigError where the rig file has no constants for it."""
        return self.force(i) / self._force_per_ampere(i)

    def answer(self, i: int, quantity: Quantity, at_s: float, noise: float = 0.0) -> float | None:
        """What drive i answers for `quantity` sampled at `at_s` <= now: the value, then `noise`, then its
        sensor's effects; None where the effect `lost_frames` loses the answer."""
        self._answered += 1
        if is_lost(2 * self._seed + 1, self._answered, self._lost_answers):
            return None
        k = QUANTITIES.index(quantity)
        bias, scale, latency_s, quantum, _ = self._sensors[k * self.n + i].tolist()
        value = self._look(min(k, 2) * self.n + i, at_s - latency_s)
        if quantity == "current":
            value /= self._force_per_ampere(i)
        home = self._homes[i] if quantity == "position" else 0.0
        return float(reading(value + noise, home, bias, scale, quantum))

    def imu_answer(self, at_s: float, noise: Array) -> Array:
        """What the IMU answers for its sample at `at_s` <= now: `imu`, noise (6,), sensor effects."""
        out = np.empty(6)
        for a in range(6):
            bias, scale, latency_s, quantum, _ = self._sensors[4 * self.n + a].tolist()
            value = self._look(4 * self.n + a, at_s - latency_s)
            out[a] = reading(value + noise[a], 0.0, bias, scale, quantum)
        return out

    def _force_per_ampere(self, i: int) -> float:
        constant = self.rig.actuators[i].force_per_ampere
        if constant is None:
            raise ConfigError(
                f"{self.rig.name}: actuators[{i}] ({self.rig.actuators[i].name}): current needs "
                "torque_constant and transmission"
            )
        return constant

    def pose(self) -> Array:
        """True pose (n,), in the rig file's order of coordinates."""
        return np.array([self._look(3 * self.n + a) for a in range(self.n)])

    def imu(self) -> Array:
        """(6,) rate rad/s and specific force m/s² in the sensor frame, after its filter, without noise."""
        if self.rig.imu is None:
            raise ConfigError(f"{self.rig.name}: the rig file has no imu")
        return np.array([self._look(4 * self.n + a) for a in range(6)])

    def _look(self, column: int, at_s: float | None = None) -> float:
        at_s = self.now_s if at_s is None else at_s
        return float(look_up(self._ring, int(self._tail[-1]), self._dt_s, float(at_s), column))
