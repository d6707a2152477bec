"""The motorcycle platform's figure 7: the torque of a leg's motor over a chirp, and who can tell it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.identify.estimate import TwinProblem
from hil.identify.replay import stretches
from hil.rigs import build_rig
from hil.ui.page import PALETTE
from hil.ui.reproduce import motorcycle_prose as prose
from hil.ui.reproduce.bench import Played
from hil.ui.reproduce.curves import MEASURED, SIMULATED, Curve, Panel, panels
from hil.ui.reproduce.following import LEG
from hil.ui.reproduce.report import Section, Table

Array = NDArray[np.float64]
TWIN: Final = "twin: the drives' loops too"
WHOLE: Final = "platform, rotors, friction"
BODY: Final = "platform alone, as in the paper"


def torque_section(played: Mapping[str, Played]) -> Section:
    """Figure 7."""
    p = played["chirp_servo"]
    rig = p.job.rig
    actuator = rig.actuators[rig.actuator_names.index(LEG)]
    assert actuator.torque_constant is not None
    assert actuator.force_per_ampere is not None
    torque_per_force_m = actuator.torque_constant / actuator.force_per_ampere
    t, force = p.samples(f"{LEG}.force")
    whole, body, static = _expected(p, t)
    piece = stretches(p.run)[0]
    twin = TwinProblem(rig, [piece], ("mass.m",), ("force",))
    answers = twin.stretch_samples(twin.start)[0][f"{LEG}.force"]
    drawn = np.interp(t, piece.samples[f"{LEG}.force"][0] - rig.bus.answer_delay, answers)
    left = {TWIN: drawn, WHOLE: whole, BODY: body, "weight alone": static}
    shares = {k: float(np.std(force - y) / np.std(force)) for k, y in left.items()}
    x = t - p.start_s
    to_nm = torque_per_force_m

    def panel(title: str, low_s: float, high_s: float, *, with_twin: bool) -> Panel:
        some = (x >= low_s) & (x <= high_s)
        curves = [
            Curve("measured", x[some], to_nm * force[some], MEASURED),
            Curve("model: platform, rotor, friction", x[some], to_nm * whole[some], SIMULATED),
            Curve(
                "model: platform alone, as the paper's",
                x[some],
                to_nm * body[some],
                PALETTE[2],
                "dash",
            ),
        ]
        if with_twin:
            curves.append(Curve(TWIN, x[some], to_nm * drawn[some], PALETTE[3], "dot"))
        return Panel(title, "t, s", "N·m at the motor", curves)

    end_s = p.description.duration_s
    figure = panels(
        [
            panel("torque of leg 1's motor over the chirp", 0.0, end_s, with_twin=False),
            panel(
                "its last second and a half at full size",
                end_s - 3.8,
                end_s - 2.3,
                with_twin=True,
            ),
        ],
        height=250,
    )
    rows = tuple((name, f"{100.0 * share:.1f}") for name, share in shares.items())
    words = prose.TORQUE.filled(
        peak=to_nm * float(np.abs(force).max()),
        mean=to_nm * float(np.mean(force)),
        rotor=actuator.reflected_mass,
        body=100.0 * shares[BODY],
        whole=100.0 * shares[WHOLE],
        twin=100.0 * shares[TWIN],
        cycle=1e3 * rig.bus.cycle,
    )
    table = Table(("model of the force", "left unexplained, % of its spread"), rows)
    facts = {
        "torque_left_whole": shares[WHOLE],
        "torque_left_body": shares[BODY],
    }
    return Section(words, (figure,), table, facts)


def _expected(p: Played, t_s: Array) -> tuple[Array, Array, Array]:
    """Force of the leg (N,) for the commanded motion: all of the model, platform alone, weight alone."""
    rig = p.job.rig
    bare = rig.model_copy(
        update={
            "actuators": tuple(a.model_copy(update={"reflected_mass": 0.0}) for a in rig.actuators)
        }
    )
    model, light = build_rig(rig), build_rig(bare)
    k = rig.actuator_names.index(LEG)
    own = rig.actuators[k]
    curve = CubicSpline(p.trajectory.t_s, p.trajectory.poses)
    out = np.empty((3, len(t_s)))
    for n, t in enumerate(t_s - p.start_s):
        q, qd, qdd = (curve(t, d) for d in range(3))
        speed = model.rates(q, qd)[k]
        friction = own.viscous * speed + own.coulomb * np.sign(speed)
        out[:, n] = (
            model.inverse_dynamics(q, qd, qdd)[k] + friction,
            light.inverse_dynamics(q, qd, qdd)[k],
            model.static_forces(q)[k],
        )
    return out[0], out[1], out[2]
