"""The current folder may be anybody's: nothing in it is a module, an option or a setting of a run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import scenes
from scenes import ROOT, pinched_blocks, write_scene

pytestmark = pytest.mark.slow

NAMES = (
    "h5py",
    "numpy",
    "scipy",
    "meshio",
    "petsc4py",
    "mpi4py",
    "gmsh",
    "matplotlib",
    "msgspec",
    "argparse",
    "csv",
)


@pytest.fixture
def here(tmp_path) -> Path:
    """A folder with a scene of a drawing, and modules and settings that say so when they are read."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / f'{name}.ran')!r}, 'w').close()\nraise SystemExit(9)"
        )
    (tmp_path / ".petscrc").write_text(f"-log_view :{tmp_path / 'petsc.ran'}\n")
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\n")
    scene = pinched_blocks(1)
    (tmp_path / "block.geo").write_text(
        "Point(1) = {0, 1, 0}; Point(2) = {3, 1, 0}; Point(3) = {3, 2, 0}; Point(4) = {0, 2, 0};\nLine(1) = {1, 2}; "
        "Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};\nCurve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};\n"
        'Physical Curve("bottom") = {1}; Physical Curve("right") = {2}; Physical Curve("top") = {3}; '
        'Physical Curve("left") = {4};\n'
    )
    scene["body"][0]["mesh"] = {"geometry": "block.geo", "size": 1.0}
    write_scene(scene, tmp_path / "scene.toml")
    return tmp_path


def ended(here: Path, *command: str, **more: str) -> subprocess.CompletedProcess:
    """A run in that folder has found its answer, and has read nothing there but what its scene names."""
    environment = (
        scenes.clean_environment()
        | {"DDMPI_PYTHON": sys.executable, "HOME": str(here / "home")}
        | more
    )
    done = subprocess.run(
        [*command, "run", "scene.toml", "--output", "out"],
        cwd=here,
        env=environment,
        text=True,
        capture_output=True,
        timeout=scenes.LIMIT,
    )
    assert done.returncode == 0, done.stderr
    assert not list(here.glob("*.ran"))
    assert json.loads((here / "out" / "summary.json").read_text())["converged"]
    assert (here / "out" / "bodies.png").exists()
    return done


def test_run_sh_takes_no_module_from_the_current_folder(here):
    """On all ranks, in the process that draws, and whatever empty entries PYTHONPATH has."""
    ended(here, str(ROOT / "scripts" / "run.sh"), PYTHONPATH="::/nowhere::/elsewhere:")


def test_python_takes_no_module_from_the_current_folder(here):
    """Nor where `python -m ddmpi` is started by hand, whose path begins with that folder; PETSc's file is named."""
    done = ended(here, sys.executable, "-m", "ddmpi", PYTHONPATH=str(ROOT))
    assert ".petscrc is not read" in done.stderr


def test_options_in_the_home_are_read(here):
    """PETSc's file in the home holds, as everywhere, also where the one of the current folder does not."""
    (here / "home").mkdir()
    (here / "home" / ".petscrc").write_text("-body_ksp_rtol 1e-9\n")
    ended(here, sys.executable, "-m", "ddmpi", PYTHONPATH=str(ROOT))
    options = json.loads((here / "out" / "summary.json").read_text())["options"]
    assert options == {"body_ksp_rtol": "1e-9"}


def test_a_checkout_runs_where_it_lies(tmp_path):
    """In the folder that holds ddmpi itself, on several ranks, with a drawing, which another process meshes."""
    environment = {
        name: value for name, value in scenes.clean_environment().items() if name != "PYTHONPATH"
    }
    done = subprocess.run(
        [
            "mpirun",
            "-n",
            "2",
            sys.executable,
            "-m",
            "ddmpi",
            "check",
            "configs/drawn/pin_in_lug.toml",
            "--output",
            str(tmp_path / "out"),
            "--no-figures",
        ],
        cwd=ROOT,
        env=environment,
        text=True,
        capture_output=True,
        timeout=scenes.LIMIT,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("both", [False, True])
def test_a_reader_that_has_seen_enough_ends_no_run(tmp_path, both):
    """`scripts/run.sh … | head -1`: mpirun goes on, and the results are there."""
    scene = write_scene(pinched_blocks(1), tmp_path / "scene.toml")
    command = f"{ROOT}/scripts/run.sh {scene} --output out --no-figures {'2>&1' * both} | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment() | {"DDMPI_PYTHON": sys.executable},
    )
    assert done.stdout.split("\n")[-2] == "0" and done.stdout.count("\n") == 2, done
    assert (tmp_path / "out" / "summary.json").exists()


def test_a_stream_without_umlauts_tells_all(tmp_path):
    """PYTHONIOENCODING=ascii: letters that the screen does not have are escaped, and all messages appear."""
    scene = write_scene(pinched_blocks(1) | {"title": "Prüfkörper – λ"}, tmp_path / "scene.toml")
    command = [
        sys.executable,
        "-P",
        "-m",
        "ddmpi",
        "run",
        str(scene),
        "--output",
        "löst",
        "--no-figures",
        "-nö",
        "1",
    ]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment() | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0 and done.stdout.startswith(rb"Pr\xfcfk\xf6rper \u2013 \u03bb")
    assert rb"results in l\xf6st: " in done.stdout and rb"nothing used: n\xf6" in done.stderr
    wrong = subprocess.run(
        [*command[:5], "wö.toml"],
        cwd=tmp_path,
        capture_output=True,
        timeout=scenes.LIMIT,
        env=dict(os.environ) | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": str(ROOT)},
    )
    assert wrong.returncode == 2 and rb"w\xf6.toml: cannot be read" in wrong.stderr
