"""Nodes of mesh files: numbers of nodes that are not there, cells that have a node twice.

Meshio takes a number below the first one for a node counted from the end, and of two nodes of one number the last.
"""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.refine import KINDS
from ddmpi.system.numbers import in_words

COUNTS = (
    0,
    2,
    3,
    4,
    4,
    8,
    6,
    5,
    3,
    6,
    9,
    10,
    27,
    18,
    14,
    1,
    8,
    20,
    15,
    13,
    9,
    10,
    12,
    15,
    15,
    21,
    4,
    5,
    6,
    20,
    35,
    56,
)
"""Nodes of an element, by gmsh's numbers of types (gmsh's manual, "MSH file format")."""

WINDOW = 64
"""So many more elements than in the last run of alike ones are looked at together."""

LARGEST_NUMBER = 10**8
"""Meshio makes a table as long as the largest number of a node: 0.8 GB for this one."""


Run = tuple[np.ndarray, np.ndarray]
"""Numbers of nodes or elements (m,), and nodes (m, k)."""


class _Words:
    """The numbers of a section of an MSH file, in text or binary, one after the other."""

    def __init__(self, data: bytes, text: bool, size: int) -> None:
        self._data = data
        self._text = text
        self._at = 0
        self._types = {
            "int": np.dtype("i4"),
            "size": np.dtype(f"i{size}"),
            "real": np.dtype("f8"),
            "node": np.dtype([("number", "i4"), ("at", "f8", 3)]),
        }
        if text:
            self._words = np.fromstring(data.decode("ascii"), sep=" ")

    def take(self, kind: str, count: int) -> np.ndarray:
        """The next `count` numbers, of a `kind`: "int", "size" or "real"; in binary also records of nodes, "node".
        Raises ValueError where they are missing."""
        if self._text:
            taken = self._words[self._at : self._at + count]
            self._at = self._at + count
            if len(taken) < count:
                raise ValueError("the section ends too early")
            return taken if kind == "real" else taken.astype(np.int64)
        taken = np.frombuffer(self._data, self._types[kind], count, self._at)
        self._at += taken.nbytes
        return taken.astype(np.int64) if kind in ("int", "size") else taken

    @property
    def rest(self) -> int:
        """How many words of a text are left."""
        return len(self._words) - self._at

    def line(self) -> int:
        """The number in the first line, after which binary data begin."""
        if self._text:
            return int(self.take("int", 1)[0])
        word, _, _ = self._data.partition(b"\n")
        self._at = len(word) + 1
        return int(word)


def refuse_lost_numbers(path: Path, label: str) -> None:
    """Raise InputError, after `label`, where an MSH file of version 2 or 4.1 has elements with nodes that are not
    there, two nodes of one number, numbers of nodes and elements that no integer is, which meshio takes for large ones,
    or numbers above LARGEST_NUMBER. Says nothing of other versions, and of files that it cannot read: gmsh will. Not
    collective."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            numbers, blocks = _numbers(path.read_bytes())
    except RuntimeWarning:
        raise InputError(f"{label} has numbers of nodes or elements that no integer is") from None
    except (ValueError, TypeError, LookupError, Warning):  # TypeError: numbers of 0 bytes
        return
    there, count = np.unique(numbers, return_counts=True)
    if there.max(initial=0) > LARGEST_NUMBER:
        raise InputError(
            f"{label}: a node has the number {there[-1]}; number nodes below {LARGEST_NUMBER:.0e}, in gmsh by "
            "Mesh.Renumber = 1"
        )
    if (count > 1).any():
        raise InputError(f"{label}: {count.max()} nodes have the number {there[count.argmax()]}")
    for elements, nodes in blocks:
        lost = ~np.isin(nodes, there)
        if lost.any():
            k, j = np.argwhere(lost)[0]
            raise InputError(
                f"{label}: element {elements[k]} has the node {nodes[k, j]}, which is not there"
            )


def _numbers(data: bytes) -> tuple[np.ndarray, list[Run]]:
    """The numbers (n,) of the nodes of an MSH file, and of elements in blocks: (m,), with nodes (m, k)."""
    version, kind, size = data[data.index(b"$MeshFormat") :].split(maxsplit=4)[1:4]
    if version not in (b"2", b"2.0", b"2.1", b"2.2", b"4.1"):
        raise ValueError("of another version")
    sections = [
        _Words(_section(data, name), kind == b"0", int(size)) for name in (b"Nodes", b"Elements")
    ]
    if version == b"4.1":
        return np.concatenate([tags for tags, _ in _entities(sections[0], 3)]), [
            (rows[:, 0], rows[:, 1:]) for _, rows in _entities(sections[1], 0)
        ]
    nodes, elements = sections
    count = nodes.line()
    if kind == b"0":
        return nodes.take("real", 4 * count)[::4].astype(np.int64), list(_runs(elements))
    return nodes.take("node", count)["number"].astype(np.int64), list(_binary_runs(elements))


def _section(data: bytes, name: bytes) -> bytes:
    start = data.index(b"$" + name) + len(name) + 1
    start = data.index(b"\n", start) + 1
    return data[start : data.index(b"$End" + name, start)]


def _entities(words: _Words, coordinates: int) -> Iterator[Run]:
    """Of version 4.1: by entity the numbers of its nodes, or else rows of its elements: number, nodes."""
    for _ in range(words.take("size", 4)[0]):
        kind = int(words.take("int", 3)[2])
        count = int(words.take("size", 1)[0])
        if coordinates:
            yield words.take("size", count), np.empty(0)
            if kind:
                raise ValueError("places along curves, which meshio does not read")
            words.take("real", coordinates * count)
        else:
            yield np.empty(0), words.take("size", count * (1 + COUNTS[kind])).reshape(count, -1)


def _runs(words: _Words) -> Iterator[Run]:
    """Of version 2 in text: runs of elements of one type with as many tags, by number and nodes."""
    window = WINDOW
    left = words.line()
    every = words.take("int", words.rest)
    at = 0
    while left:
        kind, tags = every[at + 1 : at + 3]
        step = 3 + int(tags) + COUNTS[int(kind)]
        fit = min(left, window, (len(every) - at) // step)
        rows = every[at : at + fit * step].reshape(fit, step)
        alike = (rows[:, 1] == kind) & (rows[:, 2] == tags)
        run = int(alike.argmin()) if not alike.all() else fit
        if not run:
            raise ValueError("the section ends too early")
        yield rows[:run, 0], rows[:run, step - COUNTS[int(kind)] :]
        window = 2 * run + WINDOW
        left -= run
        at += run * step


def _binary_runs(words: _Words) -> Iterator[Run]:
    """The same in binary, where a file says of how many elements a run is."""
    left = words.line()
    while left > 0:
        kind, count, tags = words.take("int", 3).tolist()
        rows = words.take("int", count * (1 + tags + COUNTS[kind])).reshape(count, -1)
        yield rows[:, 0], rows[:, 1 + tags :]
        left -= max(count, 1)


def refuse_lost_nodes(raw, first: int) -> None:
    """Raise ValueError where elements of a mesh of meshio have nodes that are not there. `first` is the number that its
    format gives the first node and the first element of a type. Not collective."""
    before: dict[str, int] = {}
    if not len(raw.points):
        raise ValueError("no nodes")
    for block in raw.cells:
        nodes = np.asarray(block.data)
        wrong = (
            (nodes < 0) | (nodes >= len(raw.points))
            if nodes.dtype.kind in "iu"
            else np.zeros((0, 0), bool)
        )
        if wrong.any():
            k, j = np.argwhere(wrong)[0]
            raise ValueError(
                f"{block.type} {before.get(block.type, 0) + k + first} has the node {int(nodes[k, j]) + first}, which "
                f"is not there; its nodes are {first} to {len(raw.points) - 1 + first}, both counted from {first}"
            )
        before[block.type] = before.get(block.type, 0) + len(nodes)


def of_elements(raw, d: int, some: np.ndarray | None = None) -> Iterator[np.ndarray]:
    """The nodes (k, ·) of the elements of dimension d by kind, of `some` of them, counted through all KINDS, or all."""
    before = 0
    for kind in KINDS[d]:
        nodes = raw.cells_dict.get(kind, np.empty((0, 1), int))
        yield (
            nodes
            if some is None
            else nodes[np.unique(some[(some >= before) & (some < before + len(nodes))]) - before]
        )
        before += len(nodes)


def refuse_repeated(raw, nodes: Sequence[np.ndarray], label: str) -> None:
    """Raise InputError, after `label`, where an element has a node twice, by the `nodes` (k, ·) of those of each kind.
    Not collective."""
    for of_kind in nodes:
        in_order = np.sort(of_kind, axis=1)
        twice = (in_order[:, 1:] == in_order[:, :-1]).any(axis=1)
        if twice.any():
            k = int(twice.argmax())
            raise InputError(
                f"{label} has {int(twice.sum())} cells with a node twice, as at "
                f"{in_words(raw.points[of_kind[k]].mean(axis=0), 4)}; cells that are collapsed in this way "
                "are triangles, prisms, pyramids or tetrahedra, and are to be written as these"
            )
