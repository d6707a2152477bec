"""One case that is ridden: a bicycle drawn, an effect sized on the exam's own world, rides recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.bicycle.manoeuvres import Manoeuvre
from hil.bicycle.path import eight, slalom, surges, u_turns
from hil.config import BicycleFile, Effect
from hil.configfile import load_bicycle, parse_settings
from hil.exam.case import answer_of, write_case
from hil.exam.order import COUNTS, Order
from hil.exam.rides.bench import RideBench
from hil.exam.rides.menu import RIDE_EFFECTS, draw_effect
from hil.exam.rides.outside import RIDE_OUTSIDE, draw_outside
from hil.exam.rides.record import record
from hil.exam.rides.world import Bicycle, ride
from hil.exam.severity import Solved, effect_of, solve_size
from hil.exam.world import Outside, Scatter
from hil.exam.world.play import WorldError

Rng = np.random.Generator

FAMILIES: Final = (
    Manoeuvre("round trip", "there and back", lambda: u_turns(35.0), 5.0, 3.6),
    Manoeuvre("slalom", "round marks", lambda: slalom(80.0, 17.0), 5.0, 4.0),
    Manoeuvre("surges", "straight on, faster and slower", lambda: surges(80.0, 20.0), 5.0, 3.6),
    Manoeuvre("eight", "a circle to either side", lambda: eight(6.5), 4.5, 3.6),
)
TRIES: Final = 6
WHEELS: Final = frozenset({"wheel_radius", "wheel_slip"})
"""Two that no ride tells apart: never together."""


def make_ride(
    order: Order, number: int, kind: str, wishes: tuple[str, ...], rng: Rng, out: Path
) -> str:
    """Make case `number`; WorldError where this draw cannot be one."""
    rig = draw_bicycle(rng)
    scatter = Scatter(int(rng.integers(2**31)), order.scatter)
    count = int(rng.choice([1, 2, 3], p=[0.25, 0.5, 0.25]))
    ways = [FAMILIES[k] for k in rng.permutation(len(FAMILIES))[:count]]
    seeds = [int(rng.integers(2**31)) for _ in range(count + 1)]
    asked = float(rng.choice(order.severities))
    effects: tuple[Effect, ...] = ()
    outside: tuple[Outside, ...] = ()
    solved: list[Solved] = []
    if kind != "none":
        bench = RideBench.of(rig, scatter, ways[0], seeds[0])
        effects, outside, solved = _drawn(order, kind, wishes, bench, asked, rng)
    plays: list[tuple[Manoeuvre, int, str]] = [
        (way, seed, "diagnose") for way, seed in zip(ways, seeds, strict=False)
    ]
    if rng.random() < 0.3:
        healthy = (FAMILIES[rng.integers(len(FAMILIES))], seeds[-1], "reference")
        plays.insert(int(rng.integers(len(plays) + 1)), healthy)
    tables: list[tuple[Any, str, None]] = []
    for way, seed, role in plays:
        told = role == "diagnose"
        b = Bicycle(rig, scatter, effects if told else (), outside if told else ())
        tables.append((record(b, ride(b, way, seed), seed), role, None))
    answer = {
        **answer_of(kind, effects, outside),
        "rig": rig.name,
        "severity": min((order.severity_of(s.reached) for s in solved), default=0.0),
        "traces": [{n: round(x, 3) for n, x in s.traces.items() if x > 0.3} for s in solved],
        "families": [way.name for way in ways],
        "scatter_seed": scatter.seed,
        "made_with": order.made_with(number),
    }
    write_case(order.case_id(number), rig, tables, answer, number, out)
    return f"{len(tables)} rides"


def draw_bicycle(rng: Rng) -> BicycleFile:
    """The shipped bicycle with another rider, another place for its IMU and other noise."""
    tables = load_bicycle("bicycle").model_dump()
    share = rng.uniform(0.82, 1.15)
    mass = tables["mass"]
    mass["m"] = (mass["m"][0], round(mass["m"][1] * share, 1), *mass["m"][2:])
    mass["I3"] = tuple(round(x * share, 3) for x in mass["I3"])
    tables["rider"]["mass"] = round(tables["rider"]["mass"] * share, 1)
    place = (rng.uniform(0.0, 0.6), 0.0, rng.uniform(0.35, 0.75))
    tables["imu"]["position"] = tuple(round(float(x), 3) for x in place)
    for name in ("lean", "rear_wheel", "steer", "gyro", "accel"):
        tables["noise"][name] = round(tables["noise"][name] * float(rng.uniform(0.7, 1.3)), 6)
    return parse_settings(tables, BicycleFile, "bicycle")


def _drawn(
    order: Order, kind: str, wishes: tuple[str, ...], bench: RideBench, severity: float, rng: Rng
) -> tuple[tuple[Effect, ...], tuple[Outside, ...], list[Solved]]:
    """Effects of a case of `kind`, each solved to the severity by itself."""
    count = COUNTS.get(kind, 1)
    names = RIDE_OUTSIDE if kind == "outside" else RIDE_EFFECTS
    allowed = [n for n in names if not order.effects or n in order.effects]
    effects: list[Effect] = []
    outside: list[Outside] = []
    found: list[Solved] = []
    for _ in range(TRIES * count):
        name = wishes[len(found)] if wishes else str(rng.choice(allowed))
        others = {e.effect for e in effects}
        if name in others or (name in WHEELS and others & WHEELS):
            if wishes:
                break
            continue
        recipe = draw_outside(name, rng) if kind == "outside" else draw_effect(name, rng)
        solved = solve_size(bench, recipe, severity, rng.uniform(1.0, 1.6))
        if solved is None:
            continue
        more, odd = effect_of(recipe, solved.size)
        effects += more
        outside += odd
        found.append(solved)
        if len(found) == count:
            return tuple(effects), tuple(outside), found
    raise WorldError(f"no {kind} effect shows {severity:g} times the floor in this ride")
