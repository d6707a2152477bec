"""The gap between a bicycle and its model: the same questions, asked of a ride.

`locate_rides` and `diagnose_rides` answer as `hil.gap.locate` and `hil.gap.diagnose` do for driven rigs;
`locate_any` and `diagnose_any` take either sort of rig.
"""

from hil.gap.bicycle.diagnose import diagnose_rides
from hil.gap.bicycle.either import diagnose_any, locate_any
from hil.gap.bicycle.locate import locate_rides
from hil.gap.bicycle.problem import RideProblem

__all__ = ["RideProblem", "diagnose_any", "diagnose_rides", "locate_any", "locate_rides"]
