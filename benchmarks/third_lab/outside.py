"""Faults from outside the catalogue, as rigs have them; the right diagnosis of each is `unknown`."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from benchmarks.third_lab.effect import Effect, Setting, on_plant, on_sensing
from benchmarks.third_lab.sensing import IMU


def warming_friction(s: Setting) -> Effect:
    """All friction of an actuator changes by a share while the grease warms, or while it runs dry."""
    a, tau = s.actuator(), s.rng.uniform(5.0, 15.0)
    thick = s.rng.random() < 0.5

    def change(x: float, p: object) -> object:
        base = p.scale(a, coulomb_pos=1 + x, coulomb_neg=1 + x, viscous=1 + x) if thick else p
        return base.set(a, warm=-x / (1 + x) if thick else x, warm_tau=tau)

    return _fault(warming_friction, a, 0.3, 15.0, on_plant(change))


def friction_spot(s: Setting) -> Effect:
    """A dent: friction rises over a short stretch of travel."""
    a = s.actuator()
    home = s.ideal.get(a, "home")
    x0, width = home + s.rng.uniform(-0.03, 0.03), s.rng.uniform(0.006, 0.02)
    return _fault(
        friction_spot,
        a,
        5.0,
        1000.0,
        on_plant(lambda x, p: p.set(a, spot=x, spot_x=x0, spot_width=width)),
    )


def torque_dropouts(s: Setting) -> Effect:
    """The drive loses torque for some 50 ms every second or so; its current says nothing of it."""
    a = s.actuator()
    return _fault(torque_dropouts, a, 1.0, 1.0, on_plant(lambda x, p: p.set(a, dropout=x)))


def rubber_stop(s: Setting) -> Effect:
    """A rubber buffer stands in the last part of the travel."""
    a = s.actuator()
    x0 = s.ideal.get(a, "home") + s.rng.uniform(0.01, 0.05)
    return _fault(
        rubber_stop, a, 200.0, 1.5e5, on_plant(lambda x, p: p.set(a, stop_x=x0, stop_k=x))
    )


def cable_pull(s: Setting) -> Effect:
    """A hose or cable chain pulls towards where it hangs loose."""
    a = s.actuator()
    x0 = s.ideal.get(a, "home") + s.rng.uniform(-0.05, 0.05)
    return _fault(cable_pull, a, 60.0, 2e4, on_plant(lambda x, p: p.set(a, cable_k=x, cable_x=x0)))


def pump(s: Setting) -> Effect:
    """Something on the rig turns at its own pace and shakes an actuator."""
    a = s.actuator()
    hz, phase = s.rng.uniform(1.5, 9.0), s.rng.uniform(0, 2 * pi)
    return _fault(
        pump, a, 3.0, 800.0, on_plant(lambda x, p: p.set(a, pump=x, pump_hz=hz, pump_phase=phase))
    )


def loose_base(s: Setting) -> Effect:
    """The frame's feet are loose: it sways at a few hertz in one direction."""
    k = 0 if s.ideal.rig.kind == "axis_1dof" else int(s.rng.integers(2))

    def change(x: float, p: object) -> object:
        floor = p.floor.copy()
        floor[1, k] /= x
        floor[2, k] /= np.sqrt(x)
        return replace(p, floor=floor)

    return _fault(loose_base, "xy"[k], 12.0, 300.0, on_plant(change))


def air_drag(s: Setting) -> Effect:
    """A sail: force with the square of speed."""
    a = s.actuator()
    return _fault(air_drag, a, 80.0, 6e4, on_plant(lambda x, p: p.set(a, drag=x)))


def supply_dip(s: Setting) -> Effect:
    """A weak supply: the faster the motor, the less force it has. `size` is the share of power missing."""
    a = s.actuator()
    i = s.ideal.index(a)
    full = 0.7 * float(s.force[i, 1] * s.speed[i])
    return _fault(supply_dip, a, 0.1, 0.97, on_plant(lambda x, p: p.set(a, power=full * (1 - x))))


def gain_schedule(s: Setting) -> Effect:
    """The drive switches to a soft speed loop whenever little speed is asked for."""
    a = s.actuator()
    v = float(s.speed[s.ideal.index(a)]) * s.rng.uniform(0.1, 0.35)
    return _fault(
        gain_schedule, a, 0.2, 0.97, on_plant(lambda x, p: p.set(a, schedule=x, schedule_v=v))
    )


def sticky_brake(s: Setting) -> Effect:
    """The holding brake drags after every standstill and reversal until it lets go."""
    a = s.actuator()
    return _fault(sticky_brake, a, 5.0, 1200.0, on_plant(lambda x, p: p.set(a, brake=x)))


def slipping_coupling(s: Setting) -> Effect:
    """A bolt is loose: above some force motor and load slip against each other, and stay so."""
    a = s.actuator()
    mean, most = s.force[s.ideal.index(a)]
    return _fault(
        slipping_coupling,
        a,
        0.1,
        0.85,
        on_plant(lambda x, p: p.set(a, slip=mean + (most - mean) * (1 - x))),
    )


def sloshing_load(s: Setting) -> Effect:
    """Part of the platform's mass swings to and fro by itself: a tank, or a rack on soft feet."""
    hz, zeta = s.rng.uniform(0.9, 4.0), s.rng.uniform(0.03, 0.15)
    at = s.ideal.cog + s.rng.uniform(-0.1, 0.1, 3)
    own = s.ideal.mass

    def change(x: float, p: object) -> object:
        m = x * own
        k = m * (2 * pi * hz) ** 2
        return replace(p, slosh=np.array([m, *at, k, 2 * zeta * np.sqrt(k * m)]))

    return _fault(sloshing_load, "platform", 0.01, 0.3, on_plant(change))


def stale_answers(s: Setting) -> Effect:
    """The drives now and then answer a request with the value of the one before."""
    return _fault(stale_answers, "bus", 0.005, 0.4, on_sensing(lambda x, m: replace(m, stale=x)))


def warming_sensor(s: Setting) -> Effect:
    """A current sensor or a gyro drifts as it warms."""
    force = s.rng.random() < 0.6
    signal = f"{s.actuator()}.force" if force else str(s.rng.choice(IMU[:3]))
    low, high = (6.0, 300.0) if force else (0.004, 0.15)
    tau, side = s.rng.uniform(5.0, 15.0), s.side()
    change = on_sensing(lambda x, m: replace(m, warm_bias={signal: side * x}, warm_tau=tau))
    return _fault(warming_sensor, signal, low, high, change)


def _fault(maker: object, location: str, low: float, high: float, apply: object) -> Effect:
    name = maker.__name__
    return Effect(name, location, low, high, apply, lambda x: {"size": x})


MAKERS = (
    warming_friction,
    friction_spot,
    torque_dropouts,
    rubber_stop,
    cable_pull,
    pump,
    loose_base,
    air_drag,
    supply_dip,
    gain_schedule,
    sticky_brake,
    slipping_coupling,
    sloshing_load,
    stale_answers,
    warming_sensor,
)
