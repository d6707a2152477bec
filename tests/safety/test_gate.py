"""The gate lets pass what is inside every bound, and names the rule of what is outside."""

from __future__ import annotations

import pytest

from hil.frames import Frame
from hil.safety import Cause, Gate, Rule
from tests.safety.bench import BenchMeaning, limits, off, on, read, write
from tests.safety.gate_cases import CASES, Case, run


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)
def test_boundary(case: Case) -> None:
    gate = Gate(limits(case.kind, **case.limits), BenchMeaning(), read_only=case.read_only)
    assert run(case, gate) == []


def test_every_rule_has_a_case_that_breaks_it() -> None:
    broken = {step[3] for case in CASES for step in case.steps if step[0] == "send"}
    assert broken - {None} == {rule.value for rule in Rule}


def test_refusals_are_counted_by_rule_and_named_with_frame_and_drive() -> None:
    gate = Gate(limits(), BenchMeaning())
    gate.arm()
    gate.measured(1, 0.0, 0.0)
    verdict = gate.pass_frame(0.0, on(30.0, 1))
    gate.pass_frame(0.0, write(6))
    gate.pass_frame(0.0, write(6))
    gate.pass_frame(0.0, off())
    assert gate.refused == {Rule.SPEED: 1, Rule.WRITE_PARAMETER: 2}
    assert gate.passed == 1
    assert "right" in verdict.text
    assert "60.0000 /s" in verdict.text


def test_refusals_are_findings_once_and_harmless_ones_are_not() -> None:
    gate = Gate(limits(), BenchMeaning())
    gate.pass_frame(0.0, read(1))
    gate.pass_frame(0.0, read(1))
    assert gate.findings() == ()
    gate.pass_frame(0.0, Frame(0x555, b""))
    (finding,) = gate.findings()
    assert finding.cause is Cause.GATE_REFUSED
    assert "unknown_id" in finding.text
    assert gate.findings() == ()


def test_a_read_only_gate_cannot_be_armed() -> None:
    gate = Gate(limits(), BenchMeaning(), read_only=True)
    gate.arm()
    assert not gate.armed


def test_powered_tells_whether_any_drive_was_told_to_be_on() -> None:
    gate = Gate(limits(), BenchMeaning())
    assert not gate.powered
    gate.arm()
    gate.measured(0, 0.0, 0.0)
    gate.pass_frame(0.0, on(0.0))
    assert gate.powered
    gate.pass_frame(0.0, off(1))
    assert gate.powered
    gate.pass_frame(0.0, off(0))
    assert not gate.powered
