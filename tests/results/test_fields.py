"""The fields of all bodies in one file, for ParaView and meshio."""

import h5py
import made_up
import meshio
import numpy as np
import pytest

from ddmpi.results.fields import write_fields, write_xdmf


@pytest.mark.parametrize("order", [1, 2])
def test_meshio_reads_all_bodies(tmp_path, order):
    """meshio.read takes result.xdmf as it is: nodes, triangles and fields of all bodies in the order of the scene."""
    blocks = [made_up.block(origin, (6, 2), order) for origin in made_up.ROW.values()]
    parts = [made_up.fields(block, error=True) for block in blocks]
    sizes = [(len(block.points), len(block.triangles)) for block in blocks]
    for number, part in enumerate(parts):
        write_fields(tmp_path, part, number, sizes)
    write_xdmf(tmp_path)
    mesh = meshio.read(tmp_path / "result.xdmf")
    assert [cells.type for cells in mesh.cells] == [{1: "triangle", 2: "triangle6"}[order]]
    assert list(mesh.point_data) == ["displacement"]
    assert set(mesh.cell_data) == {"body", "stress", "von_mises", "error"}
    first = 0
    for number, (block, part) in enumerate(zip(blocks, parts, strict=True)):
        nodes, own = slice(first, first + len(block.points)), mesh.cell_data["body"][0] == number
        first = nodes.stop
        assert np.array_equal(mesh.points[nodes], np.pad(block.points, ((0, 0), (0, 1))))
        assert np.array_equal(mesh.point_data["displacement"][nodes], np.pad(part.displacement, ((0, 0), (0, 1))))
        assert np.array_equal(mesh.points[mesh.cells[0].data[own], :2], block.points[block.triangles])
        assert np.array_equal(mesh.cell_data["von_mises"][0][own], part.von_mises)
        assert np.array_equal(mesh.cell_data["error"][0][own], part.error)
        assert np.array_equal(mesh.cell_data["stress"][0][own][:, [0, 3, 5, 1]], part.stress)
        assert not mesh.cell_data["stress"][0][own][:, [2, 4]].any()
    assert first == len(mesh.points)


def test_fields_that_nobody_asks_for_are_left_out(tmp_path):
    """Without stress and error, files have displacements and bodies only."""
    block = made_up.block(divisions=(6, 2))
    write_fields(tmp_path, made_up.fields(block, stresses=False), 0, [(len(block.points), len(block.triangles))])
    write_xdmf(tmp_path)
    with h5py.File(tmp_path / "result.h5") as file:
        assert set(file) == {"points", "cells", "body", "displacement"}
    assert set(meshio.read(tmp_path / "result.xdmf").cell_data) == {"body"}
