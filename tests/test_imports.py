"""Imports go one way, one module talks between bodies, and the command starts without heavy libraries."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "ddmpi"

ORDER = ["errors", "files", "memory", "events", "interrupt", "logs", "provenance", "keys", "scene", "cases",
         "accuracy", "mesh", "elements", "stiffness", "elasticity", "estimate", "interface", "petsc_versions",
         "qp", "mprgp", "schur", "solvers", "compliance", "preconditioner", "body", "exchange", "coupled", "algorithm",
         "anderson", "newton", "certificate", "diagnosis", "petsc_options", "problem", "checkpoint", "solution",
         "results", "figures", "sweep_table", "sweep_figures", "info", "report", "run", "sweep", "cli", "__main__"]
"""From the bottom to the top: a module imports only modules to its left."""

MAY_IMPORT_MPI = {"exchange", "problem", "checkpoint", "provenance", "results", "run", "sweep", "cli", "__main__"}
"""`exchange`, and the rooms that compose a run around a communicator; the serial work knows no MPI."""

MODULES = sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")


def imported(module: str) -> set[str]:
    """Full names of all that a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def siblings(module: str) -> set[str]:
    """The modules of the package that a module imports."""
    parts = [name.split(".") for name in imported(module)]
    return {part[1] for part in parts if part[0] == "ddmpi" and len(part) > 1 and part[1] in MODULES}


def test_every_module_has_its_place():
    assert set(MODULES) == set(ORDER) & set(MODULES), "add the new module to ORDER, at its place"
    assert len(ORDER) == len(set(ORDER))


@pytest.mark.parametrize("module", MODULES)
def test_imports_go_one_way(module):
    below = set(ORDER[:ORDER.index(module)])
    assert siblings(module) <= below, f"{module} imports {sorted(siblings(module) - below)} from above"


def test_the_package_itself_imports_nothing():
    assert imported("__init__") == set()


@pytest.mark.parametrize("module", MODULES)
def test_only_exchange_and_those_who_compose_know_mpi(module):
    if any(name.split(".")[0] == "mpi4py" for name in imported(module)):
        assert module in MAY_IMPORT_MPI


def test_imports_are_light():
    """What draws, meshes or writes is imported when it is needed; matplotlib alone takes half a second."""
    code = """
import importlib, sys
for module in ("cli", "sweep"):
    importlib.import_module("ddmpi." + module)
    print(module, *[name for name in ("gmsh", "matplotlib", "meshio", "h5py", "scipy.optimize") if name in sys.modules])
"""
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                           cwd=PACKAGE.parent)
    assert child.returncode == 0, child.stderr
    assert child.stdout.splitlines() == ["cli", "sweep"]
