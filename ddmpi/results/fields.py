"""Fields of all bodies: result.h5, and result.xdmf, which describes it to ParaView and meshio."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ddmpi.results.tables import writing
from ddmpi.system.files import FileOfHDF5

TOPOLOGY = {3: "Triangle", 6: "Triangle_6"}
"""What XDMF calls triangles, by their number of nodes."""

KIND = {1: "Scalar", 3: "Vector", 6: "Tensor6"}
"""What XDMF calls a field, by its number of components."""

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


def write_fields(path: Path, fields: Fields, body: int, sizes: Sequence[tuple[int, int]]) -> None:
    """Write the part of one body into result.h5 in the folder `path`; the first body creates the file.

    Parameters
    ----------
    body : its number in the order of the scene
    sizes : numbers of nodes and triangles of all bodies

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
    target, mode = path / "result.h5", "r+" if body else "w"
    with writing(target), FileOfHDF5(target, f"{mode[0]}+") as storage, h5py.File(storage, mode) as file:
        for name, part in parts.items():
            kind = 0 if name in AT_NODES else 1
            if body == 0:
                file.create_dataset(name, (total[kind], *part.shape[1:]), dtype=part.dtype)
            file[name][before[kind]:before[kind] + len(part)] = part


def write_xdmf(path: Path) -> None:
    """Write result.xdmf into the folder `path`: the mesh and all fields of result.h5 as one grid.

    The grid has no time: meshio.read refuses grids that have one, and ParaView does not need it for a single step.
    Not collective. Raises OutputError.
    """
    from xml.etree import ElementTree

    import h5py

    root = ElementTree.Element("Xdmf", Version="3.0")
    grid = ElementTree.SubElement(ElementTree.SubElement(root, "Domain"), "Grid", Name="bodies", GridType="Uniform")
    with writing(path / "result.xdmf"), h5py.File(path / "result.h5", "r") as file:
        for name, data in file.items():
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
                                   ).text = f"result.h5:/{name}"
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(path / "result.xdmf", encoding="utf-8", xml_declaration=True)


def _padded(array: np.ndarray) -> np.ndarray:
    return np.column_stack([array, np.zeros(len(array))])
