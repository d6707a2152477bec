"""One bicycle with its sensors and its rides: what is asked of it, and what of that a fault changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_rides.body import Body, healthy
from benchmarks.other_rides.ridden import Ride, Truth, draw_ride, ideal, ridden, steered
from benchmarks.other_rides.sensing import (
    ALL,
    IMU,
    Chance,
    Sensing,
    Signals,
    chance,
    fitted,
    sense,
    sizes,
)
from hil.config import BicycleFile

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bicycle:
    """Body and sensors."""

    body: Body
    sensing: Sensing


@dataclass(frozen=True, slots=True)
class Told:
    """One ride as it happened to a bicycle."""

    steer: Array
    """At the plan's instants, rad."""
    truth: Truth


@dataclass(frozen=True, slots=True)
class Outing:
    """One ride with all chance of road, rider and sensors."""

    ride: Ride
    luck: Chance
    healthy: Told
    """As the healthy bicycle rides it."""


def draw_bicycle(rng: np.random.Generator) -> Bicycle:
    """A healthy one."""
    return Bicycle(healthy(rng), fitted(rng))


def draw_outing(kind: str, rng: np.random.Generator, rig: BicycleFile, body: Body) -> Outing:
    """A ride of a kind."""
    ride = draw_ride(kind, rng, rig, body)
    return Outing(ride, chance(rng, rig, ride.duration_s), _go(rig, body, ride, None))


def go(rig: BicycleFile, body: Body, outing: Outing, steer: Array | None = None) -> Told:
    """The ride; with the steer that balance asks for, or with one that is given."""
    return _go(rig, body, outing.ride, steer)


def noise_free(rig: BicycleFile, truth: Truth, sensing: Sensing, outing: Outing) -> Signals:
    """Answers without noise and without the sensors' own steps."""
    return sense(rig, truth, sensing, outing.luck, dict.fromkeys(ALL, 0.0))


def noisy(rig: BicycleFile, truth: Truth, sensing: Sensing, outing: Outing) -> Signals:
    """Answers with the rig file's noise."""
    noise = {s: size for s, (size, _) in sizes(rig).items()}
    return sense(rig, truth, sensing, outing.luck, noise)


def floors(rig: BicycleFile, bicycle: Bicycle, outings: list[Outing]) -> dict[str, float]:
    """Rms by signal that the rig file's model cannot tell of this healthy bicycle: noise, steps and misses.

    Of the IMU: what its rigid model makes of the coordinates as read. Of lean and steer: their zeros, and
    the steer that the rider's own motion takes.
    """
    missed = dict.fromkeys(ALL, 0.0)
    still = replace(bicycle.body.hold, stiffness=1e7, damping=1e4)
    for outing in outings:
        told = outing.healthy
        read = noise_free(rig, told.truth, bicycle.sensing, outing)
        lean, steer = (bicycle.sensing.channels[s].offset for s in ("lean", "steer"))
        model = ideal(rig, told.truth, lean, steer)
        perfect = replace(
            bicycle.body, hold=still, restless_rad=0.0, rear_scale=1.0, front_scale=1.0
        )
        asked = steered(rig, perfect, outing.ride).steer
        missed["lean"] += lean**2
        missed["steer"] += steer**2 + float(np.mean((asked - told.steer) ** 2))
        for k, s in enumerate(IMU):
            there = np.interp(outing.luck.stamps[s], told.truth.t_s, model[k])
            missed[s] += float(np.mean((read[s] - there) ** 2))
    return {
        s: float(np.sqrt(noise**2 + step**2 / 12.0 + missed[s] / len(outings)))
        for s, (noise, step) in sizes(rig).items()
    }


def traces(
    rig: BicycleFile, healthy_one: Bicycle, faulty: Bicycle, outings: list[Outing]
) -> dict[str, float]:
    """Rms by signal of the faulty record minus the healthy one of the same ride, all chance the same.

    A fault of the body: the IMU at equal lean, wheel and steer, and the steer that balance asks for. A
    fault of the sensors: their answers; of the wheel's angle, which nothing foretells, rather what the
    model makes of it.
    """
    out = dict.fromkeys(ALL, 0.0)
    for outing in outings:
        told = same = outing.healthy
        if faulty.body != healthy_one.body:
            hands = outing.healthy.steer
            rebalanced = _balances(faulty.body) != _balances(healthy_one.body)
            told = go(rig, faulty.body, outing, None if rebalanced else hands)
            if rebalanced:
                same = go(rig, healthy_one.body, outing, told.steer)
            if _holds(faulty.body) != _holds(healthy_one.body):
                out["steer"] += float(np.mean((hands - told.steer) ** 2))
        coarse = any(c.step for c in faulty.sensing.channels.values())
        read = noisy if coarse else noise_free
        with_it = read(rig, told.truth, faulty.sensing, outing)
        without = read(rig, same.truth, healthy_one.sensing, outing)
        for s in ALL:
            if s != "rear_wheel" or coarse or faulty.sensing.before is not None:
                out[s] += float(np.mean((with_it[s] - without[s]) ** 2))
        _add_speed(rig, told.truth, healthy_one.sensing, faulty.sensing, out)
    return {s: float(np.sqrt(v / len(outings))) for s, v in out.items()}


def _go(rig: BicycleFile, body: Body, ride: Ride, steer: Array | None) -> Told:
    turned = steered(rig, body, ride).steer if steer is None else steer
    return Told(turned, ridden(rig, body, ride, turned))


def _holds(body: Body) -> tuple[object, ...]:
    """What of a body changes the steer for a lean at a speed, and nothing else."""
    return body.hold, body.gusts_n


def _balances(body: Body) -> tuple[object, ...]:
    """What of a body changes the steer for a lean."""
    return *_holds(body), body.rear_scale, body.front_scale, body.slip


def _add_speed(
    rig: BicycleFile, truth: Truth, before: Sensing, after: Sensing, out: dict[str, float]
) -> None:
    """What the model makes of a wheel's angle that is scaled or late."""
    wheel, was = after.channels["rear_wheel"], before.channels["rear_wheel"]
    if (wheel.scale, wheel.delay_s) == (was.scale, was.delay_s):
        return
    late = np.interp(truth.t_s - wheel.delay_s + was.delay_s, truth.t_s, truth.speed)
    changed = replace(truth, speed=wheel.scale / was.scale * late)
    difference = (ideal(rig, changed) - ideal(rig, truth))[:, truth.t_s > 0.0]
    for k, s in enumerate(IMU):
        out[s] += float(np.mean(difference[k] ** 2))
