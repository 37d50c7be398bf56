"""Fields of all bodies: result.h5, and result.xdmf, which describes it to ParaView and meshio."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.results.tables import writing
from ddmpi.system.files import FileOfHDF5

TOPOLOGY = {3: "Triangle", 6: "Triangle_6"}
"""What XDMF calls triangles, by their number of nodes."""

KIND = {1: "Scalar", 3: "Vector", 6: "Tensor6"}
"""What XDMF calls a field, by its number of components."""

AT_STEPS = ("displacement", "stress", "von_mises", "error")
"""The datasets that differ from load step to load step."""

AT_NODES = ("points", "displacement")
"""The datasets with a row per node; all others have a row per triangle."""


@dataclass(frozen=True)
class Fields:
    """Fields of one body; stress, von Mises stress and error are None where the scene does not ask for them.

    Attributes
    ----------
    points : (nv, 2) positions (m)
    triangles : (nt, 3 or 6) nodes, as in `mesh.mesh.Mesh`
    displacement : (nv, 2) in m
    stress : (nt, 4) in Pa, as in `body.stress.stress`
    von_mises : (nt,) in Pa
    error : (nt,) estimated discretization error, without unit
    """

    points: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None = None
    von_mises: np.ndarray | None = None
    error: np.ndarray | None = None


def write_fields(path: Path, fields: Fields, body: int, sizes: Sequence[tuple[int, int]],
                 step: int | None = None) -> None:
    """Write the part of one body into result.h5 in the folder `path`; the first body creates the file.

    The datasets are those of the last load step, with the mesh. The fields of a `step` before it stand in a group.

    Parameters
    ----------
    body : its number in the order of the scene
    sizes : numbers of nodes and triangles of all bodies
    step : number of a load step before the last one

    Not collective: the caller lets bodies write one after another, the first one first. Raises OutputError.
    """
    import h5py

    ends = np.cumsum([(0, 0), *sizes], axis=0)
    before, total = ends[body], ends[-1]
    parts = {"points": _padded(fields.points), "cells": fields.triangles + before[0],
             "displacement": _padded(fields.displacement), "body": np.full(len(fields.triangles), body)}
    if fields.stress is not None:
        xx, yy, zz, xy = fields.stress.T
        zero = np.zeros_like(xx)
        parts |= {"stress": np.column_stack([xx, xy, zero, yy, zero, zz]), "von_mises": fields.von_mises}
    if fields.error is not None:
        parts["error"] = fields.error
    if step is not None:
        parts = {f"{group_of(step)}/{name}": parts[name] for name in parts if name in AT_STEPS}
    target, mode = path / "result.h5", "r+" if body or step is not None else "w"
    with writing(target), FileOfHDF5(target, f"{mode[0]}+") as storage, h5py.File(storage, mode) as file:
        for name, part in parts.items():
            kind = 0 if name.rpartition("/")[2] in AT_NODES else 1
            if body == 0:
                file.create_dataset(name, (total[kind], *part.shape[1:]), dtype=part.dtype)
            file[name][before[kind]:before[kind] + len(part)] = part


def write_xdmf(path: Path, times: Sequence[float] = ()) -> None:
    """Write result.xdmf into the folder `path`: the mesh and all fields of result.h5 as one grid.

    The grid has no time: meshio.read refuses grids that have one, and ParaView does not need it for a single step. With
    the `times` of load steps whose fields have been written, the last one's without a number, there is a grid for each,
    which ParaView plays and meshio.xdmf.TimeSeriesReader reads. Not collective. Raises OutputError.
    """
    from xml.etree import ElementTree

    import h5py

    root = ElementTree.Element("Xdmf", Version="3.0")
    parent = ElementTree.SubElement(root, "Domain")
    if times:
        parent = ElementTree.SubElement(parent, "Grid", Name="steps", GridType="Collection", CollectionType="Temporal")
    with writing(path / "result.xdmf"), h5py.File(path / "result.h5", "r") as file:
        for k, time in enumerate(times or [None]):
            grid = ElementTree.SubElement(parent, "Grid", Name="bodies", GridType="Uniform")
            if time is not None:
                ElementTree.SubElement(grid, "Time", Value=repr(time))
            _describe(grid, file, group_of(k) if group_of(k) in file else "")
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(path / "result.xdmf", encoding="utf-8", xml_declaration=True)


def group_of(step: int) -> str:
    """Where result.h5 has the fields of a load step before the last one."""
    return f"step_{step:06d}"


def _describe(grid: Any, file: Any, group: str) -> None:
    """Add to an XDMF grid the mesh of an HDF5 file, and its fields: those in `group`, if that has a name."""
    from xml.etree import ElementTree

    import h5py

    fields = {name: data for name, data in file.items() if isinstance(data, h5py.Dataset)
              and not (group and name in AT_STEPS)}
    if group:
        fields |= {f"{group}/{name}": data for name, data in file[group].items()}
    for path, data in fields.items():
        name = path.rpartition("/")[2]
        if name == "points":
            parent = ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ")
        elif name == "cells":
            number, nodes = data.shape
            parent = ElementTree.SubElement(grid, "Topology", TopologyType=TOPOLOGY[nodes],
                                            NumberOfElements=str(number))
        else:
            parent = ElementTree.SubElement(grid, "Attribute", Name=name, AttributeType=KIND[data[:1].size],
                                            Center="Node" if name in AT_NODES else "Cell")
        ElementTree.SubElement(parent, "DataItem", DataType="Int" if data.dtype.kind == "i" else "Float",
                               Precision="8", Format="HDF", Dimensions=" ".join(map(str, data.shape)),
                               ).text = f"result.h5:/{path}"


def _padded(array: np.ndarray) -> np.ndarray:
    return np.column_stack([array, np.zeros(len(array))])


def linear_triangles(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (nt, 3 or 6) as triangles between neighbouring nodes, and the cell that each is part of."""
    parts = [[0, 1, 2]] if cells.shape[1] == 3 else [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
    return cells[:, parts].reshape(-1, 3), np.repeat(np.arange(len(cells)), len(parts))


def boundary_edges(cells: np.ndarray) -> np.ndarray:
    """The edges (k, 2) of triangles (nt, 3) that belong to one triangle only."""
    edges = np.sort(np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]]), axis=1)
    _, index, count = np.unique(edges @ (cells.max() + 1, 1), return_index=True, return_counts=True)
    return edges[index[count == 1]]


def middles(points: np.ndarray, cells: np.ndarray, owner: np.ndarray) -> list[np.ndarray]:
    """A node (2,) of each body far from its boundary, near the body's middle if there are several.

    Parameters
    ----------
    points, cells : nodes (nv, 2) and triangles (nt, 3)
    owner : (nv,) the body of each node
    """
    from scipy.spatial import cKDTree

    edge, found = np.unique(boundary_edges(cells)), []
    for k in range(owner.max() + 1):
        own = points[owner == k]
        depth = cKDTree(points[edge[owner[edge] == k]]).query(own)[0]
        off = np.linalg.norm(own - (own.max(axis=0) + own.min(axis=0)) / 2, axis=1)
        found.append(own[np.argmin(np.where(depth >= 0.8 * depth.max(), off, np.inf))])
    return found


def areas_at_nodes(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(nv,) a third of the areas of the triangles around each node."""
    return np.bincount(cells.ravel(), np.repeat(_areas(points, cells) / 3, 3), len(points))


def _areas(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    (ax, ay), (bx, by) = ((points[cells[:, i]] - points[cells[:, 0]]).T for i in (1, 2))
    return np.abs(ax * by - ay * bx) / 2


def at_nodes(values: np.ndarray, points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Averages over the triangles around each node, weighted by their areas."""
    total = areas_at_nodes(points, cells)
    return np.bincount(cells.ravel(), np.repeat(values * _areas(points, cells) / 3, 3),
                       len(points)) / np.where(total > 0, total, 1.0)
