""" "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", figures 2 and 4 to 8."""

from __future__ import annotations

from pathlib import Path

from hil.config import RigFile
from hil.ui.reproduce import stewart_motions as motions
from hil.ui.reproduce import stewart_rig
from hil.ui.reproduce.bench import Profiles, Progress, play_all
from hil.ui.reproduce.report import Lengths, Report, write_report
from hil.ui.reproduce.stewart_diagram import diagram_section
from hil.ui.reproduce.stewart_filter import filter_section
from hil.ui.reproduce.stewart_fit import table_section, two_stage
from hil.ui.reproduce.stewart_prose import OPENING, PAPER


def stewart_report(
    rig: RigFile,
    profiles: Profiles,
    out_html: Path,
    runs: Path,
    lengths: Lengths,
    on_progress: Progress = lambda text: None,
) -> Report:
    """Play the experiments on `rig` (of the law "pd"), keep recordings under `runs`, write the page.

    CommandRefused, IdentificationError or RunError where one of them fails.
    """
    own = stewart_rig.lengths_rig(rig)
    jobs = stewart_rig.jobs(own, lengths)
    played = play_all(jobs, profiles, runs, on_progress)
    on_progress("analysing: describing function")
    describing = filter_section(played, lengths)
    on_progress("fitting in two stages")
    stages = two_stage(played, lengths)
    on_progress("fitting with forces")
    table = table_section(played, stages)
    on_progress("replaying")
    sections = [
        describing,
        diagram_section(own),
        motions.circle_section(played, stages),
        motions.circle_pose_section(played, stages),
        motions.yaw_section(played, stages),
        table,
        motions.heave_section(played, stages),
    ]
    total_s = sum(p.run.duration_s for p in played.values())
    subtitle = f"{PAPER} · {len(jobs)} experiments, {total_s:.0f} s on the simulated rig"
    leg = rig.actuators[0]
    opening = OPENING.format(
        rotor=leg.reflected_mass,
        coulomb=stewart_rig.COULOMB_N,
        hysteresis=stewart_rig.HYSTERESIS["force"],
        file=leg.coulomb,
        k_p=1e-3 * leg.position_gain,
        buried=1e6 * leg.coulomb / leg.position_gain,
    )
    return write_report(out_html, "The MPI Stewart platform again", subtitle, opening, sections)
