"""Rides of the simulated session: the daemon's own core, drivers and recorder, a rig with hidden effects."""

from __future__ import annotations

from pathlib import Path

from hil.config import Effect, RigFile
from hil.configfile import load_rig, parse_settings, rig_toml
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.simulated import record_ride
from hil.drivefiles import load_profiles
from hil.runs import Run, load_run

SECONDS = 10.0


def ridden(folder: Path, name: str, mode: str, *hidden: Effect) -> tuple[Run, RigFile]:
    """A ride of the shipped rig `name` in a control mode, recorded in `folder`."""
    tables = load_rig(name).model_dump()
    tables["control"]["mode"] = mode
    rig = parse_settings(tables, RigFile, name)
    ride = cues(DemoRide(rig).poses, 0.0, SECONDS, "ride")
    text = rig_toml(rig, name)
    made = record_ride(rig, text, load_profiles(rig), ride, folder, hidden=hidden)
    return load_run(made), rig
