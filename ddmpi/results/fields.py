"""Fields of all bodies in result.h5."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI

from ddmpi.body.stress import principal, turned, von_mises
from ddmpi.interface.interface import Lines
from ddmpi.interface.state import ContactState
from ddmpi.mesh.elements import Cell, cell_with
from ddmpi.mesh.mesh import boundary_facets
from ddmpi.results.tables import Columns, Results, leg_values, together
from ddmpi.scene.given import CELLS
from ddmpi.surface.curve import in_order
from ddmpi.surface.outline import Outline
from ddmpi.system.agreement import gathered
from ddmpi.system.files import Part, write_rows
from ddmpi.system.numbers import Frame

Datasets = Mapping[str, np.ndarray]  # the data of a body or a contact in result.h5, by name
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

BY_KIND = sorted(f"cells/{kind}" for d in (2, 3) for kind in CELLS[d].values())
"""The datasets of cells in result.h5, in the order in which cells stand in others."""

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
        points, kind = data.pop("points"), self.kind
        del data["body"], data[f"cells/{kind}"]
        return meshio.Mesh(
            points,
            [(kind, self.cells)],
            {name: values for name, values in data.items() if name in AT_NODES},
            {name: [values] for name, values in data.items() if name not in AT_NODES},
        )

    @property
    def triangles(self) -> np.ndarray:
        return self.cells

    @property
    def kind(self) -> str:
        """meshio's word for the cells."""
        return CELLS[self.points.shape[1]][self.cells.shape[1]]

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
    of a `step` before it are added in a group. Cells stand by kind, as in `cells/tetra`; what has a row per cell is in
    the order of the kinds' names.

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
    parts = dict[str, Part]()
    spans = dict[int | str, np.ndarray]()
    for group, entries in everything.items():
        rows = _rows(entries, world)
        spans |= {key: np.array([own.first, own.number]) for key, own in rows.items()}
        for name, part in _parts(entries, rows):
            if step is None or name in AT_STEPS or (group and tables):
                parts[group + name] = part
    for name, table in (tables or {}).items():
        for key, data in {**table, "span": spans[name]}.items():
            parts[f"contacts/{name}/{key}"] = [data], [0], len(data)
    write_rows(path / "result.h5", parts, world, None if step is None else group_of(step))
    return gathered(world, spans)


@dataclass(frozen=True)
class Rows:
    """Where the rows of a body or contact stand in the datasets of all.

    Attributes
    ----------
    first, number, total : (2,) its first node and cell, their numbers, and those of all
    of_kind : its first cell and the number of all of its kind
    """

    first: tuple[int, int]
    number: tuple[int, int]
    total: tuple[int, int]
    of_kind: tuple[int, int]

    def places(self, name: str) -> tuple[int, int]:
        """Its first row in the dataset `name`, and the number of rows of that."""
        if name.startswith("cells/"):
            return self.of_kind
        of = int(name not in AT_NODES)
        return self.first[of], self.total[of]


def _rows(entries: Mapping[Any, Datasets], world: MPI.Comm) -> dict[Any, Rows]:
    """The rows of this rank's entries, of which those of a rank follow those of the ranks before it; cells by kind.
    Collective."""
    kinds = ["points", "cells", *BY_KIND]
    number = np.array(
        [[len(entry.get(kind, ())) for kind in kinds] for entry in entries.values()], int
    ).reshape(-1, len(kinds))
    mine = number.sum(axis=0)
    ends, total = np.empty_like(mine), np.empty_like(mine)
    MPI.Intracomm(world).Scan(mine, ends)
    world.Allreduce(mine, total)
    within = ends - number[::-1].cumsum(axis=0)[::-1]
    before = np.append(0, total[1:].cumsum()[:-1])
    rows = {}
    for key, counts, firsts in zip(entries, number, within, strict=True):
        kind = 1 + int(counts[1:].argmax())
        rows[key] = Rows(
            (int(firsts[0]), int(before[kind - 1] + firsts[kind])),
            (int(counts[0]), int(counts[kind])),
            (int(total[0]), int(total[1:].sum())),
            (int(firsts[kind]), int(total[kind])),
        )
    return rows


def by_kind(cells: np.ndarray, dimension: int) -> Iterator[tuple[Cell, np.ndarray, np.ndarray]]:
    """The kinds of cells among (nt, width), see `together`: the reference cell, the numbers (n,), and their nodes (n, k)."""
    number = (cells >= 0).sum(axis=1)
    for k in np.unique(number).tolist():
        some = np.flatnonzero(number == k)
        yield cell_with(k, dimension), some, cells[some, :k]


def _parts(entries: Mapping[Any, Datasets], rows: Mapping[Any, Rows]) -> Iterator[tuple[str, Part]]:
    """The datasets of all entries by name; cells by the numbers of nodes among all."""
    for name in {name: None for entry in entries.values() for name in entry}:
        own = {key: entry[name] for key, entry in entries.items() if name in entry}
        if name.startswith("cells"):
            own = {key: cells + rows[key].first[0] for key, cells in own.items()}
        found = [rows[key].places(name) for key in own]
        yield name, (list(own.values()), [first for first, _ in found], found[0][1])


def _datasets_of(fields: Fields, body: int) -> dict[str, np.ndarray]:
    """The datasets of result.h5 of the body number `body`, by name."""
    data = {
        "points": _padded(fields.points),
        f"cells/{fields.kind}": fields.cells,
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


def group_of(step: int) -> str:
    """The group of result.h5 with the fields of a load step before the last one."""
    return f"step_{step:06d}"


def _padded(array: np.ndarray) -> np.ndarray:
    return np.pad(array, ((0, 0), (0, 3 - array.shape[1])))


def boundary_of(cells: np.ndarray, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """`boundary_facets` of cells (nt, width) of several kinds: facets (f, ·) `together`, and their cells (f,)."""
    found = [
        (some, *boundary_facets(nodes, dimension)) for _, some, nodes in by_kind(cells, dimension)
    ]
    outer = together([facets for _, facets, _ in found])
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
