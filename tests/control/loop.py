"""A rig in closed loop: plant and drives of hil.sim under a control mode, slots and delays as on the bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hil.config import RigFile
from hil.control import Controller, Observer, Reference, build_controller
from hil.rigs import build_rig
from hil.signals import Sample
from hil.sim.plant import Plant

SAMPLE_AFTER_S = 0.0005
"""From a slot's start to the instant the drive samples for its answer."""


def with_control(rig: RigFile, **keys) -> RigFile:
    return rig.model_copy(update={"control": rig.control.model_copy(update=keys)})


@dataclass
class Trace:
    """What a run left: times (m,), exact and observed state, forces or positions sent."""

    t: np.ndarray
    wanted: np.ndarray
    pose: np.ndarray
    observed: np.ndarray
    rates: np.ndarray
    observed_rates: np.ndarray
    setpoints: np.ndarray
    observer: Observer

    def error(self, after_s: float = 1.0) -> np.ndarray:
        return (self.pose - self.wanted)[self.t >= after_s]


class ClosedLoop:
    """Runs `rig` by its own control mode; the plant may be another rig (`plant_rig`)."""

    def __init__(
        self,
        rig: RigFile,
        plant_rig: RigFile | None = None,
        controller: Controller | None = None,
        seed: int = 0,
    ) -> None:
        self.rig = rig
        self.manipulator = build_rig(rig)
        self.plant = Plant(plant_rig or rig, seed)
        self.observer = Observer(rig, self.manipulator)
        self.controller = controller or build_controller(rig, self.manipulator)
        self.rng = np.random.default_rng(seed)
        self.force = controller is None and rig.control.mode != "drive"
        self.pending: list[Sample] = []
        self.lose: Callable[[float, int], bool] = lambda t_s, i: False
        self.change: Callable[[float, int, float], float] = lambda t_s, i, value: value
        self.stagger = rig.bus.stagger if rig.bus.schedule == "parameter" else 0.0
        n = self.manipulator.n
        self.plant.reset(mode="off" if self.force else "position")
        for i in range(n):
            if self.force:
                self.plant.set_mode(i, "force")
            if rig.control.precontrol:
                self.plant.set_gains(i, velocity_ff=1.0, acceleration_ff=1.0, friction_ff=1.0)
            rho = float(self.manipulator.inverse(np.asarray(rig.parked_pose))[i])
            name = self.manipulator.actuators[i]
            self.observer.sample(Sample(name, "position", rho, 0.0, 0.0))

    def run(self, reference: Callable[[float], Reference], duration_s: float) -> Trace:
        cycle = self.rig.bus.cycle
        rows = []
        for k in range(round(duration_s / cycle)):
            now = cycle * (k + 1)
            self.plant.advance(now)
            for sample in [s for s in self.pending if s.received_s <= now]:
                self.observer.sample(sample)
            self.pending = [s for s in self.pending if s.received_s > now]
            observed = self.observer.estimate(now)
            if k == 0:
                self.controller.reset(observed)
            setpoints = self.controller.step(now, reference(now + cycle), observed)
            self.observer.applied(now, setpoints)
            pose = self.plant.pose()
            J = self.manipulator.jacobian(pose)
            speeds = [self.plant.velocity(i) for i in range(self.manipulator.n)]
            rates = np.linalg.solve(J, speeds)
            rows.append(
                (
                    now,
                    reference(now).pose,
                    pose,
                    observed.pose,
                    rates,
                    observed.rates,
                    setpoints.values,
                )
            )
            self._slots(now, k, setpoints.values)
        return Trace(*(np.array(column) for column in zip(*rows, strict=True)), self.observer)

    def _slots(self, now: float, k: int, values: np.ndarray) -> None:
        bus, noise = self.rig.bus, self.rig.noise
        fast = bus.schedule == "fast"
        quantity = "position" if fast else bus.pattern[k % len(bus.pattern)]
        for i, name in enumerate(self.manipulator.actuators):
            slot = now + i * self.stagger
            self.plant.advance(slot)
            late = abs(float(self.rng.normal(0.0, bus.jitter)))
            self.plant.set_setpoint(i, float(values[i]), slot + late)
            at = slot + SAMPLE_AFTER_S
            self.plant.advance(at)
            value = self.plant.answer(
                i, quantity, at, float(self.rng.normal(0.0, getattr(noise, quantity)))
            )
            if value is None or self.lose(at, i):
                continue
            if quantity == "position":
                value = self.change(at, i, value)
            late = bus.answer_delay + float(self.rng.normal(0.0, bus.answer_jitter))
            self.pending.append(Sample(name, quantity, value, at, at + late))


def still(n: int) -> Callable[[float], Reference]:
    zero = np.zeros(n)
    return lambda t: Reference(t, zero, zero, zero)


def chirp(direction, f0: float, f1: float, duration_s: float) -> Callable[[float], Reference]:
    """Exponential chirp along `direction` (n,), the pose's amplitude; fades in over the first second."""
    direction = np.asarray(direction, dtype=float)
    k = np.log(f1 / f0) / duration_s

    def motion(t):
        phase = 2.0 * np.pi * f0 * np.expm1(k * t) / k
        u = min(max(t, 0.0), 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u * u) * np.sin(phase)

    def reference(t: float) -> Reference:
        h = 1.0e-4
        a, b, c = motion(t - h), motion(t), motion(t + h)
        return Reference(
            t, direction * b, direction * (c - a) / (2 * h), direction * (a - 2 * b + c) / h**2
        )

    return reference
