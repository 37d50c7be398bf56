"""Rooms import in one direction only, know no dimension, and the command starts without heavy libraries."""

import ast
import functools
import graphlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from scenes import LIMIT
from trees import statements, texts, trees

PACKAGE = Path(__file__).resolve().parents[1] / "ddmpi"

STOREYS = {
    "ground": ["errors", "sets", "petsc", "system", "kept"],
    "what the user says": ["scene", "decks", "mesh"],
    "mechanics": ["body", "surface", "interface", "coupling", "methods", "published"],
    "judgement": ["judge", "results"],
    "use": ["pictures", "derive", "run", "check", "sweep", "cli"],
}
"""The rooms by storey, from the bottom to the top: a room imports only itself and rooms before it."""

ROOMS = [room for rooms in STOREYS.values() for room in rooms]

ENTRANCES = {"__init__", "__main__", "mprgp", "apg"}
"""Modules outside the rooms: the package, ``python -m ddmpi``, and names that stand in users' options."""

NEVERS = [
    ("interface", "mpi4py", set()),
    ("interface", "petsc4py", {"trace"}),
    ("body", "ddmpi.interface", set()),
    ("methods", "ddmpi.body", set()),
    ("scene", "petsc4py", set()),
    ("mesh", "petsc4py", set()),
    ("sets", "petsc4py", set()),
    ("published", "mpi4py", set()),
]
"""A room, what it never imports, and which of its modules may."""

# The last pattern turns a vector of two components.
ASKS = re.compile(
    r"\b(?:dimension|components)\b (?:==|!=|<|>|<=|>=) \d"  # compares it
    r"|\b\w?x\w?, \w?y\w?\)?(?: =| in\b)|\(x, y\), \("  # takes points apart into two coordinates
    r"|(?:np\.empty|np\.zeros)\(\((?:0|len\(\w+\)|\w+), 2\)"  # makes vectors of two components
    r"|isinstance\(\w+, (?:Curve|Patch)\)|facets\.shape\[1\] == \d|law\.size > law\.m"  # in other words
    r"|\[-(\w+)\[1\], \1\[0\]\]"
)
"""Code that asks for the dimension, or takes it to be two."""

PLACES = {
    # of the laws: a box and two edges in the plane, discs and polygons in space; no friction turns in the plane
    "interface/law": 2,
    "run/equilibrium": 1,
    "mesh/boundary": 1,
    "interface/interface": 2,
    # what the plane has and space has not, to be replaced with solids
    "surface/curve": 1,
    "interface/state": 1,
    # pictures, and meshes that are made or drawn
    "mesh/geometry": 1,
    "pictures/draw": 1,
    "pictures/contacts": 1,
    "pictures/curves": 1,
    "pictures/moved": 1,
    # columns, units and the name of the preconditioner
    "check/drawing": 1,
    "results/tables": 1,
    "scene/output": 1,
    "run/report": 1,
    # a scene in the plane has plane strain or plane stress
    "scene/bodies": 1,
    # by the kind of a side, and by what is drawn of it
    "interface/mortar": 1,
    "surface/cover": 1,
    "results/fields": 1,
}
"""How often a module does so. The numbers only fall: everything else holds in any dimension."""

DOCSTRING = re.compile(r'^ *""".*?"""$', re.M | re.S)

MODULES = [*texts()]


def room_of(module: str) -> str:
    return module.split("/")[0]


@functools.cache
def imported(module: str) -> set[str]:
    """Full names of everything that a module imports, anywhere in it."""
    names = set()
    for node in statements(trees()[module]):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_rooms(module: str) -> set[str]:
    parts = [name.split(".") for name in imported(module)]
    return {part[1] for part in parts if part[0] == "ddmpi" and len(part) > 1} & set(ROOMS)


def test_the_map_has_the_storeys():
    """The map of the code names the storeys and their rooms, in the order of imports."""
    page = (PACKAGE.parent / "docs/rooms.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \d ([^|]+) \|[^|]+\| ([^|]+) \|$", page, re.M)
    assert {name.lower(): re.findall(r"\w+", rooms) for name, rooms in rows} == STOREYS


def test_all_rooms_are_looked_at():
    """The test reads every module of the package, those in rooms as well."""
    assert {room_of(module) for module in MODULES} == {*ROOMS, *ENTRANCES}
    assert len(MODULES) > 50


def test_imports_go_one_way():
    """A module imports only from its own room and from rooms below it."""
    above = {
        module: imported_rooms(module) & set(ROOMS[ROOMS.index(room_of(module)) + 1 :])
        for module in MODULES
        if room_of(module) not in ENTRANCES
    }
    assert {module: rooms for module, rooms in above.items() if rooms} == {}


def below(name: str) -> set[str]:
    """The modules that a module imports."""
    found = {
        "/".join(other.split(".")[1:]) for other in imported(name) if other.startswith("ddmpi.")
    }
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
            assert not any(f"{name}.".startswith(f"{never}.") for name in imported(module)), (
                f"{module}: {never}"
            )


def code(module: str) -> str:
    """What a module does, a statement a line, without its docstrings and comments."""
    return DOCSTRING.sub("", ast.unparse(trees()[module]))


def may_ask(module: str) -> bool:
    """Whether a module's text, with its docstrings, has such code in one line or in several."""
    text = re.sub(r"(?<=[(\[]) |,? (?=[)\]])", "", " ".join(texts()[module].split()))
    return bool(ASKS.search(text))


def test_few_places_ask_for_the_dimension():
    found = {
        module: sum(bool(ASKS.search(line)) for line in code(module).splitlines())
        for module in MODULES
        if may_ask(module)
    }
    assert {module: number for module, number in found.items() if number} == PLACES


def test_imports_are_light():
    """What draws, meshes or writes is imported when it is needed; matplotlib alone takes half a second."""
    code = """
import importlib, sys
for module in ("cli.main", "sweep.sweep"):
    importlib.import_module("ddmpi." + module)
    print(module, *[name for name in ("gmsh", "matplotlib", "meshio", "h5py", "scipy.optimize") if name in sys.modules])
"""
    child = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=LIMIT,
        cwd=PACKAGE.parent,
    )
    assert child.returncode == 0, child.stderr
    assert child.stdout.splitlines() == ["cli.main", "sweep.sweep"]


def test_files_of_tests_have_names_of_their_own():
    """Pytest imports them by their names alone, and refuses a whole run in which two have one."""
    names = [path.name for path in (PACKAGE.parent / "tests").rglob("test_*.py")]
    assert sorted(name for name in {*names} if names.count(name) > 1) == []
