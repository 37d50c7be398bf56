"""Files of solids: tetrahedra, other cells that are cut into them, groups, curves and points, both orders, halves."""

from collections.abc import Callable
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from scipy.spatial import KDTree

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import CELLS, facet_measures
from ddmpi.mesh.mesh import Mesh, boundary_facets, signed_measures
from ddmpi.mesh.read import file_kind, gmsh_session
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, PartMaterial, Traction

RADII, HEIGHT = (0.5, 1.0), 0.75
SURFACE = np.pi / 2 * RADII[1] * HEIGHT
VOLUME = np.pi / 4 * (RADII[1]**2 - RADII[0]**2) * HEIGHT


def body(path: Path, order=None, refine=0, **keys) -> BodySpec:
    return BodySpec(name="ring", mesh=MeshSpec(file=str(path), order=order, refine=refine),
                    **{"material": Material(young=1.0, poisson=0.3)} | keys)


def write(path: Path, draw: Callable, version: float = 4.1, order: int = 1, **options) -> Path:
    """A mesh that gmsh makes of what `draw` draws."""
    with gmsh_session():
        for option, value in {"Mesh.MshFileVersion": version, "Mesh.MeshSizeMax": 0.3,
                              **{f"Mesh.{key}": value for key, value in options.items()}}.items():
            gmsh.option.setNumber(option, value)
        draw()
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    return path


def ring(cells: str = "tetrahedra") -> None:
    """A quarter of a tube, its inner half another volume; structured unless of tetrahedra."""
    geo, structured = gmsh.model.geo, cells != "tetrahedra"
    centre = geo.addPoint(0.0, 0.0, 0.0)
    ends = [(geo.addPoint(r, 0.0, 0.0), geo.addPoint(0.0, r, 0.0)) for r in (RADII[0], 0.75, RADII[1])]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in ends]
    volumes, faces = [], {"bottom": [], "top": []}
    for k in (0, 1):
        (a, b), (c, d) = ends[k:k + 2]
        lines = [geo.addLine(a, c), geo.addLine(b, d)]
        base = geo.addPlaneSurface([geo.addCurveLoop([lines[0], arcs[k + 1], -lines[1], -arcs[k]])])
        if structured:
            for curve, number in ((arcs[k], 7), (arcs[k + 1], 7), (lines[0], 3), (lines[1], 3)):
                geo.mesh.setTransfiniteCurve(curve, number)
            geo.mesh.setTransfiniteSurface(base)
            if cells == "hexahedra":
                geo.mesh.setRecombine(2, base)
        out = geo.extrude([(2, base)], 0.0, 0.0, HEIGHT, [3] if structured else [], recombine=structured)
        faces["bottom"].append(base)
        faces["top"].append(out[0][1])
        volumes.append(out[1][1])
        if k:  # sides in the order of the loop
            faces |= {"outer": [out[3][1]]}
    geo.synchronize()
    for name, tags in faces.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(1, [arcs[2]], name="rim")
    gmsh.model.addPhysicalGroup(0, [ends[2][0]], name="heel")
    for tag, name in zip(volumes, ("soft", "hard"), strict=True):
        gmsh.model.addPhysicalGroup(3, [tag], name=name)


def check(mesh: Mesh) -> None:
    """All cells are positive, they match, and groups are on the boundary."""
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all()
    facets = np.sort(mesh.corners[:, CELLS[3, 1].facets].reshape(-1, 3), axis=1)
    assert np.unique(facets, axis=0, return_counts=True)[1].max() == 2
    for name, group in mesh.groups.items():
        assert len(mesh.facets(name).nodes) == len(group)
    outer = boundary_facets(mesh.triangles)[0]
    closed = np.sort(outer[:, CELLS[2, 1].edges].reshape(-1, 2), axis=1)
    assert (np.unique(closed, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cells", ["tetrahedra", "prisms", "hexahedra"])
def test_solids_of_a_file(tmp_path, cells, order, version):
    """A file's tetrahedra, or what its hexahedra and prisms are cut into, fill the body; curved in order 2."""
    path = write(tmp_path / "ring.msh", lambda: ring(cells), version, order)
    mesh = build_mesh(body(path, order, clamp=["bottom", "rim", Clamp(on="heel", z=0.0)]))
    assert file_kind(path, "ring") == (3, order)
    assert (mesh.dimension, mesh.order) == (3, order)
    assert mesh.cut == {"tetrahedra": 0, "prisms": 144, "hexahedra": 72}[cells]
    check(mesh)
    close = {1: 2e-2, 2: 3e-4}[order]
    assert mesh.measures().sum() == pytest.approx(VOLUME, rel=close)
    assert facet_measures(mesh.points[mesh.groups["outer"]]).sum() == pytest.approx(SURFACE, rel=close)
    outer = mesh.points[mesh.groups["outer"]]
    assert np.hypot(outer[..., 0], outer[..., 1]) == pytest.approx(RADII[1], abs=1e-9 if order == 1 else 1e-3)
    assert mesh.points[mesh.groups["top"]][..., 2] == pytest.approx(HEIGHT, rel=1e-12)
    parts = {name: mesh.measures()[own].sum() for name, own in mesh.surfaces.items()}
    assert sum(parts.values()) == pytest.approx(mesh.measures().sum(), rel=1e-12) and parts.keys() == {"soft", "hard"}
    assert parts["hard"] / parts["soft"] == pytest.approx((1 - 0.75**2) / (0.75**2 - 0.5**2), rel=close)
    rim = mesh.points[mesh.nodes_of("rim")]
    assert np.hypot(*rim[:, :2].T) == pytest.approx(RADII[1]) and np.ptp(rim[:, 2]) == 0.0
    assert len(rim) == order * len(mesh.curves["rim"]) + 1
    assert mesh.points[mesh.nodes_of("heel")] == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


@pytest.mark.parametrize("cells", ["prisms", "hexahedra"])
def test_elements_without_middles_of_faces_are_cut_alike(tmp_path, cells):
    """Elements of second order without nodes on faces, and those with them, give the same mesh."""
    one, two = (build_mesh(body(write(tmp_path / f"{number}.msh", lambda: ring(cells), order=2,
                                      SecondOrderIncomplete=number), 2)) for number in (0, 1))
    assert np.array_equal(one.corners, two.corners)
    assert one.points == pytest.approx(two.points, abs=1e-12)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("suffix", [".inp", ".vtu", ".med"])
def test_solids_of_other_programs(tmp_path, suffix, order):
    """Sets of nodes (Abaqus) are the facets between them, or else the edges, or else the nodes."""
    if suffix == ".med":
        pytest.importorskip("h5py")
    raw = meshio.gmsh.read(write(tmp_path / "ring.msh", lambda: ring("hexahedra"), order=order,
                                 SecondOrderIncomplete=1))
    kind = ("hexahedron", "hexahedron20")[order - 1]
    expected = build_mesh(body(tmp_path / "ring.msh", order))
    number, path = np.hypot(*raw.points[:, :2].T), tmp_path / f"other{suffix}"
    if suffix == ".inp":
        low = raw.points[:, 2] == 0.0
        sets = {"outer": np.abs(number - 1.0) < 1e-9, "bottom": low, "rim": low & (np.abs(number - 1.0) < 1e-9),
                "heel": low & (np.abs(raw.points[:, 0] - 1.0) < 1e-9)}
        lines = ["*NODE", *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(raw.points.tolist(), 1)),
                 f"*ELEMENT, TYPE={('C3D8R', 'C3D20R')[order - 1]}, ELSET=whole"]
        for k, nodes in enumerate(raw.cells_dict[kind].tolist(), 1):
            words = [str(k), *(str(1 + node) for node in nodes)]
            lines += [", ".join(words[:11]) + "," * (len(words) > 11), ", ".join(words[11:])][:1 + (len(words) > 11)]
        for name, own in sets.items():
            lines += [f"*NSET, NSET={name}", *(f"{1 + node}," for node in np.flatnonzero(own))]
        path.write_text("\n".join(lines) + "\n")
    else:
        blocks = [(each, raw.cells_dict[each]) for each in (kind, ("quad", "quad8")[order - 1])]
        tags = [np.zeros(len(blocks[0][1]), int), raw.cell_data_dict["gmsh:physical"][blocks[1][0]]]
        name = {".vtu": "CellEntityIds", ".med": "cell_tags"}[suffix]
        meshio.Mesh(raw.points, blocks, cell_data={name: tags}).write(path)
    mesh = build_mesh(body(path, order))
    check(mesh)
    assert (file_kind(path, "ring"), mesh.cut) == ((3, order), 72)
    assert mesh.measures().sum() == pytest.approx(expected.measures().sum(), rel=1e-10)
    if suffix == ".inp":
        for group in ("outer", "bottom"):
            assert len(mesh.groups[group]) == len(expected.groups[group])
        assert len(mesh.curves["rim"]) == 6 and mesh.vertices.keys() == {"heel"}
    else:
        sizes = sorted(facet_measures(mesh.points[group]).sum() for group in mesh.groups.values())
        assert sizes == pytest.approx(sorted(facet_measures(expected.points[group]).sum()
                                             for group in expected.groups.values()), rel=1e-10)


PYRAMID = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1],
                    [.5, .5, .5]])


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("mirrored", [False, True])
def test_pyramids_are_cut(tmp_path, order, mirrored):
    """Six pyramids make a cube, whichever way their corners run; its facets are cut from their smallest nodes."""
    bases = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    cells = np.array([[*(base[::-1] if mirrored else base), 8] for base in bases])
    quads = np.array(bases)
    points, kinds = PYRAMID.astype(float), {"pyramid": cells, "quad": quads}
    if order == 2:
        ends = np.unique(np.sort(np.concatenate([cells[:, [a, b]] for a, b in (
            (0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))]), axis=1), axis=0)
        middle = {tuple(pair): 9 + k for k, pair in enumerate(ends.tolist())}
        points = np.concatenate([points, points[ends].mean(axis=1)])
        kinds = {f"{kind}{number}": np.array([[*row, *(middle[tuple(sorted((row[a], row[b])))] for a, b in pairs)]
                                              for row in rows.tolist()])
                 for kind, number, rows, pairs in (
                     ("pyramid", 13, cells, ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))),
                     ("quad", 8, quads, ((0, 1), (1, 2), (2, 3), (3, 0))))}
    tags = [np.full(6, 7), np.arange(1, 7)]
    path = tmp_path / "cube.vtu"
    meshio.Mesh(points, list(kinds.items()), cell_data={"CellEntityIds": tags}).write(path)
    mesh = build_mesh(body(path, order))
    check(mesh)
    assert (mesh.cut, len(mesh.triangles), len(mesh.curved)) == (6, 12, 0)
    assert mesh.measures().sum() == pytest.approx(1.0, rel=1e-14)
    assert {name: facet_measures(mesh.points[group]).tolist() for name, group in mesh.groups.items()} == \
        {str(k): pytest.approx([0.5, 0.5]) for k in range(1, 7)}
    for k, base in enumerate(bases, 1):  # the node of least number is in both triangles
        assert (mesh.points[mesh.groups[str(k)]] == PYRAMID[min(base)]).all(axis=2).any(axis=1).all()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cells", ["tetrahedra", "hexahedra"])
def test_halved_solid(tmp_path, cells, order):
    """Every edge is halved: eight tetrahedra for one, four facets, two lines; curved where the coarse map has them."""
    path = write(tmp_path / "ring.msh", lambda: ring(cells), order=order)
    coarse, fine = (build_mesh(body(path, order, refine)) for refine in (0, 1))
    check(fine)
    assert len(fine.triangles) == 8 * len(coarse.triangles) and fine.cut == coarse.cut
    assert fine.measures().reshape(-1, 8).sum(axis=1) == pytest.approx(coarse.measures(), rel=1e-12)
    for name, own in coarse.groups.items():
        found = facet_measures(fine.points[fine.groups[name]]).reshape(4, -1).sum(axis=0)
        assert found == pytest.approx(facet_measures(coarse.points[own]), rel=1e-7)
    assert len(fine.nodes_of("rim")) == 2 * len(coarse.nodes_of("rim")) - 1
    for name, own in coarse.surfaces.items():
        assert np.array_equal(np.unique(fine.surfaces[name] // 8), own)
    quality = [signed_measures(mesh.points, mesh.triangles) / np.linalg.norm(
        np.diff(mesh.points[mesh.corners][:, [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]], axis=2),
        axis=3).max(axis=(1, 2))**3 for mesh in (coarse, fine)]
    assert quality[1].min() > 0.4 * quality[0].min()
    if order == 2:
        places = coarse.map(slice(None), _lattice()).places.reshape(-1, 3)
        assert KDTree(places).query(fine.points)[0].max() <= 1e-12


def _lattice() -> np.ndarray:
    """Barycentric coordinates of all points of a tetrahedron whose edges are divided into four."""
    return np.array([(a, b, c, 4 - a - b - c) for a in range(5) for b in range(5 - a) for c in range(5 - a - b)]) / 4


def test_what_groups_of_solids_may_name(tmp_path):
    """Clamps may name surfaces, curves and points; loads only surfaces; materials only volumes."""
    path = write(tmp_path / "ring.msh", ring)

    def refused(**keys) -> str:
        with pytest.raises(InputError) as error:
            build_mesh(body(path, **keys))
        return str(error.value)

    assert refused(traction=[Traction(on="rim", pressure=1.0)]) == (
        "body.ring.traction: 'rim' is a physical curve of the mesh, which only a clamp may name; where a force acts on "
        "it, the displacement has no limit as the mesh gets finer")
    assert "'heel' is a physical point of the mesh" in refused(traction=[Traction(on="heel", pressure=1.0)])
    assert "'soft' is a physical volume of the mesh, not a boundary group" in refused(clamp=["soft"])
    assert refused(clamp=["botom"]).startswith("body.ring.clamp: the mesh has no boundary group 'botom'; did you mean "
                                               "'bottom'?")
    part = {"young": 1.0, "poisson": 0.3}
    assert "the mesh has no physical volume 'top'" in refused(material=[PartMaterial(on="top", **part)])
    assert "in the physical volume 'hard', has no material" in refused(material=[PartMaterial(on="soft", **part)])
    mesh = build_mesh(body(path))
    assert len(mesh.facets("bottom").nodes) and len(np.unique(mesh.surfaces["soft"]))
    twice = Mesh(mesh.points, mesh.triangles, {"rim": mesh.groups["top"]}, curves=mesh.curves)
    assert np.array_equal(twice.nodes_of("rim"), np.union1d(mesh.groups["top"], mesh.curves["rim"]))
    with pytest.raises(InputError, match="the mesh is in space, and the scene is in the plane"):
        build_mesh(body(path), dimension=2)


def test_a_surface_in_space_is_refused(tmp_path):
    """A file of triangles that are not in a plane is no solid, and the message says what lacks."""
    def sphere() -> None:
        gmsh.model.occ.addSphere(0.0, 0.0, 0.0, 1.0)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="skin")

    with pytest.raises(InputError, match=r"is not plane \(its z coordinates differ\), and has no tetrahedra; a solid "
                                         r'needs its cells: Physical Volume\("body"\)'):
        build_mesh(body(write(tmp_path / "sphere.msh", sphere)))


def test_overlapping_tetrahedra_are_refused(tmp_path):
    """A node of a box that lies across its neighbours, as in a mesh that was moved."""
    path = write(tmp_path / "ring.msh", ring)
    raw = meshio.gmsh.read(path)
    faces = np.concatenate([data for kind, data in raw.cells_dict.items() if kind == "triangle"])
    inner = np.setdiff1d(raw.cells_dict["tetra"], faces)[0]
    raw.points[inner, 2] += 3.0
    raw.write(tmp_path / "ring.vtu")
    with pytest.raises(InputError, match=r"has tetrahedra that overlap at \(.*: the mesh folds there"):
        build_mesh(body(tmp_path / "ring.vtu"))


def test_folded_tetrahedra_are_refused(tmp_path):
    """A file whose middles are on the wrong edges is refused."""
    path = write(tmp_path / "ring.msh", ring, 2.2, 2)
    raw = meshio.gmsh.read(path)
    raw.cells_dict["tetra10"][:, [4, 5]] = raw.cells_dict["tetra10"][:, [5, 4]]
    blocks = [(each.type, each.data[:, [0, 1, 2, 3, 5, 4, 6, 7, 8, 9]] if each.type == "tetra10" else each.data)
              for each in raw.cells if each.type != "vertex"]
    tags = [np.full(len(data), k) for k, (_, data) in enumerate(blocks)]
    meshio.Mesh(raw.points, blocks, cell_data={"CellEntityIds": tags}).write(tmp_path / "ring.vtu")
    with pytest.raises(InputError, match=r"the curved tetrahedron at .* folds"):
        build_mesh(body(tmp_path / "ring.vtu", 2))
