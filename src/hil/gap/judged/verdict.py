"""What weighed fits amount to: causes with probabilities and intervals, held-out shrink, the verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.catalogue.bank import Bank
from hil.gap.catalogue.nature import EVENTS, MOMENTS
from hil.gap.catalogue.nuisances import CRYSTALS, LOOPS, WOBBLE_M
from hil.gap.catalogue.sprung import SOFTEST_HZ, stiffness_at
from hil.gap.fits.evidence import MORE, Weighed, weigh
from hil.gap.fits.facts import EFFECT as ROUNDED
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import ANSWERS
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.heldout import Score, traces
from hil.gap.fits.shares import largest_ratio
from hil.gap.judged.causes import OTHER_LAW, Shown, weighed_causes, without_doubtful
from hil.gap.judged.clear import asked, clear, other_than_facts, signals
from hil.gap.judged.constancy import Variation
from hil.gap.judged.diagnosis import Cause, Diagnosis, Verdict
from hil.gap.judged.doubt import HOLDS, STANDS, Told, by_share, doubt, explained_share, is_hidden
from hil.gap.located.events import jumps
from hil.gap.located.result import RATIO, Located, Place, SignalGap
from hil.gap.record.leaf import Leaf

Array = NDArray[np.float64]

SURE: Final = 0.8
"""Probability from which on one candidate is the verdict."""
LARGE: Final = 2.0
"""Floors on any signal that its usual residual, wild samples aside, must stand above to be a gap alone."""
BANDS: Final = {"force": 5.5, "current": 5.5}
"""Floors that one band of a signal up to SLOW_HZ stands above its own, everywhere or in a region, to be a gap
alone: slow drags are small beside the whole noise and tower above that of their band. What a position has
there are micrometres of its zero, what an IMU has its own slow errors, and what friction of another law does
at reversals is faster [set on the diagnoses of exams 114 to 118 and of other worlds: 4.8 at most; told
by `benchmarks.gap_signs`]."""
SLOW_HZ: Final = 1.0
BESIDES: Final = 1.3
"""Floors, all bands together, that such a signal stands besides where the band does so in one region only:
where noise is low, friction that differs as a healthy rig's may towers above it in a few reversals."""
UNTOLD: Final = 0.1
"""Chance of something unknown up to which what acts now and then, not beyond doubt, is a gap though unseen
data have none of it [set on the used-up exam of seed 114: those that were there had 0.04 at most, one that
was not had 0.2]."""
WHOLE: Final = 0.9
"""Share of a small gap from which on what is nearly certain is none by chance, though unseen data hardly show
it: of 35 healthy axes and motorcycles of two worlds of others the best candidates have 8 nats and less."""
LOSSY: Final = 0.01
"""Share of the drives' answers from which on a bus that loses them is a finding whatever else there is: it
loses setpoints as well, of which not each loss shows."""
BESIDE: Final = 0.25
"""Chance then that what else there is is all there is."""
HARDLY: Final = 0.05
"""Share below which a sentence says that unseen data show little of what was found, or that what was not
found looks like no candidate."""
FRAME_HZ: Final = 30.0
"""Down to which a load that swings on a spring, and moves no signal by RATIO floors, may be the frame or the
floor that the rig stands on: two tonnes on mounts swing at 32 to 55 Hz [R]."""
FRAME: Final = "No gap but what swings as a rig's own frame does (above 30 Hz, within 1.5 floors)."
USUAL: Final = (
    "No gap but clocks, screws and loops that are off as any are (30 ppm, 8 µm, 60 Hz, 3 %)."
)
WANDERS: Final = 0.12
"""Of an actuator's own Coulomb friction, by which its slow force differs on any healthy rig: friction goes
with place and warmth [R; 0.10 on a healthy Stewart platform of others, 0.15 and more of what was a gap]."""
VISIBLE: Final = 0.3
"""Floors that a candidate of a usual size must show on some signal to be judged at all."""


def no_gap(located: Located, held_out: str) -> Diagnosis:
    """Nothing to explain."""
    sentence = located.sentence
    if located.is_gap and located.where:
        sentence = f"No gap that stands beyond doubt. Nearest to one: {sentence}"
    return Diagnosis(
        located, "no_gap", sentence, (), (), 0.0, None, None, held_out, (), None, None, None
    )


def whereabouts(located: Located) -> str:
    """Where a gap stands, a sentence to follow another; nothing where it stands nowhere in particular."""
    return f" {located.sentence}" if located.is_gap and located.where else ""


def _nothing_like_it(located: Located, held_out: str) -> Diagnosis:
    """A gap of which no candidate has the pattern."""
    worst, place = max(located.signals, key=lambda s: s.ratio), _loudest(located)
    ratio, where = worst.ratio, worst.signal
    if place is not None and ratio < RATIO:
        ratio, where = place.rms / place.noise_floor, f"{place.text},"
    sentence = (
        f"A gap that nothing in the catalogue explains: {where} stands {ratio:.1f} times above its floor, "
        f"and no candidate has its pattern.{whereabouts(located)}"
    )
    return replace(no_gap(located, held_out), verdict="unknown", sentence=sentence, unknown=1.0)


def _small(located: Located, held_out: str) -> Diagnosis:
    """Nothing to explain, or a rare event that nothing in the catalogue makes."""
    signal, times = jumps(located)
    if signal is None or times <= 1.0:
        return no_gap(located, held_out)
    sentence = (
        f"A gap that nothing in the catalogue explains: for moments, or in one frequency, {signal} stands "
        "further from the twin than noise or a late frame ever puts it."
    )
    return replace(no_gap(located, held_out), verdict="unknown", sentence=sentence, unknown=1.0)


def answer(
    located: Located,
    c: Calibrated,
    fits: Sequence[Fit],
    bank: Bank,
    held: NDArray[np.bool_],
    held_out: str,
    seed: int,
    is_large: bool,
) -> Diagnosis:
    """The diagnosis of `fits`, the first of them the twin without effects; `held` (N,): unseen samples.

    `is_large`: whether the gap stands by itself, whatever explains it (`stands`).
    """
    none = fits[0]
    weighed, worth = weigh(c, fits)
    zero = next(w.log_evidence for w in weighed if not w.fit.leaves)
    shown = Shown(located, none, held, np.random.default_rng(seed + 2))

    def unseen(f: Fit) -> Score:
        return shown.score(f, signals(c, none, f))

    weighed = clear(c, none, [w for w in weighed if w.fit.leaves], zero, is_large, unseen)
    weighed = without_doubtful(c, weighed, worth, is_large)
    if not weighed:
        found = _nothing_like_it(located, held_out) if is_large else _small(located, held_out)
        return replace(found, not_excited=not_excited(c, bank))
    first, gain = weighed[0].fit, weighed[0].log_evidence - zero
    share = explained_share(c, none, first, gain)
    usual = usual_of(first, c.problem.rig)
    is_frame = not usual and _is_frame(c, none, first)
    if is_frame or len(usual) == len(first.leaves):
        if is_large and by_share(share, gain) > 0.5:
            return replace(_nothing_like_it(located, held_out), not_excited=not_excited(c, bank))
        found = replace(no_gap(located, held_out), sentence=FRAME if is_frame else USUAL)
        return replace(found, not_excited=not_excited(c, bank))
    part = unseen(first)
    whole = shown.score(first, c.problem.signals)
    unknown, varies = doubt(c, none, first, Told(share, gain, part), bank, worth)
    lossy = _lossy(weighed) if unknown > 0.5 and other_than_facts(first) else None
    if lossy is not None:
        weighed, first, usual = [replace(lossy, probability=1.0)], lossy.fit, []
        gain, part, varies = lossy.log_evidence - zero, unseen(first), None
        whole, unknown = shown.score(first, c.problem.signals), BESIDE
    if unknown > 0.5 and by_share(share, gain) > 0.5 and not is_large:
        return replace(_small(located, held_out), not_excited=not_excited(c, bank))
    is_plain = all(leaf.effect in (LOST, ROUNDED) for leaf in first.leaves)
    is_seen = varies is not None and part.before > RATIO
    is_told = is_large or is_seen or is_plain or _is_once(c, first, gain)
    is_told = is_told or _is_the_blow(located, first, unknown)
    is_beyond_chance = gain > asked(c).nearly and share > WHOLE
    is_chance = _is_unseen(first, part, unknown) or (
        _is_faint(part) and not is_hidden(c, none, first) and not is_beyond_chance
    )
    if is_chance and not is_told:
        return replace(_small(located, held_out), not_excited=not_excited(c, bank))
    healthy = {leaf.name for leaf in usual}
    causes = tuple(
        x for x in weighed_causes(c, none, weighed, worth, unknown, zero, shown)
        if f"{x.location}.{x.effect}" not in healthy
    )  # fmt: skip
    chosen = tuple(
        next(x for x in causes if (x.effect, x.location) == (leaf.effect, leaf.location))
        for leaf in first.leaves
        if leaf not in usual
    )
    shrink = part.shrink if other_than_facts(first) else None
    verdict, sentence = judge(
        chosen, causes, unknown, shrink, share=share, where=whereabouts(located), varies=varies
    )
    lost = dict(zip(first.names, first.values.tolist(), strict=True)).get(ANSWERS, 0.0)
    if lossy is not None:
        sentence += " Besides there is what nothing in the catalogue explains."
    if lost:
        sentence += f" Of the drives' answers {100.0 * lost:.2g} % never came."
    if usual and verdict != "unknown":
        sentence += f" Beside that {_names(usual)}, no larger than any healthy rig's."
    return Diagnosis(
        located, verdict, sentence, causes, chosen if verdict != "unknown" else (), unknown,
        part, whole, held_out, not_excited(c, bank, first), first, none, c,
    )  # fmt: skip


def or_several(
    found: Diagnosis, fits: Sequence[Fit], answered: Callable[[Sequence[Fit]], Diagnosis]
) -> Diagnosis:
    """`found`, or what is `answered` of those of `fits` with more effects, where `found` is unknown.

    Something unknown beside an effect is no more likely than another effect: where what is best leaves too
    much, further effects need not earn what several cost.
    """
    if found.verdict != "unknown" or found.best is None or not found.causes:
        return found
    larger = [f for f in fits if len(f.leaves) > len(found.best.leaves)]
    several = answered(larger) if larger else found
    is_better = several.effects and several.effects[0].gain + MORE > found.causes[0].gain
    return several if is_better else found


def stands(located: Located, c: Calibrated, none: Fit) -> bool:
    """Whether a signal is a gap by itself, before anything is known of what makes it."""
    surely = max(map(_surely, located.signals)) > RATIO
    return surely or largest_ratio(c, none) > LARGE or _loudest(located) is not None


def _wanders(rig: RigFile) -> dict[str, float]:
    """By signal, in its unit, what friction as a healthy rig's adds to a slow force."""
    out = {}
    for a in rig.actuators:
        out[f"{a.name}.force"] = WANDERS * a.coulomb
        out[f"{a.name}.current"] = WANDERS * a.coulomb / (a.force_per_ampere or math.inf)
    return out


def _loudest(located: Located) -> Place | None:
    """Of the bands of drives' signals that are gap alone, by BANDS, the one that stands highest."""
    whole = {s.signal: s.ratio for s in located.signals}
    wanders = _wanders(located.evidence.problem.rig)
    loud = {
        p: p.rms / p.noise_floor
        for p in located.where
        if p.band_hz[1] <= SLOW_HZ
        and (p.region == "everywhere" or whole[p.signal] > BESIDES)
        and p.rms > BANDS.get(p.signal.rpartition(".")[2], math.inf) * p.noise_floor
        and p.rms > wanders.get(p.signal, 0.0)
    }
    return max(loud, key=lambda p: loud[p], default=None)


def usual_of(f: Fit, rig: RigFile) -> list[Leaf]:
    """Effects of a fit that are no more than what any rig has: two clocks differ, a screw wobbles and gives
    a little, a drive has filters."""
    values: dict[str, float] = dict(zip(f.names, f.values.tolist(), strict=True))

    def is_usual(leaf: Leaf) -> bool:
        mine = {n.rpartition(".")[2]: v for n, v in values.items() if n in leaf.parameters}
        if leaf.effect == "clock_drift":
            return abs(mine["rate"]) < CRYSTALS
        if leaf.effect == "loop_gain":
            return all((1.0 - OTHER_LAW) * abs(v - 1.0) < LOOPS[k] for k, v in mine.items())
        if leaf.effect == "compliance":
            own = next(a for a in rig.actuators if a.name == leaf.location)
            return mine["stiffness"] > stiffness_at(own, SOFTEST_HZ)
        is_wave = leaf.effect == "lead_error" and "scale" not in mine
        return is_wave and (1.0 - OTHER_LAW) * abs(mine.get("amplitude", math.inf)) < WOBBLE_M

    return [leaf for leaf in f.leaves if is_usual(leaf)]


def _is_frame(c: Calibrated, none: Fit, f: Fit) -> bool:
    """Whether a fit is a spring alone that is no softer and shows no more than a rig's own frame."""
    if [leaf.effect for leaf in f.leaves] != ["compliance"]:
        return False
    (leaf,) = f.leaves
    own = next(a for a in c.problem.rig.actuators if a.name == leaf.location)
    stiffness = dict(zip(f.names, f.values.tolist(), strict=True))[f"{leaf.name}.stiffness"]
    is_stiff = stiffness > stiffness_at(own, FRAME_HZ)
    return is_stiff and max(traces(c, none, f).values()) <= RATIO


def _lossy(weighed: Sequence[Weighed]) -> Weighed | None:
    """The best of `weighed` that has nothing but facts, answers that never came in LOSSY shares among
    them."""
    for w in weighed:
        share = dict(zip(w.fit.names, w.fit.values.tolist(), strict=True)).get(ANSWERS, 0.0)
        if share > LOSSY and not other_than_facts(w.fit):
            return w
    return None


def _is_once(c: Calibrated, f: Fit, gain: float) -> bool:
    """Whether what a fit of `gain` nats says acts now and then, beyond doubt: unseen data may lack it."""
    return gain > asked(c).certain and all(leaf.effect in EVENTS for leaf in f.leaves)


def _is_the_blow(located: Located, f: Fit, unknown: float) -> bool:
    """Whether what stands for moments further off than noise ever puts it, and so is a gap in any case, is
    explained by what acts in moments."""
    acts = all(leaf.effect in MOMENTS for leaf in f.leaves)
    return acts and unknown <= UNTOLD and jumps(located)[1] > 1.0


def _is_faint(unseen: Score) -> bool:
    """Whether unseen data hardly show a gap, and do not bear out what explains the seen one: less than a
    verdict needs goes there, and that might be chance."""
    if unseen.shrink is None or unseen.before > STANDS * unseen.floor:
        return False
    is_sure = unseen.shrink_ci is not None and unseen.shrink_ci[0] > 0.0
    return unseen.shrink < HOLDS and not is_sure


def _is_unseen(f: Fit, unseen: Score, unknown: float) -> bool:
    """Whether a fit is of what acts now and then, no unseen data show it, and it leaves too much of the seen
    gap."""
    is_moment = all(leaf.effect in EVENTS for leaf in f.leaves)
    return is_moment and unseen.shrink is None and unknown > UNTOLD


def _surely(s: SignalGap) -> float:
    """Floors above which a signal stands for sure: one kick by a frame that came late is no gap."""
    return s.before_ci[0] / s.noise_floor if s.noise_floor > 0.0 else 0.0


def _names(some: Sequence[Leaf | Cause]) -> str:
    return " and ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in some)


def judge(
    chosen: Sequence[Cause],
    causes: Sequence[Cause],
    unknown: float,
    shrink: float | None,
    *,
    share: float,
    where: str,
    varies: Variation | None = None,
) -> tuple[Verdict, str]:
    """Verdict and sentence for the best set `chosen` among all `causes`. Where that is none: the `share` of
    the gap that it explains, `where` the gap stands, and what it takes that `varies`."""
    names = _names(chosen)
    if unknown > 0.5:
        nearest = f"; the nearest is {names}, which explains {100.0 * share:.0f} % of what fits saw of it."
        if varies is not None:
            nearest = (
                f"; the nearest is {names}, but what it takes is not the same everywhere: it goes with "
                f"{varies.goes_with}."
            )
        elif share < HARDLY:
            nearest = ", and no candidate has its pattern."
        return "unknown", f"A gap that nothing in the catalogue explains{nearest}{where}"
    return attributed(chosen, causes, unknown, shrink)


def attributed(
    chosen: Sequence[Cause], causes: Sequence[Cause], unknown: float, shrink: float | None
) -> tuple[Verdict, str]:
    """The same for a set that is the answer."""
    names = _names(chosen)
    far = (
        "" if shrink is None else f" It takes {100.0 * shrink:.0f} % of the gap off held-out data."
    )
    if shrink is not None and 0.0 <= shrink < HARDLY:
        far = f" Held-out data show little of it ({100.0 * shrink:.0f} % of their gap goes)."
    if shrink is not None and shrink < 0.0:
        far = " Held-out data stand further from the twin with it than without."
    if min(x.probability for x in chosen) / (1.0 - unknown) >= SURE:
        return "identified", f"The gap comes from {names}.{far}"
    others = [x for x in causes if x not in chosen and x.probability > 0.05]
    rest = ", ".join(f"{x.effect.replace('_', ' ')} at {x.location}" for x in others[:3])
    if not others:
        least = min(chosen, key=lambda x: x.probability)
        rest = f"that {least.effect.replace('_', ' ')} is not there"
    return "ambiguous", (
        f"The gap comes most likely from {names}; these data cannot rule out {rest}.{far}"
    )


def not_excited(c: Calibrated, bank: Bank, named: Fit | None = None) -> tuple[str, ...]:
    """Candidates that at a usual size would change no signal visibly on these data; none of those `named`,
    which have another size."""
    own = set() if named is None else {leaf.name for leaf in named.leaves}
    weight = 1.0 / c.noise.sigma**2 * c.problem.kept
    size = np.zeros(bank.columns.shape[1])
    for signal in c.problem.signals:
        parts = [x.part for x in c.problem.series if x.signal == signal]
        total = sum(weight[p] @ bank.columns[p].astype(float) ** 2 for p in parts)
        share = np.sqrt(total / max(sum(float(weight[p].sum()) for p in parts), 1e-300))
        size = np.maximum(size, share / max(c.floors[signal], 1e-300))
    return tuple(
        leaf.name
        for leaf, starts in zip(bank.leaves, bank.places, strict=True)
        if leaf.name not in own
        and max((size[k] for start in starts for k in start), default=0.0) < VISIBLE
    )
