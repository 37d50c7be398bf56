"""The examples in docs/examples and in the docstrings of public names run, from the folder of the repository."""

import re
import subprocess
import sys
from pathlib import Path

from scenes import LIMIT

import ddmpi

ROOT = Path(ddmpi.__file__).resolve().parents[1]

MODULES = [
    "ddmpi",
    "ddmpi.body.compliance",
    "ddmpi.body.elasticity",
    "ddmpi.interface.interface",
    "ddmpi.interface.law",
    "ddmpi.interface.state",
    "ddmpi.mesh.build",
    "ddmpi.mesh.elements",
    "ddmpi.mesh.mesh",
    "ddmpi.scene.contacts",
    "ddmpi.scene.reader",
    "ddmpi.system.doubts",
    "ddmpi.system.numbers",
]


RUN = """
import doctest, importlib, sys
import ddmpi
for name in sys.argv[1:]:
    result = doctest.testmod(importlib.import_module(name), extraglobs={"ddmpi": ddmpi})
    assert result.attempted and not result.failed, name
"""


def run(*arguments: str) -> str:
    """What Python prints; it must not fail."""
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, text=True, capture_output=True, timeout=LIMIT
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_method_of_your_own():
    """Projected gradients have Newton's answer, and take far more iterations."""
    said = run("docs/examples/projected.py")
    newton, projected = map(int, re.findall(r"(\d+) iterations", said))
    assert projected > 20 * newton


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


def test_examples_run():
    """An example in a docstring has the output that stands below it, in a process of its own, as users have it."""
    run("-c", RUN, *MODULES)


def test_all_examples_are_run():
    """Modules with examples are in the list."""
    root = Path(ddmpi.__file__).resolve().parent
    names = {
        ".".join(["ddmpi", *path.relative_to(root).with_suffix("").parts])
        for path in root.rglob("*.py")
        if ">>> " in path.read_text(encoding="utf-8")
    }
    assert names == {"ddmpi.__init__", *MODULES[1:]}
