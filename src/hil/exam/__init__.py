"""The blind check: cases from a world that is not the twin, sat by a diagnosis that cannot know, marked.

`make_exam` draws and seals cases, `sit_exam` diagnoses them (or has a baseline do it), `mark_exam` marks.
"""

from hil.exam.case import Case, load_case, seal
from hil.exam.make import make_exam
from hil.exam.mark import Marked, mark_exam
from hil.exam.order import Order
from hil.exam.sit import Sitting, sit_exam

__all__ = [
    "Case", "Marked", "Order", "Sitting", "load_case", "make_exam", "mark_exam", "seal", "sit_exam",
]  # fmt: skip
