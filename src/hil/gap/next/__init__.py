"""The experiment that best splits the candidates that a diagnosis leaves, within a rig's limits.

`propose` draws motions, lets the twin with each candidate ride them and takes the one after which fewest look
alike; `next_experiment` says it as a table of the answer file, `write_proposal` makes it playable.
"""

from hil.gap.next.candidates import Candidate, read_candidates
from hil.gap.next.propose import Proposal, next_experiment, propose
from hil.gap.next.score import Split, split_of
from hil.gap.next.sketches import Sketch, draw_sketches, generic_multisine
from hil.gap.next.write import motion_beside, write_proposal

__all__ = [
    "Candidate",
    "Proposal",
    "Sketch",
    "Split",
    "draw_sketches",
    "generic_multisine",
    "motion_beside",
    "next_experiment",
    "propose",
    "read_candidates",
    "split_of",
    "write_proposal",
]
