"""The picture of a mechanism and the file that it is drawn from."""

import json

import made_up
import numpy as np
import pytest
from matplotlib import image
from matplotlib.collections import LineCollection
from scenes import seldom

from ddmpi.judge.equilibrium import Mechanism, describe
from ddmpi.judge.motions import MotionsOfBody
from ddmpi.pictures.bodies import draw_mechanism
from ddmpi.pictures.draw import draw_all
from ddmpi.results.summary import write_mechanism
from ddmpi.results.tables import read_results


def tipping(velocity=(-0.15, 0.45, 0.3)) -> Mechanism:
    """The upper of two blocks moves; without another velocity it tips about its left lower corner."""
    points = made_up.block(made_up.STACK["upper"]).points
    x, y = points.T
    motions = np.stack(
        [np.tile(axis, (len(points), 1)) for axis in np.eye(2)] + [np.column_stack([-y, x])], axis=2
    )
    return Mechanism((MotionsOfBody.of("upper", points, motions),), np.array([velocity]), 0.1)


@pytest.mark.slow
def test_a_mechanism_is_the_only_picture(tmp_path):
    """mechanism.json holds how the loose bodies move; its picture is drawn from files, and in place of all others."""
    made_up.results(tmp_path, title="Costs $5 and $6")
    write_mechanism(tmp_path, tipping())
    content = json.loads((tmp_path / "mechanism.json").read_text(encoding="utf-8"))
    assert (
        content["reason"]
        == describe(tipping())
        == ("no equilibrium: upper would move most at (3, 2), along (-0.32, 0.95)")
    )
    assert (
        content["bodies"]
        == [{"name": "upper", "centre": pytest.approx([1.5, 1.5]), "velocity": [-0.15, 0.45, 0.3]}]
        and content["imbalance"] == 0.1
    )
    assert draw_all(str(tmp_path)) == [tmp_path / "mechanism.png"]
    first = image.imread(tmp_path / "mechanism.png")
    assert ((first[..., 0] > first[..., 2] + 0.1).mean()) > 0.02  # the colour of what moves


@pytest.mark.parametrize(
    ("velocity", "fixed"), [((-0.15, 0.45, 0.3), (0.0, 1.0)), seldom((0.0, 0.0, 40.0), (1.5, 1.5))]
)
def test_a_body_is_drawn_moved_and_not_stretched(tmp_path, velocity, fixed):
    """By at most a tenth of the extent, without a turn that would stretch it; what rests is drawn once."""
    made_up.results(tmp_path)
    write_mechanism(tmp_path, tipping(velocity))
    content = json.loads((tmp_path / "mechanism.json").read_text(encoding="utf-8"))
    axes = draw_mechanism(read_results(tmp_path), content).axes[0]
    rests, moved, before = (
        np.unique(np.concatenate(each.get_segments()).round(9), axis=0)
        for each in axes.collections
        if isinstance(each, LineCollection)
    )
    stands = np.vstack([rests, before])
    assert np.ptp(stands, axis=0) == pytest.approx([3.0, 2.0])
    from_fixed = np.linalg.norm(moved - fixed, axis=1)
    before = np.linalg.norm(stands[stands[:, 1] >= 1.0] - fixed, axis=1)
    assert from_fixed.max() == pytest.approx(before.max(), rel=0.05)
    y = moved[:, 1].max() - 2.0
    assert 0.1 < y <= 0.45
