"""Runs as the reader gives them, made of simulated rides, whole or spoilt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from hil.bicycle.recorded import Ride, prepare
from hil.bicycle.simulated import SimulatedRide
from hil.runs import Run, RunMeta
from hil.runs.table import check_table


def run_of(ride: SimulatedRide, spoil: Callable[[pd.DataFrame], pd.DataFrame] | None = None) -> Run:
    """The ride as a run, its table changed by `spoil`."""
    table = ride.table.copy()
    if spoil is not None:
        table = spoil(table)
    table = check_table(table, "ride", ride.rig)
    return Run(
        Path("ride"), RunMeta(rig=ride.rig.name, mode="ride"), None, table, pd.DataFrame({"t": []}), (),
        None, ride.rig,
    )  # fmt: skip


def ride_of(
    ride: SimulatedRide, spoil: Callable[[pd.DataFrame], pd.DataFrame] | None = None
) -> Ride:
    """The ride prepared, its table changed by `spoil`."""
    return prepare(run_of(ride, spoil), ride.rig)
