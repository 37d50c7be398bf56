"""The examples in the docstrings of public names run, from the folder of the repository."""

import doctest
import importlib
from pathlib import Path

import pytest

import ddmpi

MODULES = ["ddmpi", "ddmpi.body.compliance", "ddmpi.body.elasticity", "ddmpi.interface.interface",
           "ddmpi.interface.law", "ddmpi.interface.state", "ddmpi.mesh.build", "ddmpi.mesh.elements", "ddmpi.mesh.mesh",
           "ddmpi.scene.contacts", "ddmpi.scene.reader", "ddmpi.system.numbers"]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, monkeypatch):
    """An example in a docstring has the output that stands below it."""
    monkeypatch.chdir(Path(__file__).resolve().parents[1])
    result = doctest.testmod(importlib.import_module(name), extraglobs={"ddmpi": ddmpi})
    assert result.attempted and not result.failed


def test_all_examples_are_run():
    """Modules with examples are in the list."""
    root = Path(ddmpi.__file__).resolve().parent
    names = {".".join(["ddmpi", *path.relative_to(root).with_suffix("").parts]) for path in root.rglob("*.py")
             if ">>> " in path.read_text(encoding="utf-8")}
    assert names == {"ddmpi.__init__", *MODULES[1:]}
