"""No rule of the gate can be loosened, tightened or dropped without the boundary table noticing.

A mutant that no input can tell from the gate would have to be listed here with its reason: there is none.
"""

from __future__ import annotations

import ast
import inspect
from typing import Any

from hil.safety import gate as gate_module
from hil.safety import rules as rules_module
from tests.safety.bench import BenchMeaning, limits
from tests.safety.gate_cases import CASES, run
from tests.safety.mutants import Mutant, load, mutants

RULES = frozenset(
    {"judge_measured", "judge_force", "judge_position", "judge_velocity", "_slot", "_sudden"}
)
RULE_CONSTANTS = frozenset({"SLACK", "AHEAD_CYCLES"})
GATE = frozenset(
    {
        "powered",
        "arm",
        "disarm",
        "measured",
        "_judge",
        "_judge_rate",
        "_judge_ask",
        "_judge_write",
        "_judge_power_on",
        "_judge_setpoint",
        "_forget",
    }
)
GATE_CONSTANTS = frozenset({"RATE_CYCLES", "RATE_FRAMES", "DUPLICATE_CYCLES"})

RULE_NAMES = (
    *("Broken", "Passed", "judge_measured", "judge_force", "judge_position"),
    "judge_velocity",
)
"""What the gate takes from the rules' module and mutants of it make anew."""


def survives(gate_names: dict[str, Any]) -> bool:
    """Whether the whole table holds for this gate."""
    for case in CASES:
        gate = gate_names["Gate"](
            limits(case.kind, **case.limits), BenchMeaning(), read_only=case.read_only
        )
        try:
            if run(case, gate):
                return False
        except Exception:  # noqa: BLE001 - a mutant that breaks down is a mutant found
            return False
    return True


def survivors_of(made: list[Mutant], *, in_rules: bool) -> set[str]:
    alive = set()
    for mutant in made:
        if in_rules:
            # The gate as it is, over the mutated rules.
            rules = load(mutant.tree, rules_module)
            space = load(ast.parse(inspect.getsource(gate_module)), gate_module)
            space.update((name, rules[name]) for name in RULE_NAMES)
        else:
            space = load(mutant.tree, gate_module)
        if survives(space):
            alive.add(mutant.where)
    return alive


def test_the_table_kills_every_mutant_of_the_setpoint_rules() -> None:
    made = list(mutants(rules_module, RULES, RULE_CONSTANTS))
    assert len(made) > 60
    assert survivors_of(made, in_rules=True) == set()


def test_the_table_kills_every_mutant_of_the_gate() -> None:
    made = list(mutants(gate_module, GATE, GATE_CONSTANTS))
    assert len(made) > 60
    assert survivors_of(made, in_rules=False) == set()
