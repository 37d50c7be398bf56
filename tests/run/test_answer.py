"""The Python interface: resultants and counts of an answer against closed forms."""

import base64
import copy
import dataclasses
import datetime
import inspect
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from documented import NAMES
from matplotlib.figure import Figure
from mpi4py import MPI
from scenes import (
    confined_blocks,
    pinched_blocks,
    rectangle,
    run_here,
    run_python,
    seldom,
    to_toml,
    tower,
    write_scene,
)
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError
from ddmpi.results.fields import contact_fields
from ddmpi.results.tables import named
from ddmpi.run import answer as answers
from ddmpi.run.gather import _write_contacts

two_ranks = pytest.mark.mpi(ranks=2)


@pytest.mark.slow
@two_ranks
def test_gaps_close_and_multiplications_are_counted_step_by_step(comm):
    """A step of the history counts what all bodies have multiplied until then."""
    stack = confined_blocks(3, 4e-4)
    answer = ddmpi.solve(to_toml(stack.scene()), comm)
    (state,) = answer.contacts.values()
    assert state.pressure == pytest.approx(np.full(4, stack.pressure), rel=1e-6)
    assert state.gap == pytest.approx(np.zeros(4), abs=1e-10)
    *_, last = answer.solved.solution.outer.history
    assert last.n_A == answer.summary["n_A"] - 2  # and one each for the final displacement


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_a_rank_writes_the_tables_of_contacts_that_it_owns(comm, tmp_path):
    """Those of which it holds the first body, and no others: the first rank need not write all."""
    solved = ddmpi.solve(to_toml(tower(3, 2)), comm).solved
    _write_contacts(
        tmp_path,
        solved,
        {name: contact_fields(each) for name, each in solved.solution.states.items()},
        [],
    )
    own = {name for name, first, _ in solved.assembly.exchange.ends if first == comm.rank}
    files = [path.name for path in tmp_path.iterdir()]
    assert sorted(files) == sorted(
        f"contact_{name}.{end}" for name in own for end in ("csv", "vtu")
    )
    everyone = comm.allgather(sorted(own))
    contacts = sorted(contact.name for contact in solved.assembly.scene.contact)
    assert sorted(name for each in everyone for name in each) == contacts
    assert sum(map(bool, everyone)) > 1


def test_a_clamp_on_the_contact_moves_it():
    """A surface that is clamped and moved presses the other body, as its own bottom would."""
    stack = confined_blocks(3, 0.0)
    scene = stack.scene()
    for body, on, y in zip(scene["body"], ("top", "top"), (0.0, 1e-3), strict=True):
        body["clamp"] = [
            {"on": on, "x": 0.0, "y": y},
            *({"on": side, "x": 0.0} for side in ("left", "right")),
        ]
    (state,) = ddmpi.solve(to_toml(scene)).contacts.values()
    expected = 1e-3 * stack.upper.confined("strain") / stack.upper.height
    assert state.pressure == pytest.approx(np.full(4, expected), rel=1e-6)


@pytest.mark.slow
@two_ranks
def test_petsc_options_of_a_scene_hold_for_its_run_only(comm):
    scene = to_toml(pinched_blocks(3))
    asked = {
        "petsc.body_ksp_type": "cg",
        "petsc.body_pc_type": "jacobi",
        "petsc.body_ksp_rtol": np.float64(1e-12),
    }
    for overrides, solver in (asked, "cg"), ({}, "mumps"):
        answer = ddmpi.solve(scene, comm, overrides)
        assert answer.certified and not answer.summary["options_unused"]
        assert all(solver in body["solver"] for body in answer.summary["bodies"].values()), (
            answer.summary["bodies"]
        )


def test_overrides_are_values_of_a_scene():
    scene = to_toml(pinched_blocks(2))
    title = 'a "quoted" Größe\\n in µm'
    answer = ddmpi.solve(
        scene,
        None,
        {
            "title": title,
            "body.upper.mesh.divisions": np.array([6, 2]),
            "output": {"figures": False},
            "method.tolerance": 1e-9,
        },
    )
    assert answer.summary["title"] == title and answer.certified
    for value in None, {1, 2}, 1j, datetime.date(2020, 1, 1):
        with pytest.raises(InputError, match=r"^overrides: title: .* is no value of a scene"):
            ddmpi.solve(scene, None, {"title": value})


def test_data_that_contain_themselves_are_refused():
    data, overrides, endless = pinched_blocks(2), {"method": {}}, []
    data["body"][1]["mesh"]["size"] = overrides["method"]["theta"] = endless
    endless.append(endless)
    with pytest.raises(
        InputError, match=r"^scene: body\.lower\.mesh…: is nested too deeply, or contains itself$"
    ):
        ddmpi.solve(data)
    with pytest.raises(
        InputError,
        match=r"^overrides: method\.theta\.0…: is nested too deeply, or contains itself$",
    ):
        ddmpi.solve(pinched_blocks(2), None, overrides)


@pytest.mark.slow
def test_a_dict_is_a_scene(tmp_path, monkeypatch):
    """A dict is read and checked as a file: the same answer, the same messages, paths from the current folder."""
    data = pinched_blocks(2)
    expected = ddmpi.solve(to_toml(data)).contacts["upper-lower"]
    data["body"][0] |= {"clamp": tuple(data["body"][0]["clamp"]), "volume_force": None}
    data["body"][0]["mesh"] |= {"divisions": np.array(data["body"][0]["mesh"]["divisions"])}
    found = ddmpi.solve(data).contacts["upper-lower"]
    assert np.array_equal(found.forces, expected.forces)
    again = ddmpi.solve(ddmpi.solve(data).summary["scene"])
    assert np.array_equal(again.contacts["upper-lower"].forces, expected.forces)
    with pytest.raises(InputError, match=r"^scene: body.upper.titel: unknown key"):
        ddmpi.solve(data | {"body": [data["body"][0] | {"titel": 1}, data["body"][1]]})
    with pytest.raises(InputError, match=r"^scene: title: .* is no value of a scene"):
        ddmpi.solve(data | {"title": {1, 2}})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        InputError, match=r"^scene: body.upper.mesh.file: there is no file none.msh$"
    ):
        ddmpi.solve(
            data
            | {"body": [data["body"][0] | {"mesh": {"file": Path("none.msh")}}, data["body"][1]]}
        )


def test_an_answer_and_its_parts_are_short_in_words():
    """An answer prints as a few lines: title, certificate, reason, largest displacement, forces; bodies as one line."""
    answer = ddmpi.solve(
        pinched_blocks(6) | {"output": {"length_unit": "mm", "stress_unit": "MPa"}}
    )
    first, moved, contact, friction = repr(answer).splitlines()
    assert friction.endswith("% of the friction that it could")
    assert (
        first
        == f"Answer({answer.summary['title']!r}, certified=True, reason='converged and certified')"
    )
    assert (
        moved == f"    largest displacement {answer.summary['displacement_max']:.4g} mm at (3, 1)"
    )
    x, y = answer.contacts["upper-lower"].force
    assert (
        f"; force ({x:.4g}, {y:.4g}) N/mm on upper, largest pressure " in contact
        and " MPa at (" in contact
    )
    assert repr(answer.contacts["upper-lower"]) == "ContactState(upper-lower, 18 nodes)"
    assert all(repr(body).startswith("Fields(133 nodes") for body in answer.bodies.values())


def test_an_answer_is_pickled_without_its_matrices():
    """What cannot be pickled says what can, which has all results."""
    answer = ddmpi.solve(pinched_blocks(2), MPI.COMM_SELF)
    for of in pickle.dumps, copy.deepcopy:
        with pytest.raises(TypeError, match=r"dataclasses.replace\(answer, solved=None\) can"):
            of(answer)
    assert copy.copy(answer).solved is answer.solved
    bare = dataclasses.replace(answer, solved=None)
    for other in pickle.loads(pickle.dumps(bare)), copy.deepcopy(bare):
        assert other.summary == answer.summary and other.certified and repr(other) == repr(answer)
        for name, state in answer.contacts.items():
            assert (other.contacts[name].pressure == state.pressure).all()
        for name, body in answer.bodies.items():
            assert (other.bodies[name].displacement == body.displacement).all()


def test_help_says_it_all():
    """help(ddmpi.solve) describes every parameter, and has an example."""
    words = inspect.getdoc(ddmpi.solve)
    assert all(f"\n{name} : " in words for name in inspect.signature(ddmpi.solve).parameters)
    assert ">>> answer = ddmpi.solve(scene" in words and "InputError" in words


TOLD = """
import logging, sys
from matplotlib.figure import Figure
from mpi4py import MPI
import ddmpi
logging.basicConfig(level="INFO", format="%(levelname)s %(message)s", stream=sys.stderr)
scene = {scene!r}
for progress in (True, False):
    ddmpi.solve(scene, progress=progress)
logging.getLogger("ddmpi").warning("again")
"""


@pytest.mark.slow
def test_progress_is_told_by_rank_0_alone():
    """With progress=True rank 0 prints what the command does; else `logging` has it there."""
    run = run_python(["-c", TOLD.format(scene=pinched_blocks(2))])
    assert run.code == 0, run.output
    assert run.stdout.count("converged and certified") == 1 and "INFO" not in run.stdout
    assert run.stderr.count("INFO converged and certified") == 1
    assert run.stderr.count("WARNING again") == 2


@pytest.mark.parametrize("scene", [seldom("plane"), "axis", seldom("space")])
def test_a_contact_is_a_table(scene, tmp_path):
    """`ContactState.table` has the names, rows and numbers of contact_NAME.csv."""
    plain = {
        "plane": lambda: pinched_blocks(2),
        "space": lambda: two_boxes(2, 3),
        "axis": lambda: {
            "axisymmetric": True,
            "body": [
                rectangle(
                    "disc", (0.0, 1.0), (1.0, 1.0), (2, 2), 2, clamp=[{"on": "top", "y": -1e-3}]
                ),
                rectangle("core", (0.0, 0.0), (1.0, 1.0), (3, 2), 2, clamp=["bottom"]),
            ],
            "contact": [{"bodies": ["disc", "core"], "on": ["bottom", "top"]}],
        },
    }[scene]()
    run = run_here(write_scene(plain, tmp_path / "scene.toml"), tmp_path / "out", "--no-figures")
    ((name, state),) = ddmpi.solve(plain, MPI.COMM_SELF).contacts.items()
    table, file = state.table(), run.table(f"contact_{name}.csv")
    documented = NAMES["contact_NAME.csv" + " of solids" * (scene == "space")]
    assert list(table.dtype.names) == list(file) == named(documented, scene == "axis")
    for column, values in file.items():
        assert np.array_equal(table[column], values), column
    # nodes that share a row share its force
    assert (len(table) > state.interface.m) == (scene == "axis")
    assert table["normal_force"].sum() == pytest.approx(state.normal_force.sum(), rel=1e-12)
    assert table["normal_stress"] @ table["area" if "area" in file else "length"] == pytest.approx(
        state.normal_force.sum(), rel=1e-12
    )
    forces = [table[f"force_{axis}"].sum() for axis in "xyz"] if scene == "space" else []
    assert forces == pytest.approx(state.force[: len(forces)], rel=1e-9)
    assert set(table["status"]) <= {"open", "slip", "stick"} and table["normal_force"].any()


@pytest.mark.parametrize(
    "scene",
    [
        seldom(lambda: pinched_blocks(2), id="plane"),
        seldom(lambda: two_boxes(2), id="space"),
        pytest.param(lambda: tower(3, 2), id="tower"),
    ],
)
def test_a_notebook_shows_an_answer(scene, monkeypatch):
    """HTML with each contact's numbers, whatever its name, and a picture; without matplotlib the table alone."""
    scene = scene() | {"title": "<Two> & more $x"}
    scene["contact"][0]["name"] = "a<b>&$"
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    drawn: list = []
    save = Figure.savefig

    def noted(figure, *given, **keys) -> None:
        drawn.append(figure)
        save(figure, *given, **keys)

    monkeypatch.setattr(Figure, "savefig", noted)
    shown = answer._repr_html_()
    assert "; largest displacement " in shown
    largest = sorted(answer.contacts, key=lambda name: answer.contacts[name].normal_force.sum())
    assert [axes.get_title() for axes in drawn[0].axes if axes.get_title()] == [
        name.replace("$", r"\$") for name in largest[::-1]
    ]
    for name, axes in zip(largest[::-1], drawn[0].axes, strict=False):
        table = answer.contacts[name].table()
        if "z" in table.dtype.names:
            continue  # in space points with colours
        at = np.argsort(table["x"])
        lines = [line.get_xydata() for line in axes.lines]
        arc = np.sort(table["x"]) - table["x"].min()
        assert all(line[:, 0] == pytest.approx(arc, abs=1e-9) for line in lines)
        for line, kind in zip(lines, ("normal", "tangential"), strict=True):
            stress = np.sort(table[f"{kind}_stress"][at])
            assert np.sort(line[:, 1]) * 1e6 == pytest.approx(stress, rel=1e-9), name
        assert axes.get_ylabel() == "stress (MPa)"
    assert (
        "&lt;Two&gt; &amp; more" in shown
        and "<th>a&lt;b&gt;&amp;$</th>" in shown
        and "a<b>" not in shown
    )
    assert shown.count("<tr>") == 1 + len(answer.contacts)
    contact = answer.summary["contacts"]["a<b>&$"]
    cells = re.findall(r"<td>(.*?)</td>", shown)
    assert cells[5:8] == [str(contact[status]) for status in ("open", "slip", "stick")]
    (image,) = re.findall(r'src="data:image/png;base64,([^"]*)"', shown)
    assert base64.b64decode(image).startswith(b"\x89PNG")
    assert "http" not in shown
    monkeypatch.setattr(answers, "has_matplotlib", lambda: False)
    assert "<img" not in answer._repr_html_() and "<table>" in answer._repr_html_()
