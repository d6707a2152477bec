"""The blind check: cases from a world that is not the twin, sat by a diagnosis that cannot know, marked.

`make_exam` draws and seals cases.
"""

from hil.exam.case import Case, load_case, seal
from hil.exam.make import Order, make_exam

__all__ = ["Case", "Order", "load_case", "make_exam", "seal"]
