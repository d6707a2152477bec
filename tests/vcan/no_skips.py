"""pytest plugin (`-p tests.vcan.no_skips`): a run that skipped a test, or had none, has failed."""

from __future__ import annotations

import pytest

_skipped: list[str] = []
_passed: list[str] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped:
        _skipped.append(report.nodeid)
    elif report.when == "call" and report.passed:
        _passed.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if (_skipped or not _passed) and session.exitstatus in (
        pytest.ExitCode.OK,
        pytest.ExitCode.NO_TESTS_COLLECTED,
    ):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if _skipped or not _passed:
        terminalreporter.write_line(
            f"FAILED: {len(_skipped)} tests were skipped and {len(_passed)} passed; "
            "here none may be skipped",
            red=True,
        )
