"""A rig that turns its load is shown in angles: rad and degrees, nowhere m and mm."""

from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from hil.configfile import load_rig
from hil.identify.frequency.acceleration import acceleration
from hil.identify.frequency.agard import excursions
from hil.identify.frequency.channels import channel
from hil.messages import ActuatorState, StateMessage
from hil.rigs import build_rig
from hil.runs import Run, RunMeta
from hil.ui.live import LiveView
from hil.ui.report_data import view
from hil.ui.workspace import range_rows, ranges_figure, survey
from tests.sim.rigs import changed, pendulum

RIG = pendulum()
T = np.arange(0.0, 4.0, 0.01)


@pytest.fixture
def run() -> Run:
    swing = 0.5 * np.sin(2.0 * T)
    columns = {"t": T, "cue.position": swing, "axis.setpoint": swing, "axis.position": swing}
    columns |= {f"imu.gyro_{a}": np.cos(2.0 * T) * (a == "y") for a in "xyz"}
    columns |= {f"imu.accel_{a}": T * (a == "z") for a in "xyz"}
    return Run(
        Path("run"), RunMeta(rig=RIG.name), RIG, pd.DataFrame(columns), pd.DataFrame({"t": []}), ()
    )


def test_the_workspace_is_in_degrees():
    found = survey(RIG, build_rig(RIG))
    ((name, low, high, _, limit, unit),) = range_rows(found)
    assert (name, low, high, limit, unit) == ("position", "-171.9", "171.9", "±85.9", "deg")
    assert ranges_figure(found).layout.xaxis.title.text == "deg"


def test_the_report_shows_the_pose_in_the_unit_of_its_actuator(run):
    shown = view(run)
    assert {q.unit for q in (*shown.coordinates, *shown.actuators)} == {"°"}
    assert np.ptp(shown.coordinates[0].measured.values) == pytest.approx(np.degrees(1.0), rel=1e-3)


def test_a_response_is_of_angles_and_its_acceleration_is_the_gyroscopes(run):
    assert channel(run, RIG, "position").unit == channel(run, RIG, "cue.position").unit == "rad"
    assert excursions(RIG)[0].unit == "rad"
    felt = acceleration(run, RIG, "position")
    assert (felt.order, felt.unit) == (1, "rad/s²")
    assert np.ptp(felt.channel.value) == pytest.approx(2.0, rel=1e-3), (
        "about the axis that it turns about"
    )


def test_an_axis_feels_its_acceleration_along_the_line_that_it_moves_on(run):
    rig = changed(RIG, geometry={"load": "vertical"})
    felt = acceleration(run, rig, "position")
    assert (felt.order, felt.unit) == (0, "m/s²")
    assert felt.channel.value == pytest.approx(run.table["imu.accel_z"].to_numpy())


@pytest.mark.parametrize(
    ("rig", "length", "force"), [(RIG, "rad", "N·m"), (load_rig("axis"), "m", "N")]
)
def test_the_live_view_says_in_which_units_it_counts(rig, length, force):
    shown = LiveView(rig)
    axis = {"axis": ActuatorState(0.1, 0.2, 3.0, 0.001)}
    shown.add_state(
        StateMessage(1.0, "engaged", {"position": 0.1}, {"position": 0.1}, axis, 2e-3, "")
    )
    assert f"position +0.100 {length}, error 2.00 m{length}," in shown.line()
    console = Console(width=120, record=True, file=StringIO())
    console.print(shown.render())
    text = console.export_text()
    for said in (
        f"position, {length} ",
        f"velocity, {length}/s",
        f"force, {force} ",
        f"2.00 m{length} ",
    ):
        assert said in text
