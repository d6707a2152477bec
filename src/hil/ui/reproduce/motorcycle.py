""" "Parameters Identification for Motorcycle Simulator's Platform Characterization", figures 3 and 5 to 8."""

from __future__ import annotations

from pathlib import Path

from hil.config import RigFile
from hil.ui.reproduce import adapting, following, motorcyclebus, torque
from hil.ui.reproduce.bench import Profiles, Progress, play_all
from hil.ui.reproduce.motorcycle_prose import OPENING, PAPER
from hil.ui.reproduce.report import Lengths, Report, write_report


def motorcycle_report(
    rig: RigFile,
    profiles: Profiles,
    out_html: Path,
    runs: Path,
    lengths: Lengths,
    on_progress: Progress = lambda text: None,
) -> Report:
    """Play the experiments on `rig`, keep recordings under `runs`, write the page to `out_html`.

    CommandRefused, IdentificationError or RunError where one of them fails.
    """
    jobs = [*following.jobs(rig, lengths), *adapting.jobs(rig, lengths)]
    played = play_all(jobs, profiles, runs, on_progress)
    on_progress("analysing: bus, step, chirp, torque")
    sections = [
        motorcyclebus.bus_section(played["chirp_servo"], profiles),
        following.step_section(played),
        following.chirp_section(played),
        torque.torque_section(played),
    ]
    on_progress("identifying")
    sections.append(adapting.adapting_section(played))
    total_s = sum(p.run.duration_s for p in played.values())
    subtitle = f"{PAPER} · {len(jobs)} experiments, {total_s:.0f} s on the simulated rig"
    return write_report(out_html, "The motorcycle platform again", subtitle, OPENING, sections)
