"""Experiments: motions designed within a rig's limits, played, and recorded with their description.

`design(plan, rig)` makes one of a plan (`Step`, `Chirp`, `Sweep`, `Multisine`, `Circle`, `Heave`,
`Custom`); `play_simulated` and `play_on_rig` run it; `experiment_of` reads what a run was, `periods` cuts it.
"""

from hil.identify.experiments.description import (
    Description,
    Period,
    experiment_of,
    periods,
    read_experiment,
    write_experiment,
)
from hil.identify.experiments.design import Design, design
from hil.identify.experiments.plans import (
    PLANS,
    Chirp,
    Circle,
    Custom,
    Heave,
    Multisine,
    Plan,
    Step,
    Sweep,
)

__all__ = [
    "PLANS",
    "Chirp",
    "Circle",
    "Custom",
    "Description",
    "Design",
    "Heave",
    "Multisine",
    "Period",
    "Plan",
    "Step",
    "Sweep",
    "design",
    "experiment_of",
    "periods",
    "read_experiment",
    "write_experiment",
]
