"""Quadratic triangles with curved sides: from files, of annuli, refined."""

import meshio
import numpy as np
import pytest
from test_formats import write_ring

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, refuse_folded
from ddmpi.mesh.read import read_mesh
from ddmpi.mesh.refine import bend
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec

INNER, OUTER = 0.5, 1.25


def body(**keys) -> BodySpec:
    return BodySpec(name="ring", mesh=MeshSpec(**keys), material=Material(young=1.0, poisson=0.3))


def annulus(divisions, angles=(0.0, 90.0), center=(0.0, 0.0)) -> Mesh:
    return build_mesh(body(shape="annulus", center=center, radii=(INNER, OUTER), angles=angles, divisions=divisions,
                           order=2))


def test_turned_triangles_keep_their_middles(tmp_path):
    """A file whose triangles run clockwise has its curved sides where they belong."""
    path = write_ring(tmp_path, "triangle", 2, "msh 2.2")
    mesh, raw = read_mesh(path, "ring", 2), meshio.read(path)
    turned = [(block.type, block.data[:, [0, 2, 1, 5, 4, 3]] if block.type == "triangle6" else block.data)
              for block in raw.cells]
    meshio.write(tmp_path / "turned.msh", meshio.Mesh(raw.points, turned, cell_data=raw.cell_data,
                                                      field_data=raw.field_data), file_format="gmsh22", binary=False)
    other = read_mesh(tmp_path / "turned.msh", "ring", 2)
    assert other.measures() == pytest.approx(mesh.measures(), rel=1e-12)


@pytest.mark.parametrize("angles", [(-30.0, 47.0), (0.0, 360.0)])
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
