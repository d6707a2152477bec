"""The map of a gap: what is written into its cells, and under them."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap.located.cells import Cells
from hil.ui.gap_figures import map_figure


def located(energy, *, is_gap):
    """One signal sampled at 50 Hz and one at 200 Hz, two bands each; a floor of 10 in every cell."""
    energy = np.array(energy)[:, None]
    cells = Cells(
        np.array([0, 0, 1, 1]),
        ((3.0, 10.0), (10.0, 25.0), (3.0, 10.0), (10.0, 30.0)),
        ("everywhere",) * 4,
        ("",) * 4,
        energy,
        np.full_like(energy, 10.0),
        np.ones(4),
        np.ones(4),
        np.ones(4),
    )
    evidence = SimpleNamespace(
        cells=cells, problem=SimpleNamespace(signals=("axis.force", "imu.accel_z"))
    )
    return SimpleNamespace(evidence=evidence, is_gap=is_gap)


def written(found):
    return [list(row) for row in map_figure(found).data[0].text]


def test_shares_of_a_gap_add_up():
    assert written(located([310.0, 10.0, 110.0, 10.0], is_gap=True)) == [["75 %", ""], ["25 %", ""]]


@pytest.mark.parametrize("energy", [[22.0, 10.0, 10.0, 10.0], [310.0, 10.0, 10.0, 10.0]])
def test_where_there_is_no_gap_nothing_has_a_share_of_it(energy):
    assert written(located(energy, is_gap=False)) == [["", ""], ["", ""]]


def test_a_band_ends_where_it_does_for_the_signal_that_is_sampled_fastest():
    assert list(map_figure(located([310.0, 10.0, 10.0, 10.0], is_gap=True)).data[0].x) == [
        "3–10",
        "10–30",
    ]
