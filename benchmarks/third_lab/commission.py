"""What a careful commissioning leaves: the healthy rig's scatter about its file, and a day's drift of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.third_lab.engine import LINE
from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.sensing import IMU, Sensing


def commission(ideal: Plant, rng: np.random.Generator) -> tuple[Plant, Sensing]:
    """A healthy specimen of the rig."""
    rig, n = ideal.rig, len(ideal.rig.actuators)

    def about(share: float) -> float:
        return 1.0 + rng.uniform(-share, share)

    plant = replace(
        ideal,
        mass=ideal.mass * about(0.01),
        cog=ideal.cog + rng.uniform(-0.003, 0.003, 3),
        inertia=ideal.inertia * about(0.02),
        tilt=rng.uniform(-0.0015, 0.0015, 2),
        floor=ideal.floor * np.array([1.0, about(0.3), about(0.3)])[:, None],
        imu_at=ideal.imu_at + rng.uniform(-0.002, 0.002, 3),
    )
    if n > 1:
        moved = (plant.kind != LINE)[:, None]
        plant = replace(
            plant,
            cabin=plant.cabin + moved * rng.uniform(-2e-4, 2e-4, (6, 3)),
            base=plant.base + moved * rng.uniform(-2e-4, 2e-4, (6, 3)),
        )
    late = rng.uniform(0.0, 1.5e-4)
    for a in rig.actuators:
        level, side = about(0.05), rng.uniform(-0.015, 0.015)
        period = _ripple_period(a.transmission, rng)
        plant = plant.scale(
            a.name,
            reflected=about(0.01),
            viscous=about(0.06),
            load_viscous=about(0.06),
            coulomb_pos=level * (1.0 + side),
            coulomb_neg=level * (1.0 - side),
            stiffness=rng.uniform(0.7, 1.5),
            torque=about(0.007),
            position_gain=about(0.006),
            speed_gain=about(0.008),
            integral_gain=about(0.008),
            current_hz=about(0.1),
        )
        plant = plant.set(
            a.name,
            static_extra=rng.uniform(0.0, 0.04) * a.coulomb,
            stribeck_v=rng.uniform(0.002, 0.008),
            law=float(rng.integers(2)),
            presliding=rng.uniform(5e-6, 2.5e-5),
            ripple=rng.uniform(0.2, 0.8),
            ripple_period=period,
            ripple_phase=rng.uniform(0.0, 2 * np.pi),
            ripple_second=rng.uniform(0.0, 0.3),
            speed_filter=rng.uniform(1e-4, 3e-4),
            offset=rng.uniform(-1.5e-4, 1.5e-4) if n > 1 else 0.0,
        )
        plant = plant.add(a.name, setpoint_delay=late + rng.uniform(-5e-5, 1.5e-4))
    sensing = Sensing(
        answer_delay=rig.bus.answer_delay + rng.uniform(-1e-4, 1.5e-4, n),
        bias={
            **{
                f"{a}.force": rng.uniform(-0.35, 0.35) * rig.noise.force for a in rig.actuator_names
            },
            **{s: rng.uniform(-1, 1) * (0.0015 if "gyro" in s else 0.02) for s in IMU},
        },
        scale={s: about(0.003) for s in IMU},
        delay=dict.fromkeys(IMU, rng.uniform(0.0, 2.5e-4)),
        turn=rng.uniform(-0.0015, 0.0015, 3),
        clock={"imu": rng.uniform(-1.5e-5, 1.5e-5), "drives": rng.uniform(-1.5e-5, 1.5e-5)},
    )
    return plant, sensing


def aged(plant: Plant, sensing: Sensing, rng: np.random.Generator) -> tuple[Plant, Sensing]:
    """The same healthy rig on another day: friction and offsets have moved a little."""
    for name in plant.rig.actuator_names:
        share = 1.0 + rng.uniform(-0.015, 0.015, 2)
        plant = plant.scale(name, coulomb_pos=share[0], coulomb_neg=share[0], viscous=share[1])
    drift = {s: b + rng.uniform(-0.15, 0.15) * abs(b) for s, b in sensing.bias.items()}
    return plant, replace(sensing, bias=drift)


def _ripple_period(transmission: object, rng: np.random.Generator) -> float:
    lead = getattr(transmission, "lead", None)
    if lead is None and hasattr(transmission, "pinion_radius"):
        lead = 2.0 * np.pi * transmission.pinion_radius / transmission.gear
    return float(lead or 0.01) / float(rng.choice([1.0, 2.0, 3.0]))
