"""Effects from outside the catalogue: what real rigs have besides, for which the answer is `unknown`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from hil.exam.world import layout as lay
from hil.exam.world.body import World

OF_ACTUATOR: Final = {
    "cable_drag": {"stiffness": lay.O_CABLE_K, "from": lay.O_CABLE_X},
    "seal_stiction": {"force": lay.O_SEAL_F, "time": lay.O_SEAL_TAU},
    "thermal_drift": {"coefficient": lay.O_DRIFT_C, "time": lay.O_DRIFT_TAU},
    "bump": {"force": lay.O_BUMP_F, "at": lay.O_BUMP_X, "width": lay.O_BUMP_W},
    "quadratic_drag": {"coefficient": lay.O_QUADRATIC},
    "limit_cycle": {"force": lay.O_CYCLE_F, "rate": lay.O_CYCLE_W},
    "swelling_cogging": {
        "force": lay.O_COG_F, "period": lay.O_COG_P, "zero": lay.O_COG_X, "length": lay.O_COG_L,
    },
    "setpoint_rounding": {"step": lay.O_ROUND},
    "encoder_slip": {"jump": lay.O_SLIP_X, "time": lay.O_SLIP_T},
    "thermal_derating": {"share": lay.O_DERATE, "time": lay.O_DERATE_TAU},
}  # fmt: skip
OF_PLATFORM: Final = {
    "slosh": {
        "mass": lay.H_SLOSH_M, "rate": lay.H_SLOSH_W, "damping": lay.H_SLOSH_D,
        "x": lay.H_SLOSH_X, "y": lay.H_SLOSH_Y, "z": lay.H_SLOSH_Z,
    },
    "soft_base": {"ratio": lay.H_BASE_RATIO, "rate": lay.H_BASE_W, "damping": lay.H_BASE_D},
    "failing_counterbalance": {
        "force": lay.H_LOSS_F, "period": lay.H_LOSS_T1, "second": lay.H_LOSS_T2, "phase": lay.H_LOSS_PHASE,
    },
    "periodic_push": {
        "force": lay.H_PUSH_F, "rate": lay.H_PUSH_W, "phase": lay.H_PUSH_PHASE,
        "x": lay.H_PUSH_X, "y": lay.H_PUSH_Y, "z": lay.H_PUSH_Z,
    },
}  # fmt: skip
OUTSIDE: Final = (*OF_ACTUATOR, *OF_PLATFORM)
"""Names of all of them."""


def apply_outside(world: World, kind: str, location: str, parameters: Mapping[str, float]) -> None:
    """Put one into `world`."""
    if kind in OF_PLATFORM:
        for name, value in parameters.items():
            world.head[OF_PLATFORM[kind][name]] = value
        return
    i = world.rig.actuator_names.index(location)
    for name, value in parameters.items():
        world.act[OF_ACTUATOR[kind][name], i] = value
