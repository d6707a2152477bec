"""Draws and records exam cases; each is made from the order and its number alone, whichever come first."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import as_completed
from pathlib import Path
from typing import Final

import numpy as np

from hil.config import Effect, RigFile
from hil.errors import ConfigError, LimitViolation, RunError
from hil.exam.case import ANSWER, RIG, answer_of, read_answer, write_case
from hil.exam.excite import FAMILIES, draw_motion
from hil.exam.menu import Recipe, draw_recipe, effects_of, possible
from hil.exam.odd import draw_outside, outside_of
from hil.exam.order import COUNTS, Order
from hil.exam.rides import RIDE_EFFECTS, RIDE_OUTSIDE, make_ride
from hil.exam.rigs import RIDDEN, RIGS, draw_rig
from hil.exam.severity import Bench, Solved, effect_of, solve_size
from hil.exam.world import OUTSIDE, Outside, Scatter, build_world, play
from hil.exam.world.play import WorldError
from hil.files import is_taken
from hil.runs.folder import Payload
from hil.workers import worker_pool

SHARES: Final = {"none": 1.0 / 3.0, "single": 0.41, "double": 0.1, "triple": 0.02, "outside": 0.14}
ONE_LAW: Final = ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "hysteresis")
ATTEMPTS: Final = 40
WISHED: Final = 8
"""Rigs and motions tried for the effects that a case should have, before any others will do."""
TRIES_A_WISH: Final = 3


def make_exam(
    order: Order,
    count: int,
    out: Path,
    *,
    jobs: int = 2,
    on_done: Callable[[str, str], None] = lambda case, text: None,
) -> None:
    """Make cases 0 .. count - 1 below `out`; those that are there already stay as they are.

    ConfigError where cases there were made with other options, RunError where one there lacks its answer or
    rig file, or cannot be written.
    """
    offered = {*OUTSIDE, *RIDE_EFFECTS, *RIDE_OUTSIDE, *(e for rig in RIGS for e in possible(rig))}
    strange = [e for e in order.effects if e not in offered]
    if strange:
        raise ConfigError(
            f"no exam case can hold {', '.join(strange)}; choose of {', '.join(sorted(offered))}"
        )
    _check_options(order, out)
    there = [n for n in range(count) if is_taken(out / "cases" / order.case_id(n))]
    faults = [fault for n in there if (fault := _lacking(out, order.case_id(n)))]
    if faults:
        raise RunError("\n".join(faults))
    for number in there:
        on_done(order.case_id(number), "is there already")
    todo = sorted(set(range(count)) - set(there))
    if jobs <= 1 or len(todo) < 2:
        for number in todo:
            on_done(order.case_id(number), make_case(order, number, out))
        return
    with worker_pool(jobs) as pool:
        waiting = {pool.submit(make_case, order, n, out): n for n in todo}
        for done in as_completed(waiting):
            on_done(order.case_id(waiting[done]), done.result())


def _check_options(order: Order, out: Path) -> None:
    """ConfigError where a case below `out` was made with other options; not all answers say with which."""
    for path in sorted((out / "answers").glob(f"*/{ANSWER}")):
        made = read_answer(path).get("made_with")
        options = made.get("options") if isinstance(made, dict) else None
        told = None if options is None else {"scatter": 1.0, **options}
        if told is not None and told != order.options:
            other = [
                f"{key} {told.get(key)}" for key, x in order.options.items() if told.get(key) != x
            ]
            raise ConfigError(
                f"{path}: was made with other options ({', '.join(other)}); one folder holds one exam: name "
                "another with --out"
            )


def _lacking(out: Path, case: str) -> str:
    """What the case that is there lacks, and what to do; "" where nothing."""
    folder, answer = out / "cases" / case, out / "answers" / case / ANSWER
    if not (folder / RIG).is_file():
        return f"{folder}: has no {RIG}; delete the folder, and the case is made anew"
    if not answer.is_file():
        return f"{answer}: is missing; put it back, or delete {folder}, and the case is made anew"
    return ""


def make_case(order: Order, number: int, out: Path) -> str:
    """Make one case and seal its answer; returns a line about its recording that gives nothing away."""
    case = order.case_id(number)
    last: Exception | None = None
    rig = order.rigs[number % len(order.rigs)]
    make = make_ride if rig == RIDDEN else _make
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([order.seed, number, attempt])
        # kind and effects are drawn once a case: what is hard to make must not become rare
        once = np.random.default_rng([order.seed, number, 977])
        kind = _kind(order, rig, once)
        wishes = _wishes(order, kind, rig, once)
        try:
            return make(order, number, kind, wishes if attempt < WISHED else (), rng, out)
        except (WorldError, LimitViolation) as error:
            last = error
    raise ConfigError(f"{case}: could not be made: {last}")


def _kind(order: Order, rig: str, rng: np.random.Generator) -> str:
    kinds = tuple(k for k in order.kinds if len(_offered(order, k, rig)) >= COUNTS.get(k, 1))
    if not kinds:
        raise ConfigError(
            f"no case of {rig} can be {' or '.join(order.kinds)} with {', '.join(order.effects)} alone: two "
            "or three together need as many effects, outside needs one from outside the catalogue"
        )
    weights = np.array([SHARES[k] for k in kinds])
    return str(rng.choice(kinds, p=weights / weights.sum()))


def _offered(order: Order, kind: str, rig: str) -> list[str]:
    """The effects that a case of `kind` may hold."""
    if rig == RIDDEN:
        names = RIDE_OUTSIDE if kind == "outside" else RIDE_EFFECTS
    else:
        names = OUTSIDE if kind == "outside" else possible(rig, order.mode)
    return [n for n in names if not order.effects or n in order.effects]


def _wishes(order: Order, kind: str, rig: str, rng: np.random.Generator) -> tuple[str, ...]:
    """The effects that a case should have, if some rig and motion show them."""
    count = COUNTS.get(kind, 1)
    if not count:
        return ()
    return tuple(map(str, rng.choice(_offered(order, kind, rig), count, replace=False)))


def _make(
    order: Order,
    number: int,
    kind: str,
    wishes: tuple[str, ...],
    rng: np.random.Generator,
    out: Path,
) -> str:
    rig = draw_rig(order.rigs[number % len(order.rigs)], rng, is_told=order.mode == "force")
    signals: set[str] = set(rig.bus.pattern)
    if rig.imu is not None and rng.random() < 0.45:
        signals.add("imu")
    scatter = Scatter(int(rng.integers(2**31)), order.scatter)
    families = [
        str(f) for f in rng.permutation(FAMILIES)[: rng.choice([1, 2, 3], p=[0.35, 0.45, 0.2])]
    ]
    durations = [float(round(rng.uniform(20.0, 40.0), 1)) for _ in families]
    motions = [
        draw_motion(rig, f, d, rng.uniform(0.4, 0.9), rng)
        for f, d in zip(families, durations, strict=True)
    ]
    seeds = [(int(rng.integers(2**31)), int(rng.integers(2**31))) for _ in range(len(motions) + 1)]
    bench = Bench.of(rig, scatter, motions[0], seeds[0], "imu" in signals)
    asked = float(rng.choice(order.severities))
    effects, outside, solved = _drawn(
        order, kind, wishes, rig, signals, bench, durations[0], asked, rng
    )
    severity = min((order.severity_of(s.reached) for s in solved), default=0.0)
    payloads = [
        _payload(rig, rng) if k and rng.random() < 0.3 else None for k in range(len(motions))
    ]
    plays: list[tuple[int, str, Payload | None]] = [
        (k, "diagnose", p) for k, p in enumerate(payloads)
    ]
    if rng.random() < 0.3:
        motions.append(
            draw_motion(rig, str(rng.choice(FAMILIES)), 25.0, rng.uniform(0.5, 0.9), rng)
        )
        plays.insert(int(rng.integers(len(plays) + 1)), (len(motions) - 1, "reference", None))
    tables = []
    for k, role, payload in plays:
        healthy = role == "reference"
        mass = None if payload is None else (payload.mass, payload.x, payload.y, payload.z)
        world = build_world(
            rig, scatter, () if healthy else effects, () if healthy else outside, mass
        )
        played = play(
            world, motions[k], seen=seeds[k][0], hidden=seeds[k][1], with_imu="imu" in signals
        )
        tables.append((played.table(world), role, payload))
    answer = {
        **answer_of(kind, effects, outside),
        "rig": order.rigs[number % len(order.rigs)],
        "severity": severity,
        "traces": [{n: round(x, 3) for n, x in s.traces.items() if x > 0.3} for s in solved],
        "families": families,
        "scatter_seed": scatter.seed,
        "made_with": order.made_with(number),
    }
    write_case(order.case_id(number), rig, tables, answer, number, out)
    seconds = sum(m.duration_s for m in motions)
    return f"{len(tables)} runs, {seconds:.0f} s"


def _drawn(
    order: Order,
    kind: str,
    wishes: tuple[str, ...],
    rig: RigFile,
    signals: set[str],
    bench: Bench,
    duration_s: float,
    severity: float,
    rng: np.random.Generator,
) -> tuple[tuple[Effect, ...], tuple[Outside, ...], list[Solved]]:
    """Effects of a case of `kind`, each solved to the severity by itself; `wishes`: which, if any will do."""
    count = COUNTS.get(kind, 1)
    effects: list[Effect] = []
    outside: list[Outside] = []
    found: list[Solved] = []
    for _ in range(ATTEMPTS if not wishes else TRIES_A_WISH * count + 1):
        if len(found) == count:
            return tuple(effects), tuple(outside), found
        wish = wishes[len(found)] if wishes else ""
        recipe = _recipe(order, kind, wish, rig, signals, duration_s, rng)
        if any(e.effect == recipe.effect or _one_law(e, recipe) for e in effects):
            continue
        solved = solve_size(bench, recipe, severity, rng.uniform(1.0, 1.6))
        if solved is None:
            continue
        more, odd = effect_of(recipe, solved.size)
        effects += more
        outside += odd
        found.append(solved)
    raise WorldError(f"{rig.name}: no {kind} effect shows {severity:g} times the floor here")


def _one_law(there: Effect, recipe: Recipe) -> bool:
    """Whether two effects are forms of one friction at one place: together they are one of them, larger."""
    same_place = there.location == recipe.location
    return same_place and there.effect in ONE_LAW and recipe.effect in ONE_LAW


def _recipe(
    order: Order,
    kind: str,
    wish: str,
    rig: RigFile,
    signals: set[str],
    duration_s: float,
    rng: np.random.Generator,
) -> Recipe:
    names = outside_of(rig, OUTSIDE) if kind == "outside" else effects_of(rig, signals)
    allowed = (wish,) if wish else order.effects
    chosen = [n for n in names if not allowed or n in allowed]
    if not chosen:
        raise WorldError(f"{rig.name}: has none of the effects asked for: {', '.join(allowed)}")
    name = str(rng.choice(chosen))
    if kind == "outside":
        return draw_outside(rig, name, duration_s, rng)
    return draw_recipe(rig, name, signals, rng)


def _payload(rig: RigFile, rng: np.random.Generator) -> Payload:
    place = np.array(rig.mass.cog) + rng.uniform(-0.1, 0.1, 3)
    mass = float(rng.uniform(0.05, 0.2)) * rig.mass.m
    return Payload(
        mass=round(mass, 1), **{c: round(float(x), 3) for c, x in zip("xyz", place, strict=True)}
    )
