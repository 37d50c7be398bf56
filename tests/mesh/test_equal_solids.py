"""Equal solids of a drawing: found wherever they stand, however they are turned; others, and mirror images, are not."""

from pathlib import Path

import eighteen_parts
import numpy as np
import pytest
from scenes import seldom
from scipy.spatial.transform import Rotation

from ddmpi.mesh.alike import list_drawn
from meshes import cad


def bracket(occ, mirrored: bool = False) -> int:
    """An angle with one hole, which no turn takes to its mirror image, in its own axes."""
    angle, _ = occ.fuse([(3, occ.addBox(0, 0, 0, 10, 2, 6))], [(3, occ.addBox(0, 0, 0, 2, 8, 6))])
    (made,), _ = occ.cut(angle, [(3, occ.addCylinder(7, -1, 2, 0, 4, 0, 1))])
    if mirrored:
        occ.mirror([made], 0, 0, 1, 0)
    return int(made[1])


def bolt(occ, at: np.ndarray, along: np.ndarray) -> None:
    """A bolt of two cylinders."""
    occ.fuse(
        [(3, occ.addCylinder(*at, *(10 * along), 1.5))],
        [(3, occ.addCylinder(*at, *(-2 * along), 3))],
    )


TURN = Rotation.from_rotvec(0.7 * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
"""About an axis through the origin."""


@pytest.mark.parametrize("suffix", [seldom(".step"), ".brep"])
def test_equal_solids_are_copies_and_mirror_images_are_not(tmp_path, suffix):
    """Brackets by their one motion; bolts, balls and boxes, which several motions lead to, by one that fits."""
    ends = [(40.0, 0.0, 0.0), (50.0, 0.0, 0.0), (60.0, 0.0, 0.0), (70.0, 0.0, 0.0)]
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -0.6, -0.8]])

    def draw(occ) -> None:
        for mirrored in (False, True):
            bracket(occ, mirrored)
            turned = bracket(occ, mirrored)
            occ.rotate([(3, turned)], 0, 0, 0, 1, 1, 0, 0.7)
            occ.translate([(3, turned)], 30, 5, 6 + 50 * mirrored)
        for at, along in zip(ends, axes, strict=True):
            bolt(occ, np.array(at), along)
        occ.addSphere(100, 0, 0, 3)
        occ.addSphere(120, 0, 0, 3)
        for k, size in enumerate(((3, 4, 5), (4, 5, 3), (3, 4, 5.0001), (3, 4, -5))):
            occ.addBox(150, 20 * k, 0, *size)

    dimension, drawn = list_drawn(cad(tmp_path / f"all{suffix}", draw), "a drawing")
    of = [each.copy and int(each.copy.of) for each in drawn]
    assert dimension == 3
    assert of == [None, 1, None, 3, None, 5, 5, 5, None, 9, None, 11, None, 11]
    frames = {each.number: each.copy.frame(1.0, 3) for each in drawn if each.copy}
    for number, z in ((2, 6.0), (4, 56.0)):
        assert np.allclose(frames[number].turned, TURN.as_matrix(), atol=1e-9)
        assert np.allclose(frames[number].shift, [30.0, 5.0, z], atol=1e-8)
    for k in (1, 2, 3):
        assert np.allclose(frames[5 + k].at(np.array(ends[0])), ends[k], atol=1e-8)
        assert np.allclose(frames[5 + k].along(axes[0]), axes[k], atol=1e-9)
    # where nothing turns, a shift is all
    assert [each.copy.turn for each in drawn if each.copy and each.number in (6, 10, 14)] == [
        None
    ] * 3
    assert np.allclose(frames[14].shift, [0.0, 60.0, -5.0], atol=1e-8)


def test_holes_at_other_angles_make_another_part(tmp_path):
    """Two lids whose holes are at other angles have faces of the same kinds, areas, and centres about their axis."""

    def lid(occ, at: float, angles: tuple[float, ...]) -> None:
        holes = [
            (3, occ.addCylinder(at + 6 * np.cos(a), 6 * np.sin(a), -1, 0, 0, 4, 1)) for a in angles
        ]
        occ.cut([(3, occ.addCylinder(at, 0, 0, 0, 0, 2, 10))], holes)

    def draw(occ) -> None:
        cross = tuple(np.pi / 2 * np.arange(4))
        lid(occ, 0, cross)
        lid(occ, 30, tuple(np.array(cross) + 0.3))
        lid(occ, 60, (0.0, np.pi, 1.0, np.pi + 1.0))

    path = cad(tmp_path / "lids.step", draw)
    assert [bool(each.copy) for each in list_drawn(path, "a drawing")[1]] == [False, True, False]


def test_a_shape_of_equal_numbers_is_no_copy(tmp_path):
    """Centres, areas and volumes agree, and points of the faces do not: an elliptic post turned against its square foot."""

    def draw(occ) -> None:
        for k, angle in enumerate((0.0, np.pi / 4, np.pi / 2)):
            disc = occ.addDisk(20 * k, 0, 0, 3, 2)
            occ.rotate([(2, disc)], 20 * k, 0, 0, 0, 0, 1, angle)
            post = [each for each in occ.extrude([(2, disc)], 0, 0, 5) if each[0] == 3]
            occ.fuse([(3, occ.addBox(20 * k - 4, -4, -2, 8, 8, 2))], post)

    drawn = list_drawn(cad(Path(tmp_path) / "posts.brep", draw), "a drawing")[1]
    assert [bool(each.copy) for each in drawn] == [False, False, True]


@pytest.mark.slow
def test_copies_of_an_assembly(tmp_path):
    """Of 18 parts nine are copies: bolts, nuts and screws, a bracket that is turned, and a nut on the other end of a rod."""
    eighteen_parts.draw(tmp_path / "all.step")
    drawn = list_drawn(tmp_path / "all.step", "a drawing")[1]
    of = [each.copy and int(each.copy.of) for each in drawn]
    fastened = [None, None, 3, 4, 3, 4, 3, 4]
    assert of == [None, None, *fastened, None, None, 11, 12, None, None, None, 17]


def test_parts_in_the_plane_are_no_copies(tmp_path):
    path = cad(tmp_path / "discs.step", lambda occ: [occ.addDisk(x, 0, 0, 1, 1) for x in (0, 5)])
    dimension, drawn = list_drawn(path, "a drawing")
    assert dimension == 2 and [each.copy for each in drawn] == [None, None]
