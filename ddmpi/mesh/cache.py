"""Meshes of drawings that earlier commands have made, in a folder beside their results.

A mesh is kept as gmsh wrote it. Its name is a digest of all that it depends on, and it begins with a digest of the rest,
both with a key that this account alone has: a folder that comes from others has no mesh that is believed.
"""

import contextlib
import hashlib
import json
import os
import stat
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import ddmpi
from ddmpi.errors import OutputError
from ddmpi.kept.kept import digest
from ddmpi.mesh.mesh import Face, Faces

FOLDER = ".ddmpi-meshes"
"""Beside the results."""

LONG = 1.0  # s: meshes that take less are made again

_parents: list[Path] = []  # of the folder of results, one of this process
_folders: list[Path] = []  # of meshes, one while bodies are meshed


@contextlib.contextmanager
def beside(results: str | None) -> Iterator[None]:
    """A context in which meshes are kept beside this folder of `results`, or the one of results/ that a run would
    make. Not collective."""
    _parents.append(Path(results).parent if results else Path("results"))
    try:
        yield
    finally:
        _parents.pop()


@contextlib.contextmanager
def opened(cache: bool | str) -> Iterator[None]:
    """A context in which meshes are kept, or not, as output.cache says. Not collective."""
    folder = _folder(cache) if _parents and cache else None
    _folders[:] = [folder] if folder else []
    try:
        yield
    finally:
        _folders.clear()


def _folder(cache: bool | str) -> Path | None:
    """The folder of a scene; None, with a word, where a link leads away from beside the results."""
    parent = _parents[-1]
    name = FOLDER if cache is True else str(cache)
    folder = parent / name
    if Path(name).is_absolute() or ".." in Path(name).parts:  # of the command line
        return folder
    if folder.resolve() != parent.resolve() / name:
        _say(f"{folder} is a link, and no folder for meshes")
        return None
    return folder


def name_of(folder: Path, *depends: Any) -> str:
    """The name of the mesh of the files in a `folder` for gmsh, by their content, which `depends` on all that is given;
    empty where none is kept. Not collective."""
    key = _key() if _folders else b""
    if not key:
        return ""
    here = os.fsencode(folder)
    files = {path.name: path.read_bytes().replace(here, b"") for path in sorted(folder.glob("*"))}
    gmsh = find_spec("gmsh")  # its module names its version
    made_by = ddmpi.__version__, gmsh and gmsh.origin and Path(gmsh.origin).read_bytes()
    return hashlib.blake2b(
        digest(files, depends, made_by).encode(), digest_size=16, key=key
    ).hexdigest()


def recall(name: str, target: Path) -> Faces | None:
    """Write the kept mesh of a name as `target`, and return its numbered faces; None where there is none. A damaged one
    is told. Not collective."""
    if not name:
        return None
    path = _folders[0] / name
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise OSError
            mac = file.read(SIZE)
            data = file.read()
    except FileNotFoundError:
        return None
    except OSError:
        mac = b""
        data = b""
    if mac != _mac(data):
        _say(f"{path} is damaged, and not used")
        return None
    faces, _, mesh = data.partition(b"\n")
    target.write_bytes(mesh)
    return {
        number: Face(kind, radius, measure, tuple(place), words, tuple(map(tuple, axis)))
        for number, (kind, radius, measure, place, words, axis) in json.loads(faces).items()
    }


def keep(name: str, mesh: Path, faces: Faces, seconds: float) -> None:
    """Keep what gmsh has written after so many `seconds`, if these are many. Not collective."""
    if not name or seconds < LONG:
        return
    from ddmpi.system.files import write_atomically  # needs MPI, which processes of gmsh have not

    data = json.dumps(faces).encode() + b"\n" + mesh.read_bytes()
    try:
        _folders[0].mkdir(parents=True, exist_ok=True)
        write_atomically(_folders[0] / name, _mac(data) + data)
    except (OSError, OutputError) as error:
        _say(f"meshes are not kept: {error}")


def _mac(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=SIZE // 2, key=_key()).hexdigest().encode()


SIZE = 64  # bytes of a digest before a mesh


def _key() -> bytes:
    """The key of this account, made at first use; empty where its home cannot be written."""
    path = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ddmpi" / "key"
    ours = path.with_name(f"key-{os.getpid()}")
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(os.open(ours, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                file.write(os.urandom(SIZE))
            with contextlib.suppress(FileExistsError):  # of two commands the first one makes it
                os.link(ours, path)
            ours.unlink()
        key = path.read_bytes() if path.is_file() else b""  # a pipe has no end
    except (OSError, RuntimeError):  # the second one where nobody knows the home
        return b""
    return key if len(key) == SIZE else b""


def _say(words: str) -> None:
    print(f"ddmpi: output.cache: {words}", file=sys.stderr, flush=True)
