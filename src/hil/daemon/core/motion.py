"""From cues and samples to one setpoint an actuator: guard, shaper, platform filter, observer, controller."""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.config import RigFile
from hil.control.guard import CueGuard, Verdict
from hil.control.modes import build_controller
from hil.control.observer import Observer
from hil.control.platform_filter import PlatformFilter
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints
from hil.daemon.core.pacing import PacedShaper
from hil.daemon.records import ActuatorState
from hil.rigs import Manipulator
from hil.safety.rigstate import MotionGoal
from hil.signals import Cue, Sample, TimedPose

NEAR_PARKED: Final = 0.02
"""The measured pose counts as near the parked one within this, m or rad: a step no rider would notice."""

NAN: Final = float("nan")


class Motion:
    """What one rig is asked to do, cycle by cycle."""

    def __init__(self, rig: RigFile, manipulator: Manipulator, torque_reference: bool) -> None:
        self.manipulator = manipulator
        self.guard = CueGuard(rig)
        self._paced = PacedShaper(rig, manipulator)
        self.shaper = self._paced.shaper
        self.observer = Observer(rig, manipulator)
        self.observed = self.observer.estimate(0.0)
        self.reference: Reference | None = None
        self.setpoints: Setpoints | None = None
        settings = rig.control.platform_filter
        self._filter = (
            None
            if settings is None
            else PlatformFilter(settings, len(rig.coordinates), rig.bus.cycle)
        )
        self._controller = build_controller(rig, manipulator, torque_reference)
        self._parked = np.asarray(rig.parked_pose)
        self._cycle_s = rig.bus.cycle
        self._goal = MotionGoal.NONE
        self._values: list[float] = []
        self._meant: list[float] = []

    def rehearse(self) -> None:
        """Play a few cycles at rest, cues and all, so that compiled code is loaded before time matters.

        For a `Motion` that is thrown away afterwards.
        """
        rho = self.manipulator.inverse(self._parked)
        cycle_s = self._cycle_s
        still = tuple(self._parked.tolist())
        ahead = tuple(TimedPose(cycle_s * j, still) for j in range(8))
        for k, goal in enumerate((MotionGoal.NONE, *MotionGoal, MotionGoal.NONE)):
            now_s = k * cycle_s
            self.cue(now_s, Cue("rehearsal", k, now_s, now_s, ahead))
            for name, value in zip(self.manipulator.actuators, rho.tolist(), strict=True):
                for quantity in ("position", "velocity", "force"):
                    measured = value if quantity == "position" else 0.0
                    self.sample(Sample(name, quantity, measured, now_s, now_s))
            self.observe(now_s + 0.5 * cycle_s)
            self.step(now_s + cycle_s, goal)

    def cue(self, now_s: float, cue: Cue) -> Verdict:
        """Judge a cue and, if it may move the rig, take it."""
        verdict = self.guard.check(cue, now_s)
        if verdict.cue is not None:
            self.shaper.accept(verdict.cue)
        return verdict

    def sample(self, sample: Sample) -> None:
        """Take a measured value."""
        self.observer.sample(sample)

    def observe(self, now_s: float, *, is_needed: bool = True) -> None:
        """Reckon the rig's state now, unless nobody needs it: position setpoints do without."""
        if is_needed or self.setpoints is None or self.setpoints.kind != "position":
            self.observed = self.observer.estimate(now_s)

    @property
    def shaping_cycles(self) -> int:
        """Cycles from one plan of the motion to the next."""
        return self._paced.every

    @property
    def near_parked(self) -> bool:
        """Whether the measured pose is known and near the parked one."""
        off = np.abs(self.observed.pose - self._parked)
        return self.observed.is_known and bool(np.all(off < NEAR_PARKED))

    @property
    def at_rest(self) -> bool:
        """Whether what the controller is asked for rests, with nothing on its way in the filter."""
        return self._paced.at_rest and (self._filter is None or self._filter.at_rest)

    @property
    def at_parked(self) -> bool:
        """Whether it rests in the parked pose."""
        return self._paced.at_parked and self.at_rest

    def step(self, now_s: float, goal: MotionGoal) -> Setpoints | None:
        """Setpoints of the cycle that starts at `now_s`; None while drives are off."""
        if goal is MotionGoal.NONE:
            self._rest()
        else:
            if goal is not self._goal:
                self._turn_to(goal)
            asked = self._paced.step(now_s)
            self.reference = asked if self._filter is None else self._filter.step(asked)
            self.setpoints = self._controller.step(now_s, self.reference, self.observed)
            self._values = self._meant = self.setpoints.values.tolist()
            if self.setpoints.kind != "position":
                self._meant = self.manipulator.inverse(self.reference.pose).tolist()
        self._goal = goal
        self.observer.applied(now_s, self.setpoints)
        return self.setpoints

    def wanted(self, i: int) -> tuple[float | None, float | None]:
        """Setpoint of actuator i in this cycle and the position it means; None while drives are off."""
        if self.setpoints is None or self.reference is None:
            return None, None
        return self._values[i], self._meant[i]

    def _rest(self) -> None:
        """Drives are off: what will be asked first is where the rig stands."""
        self.reference = self.setpoints = None
        if self.observed.is_known:
            self._paced.reset(self.observed.pose)
            if self._filter is not None:
                self._filter.reset(self.observed.pose)
            self._controller.reset(self.observed)

    def _turn_to(self, goal: MotionGoal) -> None:
        if goal is MotionGoal.FOLLOW:
            self.shaper.follow()
        elif goal is MotionGoal.PARK:
            self.shaper.park()
        else:
            self.shaper.hold()


def tracking_error(motion: Motion) -> float:
    """Largest |wanted - observed| position of the actuators now, m or rad; NaN while drives are off."""
    if motion.reference is None or not motion.observed.is_known:
        return float("nan")
    wanted = motion.manipulator.inverse(motion.reference.at(motion.observed.t_s).pose)
    return float(np.max(np.abs(wanted - motion.observed.position)))


def actuator_states(motion: Motion) -> tuple[ActuatorState, ...]:
    """What is asked and known of each actuator now; NaN where nothing is."""
    observed, setpoints, n = motion.observed, motion.setpoints, len(motion.manipulator.actuators)
    values = [NAN] * n if setpoints is None else setpoints.values.tolist()
    known = observed.is_known
    return tuple(
        ActuatorState(
            values[i],
            float(observed.position[i]) if known else NAN,
            float(observed.velocity[i]) if known else NAN,
            float(observed.force[i]),
            float(observed.age_s[i]),
        )
        for i in range(n)
    )
