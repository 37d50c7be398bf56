"""What describes result.h5 to ParaView, pyvista and meshio: result.xdmf; and contact_NAME.vtu for the same programs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np

from ddmpi.mesh.elements import CELLS, Cell, cell_with
from ddmpi.results.fields import AT_NODES, AT_STEPS, SURFACES, Datasets, group_of
from ddmpi.results.tables import cells_by_kind, datasets
from ddmpi.system.files import contact_files, writing

KIND = {
    1: "Scalar",
    3: "Vector",
    6: "Tensor6",
}  # what XDMF calls a field, by its number of components

MANY = 10_000  # most grids of single bodies and contacts, one for each load step, in result.xdmf

Stored = tuple[str, tuple[int, ...], str]  # path, shape and kind of numbers of a dataset


@dataclass(frozen=True)
class Shown:
    """What a grid shows: cells of one kind, with their fields.

    Attributes
    ----------
    name : of the grid
    kind : the cells
    steps : of each load step the datasets by name
    first : the cell in which the dataset of these cells begins
    span : (2, 2) the first node and cell, and their numbers; None for all
    """

    name: str
    kind: Cell
    steps: Sequence[Mapping[str, Stored]]
    first: int = 0
    span: np.ndarray | None = None


def write_xdmf(
    path: Path,
    times: Sequence[float] = (),
    bodies: Mapping[str, np.ndarray] | None = None,
    contacts: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write result.xdmf into the folder `path`: the mesh and all fields of result.h5 as one grid without time, or as a
    grid for each kind of cells.

    With the `times` of load steps whose fields have been written, the last one's without a number, there is a grid
    for each. meshio.read takes the grid of a single step, meshio.xdmf.TimeSeriesReader those of several; both refuse
    more, as those of several kinds. So grids of bodies and contacts by name, with their times, stand where meshio does
    not look, in an Information. ParaView and pyvista are referred to them (Reference="XML", as XDMF 2 has it).
    result_last.xdmf has the last of several load steps, for meshio.read.

    Parameters
    ----------
    bodies, contacts : by name in the order of the scene, where `write_fields` has written them

    Not collective. Raises OutputError.
    """
    import h5py

    with writing(path / "result.h5"), h5py.File(path / "result.h5", "r") as file:
        number = max(len(times), 1)
        kinds = list(_kinds(file, [_described(file, "/", group_of(k)) for k in range(number)]))
        surfaces = [_described(file, f"/{SURFACES}", group_of(k)) for k in range(number)]
    starts = [kind.first for kind in kinds]
    grids = []
    for name, span in (bodies or {}).items():
        own = kinds[np.searchsorted(starts, span[0, 1], side="right") - 1]
        grids.append(replace(own, name=name, span=span))
    for name, span in (contacts or {}).items():
        called = f"contact {name}" if name in (bodies or {}) else name
        facets = CELLS[kinds[0].kind.dimension - 1, 1]
        grids.append(Shown(called, facets, surfaces, span=span))
    root = Element("Xdmf", Version="3.0")
    domain = SubElement(root, "Domain")
    _add_all(domain, kinds, times)
    if 0 < len(grids) * number <= MANY:
        depth = bool(times) + (len(kinds) > 1)
        domain[0].set("Reference", "XML")
        domain[0].text = f"/Xdmf/Domain/Grid{'/Grid[1]' * depth}/Information/Grid"
        first = domain[0]
        for _ in range(depth):
            first = first[0]
        hidden = SubElement(first, "Information", Name="named")
        hidden.text = "<none/>"  # as meshio reads it
        named = _collection(hidden, "results", "Spatial")
        for grid in grids:
            _add_grids(named, grid, times, alone=1.0)
    _write_document(path / "result.xdmf", root)
    if times and len(kinds) == 1:
        root = Element("Xdmf", Version="3.0")
        last = replace(kinds[0], steps=kinds[0].steps[-1:])
        _add_all(SubElement(root, "Domain"), [last], ())
        _write_document(path / "result_last.xdmf", root)


def _kinds(file: Any, steps: Sequence[Mapping[str, Stored]]) -> Iterator[Shown]:
    """The cells of all bodies by kind, with the fields of all `steps`."""
    dimension = 2 + int(file["points"][:, 2].any())
    nodes, first = len(file["points"]), 0
    cells = cells_by_kind(file)
    for name, data in cells.items():
        number, width = data.shape
        stored = {"cells": (data.name, data.shape, data.dtype.kind)}
        yield Shown(
            name,
            cell_with(width, dimension),
            [{**fields, **stored} for fields in steps],
            first,
            np.array([[0, first], [nodes, number]]) if len(cells) > 1 else None,
        )
        first += number


def _add_all(domain: Element, kinds: Sequence[Shown], times: Sequence[float]) -> None:
    """Add the grid of all bodies, or one for each kind of their cells."""
    if len(kinds) == 1:
        _add_grids(domain, replace(kinds[0], name="bodies"), times)
        return
    together = _collection(domain, "bodies", "Spatial")
    for kind in kinds:
        _add_grids(together, kind, times)


def _collection(parent: Element, name: str, of: str) -> Element:
    return SubElement(parent, "Grid", Name=name, GridType="Collection", CollectionType=of)


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


def _described(file: Any, group: str, step: str = "") -> dict[str, Stored]:
    """Path, shape and kind of the datasets in a group of result.h5, by name; those of a load step in their place."""
    last, changed = (
        datasets(file.get(group, {})),
        datasets(file.get(f"{step}{group}", {})) if step else {},
    )
    kept = {name: last[name] for name in last if not changed or name not in AT_STEPS} | changed
    return {name: (data.name, data.shape, data.dtype.kind) for name, data in kept.items()}


def _add_grids(
    parent: Element, shown: Shown, times: Sequence[float], alone: float | None = None
) -> None:
    """Add grids to an element of XDMF: a collection with one for each time, or a single one with the time `alone`."""
    if times:
        parent = _collection(parent, shown.name, "Temporal")
    for time, fields in zip(times if times else [alone], shown.steps, strict=True):
        grid = SubElement(parent, "Grid", Name=shown.name, GridType="Uniform")
        if time is not None:
            SubElement(grid, "Time", Value=repr(time))
        for field, stored in fields.items():
            _add_field(grid, field, stored, shown)


def _add_field(
    grid: Element,
    name: str,
    stored: Stored,
    shown: Shown,
) -> None:
    """Add a `stored` field, or what is shown of it, to a grid."""
    (path, shape, kind), nodal, span = stored, name in AT_NODES, shown.span
    start, number = (0, shape[0]) if span is None else span[:, 0 if nodal else 1].tolist()
    if name == "points":
        parent = SubElement(grid, "Geometry", GeometryType="XYZ")
    elif name == "cells":
        start -= shown.first
        topology = shown.kind.topology
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
            parent, "DataItem", ItemType="HyperSlab", Dimensions=_words(number, *shape[1:])
        )
        slab = np.array([[start, 1, number], *([0, 1, size] for size in shape[1:])])
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
