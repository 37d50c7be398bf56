"""Mesh files: one body by every kind of cell, format and order; and what Abaqus's inputs say."""

from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from scenes import seldom
from scipy.spatial import KDTree
from test_mesh import NAMES, SQUARE, refused

from ddmpi.body.loads import supports
from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh, kind_of_files
from ddmpi.mesh.elements import BRICKS, facet_measures
from ddmpi.mesh.mesh import Mesh, boundary_facets, signed_measures
from ddmpi.mesh.read import file_kind, gmsh_session, read_mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, PartMaterial, Traction
from meshes import area, body_of

# One shape by all formats: a quarter of a ring of two materials, in space of a tube

RADII, HEIGHT = (0.5, 0.75, 1.0), 0.75

DIMENSION = {"triangle": 2, "quad": 2, "tetra": 3, "wedge": 3, "hexahedron": 3}

CUT = {"triangle": 0, "quad": 0, "tetra": 0, "wedge": 144, "hexahedron": 0}
"""How many cells are cut into simplices."""

GMSH = {
    "msh 1": (1.0, False),
    "msh 2.2": (2.2, False),
    "binary msh 2.2": (2.2, True),
    "msh 4": (4.0, False),
    "msh 4.1": (4.1, False),
    "binary msh 4.1": (4.1, True),
}
"""Versions of gmsh's format; meshio reads neither 1 nor 4."""

NUMBERS = {
    "outer": "1",
    "bottom": "2",
    "around": "3",
    "heel": "5",
    "soft": "8",
    "hard": "9",
    "all": "10",
    "centre": "6",
}
"""What groups are called where a format has no names."""

TYPES = {
    ("triangle", 1): "CPS3",
    ("triangle", 2): "CPE6M",
    ("quad", 1): "CPS4R",
    ("quad", 2): "CPS8",
    ("tetra", 1): "C3D4",
    ("tetra", 2): "C3D10",
    ("wedge", 1): "C3D6",
    ("wedge", 2): "C3D15",
    ("hexahedron", 1): "C3D8R",
    ("hexahedron", 2): "C3D20R",
}
"""Abaqus's names of elements."""


def draw_ring(cells: str) -> None:
    """The shape in gmsh, structured unless of simplices, with its groups: `outer` at the largest radius, `bottom` at
    y = 0, in space z = 0, `around` both; `soft` within `hard`, `all` of both; the point `heel`, and `centre`, which no
    cell has; in space the curve `rim`."""
    geo, solid, structured = (
        gmsh.model.geo,
        DIMENSION[cells] == 3,
        cells not in ("triangle", "tetra"),
    )
    centre = geo.addPoint(0.0, 0.0, 0.0)
    ends = [(geo.addPoint(r, 0.0, 0.0), geo.addPoint(0.0, r, 0.0)) for r in RADII]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in ends]
    parts, outer, bottom = [], arcs[2], []
    for k in (0, 1):
        (a, b), (c, d) = ends[k : k + 2]
        lines = geo.addLine(a, c), geo.addLine(b, d)
        surface = geo.addPlaneSurface(
            [geo.addCurveLoop([lines[0], arcs[k + 1], -lines[1], -arcs[k]])]
        )
        if structured:
            for curve, number in ((arcs[k], 7), (arcs[k + 1], 7), (lines[0], 3), (lines[1], 3)):
                geo.mesh.setTransfiniteCurve(curve, number)
            geo.mesh.setTransfiniteSurface(surface)
            if cells != "wedge":
                geo.mesh.setRecombine(2, surface)
        if solid:
            out = geo.extrude(
                [(2, surface)], 0.0, 0.0, HEIGHT, [3] if structured else [], recombine=structured
            )
            outer = out[3][1]  # sides follow in the order of the loop
        parts.append(out[1][1] if solid else surface)
        bottom.append(surface if solid else lines[0])
    geo.synchronize()
    d = DIMENSION[cells]
    groups = [
        (d - 1, [outer], "outer"),
        (d - 1, bottom, "bottom"),
        (d - 1, [outer, *bottom], "around"),
        (d, parts[:1], "soft"),
        (d, parts[1:], "hard"),
        (d, parts, "all"),
        (0, [ends[2][0]], "heel"),
        (0, [centre], "centre"),
    ]
    for dimension, tags, name in groups + [(1, [arcs[2]], "rim")] * solid:
        gmsh.model.addPhysicalGroup(dimension, tags, int(NUMBERS.get(name, 4)), name)


def write_ring(
    folder: Path, cells: str, order: int, form: str = "msh 4.1", incomplete: int = 1
) -> Path:
    """A file of the shape; elements of order 2 have no nodes in the middle of quadrilaterals if `incomplete`."""
    suffix = next(word for word in ("msh", "inp", "vtu", "vtk", "med") if word in form)
    path, d = folder / f"ring.{suffix}", DIMENSION[cells]
    version, binary = GMSH.get(form, (4.1, False))
    with gmsh_session():
        for option, value in (
            ("MeshSizeMax", 0.3),
            ("SecondOrderIncomplete", incomplete),
            ("MshFileVersion", version),
            ("Binary", binary),
            ("SaveGroupsOfNodes", 1),
        ):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        draw_ring(cells)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path if "gmsh" in form else path.with_suffix(".msh")))
    if form in GMSH or "gmsh" in form:
        return path
    raw = meshio.gmsh.read(path.with_suffix(".msh"))
    kinds = sorted(
        {block.type for block in raw.cells if block.dim in (d - 1, d)},
        key=list(raw.cells_dict).index,
    )[::-1]
    tags = [raw.cell_data_dict["gmsh:physical"][kind] for kind in kinds]
    if form == "inp":
        return write_sets(path, raw.points, raw.cells_dict[kinds[0]], TYPES[cells, order], tags[0])
    written = meshio.Mesh(raw.points, [(kind, raw.cells_dict[kind]) for kind in kinds])
    if (
        form == "med"
    ):  # names are padded with blanks, a family of cells belongs to several groups, a group has several
        written.cell_data["cell_tags"] = [-number for number in tags]
        written.cell_tags = {
            -int(NUMBERS[name]): [f"{name:<80}", *(group.ljust(80, "\0") for group in more)]
            for name, more in (
                ("outer", ["around"]),
                ("bottom", ["around"]),
                ("soft", ["all"]),
                ("hard", ["all"]),
            )
        }
        written.point_data["point_tags"] = 5 * (raw.points == [1.0, 0.0, 0.0]).all(axis=1)
        written.point_tags = {5: [f"{'heel':<80}"]}
    else:
        written.cell_data["CellEntityIds"] = tags
    written.write(path)
    return path


def write_sets(
    path: Path, points: np.ndarray, elements: np.ndarray, kind: str, parts: np.ndarray
) -> Path:
    """An input of Abaqus: materials as sets of elements, boundaries as sets of nodes, which name no facets."""
    low = points[:, 2 if np.ptp(points[:, 2]) else 1] == 0.0
    outer = np.abs(np.hypot(*points[:, :2].T) - RADII[-1]) < 1e-9
    sets = {
        "outer": outer,
        "bottom": low,
        "heel": outer & (points[:, 1] == 0.0) & (points[:, 2] == 0.0),
    }
    sets |= {"rim": outer & low} if kind.startswith("C3D") else {}
    lines = [
        "*NODE",
        *(f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1)),
    ]
    for name in ("soft", "hard"):
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
        for k in np.flatnonzero(parts == int(NUMBERS[name])):
            words = [str(k + 1), *(str(1 + node) for node in elements[k])]
            lines += [
                ", ".join(words[:11]) + "," * (len(words) > 11),
                *[", ".join(words[11:])] * (len(words) > 11),
            ]
    for name, members in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{1 + node}," for node in np.flatnonzero(members))]
    path.write_text("\n".join(lines) + "\n")
    return path


def ring(
    path: Path, order: int | None = None, refine: int = 0, cut: bool = False, **keys
) -> BodySpec:
    return BodySpec(
        name="ring",
        mesh=MeshSpec(file=str(path), order=order, refine=refine, cut=cut),
        **{"material": Material(young=1.0, poisson=0.3)} | keys,
    )


def check(mesh: Mesh) -> None:
    """All cells are positive, they match, the boundary is closed, and groups are on it."""
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all()
    d = mesh.dimension
    facets = np.sort(
        mesh.corners[:, mesh.cell.straight.facets].reshape(-1, mesh.cell.facet.corners), axis=1
    )
    assert np.unique(facets, axis=0, return_counts=True)[1].max() == 2
    for name, group in mesh.groups.items():
        assert len(mesh.facets(name).nodes) == len(group)
    outer = boundary_facets(mesh.triangles, d)[0]
    ends = (
        np.sort(outer[:, mesh.cell.facet.straight.edges].reshape(-1, 2), axis=1)
        if d == 3
        else outer[:, :2].reshape(-1, 1)
    )
    assert (np.unique(ends, axis=0, return_counts=True)[1] == 2).all()


def check_ring(mesh: Mesh, form: str) -> None:
    """Measures are those of the ring, with curved sides nearly exactly; groups, materials, curves, points are named."""
    check(mesh)
    d, close = mesh.dimension, {1: 2e-2, 2: 3e-4}[mesh.order]
    height, (inner, middle, outer) = HEIGHT if d == 3 else 1.0, RADII
    areas = np.pi / 4 * np.array([middle**2 - inner**2, outer**2 - middle**2])
    sizes = {
        "soft": areas[0] * height,
        "hard": areas[1] * height,
        "outer": np.pi / 2 * outer * height,
        "bottom": areas.sum() if d == 3 else outer - inner,
    }
    sizes["around"] = sizes["outer"] + sizes["bottom"]
    names = NUMBERS if form in ("msh 1", "vtu", "vtk") else {name: name for name in NUMBERS}
    sizes["all"], named = (
        sizes["soft"] + sizes["hard"],
        form in GMSH or form in ("med", "inp by gmsh"),
    )
    groups = ["outer", "bottom"] + ["around"] * named
    parts = (
        ["soft", "hard"] + ["all"] * named if form != "msh 1" else []
    )  # which has boundaries only
    found = {
        name: facet_measures(mesh.points[facets]).sum() for name, facets in mesh.groups.items()
    }
    assert found == pytest.approx({names[name]: sizes[name] for name in groups}, rel=close)
    found = {name: mesh.measures()[cells].sum() for name, cells in mesh.surfaces.items()}
    assert found == pytest.approx({names[name]: sizes[name] for name in parts}, rel=close)
    assert mesh.measures().sum() == pytest.approx(sizes["all"], rel=close)
    sides = mesh.points[mesh.groups[names["outer"]]]
    rounding = 1e-9 if d == 2 or mesh.order == 1 else 1e-3  # middles of faces are not on the arcs
    assert np.hypot(sides[..., 0], sides[..., 1]) == pytest.approx(outer, abs=rounding)
    if form not in ("msh 1", "vtu", "vtk"):
        assert mesh.points[mesh.nodes_of(names["heel"])].tolist() == [[1.0, 0.0, 0.0][:d]]
        if d == 3 and form != "med":
            rim = mesh.points[mesh.nodes_of("rim")]
            assert np.hypot(*rim[:, :2].T) == pytest.approx(outer) and np.ptp(rim[:, 2]) == 0.0
            assert len(rim) == mesh.order * len(mesh.curves["rim"]) + 1


@pytest.mark.parametrize(
    ("cells", "form", "order"),
    [
        ("triangle", "msh 1", 2),
        seldom("hexahedron", "msh 4", 2),
        ("quad", "inp by gmsh", 2),
        ("triangle", "msh 2.2", 1),
        *((cells, "msh 4.1", 2) for cells in DIMENSION),
        *(
            made(cells, "inp", order)
            for k, cells in enumerate(DIMENSION)
            for order, made in ((1 + k % 2, pytest.param), (2 - k % 2, seldom))
        ),
        *(
            made(cells, form, 2)
            for k, form in enumerate(("binary msh 2.2", "binary msh 4.1", "vtu", "vtk", "med"))
            for cells, made in zip(
                ("triangle", "hexahedron"), (pytest.param, seldom)[:: 1 - 2 * (k % 2)], strict=True
            )
        ),
    ],
)
def test_a_ring_of_any_cells_and_format(tmp_path, cells, form, order):
    """Simplices, or what other cells are cut into, fill the body, curved in order 2; in order 1 corners are kept."""
    path = write_ring(tmp_path, cells, order, form)
    mesh = build_mesh(ring(path, order))
    assert kind_of_files(tmp_path / "scene.toml")(ring(path)) == (DIMENSION[cells], order)
    assert (mesh.dimension, mesh.order, mesh.cut) == (DIMENSION[cells], order, CUT[cells])
    check_ring(mesh, form)
    if cells in ("quad", "hexahedron"):
        assert mesh.cell.name in ("quadrilateral", "hexahedron")
        cut = build_mesh(ring(path, order, cut=True))
        check_ring(cut, form)
        assert cut.cut == {"quad": 24, "hexahedron": 72}[cells] and cut.cell.simplex
    if order == 2 and form == "msh 4.1":
        corners = build_mesh(ring(path, 1))
        assert corners.order == 1 and len(mesh.curved) > 0 == len(corners.curved)
        assert np.array_equal(corners.points, mesh.points[: len(corners.points)])
        assert np.array_equal(corners.triangles, mesh.corners)


@pytest.mark.parametrize("cells", ["quad", "wedge", "hexahedron"])
def test_elements_without_middles_of_faces_are_cut_alike(tmp_path, cells):
    """Elements of second order without nodes on faces, and those with them, give the same mesh."""
    one, two = (
        build_mesh(ring(write_ring(tmp_path, cells, 2, "msh 4.1", number), 2)) for number in (0, 1)
    )
    assert np.array_equal(one.corners, two.corners)
    assert one.points == pytest.approx(two.points, abs=1e-12)


@pytest.mark.parametrize(
    ("cells", "order"),
    [("triangle", 1), ("triangle", 2), ("quad", 1), ("quad", 2), ("tetra", 1), ("hexahedron", 2)],
)
def test_halves_of_a_file(tmp_path, cells, order):
    """Every edge is halved, in the cells, facets and lines of each name; curved where the coarse map has them."""
    path = write_ring(tmp_path, cells, order)
    coarse, fine = (build_mesh(ring(path, order, refine)) for refine in (0, 1))
    check(fine)
    d, parts = coarse.dimension, 2**coarse.dimension
    assert len(fine.triangles) == parts * len(coarse.triangles) and fine.cut == coarse.cut
    assert fine.measures().reshape(-1, parts).sum(axis=1) == pytest.approx(
        coarse.measures(), rel=1e-12
    )
    for name, own in coarse.groups.items():
        found = facet_measures(fine.points[fine.groups[name]]).reshape(parts // 2, -1).sum(axis=0)
        assert found == pytest.approx(facet_measures(coarse.points[own]), rel=1e-7)
    for name, own in coarse.surfaces.items():
        assert np.array_equal(np.unique(fine.surfaces[name] // parts), own)
    if d == 3:
        assert len(fine.nodes_of("rim")) == 2 * len(coarse.nodes_of("rim")) - 1
    ends = [mesh.points[mesh.corners[:, mesh.cell.edges[:, :2]]] for mesh in (coarse, fine)]
    longest = [np.linalg.norm(np.diff(each, axis=2)[:, :, 0], axis=2).max(axis=1) for each in ends]
    quality = [
        (mesh.measures() / size**d).min()
        for mesh, size in zip((coarse, fine), longest, strict=True)
    ]
    assert quality[1] > 0.4 * quality[0]
    if order == 2:
        quarters = np.array(list(np.ndindex((5,) * (d + 1)))) / 4
        hats = quarters[quarters.sum(axis=1) == 1.0]
        if not coarse.cell.simplex:
            hats = BRICKS[d, 1].hats_at(
                coarse.cell.coordinates(np.array([*np.ndindex((5,) * d)]) / 4)
            )
        places = coarse.map(slice(None), hats).places.reshape(-1, d)
        assert KDTree(places).query(fine.points)[0].max() <= 1e-12


def test_turned_triangles_keep_their_middles(tmp_path):
    """A file whose triangles run clockwise has its curved sides where they belong."""
    path = write_ring(tmp_path, "triangle", 2, "msh 2.2")
    mesh, raw = read_mesh(path, "ring", 2), meshio.read(path)
    turned = [
        (block.type, block.data[:, [0, 2, 1, 5, 4, 3]] if block.type == "triangle6" else block.data)
        for block in raw.cells
    ]
    meshio.write(
        tmp_path / "turned.msh",
        meshio.Mesh(raw.points, turned, cell_data=raw.cell_data, field_data=raw.field_data),
        file_format="gmsh22",
        binary=False,
    )
    other = read_mesh(tmp_path / "turned.msh", "ring", 2)
    assert other.measures() == pytest.approx(mesh.measures(), rel=1e-12)


PYRAMID = np.array(
    [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 0, 1],
        [1, 1, 1],
        [0, 1, 1],
        [0.5, 0.5, 0.5],
    ]
)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("mirrored", [False, True])
def test_pyramids_are_cut(tmp_path, order, mirrored):
    """Six pyramids make a cube, whichever way their corners run; its facets are cut from their smallest nodes."""
    bases = [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
    cells = np.array([[*(base[::-1] if mirrored else base), 8] for base in bases])
    quads = np.array(bases)
    points, kinds = PYRAMID.astype(float), {"pyramid": cells, "quad": quads}
    if order == 2:
        ends = np.unique(
            np.sort(
                np.concatenate(
                    [
                        cells[:, [a, b]]
                        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))
                    ]
                ),
                axis=1,
            ),
            axis=0,
        )
        middle = {tuple(pair): 9 + k for k, pair in enumerate(ends.tolist())}
        points = np.concatenate([points, points[ends].mean(axis=1)])
        kinds = {
            f"{kind}{number}": np.array(
                [
                    [*row, *(middle[tuple(sorted((row[a], row[b])))] for a, b in pairs)]
                    for row in rows.tolist()
                ]
            )
            for kind, number, rows, pairs in (
                (
                    "pyramid",
                    13,
                    cells,
                    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
                ),
                ("quad", 8, quads, ((0, 1), (1, 2), (2, 3), (3, 0))),
            )
        }
    tags = [np.full(6, 7), np.arange(1, 7)]
    path = tmp_path / "cube.vtu"
    meshio.Mesh(points, list(kinds.items()), cell_data={"CellEntityIds": tags}).write(path)
    mesh = build_mesh(ring(path, order))
    check(mesh)
    assert (mesh.cut, len(mesh.triangles), len(mesh.curved)) == (6, 12, 0)
    assert mesh.measures().sum() == pytest.approx(1.0, rel=1e-14)
    assert {
        name: facet_measures(mesh.points[group]).tolist() for name, group in mesh.groups.items()
    } == {str(k): pytest.approx([0.5, 0.5]) for k in range(1, 7)}
    for k, base in enumerate(bases, 1):  # the node of least number is in both triangles
        assert (
            (mesh.points[mesh.groups[str(k)]] == PYRAMID[min(base)]).all(axis=2).any(axis=1).all()
        )


# What names of a file may be used for

PART = {"young": 1.0, "poisson": 0.3}

ASKED = {
    "load on a curve": (
        "tetra",
        {"traction": [Traction(on="rim", pressure=1.0)]},
        "traction: 'rim' is a physical curve of the mesh, which only a clamp may name; where a force "
        "acts on it, the displacement has no limit as the mesh gets finer",
    ),
    "load on a point": (
        "triangle",
        {"traction": [Traction(on="heel", pressure=1.0)]},
        "traction: 'heel' is a physical point of the mesh, which only a clamp may name",
    ),
    "clamped volume": (
        "tetra",
        {"clamp": ["soft"]},
        "clamp: 'soft' is a physical volume of the mesh, not a boundary ",
    ),
    "clamped surface": (
        "triangle",
        {"clamp": ["soft"]},
        "clamp: 'soft' is a physical surface of the mesh",
    ),
    "far point": (
        "triangle",
        {"clamp": ["centre"]},
        "clamp: the physical point 'centre' of the mesh is at none",
    ),
    "no group": (
        "tetra",
        {"clamp": ["botom"]},
        "clamp: the mesh has no boundary group 'botom'; did you mean",
    ),
    "no loaded group": (
        "triangle",
        {"traction": [Traction(on="botom", pressure=1.0)]},
        "traction: the mesh has no boundary group 'botom'; did you mean 'bottom'",
    ),
    "no volume": (
        "tetra",
        {"material": [PartMaterial(on="top", **PART)]},
        "material.0.on: the mesh has no physical volume 'top'",
    ),
    "no material": (
        "tetra",
        {"material": [PartMaterial(on="soft", **PART)]},
        "material: the tetrahedron at (",
    ),
}


@pytest.mark.parametrize(("cells", "keys", "words"), ASKED.values(), ids=ASKED)
def test_what_names_of_a_file_may_not_be_used_for(tmp_path, cells, keys, words):
    """Clamps may name boundaries, curves and points of bodies; loads only boundaries; materials only parts."""
    with pytest.raises(InputError) as error:
        build_mesh(ring(write_ring(tmp_path, cells, 1), **keys))
    assert str(error.value).startswith(f"body.ring.{words}")


# Files of solids that are none


def moved_node(raw: meshio.Mesh) -> None:
    inside = np.linalg.norm(raw.points - [0.53, 0.53, HEIGHT / 2], axis=1).argmin()
    raw.points[inside, 2] += 3.0


def wrong_edges(raw: meshio.Mesh) -> None:
    for block in raw.cells:
        if block.type == "tetra10":
            block.data[:, [4, 5]] = block.data[:, [5, 4]]


@pytest.mark.parametrize(
    ("order", "spoil", "words"),
    [
        (1, moved_node, r"has tetrahedra that overlap at \(.*: the mesh folds there"),
        (2, wrong_edges, r"the curved tetrahedron at .* folds"),
    ],
)
def test_solids_that_are_none_are_refused(tmp_path, order, spoil, words):
    """A node that lies across its neighbours, and middles on the wrong edges."""
    raw = meshio.gmsh.read(write_ring(tmp_path, "tetra", order))
    spoil(raw)
    blocks = [(block.type, block.data) for block in raw.cells if block.dim > 1]
    tags = [np.full(len(data), k) for k, (_, data) in enumerate(blocks, start=1)]
    meshio.Mesh(raw.points, blocks, cell_data={"CellEntityIds": tags}).write(tmp_path / "ring.vtu")
    with pytest.raises(InputError, match=words):
        build_mesh(ring(tmp_path / "ring.vtu", order))


# Inputs of Abaqus, by hand

MIDDLES = (SQUARE + np.roll(SQUARE, -1, axis=0)) / 2

ELEMENTS = {
    "CPS3": [[1, 2, 3], [1, 3, 4]],
    "CPS6": [[1, 2, 3, 5, 6, 9], [1, 3, 4, 9, 7, 8]],
    "CPS8": [[1, 2, 3, 4, 5, 6, 7, 8]],
}
"""The square by Abaqus's names of elements; nodes 5 to 8 are the middles of its sides, 9 is that of the diagonal."""


def write_inp(path, kind: str, elements=None, more: str = ""):
    """The square as a program for Abaqus or CalculiX writes it, its sides as sets of nodes."""
    points = np.vstack([SQUARE, MIDDLES, [[0.5, 0.5]]])
    lines = [
        "*HEADING",
        "** a square",
        "*NODE, NSET=all",
        *(f"{k}, {x}, {y}" for k, (x, y) in enumerate(points, 1)),
        f"*ELEMENT, TYPE={kind}, ELSET=volume",
        *(
            f"{k}, {', '.join(map(str, nodes))}"
            for k, nodes in enumerate(elements or ELEMENTS[kind], 1)
        ),
        "*NSET, NSET=bottom, GENERATE",
        "1, 2, 1",
        "*NSET, NSET=right",
        "2, 3,",
        "6",
        "*Nset, nset=top",
        "3, 4",
        "*NSET, NSET=left",
        "4, 1",
        "*NSET, NSET=corner",
        "1",
        "*NSET, NSET=volume",
        "1, 2, 3, 4",
        more,
        "*MATERIAL, NAME=steel",
        "*ELASTIC",
        "210000., 0.3",
        "*STEP",
        "*STATIC",
        "*BOUNDARY",
        "bottom, 1, 2",
        "*NODE FILE",
        "U",
        "*END STEP",
    ]
    path.write_text("\n".join(line for line in lines if line) + "\n")
    return path


@pytest.mark.parametrize("kind", ["CPS6", "CPS8"])
def test_a_set_of_a_side_and_other_nodes_is_held_whole(tmp_path, kind):
    """Nodes beside the sides of a set are held, in the middle of an edge as well, unless linear elements have none."""
    more = "*NSET, NSET=mixed\n4, 1, 6\n*NSET, NSET=middle\n6\n*NSET, NSET=side\n4, 1, 8"
    path = write_inp(tmp_path / "square.inp", kind, more=more)
    mesh, straight = (read_mesh(path, "upper", order) for order in (2, 1))

    def held(name: str, of: Mesh = mesh) -> list[list[float]]:
        return sorted(of.points[of.nodes_of(name)].tolist())

    side = [[0.0, 0.0], [0.0, 0.5], [0.0, 1.0]]
    assert (
        held("side") == side
        and held("mixed") == [*side, [1.0, 0.5]]
        and held("middle") == [[1.0, 0.5]]
    )
    assert "side" not in mesh.vertices and len(mesh.facets("mixed").nodes) == 1
    assert held("side", straight) == side[::2]
    for name in ("mixed", "middle"):
        with pytest.raises(
            InputError, match=f"^'{name}' has nodes in the middle of edges, .* order = 2"
        ):
            held(name, straight)
    with pytest.raises(
        InputError, match=r"the node of 'mixed' at \(1, 0.5\) is on no line of it and has no normal"
    ):
        supports(mesh, body_of(file=str(path), clamp=[Clamp(on="mixed", normal=0.0)]))


def test_a_plane_part_is_moved_by_two_coordinates(tmp_path):
    """An instance of a plane part may be shifted by x and y alone."""
    path = write_inp(
        tmp_path / "square.inp", "CPS3", more="*INSTANCE, NAME=one\n2., 3.\n*END INSTANCE"
    )
    mesh = read_mesh(path, "upper")
    assert np.array_equal(
        [mesh.points.min(axis=0), mesh.points.max(axis=0)], [[2.0, 3.0], [3.0, 4.0]]
    )


CORNERS = [
    f"{1 + k + 4 * z:7d}, {x:12.0f}., {y:12.0f}., {z:12.0f}."
    for z in range(3)
    for k, (x, y) in enumerate(SQUARE)
]

CAE = (
    """*Heading
** as Abaqus/CAE writes it
*Part, name=Block
*Node
"""
    + "\n".join(CORNERS)
    + """
*Element, type=C3D8R
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 5, 6, 7, 8, 9, 10, 11, 12
*Nset, nset=Whole, generate
  1,  12,   1
*Elset, elset=Lower
 1,
*Elset, elset=Upper
 2,
*Solid Section, elset=Lower, material=Steel
,
*End Part
*Assembly, name=Assembly
*Instance, name=Block-1, part=Block
         10.,           0.,           0.
         10.,           0.,           0.,          10.,           0.,           1.,          90.
*End Instance
*Node
      1,           0.,           5.,           9.
*Nset, nset=_PickedSet4, internal
 1,
*Nset, nset="Fixed end", instance=Block-1
 1, 2, 3, 4
*Nset, nset=edge, instance=Block-1
 9, 10
*Elset, elset=_Side_S3, internal, instance=Block-1, generate
 1,  2,  1
*Elset, elset=_Side_S4, internal, instance=Block-1
 2,
*Surface, type=ELEMENT, name=Side
_SIDE_S3, S3
_Side_S4, S4
*Surface, type=ELEMENT, name=Top
Block-1.Upper, S2
*Surface, type=NODE, name=Corners
Fixed end, 1.
*Element, type=MASS, elset=mass
9, 1
*End Assembly
*Material, name=Steel
*Elastic
210000., 0.3
"""
)


def test_input_of_an_assembly(tmp_path):
    """A part that stands in an assembly, moved and turned: sets of the instance, surfaces of faces, no internal set."""
    path = tmp_path / "Job-1.inp"
    path.write_text(CAE)
    mesh = build_mesh(body_of(file=str(path), clamp=["Fixed end", "edge"]))
    assert sorted(mesh.groups) == ["Corners", "Fixed end", "Side", "Top", "Whole"] and list(
        mesh.curves
    ) == ["edge"]
    assert {name: len(cells) for name, cells in mesh.surfaces.items()} == {"Lower": 1, "Upper": 1}
    assert mesh.cut == 0 and mesh.measures().sum() == pytest.approx(2.0)
    assert mesh.points.min(axis=0) == pytest.approx(
        [9.0, 0.0, 0.0]
    )  # a quarter turn about x = 10, y = 0
    assert mesh.points.max(axis=0) == pytest.approx([10.0, 1.0, 2.0])
    areas = {
        name: facet_measures(mesh.points[facets]).sum() for name, facets in mesh.groups.items()
    }
    assert areas == pytest.approx(
        {"Corners": 1.0, "Fixed end": 1.0, "Side": 3.0, "Top": 1.0, "Whole": 10.0}
    )
    assert np.all(mesh.points[mesh.groups["Top"], 2] == 2.0)


@pytest.mark.parametrize(
    "form, cells, order",
    [
        ("msh 2.2", "triangle", 2),
        seldom("binary msh 4.1", "tetra", 2),
        seldom("med", "hexahedron", 1),
        seldom("med", "quad", 1),
        seldom("vtu", "quad", 1),
        ("vtu", "tetra", 2),
        ("inp", "hexahedron", 1),
        ("inp by gmsh", "triangle", 2),
    ],
)
def test_a_part_of_a_file(tmp_path, form, cells, order):
    """A body may be a part of a file: its cells, and of all groups what is on its boundary."""
    path, d = write_ring(tmp_path, cells, order, form), DIMENSION[cells]

    def called(*names: str) -> set[str]:
        return {NUMBERS[name] if form == "vtu" else name for name in names}

    whole, (inner, middle, outer), close = (
        read_mesh(path, "ring", order),
        RADII,
        {1: 2e-2, 2: 3e-4}[order],
    )
    for name, own, ends in (
        ("soft", (inner, middle), set()),
        ("hard", (middle, outer), called("outer")),
    ):
        (part,), (low,), area = (
            called(name),
            called("bottom"),
            np.pi / 4 * (own[1] ** 2 - own[0] ** 2),
        )
        mesh = build_mesh(
            BodySpec(
                name="ring",
                mesh=MeshSpec(file=str(path), part=part, order=order),
                clamp=[low],
                material=Material(young=1.0, poisson=0.3),
            )
        )
        check(mesh)
        assert mesh.measures().sum() == pytest.approx(area * (HEIGHT if d == 3 else 1.0), rel=close)
        assert called("outer", "bottom", "around") & set(mesh.groups) == (
            ends | called("bottom", "around")
        ) & set(whole.groups)
        assert facet_measures(mesh.points[mesh.groups[low]]).sum() == pytest.approx(
            area if d == 3 else own[1] - own[0], rel=close
        )
        assert file_kind(path, "ring", part) == (d, order)
    assert mesh.cut == (0 if cells in ("triangle", "tetra") else whole.cut // 2)
    with pytest.raises(
        InputError, match=r"ring.*: .* has no part 'sof'.*parts with .* or what is cut into them: "
    ):
        read_mesh(path, "ring", order, part="sof")


def test_parts_of_an_assembly(tmp_path):
    """Named by the instance, or by the part where it stands there once; sets of elements are parts as well."""
    path = tmp_path / "Job-2.inp"
    path.write_text(
        CAE.replace(
            "*End Instance",
            "*End Instance\n*Instance, name=Block-2, part=Block\n0., 7., 0.\n"
            "*End Instance\n*Elset, elset=both, instance=Block-1\n1\n*Elset, elset=both, "
            "instance=Block-2\n2",
            1,
        )
    )
    with pytest.raises(
        InputError,
        match=r'several parts; name the one of this body by part = "Block-1" or "Block-2"',
    ):
        read_mesh(path, "block")
    with pytest.raises(
        InputError,
        match=r'Block stands in it 2 times; name the instance by part = "Block-1" or "Blo',
    ):
        read_mesh(path, "block", part="Block")
    first, second = (read_mesh(path, "block", part=name) for name in ("block-1", "Block-2"))
    assert sorted(first.groups) == ["Corners", "Fixed end", "Side", "Top", "Whole"]
    assert sorted(second.groups) == ["Whole"] and set(second.surfaces) == {
        "Block-2",
        "Lower",
        "Upper",
        "both",
    }
    assert second.points.max(axis=0) == pytest.approx([1.0, 8.0, 2.0])
    half = read_mesh(path, "block", part="Block-2.Upper")
    assert half.measures().sum() == pytest.approx(1.0) and half.points[:, 2].min() == 1.0
    path.write_text(CAE)
    assert read_mesh(path, "block", part="BLOCK").measures().sum() == pytest.approx(2.0)
    with pytest.raises(InputError, match=r"has no part 'Blok' \(parts with .*: Lower, Upper\)"):
        read_mesh(path, "block", part="Blok")


FACES = {
    "C3D4": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.5, 0.5, 3**0.5 / 2, 0.5]),
    "C3D6": (
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2], [1, 0, 2], [0, 1, 2]],
        [0.5, 0.5, 2.0, 8**0.5, 2.0],
    ),
    "C3D5": (
        [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0, 0, 1]],
        [2.0, 0.5, 2**0.5, 5**0.5 / 2, 1.0],
    ),
    "S3": ([[0, 0], [3, 0], [0, 4]], [3.0, 5.0, 4.0]),
    "C3D8I": (
        [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0, 0, 3], [1, 0, 3], [1, 2, 3], [0, 2, 3]],
        [2.0, 2.0, 3.0, 6.0, 3.0, 6.0],
    ),
    "CAX3": ([[0, 0], [3, 0], [0, 4]], [3.0, 5.0, 4.0]),
    "CPE4": ([[0, 0], [3, 0], [3, 4], [0, 5]], [3.0, 4.0, 10**0.5, 5.0]),
}
"""An element of each kind: its nodes, and how large its faces S1, S2, … are."""


@pytest.mark.parametrize("kind", FACES)
def test_faces_of_elements(tmp_path, kind):
    """Faces of elements in surfaces are numbered as Abaqus and CalculiX do, in the plane and in space."""
    (points, sizes), path = FACES[kind], tmp_path / "one.inp"
    lines = [
        "*NODE",
        *(", ".join(map(str, (10 * k, *at))) for k, at in enumerate(points, 1)),
        f"*ELEMENT, TYPE={kind}",
        ", ".join(map(str, [7, *(10 * k for k in range(1, len(points) + 1))])),
    ]
    for k in range(1, len(sizes) + 1):
        lines += [f"*SURFACE, NAME=face{k}", f"7, S{k}"]
    path.write_text("\n".join(lines))
    mesh = read_mesh(path, "upper")
    assert {
        name: facet_measures(mesh.points[own]).sum() for name, own in mesh.groups.items()
    } == pytest.approx({f"face{k}": size for k, size in enumerate(sizes, 1)})


def test_sets_of_sets_and_parts_of_a_file(tmp_path):
    """Sets may name others, be continued, and be spelt in any case; what is included belongs to the file."""
    path = write_inp(
        tmp_path / "square.inp",
        "CPS3",
        more="*NSET, NSET=rim\nBottom, RIGHT\ntop\n*NSET, NSET=Rim\nleft",
    )
    whole = tmp_path / "whole.inp"
    whole.write_text(
        "*INCLUDE,\nINPUT=square.inp\n*ELSET, ELSET=one\n1\n*ELSET, ELSET=two\none,\n2,"
    )
    mesh = read_mesh(whole, "upper")
    assert area(mesh, "rim") == pytest.approx(4.0)
    assert {name: sorted(own.tolist()) for name, own in mesh.surfaces.items()} == {
        "volume": [0, 1],
        "one": [0],
        "two": [0, 1],
    }
    assert [area(mesh, name) for name in NAMES] == pytest.approx([1.0] * 4) and path.exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("*ELEMENT, TYPE=C3D4\n9, 1, 2, 3, 4", "has tetrahedra without volume"),
        (
            "*ELEMENT, TYPE=CPS3\n9, 1, 2, 77",
            "that can be read: the element 9 has node 77, which is not there",
        ),
        (
            "*ELEMENT, TYPE=CPS3\n9, 1, 2",
            "*ELEMENT: it has 3 numbers, and CPS3 takes 4 each; is the file cut off?",
        ),
        (
            "*ELEMENT, TYPE=UNKNOWN\n9, 1, 2, 3",
            "that can be read: the element type UNKNOWN is not known",
        ),
        ("*ELEMENT\n9, 1, 2, 3", "*ELEMENT: it lacks TYPE"),
        ("*ELGEN\n9, 1, 2, 3", "*ELGEN: it is not supported; write all nodes and elements"),
        (
            "*PART, NAME=one\n*END PART\n*PART, NAME=two",
            'several parts; name the one of this body by part = "one" or',
        ),
        ("*INSTANCE, NAME=one\n*END INSTANCE\n*INSTANCE, NAME=two", "it has several parts"),
        ("*NSET, NSET=a\nb\n*NSET, NSET=b\na", "the set a contains itself"),
        ("*ELSET, ELSET=a\nb", "there is no set b"),
        ("*NSET, NSET=a, GENERATE\n1, 999999999999", "the set a has more than 100000000 members"),
        (
            "*SURFACE, NAME=rim\nvolume",
            "the surface rim has no face of a triangle; these are S1 to S3",
        ),
        ("*SURFACE, NAME=rim\nvolume, S4", "the surface rim has S4 face of a triangle"),
        ("*INCLUDE, INPUT=none.inp", "no such file: none"),
        ("*INCLUDE, INPUT=square.inp", "square.inp includes itself"),
    ],
)
def test_refused_input(tmp_path, monkeypatch, more, words):
    """What cannot be read is refused with the reason."""
    monkeypatch.chdir(tmp_path)
    assert words in refused(write_inp(tmp_path / "square.inp", "CPS3", more=more))


def bricks(path: Path, numbers: np.ndarray, points: np.ndarray, elements: list[list[int]]) -> Path:
    """A deck of hexahedra between points (n, 3), called by `numbers` (n,)."""
    rows = [
        f"{number}, {', '.join(map(repr, x))}"
        for number, x in zip(numbers.tolist(), points.tolist(), strict=True)
    ]
    cells = [
        ", ".join(map(str, [k, *numbers[nodes].tolist()])) for k, nodes in enumerate(elements, 1)
    ]
    path.write_text(
        "\n".join(
            [
                "*NODE",
                *rows,
                "*ELEMENT, TYPE=C3D8, ELSET=ALL",
                *cells,
                "*NSET, NSET=SOME",
                f"{numbers[elements[0][0]]},",
            ]
        )
        + "\n"
    )
    return path


def test_hexahedra_are_cut_into_mirror_images(tmp_path):
    """Five tetrahedra each, whatever the numbers of the nodes, mirror images across every plane of an even grid, with
    no diagonal at its corners; a ring of three, whose nodes have no two colours, six each."""
    rng, grid = np.random.default_rng(3), np.array(list(np.ndindex(3, 3, 3)), float)
    corners = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 0, 1],
        [1, 1, 1],
        [0, 1, 1],
    ]
    elements = [
        [int(np.ravel_multi_index(np.add(at, corner), (3, 3, 3))) for corner in corners]
        for at in np.ndindex(2, 2, 2)
    ]
    path = bricks(tmp_path / "cube.inp", 1 + rng.permutation(27), grid, elements)
    assert len(read_mesh(path, "cube").triangles) == 8
    mesh = read_mesh(path, "cube", cut=True)
    cells = {frozenset(map(tuple, mesh.points[cell].tolist())) for cell in mesh.triangles}
    assert len(mesh.triangles) == len(cells) == 40 and mesh.measures().sum() == pytest.approx(8.0)
    for axis in range(3):
        one = np.eye(3)[axis]
        assert cells == {
            frozenset(tuple((x - 2.0 * one * x + 2.0 * one).tolist()) for x in map(np.array, cell))
            for cell in cells
        }
    at_corners = [cell for cell in cells for x in cell if set(x) <= {0.0, 2.0}]
    assert len(at_corners) == len(set(at_corners)) == 8
    around = np.array(
        [
            [r * np.cos(a), r * np.sin(a), z]
            for z in (0.0, 1.0)
            for a in 2.0 * np.pi * np.arange(3) / 3.0
            for r in (1.0, 2.0)
        ]
    )
    odd = [[2 * k, 2 * k + 1, (2 * k + 3) % 6, (2 * k + 2) % 6] for k in range(3)]
    mesh = read_mesh(
        bricks(
            tmp_path / "odd.inp",
            1 + rng.permutation(12),
            around,
            [[*face, *(k + 6 for k in face)] for face in odd],
        ),
        "odd",
        cut=True,
    )
    assert len(mesh.triangles) == 18 and mesh.measures().sum() == pytest.approx(
        3 * np.sqrt(3) / 4 * 3
    )
