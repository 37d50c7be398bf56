"""Rooms import in one direction only, and the command starts without heavy libraries."""

import ast
import functools
import graphlib
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import LIMIT

PACKAGE = Path(__file__).resolve().parents[1] / "ddmpi"

ROOMS = ["errors", "sets", "petsc", "system", "kept", "scene", "decks", "mesh", "body", "surface", "interface",
         "coupling", "methods", "published", "judge", "results", "pictures", "derive", "run", "check", "sweep", "cli"]
"""From the bottom to the top: a room imports only itself and rooms to its left."""

FILES = {"errors", "sets"}
"""Rooms that are single files."""

ENTRANCES = {"__init__", "__main__", "mprgp", "apg"}
"""Modules outside the rooms: the package, ``python -m ddmpi``, and names that stand in users' options."""

NEVERS = [("interface", "mpi4py", set()), ("interface", "petsc4py", {"trace"}),
          ("body", "ddmpi.interface", set()), ("methods", "ddmpi.body", set()),
          ("scene", "petsc4py", set()), ("mesh", "petsc4py", set()), ("sets", "petsc4py", set()),
          ("published", "mpi4py", set())]
"""A room, what it never imports, and which of its modules may."""

MODULES = sorted(path.relative_to(PACKAGE).with_suffix("").as_posix() for path in PACKAGE.rglob("*.py"))


def room_of(module: str) -> str:
    return module.split("/")[0]


@functools.cache
def imported(module: str) -> set[str]:
    """Full names of everything that a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_rooms(module: str) -> set[str]:
    parts = [name.split(".") for name in imported(module)]
    return {part[1] for part in parts if part[0] == "ddmpi" and len(part) > 1} & set(ROOMS)


def test_all_rooms_are_looked_at():
    """The test reads every module of the package, those in rooms as well."""
    assert {room_of(module) for module in MODULES} == {*ROOMS, *ENTRANCES}
    assert len(MODULES) > 50


@pytest.mark.parametrize("module", [m for m in MODULES if room_of(m) not in ENTRANCES])
def test_imports_go_one_way(module):
    """A module imports only from its own room and from rooms below it."""
    allowed = set(ROOMS[:ROOMS.index(room_of(module)) + 1])
    assert imported_rooms(module) <= allowed, f"{module} imports {sorted(imported_rooms(module) - allowed)} from above"


def below(name: str) -> set[str]:
    """The modules that a module imports."""
    found = {"/".join(other.split(".")[1:]) for other in imported(name) if other.startswith("ddmpi.")}
    return {m for m in MODULES if m in found or any(f.startswith(f"{m}/") for f in found)} - {name}


def test_no_circles():
    """Modules do not import each other in a circle."""
    graphlib.TopologicalSorter({module: below(module) for module in MODULES}).prepare()


@pytest.mark.parametrize("room, never, but", NEVERS)
def test_nevers(room, never, but):
    """A room stays free of what it must not know."""
    modules = [m for m in MODULES if room_of(m) == room]
    assert modules
    for module in modules:
        if module.split("/")[-1] not in but:
            assert not any(f"{name}.".startswith(f"{never}.") for name in imported(module)), f"{module}: {never}"


@pytest.mark.parametrize("room", [room for room in ROOMS if room not in FILES])
def test_rooms_are_small(room):
    """A room holds at most eight modules, each of them at most 400 lines."""
    modules = [path for path in (PACKAGE / room).glob("*.py") if path.stem != "__init__"]
    assert 0 < len(modules) <= 8
    for path in modules:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path


def test_imports_are_light():
    """What draws, meshes or writes is imported when it is needed; matplotlib alone takes half a second."""
    code = """
import importlib, sys
for module in ("cli.main", "sweep.sweep"):
    importlib.import_module("ddmpi." + module)
    print(module, *[name for name in ("gmsh", "matplotlib", "meshio", "h5py", "scipy.optimize") if name in sys.modules])
"""
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT,
                           cwd=PACKAGE.parent)
    assert child.returncode == 0, child.stderr
    assert child.stdout.splitlines() == ["cli.main", "sweep.sweep"]
