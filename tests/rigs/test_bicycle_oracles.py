"""Other people's bicycle models say the same: bicycleparameters and a measured bicycle's authors."""

import warnings

import numpy as np
import pytest

from hil.configfile import load_bicycle
from hil.rigs.bicycle import canonical, linearise, pack
from tests.shared_data import shared


def meijaard_parameters(rig):
    """`rig` in the benchmark paper's parameters: z down from the road."""
    g, m = rig.geometry, rig.mass
    return {
        "w": g.wheelbase, "c": g.trail, "lam": g.tilt, "g": m.gravity, "v": 1.0,
        "rR": g.R, "mR": m.m[0], "IRxx": m.I2[0], "IRyy": m.I2[1],
        "xB": m.G3[0], "zB": -(m.G3[2] + g.R), "mB": m.m[1],
        "IBxx": m.I3[0], "IByy": m.I3[1], "IBzz": m.I3[2], "IBxz": -m.I3[3],
        "xH": m.G4[0], "zH": -(m.G4[2] + g.R), "mH": m.m[2],
        "IHxx": m.I4[0], "IHyy": m.I4[1], "IHzz": m.I4[2], "IHxz": -m.I4[3],
        "rF": g.front_radius, "mF": m.m[3], "IFxx": m.I5[0], "IFyy": m.I5[1],
    }  # fmt: skip


@pytest.mark.parametrize("name", ["bicycle", "bicycle_text", "bicycle_benchmark", "bicycle_delft"])
def test_bicycleparameters_gives_the_same_matrices(name):
    pytest.importorskip("bicycleparameters")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # theirs, at import
        from bicycleparameters.models import Meijaard2007Model
        from bicycleparameters.parameter_sets import Meijaard2007ParameterSet
    rig = load_bicycle(name)
    model = Meijaard2007Model(Meijaard2007ParameterSet(meijaard_parameters(rig), True))
    found = canonical(pack(rig))
    for ours, theirs in zip(
        (found.M, found.C1, found.K0, found.K2),
        model.form_reduced_canonical_matrices(),
        strict=True,
    ):
        np.testing.assert_allclose(ours, theirs, atol=2e-12 * max(1.0, np.abs(theirs).max()))
    A, B = model.form_state_space_matrices(v=6.0)
    ours, inputs = linearise(pack(rig), 6.0)
    np.testing.assert_allclose(ours, A, atol=1e-10)
    np.testing.assert_allclose(inputs, B, atol=1e-11)


@pytest.mark.shared
def test_the_measured_bicycle_is_its_authors_model():
    grid = np.load(shared("data/sbw_bicycle/whipple_state_space_on_speed_grid.npz"))
    found = canonical(pack(load_bicycle("bicycle_delft")))
    for speed, A, B in zip(
        grid["speeds_mps"], grid["measured_corrected/plant/A"], grid["measured_corrected/plant/B"],
        strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(found.state_matrix(speed), A, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(found.input_matrix(), B, rtol=1e-8, atol=1e-8)
