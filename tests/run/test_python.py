"""What answers and sweeps are for other programs: records, meshes of meshio and pyvista, datasets, and a notebook."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scenes import LIMIT, pinched_blocks, run_here, write_scene
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError
from ddmpi.sweep.table import as_variables

ROOT = Path(ddmpi.__file__).resolve().parents[1]
NOTEBOOK = ROOT / "docs/examples/pad_on_plate.ipynb"


def test_public_names_are_there():
    assert sorted(ddmpi.__all__) == ddmpi.__all__
    assert all(callable(getattr(ddmpi, name)) for name in ddmpi.__all__)
    made_here = (thing for thing in vars(ddmpi).values() if hasattr(thing, "__module__"))
    functions = {thing.__name__ for thing in made_here if thing.__module__ == "ddmpi"}
    assert set(ddmpi.__all__) == functions


def test_the_history_is_that_of_the_file(tmp_path):
    scene = pinched_blocks(4)
    run = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out", "--no-figures")
    history = ddmpi.solve(scene, MPI.COMM_SELF).history
    file = run.table("history.csv")
    assert list(history.dtype.names) == list(file)
    for name, column in file.items():
        assert np.array_equal(history[name], column), name


@pytest.mark.parametrize(
    ("scene", "kind"),
    [(pinched_blocks(2), "triangle"), (two_boxes(2, order=2), "tetra10")],
    ids=["plane", "space"],
)
def test_a_body_is_a_mesh_of_meshio(tmp_path, scene, kind):
    """With the fields of result.h5; what meshio writes of it, it reads."""
    import meshio

    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    fields = answer.bodies["upper"]
    answer.to_meshio("upper").write(tmp_path / "upper.vtu")
    mesh = meshio.read(tmp_path / "upper.vtu")
    d = fields.points.shape[1]
    assert np.array_equal(mesh.cells_dict[kind], fields.triangles)
    assert np.array_equal(mesh.points[:, :d], fields.points)
    assert np.array_equal(mesh.point_data["displacement"][:, :d], fields.displacement)
    assert np.array_equal(mesh.cell_data["von_mises"][0], fields.von_mises)
    assert mesh.point_data["nodal_stress"].shape == (len(fields.points), 6)
    for wrong in ("uper", "floor", ["upper"]):
        with pytest.raises(InputError, match="there is no such body on this rank"):
            answer.to_meshio(wrong)


ROWS = [
    {"case": k, "a": a, "b": b, "status": status, "reason": "", "n": n, "x": x}
    for k, (a, b, status, n, x) in enumerate(
        [
            (0.1, "p", "certified", 3, 1.5),
            (0.1, "q", "certified", 4, 2.5),
            (0.2, "p", "refused", None, None),
            (0.2, "q", "certified", 6, 4.5),
        ]
    )
]


def test_a_sweep_is_a_grid_of_its_keys():
    """What a case lacks is NaN; where combinations are missing there is a row of cases."""
    variables, coordinates = as_variables(ROWS)
    assert coordinates == {"a": ("a", [0.1, 0.2]), "b": ("b", ["p", "q"])}
    assert set(variables) == {"case", "n", "x"}
    dimensions, values = variables["x"]
    assert dimensions == ("a", "b")
    assert np.array_equal(values, [[1.5, 2.5], [np.nan, 4.5]], equal_nan=True)
    variables, coordinates = as_variables(ROWS[:3])
    assert coordinates == {"a": ("case", [0.1, 0.1, 0.2]), "b": ("case", ["p", "q", "p"])}
    assert variables["n"][0] == ("case",) and variables["n"][1][:2].tolist() == [3.0, 4.0]


@pytest.mark.parametrize("name", ["pyvista", "xarray"])
def test_programs_that_are_not_installed_are_named(monkeypatch, tmp_path, name):
    monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "sweep.csv").write_text("case,a,status\n1,2,certified\n")
    answer = ddmpi.solve(pinched_blocks(2), MPI.COMM_SELF)
    with pytest.raises(InputError, match=f"{name} is not installed: pip install {name}"):
        answer.to_pyvista("upper") if name == "pyvista" else ddmpi.to_xarray(tmp_path)


def test_pyvista_and_xarray_where_they_are_installed(tmp_path):
    """The same bodies and tables."""
    if find_spec("xarray"):
        (tmp_path / "sweep.csv").write_text("case,a,status,n\n1,2,certified,5\n")
        assert ddmpi.to_xarray(tmp_path)["n"].sel(a=2) == 5
    if find_spec("pyvista"):
        answer = ddmpi.solve(pinched_blocks(2), MPI.COMM_SELF)
        assert answer.to_pyvista("upper").n_points == len(answer.bodies["upper"].points)


@pytest.mark.slow
def test_the_notebook_runs(tmp_path):
    """Cell by cell as a program, and by nbconvert where that is installed."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    commands = [["-c", code]]
    if find_spec("nbconvert") and find_spec("ipykernel"):
        convert = ["nbconvert", "--to", "notebook", "--execute", "--output-dir"]
        commands.append(["-m", *convert, str(tmp_path), str(NOTEBOOK)])
    for command in commands:
        done = subprocess.run(
            [sys.executable, *command], cwd=ROOT, text=True, capture_output=True, timeout=LIMIT
        )
        assert done.returncode == 0, done.stdout + done.stderr
