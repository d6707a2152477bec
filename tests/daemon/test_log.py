"""Whoever logs never waits for whoever reads, and knows what was lost."""

import os
import time

import pytest

from hil.daemon.log import CLOSE_S, MOST_WAITING, Log


@pytest.fixture
def pipe():
    end, fd = os.pipe()
    yield end, fd
    for each in (end, fd):
        os.close(each)


def read_all(end: int) -> str:
    os.set_blocking(end, False)
    return os.read(end, 1 << 20).decode()


def test_an_event_is_a_line(pipe):
    log = Log("axis", pipe[1])
    log.event("fault", "drive_error", "leg1: error 5")
    log.close()
    told = 'rig=axis name=drive_error event="leg1: error 5" level=error\n'
    assert read_all(pipe[0]) == told


def test_a_pipe_that_nobody_reads_costs_lines_and_no_time(pipe):
    log = Log("axis", pipe[1])
    start_s = time.monotonic()
    for _ in range(3 * MOST_WAITING):
        log.event("info", "word", "x" * 100)
    assert time.monotonic() - start_s < 1.0
    assert MOST_WAITING <= log.dropped <= 2 * MOST_WAITING
    start_s = time.monotonic()
    log.close()
    assert CLOSE_S - 0.1 <= time.monotonic() - start_s < CLOSE_S + 1.0


def test_what_waits_is_written_once_somebody_reads(pipe):
    end, fd = pipe
    os.set_blocking(fd, False)  # as a terminal may be that another program has made so
    log = Log("axis", fd)
    for k in range(MOST_WAITING):
        log.event("info", f"word_{k}", "x" * 200)
    text = ""
    while f"word_{MOST_WAITING - 1}" not in text:
        text += os.read(end, 65536).decode()
    log.close()
    assert (text.count("word_"), log.waiting, log.dropped) == (MOST_WAITING, 0, 0)


def test_a_reader_who_is_gone_is_no_error():
    end, fd = os.pipe()
    os.close(end)
    log = Log("axis", fd)
    log.event("info", "word", "")
    log.close()
    os.close(fd)
    assert (log.waiting, log.dropped) == (0, 0)
