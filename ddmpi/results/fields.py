"""Fields of the bodies: result.h5, and result.xdmf that describes it."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from ddmpi.methods.outer import Step
from ddmpi.interface.state import ContactState
from ddmpi.errors import HeldError, InputError, OutputError, TakenError
from ddmpi.system.files import CHECKPOINT, FileOfHDF5, clear_unfinished, link_new, locked, publishing, unfinished
from ddmpi.system.files import RESULTS as NAMES
from ddmpi.interface.interface import Interface
from ddmpi.results.folder import _guarded


XDMF = """<?xml version="1.0"?>
<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>
<Xdmf Version="3.0" xmlns:xi="http://www.w3.org/2001/XInclude">
  <Domain>
    <Grid Name="mesh" GridType="Uniform">
      <Geometry GeometryType="XYZ">
        <DataItem DataType="Float" Precision="8" Format="HDF" Dimensions="{nv} 3">result.h5:/points</DataItem>
      </Geometry>
      <Topology TopologyType="{topology}" NumberOfElements="{nt}" NodesPerElement="{k}">
        <DataItem DataType="Int" Precision="8" Format="HDF" Dimensions="{nt} {k}">result.h5:/cells</DataItem>
      </Topology>
    </Grid>
    <Grid Name="steps" GridType="Collection" CollectionType="Temporal">
      <Grid Name="step">
        <xi:include xpointer="xpointer(//Grid[@Name=&quot;mesh&quot;]/*[self::Topology or self::Geometry])"/>
        <Time Value="0.0"/>
{attributes}
      </Grid>
    </Grid>
  </Domain>
</Xdmf>
"""

ATTRIBUTE = """        <Attribute Name="{name}" AttributeType="{kind}" Center="{center}">
          <DataItem DataType="{type}" Precision="8" Format="HDF" Dimensions="{dimensions}">result.h5:/{name}</DataItem>
        </Attribute>"""

TOPOLOGY = {3: "Triangle", 6: "Triangle_6"}

KIND = {1: "Scalar", 3: "Vector", 6: "Tensor6"}


@dataclass(frozen=True)
class Fields:
    """Fields of one body; stress, von Mises and error are None where no one asked for them.

    points (nv, 2) m, triangles (nt, 3 or 6), displacement (nv, 2) m, stress (nt, 4) as
    `elasticity.stress` and von_mises (nt,) in Pa.
    """

    points: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None = None
    von_mises: np.ndarray | None = None
    error: np.ndarray | None = None


def write_fields(path: Path, fields: Fields, body: int, sizes: Sequence[tuple[int, int]]) -> None:
    """Write the part of body number `body` into result.h5; body 0 creates the file.

    `sizes` holds the numbers of nodes and triangles of all bodies. Not collective: the caller
    sees to it that bodies write one after another. Raises OutputError.
    """
    import h5py

    nodes = sum(nv for nv, _ in sizes[:body])
    cells = sum(nt for _, nt in sizes[:body])
    parts = {"points": (_padded(fields.points), nodes), "cells": (fields.triangles + nodes, cells),
             "displacement": (_padded(fields.displacement), nodes),
             "body": (np.full(len(fields.triangles), body), cells)}
    if fields.stress is not None:
        xx, yy, zz, xy = fields.stress.T
        zero = np.zeros_like(xx)
        parts["stress"] = (np.column_stack([xx, xy, zero, yy, zero, zz]), cells)
        parts["von_mises"] = (fields.von_mises, cells)
    if fields.error is not None:
        parts["error"] = (fields.error, cells)

    def write() -> None:
        mode = "w" if body == 0 else "r+"
        with FileOfHDF5(path / "result.h5", f"{mode[0]}+") as storage, h5py.File(storage, mode) as file:
            for name, (part, start) in parts.items():
                if body == 0:
                    total = sum(size[0 if name in ("points", "displacement") else 1] for size in sizes)
                    file.create_dataset(name, (total, *part.shape[1:]), dtype=part.dtype)
                file[name][start:start + len(part)] = part
    _guarded(write, path / "result.h5")


def write_xdmf(path: Path) -> None:
    """Write result.xdmf, a time series of one step, which describes result.h5. Raises OutputError."""
    import h5py

    def write() -> None:
        with h5py.File(path / "result.h5", "r") as file:
            nv, (nt, k) = len(file["points"]), file["cells"].shape
            attributes = [ATTRIBUTE.format(
                name=name, kind=KIND[data.shape[1] if data.ndim > 1 else 1],
                center="Node" if name == "displacement" else "Cell",
                type="Int" if data.dtype.kind == "i" else "Float",
                dimensions=" ".join(str(d) for d in data.shape))
                for name, data in file.items() if name not in ("points", "cells")]
        (path / "result.xdmf").write_text(XDMF.format(
            nv=nv, nt=nt, k=k, topology=TOPOLOGY[k], attributes="\n".join(attributes)))
    _guarded(write, path / "result.xdmf")


def _padded(array: np.ndarray) -> np.ndarray:
    return np.column_stack([array, np.zeros(len(array))])
