"""The examples in docs/examples and in the docstrings of public names run, from the folder of the repository."""

import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI
from scenes import LIMIT

import ddmpi

ROOT = Path(ddmpi.__file__).resolve().parents[1]

COLLECTIVE = [
    "ddmpi.coupling.coarse",
    "ddmpi.coupling.joint",
    "ddmpi.coupling.ranks",
    "ddmpi.coupling.space",
    "ddmpi.methods.half_space",
    "ddmpi.methods.krylov",
    "ddmpi.methods.linear",
    "ddmpi.methods.newton",
    "ddmpi.methods.paths",
]
"""Modules whose examples have the same output on each of several ranks."""

MODULES = [
    "ddmpi",
    "ddmpi.body.compliance",
    "ddmpi.body.elasticity",
    "ddmpi.interface.interface",
    "ddmpi.interface.law",
    "ddmpi.interface.state",
    "ddmpi.interface.utilisation",
    "ddmpi.mesh.build",
    "ddmpi.mesh.elements",
    "ddmpi.mesh.mesh",
    "ddmpi.scene.contacts",
    "ddmpi.scene.reader",
    "ddmpi.system.doubts",
    "ddmpi.system.matrices",
    "ddmpi.system.numbers",
    *COLLECTIVE,
]


RUN = """
import doctest, importlib, sys
import ddmpi
from mpi4py import MPI
for name in sys.argv[1:]:
    known = {"ddmpi": ddmpi, "MPI": MPI}
    result = doctest.testmod(importlib.import_module(name), extraglobs=known)
    assert result.attempted and not result.failed, name
"""


def run(*arguments: str) -> str:
    """What Python prints; it must not fail."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, text=True, capture_output=True, timeout=LIMIT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_method_of_your_own():
    """Projected gradients have Newton's answer, and take far more iterations."""
    said = run("docs/examples/projected.py")
    newton, projected = map(int, re.findall(r"(\d+) iterations", said))
    assert projected > 20 * newton


@pytest.mark.slow
def test_a_preconditioner_of_your_own():
    """With springs products grow with the mesh, with half-spaces hardly."""
    said = run("docs/examples/springs.py")
    half_spaces, springs, finer_half_spaces, finer_springs = map(
        int, re.findall(r"(\d+) products", said)
    )
    assert finer_half_spaces < 1.2 * half_spaces
    assert finer_springs > 1.3 * springs > 1.3 * half_spaces


def test_all_files_of_examples_are_run():
    """Each has a test above."""
    files = sorted(path.name for path in (ROOT / "docs/examples").glob("*.py"))
    assert files == ["projected.py", "springs.py"]


@pytest.mark.slow
def test_examples_run():
    """An example in a docstring has the output that stands below it, in a process of its own, as users have it."""
    run("-c", RUN, *MODULES)


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", COLLECTIVE)
def test_examples_have_the_same_output_on_two_ranks(comm, name, monkeypatch):
    """On each of them."""
    monkeypatch.chdir(ROOT)
    known = {"ddmpi": ddmpi, "MPI": MPI}
    result = doctest.testmod(importlib.import_module(name), extraglobs=known)
    assert result.attempted
    assert not result.failed


def test_all_examples_are_run():
    """Modules with examples are in the list."""
    root = Path(ddmpi.__file__).resolve().parent
    names = {
        ".".join(["ddmpi", *path.relative_to(root).with_suffix("").parts])
        for path in root.rglob("*.py")
        if ">>> " in path.read_text(encoding="utf-8")
    }
    assert names == {"ddmpi.__init__", *MODULES[1:]}
