"""What a healthy rig may have or do that its file does not say: habits, not faults.

- Drives rest at setpoints. A drive that draws a line to each setpoint may start it from where the line before
  would be by now, or from what its last tick asked for (`bus.interpolation`). The latter stands still for a
  tick each cycle: force that is sampled in step with setpoints then looks like drag in proportion to speed,
  on a healthy rig.
- Drives make the first step of such a line at the tick at which they take the setpoint, and so are a tick
  early in everything. No effect of the catalogue is: delays are added.
- Drives that play setpoints on their own clocks begin each cycle together, whatever slot their setpoints came
  in, and sooner than a cycle after those came. No effect of the catalogue makes all drives early.
- Drives take their time: what they compute for, filter speeds with and switch currents by adds to the lag of
  their current loops. To a twin whose loops have that of the file alone their gains seem larger.
- Drives that are told forces draw each out in a line, as they do positions (`bus.force_interpolation`): all
  that they do is half a cycle later and smoother.
- Drives feed the static force forward beside their cascade (law "cascade_static"). Their integrators have
  less to do, so that a load that changes with the pose leaves less of an error in the position.
- Friction builds up within some micrometres, for what rubs bends before it slips. A bus of a few
  milliseconds shows that at each reversal, a slower one most where a drive hardly moves.
- Guides rub on the load, not on the motor. A stiff transmission does not tell the two apart; behind one that
  gives, a load that rubs stops swinging (`hil.gap.rounds.twins`).
- Legs weigh something. Most rig files take them for massless; of two times 1 kg a leg a platform of 450 kg
  takes 1.3 % more force.

What drives make of forces they answer themselves (`hil.gap.record.lines`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from hil.config import Actuator, LegMass, RigFile
from hil.gap.located.habit import HELD, Habit, is_finer
from hil.gap.located.result import Located

EARLY: Final = 0.4
"""Of a tick of the position loop, by which all drives seem early, half of them more, where they may lead."""
LATER_S: Final = 2e-4
"""By how much loops lag more where the share of that habit is 1 [R: two steps of a speed loop,
its filter]."""
LATER: Final = (0.5, 0.8, 1.2, 1.8)
"""Shares of that which are tried."""
LEGS: Final = 0.05
"""Of the platform's mass, what all legs together weigh where the share of their habit is 1 [R]."""
SOONER: Final = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.13, 0.16, 0.19, 0.22, 0.26, 0.3)
"""Shares of a cycle by which the first of drives that begin their cycles together may wait less than one."""
BENDS_M: Final = 2e-5
"""m or rad within which friction builds up where the share of that habit is 1 [R: bristles of rolling guides
and screws bend by 5 to 50 µm]."""
BENT: Final = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0)
"""Shares of that which are tried."""
RUBS: Final = (0.3, 0.6)
"""Shares of the Coulomb friction that may rub on the load, tried in turn [R: a screw's nut and bearings make
more than half of it on most rigs]."""
HEAVIEST: Final = 2.0
"""Such shares from which on legs are no trifle that a rig file leaves out."""


def _may_rest(rig: RigFile) -> bool:
    bus = rig.bus
    return (
        bus.interpolation == "linear"
        and not bus.retimed
        and bus.position_loop > bus.speed_loop
        and bus.cycle > 1.5 * bus.position_loop
    )


def _resting(rig: RigFile, _: float) -> RigFile:
    bus = rig.bus.model_copy(update={"interpolation": "linear_rests"})
    return rig.model_copy(update={"bus": bus})


def _leading(rig: RigFile, _: float) -> RigFile:
    bus = rig.bus.model_copy(update={"interpolation": "linear_leads"})
    return rig.model_copy(update={"bus": bus})


def _may_play_together(rig: RigFile) -> bool:
    """Where slots are apart: of a single drive that is early a gain might be too high."""
    return rig.bus.retimed and rig.bus.schedule == "parameter" and len(rig.actuators) > 1


def _together(rig: RigFile, share: float) -> RigFile:
    bus = rig.bus.model_copy(update={"clock_wait": (1.0 - share) * rig.bus.cycle})
    return rig.model_copy(update={"bus": bus})


def _is_early(located: Located) -> float:
    """1 where drives seem early by nearly a tick, as calibration says of setpoints and positions together."""
    rig = located.evidence.problem.rig
    found = {f.name: f.change for f in located.nuisances}
    ends = ("transport_delay.delay", "position.sensor_latency.delay")
    late = [sum(found.get(f"{a}.{end}", 0.0) for end in ends) for a in rig.actuator_names]
    return float(float(np.median(late)) < -EARLY * rig.bus.position_loop)


def _taking_time(rig: RigFile, share: float) -> RigFile:
    def later(a: Actuator) -> Actuator:
        turn = 2.0 * math.pi
        lag_s = 1.0 / (turn * a.current_hz) + share * LATER_S
        return a.model_copy(update={"current_hz": 1.0 / (turn * lag_s)})

    return rig.model_copy(update={"actuators": tuple(map(later, rig.actuators))})


def _drawing(rig: RigFile, _: float) -> RigFile:
    bus = rig.bus.model_copy(update={"force_interpolation": "linear"})
    return rig.model_copy(update={"bus": bus})


def _may_feed(rig: RigFile) -> bool:
    return all(a.law == "cascade" and a.static_ff > 0.0 for a in rig.actuators)


def _feeding(rig: RigFile, _: float) -> RigFile:
    actuators = (a.model_copy(update={"law": "cascade_static"}) for a in rig.actuators)
    return rig.model_copy(update={"actuators": tuple(actuators)})


def _may_bend(rig: RigFile) -> bool:
    return not any(a.presliding for a in rig.actuators)


def _bending(rig: RigFile, share: float) -> RigFile:
    actuators = (a.model_copy(update={"presliding": share * BENDS_M}) for a in rig.actuators)
    return rig.model_copy(update={"actuators": tuple(actuators)})


def _may_rub(rig: RigFile) -> bool:
    return not any(a.guide_share for a in rig.actuators) and any(a.coulomb for a in rig.actuators)


def _rubbing(rig: RigFile, share: float) -> RigFile:
    actuators = (a.model_copy(update={"guide_share": share}) for a in rig.actuators)
    return rig.model_copy(update={"actuators": tuple(actuators)})


def _legs(rig: RigFile) -> list[Actuator]:
    return [a for a in rig.actuators if a.name.startswith("leg")]


def _may_weigh(rig: RigFile) -> bool:
    legs = _legs(rig)
    return bool(legs) and all(a.leg == LegMass() for a in legs)


def _may_load(rig: RigFile) -> bool:
    """Where drives feed nothing forward, what they know of legs makes no difference."""
    return _may_weigh(rig) and any(a.law != "cascade" and a.static_ff > 0.0 for a in rig.actuators)


def _weighing(is_fed: bool, rig: RigFile, share: float) -> RigFile:
    """Each half of a leg is a slender rod, half as long as the leg at home; `is_fed`: drives know of it."""
    legs = _legs(rig)
    half = 0.5 * share * LEGS * rig.mass.m / len(legs)

    def heavy(a: Actuator) -> Actuator:
        inertia = half * (0.5 * a.home) ** 2 / 12.0
        leg = LegMass(
            lower_mass=half, lower_cog=0.25 * a.home, lower_inertia=inertia,
            upper_mass=half, upper_cog=0.25 * a.home, upper_inertia=inertia, is_fed=is_fed,
        )  # fmt: skip
        return a.model_copy(update={"leg": leg})

    actuators = (heavy(a) if a in legs else a for a in rig.actuators)
    return rig.model_copy(update={"actuators": tuple(actuators)})


RESTS: Final = Habit(
    "bus.interpolation", "drives that rest for a tick at each setpoint", _may_rest, _resting,
    lambda twin: (
        f"the drives stand still for a tick of {1e3 * twin.bus.position_loop:g} ms at each setpoint: the "
        f'twin rests with them; "{twin.bus.interpolation}" belongs into the rig file'
    ),
    free=("transport_delay.delay",),
    told=0.01,
    is_plain=True,
    shows=is_finer,
)  # fmt: skip
"""Drives that rest are later by about half a tick: how late setpoints are is free. Beside a twin that does
not rest no place of their ticks makes kicks fall on theirs, and the louder noise hides what else there is."""
LEADS: Final = Habit(
    "bus.interpolation", "drives that make a first step as they take a setpoint", _may_rest, _leading,
    lambda twin: (
        "the drives make the first step to each setpoint as they take it, so that they are a tick of "
        f"{1e3 * twin.bus.position_loop:g} ms early: the twin does so with them; "
        f'"{twin.bus.interpolation}" belongs into the rig file'
    ),
    asked=_is_early,
)  # fmt: skip
TOGETHER: Final = Habit(
    "bus.clock_wait", "drives that begin each cycle together", _may_play_together, _together,
    lambda twin: (
        f"the drives begin each cycle together, {1e3 * twin.bus.waits_s(0):.2g} ms after the first one's "
        "setpoint came: the twin does so with them; bus.clock_wait belongs into the rig file"
    ),
    sizes=SOONER,
    is_plain=True,
)  # fmt: skip
TAKES_TIME: Final = Habit(
    "actuators.current_hz", "drives whose loops take their time", lambda rig: True, _taking_time,
    lambda twin: (
        "the drives' loops seem to lag as if their current loops had "
        f"{min(a.current_hz for a in twin.actuators):.0f} Hz, for drives compute, filter and switch: those "
        "of the twin do so"
    ),
    told=0.01,
    sizes=LATER,
)  # fmt: skip
DRAWS: Final = Habit(
    "bus.force_interpolation", "drives that draw out what force they are told",
    lambda rig: rig.bus.force_interpolation == "hold", _drawing,
    lambda twin: (
        "the drives draw the forces that they are told out in lines of one cycle, so the twin does so with "
        f'them; "{twin.bus.force_interpolation}" belongs into the rig file. Of a single actuator whose force '
        f"is sampled just where setpoints come a delay of about {500.0 * twin.bus.cycle:g} ms looks the same"
    ),
)  # fmt: skip
FEEDS: Final = Habit(
    "actuators.law", "drives that feed the static force forward", _may_feed, _feeding,
    lambda twin: (
        f"the drives feed {twin.actuators[0].static_ff:g} of the static force forward beside their cascade: "
        f'the twin does so with them; "{twin.actuators[0].law}" belongs into the rig file'
    ),
    shares=(HELD, math.inf),
    is_unlike=True,
)  # fmt: skip


BENDS: Final = Habit(
    "actuators.presliding", "friction that builds up within micrometres", _may_bend, _bending,
    lambda twin: (
        f"friction seems to build up within {1e6 * twin.actuators[0].presliding:.0f} µm (or µrad), for what "
        "rubs bends before it slips: that of the twin does so"
    ),
    told=0.01,
    sizes=BENT,
    is_unlike=True,
)  # fmt: skip


GUIDES: Final = Habit(
    "actuators.guide_share", "guides that rub on the load", _may_rub, _rubbing,
    lambda twin: (
        f"about {100.0 * twin.actuators[0].guide_share:.0f} % of the friction seems to rub on the load, "
        "behind a transmission that gives: that of the twin does so"
    ),
    sizes=RUBS,
)  # fmt: skip
"""Asked only beside fits whose transmissions give."""


def _weighs(is_fed: bool, may: Callable[[RigFile], bool], and_drives: str) -> Habit:
    return Habit(
        "actuators.leg", f"legs that weigh something, {and_drives}", may, partial(_weighing, is_fed),
        lambda twin: (
            f"the legs weigh about {2.0 * _legs(twin)[0].leg.lower_mass:.2g} kg each, as it seems, "
            f"{and_drives}; by the rig file they weigh nothing: those of the twin do"
        ),
        shares=(HELD, HEAVIEST),
    )  # fmt: skip


WEIGHS: Final = _weighs(True, _may_weigh, "and drives reckon with it")
LOADS: Final = _weighs(False, _may_load, "and drives do not know of it")
LINES: Final = (RESTS, LEADS)
"""How drives draw their lines: references tell that, whatever runs do."""
HABITS: Final = (TOGETHER, *LINES, TAKES_TIME, FEEDS, BENDS, WEIGHS, LOADS)
"""Those that a record is asked for by their share."""
