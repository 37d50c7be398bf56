"""The package as others get it: wheel, sdist, one version, and recipes that want what pyproject.toml wants."""

import functools
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import scenes
import yaml
from commands import run
from scenes import LIMIT, pinched_blocks

import ddmpi

pytestmark = pytest.mark.slow

ROOT = scenes.ROOT
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def build(kind: str, folder: Path, output: Path) -> Path:
    """A "wheel" or "sdist" of the checkout in `folder`, by the setuptools that are here: nothing is downloaded."""
    pytest.importorskip("setuptools", "77")
    output.mkdir()
    code = f"from setuptools import build_meta; build_meta.build_{kind}({str(output)!r})"
    assert "eprecat" not in run(sys.executable, "-c", code, cwd=folder)
    (built,) = output.iterdir()
    return built


def digests(wheel: Path) -> dict[str, int]:
    with zipfile.ZipFile(wheel) as archive:
        return {item.filename: item.CRC for item in archive.infolist()}


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Path:
    """The files that git follows, in a folder of their own."""
    listed = (
        subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT
        )
        if shutil.which("git")
        else None
    )
    if not listed or listed.returncode:
        pytest.skip("not a git checkout")
    folder = tmp_path_factory.mktemp("package") / "clean"
    for name in filter(None, listed.stdout.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    return folder


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def wheel(clean) -> Path:
    copy = shutil.copytree(clean, clean.parent / "for_wheel")  # setuptools leaves a folder build/
    return build("wheel", copy, clean.parent / "wheel")


@pytest.fixture(scope="module")
def installed(wheel) -> Path:
    """The folder in which pip has installed the wheel, without what it depends on."""
    target = wheel.parents[1] / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index"]
    run(*pip, "--target", target, wheel, cwd=target.parent)
    return target


def test_wheel_is_the_package(wheel, clean):
    """The wheel holds every file of ddmpi/, the license, and nothing else."""
    own = {f"ddmpi/{name}" for name in files(clean / "ddmpi")}
    info = f"ddmpi-{ddmpi.__version__}.dist-info"
    names = digests(wheel).keys()
    assert {name for name in names if not name.startswith(f"{info}/")} == own
    assert "ddmpi/py.typed" in own and f"{info}/licenses/LICENSE" in names
    with zipfile.ZipFile(wheel) as archive:
        metadata = archive.read(f"{info}/METADATA").decode()
    assert "License-Expression: BSD-2-Clause" in metadata
    assert (
        set(re.findall("^Provides-Extra: (.*)$", metadata, re.M))
        == PROJECT["optional-dependencies"].keys()
    )


def test_sdist_is_the_checkout(clean, wheel):
    """The sdist holds what git follows, but for hidden files, and the same wheel is built from it."""
    copy = shutil.copytree(clean, clean.parent / "for_sdist")
    shutil.unpack_archive(build("sdist", copy, clean.parent / "sdist"), clean.parent / "unpacked")
    (folder,) = (clean.parent / "unpacked").iterdir()
    made = {
        name
        for name in files(folder)
        if name in ("PKG-INFO", "setup.cfg") or name.startswith("ddmpi.egg-info/")
    }
    assert files(folder) - made == {name for name in files(clean) if not name.startswith(".")}
    assert digests(build("wheel", folder, clean.parent / "second")) == digests(wheel)


def test_the_wheel_runs_outside_of_the_checkout(installed, tmp_path):
    """The command of an installed wheel solves a scene on two ranks, in a folder far from any checkout."""
    paths = [
        path
        for path in os.environ.get("PYTHONPATH", "").split(os.pathsep)
        if path and Path(path) != ROOT
    ]
    start = functools.partial(
        run, cwd=tmp_path, PYTHONPATH=os.pathsep.join([str(installed), *paths])
    )
    place = start(sys.executable, "-c", "import ddmpi; print(ddmpi.__file__)")
    assert Path(place.strip()) == installed / "ddmpi" / "__init__.py"
    scene = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    start(
        *os.environ.get("MPIRUN", "mpirun").split(),
        "-n",
        "2",
        sys.executable,
        installed / "bin" / "ddmpi",
        "run",
        scene,
        "--output",
        tmp_path / "out",
        "--no-figures",
    )
    assert {"summary.json", "result.h5"} <= files(tmp_path / "out")


def test_one_version():
    """The citation and the newest section of the changelog name the version of the package."""
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.M) == [ddmpi.__version__]
    assert re.findall(r"^## (\S+)", changes, re.M)[0] == ddmpi.__version__
    assert "version" in PROJECT["dynamic"]


def test_extras_are_in_the_tests():
    """The extra `test` has all that the others have, and setup.sh looks for each module that is needed."""
    extras = PROJECT["optional-dependencies"]
    assert {*extras["figures"], *extras["docs"], *extras["equilibrium"]} <= {*extras["test"]}
    setup = (ROOT / "scripts" / "setup.sh").read_text(encoding="utf-8")
    modules = " ".join(re.findall(r'^MODULES\+?="(.*)"', setup, re.M)).split()
    names = {
        re.match(r"[\w-]+", each)[0].replace("-", "_")
        for each in PROJECT["dependencies"] + extras["test"]
    }
    assert {*modules} == names - {"setuptools", "scikit_fem", "clarabel", "pytest_xdist"} | {
        "skfem"
    }
    assert re.findall(r'^CLARABEL="(.*?)"', setup, re.M) == extras["equilibrium"]


def wanted() -> dict[str, str]:
    """The lower bound of each package that runs and draws, by its name on PyPI."""
    extras = PROJECT["optional-dependencies"]
    requirements = PROJECT["dependencies"] + extras["figures"] + extras["equilibrium"]
    return dict(requirement.split(">=") for requirement in requirements)


def test_conda_recipe():
    """The conda recipe names this version, this command, and the packages and lower bounds of pyproject.toml."""
    recipe = yaml.safe_load(
        (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    )
    assert recipe["context"]["version"] == ddmpi.__version__
    assert recipe["build"]["python"]["entry_points"] == [
        f"{k} = {v}" for k, v in PROJECT["scripts"].items()
    ]
    names = {"python": "python", "gmsh": "python-gmsh", "matplotlib": "matplotlib-base"}
    bounds = {"python": PROJECT["requires-python"].removeprefix(">="), **wanted()}
    assert sorted(recipe["requirements"]["run"]) == sorted(
        f"{names.get(k, k)} >={v}" for k, v in bounds.items()
    )
    assert (
        recipe["about"]["summary"] == PROJECT["description"]
        and recipe["about"]["license"] == PROJECT["license"]
    )


def test_spack_package():
    """The Spack package, and the page that installs it, name this version; its packages are those of pyproject.toml."""
    text = (ROOT / "packaging" / "spack" / "package.py").read_text(encoding="utf-8")
    compile(text, "package.py", "exec")
    page = (ROOT / "docs" / "start" / "installing.md").read_text(encoding="utf-8")
    assert re.findall(r'^    version\("(.*)"\)$', text, re.M) == [ddmpi.__version__]
    assert set(re.findall(r"py-ddmpi@([\d.]+)", page)) == {ddmpi.__version__}
    found = dict(re.findall(r'^        depends_on\("(?:py-)?([\w-]+)@([\d.]+):', text, re.M))
    assert found == {"python": PROJECT["requires-python"].removeprefix(">="), **wanted()}
