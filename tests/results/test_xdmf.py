"""Bodies with cells of several kinds in result.h5 and result.xdmf: a grid of each kind, and of each body."""

import bricks
import h5py
import made_up
import meshio
import numpy as np
import pytest
import solids
from mpi4py import MPI

from ddmpi.body.stress import von_mises
from ddmpi.mesh.refine import raise_order
from ddmpi.results.fields import Fields, by_kind, write_fields
from ddmpi.results.tables import read_fields
from ddmpi.results.xdmf import write_xdmf

TOPOLOGY = {
    "quad": "Quadrilateral",
    "quad8": "Quadrilateral_8",
    "triangle": "Triangle",
    "triangle6": "Triangle_6",
    "hexahedron": "Hexahedron",
    "hexahedron20": "Hexahedron_20",
    "tetra": "Tetrahedron",
    "tetra10": "Tetrahedron_10",
}
"""XDMF's names of the kinds, by those of meshio."""

BODIES = {
    2: ["quad8", "triangle", "quad", "triangle6", "triangle"],
    3: ["hexahedron20", "tetra", "hexahedron", "tetra10", "hexahedron20"],
}


def mesh_of(kind: str, number: int):
    """Some cells of a kind, beside those of other numbers."""
    d, order = 2 if kind in BODIES[2] else 3, 2 if kind[-1].isdigit() else 1
    if kind[0] in "qh":
        mesh = bricks.grid((2, 1 + number, 1)[:d], order)
    else:
        mesh = (
            made_up.block(divisions=(2, 1 + number)) if d == 2 else solids.grid((1, 1, 1 + number))
        )
        mesh = raise_order(mesh, "", order)
    mesh.points[:, 0] += 9.0 * number
    return mesh


def some(mesh, number: int, step: int) -> Fields:
    """Fields that tell body, step, and each node and cell."""
    n, d, cells = len(mesh.points), mesh.points.shape[1], len(mesh.triangles)
    u = 100.0 * number + step + np.arange(n * d).reshape(n, d) / (n * d)
    sigma = 1.0 + number + step + np.arange(cells * 2 * d).reshape(cells, 2 * d) / cells
    error = number + np.linspace(0.1, 0.9, cells)
    return Fields(mesh.points, mesh.triangles, u, sigma, error=error)


def written(folder, kinds, world=MPI.COMM_SELF) -> dict[int, Fields]:
    """Bodies of these kinds at two load steps, each with a rank of `world` by turns; those of the last step."""
    meshes = [mesh_of(kind, number) for number, kind in enumerate(kinds)]
    mine = range(len(meshes))[world.rank :: world.size]
    last = {number: some(mesh, number, 2) for number, mesh in enumerate(meshes)}
    spans = write_fields(folder, {number: last[number] for number in mine}, world=world)
    write_fields(folder, {k: some(meshes[k], k, 1) for k in mine}, world=world, step=0)
    if world.rank == 0:
        write_xdmf(folder, (0.5, 1.0), {f"body {k}": spans[k] for k in range(len(meshes))})
    world.Barrier()
    return last


def in_space(values: np.ndarray) -> np.ndarray:
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


@pytest.mark.parametrize("d", [2, 3])
def test_each_kind_of_cells_is_a_grid(tmp_path, d):
    """As a reader finds that knows XDMF alone: cells, with the body that each is of, at all load steps; and each body."""
    last = written(tmp_path, BODIES[d])
    found, bodies = made_up.grids_by_kind(tmp_path), made_up.named_grids(tmp_path)
    assert set(found) == set(BODIES[d]) and len(bodies) == len(BODIES[d])
    with h5py.File(tmp_path / "result.h5") as file:
        assert set(file["cells"]) == set(BODIES[d])
    for number, part in last.items():
        kind = BODIES[d][number]
        for grids, own in ((found[kind], None), (bodies[f"body {number}"], slice(None))):
            assert [grid["time"] for grid in grids] == [0.5, 1.0]
            assert {grid["kind"] for grid in grids} == {TOPOLOGY[kind]}
            for step, grid in enumerate(grids, start=1):
                own = grid["body"] == number if own is None else own
                nodes = grid["Topology"][own]
                assert np.array_equal(grid["Geometry"][nodes], in_space(part.points)[part.cells])
                expected = some(mesh_of(kind, number), number, step)
                assert np.array_equal(
                    grid["displacement"][nodes], in_space(expected.displacement)[part.cells]
                )
                assert np.array_equal(grid["von_mises"][own], von_mises(expected.stress))
                assert np.array_equal(grid["error"][own], expected.error)


@pytest.mark.parametrize("kind", BODIES[2][:4] + BODIES[3][:4])
def test_meshio_reads_one_kind(tmp_path, kind):
    """A file with cells of one kind, by its word for them."""
    part = written(tmp_path, [kind])[0]
    mesh = meshio.read(tmp_path / "result_last.xdmf")
    assert [block.type for block in mesh.cells] == [kind]
    assert np.array_equal(mesh.cells[0].data, part.cells)
    assert np.array_equal(mesh.points, in_space(part.points))
    assert np.array_equal(mesh.point_data["displacement"], in_space(part.displacement))
    assert np.array_equal(part.triangles, part.cells) and part.to_meshio().cells[0].type == kind


@pytest.mark.parametrize("d", [2, 3])
def test_files_of_versions_before_are_read_as_those_of_today(tmp_path, d):
    """Which had the cells of all kinds in one dataset, in the order of the bodies, with rows that end in −1."""
    last = written(tmp_path, BODIES[d])
    for old in False, True:
        with h5py.File(tmp_path / "result.h5", "r+") as file:
            if old:
                order = np.argsort(file["body"][()], kind="stable")
                cells = read_fields(file)["cells"][order]
                del file["cells"]
                file["cells"] = cells
                for name in "body", "stress", "principal", "von_mises", "error":
                    file[name][...] = file[name][()][order]
            fields = read_fields(file)
        for number, part in last.items():
            own = fields["body"] == number
            ((kind, _, nodes),) = by_kind(fields["cells"][own], d)
            assert len(kind.nodes) == part.cells.shape[1]
            assert np.array_equal(fields["points"][nodes], in_space(part.points)[part.cells])
            assert np.array_equal(fields["error"][own], part.error)


@pytest.mark.mpi(ranks=2)
def test_ranks_write_kinds_as_one_does(comm, tmp_path):
    """Also where a rank has bodies of two kinds, between those of others."""
    found = []
    for world in MPI.COMM_SELF, comm:
        folder = (comm.bcast(tmp_path) if world.size > 1 else tmp_path) / f"of {world.size}"
        folder.mkdir(exist_ok=True)
        world.Barrier()
        written(folder, BODIES[3], world)
        found.append({**made_up.grids_by_kind(folder), **made_up.named_grids(folder)})
        world.Barrier()
    for name, grids in found[0].items():
        for one, other in zip(grids, found[1][name], strict=True):
            # each rank's nodes follow those of the rank before it
            assert np.array_equal(
                one["Geometry"][one["Topology"]][np.argsort(one["error"])],
                other["Geometry"][other["Topology"]][np.argsort(other["error"])],
            )
            assert np.array_equal(np.sort(one["von_mises"]), np.sort(other["von_mises"]))
