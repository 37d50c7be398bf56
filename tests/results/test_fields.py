"""The fields of all bodies and contacts in one file, for ParaView, pyvista and meshio."""

import csv
from dataclasses import replace

import h5py
import made_up
import meshio
import numpy as np
import pytest
from mpi4py import MPI

from ddmpi.interface.interface import Drawing
from ddmpi.results.fields import contact_fields, table_fields, write_fields
from ddmpi.results.tables import STATUS, chains
from ddmpi.results.xdmf import MANY, write_xdmf
from ddmpi.system.files import write_rows


@pytest.mark.parametrize("order", [1, 2])
def test_meshio_reads_all_bodies(tmp_path, order):
    """meshio.read takes result.xdmf as it is: nodes, triangles and fields of all bodies in the order of the scene."""
    blocks = [made_up.block(origin, (6, 2), order) for origin in made_up.ROW.values()]
    parts = [made_up.fields(block, error=True) for block in blocks]
    write_fields(tmp_path, dict(enumerate(parts)))
    write_xdmf(tmp_path)
    mesh = meshio.read(tmp_path / "result.xdmf")
    assert [cells.type for cells in mesh.cells] == [{1: "triangle", 2: "triangle6"}[order]]
    assert set(mesh.point_data) == {
        "displacement",
        "nodal_stress",
        "nodal_principal",
        "nodal_von_mises",
    }
    assert set(mesh.cell_data) == {"body", "stress", "principal", "von_mises", "error"}
    first = 0
    for number, (block, part) in enumerate(zip(blocks, parts, strict=True)):
        nodes, own = slice(first, first + len(block.points)), mesh.cell_data["body"][0] == number
        first = nodes.stop
        assert np.array_equal(mesh.points[nodes], np.pad(block.points, ((0, 0), (0, 1))))
        assert np.array_equal(
            mesh.point_data["displacement"][nodes], np.pad(part.displacement, ((0, 0), (0, 1)))
        )
        assert np.array_equal(
            mesh.points[mesh.cells[0].data[own], :2], block.points[block.triangles]
        )
        assert np.array_equal(mesh.cell_data["von_mises"][0][own], part.von_mises)
        assert np.array_equal(mesh.cell_data["error"][0][own], part.error)
        for stresses, expected, principal in (
            (mesh.cell_data["stress"][0][own], part.stress, mesh.cell_data["principal"][0][own]),
            (
                mesh.point_data["nodal_stress"][nodes],
                part.nodal_stress,
                mesh.point_data["nodal_principal"][nodes],
            ),
        ):
            assert (
                np.array_equal(stresses[:, [0, 3, 5, 1]], expected)
                and not stresses[:, [2, 4]].any()
            )
            assert principal.sum(axis=1) == pytest.approx(expected[:, :3].sum(axis=1))
    assert first == len(mesh.points)


def test_fields_that_nobody_asks_for_are_left_out(tmp_path):
    """Without stress and error, files have displacements and bodies only."""
    block = made_up.block(divisions=(6, 2))
    write_fields(tmp_path, {0: made_up.fields(block, stresses=False)})
    write_xdmf(tmp_path)
    with h5py.File(tmp_path / "result.h5") as file:
        assert set(file) == {"points", "cells", "body", "displacement"} and set(file["cells"]) == {
            "triangle"
        }
    assert set(meshio.read(tmp_path / "result.xdmf").cell_data) == {"body"}


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_rows_of_all_ranks_are_of_one_kind(comm, tmp_path):
    """What a rank has in another precision than the first is written as the first has it."""
    rows = (np.arange(6.0).reshape(2, 3) + 6.0 * comm.rank).astype((float, "f4", int)[comm.rank])
    path = comm.bcast(tmp_path / "rows.h5")
    write_rows(
        path,
        {"rows": ([rows[:1], rows[1:]], 2 * comm.rank + np.arange(2), 2 * comm.size)},
        comm,
    )
    with h5py.File(path) as file:
        assert np.array_equal(file["rows"], np.arange(6.0 * comm.size).reshape(-1, 3))


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_ranks_write_their_contacts_as_one_does(comm, tmp_path):
    """What result.xdmf and result.h5 say of each contact does not depend on who has it; no rank needs to have one."""
    meshes = {name: made_up.block(origin) for name, origin in made_up.ROW.items()}
    states = {
        name: made_up.state(
            made_up.interface(name, *(meshes[body] for body in name.split("-")), on)
        )
        for name, on in made_up.CONTACTS["row"].items()
    }
    bodies = {number: made_up.fields(mesh) for number, mesh in enumerate(meshes.values())}
    found = []
    for world, own in (
        (MPI.COMM_SELF, list(states)),
        (comm, list(states)[comm.rank : comm.rank + 1]),
    ):
        folder = (world.bcast(tmp_path) if world.size > 1 else tmp_path) / f"of {world.size}"
        folder.mkdir(exist_ok=True)
        world.Barrier()
        mine = {k: bodies[k] for k in bodies if world.size == 1 or k == comm.rank}
        surfaces = {name: contact_fields(states[name]) for name in own}
        places = write_fields(
            folder, mine, surfaces, world, tables={name: table_fields(states[name]) for name in own}
        )
        write_fields(folder, mine, surfaces, world, step=0)
        if world.rank == 0:
            write_xdmf(
                folder,
                (0.5, 1.0),
                {name: places[k] for k, name in enumerate(meshes)},
                {name: places[name] for name in states},
            )
        world.Barrier()
        with h5py.File(folder / "result.h5") as file:
            found.append(
                (
                    made_up.named_grids(folder),
                    {
                        f"{name}/{key}": data[()].tolist()
                        for name, group in file["contacts"].items()
                        for key, data in group.items()
                    },
                )
            )
        world.Barrier()
    np.testing.assert_equal(found[0], found[1])
    assert len(found[0][1]) == 3 * len(states) and list(found[0][0]) == [*meshes, *states]


@pytest.mark.parametrize("order", [1, 2])
def test_bodies_and_contacts_are_grids_of_their_names(tmp_path, order):
    """With a time, also of a single step; contacts have what their tables have, on lines between their nodes."""
    made_up.results(tmp_path, "row", order)
    grids = made_up.named_grids(tmp_path)
    assert list(grids) == [*made_up.ROW, *made_up.CONTACTS["row"]]
    for name, origin in made_up.ROW.items():
        (grid,), mesh = grids[name], made_up.block(origin, (24, 8), order)
        part = made_up.fields(mesh)
        assert grid["time"] == 1.0 and np.array_equal(grid["Topology"], mesh.triangles)
        assert np.array_equal(grid["Geometry"][:, :2], mesh.points)
        assert np.array_equal(grid["displacement"][:, :2], part.displacement)
        assert np.array_equal(grid["von_mises"], part.von_mises) and len(grid["stress"]) == len(
            mesh.triangles
        )
    for name in made_up.CONTACTS["row"]:
        (grid,), table = (
            grids[name],
            list(csv.DictReader((tmp_path / f"contact_{name}.csv").open())),
        )
        for ours, theirs in {
            "pressure": "normal_stress",
            "friction": "tangential_stress",
            "gap": "gap",
            "slip": "slip",
            "slip_total": "slip_total",
        }.items():
            assert grid[ours].tolist() == [float(row[theirs]) for row in table], ours
        assert [STATUS[int(k)] for k in grid["status"]] == [row["status"] for row in table]
        assert grid["Geometry"].tolist() == [
            [float(row["x"]), float(row["y"]), 0.0] for row in table
        ]
        assert grid["Topology"].tolist() == [[k, k + 1] for k in range(len(table) - 1)]
    assert len(meshio.read(tmp_path / "result.xdmf").points) == sum(
        len(grids[name][0]["Geometry"]) for name in made_up.ROW
    )


def test_contacts_in_pieces_and_of_one_node():
    """Lines join neighbours only, close closed contacts, and are points where a node has no neighbour."""
    upper, lower = (made_up.block(origin) for origin in made_up.STACK.values())
    flat = made_up.interface("upper-lower", upper, lower, ("bottom", "top"))
    inner, outer = (made_up.ring(radii) for radii in ((1.0, 2.0), (2.0, 3.0)))
    closed = made_up.interface("inner-outer", inner, outer, ("outside", "inside"))
    ring = list(range(24))
    for contact, nodes, joined, chained in (
        (flat, [3, 4, 6, 8, 9], [[0, 1], [2, 2], [3, 4]], [[0, 1], [2], [3, 4]]),
        (flat, [5], [[0, 0]], [[0]]),
        (closed, ring, [[k, (k + 1) % 24] for k in ring], [[*ring, 0]]),
    ):
        lines = contact.lines.only(np.isin(np.arange(contact.m), nodes))
        facets = table_fields(made_up.state(replace(contact, drawing=Drawing(lines))))["facets"]
        assert facets.tolist() == joined and [each.tolist() for each in chains(facets)] == chained


def test_very_many_grids_have_no_names(tmp_path):
    """Then the file is the plain one that meshio reads."""
    made_up.results(tmp_path)
    write_xdmf(tmp_path, (), dict.fromkeys(map(str, range(MANY + 1)), np.ones((2, 2), int)))
    assert (tmp_path / "result.xdmf").stat().st_size < 10_000


def test_a_contact_of_which_no_facet_is_drawn_is_written(tmp_path):
    """Of two nodes that share a row one hardly faces the other side; the contacts after it stand where they belong."""
    upper, lower = (made_up.block(origin) for origin in made_up.STACK.values())
    contact = made_up.interface("upper-lower", upper, lower, ("bottom", "top"))
    lines = replace(
        contact.lines,
        row=np.zeros(2, int),
        xy=contact.xy[:2],
        area=np.array([1.0, 1e-3]),
        facets=np.array([[0, 1]]),
    )
    none = replace(
        contact.drawing.outline,
        xy=contact.xy[:2],
        cells=np.empty((0, 2), int),
        shares=contact.drawing.outline.shares[:2],
    )
    states = {
        "bare": made_up.state(replace(contact, drawing=Drawing(lines, lambda: none))),
        "whole": made_up.state(contact),
    }
    bare, whole = map(contact_fields, states.values())
    places = write_fields(
        tmp_path,
        {0: made_up.fields(upper)},
        {"bare": bare, "whole": whole},
        tables={name: table_fields(each) for name, each in states.items()},
    )
    assert places["bare"].tolist() == [[0, 0], [2, 0]] and places["whole"][0].tolist() == [2, 0]
    with h5py.File(tmp_path / "result.h5") as file:
        assert (
            np.array_equal(file["surfaces/cells"], whole["cells"] + 2)
            and len(file["contacts/bare/facets"]) == 0
        )
        assert np.array_equal(file["surfaces/pressure"][2:], whole["pressure"])
