"""The verdict of a ride: by the gap's energy, what unseen rides bear out, and what would look the same."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from hil.bicycle.sensors import noise_of
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.growing import grow
from hil.gap.bicycle.sideslip import SCALE, is_no_slip
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.heldout import Score, score
from hil.gap.floor.noise import NoiseModel
from hil.gap.judged.clear import asked, other_than_facts
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.judged.doubt import BORNE_OUT, STANDS, chance, least_explained
from hil.gap.judged.verdict import judge, whereabouts
from hil.gap.located.result import Located

EXPLAINED: Final = 0.72
"""Share of a gap's energy that a verdict must explain, half of the time [set on training cases]."""
SPRUNG_EXPLAINED: Final = 0.5
"""The same of a fork or tyres alone: a road shakes a bicycle on springs more than a stiff one, where they
swing, and no ride tells that [set on rides of another world, none of whose outside effects is one]."""
SPRUNG: Final = frozenset({"front_suspension", "tyre_compliance"})
MAKERS: Final = 0.01
"""Off 1, within which a sensor's scale is no finding: makers tell it to a hundredth [R]."""
LATE_S: Final = 0.005
"""Up to which a sensor's delay is no finding: half of a sample at 100 Hz, and what filters differ by [R]."""
FIRM: Final = {"front_suspension": 5e4, "tyre_compliance": 1.1e5}
"""N/m of a fork and of tyres, above which they give way as stiff forks, frames and hard tyres of any bicycle
do [R: tyres at 4 bar and more have 130 kN/m and more, and two of them pitch a bicycle as a fork of half their
stiffness]."""
EXACT: Final = frozenset(
    {
        "sensor_bias",
        "sensor_scale",
        "sensor_latency",
        "sensor_misalignment",
        "clock_drift",
        "wheel_radius",
    }
)
"""Effects whose law has no form to differ in: the true one explains all of its gap."""
WHOLLY: Final = ((0.83, 0.94), 0.6)
"""Shares of the energy between which one of those alone becomes certain, and the chance up to there that it
is none of the catalogue: clocks that part look like a latency, a turned sensor like an offset [set on tuning
seed 1921 and the other world's seed 1: 35 true ones explain 0.94 and more, nearly all of them 1.0; of eleven
that are named where the true effect is withheld, eight explain 0.93 and less. Beside healthy tyres that slip
more than most a true scale of the steer explained 0.87]."""
OTHERWISE: Final = 0.03
"""Chance that even what is all explained is none of the catalogue [set on exams of rides 618 to 625: of 92
causes that were named with 0.9 and more, all were there (`docs/marks`, "reliability")]."""
TWINS: Final = {
    "bicycle.front_suspension": (0.15, "an IMU whose bracket bends"),
    "bicycle.tyre_compliance": (0.15, "an IMU whose bracket bends"),
    "steer.sensor_scale": (0.45, "tyres that slip sideways"),
    "imu.accel_x.sensor_scale": (0.25, "an IMU whose bracket bends"),
    "imu.accel_y.sensor_scale": (0.25, "an IMU whose bracket bends"),
    "lean.sensor_scale": (0.25, "an inclinometer that swings out in curves"),
}
"""The same of effects that something outside the catalogue looks like on any ride, and what that is: a
bracket that bends pitches the IMU when the fork would dive and turns gravity into its axes in proportion to
what they feel, tyres that slip sideways turn a bicycle less than its steer angle says, as a scale above 1 of
that does where rides of one speed do not tell them apart (`is_no_slip`), and an inclinometer that feels
curves tells less of the lean that they need [set on used-up exams and rides of another world: about half of
these that were named were not there, most of them for such a thing; of eight scales of the steer above 1, six
were tyres, of five in seven later worlds one; of four later worlds' forks 9 of 11 were there, of their tyres
8 of 8]."""
OF_SETS: Final = 0.3
"""The same at most for sets, whose other effects would stand all the same."""
DRIFT: Final = "clock_drift"
"""The one effect that grows with time itself."""
GROWN: Final = 0.6
"""Chance that an effect which grows along the rides is none of the catalogue, or may not be named [R]."""
SLIGHT: Final = 0.1
"""By how much more than for that alone a cause may be in doubt, for the sentence to speak of it."""
HOLDS: Final = 0.05
SEVERAL_HOLD: Final = 0.7
"""Held-out shrink below which one effect and a set are withdrawn: with two effects much can be bent to fit
what was seen [set on training cases]."""
AS_MUCH: Final = 1.15
"""Times what is left of the seen data, floors in each, that may be left of unseen ones."""
UNSAID: Final = 1.38
"""Floors, tolerances among them, from which on a signal is off although no candidate explains it: how well a
record tells its own noise, twice over [set on training cases]."""
RESTLESS: Final = {LEAN_TORQUE: 1.6, "imu.gyro_x": 1.6, "imu.accel_x": 1.8}
"""The same of the lean torque, for how still riders sit differs more than how loud sensors are, and of the
roll rate, which is held against the slope of lean: what an inclinometer errs by slowly shows where riders
lean, and no quiet band tells it [set on healthy rides of three worlds of others, 1.47 at most]; and of the
acceleration along, for roads rise and fall by a few in a thousand [1.7 in a world whose roads do]. No floor
has that in: there it would hide what tells tyres from a fork."""
ROAD: Final = {"imu.gyro_y": 8e-4, "imu.accel_x": 0.02}
"""What a road that is as level as roads are adds to a signal, rad/s and m/s² [R]: its slope differs by some
two thousandths from here to there. It asks for no explanation and is none; no floor has it, as above."""


def twins(c: Calibrated, none: Fit, best: Fit) -> list[tuple[float, str]]:
    """Of effects of a fit that something outside the catalogue looks like, its chance and its name."""
    value = dict(zip(best.names, best.values.tolist(), strict=True)).get(SCALE)
    is_steer = value is not None and (value < 1.0 or is_no_slip(c, none, best))
    most = 1.0 if len(best.leaves) == 1 else OF_SETS
    return [
        (min(TWINS[x.name][0], most), TWINS[x.name][1]) for x in best.leaves
        if x.name in TWINS and not (x.name == "steer.sensor_scale" and is_steer)
    ]  # fmt: skip


def _growing(c: Calibrated, best: Fit) -> list[tuple[float, str]]:
    """As `twins`, of effects that are exact but grow along the rides."""
    others = other_than_facts(best)
    exact = [x for x in others if x.effect in EXACT - {DRIFT}]
    if not exact or not grow(c, best, exact):
        return []
    most = GROWN if len(others) == 1 else OF_SETS
    return [(most, "something that grows along the rides, as what warms up or works loose does")]


def leaves_as_much(c: Calibrated, best: Fit, unseen: Score) -> bool:
    """Whether a fit leaves no more of unseen data than of the seen ones: what it takes off those then is
    little because little of it is there."""
    rng = np.random.default_rng(0)
    seen = score(c.problem, c.noise, best.residual, best.residual, c.train, unseen.signals, rng)
    return unseen.after * seen.floor <= AS_MUCH * seen.after * unseen.floor


def standing(located: Located) -> dict[str, float]:
    """Signals that stand above what noise and tolerances make of them, and so are a gap whatever explains it,
    with the floors that they do."""
    above = {s.signal: s.ratio for s in located.signals}
    return {name: ratio for name, ratio in above.items() if ratio >= RESTLESS.get(name, UNSAID)}


def unsaid(found: Diagnosis) -> Diagnosis:
    """`found`, no gap for want of a candidate; unknown where a signal is one all the same."""
    over = standing(found.located)
    if not over:
        return found
    worst = max(over, key=lambda s: over[s])
    sentence = (
        f"A gap that nothing in the catalogue explains: {worst} stands {over[worst]:.1f} times above what "
        "noise and a healthy bicycle's tolerances make of it, and no candidate has its pattern."
        f"{whereabouts(found.located)}"
    )
    return replace(found, verdict="unknown", sentence=sentence, unknown=1.0)


def told_by(found: Diagnosis, other: str) -> Diagnosis:
    """`found` as unknown, because of some `other` thing that is in no model."""
    if found.verdict == "unknown":
        return replace(found, sentence=f"{found.sentence} Besides, {other}.")
    causes = tuple(replace(x, probability=OTHERWISE * x.probability) for x in found.causes)
    unknown = 1.0 - sum(x.probability for x in causes)
    sentence = f"A gap that nothing in the catalogue explains: {other}."
    return replace(
        found, verdict="unknown", sentence=sentence, causes=causes, effects=(), unknown=unknown
    )


def is_usual(found: Diagnosis, rig: BicycleFile) -> bool:
    """Whether all that was found is that a bicycle gives way as hard tyres and stiff frames do, or that a
    sensor is off by what its maker allows."""
    return bool(found.effects) and all(_is_trifle(x, rig) for x in found.effects)


def _is_trifle(x: Cause, rig: BicycleFile) -> bool:
    """Whether an effect is no more than any healthy bicycle or sensor has of it: a zero within half a step of
    its encoder is where it was found when that was switched on."""
    if x.effect == "sensor_bias" and x.location in SIGNALS:
        _, step = noise_of(x.location, rig)
        return abs(x.parameters["offset"].value) < 0.5 * step
    if x.effect in FIRM:
        return x.parameters["stiffness"].value > FIRM[x.effect]
    if x.effect == "sensor_scale" and x.location != "rear_wheel":  # an encoder counts exactly
        return abs(x.parameters["scale"].value - 1.0) < MAKERS
    return x.effect == "sensor_latency" and abs(x.parameters["delay"].value) < LATE_S


def by_energy(found: Diagnosis, measured: NoiseModel) -> Diagnosis:
    """The same with the chance of an unknown cause by the share of the gap's energy on the training data.

    A ride's gap stands in few seconds, tens of floors high; evidence counts in nats, in which those few
    seconds are little. What is left of the energy says whether a cause is missing. `measured` is the floor
    without tolerances: an effect that has no form to differ in explains all that stands above that one,
    however much of it a healthy bicycle might have too.
    """
    c, none, best = found.calibrated, found.none, found.best
    if c is None or none is None or best is None or not found.causes:
        return found
    is_sure = found.causes[0].gain > asked(c).decisive
    share = _explained(c, none, best, is_sure)
    unseen = found.score
    worth = None if unseen is None or unseen.before <= STANDS * unseen.floor else unseen.shrink
    if unseen is not None and leaves_as_much(c, best, unseen):
        worth = None if worth is None or worth < BORNE_OUT[0] else worth
    least, twin = max([(OTHERWISE, ""), *twins(c, none, best), *_growing(c, best)])
    others = other_than_facts(best)
    is_sprung = len(others) == 1 and others[0].effect in SPRUNG
    usual = SPRUNG_EXPLAINED if is_sprung else EXPLAINED
    unknown = chance(share, least_explained(worth, usual), least) if others else least
    if len(others) == 1 and others[0].effect in EXACT:
        wholly = max(share, _wholly(c, measured, none, best, is_sure))
        unknown = max(unknown, float(np.interp(wholly, WHOLLY[0], (WHOLLY[1], least))))
    if others and worth is not None and worth < (HOLDS if len(others) == 1 else SEVERAL_HOLD):
        unknown = max(unknown, 0.9)  # unseen data do not bear it out
    factor = (1.0 - unknown) / max(1.0 - found.unknown, 1e-12)
    causes = tuple(replace(x, probability=x.probability * factor) for x in found.causes)
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in best.leaves
    )
    shrink = None if unseen is None else unseen.shrink
    where = whereabouts(found.located)
    verdict, sentence = judge(chosen, causes, unknown, shrink, share=share, where=where)
    if verdict == "unknown" and unknown < least + SLIGHT:
        names = " and ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in chosen)
        sentence = (
            f"A gap that something outside the catalogue makes more often than {names}, which these rides "
            f"cannot tell from it: {twin}."
        )
    return replace(
        found,
        verdict=verdict,
        sentence=sentence,
        causes=causes,
        effects=chosen if verdict != "unknown" else (),
        unknown=unknown,
    )


def _explained(c: Calibrated, none: Fit, best: Fit, is_sure: bool) -> float:
    """Share of the energy above the floor, tolerances and moments and all, that `best` explains."""
    floors = {s: with_road(s, floor) for s, floor in c.noise.floor(c.problem).items()}
    before, after = (c.noise.rms(c.problem, f.residual) for f in (none, best))
    return _share(floors, before, after, is_sure)


def _wholly(c: Calibrated, measured: NoiseModel, none: Fit, best: Fit, is_sure: bool) -> float:
    """The same above the floor `measured`, each sample by its noise."""
    drawn = measured.weighted_rms(c.problem, measured.draws)
    floors = {s: with_road(s, floor) for s, floor in drawn.items()}
    before, after = (measured.weighted_rms(c.problem, f.residual) for f in (none, best))
    return _share(floors, before, after, is_sure)


def with_road(signal: str, floor: float) -> float:
    """A signal's floor with what a level road adds, in its unit."""
    return math.hypot(floor, ROAD.get(signal, 0.0))


def _share(
    floors: Mapping[str, float],
    before: Mapping[str, float],
    after: Mapping[str, float],
    is_sure: bool,
) -> float:
    """Share of what stands above `floors` before that does not after, by signal root mean squares."""
    was, left = 0.0, 0.0
    for s, floor in floors.items():
        # What is beyond doubt leaves nothing but noise.
        least = min((after[s] / floor) ** 2, 1.0) if is_sure else 1.0
        was += max((before[s] / floor) ** 2 - least, 0.0)
        left += max((after[s] / floor) ** 2 - least, 0.0)
    return 1.0 - left / max(was, 1e-9)
