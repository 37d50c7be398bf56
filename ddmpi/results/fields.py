"""Fields of all bodies: result.h5, and result.xdmf, which describes it to ParaView and meshio."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI

from ddmpi.body.stress import principal, turned, von_mises
from ddmpi.interface.interface import Lines
from ddmpi.interface.state import ContactState
from ddmpi.mesh.elements import Cell, cell_with
from ddmpi.mesh.mesh import boundary_facets
from ddmpi.results.tables import Columns, Results, datasets, leg_values
from ddmpi.scene.given import CELLS
from ddmpi.surface.curve import in_order
from ddmpi.surface.outline import Outline
from ddmpi.system.agreement import gathered
from ddmpi.system.files import contact_files, write_rows, writing
from ddmpi.system.numbers import Frame

Datasets = Mapping[str, np.ndarray]  # the data of a body or a contact in result.h5, by name
KIND = {
    1: "Scalar",
    3: "Vector",
    6: "Tensor6",
}  # what XDMF calls a field, by its number of components

NODAL = ("nodal_stress", "nodal_principal", "nodal_von_mises")
"""Stress at nodes: recovered, see `body.estimate`; principal stresses and von Mises stress of it."""

AT_CONTACT = ("pressure", "friction", "gap", "slip", "slip_total", "utilisation", "status")
"""The fields of a contact, with a row per line of its table: columns of contact_NAME.csv, stresses by other names."""

AT_CONTACT_IN_SPACE = ("friction_vector", "slip_vector")
"""Fields of a contact as vectors: the friction on the first body, and its slip past the second."""

THAT_ADD_UP = ("normal_force", "force")
"""Fields of a contact that are shares of its resultants: their sums over the points are those of the summary."""

AT_STEPS = (
    "displacement",
    "displacement_in_frame",
    "stress",
    "principal",
    "von_mises",
    *NODAL,
    "error",
    "error_share",
    *AT_CONTACT,
    *AT_CONTACT_IN_SPACE,
    *THAT_ADD_UP,
)
"""The datasets that differ from load step to load step."""

AT_NODES = (
    "points",
    "displacement",
    "displacement_in_frame",
    *NODAL,
    "initial_gap",
    *AT_CONTACT,
    *AT_CONTACT_IN_SPACE,
    "normal_force",
    "force",
)
"""What has a row per node; all else has a row per cell."""

IN_FILES = [
    0,
    3,
    5,
    1,
    4,
    2,
]  # the places of the columns of `stress` in files: σ_xx, σ_xy, σ_xz, σ_yy, σ_yz, σ_zz

SURFACES = "surfaces"
"""The group of result.h5, and in that of a load step, with the fields of contacts, one contact after the other."""

MANY = 10_000  # most grids of single bodies and contacts, one for each load step, in result.xdmf
FEW = 0.02  # a node that shares its neighbour's row hardly faces the other side below this fraction of its length


@dataclass(frozen=True)
class Fields:
    """Fields of one body; stress, von Mises stress and error are None where the scene does not ask for them.

    Attributes
    ----------
    points : (nv, d) nodes (m)
    cells : (nt, k) nodes of the cells, in the order of VTK; `triangles` is another name of them
    displacement : (nv, d) in m
    stress : (nt, 4) σ_xx, σ_yy, σ_zz, σ_xy in Pa, in space (nt, 6) with σ_yz, σ_xz
    von_mises : (nt,) in Pa
    error : (nt,) estimated discretization error, without unit
    nodal_stress : (nv, 4), in space (nv, 6), as stress, at the nodes: recovered from the cells around each
    in_frame : of a body that moves far its displacement in its frame (m); the other fields are in the axes of the world
    error_share : (nt,) of what the errors of results are made, as of `derive.errors.shares`
    """

    points: np.ndarray
    cells: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None = None
    von_mises: np.ndarray | None = None
    error: np.ndarray | None = None
    nodal_stress: np.ndarray | None = None
    in_frame: np.ndarray | None = None
    error_share: np.ndarray | None = None

    def placed(self, frame: Frame) -> Self:
        """The fields of a body whose frame has gone there: its displacement is that of the frame and its own."""
        sigma, nodal = (
            stress if stress is None else turned(stress, frame.turned)
            for stress in (self.stress, self.nodal_stress)
        )
        return replace(
            self,
            displacement=frame.at(self.points + self.displacement) - self.points,
            stress=sigma,
            nodal_stress=nodal,
            in_frame=self.displacement,
        )

    def to_meshio(self) -> Any:
        """These fields as a `meshio.Mesh`: points (nv, 3), cells (nt, k); at the points displacement (nv, 3), nodal_stress,
        nodal_principal and nodal_von_mises; of cells stress (nt, 6), principal (nt, 3), von_mises, error and error_share
        (nt,), as far as there are such, as in result.h5."""
        import meshio

        data = _datasets_of(self, 0)
        points, cells = data.pop("points"), data.pop("cells")
        del data["body"]
        kind = CELLS[self.points.shape[1]][cells.shape[1]]
        return meshio.Mesh(
            points,
            [(kind, cells)],
            {name: values for name, values in data.items() if name in AT_NODES},
            {name: [values] for name, values in data.items() if name not in AT_NODES},
        )

    @property
    def triangles(self) -> np.ndarray:
        return self.cells

    def __repr__(self) -> str:
        return f"Fields({len(self.points)} nodes, {len(self.cells)} cells)"


def write_fields(
    path: Path,
    bodies: Mapping[int, Fields],
    contacts: Mapping[str, Datasets] | None = None,
    world: MPI.Comm = MPI.COMM_SELF,
    step: int | None = None,
    tables: Mapping[str, Datasets] | None = None,
) -> dict[int | str, np.ndarray]:
    """Write the fields of all bodies and contacts into result.h5 in the folder `path`, all ranks at once.

    The datasets are those of the last load step, with the mesh, facets and initial gaps; they make the file. The fields
    of a `step` before it are added in a group.

    Parameters
    ----------
    bodies : of this rank, by their numbers in the order of the scene, which the ranks keep as well
    contacts : `contact_fields` of those that this rank owns, by name
    step : number of a load step before the last one
    tables : `table_fields` of the same contacts, for the last one; where bodies move far for each step, whose contacts
        have points and cells of their own

    Returns the span (2, 2) of each body and contact in the datasets: its first node and cell, and their numbers; of all
    on the first rank, of its own on another. Collective. Raises OutputError, on all ranks.
    """
    everything: dict[str, Mapping[Any, Datasets]] = {
        "": {number: _datasets_of(fields, number) for number, fields in bodies.items()},
        f"{SURFACES}/": contacts or {},
    }
    arrays, places, spans = {}, {}, dict[int | str, np.ndarray]()
    for group, entries in everything.items():
        first, number, total = _spans(entries, world)
        spans |= zip(entries, np.stack([first, number], axis=1), strict=True)
        for name, data in _by_name(entries, first[:, 0], world).items():
            if step is None or name in AT_STEPS or (group and tables):
                kind = 0 if name in AT_NODES else 1
                arrays[group + name] = data
                places[group + name] = int(first[0, kind]), int(total[kind])
    for name, table in _of_tables(tables or {}, spans).items():
        arrays[name], places[name] = [table], (0, len(table))
    write_rows(path / "result.h5", arrays, places, world, None if step is None else group_of(step))
    return gathered(world, spans)


def _by_name(
    entries: Mapping[Any, Datasets], first: np.ndarray, world: MPI.Comm
) -> dict[str, list[np.ndarray]]:
    """The datasets of all entries by name; cells by the numbers of nodes among all, in which those of an entry begin
    at `first` (k,), and as wide as those of all ranks. Collective."""
    wide = [entry["cells"].shape[1] for entry in entries.values()]
    widest = world.allreduce(max(wide, default=0), MPI.MAX)
    names = next(iter(entries.values()), ())
    data = {name: [entry[name] for entry in entries.values()] for name in names}
    if "cells" in data:
        data["cells"] = [
            widened(cells + start, widest)
            for cells, start in zip(data["cells"], first, strict=True)
        ]
    return data


def widened(cells: np.ndarray, width: int) -> np.ndarray:
    """Cells (nt, k) of one kind as rows among those of others with more nodes, (nt, width), which end in −1."""
    return np.pad(cells, ((0, 0), (0, width - cells.shape[1])), constant_values=-1)


def by_kind(cells: np.ndarray, dimension: int) -> Iterator[tuple[Cell, np.ndarray, np.ndarray]]:
    """The kinds of cells among (nt, width), see `widened`: the reference cell, the numbers (n,), and their nodes (n, k)."""
    number = (cells >= 0).sum(axis=1)
    for k in np.unique(number).tolist():
        some = np.flatnonzero(number == k)
        yield cell_with(k, dimension), some, cells[some, :k]


def _of_tables(
    tables: Mapping[str, Datasets], spans: Mapping[int | str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The datasets of the tables of contacts, with their spans."""
    return {
        f"contacts/{name}/{key}": data
        for name, table in tables.items()
        for key, data in {**table, "span": spans[name]}.items()
    }


def _spans(
    entries: Mapping[Any, Datasets], world: MPI.Comm
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first node and cell (k, 2) of this rank's entries among those of all ranks, their numbers (k, 2) of nodes and
    cells, and these of all ranks (2,). Collective."""
    sizes = [(len(entry["points"]), len(entry["cells"])) for entry in entries.values()]
    number = np.array(sizes).reshape(-1, 2)
    mine = number.sum(axis=0, dtype=int)
    ends, total = np.empty_like(mine), np.empty_like(mine)
    MPI.Intracomm(world).Scan(mine, ends)
    world.Allreduce(mine, total)
    return ends - number[::-1].cumsum(axis=0)[::-1], number, total


def _datasets_of(fields: Fields, body: int) -> dict[str, np.ndarray]:
    """The datasets of result.h5 of the body number `body`, by name."""
    data = {
        "points": _padded(fields.points),
        "cells": fields.cells,
        "displacement": _padded(fields.displacement),
        "body": np.full(len(fields.cells), body),
    }
    if fields.in_frame is not None:
        data["displacement_in_frame"] = _padded(fields.in_frame)
    for where, sigma in ("", fields.stress), ("nodal_", fields.nodal_stress):
        if sigma is not None:
            tensor = np.zeros((len(sigma), 6))
            tensor[:, IN_FILES[: sigma.shape[1]]] = sigma
            data |= {
                f"{where}stress": tensor,
                f"{where}principal": principal(sigma),
                f"{where}von_mises": von_mises(sigma),
            }
    of_errors = {"error": fields.error, "error_share": fields.error_share}
    return data | {name: values for name, values in of_errors.items() if values is not None}


def contact_fields(state: ContactState, values: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Points (n, 3) and cells (c, d) of what a contact covers, to its true outline, initial_gap and AT_CONTACT (n, …).

    In space also AT_CONTACT_IN_SPACE (n, 3). THAT_ADD_UP are the forces on the first body at the points (N), around an
    axis of the whole circumference. `values` are `leg_values`, by default the present ones. Not collective.
    """
    interface = state.interface
    outline = interface.drawing.outline
    forces = _forces_of(state, values)
    values = leg_values(state) if values is None else values
    most = np.zeros(len(outline.xy), int)  # a status is that of the row with the largest share
    entries = outline.shares.tocoo()
    order = np.argsort(entries.data, kind="stable")
    most[entries.row[order]] = entries.col[order]
    data = {
        "points": _padded(outline.xy),
        "cells": outline.cells,
        "initial_gap": outline.shares @ interface.gap,
    }
    data |= zip(AT_CONTACT, (outline.shares @ values).T[: len(AT_CONTACT)], strict=True)
    data["status"] = values[most, AT_CONTACT.index("status")]
    if len(values.T) > len(AT_CONTACT):
        force, slip = np.split(values[:, len(AT_CONTACT) :], 2, axis=1)
        friction = force / interface.area[:, None] + values[:, :1] * interface.normal
        data |= zip(
            AT_CONTACT_IN_SPACE, (outline.shares @ friction, outline.shares @ slip), strict=True
        )
    at_points = shared_out(outline, forces)
    return data | {"normal_force": at_points[:, 0], "force": _padded(at_points[:, 1:])}


def _forces_of(state: ContactState, values: np.ndarray | None) -> np.ndarray:
    """(m, 1 + d) normal forces of the rows and their forces on the first body (N); of another load step by its
    `leg_values`, where bodies that move far have other rows than the state has forces."""
    if values is None:
        return np.column_stack([state.normal_force, state.forces])
    interface = state.interface
    normal, along = (values[:, k] * interface.area for k in range(2))
    if len(values.T) > len(AT_CONTACT):
        return np.column_stack([normal, values[:, len(AT_CONTACT) : len(AT_CONTACT) + 3]])
    force = -normal[:, None] * interface.normal - along[:, None] * interface.tangents[:, 0]
    return np.column_stack([normal, force])


def shared_out(outline: Outline, forces: np.ndarray) -> np.ndarray:
    """(n, k) at the points of an outline, of `forces` (m, k) of the rows: each row's are divided among the points whose
    values it has a share in, by share and measure, so that sums are kept to rounding. Not collective.

    Integrals of interpolated stresses are not: a row's stress is its force over the integral of its shape function,
    which on pieces of facets, and of quadratic ones, is not that of the interpolation.
    """
    number, width = outline.cells.shape
    measures = np.zeros(len(outline.xy))
    if number:
        ends = outline.xy[outline.cells]
        edges = ends[:, 1:] - ends[:, :1]
        sizes = np.sqrt(np.abs(np.linalg.det(edges @ edges.transpose(0, 2, 1))))
        np.add.at(measures, outline.cells.ravel(), np.repeat(sizes, width))
    shares = outline.shares.tocoo()
    positive = np.maximum(shares.data, 0.0)
    weights = positive * measures[shares.row]
    columns = outline.shares.shape[1]
    alone = np.bincount(shares.col, weights, columns) <= 0.0  # only points that stand by themselves
    weights = np.where(alone[shares.col], positive, weights)
    weights /= np.bincount(shares.col, weights, columns)[shares.col]
    return sparse.csr_matrix((weights, (shares.row, shares.col)), outline.shares.shape) @ forces


def table_fields(state: ContactState, far: bool = False) -> dict[str, np.ndarray]:
    """What result.h5 adds to the table of a contact, by its lines: its `drawn_facets` and initial gaps (m); where
    bodies move `far` also its normals, which differ from step to step."""
    interface, lines = state.interface, state.interface.lines
    normals = interface.normal[lines.row].T if far else ()
    return dict(zip(("nx", "ny", "nz"), normals, strict=False)) | {
        "facets": drawn_facets(lines, interface.axisymmetric),
        "initial_gap": interface.gap[lines.row],
    }


def drawn_facets(lines: Lines, axisymmetric: bool = False) -> np.ndarray:
    """The facets (f, d) of a contact that are drawn, by the lines of its table; a node by itself has k alone.

    A facet is left out if it hardly faces the other side: two of its nodes share a row, and one has less than FEW of
    another's length or area and is not on an axis. Its stress would be drawn outside of the body. Not collective.
    """
    facets, nodes = lines.facets, np.arange(len(lines.row))
    row, area = np.sort(lines.row[facets], axis=1), lines.area[facets]
    faces = np.diff(row, axis=1).all(axis=1) | (area.min(axis=1) >= FEW * area.max(axis=1))
    faces |= axisymmetric & (lines.xy[facets, 0] == 0.0).any(axis=1)
    drawn = np.vstack(
        [facets[faces], np.setdiff1d(nodes, facets)[:, None].repeat(facets.shape[1], axis=1)]
    )
    return in_order(drawn) if facets.shape[1] == 2 else drawn


def write_xdmf(
    path: Path,
    times: Sequence[float] = (),
    bodies: Mapping[str, np.ndarray] | None = None,
    contacts: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write result.xdmf into the folder `path`: the mesh and all fields of result.h5 as one grid without time.

    With the `times` of load steps whose fields have been written, the last one's without a number, there is a grid
    for each. meshio.read takes the grid of a single step, meshio.xdmf.TimeSeriesReader those of several; both refuse
    more, and bodies with cells of different kinds, of which there are grids by name alone. So grids of bodies and
    contacts by name, with their times, stand where meshio does not look, in an Information. ParaView and pyvista are
    referred to them (Reference="XML", as XDMF 2 has it). result_last.xdmf has the last of several load steps, for
    meshio.read.

    Parameters
    ----------
    bodies, contacts : by name in the order of the scene, where `write_fields` has written them

    Not collective. Raises OutputError.
    """
    import h5py

    with writing(path / "result.h5"), h5py.File(path / "result.h5", "r") as file:
        kinds = _kinds_of(file, bodies or {})
        steps, surfaces = (
            [_described(file, group, group_of(k)) for k in range(max(len(times), 1))]
            for group in ("/", f"/{SURFACES}")
        )
    grids = [(name, span, steps, kinds[name]) for name, span in (bodies or {}).items()]
    for name, span in (contacts or {}).items():
        called = f"contact {name}" if name in kinds else name
        grids.append((called, span, surfaces, kinds[""].facet.straight))
    root = Element("Xdmf", Version="3.0")
    domain = SubElement(root, "Domain")
    if any(kind is not kinds[""] for kind in kinds.values()):
        _add_named(domain, times, grids)
        _write_document(path / "result.xdmf", root)
        return
    _add_grids(domain, "bodies", times, steps, kinds[""])
    if 0 < len(grids) * len(steps) <= MANY:
        domain[0].set("Reference", "XML")
        domain[0].text = f"/Xdmf/Domain/Grid{'/Grid[1]' * bool(times)}/Information/Grid"
        first = domain[0][0] if times else domain[0]
        hidden = SubElement(first, "Information", Name="named")
        hidden.text = "<none/>"  # as meshio reads it
        _add_named(hidden, times, grids)
    _write_document(path / "result.xdmf", root)
    if times:
        root = Element("Xdmf", Version="3.0")
        _add_grids(SubElement(root, "Domain"), "bodies", (), steps[-1:], kinds[""])
        _write_document(path / "result_last.xdmf", root)


def _kinds_of(file: Any, spans: Mapping[str, np.ndarray]) -> dict[str, Cell]:
    """The kinds of cells of bodies by name, and under "" that of the first one, or of all without a name."""
    d, cells = 2 + int(file["points"][:, 2].any()), file["cells"]
    rows = {name: cells[span[0, 1]] for name, span in spans.items()}
    rows = {"": next(iter(rows.values()), cells[0])} | rows
    return {name: cell_with(np.count_nonzero(row >= 0), d) for name, row in rows.items()}


def _add_named(
    parent: Element,
    times: Sequence[float],
    grids: Sequence[tuple[str, np.ndarray, Sequence[Mapping[str, tuple]], Cell]],
) -> None:
    """Add the grids of bodies and contacts: name, span, fields of all steps, and kind of cells."""
    named = SubElement(
        parent, "Grid", Name="results", GridType="Collection", CollectionType="Spatial"
    )
    for name, span, fields, kind in grids:
        _add_grids(named, name, times, fields, kind, span, alone=1.0)


def write_surface(path: Path, name: str, fields: Datasets) -> None:
    """Write the `contact_fields` of the contact `name` as contact_NAME.vtu into the folder `path`, which ParaView,
    pyvista and meshio read. Not collective. Raises OutputError."""
    number, width = fields["cells"].shape
    root = Element("VTKFile", type="UnstructuredGrid", version="0.1", byte_order="LittleEndian")
    piece = SubElement(
        SubElement(root, "UnstructuredGrid"),
        "Piece",
        NumberOfPoints=str(len(fields["points"])),
        NumberOfCells=str(number),
    )
    cells = {
        "connectivity": fields["cells"].ravel(),
        "offsets": width * np.arange(1, number + 1),
        "types": np.full(number, {2: 3, 3: 5}[width]),
    }  # VTK's lines and triangles
    for tag, arrays in {
        "Points": {"points": fields["points"]},
        "Cells": cells,
        "PointData": {
            key: values for key, values in fields.items() if key not in ("points", "cells")
        },
    }.items():
        parent = SubElement(piece, tag)
        for key, values in arrays.items():
            item = SubElement(
                parent,
                "DataArray",
                Name=key,
                format="ascii",
                type="Int64" if values.dtype.kind == "i" else "Float64",
            )
            item.text = _words(*values.ravel().tolist())
            if values.ndim > 1:
                item.set("NumberOfComponents", str(values.shape[1]))
    _write_document(path / contact_files(name).surface, root)


def _write_document(path: Path, root: Element) -> None:
    indent(root)
    with writing(path):
        ElementTree(root).write(path, "utf-8", xml_declaration=True)


def group_of(step: int) -> str:
    """The group of result.h5 with the fields of a load step before the last one."""
    return f"step_{step:06d}"


def _described(
    file: Any, group: str, step: str = ""
) -> dict[str, tuple[str, tuple[int, ...], str]]:
    """Path, shape and kind of the datasets in a group of result.h5, by name; those of a load step in their place."""
    last, changed = (
        datasets(file.get(group, {})),
        datasets(file.get(f"{step}{group}", {})) if step else {},
    )
    kept = {name: last[name] for name in last if not changed or name not in AT_STEPS} | changed
    return {name: (data.name, data.shape, data.dtype.kind) for name, data in kept.items()}


def _add_grids(
    parent: Element,
    name: str,
    times: Sequence[float],
    steps: Sequence[Mapping[str, tuple]],
    kind: Cell,
    span: np.ndarray | None = None,
    alone: float | None = None,
) -> None:
    """Add grids to an element of XDMF: a collection with one for each time, or a single one with the time `alone`.

    A grid has the mesh, cells of a kind, and the fields of its step, `_described`, or the `span` of them, as of
    `write_fields`.
    """
    if times:
        parent = SubElement(
            parent, "Grid", Name=name, GridType="Collection", CollectionType="Temporal"
        )
    for time, fields in zip(times if times else [alone], steps, strict=True):
        grid = SubElement(parent, "Grid", Name=name, GridType="Uniform")
        if time is not None:
            SubElement(grid, "Time", Value=repr(time))
        for field, stored in fields.items():
            _add_field(grid, field, stored, kind, span)


def _add_field(
    grid: Element,
    name: str,
    stored: tuple[str, tuple[int, ...], str],
    cell: Cell,
    span: np.ndarray | None,
) -> None:
    """Add a `stored` field, or a span of it, to a grid with cells of one kind."""
    (path, shape, kind), nodal = stored, name in AT_NODES
    sizes = (len(cell.nodes),) if name == "cells" else shape[1:]
    start, number = (0, shape[0]) if span is None else span[:, 0 if nodal else 1].tolist()
    if name == "points":
        parent = SubElement(grid, "Geometry", GeometryType="XYZ")
    elif name == "cells":
        topology = cell.topology
        parent = SubElement(grid, "Topology", TopologyType=topology, NumberOfElements=str(number))
        if topology == "Polyline":
            parent.set("NodesPerElement", "2")
        if span is not None:
            parent.set("BaseOffset", str(span[0, 0]))
    else:
        parent = SubElement(
            grid,
            "Attribute",
            Name=name,
            AttributeType=KIND[int(np.prod(shape[1:]))],
            Center="Node" if nodal else "Cell",
        )
    if span is not None:
        parent = SubElement(
            parent, "DataItem", ItemType="HyperSlab", Dimensions=_words(number, *sizes)
        )
        slab = np.array([[start, 1, number], *([0, 1, size] for size in sizes)])
        item = SubElement(
            parent, "DataItem", DataType="Int", Format="XML", Dimensions=f"3 {len(shape)}"
        )
        item.text = _words(*slab.T.ravel().tolist())
    item = SubElement(
        parent,
        "DataItem",
        DataType="Int" if kind == "i" else "Float",
        Precision="8",
        Format="HDF",
        Dimensions=_words(*shape),
    )
    item.text = f"result.h5:{path}"


def _words(*numbers: float) -> str:
    return " ".join(map(repr, numbers))


def _padded(array: np.ndarray) -> np.ndarray:
    return np.pad(array, ((0, 0), (0, 3 - array.shape[1])))


def boundary_of(cells: np.ndarray, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """`boundary_facets` of cells (nt, width) of several kinds: facets (f, ·) `widened`, and their cells (f,)."""
    found = [
        (some, *boundary_facets(nodes, dimension)) for _, some, nodes in by_kind(cells, dimension)
    ]
    width = max(facets.shape[1] for _, facets, _ in found)
    outer = np.concatenate([widened(facets, width) for _, facets, _ in found])
    return outer, np.concatenate([some[cell] for some, _, cell in found])


def linear_parts(cells: np.ndarray, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Cells (nt, width) as linear simplices (·, d + 1) between their nodes, and the cell of each."""
    found = [
        (nodes[:, kind.parts].reshape(-1, dimension + 1), np.repeat(some, len(kind.parts)))
        for kind, some, nodes in by_kind(cells, dimension)
    ]
    return np.concatenate([parts for parts, _ in found]), np.concatenate([of for _, of in found])


def owners(results: Results) -> np.ndarray:
    """(nv,) the number of the body that each node belongs to."""
    owner = np.zeros(len(results.fields["points"]), int)
    cell, node = np.nonzero(results.fields["cells"] >= 0)
    owner[results.fields["cells"][cell, node]] = results.fields["body"][cell]
    return owner


def vectors(table: Columns, name: str = "") -> np.ndarray:
    """(l, d) of the columns of a contact's table whose names are `name` before x, y and z; the places, by default."""
    return np.column_stack([table[f"{name}{axis}"] for axis in "xyz" if f"{name}{axis}" in table])
