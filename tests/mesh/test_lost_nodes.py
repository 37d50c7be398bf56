"""Mesh files with numbers of nodes that are not there, in every format that is read; and nodes that no cell has."""

from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from scenes import seldom
from test_formats import GMSH, write_ring

import ddmpi.mesh.read
from ddmpi.errors import InputError
from ddmpi.mesh.nodes import _Words
from ddmpi.mesh.read import FORMATS, read_mesh
from meshes import write

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]])

CELLS = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])

LINES = np.array([[0, 1], [2, 3]])


def msh(
    path: Path, cells, lines, points=POINTS, version: str = "2.2", binary: bool = False
) -> Path:
    """A square of four triangles as gmsh writes it, with any numbers of nodes, counted from 1."""
    numbers, kind = np.arange(1, len(points) + 1), "<i4"
    head = f"$MeshFormat\n{version} {int(binary)} 8\n".encode()
    head += (np.array([1], "<i4").tobytes() + b"\n" if binary else b"") + b"$EndMeshFormat\n"
    head += b'$PhysicalNames\n2\n1 1 "edge"\n2 2 "body"\n$EndPhysicalNames\n'

    def put(form: str, *values) -> bytes:
        values = np.concatenate([np.ravel(value) for value in values])
        if binary:
            return values.astype(form).tobytes()
        return (" ".join(repr(value) for value in values.astype(form).tolist()) + "\n").encode()

    if version == "2.2":
        nodes = b"".join(
            put(kind, [k]) + put("<f8", at) for k, at in zip(numbers, points, strict=True)
        )
        if not binary:
            nodes = b"".join(
                f"{k} {x!r} {y!r} {z!r}\n".encode()
                for k, (x, y, z) in zip(numbers, points.tolist(), strict=True)
            )
        body = f"$Nodes\n{len(points)}\n".encode() + nodes + b"\n$EndNodes\n"
        body += f"$Elements\n{len(cells) + len(lines)}\n".encode()
        k = 0
        for gmsh, rows in ((1, lines), (2, cells)):
            body += put(kind, [gmsh, len(rows), 2]) if binary else b""
            for row in rows:
                k += 1
                body += put(kind, [k], [] if binary else [gmsh, 2], [gmsh, gmsh], row)
        return write_bytes(path, head + body + b"\n$EndElements\n")
    size = "<i8"
    body = b"$Entities\n" + put(size, [0, 1, 1, 0])
    body += (
        put(kind, [1]) + put("<f8", np.zeros(6)) + put(size, [1]) + put(kind, [1]) + put(size, [0])
    )
    body += (
        put(kind, [1]) + put("<f8", np.zeros(6)) + put(size, [1]) + put(kind, [2]) + put(size, [0])
    )
    body += b"\n$EndEntities\n$Nodes\n" + put(size, [1, len(points), 1, len(points)])
    body += (
        put(kind, [2, 1, 0]) + put(size, [len(points)]) + put(size, numbers) + put("<f8", points)
    )
    body += b"\n$EndNodes\n$Elements\n" + put(size, [2, len(lines) + len(cells), 1, 99])
    k = 0
    for d, gmsh, rows in ((1, 1, lines), (2, 2, cells)):
        body += put(kind, [d, 1, gmsh]) + put(size, [len(rows)])
        for row in rows:
            k += 1
            body += put(size, [k], row)
    return write_bytes(path, head + body + b"\n$EndElements\n")


def write_bytes(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def inp(path: Path, cells, lines) -> Path:
    """The same as a deck; `lines` are of no type that it has."""
    rows = [f"{k}, " + ", ".join(map(str, row)) for k, row in enumerate(cells, 1)]
    nodes = [f"{k}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(POINTS.tolist(), 1)]
    return write(
        path,
        "\n".join(["*NODE", *nodes, "*ELEMENT, TYPE=CPS3", *rows, "*NSET, NSET=edge", "1, 2"])
        + "\n",
    )


def old(path: Path, cells, lines, version: str) -> Path:
    """Versions 1 and 4.0 of gmsh's format, which meshio does not read, in text."""
    nodes = "\n".join(f"{k} {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(POINTS.tolist(), 1))
    rows = [(1, row) for row in lines] + [(2, row) for row in cells]
    if version == "1":
        elements = "\n".join(
            f"{k} {kind} {kind} {kind} {len(row)} {' '.join(map(str, row))}"
            for k, (kind, row) in enumerate(rows, 1)
        )
        return write(path, f"$NOD\n5\n{nodes}\n$ENDNOD\n$ELM\n{len(rows)}\n{elements}\n$ENDELM\n")
    blocks = []
    for kind in (1, 2):
        own = [(k, row) for k, (of, row) in enumerate(rows, 1) if of == kind]
        blocks += [
            f"1 {kind} {kind} {len(own)}",
            *(f"{k} {' '.join(map(str, row))}" for k, row in own),
        ]
    return write(
        path,
        "$MeshFormat\n4 0 8\n$EndMeshFormat\n"
        '$PhysicalNames\n2\n1 1 "edge"\n2 2 "body"\n$EndPhysicalNames\n'
        "$Entities\n0 1 1 0\n1 0 0 0 1 1 0 1 1 0\n1 0 0 0 1 1 0 1 2 0\n$EndEntities\n"
        f"$Nodes\n1 5\n1 2 0 5\n{nodes}\n$EndNodes\n$Elements\n2 {len(rows)}\n"
        + "\n".join(blocks)
        + "\n$EndElements\n",
    )


def other(path: Path, cells, lines) -> Path:
    """The same by meshio: VTK counts nodes from 0, as it does, and MED from 1, as nobody sees who calls it."""
    mesh = meshio.Mesh(POINTS, [("triangle", np.array(cells) - 1), ("line", np.array(lines) - 1)])
    if path.suffix == ".med":
        mesh.cell_data["cell_tags"] = [np.full(len(cells), -1), np.full(len(lines), -2)]
        mesh.cell_tags = {-1: ["body"], -2: ["edge"]}
        mesh.points = POINTS[:, :2]
    else:
        mesh.cell_data["CellEntityIds"] = [np.full(len(cells), 1), np.full(len(lines), 2)]
    mesh.write(path)
    return path


WRITERS = {
    "msh 1": lambda folder, *cells: old(folder / "a.msh", *cells, "1"),
    "msh 2.2": lambda folder, *cells: msh(folder / "a.msh", *cells),
    "binary msh 2.2": lambda folder, *cells: msh(folder / "a.msh", *cells, binary=True),
    "msh 4": lambda folder, *cells: old(folder / "a.msh", *cells, "4"),
    "msh 4.1": lambda folder, *cells: msh(folder / "a.msh", *cells, version="4.1"),
    "binary msh 4.1": lambda folder, *cells: msh(
        folder / "a.msh", *cells, version="4.1", binary=True
    ),
    "inp": lambda folder, *cells: inp(folder / "a.inp", *cells),
    **{
        kind: lambda folder, *cells, kind=kind: other(folder / f"a.{kind}", *cells)
        for kind in FORMATS.values()
    },
}
"""By format a function that writes the square, with the numbers of nodes counted from 1."""


def read(path: Path) -> str:
    """What is said of a file; empty if it is read."""
    try:
        mesh = read_mesh(path, "a")
    except InputError as error:
        return str(error)
    assert mesh.measures().sum() == pytest.approx(1.0) and len(mesh.points) == 5
    return ""


@pytest.mark.parametrize(
    ("form", "every"),
    [
        (seldom if every or form in ("msh 1", "msh 4") else pytest.param)(form, every)
        for form in WRITERS
        for every in (False, True)
    ],
)
def test_numbers_out_of_range_are_refused_in_every_format(tmp_path, form, every, monkeypatch):
    """Below the first node and above the last, at both ends of both, in cells and in lines: file, cell and number.

    Whole files of MED are read in a process of their own, as always, and the others in this one, in a tenth of the time.
    """
    assert {*GMSH, "inp", *FORMATS.values()} == {*WRITERS}
    assert read(WRITERS[form](tmp_path, (CELLS + 1).tolist(), (LINES + 1).tolist())) == ""
    monkeypatch.setattr(
        ddmpi.mesh.read, "read_apart", lambda path, work, label, *more: work(path, *more)
    )
    numbers = (-1, 6, 0, -2, -4, -5, -6, -100, 7, 10**6, 2**31 - 1, -(2**31) + 1)
    few = 3 if form in ("msh 1", "msh 4") else None  # which gmsh reads
    for wrong in numbers[:few] if every else numbers[:2]:
        for where in (0, 1):
            cells, lines = (CELLS + 1).tolist(), (LINES + 1).tolist()
            if where and (form == "inp" or abs(wrong) < 7):
                lines[1][1] = wrong
            else:
                cells[2][1] = wrong
            if form == "inp" and where:
                continue
            said = read(WRITERS[form](tmp_path, cells, lines))
            assert f"a.{'msh' if 'msh' in form else form}" in said, (wrong, said)
            shown = wrong - 1 if form in ("vtu", "vtk") else wrong
            assert str(shown) in said or "gmsh: " in said, (wrong, said)


def test_a_section_that_ends_too_early_is_an_error():
    """As many numbers as there are can be taken."""
    assert _Words(b"3 1 4", True, 8).take("int", 3).tolist() == [3, 1, 4]
    with pytest.raises(ValueError, match="the section ends too early"):
        _Words(b"3 1 4", True, 8).take("int", 4)


@pytest.mark.parametrize("form", ["msh 2.2", "binary msh 2.2", "msh 4.1", "binary msh 4.1"])
def test_lost_nodes_of_a_large_file_are_found(tmp_path, form):
    """In runs of elements of several types; whole files pass."""
    from ddmpi.mesh.nodes import _numbers, refuse_lost_numbers

    path = write_ring(tmp_path, "hexahedron", 2, form)
    numbers, blocks = _numbers(path.read_bytes())
    raw = meshio.gmsh.read(path)
    assert len(numbers) == len(raw.points)
    assert sum(len(nodes) for _, nodes in blocks) == sum(len(block.data) for block in raw.cells)
    refuse_lost_numbers(path, "a")


def test_two_nodes_of_one_number_are_refused(tmp_path):
    """The second would be taken without a word."""
    path = msh(tmp_path / "a.msh", (CELLS + 1).tolist(), (LINES + 1).tolist())
    path.write_text(path.read_text().replace("\n5 0.5", "\n4 0.5"))
    assert "2 nodes have the number 4" in read(path)


@pytest.mark.parametrize("number", ["1e300", "nan"])
def test_numbers_that_no_integer_is_end_in_a_message(tmp_path, number):
    """Of which numpy warns, and for which meshio would take 16 GB."""
    path = msh(tmp_path / "a.msh", (CELLS + 1).tolist(), (LINES + 1).tolist())
    path.write_text(path.read_text().replace("\n5 0.5", f"\n{number} 0.5"))
    assert "a.msh has numbers of nodes or elements that no integer is" in read(path)


def test_a_node_of_a_huge_number_is_refused_and_one_below_is_read(tmp_path):
    """For which meshio would take 16 GB."""
    cells, lines = CELLS + 1, LINES + 1
    for number, refused in ((2_147_483_000, True), (100_000_001, True), (20_000_000, False)):
        far = [np.where(nodes == 5, number, nodes).tolist() for nodes in (cells, lines)]
        path = msh(tmp_path / "a.msh", *far)
        path.write_text(path.read_text().replace("\n5 0.5", f"\n{number} 0.5"))
        if refused:
            assert f"a.msh: a node has the number {number}; number nodes below 1e+08" in read(path)
        else:
            assert len(read_mesh(path, "a").points) == 5


@pytest.mark.parametrize("size", [0, 3, 16])
def test_sizes_of_numbers_that_do_not_exist_end_in_a_message(tmp_path, size):
    path = msh(tmp_path / "a.msh", CELLS + 1, LINES + 1, version="4.1", binary=True)
    path.write_bytes(path.read_bytes().replace(b"4.1 1 8", b"4.1 1 %d" % size))
    assert "a.msh" in read(path)


FAR = np.array([[0.0, 0.0, 1e13]])


@pytest.mark.parametrize("height", [0.0, 1e-3])
def test_nodes_that_no_cell_has_decide_about_nothing(tmp_path, height):
    """Neither whether a mesh is plane, nor its extent, nor whether coordinates are numbers."""
    tilted = POINTS + np.outer(POINTS[:, 0], [0.0, 0.0, height])
    for far in (FAR, FAR * np.nan, FAR * np.inf):
        path = msh(
            tmp_path / "a.msh",
            (CELLS + 1).tolist(),
            (LINES + 1).tolist(),
            np.concatenate([tilted, far]),
        )
        assert ("is not plane" in read(path)) == (height > 0.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200])
def test_places_that_are_none_are_refused(tmp_path, value):
    """With the number of nodes and one of them."""
    points = POINTS.copy()
    points[4, 1] = value
    path = msh(tmp_path / "a.msh", (CELLS + 1).tolist(), (LINES + 1).tolist(), points)
    assert "at 1 of its nodes" in read(path)


def test_a_cell_with_a_node_twice_is_refused(tmp_path):
    """It has no area; the place is said."""
    cells = (CELLS + 1).tolist()
    cells[1] = [2, 5, 5]
    said = read(msh(tmp_path / "a.msh", cells, (LINES + 1).tolist()))
    assert "1 cells with a node twice, as at (0.6667, 0.3333, 0)" in said


def test_what_med_and_vtu_files_may_lack(tmp_path):
    """Several meshes, no groups, several pieces: the reason in words that do not speak of gmsh or Python."""
    cells = (CELLS + 1).tolist(), (LINES + 1).tolist()
    path = other(tmp_path / "a.med", *cells)
    with h5py.File(path, "a") as file:
        (name,) = file["ENS_MAA"]
        file.copy(f"ENS_MAA/{name}", "ENS_MAA/second")
    assert "it has several meshes; save that of the body" in read(path)
    with h5py.File(path, "a") as file:
        del file["ENS_MAA/second"], file["FAS"]
    assert "families (FAS), which are its groups" in read(path)
    path = other(tmp_path / "a.vtu", *cells)
    text = path.read_text()
    piece = text[text.index("<Piece") : text.index("</Piece>") + len("</Piece>")]
    path.write_text(text.replace(piece, piece + piece))
    assert "it has 2 pieces" in read(path)


@pytest.mark.parametrize("name", ["a.unv", "a.bdf", "a.mesh", "a.xdmf", "a.msh", "a"])
def test_formats_that_are_read_are_told(tmp_path, name):
    """Where the format of a file is not known."""
    said = read(write(tmp_path / name, "    -1\n  2411\n"))
    assert all(word in said for word in (".msh", ".med", ".vtu", ".vtk", ".inp"))
