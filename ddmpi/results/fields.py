"""Fields of all bodies: result.h5, and result.xdmf, which describes it to ParaView and meshio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ddmpi.body.stress import principal, von_mises
from ddmpi.interface.interface import Lines
from ddmpi.interface.state import ContactState
from ddmpi.mesh.elements import cell_with
from ddmpi.results.tables import Columns, Results, leg_values
from ddmpi.surface.curve import in_order
from ddmpi.system.agreement import agreed
from ddmpi.system.files import contact_files, write_parts, write_rows, writing

KIND = {1: "Scalar", 3: "Vector", 6: "Tensor6"}
"""What XDMF calls a field, by its number of components."""

MESH = {"points": "Geometry", "cells": "Topology"}
"""What XDMF calls the datasets of a mesh."""

NODAL = ("nodal_stress", "nodal_principal", "nodal_von_mises")
"""Stress at nodes: recovered, see `body.estimate`; principal stresses and von Mises stress of it."""

AT_STEPS = ("displacement", "stress", "principal", "von_mises", *NODAL, "error")
"""The datasets that differ from load step to load step."""

AT_CONTACT = ("pressure", "friction", "gap", "slip", "slip_total", "status")
"""The fields of a contact, with a row per line of its table: columns of contact_NAME.csv, stresses by other names."""

AT_CONTACT_IN_SPACE = ("friction_vector", "slip_vector")
"""So are these, as vectors: the friction that acts on the first body, and how it has slipped past the second."""

AT_NODES = ("points", "displacement", *NODAL, *AT_CONTACT, *AT_CONTACT_IN_SPACE)
"""What has a row per node; all else has a row per cell."""

IN_FILES = [0, 3, 5, 1, 4, 2]
"""Where the columns of `stress` stand in files: σ_xx, σ_xy, σ_xz, σ_yy, σ_yz, σ_zz."""

MANY = 10_000
"""Of more bodies and contacts than this, times load steps, result.xdmf has no grids of their own."""

DEPTH, INDENT = 5, "  "
"""How deep grids with names stand in result.xdmf where it has no times, and by what each level is set in."""

DECLARED = b"<?xml version='1.0' encoding='utf-8'?>\n"
"""How a document begins."""

FEW = 0.02
"""A node that shares its neighbour's row and has less than this part of its length hardly faces the other side."""

@dataclass(frozen=True)
class Fields:
    """Fields of one body; stress, von Mises stress and error are None where the scene does not ask for them.

    Attributes
    ----------
    points : (nv, d) nodes (m)
    triangles : (nt, k) nodes of the cells, triangles or tetrahedra of order 1 or 2
    displacement : (nv, d) in m
    stress : (nt, 4) σ_xx, σ_yy, σ_zz, σ_xy in Pa, in space (nt, 6) with σ_yz, σ_xz
    von_mises : (nt,) in Pa
    error : (nt,) estimated discretization error, without unit
    nodal_stress : (nv, 4), in space (nv, 6), as stress, at the nodes: recovered from the cells around each
    """

    points: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None = None
    von_mises: np.ndarray | None = None
    error: np.ndarray | None = None
    nodal_stress: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"Fields({len(self.points)} nodes, {len(self.triangles)} cells)"


def write_fields(path: Path, bodies: Mapping[int, Fields], world: MPI.Comm = MPI.COMM_SELF,
                 step: int | None = None) -> None:
    """Write the fields of all bodies into result.h5 in the folder `path`, all ranks at once.

    The datasets are those of the last load step, with the mesh; they make the file. The fields of a `step` before it
    are added in a group.

    Parameters
    ----------
    bodies : of this rank, by their numbers in the order of the scene, which the ranks keep as well
    step : number of a load step before the last one

    Collective. Raises OutputError, on all ranks.
    """
    nodes, cells = (np.array([len(each) for each in arrays]) for arrays in zip(
        *((each.points, each.triangles) for each in bodies.values()), strict=True))
    own = np.array([nodes.sum(), cells.sum()])
    ends, total = np.empty_like(own), np.empty_like(own)
    MPI.Intracomm(world).Scan(own, ends)
    world.Allreduce(own, total)
    before = (ends - own).tolist()
    first = before[0] + np.cumsum(nodes) - nodes
    several = [_datasets_of(fields, number, start) for (number, fields), start in
               zip(bodies.items(), first.tolist(), strict=True)]
    names = [name for name in several[0] if step is None or name in AT_STEPS]
    kinds = {name: 0 if name in AT_NODES else 1 for name in names}
    write_rows(path / "result.h5", {name: [each[name] for each in several] for name in names},
               {name: (before[kind], int(total[kind])) for name, kind in kinds.items()}, world,
               None if step is None else group_of(step))


def _datasets_of(fields: Fields, body: int, first: int) -> dict[str, np.ndarray]:
    """The rows of the body number `body`, with the nodes from `first` on, in the datasets of result.h5, by name."""
    parts = {"points": _padded(fields.points), "cells": fields.triangles + first,
             "displacement": _padded(fields.displacement), "body": np.full(len(fields.triangles), body)}
    for where, sigma in ("", fields.stress), ("nodal_", fields.nodal_stress):
        if sigma is not None:
            tensor = np.zeros((len(sigma), 6))
            tensor[:, IN_FILES[:sigma.shape[1]]] = sigma
            parts |= {f"{where}stress": tensor, f"{where}principal": principal(sigma),
                      f"{where}von_mises": von_mises(sigma)}
    return parts if fields.error is None else parts | {"error": fields.error}


def contact_fields(state: ContactState, values: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Points (l, 3) of a contact, its `cells` (·, d), which are its `drawn_facets`, and AT_CONTACT (l, …).

    In space also AT_CONTACT_IN_SPACE (l, 3). `values` are `leg_values`, by default the present ones. Not collective.
    """
    interface = state.interface
    lines = interface.lines
    values = leg_values(state) if values is None else values
    found = {"points": _padded(lines.xy), "cells": drawn_facets(lines, interface.axisymmetric)} | dict(
        zip(AT_CONTACT, values[lines.row].T[:len(AT_CONTACT)], strict=True))
    if len(values.T) > len(AT_CONTACT):
        force, slip = np.split(values[:, len(AT_CONTACT):], 2, axis=1)
        friction = force / interface.area[:, None] + values[:, :1] * interface.normal
        found |= zip(AT_CONTACT_IN_SPACE, (friction[lines.row], slip[lines.row]), strict=True)
    return found


def drawn_facets(lines: Lines, axisymmetric: bool = False) -> np.ndarray:
    """The facets (f, d) of a contact that are drawn, by the lines of its table; a node by itself has k alone.

    A facet is left out if it hardly faces the other side: two of its nodes share a row, and one has less than FEW of
    another's length or area and is not on an axis. Drawn, the stress would go on outside of the body. Not collective.
    """
    facets, nodes = lines.facets, np.arange(len(lines.row))
    row, area = np.sort(lines.row[facets], axis=1), lines.area[facets]
    faces = np.diff(row, axis=1).all(axis=1) | (area.min(axis=1) >= FEW * area.max(axis=1))
    faces |= axisymmetric & (lines.xy[facets, 0] == 0.0).any(axis=1)
    drawn = np.vstack([facets[faces], np.setdiff1d(nodes, facets)[:, None].repeat(facets.shape[1], axis=1)])
    return in_order(drawn) if facets.shape[1] == 2 else drawn


def write_facets(path: Path, states: Mapping[str, ContactState], fields: Mapping[str, Mapping[str, np.ndarray]],
                 world: MPI.Comm = MPI.COMM_SELF) -> None:
    """Add contacts/NAME/facets (f, d) and contacts/NAME/initial_gap (l,) to result.h5 in the folder `path`.

    Facets are the cells of `contact_fields`; the gap (m), at the factor 1 of its history, has an entry per line of the
    contact's table. Each rank has some of the contacts. Collective. Raises OutputError, on all ranks.
    """
    own = {f"contacts/{name}/facets": fields[name]["cells"] for name in states}
    own |= {f"contacts/{name}/initial_gap": state.interface.gap[state.interface.lines.row]
            for name, state in states.items()}
    write_rows(path / "result.h5", {name: [part] for name, part in own.items()},
               {name: (0, len(part)) for name, part in own.items()}, world, "")


def write_xdmf(path: Path, times: Sequence[float] = (), bodies: Mapping[str, tuple[int, int]] | None = None,
               contacts: Mapping[str, Sequence[Mapping[str, np.ndarray]]] | None = None,
               world: MPI.Comm = MPI.COMM_SELF) -> None:
    """Write result.xdmf into the folder `path`: the mesh and all fields of result.h5 as one grid without time.

    With the `times` of load steps whose fields have been written, the last one's without a number, there is a grid for
    each. meshio.read takes the grid of a single step, meshio.xdmf.TimeSeriesReader those of several; both refuse more.
    So grids of bodies and contacts by name, with their times, stand where meshio does not look, in an Information.
    ParaView and pyvista are referred to them (Reference="XML", as XDMF 2 has it). result_last.xdmf has the last of
    several load steps, for meshio.read.

    Parameters
    ----------
    bodies : numbers of nodes and cells by name, in the order of the scene; of all on the first rank
    contacts : by name the `contact_fields` at each time, in the order of the scene; none of other ranks' contacts. Each
        rank writes the grids of its own

    Collective. Raises OutputError, on all ranks.
    """
    bodies, contacts = bodies or {}, contacts or {}
    number = world.bcast(len(bodies))
    many = not 0 < (number + len(contacts)) * max(len(times), 1) <= MANY
    where = f"/Xdmf/Domain/Grid{'/Grid[1]' * bool(times)}/Information/Grid"
    depth = DEPTH + bool(times)
    with agreed(world):
        parts = {} if many else {k: _part(name, times, fields, f"{where}/Grid[{number + k + 1}]/Grid[1]", depth)
                                 for k, (name, fields) in enumerate(contacts.items()) if fields}
        ends = (b"", b"") if world.rank else _ends(path, times, bodies, "" if many else where, depth)
    write_parts(path / "result.xdmf", parts, ends, world)


def _part(name: str, times: Sequence[float], fields: Sequence[Mapping[str, np.ndarray]], first: str,
          depth: int) -> bytes:
    """The grids of a contact in result.xdmf; `first` is the XPath of the one that has the mesh of several."""
    holder = _element("Grid")
    for (parent, time), each in zip(_over(holder, name, times), fields, strict=True):
        mesh = first if times and len(parent) else ""
        _describe(_grid(parent, name, time), each, mesh=mesh)
    return f"\n{INDENT * depth}".encode() + _text(holder[0], depth)


def _ends(path: Path, times: Sequence[float], bodies: Mapping[str, tuple[int, int]], where: str,
          depth: int) -> tuple[bytes, bytes]:
    """What stands in result.xdmf before and after the grids of contacts, which have a place `where` grids have names;
    result_last.xdmf is written. Not collective. Raises OutputError."""
    import h5py

    root, domain = _document()
    with writing(path / "result.h5"), h5py.File(path / "result.h5", "r") as file:
        steps = [_datasets(file, group if (group := group_of(k)) in file else "") for k in range(len(times))]
        steps = steps or [_datasets(file, "")]
        plain = [_grid(parent, "bodies", time) for parent, time in _over(domain, "steps", times, None)]
        for grid, data in zip(plain, steps, strict=True):
            _describe(grid, data)
        if where:
            domain[0].set("Reference", "XML")
            domain[0].text = where
            hidden = _element("Information", plain[0], "<none/>", Name="named")  # as meshio reads it
            named = _element("Grid", hidden, Name="results", GridType="Collection", CollectionType="Spatial")
            first = np.zeros(2, int)
            for name, number in bodies.items():
                for (parent, time), data in zip(_over(named, name, times), steps, strict=True):
                    _describe(_grid(parent, name, time), data, (first, np.array(number)))
                first = first + number
            _element("contacts", named)
        if times:
            last, its = _document()
            _describe(_grid(its, "bodies", None), _datasets(file, ""))
            _write_document(path / "result_last.xdmf", last)
    head, _, tail = (DECLARED + _text(root)).partition(f"\n{INDENT * depth}<contacts />".encode())
    return head, tail


def write_surface(path: Path, name: str, fields: Mapping[str, np.ndarray]) -> None:
    """Write the `contact_fields` of the contact `name` as contact_NAME.vtu into the folder `path`, which ParaView,
    pyvista and meshio read. Not collective. Raises OutputError."""
    number, width = fields["cells"].shape
    root = _element("VTKFile", type="UnstructuredGrid", version="0.1", byte_order="LittleEndian")
    piece = _element("Piece", _element("UnstructuredGrid", root), NumberOfPoints=str(len(fields["points"])),
                     NumberOfCells=str(number))
    cells = {"connectivity": fields["cells"].ravel(), "offsets": width * np.arange(1, number + 1),
             "types": np.full(number, {2: 3, 3: 5}[width])}  # VTK's lines and triangles
    for tag, arrays in {"Points": {"points": fields["points"]}, "Cells": cells, "PointData": {
            key: values for key, values in fields.items() if key not in MESH}}.items():
        parent = _element(tag, piece)
        for key, values in arrays.items():
            item = _element("DataArray", parent, _words(*values.ravel().tolist()), Name=key, format="ascii",
                            type="Int64" if values.dtype.kind == "i" else "Float64")
            if values.ndim > 1:
                item.set("NumberOfComponents", str(values.shape[1]))
    _write_document(path / contact_files(name).surface, root)


def _element(tag: str, parent: Any = None, text: str | None = None, **attributes: str) -> Any:
    """A new element of XML, the last one in its `parent` where there is one."""
    from xml.etree import ElementTree

    found = ElementTree.Element(tag, attributes)
    found.text = text
    if parent is not None:
        parent.append(found)
    return found


def _text(root: Any, depth: int = 0) -> bytes:
    """An element as text, set in as at some `depth` of a document."""
    from xml.etree import ElementTree

    ElementTree.indent(root, level=depth)
    return ElementTree.tostring(root, "unicode").encode()


def _document() -> tuple[Any, Any]:
    """The root of a new document of XDMF, and the domain in it."""
    root = _element("Xdmf", Version="3.0")
    return root, _element("Domain", root)


def _write_document(path: Path, root: Any) -> None:
    with writing(path):
        path.write_bytes(DECLARED + _text(root))


def _over(parent: Any, name: str, times: Sequence[float],
          time: float | None = 1.0) -> list[tuple[Any, float | None]]:
    """Where the grid of each time stands, and the time: in a collection, or in `parent` where there is one `time`."""
    if not times:
        return [(parent, time)]
    series = _element("Grid", parent, Name=name, GridType="Collection", CollectionType="Temporal")
    return [(series, time) for time in times]


def _grid(parent: Any, name: str, time: float | None) -> Any:
    grid = _element("Grid", parent, Name=name, GridType="Uniform")
    if time is not None:
        _element("Time", grid, Value=repr(time))
    return grid


def group_of(step: int) -> str:
    """Where result.h5 has the fields of a load step before the last one."""
    return f"step_{step:06d}"


def _datasets(file: Any, group: str) -> dict[str, Any]:
    """The datasets of result.h5 by name; those of a load step, if its `group` has a name, in their place."""
    import h5py

    own = {name: data for name, data in file.items() if isinstance(data, h5py.Dataset)}
    if not group:
        return own
    return {name: own[name] for name in own if name not in AT_STEPS} | dict(file[group].items())


def _describe(grid: Any, fields: Mapping[str, Any], part: tuple[np.ndarray, np.ndarray] | None = None,
              mesh: str = "") -> None:
    """Add datasets or arrays to an XDMF grid: a mesh and its fields; of the nodes and cells (2,) that a `part`
    begins with and has in number. The `mesh` may be that of another grid, named by its XPath."""
    for name, data in fields.items():
        kind = 0 if name in AT_NODES else 1
        start, number = (0, len(data)) if part is None else (int(each[kind]) for each in part)
        if mesh and name in MESH:
            _element(MESH[name], grid, f"{mesh}/{MESH[name]}", Reference="XML")
            continue
        if name == "points":
            parent = _element("Geometry", grid, GeometryType="XYZ")
        elif name == "cells":
            topology = cell_with(data.shape[1]).topology
            parent = _element("Topology", grid, TopologyType=topology, NumberOfElements=str(number))
            if topology == "Polyline":
                parent.set("NodesPerElement", "2")
            if part is not None:
                parent.set("BaseOffset", str(part[0][0]))
        else:
            parent = _element("Attribute", grid, Name=name, AttributeType=KIND[int(np.prod(data.shape[1:]))],
                              Center="Cell" if kind else "Node")
        if part is not None:
            parent = _element("DataItem", parent, ItemType="HyperSlab", Dimensions=_words(number, *data.shape[1:]))
            slab = np.array([[start, 1, number], *([0, 1, size] for size in data.shape[1:])])
            _element("DataItem", parent, _words(*slab.T.ravel().tolist()), DataType="Int", Format="XML",
                     Dimensions=f"3 {data.ndim}")
        stored = not isinstance(data, np.ndarray)
        _element("DataItem", parent, f"result.h5:{data.name}" if stored else _words(*data.ravel().tolist()),
                 DataType="Int" if data.dtype.kind == "i" else "Float", Precision="8",
                 Format="HDF" if stored else "XML", Dimensions=_words(*data.shape))


def _words(*numbers: float) -> str:
    return " ".join(map(repr, numbers))


def _padded(array: np.ndarray) -> np.ndarray:
    return np.pad(array, ((0, 0), (0, 3 - array.shape[1])))


def linear_triangles(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (nt, k) in the plane as triangles between neighbouring nodes, and the cell that each is part of."""
    parts = cell_with(cells.shape[1]).parts
    return cells[:, parts].reshape(-1, 3), np.repeat(np.arange(len(cells)), len(parts))


def owners(results: Results) -> np.ndarray:
    """(nv,) the number of the body that each node belongs to."""
    found = np.zeros(len(results.fields["points"]), int)
    found[results.fields["cells"]] = results.fields["body"][:, None]
    return found


def vectors(table: Columns, name: str = "") -> np.ndarray:
    """(l, d) of the columns of a contact's table whose names are `name` before x, y and z; the places, by default."""
    return np.column_stack([table[f"{name}{axis}"] for axis in "xyz" if f"{name}{axis}" in table])
