"""What is wrong with this PC, its bus and its drives for a rig, and how to mend it.

Each part looks at one thing and returns findings; nothing here changes the PC, and the bus is only
listened to unless told otherwise.
"""

from hil.daemon.check.finding import Finding, Probe
from hil.daemon.check.rig import check_contradictions, check_rig

__all__ = ["Finding", "Probe", "check_contradictions", "check_rig"]
