"""A simulation of rigs that is not the twin: other laws, steps, ticks and modes, for exam cases.

`build_world` makes one rig as it really is (scatter, effects); `play` records a motion on it.
"""

from hil.exam.world.body import Outside, World
from hil.exam.world.build import build_world
from hil.exam.world.outside import OUTSIDE
from hil.exam.world.play import Played, play
from hil.exam.world.scatter import Scatter

__all__ = ["OUTSIDE", "Outside", "Played", "Scatter", "World", "build_world", "play"]
