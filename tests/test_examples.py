"""The examples in the docstrings of public names run, from the folder of the repository."""

import subprocess
import sys
from pathlib import Path

import ddmpi

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


def test_examples_run():
    """An example in a docstring has the output that stands below it, in a process of its own, as users have it."""
    root = Path(ddmpi.__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *MODULES], cwd=root, text=True, capture_output=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_all_examples_are_run():
    """Modules with examples are in the list."""
    root = Path(ddmpi.__file__).resolve().parent
    names = {
        ".".join(["ddmpi", *path.relative_to(root).with_suffix("").parts])
        for path in root.rglob("*.py")
        if ">>> " in path.read_text(encoding="utf-8")
    }
    assert names == {"ddmpi.__init__", *MODULES[1:]}
