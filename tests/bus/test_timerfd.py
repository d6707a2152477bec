from __future__ import annotations

import asyncio
import select
import time

import pytest

from hil.bus import Timer

from .harness import run


def _wait(timer: Timer, timeout_s: float = 2.0) -> bool:
    return bool(select.select([timer], [], [], timeout_s)[0])


def test_a_new_timer_is_at_rest() -> None:
    with Timer() as timer:
        assert not _wait(timer, 0.02)
        assert timer.expirations() == 0


def test_it_expires_once_at_its_instant() -> None:
    with Timer() as timer:
        due_s = time.monotonic() + 0.03
        timer.arm_at(due_s)
        assert _wait(timer)
        assert 0.0 <= time.monotonic() - due_s < 0.5
        assert timer.expirations() == 1
        assert not _wait(timer, 0.05)


def test_an_instant_in_the_past_expires_at_once() -> None:
    with Timer() as timer:
        for past_s in (time.monotonic() - 1.0, 0.0, -5.0):
            timer.arm_at(past_s)
            assert _wait(timer, 0.5)
            assert timer.expirations() == 1


def test_it_keeps_to_its_grid_and_counts_what_was_missed() -> None:
    with Timer() as timer:
        first_s, period_s = time.monotonic() + 0.01, 0.005
        timer.arm_every(first_s, period_s)
        time.sleep(0.1)
        count = timer.expirations()
        elapsed = (time.monotonic() - first_s) / period_s
        assert elapsed - 2 < count <= elapsed + 1
        for _ in range(5):
            assert _wait(timer)
            count += timer.expirations()
        assert time.monotonic() >= first_s + (count - 1) * period_s


def test_disarmed_it_expires_no_more() -> None:
    with Timer() as timer:
        timer.arm_every(time.monotonic() + 0.02, 0.02)
        timer.disarm()
        assert not _wait(timer, 0.06)


def test_a_period_must_be_positive() -> None:
    with Timer() as timer, pytest.raises(ValueError, match="positive"):
        timer.arm_every(time.monotonic(), 0.0)


def test_it_wakes_an_asyncio_loop_finer_than_its_own_timers() -> None:
    async def scene() -> list[float]:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        late_s: list[float] = []
        with Timer() as timer:
            due_s = time.monotonic()

            def again() -> None:
                nonlocal due_s
                due_s = time.monotonic() + 200e-6
                timer.arm_at(due_s)

            def expired() -> None:
                late_s.append(time.monotonic() - due_s)
                timer.expirations()
                if len(late_s) < 100:
                    again()
                else:
                    done.set_result(None)

            loop.add_reader(timer, expired)
            again()
            await done
            loop.remove_reader(timer)
        return late_s

    late_s = sorted(run(scene()))
    assert late_s[0] >= 0.0
    # call_later would wake for 200 µs after a whole millisecond, 800 µs late, each time.
    assert late_s[len(late_s) // 4] < 600e-6


def test_closing_twice_is_no_error() -> None:
    timer = Timer()
    timer.close()
    timer.close()
    assert timer.fileno() == -1
