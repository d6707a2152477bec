"""What is wrong with a recorded ride is found and named: channels, signs, units, ranges, clocks."""

import re

import numpy as np
import pandas as pd
import pytest

from hil.bicycle.analysis import analyse
from hil.bicycle.checks import check_ride
from hil.cli.bicycle import show
from hil.errors import RunError
from hil.ui.bicycle import ride_page
from tests.bicycle.rides import ride_of


def faults(ride, spoil):
    with pytest.raises(RunError) as caught:
        analyse(ride_of(ride, spoil))
    return str(caught.value)


def changed(**factors):
    def spoil(table):
        for name, factor in factors.items():
            table[name] = table[name] * factor
        return table

    return spoil


def test_a_good_ride_has_no_findings(round_trip, weaving):
    for ride in (round_trip, weaving):
        prepared = ride_of(ride)
        assert prepared.findings == ()
        assert check_ride(prepared) == []


@pytest.mark.parametrize("missing", ["lean", "rear_wheel", "steer"])
def test_a_missing_channel_is_named(round_trip, missing):
    text = faults(round_trip, lambda t: t.drop(columns=missing))
    assert f"no {missing}" in text


def test_swapped_channels(weaving, round_trip):
    for ride in (round_trip, weaving):
        text = faults(ride, lambda t: t.rename(columns={"lean": "steer", "steer": "lean"}))
        assert "the two channels are swapped" in text


@pytest.mark.parametrize(("signal", "side"), [("lean", "RIGHT"), ("steer", "LEFT")])
def test_a_wrong_sign_is_named_with_the_right_one(round_trip, signal, side):
    text = faults(round_trip, changed(**{signal: -1.0}))
    assert text.startswith(f"ride: {signal}: ")
    assert f"to the {side}" in text


def test_without_a_gyroscope_the_two_signs_contradict_each_other(round_trip):
    def spoil(table):
        table["steer"] = -table["steer"]
        return table.drop(columns=[c for c in table.columns if c.startswith("imu.")])

    assert "leans out of its turns" in faults(round_trip, spoil)


def test_an_imu_mounted_backward_is_told_from_two_wrong_signs(round_trip):
    text = faults(round_trip, changed(**{"imu.gyro_x": -1.0, "imu.gyro_z": -1.0}))
    assert "set imu.orientation" in text


@pytest.mark.parametrize("signal", ["lean", "steer"])
def test_degrees_are_not_radians(round_trip, signal):
    assert "are these degrees?" in faults(round_trip, changed(**{signal: 180.0 / np.pi}))


def test_a_wheel_that_counts_backward(round_trip):
    assert "counts forward as negative" in faults(round_trip, changed(rear_wheel=-1.0))


@pytest.mark.parametrize("counts", [2**8, 2**10, 2400, 2**16])
def test_a_counter_that_runs_over_is_put_together_again(round_trip, counts):
    whole = ride_of(round_trip)
    size = counts * 2.0 * np.pi / round_trip.rig.sensors.steps_per_turn

    def spoil(table):
        table["rear_wheel"] = np.mod(table["rear_wheel"] + 1.0, size)
        return table

    mended = ride_of(round_trip, spoil)
    assert [f.check for f in mended.findings] == ["rollover"]
    rolled = round_trip.table["rear_wheel"].dropna().to_numpy()
    times = int((rolled[-1] + 1.0) / size) - int((rolled[0] + 1.0) / size)
    assert f"ran over {times} times" in mended.findings[0].text
    assert np.abs(mended.angles[:, 1] - whole.angles[:, 1]).max() < 1e-9


def test_an_encoder_that_starts_anew_each_turn_is_put_together_at_speed(round_trip):
    def faster(table):
        table["rear_wheel"] = 2.0 * table["rear_wheel"]
        return table

    def anew(table):
        return faster(table).assign(rear_wheel=lambda x: np.mod(x["rear_wheel"], 2.0 * np.pi))

    whole, mended = ride_of(round_trip, faster), ride_of(round_trip, anew)
    assert np.abs(mended.angles[:, 1] - whole.angles[:, 1]).max() < 1e-9


def test_a_wheel_that_is_pushed_back_a_little_is_no_counter(round_trip):
    whole = ride_of(round_trip)

    def spoil(table):
        angle, t = table["rear_wheel"], table["t"]
        for at, back in ((10.0, 0.3), (20.0, 0.5)):
            table["rear_wheel"] = angle = angle.where(t < at, angle - back)
        return table

    pushed = ride_of(round_trip, spoil)
    assert not any(f.check == "rollover" for f in pushed.findings)
    assert whole.angles[-1, 1] - pushed.angles[-1, 1] == pytest.approx(0.8, abs=1e-6)


def test_saturation_is_told_with_its_time(round_trip):
    def spoil(table):
        table["lean"] = np.clip(table["lean"] * 1.8, -0.3490658503988659, 0.3490658503988659)
        return table

    found = ride_of(round_trip, spoil).findings
    assert [f.check for f in found] == ["saturation"]
    assert "20.0 degrees" in found[0].text


def test_an_inclinometer_that_ends_before_its_range_is_told(round_trip):
    def spoil(table):
        table["lean"] = table["lean"].clip(-0.12, 0.12)
        return table

    found = [f for f in check_ride(ride_of(round_trip, spoil)) if f.check == "saturation"]
    assert {f.subject for f in found} == {"lean"}
    assert any("stand at 0.12" in f.text or "stand at -0.12" in f.text for f in found)


def test_a_gap_is_told_with_its_length(round_trip):
    def spoil(table):
        hole = (table["t"] > 12.0) & (table["t"] < 12.4)
        table.loc[hole, "steer"] = np.nan
        return table

    found = ride_of(round_trip, spoil).findings
    assert [f.check for f in found] == ["gaps"]
    assert found[0].subject == "steer"
    assert "longest 4" in found[0].text


def test_an_imu_on_another_clock(round_trip):
    def shifted(ms=0.0, rate=0.0):
        def spoil(table):
            imu = [c for c in table.columns if c.startswith("imu.")]
            t = table["t"].to_numpy()
            for c in imu:
                there = table[c].notna().to_numpy()
                late = np.interp(t, t[there] * (1.0 + rate) + 1e-3 * ms, table[c][there])
                table[c] = np.where(there, late, np.nan)
            return table

        return spoil

    late = check_ride(ride_of(round_trip, shifted(ms=80.0)))
    assert [f.check for f in late] == ["clocks"]
    assert "+80 ms" in late[0].text or "+79 ms" in late[0].text
    drifting = check_ride(ride_of(round_trip, shifted(rate=5e-3)))
    assert [f.check for f in drifting] == ["clocks"]
    assert "ms a second" in drifting[0].text


def test_a_ride_too_short_says_so(round_trip):
    assert "overlap for" in faults(round_trip, lambda t: t[t["t"] < 1.5].reset_index(drop=True))


def exchanged(a, b):
    return lambda t: t.rename(columns={a: b, b: a})


@pytest.mark.parametrize("other", ["lean", "steer"])
def test_a_wheel_that_stands_in_another_channel_is_named(weaving, other):
    text = faults(weaving, exchanged(other, "rear_wheel"))
    assert f"column {other}" in text
    assert "another channel, such as a wheel's angle" in text


def test_a_wheel_in_degrees(weaving):
    text = faults(weaving, changed(rear_wheel=180.0 / np.pi))
    assert text.startswith("ride: rear_wheel: ")
    assert "are these degrees, or counts?" in text


@pytest.mark.parametrize("has_imu", [True, False])
def test_a_wheels_way_in_metres_is_no_angle(weaving, round_trip, has_imu):
    def spoil(table):
        imu = [c for c in table.columns if c.startswith("imu.")]
        table["rear_wheel"] *= weaving.rig.geometry.R
        return table if has_imu else table.drop(columns=imu)

    for ride in (weaving, round_trip):
        text = faults(ride, spoil)
        assert text.startswith("ride: rear_wheel: looks like metres, not radians")
        assert "the radius is 0.3" in text


def test_a_gyroscope_in_degrees_a_second_and_an_accelerometer_in_g(weaving):
    gyro = {f"imu.gyro_{a}": 180.0 / np.pi for a in "xyz"}
    assert "are these degrees per second?" in faults(weaving, changed(**gyro))
    accel = {f"imu.accel_{a}": 1.0 / 9.81 for a in "xyz"}
    assert "feels 1.00 at rest" in faults(weaving, changed(**accel))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda t: t.assign(**{"imu.accel_z": t["imu.accel_z"] - 9.81}),
        changed(**{f"imu.accel_{x}": 1e3 / 9.81 for x in "xyz"}),
    ],
    ids=["gravity taken off", "thousandths of g"],
)
def test_an_accelerometer_that_does_not_feel_gravity(weaving, spoil):
    assert "or is gravity taken off?" in faults(weaving, spoil)


@pytest.mark.parametrize("factor", [0.0, 0.5 / np.pi], ids=["stuck", "turns for radians"])
def test_a_wheel_that_hardly_turns_is_told_and_no_number_stands_for_what_it_lacks(
    weaving, tmp_path, capsys, factor
):
    found = analyse(ride_of(weaving, changed(rear_wheel=factor)))
    assert [(f.check, f.subject) for f in found.findings] == [("rest", "rear_wheel")]
    assert "its angle is not in rad, or its encoder is stuck" in found.findings[0].text
    show(found)
    assert "nan" not in capsys.readouterr().out
    page = ride_page(found, tmp_path / "ride.html").read_text(encoding="utf-8")
    shown = re.sub("<script.*?</script>", "", page, flags=re.DOTALL)
    assert "rolls at no more than" in shown
    assert not re.search(r"\bnan\b", shown)


@pytest.mark.parametrize(
    ("a", "b"),
    [("gyro_x", "gyro_z"), ("gyro_y", "gyro_z"), ("accel_x", "accel_z"), ("accel_y", "accel_z")],
)
def test_axes_of_the_imu_that_are_exchanged(weaving, a, b):
    text = faults(weaving, exchanged(f"imu.{a}", f"imu.{b}"))
    assert f"imu.{a}" in text
    assert f"imu.{b}" in text
    assert "exchanged" in text


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        ("accel_z", "z axis points down"),
        ("accel_x", "axis points the other way"),
        ("gyro_x", "contradicts lean and steer, which agree"),
        ("gyro_y", "axis points the other way"),
        ("gyro_z", "contradicts lean and steer, which agree"),
    ],
)
def test_an_axis_of_the_imu_with_the_wrong_sign(round_trip, signal, said):
    text = faults(round_trip, changed(**{f"imu.{signal}": -1.0}))
    assert text.startswith(f"ride: imu.{signal}: ")
    assert said in text


def test_what_a_soft_bracket_turns_of_gravity_is_no_wrong_sign(round_trip):
    turned = ride_of(round_trip, changed(**{"imu.accel_x": -0.35}))
    assert not [f for f in check_ride(turned) if "imu.accel_x" in f.text]
    whole, other = analyse(ride_of(round_trip)).numbers(), analyse(turned).numbers()
    for what in ("lean", "steer", "steer_torque", "normal_front"):  # none needs that axis
        assert other[what] == whole[what]


@pytest.mark.parametrize("signal", ["lean", "steer"])
def test_a_sensor_that_is_stuck(weaving, signal):
    def spoil(table):
        there = table[signal].notna()
        table.loc[there, signal] = 0.01
        return table

    text = faults(weaving, spoil)
    assert f"{signal}: never changes while the gyroscope turns" in text


def test_an_axis_of_the_imu_that_is_stuck(round_trip):
    text = faults(round_trip, changed(**{"imu.gyro_y": 0.0}))
    assert "imu.gyro_y: never changes while the bicycle moves" in text


def test_forward_and_sideward_acceleration_exchanged(round_trip):
    text = faults(round_trip, exchanged("imu.accel_x", "imu.accel_y"))
    assert "imu.accel_x is found in imu.accel_y" in text


def test_an_imu_that_keeps_another_time_altogether(weaving):
    def spoil(table):
        imu = [c for c in table.columns if c.startswith("imu.")]
        theirs = table[["t", *imu]].dropna(how="all", subset=imu)
        ours = table.drop(columns=imu).dropna(how="all", subset=["lean", "rear_wheel", "steer"])
        return pd.concat([ours, theirs.assign(t=theirs["t"] + 1000.0)], ignore_index=True)

    assert "lean, wheel and steer from 0.0 to" in faults(weaving, spoil)


def test_stamps_in_milliseconds(weaving):
    assert "are these milliseconds?" in faults(weaving, changed(t=1000.0))


def test_an_imu_whose_range_is_too_small_is_told(weaving):
    def spoil(table):
        table["imu.gyro_z"] = table["imu.gyro_z"].clip(-0.2, 0.2)
        return table

    found = [f for f in check_ride(ride_of(weaving, spoil)) if f.check == "saturation"]
    assert {f.subject for f in found} == {"imu.gyro_z"}
    assert any("stand at 0.2" in f.text for f in found)


@pytest.mark.parametrize("signal", ["lean", "rear_wheel", "imu.gyro_z"])
def test_a_gap_in_any_channel_is_told(weaving, signal):
    def spoil(table):
        hole = (table["t"] > 6.0) & (table["t"] < 6.5)
        table.loc[hole, signal] = np.nan
        return table

    prepared = ride_of(weaving, spoil)
    found = [*prepared.findings, *check_ride(prepared)]
    assert [(f.check, f.subject) for f in found] == [("gaps", signal)]
    assert "5" in found[0].text


def test_a_16_bit_counter_that_runs_over(weaving):
    whole = ride_of(weaving)

    def spoil(table):
        steps = 2400.0 / (2.0 * np.pi)
        count = np.round(table["rear_wheel"] * steps) + 30000.0
        table["rear_wheel"] = (np.mod(count + 32768.0, 65536.0) - 32768.0) / steps
        return table

    mended = ride_of(weaving, spoil)
    assert [f.check for f in mended.findings] == ["rollover"]
    assert np.abs(mended.angles[:, 1] - whole.angles[:, 1]).max() < 0.2
