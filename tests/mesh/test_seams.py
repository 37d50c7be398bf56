"""Meshes that are not connected as they look: seams, T-junctions, hinges; never where bodies only touch."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import solids
from scenes import seldom
from scipy.spatial.transform import Rotation
from test_lost_nodes import msh

from ddmpi.body.hinges import refuse_hinges
from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import read_mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import MeshSpec
from ddmpi.surface.seams import Seam, find_seam
from meshes import drawn


def block(low, high, divisions) -> Mesh:
    """A rectangle or a box in linear cells."""
    low, high = np.array(low, float), np.array(high, float)
    if len(low) == 2:
        return generate_rectangle(
            MeshSpec(
                shape="rectangle", origin=tuple(low), size=tuple(high - low), divisions=divisions
            )
        )
    mesh = solids.box(divisions, tuple(high - low))
    return replace(mesh, points=mesh.points + low)


def joined(*meshes: Mesh, merge=lambda at: np.ones(len(at), bool)) -> Mesh:
    """Several meshes in one, with nodes in one place merged where `merge` says so."""
    points = np.concatenate([mesh.points for mesh in meshes])
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    cells = np.concatenate([mesh.triangles + k for mesh, k in zip(meshes, starts, strict=False)])
    keys = np.column_stack(
        [np.round(points, 9), np.where(merge(points), -1, np.arange(len(points)))]
    )
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return Mesh(points[first], number.ravel()[cells], {})


def placed(mesh: Mesh, order: int, size: float = 1.0) -> Mesh:
    """The mesh in an order, of another size, turned, far from the origin."""
    mesh = raise_order(mesh, "", order)
    turn = Rotation.from_rotvec(
        [0.0, 0.0, 0.7] if mesh.dimension == 2 else [0.4, -1.1, 0.6]
    ).as_matrix()
    d = mesh.dimension
    return replace(mesh, points=size * (mesh.points @ turn[:d, :d].T + 3.0))


def unmerged(at: np.ndarray) -> np.ndarray:
    return np.zeros(len(at), bool)


def at_middle(at: np.ndarray) -> np.ndarray:
    """Nodes of a seam at x = 1 that are merged: its ends, and all others elsewhere."""
    return (at[:, 0] != 1.0) | (at[:, 1] == 0.0) | (at[:, 1] == 1.0)


TWO = {
    2: (block((0, 0), (1, 1), (4, 4)), block((1, 0), (2, 1), (4, 4))),
    3: (block((0, 0, 0), (1, 1, 1), (2, 4, 2)), block((1, 0, 0), (2, 1, 1), (2, 4, 2))),
}
"""Two blocks side by side, with 4 cells along y, by dimension."""

COARSER = {2: block((1, 0), (2, 1), (2, 2)), 3: block((1, 0, 0), (2, 1, 1), (1, 2, 1))}
"""The second one with half as many cells."""

OFFSET = {2: block((1, 0), (2, 1), (3, 3)), 3: block((1, 0, 0), (2, 1, 1), (1, 3, 3))}
"""The second one with cells that do not match."""


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("d", "doubled"), [(2, 3), (3, 9)])
def test_nodes_that_are_not_merged_are_counted(d, doubled, order, size):
    """Along a part of a seam, in the plane and in space, in both orders, whatever the units and the axes."""
    seam = find_seam(placed(joined(*TWO[d], merge=at_middle), order, size))
    assert seam is not None and seam.hanging == 0
    assert seam.doubled == doubled and seam.within == 0
    assert find_seam(placed(joined(*TWO[d]), order, size)) is None


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("other", [COARSER, OFFSET])
def test_nodes_on_sides_of_other_cells_are_counted(d, other, order, single):
    """T-junctions and sides that do not match: nodes in one place are merged, and the others hang; in files of single
    precision, too."""
    mesh = placed(joined(TWO[d][0], other[d]), order)
    if single:
        mesh = replace(mesh, points=(mesh.points + 50.0).astype(np.float32).astype(float))
    seam = find_seam(mesh)
    expected = {2: {True: 2, False: 5}, 3: {True: 9, False: 11 + 12}}[d][other is COARSER]
    assert seam is not None
    assert (seam.doubled, seam.hanging, seam.within) == (0, expected, 0)
    assert "nodes lie on a side of a cell" in seam.words("a")


@pytest.mark.parametrize("count", [1, 2])
def test_one_side_and_several_are_told_apart(count):
    said = str(Seam(0, count, count, np.zeros(2)).words("a"))
    one = "1 node lies on a side of a cell that has no node there and 1 side of a cell lies within"
    several = (
        "2 nodes lie on a side of a cell that has no node there and 2 sides of cells lie within"
    )
    assert (one in said, several in said) == (count == 1, count == 2)


@pytest.mark.every(5)
@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_parts_that_lie_within_each_other_are_told(d, order, size):
    """Whether they overlap by much or little, or one lies in the other; as many sides whatever the units."""
    one, low, high = block((0,) * d, (1,) * d, (4,) * d), (0.13,) * (d - 1), (0.83,) * (d - 1)
    for depth in (0.5, 0.3, 1e-2, 1e-4, 1e-5):
        other = block((1.0 - depth, *low), (2.0 - depth, *high), (4,) * d)
        seam = find_seam(placed(joined(one, other), order, size))
        assert seam is not None and seam.within >= 4 and seam.doubled == seam.hanging == 0, depth
        assert "sides of cells lie within another cell" in seam.words("a")
    apart = block((1.0 + 1e-5, *low), (2.0, *high), (4,) * d)
    assert find_seam(placed(joined(one, apart), order, size)) is None
    inside = block((0.3,) * d, (0.5,) * d, (2,) * d)
    seam = find_seam(placed(joined(one, inside, merge=unmerged), order, size))
    assert seam is not None and seam.within == {2: 8, 3: 48}[d]
    aligned = block((0.5, *(0.25,) * (d - 1)), (1.5, *(0.75,) * (d - 1)), (4, *(2,) * (d - 1)))
    seam = find_seam(placed(joined(one, aligned, merge=unmerged), order, size))
    assert seam is not None and seam.within >= {2: 6, 3: 40}[d] and seam.doubled == 0


@pytest.mark.parametrize("ending", ["2.2.msh", "4.1.msh", ".med", ".vtk", ".vtu", ".inp"])
def test_seams_are_found_in_every_format(tmp_path, ending):
    """Nodes that are not merged and T-junctions; a file's nodes stay apart as it has them."""
    above = block((0, 1), (1, 2), (4, 4))
    mesh = joined(TWO[2][0], COARSER[2], above, merge=lambda at: at[:, 1] != 1.0)
    ends = mesh.boundary[0][(mesh.points[mesh.boundary[0], 1] == 0.0).all(axis=1)]
    path, at = tmp_path / f"a{ending}", np.pad(mesh.points, ((0, 0), (0, 1)))
    if ending.endswith(".msh"):
        msh(path, 1 + mesh.triangles, 1 + ends, at, ending[:3])
    elif ending == ".inp":
        rows = ["*NODE", *(f"{k}, {x}, {y}" for k, (x, y, _) in enumerate(at.tolist(), 1))]
        rows += ["*ELEMENT, TYPE=CPS3"]
        rows += [f"{k}, {a}, {b}, {c}" for k, (a, b, c) in enumerate(1 + mesh.triangles, 1)]
        rows += ["*NSET, NSET=bottom", *map(str, 1 + np.unique(ends))]
        path.write_text("\n".join(rows) + "\n")
    else:
        tags = [np.full(len(ends), 1), np.full(len(mesh.triangles), 2)]
        written = meshio.Mesh(at, [("line", ends), ("triangle", mesh.triangles)])
        written.cell_data["CellEntityIds"] = tags
        if ending == ".med":
            written.points = mesh.points
            written.cell_data = {"cell_tags": [-tag for tag in tags]}
            written.cell_tags = {-1: ["bottom"], -2: ["all"]}
        written.write(path)
    seam = find_seam(read_mesh(path, "a"))
    # at (1, 1) three nodes lie in one place
    assert seam is not None and (seam.doubled, seam.hanging) == (6, 2)


@pytest.mark.parametrize("d", [2, 3])
def test_bodies_that_only_touch_have_no_seam(d):
    """In a corner, along an edge, and with the corner of one on the face of the other, merged or not."""
    first = block((0,) * d, (1,) * d, (2,) * d)
    corner = block((1,) * d, (2,) * d, (3,) * d)
    edge = block((1, 1, 0)[:d], (2, 2, 1)[:d], (2,) * d)
    turn = np.eye(d)
    turn[:2, :2] = np.array([[1.0, -1.0], [1.0, 1.0]]) / 2**0.5
    tip = replace(first, points=first.points @ turn.T + np.array([0.5, 1.0, 0.0][:d]))
    for other in (corner, edge, tip):
        for merge in (lambda at: np.ones(len(at), bool), unmerged):
            assert find_seam(joined(first, other, merge=merge)) is None


@pytest.mark.parametrize(("gap", "found"), [(1e-8, True), (1e-5, False), (1e-3, False)])
def test_a_narrow_slot_is_no_seam(gap, found):
    """What lies apart by more than a millionth of a side is a gap that was drawn."""
    one, two = TWO[2]
    moved = np.where(np.isclose(two.points[:, :1], 1.0), [[gap, 0.0]], 0.0)
    ends = (two.points[:, 1] == 0.0) | (two.points[:, 1] == 1.0)
    moved[ends] = 0.0
    two = replace(two, points=two.points + moved)
    assert (find_seam(joined(one, two)) is not None) == found


def test_a_crack_that_the_scene_names_on_both_sides_is_no_seam():
    """Contacts or loads on both sides of a cut say that it is meant; on one side alone they do not."""
    mesh = joined(*TWO[2], merge=at_middle)
    facets = mesh.boundary[0]
    lips = facets[np.isclose(mesh.points[facets, 0], 1.0).all(axis=1)]
    up = mesh.points[lips[:, 1], 1] > mesh.points[lips[:, 0], 1]
    mesh = replace(mesh, groups={"one": lips[up], "two": lips[~up]})
    assert find_seam(mesh, ["one", "two"]) is None
    for groups in (["one"], []):
        seam = find_seam(mesh, groups)
        assert seam is not None and seam.doubled == 3


def test_groups_that_are_of_more_than_a_crack_excuse_none():
    """One of the whole boundary, and those of which a side of the seam has the nodes alone."""
    mesh = joined(*TWO[2], merge=at_middle)
    mesh = replace(mesh, groups={"skin": mesh.boundary[0]})
    seam = find_seam(mesh, ["skin"])
    assert seam is not None and seam.doubled == 3
    lips = np.isclose(mesh.points[mesh.boundary[0], 0], 1.0).all(axis=1)
    assert find_seam(replace(mesh, groups={"lips": mesh.boundary[0][lips]}), ["lips"]) is None
    layers = block((0, 0), (1, 0.25), (4, 1)), block((1, 0), (2, 0.25), (4, 1))
    mesh = joined(*layers, merge=lambda at: at[:, 0] != 1.0)
    facets = mesh.boundary[0]
    faces = {
        name: facets[(mesh.points[facets, 1] == y).all(axis=1)]
        for name, y in (("bottom", 0.0), ("top", 0.25))
    }
    seam = find_seam(replace(mesh, groups=faces), faces)
    assert seam is not None and seam.doubled == 2


def test_a_single_node_and_three_in_one_place():
    """One doubled node inside is found; of three nodes in one place two are too many."""
    one, two = TWO[2]
    mesh = joined(one, two, merge=lambda at: (at[:, 0] != 1.0) | (at[:, 1] != 0.5))
    seam = find_seam(mesh)
    assert seam is not None and (seam.doubled, seam.place.tolist()) == (1, [1.0, 0.5])
    assert "1 node lies in one place with another" in seam.words("a")
    whole = block((0, 0), (1, 1), (2, 2))
    cells = [Mesh(whole.points[cell], np.array([[0, 1, 2]]), {}) for cell in whole.triangles]
    middle = joined(*cells, merge=lambda at: ~np.isclose(at, 0.5).all(axis=1))
    seam = find_seam(middle)
    assert (
        seam is not None
        and seam.doubled
        == sum(
            0.5 in cell
            for cell in (
                np.where(np.isclose(cell.points, 0.5).all(axis=1), 0.5, 0.0) for cell in cells
            )
        )
        - 1
    )


def ring(inner: float, outer: float, n: int, span: float, rows: int = 1) -> Mesh:
    """A part of a ring, or all of it, in triangles between circles."""
    angle, whole = span * np.arange(n + 1) / n, span == 2.0 * np.pi
    radius = np.linspace(inner, outer, rows + 1)[:, None, None]
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    k = (n + 1) * np.arange(rows)[:, None] + np.arange(n)
    cells = [[k, k + n + 1, k + n + 2], [k, k + n + 2, k + 1]]
    cells = np.concatenate([np.stack(part, axis=-1).reshape(-1, 3) for part in cells])
    mesh = Mesh((radius * around).reshape(-1, 2), cells, {})
    return joined(mesh) if whole else mesh


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("span", [2.0 * np.pi, np.pi, 0.5])
def test_rings_that_do_not_match_along_a_circle(span, order):
    """Sides along one circle are not merged, though chords are not in one place; nodes in one place may be."""
    apart = joined(ring(0.8, 1.0, 24, span), ring(1.0, 1.2, 36, span), merge=unmerged)
    ends = span != 2.0 * np.pi
    for mesh, doubled in (
        (joined(apart), 0),
        (joined(apart, merge=lambda at: np.abs(at).min(axis=1) > 1e-9), 13 if ends else 12),
        (apart, 13 if ends else 12),
    ):
        seam = find_seam(raise_order(mesh, "", order))
        # where an arc ends its curvature is known less
        assert seam is not None and 36 - 2 * ends <= seam.hanging <= 36
        assert seam.within == 0 and seam.doubled <= doubled


@pytest.mark.parametrize(
    ("solid", "doubled", "hanging"),
    [seldom("Cylinder", 20, 30), seldom("Sphere", 5, 200), ("boss", 0, 0)],
)
def test_drawings_whose_solids_are_not_united(tmp_path, solid, doubled, hanging):
    """A core in its hole, meshed apart and finer, in a plate of one layer of cells as well; a boss that goes a little
    into its plate."""
    place = {"Cylinder": "0, 0, 0, 0, 0, 0.5, 1", "Sphere": "0, 0, 0, 1"}.get(solid)
    draw = f"""SetFactory("OpenCASCADE"); Box(1) = {{-2, -2, 0, 4, 4, 0.5}};
        {solid}(2) = {{{place}}}; {solid}(3) = {{{place}}};
        BooleanDifference{{ Volume{{1}}; Delete; }}{{ Volume{{2}}; Delete; }}
        MeshSize{{ PointsOf{{ Volume{{3}}; }} }} = 0.3;"""
    if solid == "Sphere":
        draw = draw.replace("-2, -2, 0, 4, 4, 0.5", "-2, -2, -2, 4, 4, 4")
    if solid == "boss":
        draw = """SetFactory("OpenCASCADE"); Box(1) = {-2, -2, 0, 4, 4, 0.5};
            Cylinder(3) = {0, 0, 0.49, 0, 0, 1, 0.7};"""
    path = tmp_path / "body.geo"
    groups = 'Physical Volume("body") = {1, 3}; Physical Surface("sides") = Surface{:};'
    path.write_text(f"{draw}\n{groups}\n")
    seam = find_seam(drawn(path, 0.6))
    assert seam is not None and seam.doubled >= doubled and seam.hanging >= hanging
    assert (seam.within > 10) == (solid == "boss")


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("gap", [0.05, 1e-2, 3e-3])
def test_a_slot_along_an_arc_is_no_seam(gap, order):
    """Where it ends in the body, and where it does not; also if it is narrower than chords are off the arc."""
    outer = ring(1.0, 1.2, 36, np.pi)
    for inner in (ring(0.8, 1.0 - gap, 24, np.pi), ring(0.8, 1.0 - gap, 36, np.pi)):
        assert find_seam(raise_order(joined(inner, outer), "", order)) is None
        moved = np.isclose(inner.points[:, 1:], 0.0) & (inner.points[:, :1] > 0.9 - gap)
        ended = replace(inner, points=np.where(moved, [[1.0, 0.0]], inner.points))
        assert find_seam(raise_order(joined(ended, outer), "", order)) is None


@pytest.mark.parametrize("d", [2, 3])
def test_two_copies_of_a_body_are_refused(d):
    """Cells on each other make a body twice as stiff; merged ones are refused when the file is read."""
    mesh = joined(TWO[d][0], TWO[d][0], merge=unmerged)
    with pytest.raises(InputError, match=r"body\.a\.mesh has .* that lie on each other"):
        find_seam(mesh, name="a")


# Hinges


def hinged(mesh: Mesh, clamped=unmerged) -> str:
    """What is said of a mesh that is clamped at some nodes, empty if it holds."""
    free = np.tile(np.eye(mesh.dimension), (len(mesh.points), 1, 1))
    free[clamped(mesh.points)] = 0.0
    whole = 0 if clamped(mesh.points).any() else 3 * (mesh.dimension - 1)
    try:
        refuse_hinges(mesh, "a", free, whole, rigid_motions)
    except InputError as error:
        return str(error)
    return ""


SQUARES = {
    "hinge": [(0, 0), (1, 1)],
    "chain": [(0, 0), (1, 1), (2, 2)],
    "ring of three is rigid": [(0, 0), (1, 1), (2, 0)],
    "side by side": [(0, 0), (1, 0)],
}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("name", "words"),
    [("hinge", "at one node only"), ("chain", "at one node only"), ("side by side", "")],
)
def test_hinges_in_the_plane(name, words, order):
    """Parts that share one node turn about it; the same body clamped in each part holds."""
    mesh = joined(*(block(at, np.add(at, 1), (2, 2)) for at in SQUARES[name]))
    assert words in hinged(raise_order(mesh, "", order)) and bool(hinged(mesh)) == bool(words)
    assert bool(hinged(mesh, lambda at: at[:, 0] == 0.0)) == bool(words)
    assert not hinged(mesh, lambda at: at[:, 1] - np.floor(at[:, 0]) == 0.0)


def test_a_closed_chain_of_hinges_is_rigid_if_it_has_three():
    """Three bars hinged in a triangle hold, four in a square do not."""

    def bar(a, b):
        a, b = np.array(a, float), np.array(b, float)
        side = 0.1 * np.array([[0.0, -1.0], [1.0, 0.0]]) @ (b - a)
        middle = (a + b) / 2
        return Mesh(
            np.array([a, middle - side, b, middle + side]), np.array([[0, 1, 3], [1, 2, 3]]), {}
        )

    def chain(*ends):
        return joined(*(bar(a, b) for a, b in zip(ends, ends[1:] + ends[:1], strict=True)))

    assert not hinged(chain((0, 0), (1, 0), (0, 1)))
    assert "about which it can turn" in hinged(chain((0, 0), (1, 0), (1, 1), (0, 1)))


@pytest.mark.parametrize("order", [1, 2])
def test_hinges_in_space(order):
    """Blocks that share a node or an edge turn; a common face holds; whatever the size and the axes."""
    first = block((0, 0, 0), (1, 1, 1), (2, 2, 2))
    for low, words in (
        ((1, 1, 1), "at one node only"),
        ((1, 1, 0), "along one line of nodes only"),
        ((1, 0, 0), ""),
    ):
        mesh = placed(joined(first, block(low, np.add(low, 1), (2, 2, 2))), order, 1e-3)
        assert words in hinged(mesh) and bool(hinged(mesh)) == bool(words)


def test_a_body_that_touches_itself_in_a_node_is_no_hinge():
    """A ring of squares that meet in a corner is connected around."""
    at = [(i, j) for i in range(4) for j in range(4) if (i, j) not in ((1, 1), (2, 2))]
    mesh = joined(*(block(k, np.add(k, 1), (1, 1)) for k in at))
    assert not hinged(mesh)
