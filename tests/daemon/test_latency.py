"""How late this PC is: figures that add up, bands by their limits, and a picture that stands alone."""

import asyncio
import json
import threading
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.bus.hub import Hub
from hil.cli.app import app
from hil.daemon.latency import Latency, bare_loop, measure_latency
from hil.errors import BusError
from hil.ui.latency_report import figures, latency_figure


@pytest.fixture(autouse=True)
def no_rights(monkeypatch):
    """Real-time rights would stay with the test process."""
    monkeypatch.setattr("hil.daemon.latency.request_rights", list)


def made(*late_us):
    return Latency(0.01, np.array(late_us, float), 0, (), 0.0, np.empty(0))


def test_each_wake_is_measured_and_none_is_early():
    measured = measure_latency(0.002, 0.3, None, 500_000)
    assert measured.late_us.size + measured.overruns == 150
    assert measured.late_us.min() >= 0.0
    assert not measured.round_trip_us.size


def test_a_last_wake_after_the_end_counts_no_cycle_that_nobody_asked_for():
    async def late():
        asyncio.get_running_loop().call_later(0.05, time.sleep, 0.15)
        return await bare_loop(0.002, 50)

    late_us, overruns = asyncio.run(late())
    assert late_us.size + overruns == 50
    assert late_us[-1] > 1e5


def test_bands_are_those_of_the_limits():
    assert made(5.0, 19.0, 21.0, 49.0, 51.0, 499.0, 501.0, 9000.0).shares() == (0.25,) * 4


def test_round_trips_on_a_hub_take_at_least_their_bits(tmp_path):
    path = tmp_path / "bus.sock"
    up, done = threading.Event(), threading.Event()

    async def serve():
        async with Hub(path, 500_000):
            up.set()
            await asyncio.to_thread(done.wait)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    try:
        assert up.wait(10.0)
        measured = measure_latency(0.005, 0.2, f"hub:{path}", 500_000)
    finally:
        done.set()
        thread.join()
    assert measured.round_trip_us.min() > 2 * 111 / 500_000 * 1e6  # two frames, without stuff bits


def test_a_bus_that_is_not_there_is_named_before_anything_is_measured(tmp_path, monkeypatch):
    monkeypatch.setattr("hil.daemon.latency.bare_loop", lambda *_: pytest.fail("for a day, say"))
    with pytest.raises(BusError, match="no hub answers"):
        measure_latency(0.005, 0.05, f"hub:{tmp_path / 'none.sock'}", 500_000)


def test_the_picture_holds_every_wake():
    measured = made(*np.geomspace(0.5, 90_000.0, 500))
    counted = sum(latency_figure(measured).data[0].y)
    assert counted == 500
    assert figures(measured.late_us)[2] == pytest.approx(90_000.0)


def test_the_command_writes_figures_and_page(tmp_path):
    page = tmp_path / "latency.html"
    result = CliRunner().invoke(
        app, ["latency", "--seconds", "0.3", "--cycle", "0.01", "--json", "--html", str(page)]
    )
    shown = json.loads(result.output)
    assert shown["lateness"]["count"] + shown["overruns"] >= 30
    assert sum(shown["shares"].values()) == pytest.approx(1.0)
    assert result.exit_code == (1 if shown["overruns"] else 0)
    assert "https://" not in page.read_text().split("<script", 1)[0]
    assert "wakes every 10 ms" in page.read_text().split("</script>", 1)[1], (
        "above the picture, as text"
    )
    assert "a whole cycle" in page.read_text()
