"""Exam cases that are ridden: a bicycle that is not the twin's, its own springs, rider, sensors and noise.

`make_ride` makes a case, RIDE_EFFECTS and RIDE_OUTSIDE are what cases may hold.
"""

from hil.exam.rides.make import make_ride
from hil.exam.rides.menu import RIDE_EFFECTS
from hil.exam.rides.outside import RIDE_OUTSIDE

__all__ = ["RIDE_EFFECTS", "RIDE_OUTSIDE", "make_ride"]
