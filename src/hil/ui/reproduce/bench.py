"""Plays experiments on the simulated rig through the whole daemon, as many at a time as there are cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import Effect, RigFile
from hil.configfile import parse_settings, rig_toml
from hil.control.trajectory import CueTrajectory
from hil.drives.profile import LustProfile
from hil.identify.experiments import Description, Plan, design, experiment_of
from hil.identify.experiments.play import play_simulated
from hil.rigs import build_rig
from hil.runs import Run, load_run, read_cue_file
from hil.runs.folder import EXPERIMENT_CSV
from hil.workers import worker_pool

Array = NDArray[np.float64]
Profiles = Mapping[str, LustProfile]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Job:
    """One experiment to play; `effects` are the simulated rig's alone."""

    name: str
    plan: Plan
    rig: RigFile
    effects: tuple[Effect, ...] = ()
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Played:
    """An experiment that was played, with its recording."""

    job: Job
    run: Run
    description: Description
    trajectory: CueTrajectory

    @property
    def start_s(self) -> float:
        """Instant of the motion's first row, as the run's table has it."""
        assert self.description.played is not None
        return self.description.played.start_s

    def commanded(self, t_s: Array) -> Array:
        """Poses (N, n) that were asked for at instants of the run's table; outside the motion at rest."""
        t = self.trajectory.t_s
        return np.asarray(
            CubicSpline(t, self.trajectory.poses)(np.clip(t_s - self.start_s, t[0], t[-1]))
        )

    def samples(self, signal: str) -> tuple[Array, Array]:
        """(instants at which they held, values) of an actuator's signal during the motion, s of the table."""
        column = self.run.table[signal].to_numpy(dtype=float)
        there = ~np.isnan(column)
        t = self.run.table["t"].to_numpy(dtype=float)[there] - self.job.rig.bus.answer_delay
        inside = (t >= self.start_s) & (t <= self.start_s + self.trajectory.duration_s)
        return t[inside], column[there][inside]

    def lengths(self, actuator: str, t_s: Array) -> Array:
        """Commanded position (N,) of an actuator."""
        manipulator = build_rig(self.job.rig)
        k = self.job.rig.actuator_names.index(actuator)
        return np.array([manipulator.inverse(q)[k] for q in self.commanded(t_s)])


def variant(rig: RigFile, **tables: Mapping[str, Any]) -> RigFile:
    """`rig` with the given keys of the given tables changed, checked anew."""
    values = rig.model_dump()
    for name, changes in tables.items():
        values[name].update(changes)
    return parse_settings(values, RigFile, rig.name)


def play_all(
    jobs: Sequence[Job], profiles: Profiles, folder: Path, on_progress: Progress
) -> dict[str, Played]:
    """Play every job, recordings under `folder` by the job's name; what they became, by name.

    CommandRefused, LimitViolation or RunError where one cannot be played.
    """
    folders: dict[str, Path] = {}
    with worker_pool(min(len(jobs), os.cpu_count() or 1)) as pool:
        asked = {pool.submit(_play, job, dict(profiles), folder / job.name): job for job in jobs}
        for done in as_completed(asked):
            folders[asked[done].name] = done.result()
            on_progress(f"played {len(folders)} of {len(jobs)} ({asked[done].name})")
    return {job.name: _read(job, folders[job.name]) for job in jobs}


def _play(job: Job, profiles: Profiles, folder: Path) -> Path:
    made = design(job.plan, job.rig)
    return play_simulated(
        made,
        job.rig,
        rig_toml(job.rig),
        profiles,
        folder,
        seed=job.seed,
        effects=job.effects,
        note=job.name,
    )


def _read(job: Job, folder: Path) -> Played:
    description = experiment_of(folder)
    assert description is not None
    return Played(
        job,
        load_run(folder, job.rig),
        description,
        read_cue_file(folder / EXPERIMENT_CSV).trajectory,
    )
