"""Quadratic triangles with curved sides: from files, of annuli, refined."""

import gmsh
import meshio
import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh, kind_of_files
from ddmpi.mesh.elements import facet_measures, facet_shares
from ddmpi.mesh.mesh import Mesh, refuse_folded
from ddmpi.mesh.read import gmsh_session, read_mesh
from ddmpi.mesh.refine import bend, halve, raise_order
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec

INNER, OUTER = 0.5, 1.25


def body(**keys) -> BodySpec:
    return BodySpec(name="ring", mesh=MeshSpec(**keys), material=Material(young=1.0, poisson=0.3))


def annulus(divisions, angles=(0.0, 90.0), center=(0.0, 0.0)) -> Mesh:
    return build_mesh(body(shape="annulus", center=center, radii=(INNER, OUTER), angles=angles, divisions=divisions,
                           order=2))


def radii(mesh: Mesh, group: str) -> np.ndarray:
    return np.linalg.norm(mesh.points[mesh.groups[group]], axis=2)


def length(mesh: Mesh, group: str) -> float:
    return float(facet_measures(mesh.points[mesh.groups[group]]).sum())


def write_ring(path, around: int, linear: bool = False):
    """A quarter of a ring by gmsh, unstructured, of second order, with `around` sides on the inner circle."""
    with gmsh_session():
        geometry, size = gmsh.model.geo, INNER * np.pi / 2 / around
        centre = geometry.addPoint(0.0, 0.0, 0.0)
        points = [geometry.addPoint(*xy, 0.0, size) for xy in ((INNER, 0), (OUTER, 0), (0, OUTER), (0, INNER))]
        lines = {"bottom": geometry.addLine(points[0], points[1]),
                 "outer": geometry.addCircleArc(points[1], centre, points[2]),
                 "left": geometry.addLine(points[2], points[3]),
                 "inner": geometry.addCircleArc(points[3], centre, points[0])}
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(list(lines.values()))])
        geometry.synchronize()
        for name, line in lines.items():
            gmsh.model.addPhysicalGroup(1, [line], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="ring")
        gmsh.option.setNumber("Mesh.SecondOrderLinear", linear)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    return path


def test_second_order_file_keeps_its_curved_sides(tmp_path):
    """The middles of a second-order file stay where they are: on the circles that gmsh was given."""
    path = write_ring(tmp_path / "ring.msh", 6)
    mesh = build_mesh(body(file=str(path), order=2))
    assert radii(mesh, "inner") == pytest.approx(INNER, rel=1e-12)
    assert radii(mesh, "outer") == pytest.approx(OUTER, rel=1e-12)
    on_circles = np.concatenate([mesh.groups[name][:, 2] for name in ("inner", "outer")])
    touching = np.flatnonzero(np.isin(mesh.triangles[:, 3:], on_circles).any(axis=1))
    assert np.array_equal(mesh.curved, touching) and 0 < len(touching) < len(mesh.triangles)
    assert mesh.measures().sum() == pytest.approx(np.pi / 4 * (OUTER**2 - INNER**2), rel=1e-5)
    assert length(mesh, "inner") == pytest.approx(np.pi / 2 * INNER, rel=1e-5)


def test_order_one_keeps_the_corners_of_a_curved_file(tmp_path):
    """A second-order file solved with linear elements gives its corners, whether its sides are curved or not."""
    path = write_ring(tmp_path / "ring.msh", 6)
    linear, quadratic = (build_mesh(body(file=str(path), order=order)) for order in (1, 2))
    assert kind_of_files(tmp_path / "scene.toml")(body(file=str(path))) == (2, 2)
    assert linear.order == 1 and len(linear.curved) == 0
    assert np.array_equal(linear.points, quadratic.points[:len(linear.points)])
    assert np.array_equal(linear.triangles, quadratic.triangles[:, :3])


def test_straight_second_order_file_is_that_of_first_order(tmp_path):
    """Straight second-order elements are the same to the last bit as those made from their corners, refined or not."""
    path = write_ring(tmp_path / "ring.msh", 6, linear=True)
    read, raised = read_mesh(path, "ring", 2), raise_order(read_mesh(path, "ring"), "mesh")
    halved = raise_order(halve(read_mesh(path, "ring"), "mesh"), "mesh")
    for ours, theirs in ((read, raised), (halve(read, "mesh"), halved)):
        assert np.array_equal(ours.points, theirs.points) and np.array_equal(ours.triangles, theirs.triangles)
        assert all(np.array_equal(ours.groups[name], theirs.groups[name]) for name in theirs.groups)
        assert len(ours.curved) == 0


def test_turned_triangles_keep_their_middles(tmp_path):
    """A file whose triangles run clockwise has its curved sides where they belong."""
    mesh = build_mesh(body(file=str(write_ring(tmp_path / "ring.msh", 4)), order=2))
    raw = meshio.read(tmp_path / "ring.msh")
    turned = [(block.type, block.data[:, [0, 2, 1, 5, 4, 3]] if block.type == "triangle6" else block.data)
              for block in raw.cells]
    meshio.write(tmp_path / "turned.msh", meshio.Mesh(raw.points, turned, cell_data=raw.cell_data,
                                                      field_data=raw.field_data), file_format="gmsh22", binary=False)
    other = read_mesh(tmp_path / "turned.msh", "ring", 2)
    assert other.measures() == pytest.approx(mesh.measures(), rel=1e-12)


def evaluated(mesh: Mesh, barycentric: np.ndarray) -> np.ndarray:
    return mesh.map(np.arange(len(mesh.triangles)), barycentric).places


def test_halving_follows_the_map_of_the_triangles(tmp_path):
    """A halved curved mesh has its nodes where the isoparametric map of the coarse one has them, and the same area."""
    coarse = build_mesh(body(file=str(write_ring(tmp_path / "ring.msh", 3)), order=2))
    fine = halve(coarse, "mesh")
    corners = np.eye(3)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    parts = [[corners[0], middles[0], middles[2]], [middles[0], corners[1], middles[1]],
             [middles[2], middles[1], corners[2]], middles]
    for k, part in enumerate(np.array(parts)):
        nodes = np.vstack([part, (part + np.roll(part, -1, axis=0)) / 2])
        assert fine.points[fine.triangles[k::4]].swapaxes(0, 1) == pytest.approx(evaluated(coarse, nodes), abs=1e-15)
    assert fine.measures().sum() == pytest.approx(coarse.measures().sum(), rel=1e-13)
    assert length(fine, "inner") == pytest.approx(length(coarse, "inner"), rel=1e-8)
    asked = build_mesh(body(file=str(tmp_path / "ring.msh"), order=2, refine=1))
    assert np.array_equal(asked.points, fine.points) and np.array_equal(asked.triangles, fine.triangles)


@pytest.mark.parametrize("angles", [(0.0, 90.0), (0.0, 360.0), (-30.0, 47.0), (100.0, 460.0)])
def test_annulus_is_curved(angles):
    """The nodes of an annulus of order 2 lie on its circles, also where a ring closes; radial sides stay straight."""
    mesh = annulus((7, 3), angles)
    distance = np.linalg.norm(mesh.points, axis=1)
    assert distance == pytest.approx((OUTER - INNER) / 6 * np.round((distance - INNER) / (OUTER - INNER) * 6) + INNER,
                                     rel=1e-14)
    assert len(mesh.curved) == len(mesh.triangles)
    radial = np.abs(np.ptp(distance[mesh.triangles[:, mesh.cell.edges[:, :2]]], axis=2) - (OUTER - INNER) / 3) < 1e-12
    bent = mesh.cell.bends(mesh.points[mesh.triangles]).any(axis=2)
    assert np.count_nonzero(~bent) == 3 * 7 * 2 and radial[~bent].all()
    assert mesh.measures().min() > 0.0
    span = np.radians(angles[1] - angles[0])
    assert mesh.measures().sum() == pytest.approx(span / 2 * (OUTER**2 - INNER**2), rel=(span / 7)**4 / 400)


def test_annulus_approaches_the_circles():
    """Areas and lengths of an annulus of order 2 are right to the fourth power of the size of its cells."""
    exact = np.pi / 4 * (OUTER**2 - INNER**2), np.pi / 2 * OUTER
    errors = []
    for n in (4, 8, 16):
        mesh = annulus((n, n // 2))
        errors.append((mesh.measures().sum() - exact[0], length(mesh, "outer") - exact[1]))
    rates = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
    assert rates == pytest.approx(np.full((2, 2), 4.0), abs=0.1)


def test_coarse_rings_do_not_fold():
    """As few cells as a ring may have are mapped one to one, however thin or thick the ring is."""
    for around, angles in ((3, (0.0, 360.0)), (1, (0.0, 170.0))):
        for inner in (0.02, 0.5, 0.99):
            mesh = build_mesh(body(shape="annulus", center=(0.0, 0.0), radii=(inner, 1.0), angles=angles,
                                   divisions=(around, 2), order=2))
            assert len(mesh.curved) == len(mesh.triangles)


def test_folded_triangle_is_refused():
    """A triangle whose side is bent beyond its opposite corner is refused with its place."""
    square = body(shape="rectangle", size=(1.0, 1.0), divisions=(1, 1), order=2)
    bends = np.zeros((2, 3, 2))
    bends[0, 0] = (0.0, 0.6)  # the bottom, up into the lower triangle
    mesh = build_mesh(square)
    refuse_folded(bend(mesh, bends / 4), "mesh")
    with pytest.raises(InputError, match=r"body\.ring\.mesh: the curved triangle at \(0\.\d+, 0\.\d+\) folds"):
        refuse_folded(bend(mesh, bends), "body.ring.mesh")


def test_shares_of_a_curved_side():
    """Integrals of the shape functions along a parabola agree with many short chords, and add up to its length."""
    side = np.array([[0.0, 0.0], [1.0, 0.2], [0.55, 0.4]])
    t = np.linspace(0.0, 1.0, 200001)
    phi = np.column_stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)])
    steps = np.linalg.norm(np.diff(phi @ side, axis=0), axis=1)
    shares = facet_shares(side[None])[0]
    assert shares == pytest.approx(steps @ (phi[1:] + phi[:-1]) / 2, rel=2e-4)
    assert shares.sum() == pytest.approx(facet_measures(side[None])[0], rel=1e-14)
