"""A simulation of rigs that is not the twin: other laws, steps, ticks and modes, for exam cases.

`World` is one rig as it really is (scatter, effects); `play` records a motion on it.
"""

from hil.exam.world.body import Scatter, World
from hil.exam.world.outside import OUTSIDE
from hil.exam.world.play import Played, play

__all__ = ["OUTSIDE", "Played", "Scatter", "World", "play"]
