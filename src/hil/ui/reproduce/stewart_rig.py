"""The Stewart platform of the reproduction: the rig that is measured, and the model that is fitted to it."""

from __future__ import annotations

from typing import Final

from hil.config import Effect, RigFile
from hil.identify.estimate.names import with_numbers
from hil.identify.experiments import Circle, Heave, Multisine, Plan, Sweep
from hil.ui.reproduce.bench import Job, variant
from hil.ui.reproduce.report import Lengths

COULOMB_N: Final = 1.0
VISCOUS_N_S_M: Final = 20.0
HYSTERESIS: Final = {"force": 1.5, "displacement": 1.0e-4}
"""Friction small enough for the paper's scheme, see `lengths_rig`; N, N·s/m; N, m [R]."""
RESOLUTION_M: Final = 0.6e-6
"""Of the actuators' lengths: legible in the paper's table of specifications [F]."""
FIVE_HZ: Final = (0.2, 0.6, 1.2, 2.2, 4.0)
SIX_HZ: Final = (0.4, 0.8, 1.6, 2.8, 3.4, 4.6)
"""Lines of the two signals for the describing function: the paper has five and six, not which."""
IMU_HZ: Final = 225.0
"""Of samples: whatever of the setpoints' corners stands at 100, 200 or 300 Hz folds to 25 Hz or above,
far from the lines; no multiple of the setpoints' rate below 900 Hz folds onto them."""
IN_STEP: Final = "in_step"
"""The six lines again with an IMU that samples twice in each cycle of setpoints, as the rig file's does."""
SWEEP_RAD_S2: Final = 0.6
CIRCLE_M: Final = 0.25
HEAVE_HZ: Final = 0.5
ROTATIONS: Final = ("roll", "pitch", "yaw")


def lengths_rig(rig: RigFile) -> RigFile:
    """`rig` with encoders as fine as the paper's, hardly any friction in the legs, and an IMU out of step.

    K_s = 0.997 leaves 0.003 of the legs' load to be held by K_p: about 10 um at K_p = 250 kN/m. The rig
    file's 35 N of Coulomb friction would hide that behind 140 um of hysteresis.
    """
    made = variant(
        rig,
        noise={"position": RESOLUTION_M, "position_step": RESOLUTION_M},
        imu={"rate": IMU_HZ},
    )
    return with_numbers(made, {"all.coulomb": COULOMB_N, "all.viscous": VISCOUS_N_S_M})


def hysteresis(rig: RigFile) -> tuple[Effect, ...]:
    """What no model here has: presliding friction of each leg."""
    return tuple(
        Effect(effect="hysteresis", location=a, parameters=dict(HYSTERESIS))
        for a in rig.actuator_names
    )


def paper_model(rig: RigFile) -> RigFile:
    """The paper's model of `rig`: a rigid cabin on legs without friction or inertia."""
    return with_numbers(rig, {"all.coulomb": 0.0, "all.viscous": 0.0, "all.reflected_mass": 0.0})


def jobs(rig: RigFile, lengths: Lengths) -> list[Job]:
    """All experiments on `rig`, as `lengths_rig` made it."""
    plans: dict[str, Plan] = {
        "circle": Circle(
            amplitude=(CIRCLE_M,), period_s=lengths.circle_s, fade_s=lengths.circle_fade_s
        ),
        "heave": Heave(
            coordinates=("heave",), frequency=HEAVE_HZ, cycles=lengths.heave_cycles, fade_s=2.0
        ),
    }
    for c in ROTATIONS:
        plans[c] = Sweep(
            coordinates=(c,),
            amplitude=(SWEEP_RAD_S2,),
            f_min=0.4,
            f_max=3.0,
            duration_s=lengths.sweep_s,
            fade_s=2.0,
        )
    for name, lines in (("five", FIVE_HZ), ("six", SIX_HZ)):
        plans[name] = Multisine(
            coordinates=("heave",),
            period_s=lengths.multisine_s,
            harmonics=tuple(round(f * lengths.multisine_s) for f in lines),
            spectrum="acceleration",
            share=0.5,
            periods=lengths.periods,
            realisations=1,
        )
    effects = hysteresis(rig)
    out = [Job(name, plan, rig, effects, seed=k) for k, (name, plan) in enumerate(plans.items())]
    locked = variant(rig, imu={"rate": 2.0 / rig.bus.cycle})
    return [*out, Job(IN_STEP, plans["six"], locked, effects, seed=len(out))]
