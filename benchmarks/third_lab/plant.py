"""A rig as this world sees it: six members, a body, a floor, one row of numbers an actuator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.third_lab import columns as c
from benchmarks.third_lab.engine import LINE, PLANE, STRUT
from hil.config import RigFile


@dataclass(frozen=True)
class Plant:
    """Everything that the engine needs of a rig; arrays are never changed in place."""

    rig: RigFile
    act: np.ndarray  # (n, columns.COUNT)
    kind: np.ndarray  # (6,)
    actuated: np.ndarray  # (6,)
    cabin: np.ndarray  # (6, 3) in the platform frame, m
    base: np.ndarray  # (6, 3) in the base frame, m
    line: np.ndarray  # (6, 3)
    passive: np.ndarray  # (6, 3) length, stiffness, damping
    mass: float
    cog: np.ndarray  # (3,)
    inertia: np.ndarray  # (3, 3) about the centre of gravity
    tilt: np.ndarray  # (2,) roll and pitch of the base, rad
    floor: np.ndarray  # (3, 3) frame's mass, stiffness, damping along x, y, z
    imu_at: np.ndarray  # (3,) in the platform frame, m
    slosh: np.ndarray  # (6,) mass, x, y, z in the platform frame, stiffness, damping
    lost_setpoints: float = 0.0

    def set(self, actuator: str, **columns: float) -> Plant:
        """With these columns (lower-case names) of `actuator` set."""
        act = self.act.copy()
        row = act[self.index(actuator)]
        for name, value in columns.items():
            row[getattr(c, name.upper())] = value
        return replace(self, act=act)

    def add(self, actuator: str, **columns: float) -> Plant:
        """With these columns of `actuator` raised."""
        return self.set(actuator, **{k: self.get(actuator, k) + v for k, v in columns.items()})

    def scale(self, actuator: str, **columns: float) -> Plant:
        """With these columns of `actuator` multiplied."""
        return self.set(actuator, **{k: self.get(actuator, k) * v for k, v in columns.items()})

    def get(self, actuator: str, column: str) -> float:
        """One number of `actuator`."""
        return float(self.act[self.index(actuator), getattr(c, column.upper())])

    def index(self, actuator: str) -> int:
        """Row of `actuator`."""
        return self.rig.actuator_names.index(actuator)

    @property
    def gravity(self) -> np.ndarray:
        """Gravity in the frame of the tilted base, m/s²: (R_y(pitch) R_x(roll))^T g."""
        (sr, sp), (cr, cp) = np.sin(self.tilt), np.cos(self.tilt)
        return -self.rig.mass.gravity * np.array([-sp, cp * sr, cp * cr])


def nominal(rig: RigFile) -> Plant:
    """The rig as its file has it, stiff but not rigid, on a good floor."""
    kind, actuated, cabin, base, line, passive = _members(rig)
    act = np.stack([_row(rig, i) for i in range(len(rig.actuators))])
    frame = 10.0 * rig.mass.m
    hz = np.array([60.0, 55.0, 90.0])
    spring = frame * (2.0 * np.pi * hz) ** 2
    return Plant(
        rig=rig,
        act=act,
        kind=kind,
        actuated=actuated,
        cabin=cabin,
        base=base,
        line=line,
        passive=passive,
        mass=rig.mass.m,
        cog=np.array(rig.mass.cog),
        inertia=np.array(rig.mass.inertia),
        tilt=np.zeros(2),
        floor=np.stack([np.full(3, frame), spring, 2.0 * 0.06 * np.sqrt(frame * spring)]),
        imu_at=np.array(rig.imu.position if rig.imu else (0.0, 0.0, 0.0)),
        slosh=np.zeros(6),
    )


def _row(rig: RigFile, i: int) -> np.ndarray:
    a, row = rig.actuators[i], c.NEUTRAL.copy()
    if a.law != "cascade" or a.velocity_ff or a.acceleration_ff or a.friction_ff:
        raise ValueError(f"{a.name}: this world knows the plain cascade only")
    stiffness = 6.0e7
    row[c.REFLECTED] = a.reflected_mass
    row[c.VISCOUS], row[c.LOAD_VISCOUS] = 0.8 * a.viscous, 0.2 * a.viscous
    row[c.COULOMB_POS] = row[c.COULOMB_NEG] = a.coulomb
    row[c.STIFFNESS] = stiffness
    row[c.DAMPING] = 2.0 * 0.03 * np.sqrt(stiffness * a.reflected_mass)
    row[c.FORCE_LIMIT], row[c.SPEED_LIMIT] = a.force_max, a.velocity_max
    row[c.POSITION_GAIN], row[c.SPEED_GAIN] = a.position_gain, a.speed_gain
    row[c.INTEGRAL_GAIN], row[c.CURRENT_HZ] = a.integral_gain, a.current_hz
    row[c.SPEED_FILTER], row[c.ENCODER_STEP] = 2.0e-4, 5.0e-9
    row[c.HOME] = a.home
    row[c.SETPOINT_DELAY] = rig.bus.setpoint_delay
    return row


def _members(rig: RigFile) -> tuple[np.ndarray, ...]:
    build = {"axis_1dof": _axis, "motorcycle_3dof": _motorcycle, "stewart_6dof": _stewart}
    return build[rig.kind](rig)


def _axis(rig: RigFile) -> tuple[np.ndarray, ...]:
    """A carriage on two rails, half a metre apart, three runners carrying and two guiding; moves along x."""
    if rig.geometry.load != "horizontal":
        raise ValueError("this world's axis lies")
    cabin = np.array(
        [[0, 0, 0], [0.2, 0.25, 0], [-0.2, 0.25, 0], [0, -0.25, 0], [0.2, 0, 0], [-0.2, 0, 0]],
        float,
    )
    line = np.array([[1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, 1, 0]], float)
    return (
        np.full(6, LINE),
        np.array([0, -1, -1, -1, -1, -1]),
        cabin,
        np.zeros((6, 3)),
        line,
        _guides(1.5e8),
    )


def _motorcycle(rig: RigFile) -> tuple[np.ndarray, ...]:
    """Two legs in planes across y, a slide along y behind; stiff bearings there and where y_m = 0 is kept."""
    g = rig.geometry
    rear = [-g.l3, 0.0, -g.h3]
    cabin = np.array([[0, g.l, 0], [0, -g.l, 0], rear, rear, rear, [0, 0, 0]], float)
    base = np.zeros((6, 3))
    base[2:5] = [-g.L, 0.0, g.h]
    line = np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]], float)
    kind = np.array([PLANE, PLANE, LINE, LINE, LINE, LINE])
    return kind, np.array([0, 1, 2, -1, -1, -1]), cabin, base, line, _guides(2.0e8)


def _stewart(rig: RigFile) -> tuple[np.ndarray, ...]:
    """Six struts between joints."""
    g = rig.geometry
    cabin, base = np.array(g.cabin), np.array(g.base)
    return np.full(6, STRUT), np.arange(6), cabin, base, np.zeros((6, 3)), _guides(0.0)


def _guides(stiffness: float) -> np.ndarray:
    return np.tile([0.0, stiffness, 2.0 * 0.03 * np.sqrt(stiffness * 100.0)], (6, 1))
