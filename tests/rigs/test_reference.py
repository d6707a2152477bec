"""Numbers that stand on their own: the published specs and independently computed samples.

The samples were computed apart from hil, by numeric differentiation and Newton-Euler (rates to 1e-9,
forces to about 1e-8 relative), for massless legs and rotors.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from hil.config.rig import RigFile
from hil.configfile import load_rig
from hil.errors import KinematicsError
from hil.rigs import build_rig, condition_map, single_axis_ranges
from tests.rigs.models import bare
from tests.shared_data import shared

MOTORCYCLE = [
    {
        "q": [0.0, 0.0, 0.0], "qd": [0.0, 0.0, 0.0], "qdd": [0.0, 0.0, 0.0],
        "rho": [0.6, 0.6, 0.0], "rho_dot": [0.0, 0.0, 0.0],
        "F": [588.6, 588.6, 0.0], "lam": [0.0, 0.0, -784.8],
    },
    {
        "q": [-0.19789387817377013, 0.1284913673531065, 0.11882777150081852],
        "qd": [-0.3102374499099702, 0.2449210250925991, 0.17844350408003037],
        "qdd": [0.21082849799579712, -1.8609360894164093, -0.05850364492654698],
        "rho": [0.5145536127787912, 0.43872847862620645, 0.2091089590438487],
        "rho_dot": [-0.1817966717443815, -0.2606812406751075, 0.3207132024896243],
        "F": [668.3504870392666, 972.9581117404978, -92.2803200821722],
        "lam": [48.04951641796867, -102.59443183191286, -583.6792715435539],
    },
    {
        "q": [0.021398940829796986, 0.1982001133737571, 0.11706476768550123],
        "qd": [-0.950611369900422, -0.644768869892488, -0.9208675188958662],
        "qdd": [-0.47018226214936254, -2.5348929628874064, 0.542528717643403],
        "rho": [0.4405454918680807, 0.3603879048709874, -0.009719760403883369],
        "rho_dot": [0.34709304745415387, 0.9642228805716173, 0.8577566203954057],
        "F": [604.8261688061242, 1079.2245190551687, 78.38070549373315],
        "lam": [229.70762567495976, -34.99381588660543, -509.0462280156825],
    },
]  # fmt: skip

STEWART = {
    "c": [0.04383296776895414, -0.00977944963967163, 1.010375667185821],
    "rpy": [0.07894721162374557, -0.1623290608449402, 0.19024894065470238],
    "v": [0.05113616126691415, -0.1264970369374329, -0.006720463001715519],
    "omega": [-0.34121757102943207, 0.35175918994513145, 0.31111677417157935],
    "vdot": [0.09904604634182407, 1.6908618104520494, 0.7012640133780684],
    "omegadot": [-1.2889386943248573, 0.5531261761237483, -1.4383239012434983],
    "rho": [1.2203118490839484, 1.1535611452760608, 1.0966719569169585,
            0.9683800290081229, 1.171153433209332, 1.092800244238991],
    "rho_dot": [-0.23106628333171528, -0.246914014502231, 0.22874087170727586,
                0.13836479438072297, 0.09082601661196042, -0.10198161787436458],
    "F": [698.2925349962695, 787.1329046313635, 18.155841141145395,
          2141.2098471701797, 725.6414518882475, 694.125868123603],
}  # fmt: skip
STATIC = [630.3532019745788, 912.2545889983378, 860.5035560084367,
          864.9141759949472, 940.4132958674668, 654.2859414153]  # fmt: skip
LEG_INERTIA = [90.7823941111985, 344.96806515091293, 375.75138203490224,
               488.41119934258126, 912.6893298963195, 1086.7181153012482]  # fmt: skip


def check_motorcycle(file: RigFile, sample: dict[str, list[float]]) -> None:
    rig = build_rig(bare(file))
    motion = sample["q"], sample["qd"], sample["qdd"]
    np.testing.assert_allclose(rig.inverse(sample["q"]), sample["rho"], atol=1e-14)
    np.testing.assert_allclose(rig.rates(*motion[:2]), sample["rho_dot"], atol=1e-14)
    np.testing.assert_allclose(rig.inverse_dynamics(*motion), sample["F"], atol=2e-8)
    np.testing.assert_allclose(rig.constraint_forces(*motion), sample["lam"], atol=2e-8)
    np.testing.assert_allclose(rig.forward(sample["rho"]), sample["q"], atol=1e-9)


def check_stewart(file: RigFile, sample: dict[str, list[float]]) -> None:
    """The sample speaks of angular velocity; rates follow from E and its derivative."""
    roll_pitch_yaw, omega = np.array(sample["rpy"]), np.array(sample["omega"])
    rates = np.linalg.solve(euler(roll_pitch_yaw), omega)
    step = 1e-6
    E_dot = (euler(roll_pitch_yaw + step * rates) - euler(roll_pitch_yaw - step * rates)) / 2 / step
    bends = np.linalg.solve(euler(roll_pitch_yaw), sample["omegadot"] - E_dot @ rates)
    q = np.array([*sample["c"], *roll_pitch_yaw])
    q[2] -= file.geometry.height  # type: ignore[union-attr]
    rig = build_rig(bare(file))
    qd = np.array([*sample["v"], *rates])
    np.testing.assert_allclose(rig.inverse(q), sample["rho"], atol=1e-14)
    np.testing.assert_allclose(rig.rates(q, qd), sample["rho_dot"], atol=1e-13)
    force = rig.inverse_dynamics(q, qd, np.array([*sample["vdot"], *bends]))
    np.testing.assert_allclose(force, sample["F"], rtol=1e-8, atol=1e-6)


def euler(angles: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """E: omega = E (roll, pitch, yaw)'."""
    _, p, y = angles
    return np.array(
        [
            [np.cos(p) * np.cos(y), -np.sin(y), 0],
            [np.cos(p) * np.sin(y), np.cos(y), 0],
            [-np.sin(p), 0, 1],
        ]
    )


@pytest.mark.parametrize("sample", MOTORCYCLE)
def test_motorcycle_platform_meets_the_samples(
    motorcycle_file: RigFile, sample: dict[str, list[float]]
) -> None:
    check_motorcycle(motorcycle_file, sample)


def test_stewart_platform_meets_the_sample(stewart_file: RigFile) -> None:
    check_stewart(stewart_file, STEWART)


@pytest.mark.shared
def test_every_sample_of_the_reference_is_met(
    motorcycle_file: RigFile, stewart_file: RigFile
) -> None:
    reference = json.loads(shared("reference.json").read_text())
    for sample in reference["motorcycle_platform"]["samples"]:
        check_motorcycle(motorcycle_file, sample | {"q": sample["q_yaw_pitch_roll"]})
    for sample in reference["mpi_stewart"]["samples"]:
        names = {"rpy": "euler_rpy", "omega": "omega_base", "omegadot": "omegadot_base",
                 "rho": "leg_length", "rho_dot": "leg_rate", "F": "leg_force"}  # fmt: skip
        check_stewart(stewart_file, sample | {ours: sample[key] for ours, key in names.items()})


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "key"), [("axis",) * 2, ("motorcycle",) * 2, ("stewart",) * 2, ("stewart_pd",) * 2]
)
def test_shipped_rig_files_carry_the_nominal_numbers(name: str, key: str) -> None:
    nominal = json.loads(shared("rigs.json").read_text())["rigs"][key]
    shipped = load_rig(name).model_dump()
    for actuator, expected in zip(shipped["actuators"], nominal.pop("actuators"), strict=True):
        for field, value in expected.items():
            kept = actuator[field]
            assert (list(kept) if isinstance(kept, tuple) else kept) == value, field
    for table in ("geometry", "mass", "bus", "imu", "noise"):
        for field, value in nominal[table].items():
            np.testing.assert_equal(np.array(shipped[table][field]), np.array(value), field)
    assert list(shipped["limits"]) == nominal["limits"]


def test_static_leg_forces_carry_the_weight(stewart_file: RigFile) -> None:
    np.testing.assert_allclose(
        build_rig(stewart_file).static_forces(np.zeros(6)), STATIC, rtol=1e-9
    )


def test_leg_space_inertia_has_the_reference_eigenvalues(stewart_file: RigFile) -> None:
    inertia = build_rig(bare(stewart_file)).actuator_inertia(np.zeros(6))
    np.testing.assert_allclose(np.linalg.eigvalsh(inertia), LEG_INERTIA, rtol=1e-9)


def test_stewart_ranges_are_those_of_the_published_platform(stewart_file: RigFile) -> None:
    """Surge 930, sway 860, heave 500 mm; pitch +34/-32, roll 28, yaw 44 degrees [M]."""
    ranges = single_axis_ranges(build_rig(stewart_file))
    reached_m = ranges[:3, 1] - ranges[:3, 0]
    np.testing.assert_allclose(reached_m, [0.930, 0.860, 0.500], atol=0.0025)
    np.testing.assert_allclose(np.degrees(ranges[3:]), [[-28, 28], [-32, 34], [-44, 44]], atol=0.12)
    np.testing.assert_allclose(
        ranges[:3],
        [[-0.49194023, 0.43712117], [-0.43025178, 0.43025178], [-0.25488540, 0.24345142]],
        atol=1e-8,
    )


def test_stewart_is_well_conditioned_at_neutral(stewart_file: RigFile) -> None:
    """cond(J) = 3.4 with rotations measured at half a metre; the whole workspace is regular."""
    conditions = condition_map(build_rig(stewart_file), points=3, characteristic_length_m=0.5)
    neutral = int(np.argmin(np.abs(conditions.poses).sum(axis=1)))
    assert conditions.condition[neutral] == pytest.approx(3.4, abs=0.05)
    assert np.all(conditions.determinant > 0)


def test_motorcycle_jacobian_is_invertible_over_fifteen_degrees(motorcycle_file: RigFile) -> None:
    """det J_-1 A in [-0.704, -0.458], condition at most 3.36."""
    wide = motorcycle_file.model_copy(update={"limits": (np.radians(15),) * 3})
    conditions = condition_map(build_rig(wide), points=7)
    assert conditions.poses.shape == (343, 3)
    assert conditions.condition.max() == pytest.approx(3.36, abs=0.01)
    assert conditions.determinant.min() == pytest.approx(-0.704, abs=5e-4)
    assert conditions.determinant.max() == pytest.approx(-0.458, abs=5e-4)


def test_motorcycle_strokes_over_the_workspace(motorcycle_file: RigFile) -> None:
    """Legs .247..0.960 m, slide within 0.285 m, over all corners of 15 degrees."""
    wide = motorcycle_file.model_copy(update={"limits": (np.radians(15),) * 3})
    rig = build_rig(wide)
    strokes = np.array([rig.inverse(q) for q in condition_map(rig, points=5).poses])
    assert strokes[:, 0].min() == pytest.approx(0.247, abs=1e-3)
    assert strokes[:, 0].max() == pytest.approx(0.960, abs=1e-3)
    assert np.abs(strokes[:, 2]).max() == pytest.approx(0.285, abs=1e-3)


def test_only_the_motorcycle_platform_has_constraint_forces(stewart_file: RigFile) -> None:
    with pytest.raises(KinematicsError, match="stewart_6dof has no constraint forces"):
        build_rig(stewart_file).constraint_forces(*np.zeros((3, 6)))
