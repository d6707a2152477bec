"""Faults that no entry of the catalogue stands for, each with one open size."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.other_lab import layout as lay
from benchmarks.other_lab.mechanism import AXIS, MOTORCYCLE, STEWART
from benchmarks.other_lab.motions import FAST
from benchmarks.other_lab.recipes import Recipe
from benchmarks.other_lab.world import lead_of


class Fault:
    """A fault of one kind: `change(setup, size)` alters a copy of the rig."""

    def __init__(self, name, location, change, start, low, high):
        self.effect, self.location = name, location
        self._change, self.start, self.low, self.high = change, start, low, high

    def apply(self, world, setup, size):
        """A copy of the rig with the fault of this size."""
        out = setup.copy()
        self._change(out, size)
        return out

    def parameters(self, size):
        """For the lab's own notes."""
        return {"size": size}


def _pick(rng, world):
    i = int(rng.integers(len(world.rig.actuators)))
    return i, world.rig.actuators[i]


def _loose_screw(rng, world, base):
    """A coupling slips now and then: the load jumps against the motor within some milliseconds."""
    i, a = _pick(rng, world)

    def change(setup, size):
        setup.bang_m, setup.bang_at = size, i

    return Fault("loose_screw", a.name, change, 5e-5, 2e-6, 4e-4)


def _warm_friction(rng, world, base):
    """Friction falls or rises as the grease warms up."""
    i, a = _pick(rng, world)
    tau, sign = float(rng.uniform(3.0, 9.0)), float(rng.choice((-1.0, 1.0)))
    boost = 4.0 if sign < 0 else 1.0

    def change(setup, size):
        # A rig that starts stiff and cold has its ordinary friction only once it is warm.
        cold = size if sign < 0 else 0.0
        setup.act[[lay.COUL_P, lay.COUL_N, lay.VIS], i] *= 1.0 + cold
        setup.act[lay.WARM, i] = -size / (1.0 + size) if sign < 0 else size
        setup.act[lay.WARM_TAU, i] = tau

    return Fault("warm_friction", a.name, change, boost, 0.1, 16.0)


def _drive_throttle(rng, world, base):
    """A drive folds its output back while its mean current is high."""
    i, a = _pick(rng, world)
    threshold = float(base.heat[i])

    def change(setup, size):
        setup.act[lay.THR_F, i], setup.act[lay.THR_S, i] = threshold, size

    return Fault("drive_throttle", a.name, change, 0.4, 0.03, 0.85)


def _cable_drag(rng, world, base):
    """A cable drags and pulls over the outer part of the stroke."""
    i, a = _pick(rng, world)
    at = a.home + float(rng.uniform(-0.02, 0.04)) * (0.5 if world.kind == STEWART else 1.0)

    def change(setup, size):
        setup.act[lay.CAB_F, i], setup.act[lay.CAB_X, i], setup.act[lay.CAB_K, i] = size, at, 8.0

    return Fault("cable_drag", a.name, change, 0.02 * a.force_max, 1.0, 0.12 * a.force_max)


def _floor_resonance(rng, world, base):
    """The rig stands on a floor that swings."""
    hz = float(rng.uniform(5.0, 11.0))

    def change(setup, size):
        setup.glob[lay.BASE_M] = setup.body[0] / size
        setup.glob[lay.BASE_W], setup.glob[lay.BASE_Z] = 2.0 * math.pi * hz, 0.03

    return Fault("floor_resonance", "platform", change, 0.1, 0.004, 0.5)


def _mistuned_notch(rng, world, base):
    """A drive's notch filter sits far too low."""
    i, a = _pick(rng, world)
    hz, tick = float(rng.uniform(12.0, 30.0)), world.rig.bus.speed_loop

    def change(setup, size):
        w = 2.0 * math.tan(math.pi * hz * tick) / tick
        k = 2.0 / tick
        wide, deep = 0.7, 0.7 * math.exp(-size)
        a0 = k * k + 2.0 * wide * w * k + w * w
        b = (
            k * k + 2.0 * deep * w * k + w * w,
            2.0 * (w * w - k * k),
            k * k - 2.0 * deep * w * k + w * w,
        )
        setup.act[[lay.NB0, lay.NB1, lay.NB2], i] = np.array(b) / a0
        setup.act[lay.NA1, i] = 2.0 * (w * w - k * k) / a0
        setup.act[lay.NA2, i] = (k * k - 2.0 * wide * w * k + w * w) / a0

    return Fault("mistuned_notch", a.name, change, 0.4, 0.01, 1.4)


def _bearing_defect(rng, world, base):
    """A ball rolls over a spall a few times a turn, not quite in step with the screw."""
    i, a = _pick(rng, world)
    lead = lead_of(a)

    def change(setup, size):
        setup.act[lay.BEAR_A, i], setup.act[lay.BEAR_P, i] = size, lead

    return Fault("bearing_defect", a.name, change, 0.03 * a.force_max, 1.0, 0.25 * a.force_max)


def _sticking_brake(rng, world, base):
    """The holding brake bites after each standstill and lets go late."""
    i, a = _pick(rng, world)

    def change(setup, size):
        setup.act[lay.BRAKE_F, i] = size

    return Fault("sticking_brake", a.name, change, 0.05 * a.force_max, 5.0, 0.3 * a.force_max)


def _supply_ripple(rng, world, base):
    """The DC link hums through the current loop, and slow sampling folds the hum down."""
    i, a = _pick(rng, world)
    hz = float(rng.choice((50.0, 100.0)) + rng.choice((-1.0, 1.0)) * rng.uniform(0.15, 1.2))

    def change(setup, size):
        setup.act[lay.SUP_A, i], setup.act[lay.SUP_HZ, i] = size, hz

    return Fault("supply_ripple", a.name, change, 0.02 * a.force_max, 0.5, 0.12 * a.force_max)


def _sloshing_load(rng, world, base):
    """Part of the load is a liquid, or hangs."""
    hz = float(rng.uniform(1.2, 3.5))

    def change(setup, size):
        moved = size * setup.body[0]
        setup.body[0] -= moved
        setup.glob[lay.SIDE_M] += moved
        setup.glob[lay.SIDE_W], setup.glob[lay.SIDE_Z] = 2.0 * math.pi * hz, 0.04

    return Fault("sloshing_load", "platform", change, 0.05, 0.004, 0.3)


def _stale_answers(rng, world, base):
    """Drives now and then answer with the value of the time before."""

    def change(setup, size):
        setup.stale_share = size

    return Fault("stale_answers", "drives", change, 0.05, 0.015, 0.35)


def _host_stalls(rng, world, base):
    """Frames queue up in the bus adapter and leave it in bursts."""

    def change(setup, size):
        setup.stall_s = size

    return Fault("host_stalls", "bus", change, 0.04, 0.012, 0.15)


_ALL = (AXIS, MOTORCYCLE, STEWART)

FAULTS: dict[str, Recipe] = {
    "loose_screw": Recipe(_loose_screw),
    "warm_friction": Recipe(_warm_friction),
    "drive_throttle": Recipe(_drive_throttle, motions=FAST),
    "cable_drag": Recipe(_cable_drag),
    "floor_resonance": Recipe(_floor_resonance, _ALL, FAST, imu=True),
    "mistuned_notch": Recipe(_mistuned_notch, motions=FAST),
    "bearing_defect": Recipe(_bearing_defect, motions=("triangle", "slow_sine", "moves")),
    "sticking_brake": Recipe(_sticking_brake, motions=("moves",)),
    "supply_ripple": Recipe(_supply_ripple),
    "sloshing_load": Recipe(_sloshing_load, motions=FAST, imu=True),
    "stale_answers": Recipe(_stale_answers, motions=FAST),
    "host_stalls": Recipe(_host_stalls, motions=FAST),
}
