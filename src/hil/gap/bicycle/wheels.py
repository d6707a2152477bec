"""What healthy wheels do that the model's do not: two sorts of them, each with means and spreads.

The model's wheels are thin discs that roll where they point. Bicycles stand on tyres, which creep, turn them
late and roll on their flanks: a floor that allows for that hides a wheel that is 2 % off. Hard thin wheels do
next to nothing of it, and what one is allowed there is less. A record tells which (`hil.gap.bicycle.rolled`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Wheels:
    """One sort of healthy wheels: (mean, standard deviation) of each thing they do."""

    turns_by: tuple[float, float]
    """Share of the steer by which they turn a bicycle more than it says."""
    turns_late_s: tuple[float, float]
    """By how much a bicycle turns later than it is steered."""
    creeps: tuple[float, float]
    """s²/m: share of its way that the rear wheel turns further for each m/s² that it drives with."""
    round_m: tuple[float, float]
    """Radius of a tyre's section, on whose flank a leaning bicycle rolls."""
    aside: tuple[float, float]
    """rad for each m/s² across by which both wheels slip outwards."""
    slips: float
    """rad for each m/s² across, give or take: what is steered is not where the wheels roll."""


TYRES: Final = Wheels(
    turns_by=(0.012, 0.01),
    turns_late_s=(0.006, 0.004),
    creeps=(0.006, 0.0025),
    round_m=(0.012, 0.008),
    aside=(1e-3, 1e-3),
    slips=8e-4,
)
"""Round sections turn a bicycle more, the side force of a wheel that is cambered as it is steered by a
fiftieth alone; a tyre takes its side force up within some decimetres, and none lets a bicycle turn earlier;
the rear one bears three fifths of the weight, and slips by a thirtieth to a fifteenth under as much force as
it bears; sections are 25 to 50 mm wide, and a file's heights may be off as well; what the camber of a leaning
tyre does not bear across it slips for; fork and frame give way besides [R; 54 healthy rides of four worlds of
others, all on tyres that slip, turn by 0 to 3 % more and by none less, by 1 to 11 ms later; those of three
worlds that pull away and brake creep by 0.0044 to 0.009 s²/m; 19 of three worlds go aside by 0.0002 to 0.001
rad s²/m, four of another one by 0.003]."""
THIN: Final = Wheels(
    turns_by=(0.0, 0.004),
    turns_late_s=(0.0, 0.0015),
    creeps=(0.0, 4e-4),
    round_m=(0.0, 0.002),
    aside=(0.0, 2e-4),
    slips=2e-4,
)
"""Hard narrow tubulars and simulations: what is left is how well a bicycle is measured [R]."""
