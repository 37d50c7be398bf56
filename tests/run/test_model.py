"""Prepared models: every answer is that of a run by itself, to the bit, whatever was solved before."""

import random

import pytest
from mpi4py import MPI
from reused import CHANGES, changes, content, differences
from scenes import pinched_blocks, rectangle, seldom, to_toml, tower
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError, SolverError

MU = "contact.upper-lower.friction.coefficient"


def pressed() -> dict:
    """A heated block on springs between a block that is loaded and drawn along in two legs, and a rigid one."""
    material = {"young": 1e9, "poisson": 0.3, "expansion": 1e-5}
    lower = rectangle(
        "lower",
        [0.0, 0.0],
        [3.0, 1.0],
        [3, 1],
        foundation=[{"on": "left", "normal": 1e8}],
        temperature=10.0,
    ) | {"material": material}
    upper = rectangle(
        "upper",
        [0.5, 1.0],
        [2.0, 1.0],
        [3, 1],
        order=1,
        young=2e9,
        clamp=[{"on": "top", "x": 1e-3, "history": "push"}],
        traction=[{"on": "top", "value": [0.0, -1e6]}],
    )
    floor = {
        "name": "floor",
        "shape": "plane",
        "point": [0.0, 0.0],
        "normal": [0.0, 1.0],
        "displacement": [0.0, 1e-4],
        "history": "push",
    }
    friction = {"law": "coulomb", "coefficient": 0.4}
    return {
        "body": [upper, lower],
        "rigid": [floor],
        "contact": [
            {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": friction},
            {"bodies": ["lower", "floor"], "on": ["bottom"], "friction": friction, "gap": 1e-5},
        ],
        "history": {"push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, -1.0]}},
        "time": {"points": [1.0, 2.0], "steps": 1},
    }


def around() -> dict:
    """Two rings around an axis, meshes that do not match."""
    inner = rectangle(
        "inner",
        [0.5, 0.0],
        [1.0, 1.0],
        [3, 4],
        order=2,
        clamp=["bottom"],
        traction=[{"on": "left", "pressure": 1e6}],
    )
    outer = rectangle(
        "outer", [1.5, 0.0], [1.0, 1.0], [2, 3], order=2, clamp=[{"on": "bottom", "y": 1e-6}]
    )
    return {
        "axisymmetric": True,
        "body": [inner, outer],
        "contact": [
            {
                "bodies": ["inner", "outer"],
                "on": ["right", "left"],
                "friction": {"law": "coulomb", "coefficient": 0.2},
            }
        ],
    }


SCENES = {
    "held": pinched_blocks(3),
    "load steps": pressed(),
    "loose": tower(2, 2),
    "space": two_boxes(2),
    "around an axis": around(),
}


def compare(model, scene: dict, overrides: dict, comm=None, only: str | None = None) -> None:
    """A model and a run by itself end alike: with the same answer, or the same error."""
    ends = []
    for solve in (
        lambda: model.solve(overrides, only),
        lambda: ddmpi.solve(scene, comm, overrides, only=only),
    ):
        try:
            ends.append(content(solve()))
        except (InputError, SolverError) as error:
            ends.append(str(error))
    assert differences(*ends) == [], overrides


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_each_change_has_the_answer_of_a_run_by_itself(name):
    """One change after the other, and then some together; nothing of an earlier case is left in a later one. All changes
    of blocks that are held; of other scenes what these do not have, and half of the rest."""
    scene, rng = SCENES[name], random.Random(name)
    odd, held = [*SCENES].index(name) % 2, SCENES["held"]
    some = [
        change
        for k, change in enumerate(CHANGES)
        if name == "held" or k % 2 == odd or not change(random.Random(name), held)
    ]
    with ddmpi.prepare(scene) as model:
        for change in some:
            if overrides := change(rng, scene):
                compare(model, scene, overrides)
        compare(model, scene, changes(rng, scene), only="contacts")


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_the_ranks_of_a_body_stay(comm):
    """On several ranks a body: their factors are kept from solve to solve, and anew where a mesh needs other ranks."""
    scene = pinched_blocks(4)
    with ddmpi.prepare(scene, comm) as model:
        for overrides in (
            {},
            {MU: 0.5},
            {"body.upper.material.poisson": 0.2},
            {MU: 0.1},
            {"body.lower.mesh.divisions": [30, 10]},
        ):
            answer, other = model.solve(overrides), ddmpi.solve(scene, comm, overrides)
            (state,), (fresh,) = answer.contacts.values(), other.contacts.values()
            # on several ranks MUMPS adds up in any order
            assert state.normal_force == pytest.approx(fresh.normal_force, rel=1e-8, abs=1e-6)
            assert answer.summary["n_A"] == pytest.approx(other.summary["n_A"], rel=0.1)
            if overrides in ({MU: 0.5}, {MU: 0.1}):
                assert answer.summary["reused"] == model.reused
                assert "compliance" in model.reused["lower"]
        assert model.reused == {}
        with pytest.raises(InputError):
            model.solve({"body.upper.clamp": ["nowhere"]})
        assert model.solve({}).certified


PUSHED = {
    "body": [
        rectangle(
            "upper",
            [0.5, 1.0],
            [2.0, 1.0],
            [8, 4],
            clamp=[{"on": "top", "x": 1e-4, "y": -1e-4}],
            traction=[{"on": "left", "value": [1e5, 0.0]}],
        )
    ],
    "rigid": [{"name": "lower", "shape": "plane", "point": [0.0, 1.0], "normal": [0.0, 1.0]}],
    "contact": [
        {
            "bodies": ["upper", "lower"],
            "on": ["bottom"],
            "friction": {"law": "coulomb", "coefficient": 0.3},
        }
    ],
}
"""One body, so that all ranks are its."""


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_changes_on_several_ranks(comm):
    """Contacts alone are those of runs by themselves, up to the order of additions where a body has several ranks."""
    kept, load = {"factors", "compliance"}, PUSHED["body"][0]["traction"][0]["value"]
    changed = (
        {MU: 0.5},
        {"body.upper.traction.0.value": [2 * x for x in load]},
        {"contact.upper-lower.gap": 1e-6},
    )
    stiffer = {"body.upper.material.young": 3e11}
    with ddmpi.prepare(PUSHED, comm) as model:
        model.solve(only="contacts")
        for overrides, spared in (
            *((change, True) for change in changed),
            (stiffer, False),
            ({}, False),
        ):
            answer = model.solve(overrides, only="contacts")
            assert (kept <= set(model.reused.get("upper", ()))) is spared
            fresh = ddmpi.solve(PUSHED, comm, overrides, only="contacts")
            assert answer.certified and answer.summary["n_A"] == pytest.approx(
                fresh.summary["n_A"], rel=0.1
            )
            one, other = answer.contacts["upper-lower"], fresh.contacts["upper-lower"]
            assert (one.status == other.status).all()
            assert one.forces == pytest.approx(
                other.forces, rel=1e-9, abs=1e-9 * abs(other.forces).max()
            )
            for name, body in fresh.summary["bodies"].items():
                assert answer.summary["bodies"][name]["reaction"] == pytest.approx(
                    body["reaction"], rel=1e-8, abs=1e-3
                )


def test_nobody_changes_what_is_kept():
    """Nodes in other units, in place, would make the next answer one of another mesh."""
    with ddmpi.prepare(pinched_blocks(3)) as model:
        answer = model.solve()
        for kept in answer.bodies["upper"].points, answer.contacts["upper-lower"].interface.xy:
            with pytest.raises(ValueError, match="read-only"):
                kept *= 1e3
        compare(model, pinched_blocks(3), {MU: 0.4})


def test_what_is_kept_is_told():
    """`reused` names what the last solve has taken; a failing case leaves the rest as it was."""
    parts = ["mesh", "stiffness", "factors", "compliance"]
    with ddmpi.prepare(pinched_blocks(2)) as model:
        assert model.solve().summary["reused"] == {}
        model.solve({MU: 0.4})
        assert model.reused == {"upper": parts, "lower": parts, "upper-lower": ["rows"]}
        model.solve({"body.upper.material.poisson": 0.3})
        assert model.reused == {"upper": ["mesh"], "lower": parts}
        with pytest.raises(InputError, match="nowhere"):
            model.solve({"body.lower.clamp": ["nowhere"]})
        model.solve({"body.upper.material.poisson": 0.3, MU: 0.2})
        assert model.reused["upper"] == parts
        for overrides in (
            {"petsc.body_mat_mumps_icntl_7": 0},
            {"method.compliance": "direct"},
            {"method.compliance": "explicit"},
        ):
            model.solve()
            model.solve(overrides)
            assert "compliance" not in model.reused.get("lower", ())
        for name in "upper", "lower":
            model.solve()
            model.solve({f"body.{name}.mesh.divisions": [7, 2]})
            assert "upper-lower" not in model.reused
    with pytest.raises(InputError, match="closed"):
        model.solve()


def drawn(folder) -> dict:
    """A drawn block that is pressed on a floor and against a wall, with elements that are finer along contacts."""
    (folder / "block.geo").write_text(
        """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 1, 1};
        Physical Curve("bottom") = {1}; Physical Curve("right") = {2}; Physical Curve("top") = {3};
        Physical Curve("left") = {4}; Physical Surface("block") = {1};""",
        encoding="utf-8",
    )
    block = {
        "name": "block",
        "mesh": {"geometry": str(folder / "block.geo"), "size": 0.5},
        "material": {"young": 1e9, "poisson": 0.3},
        "clamp": [{"on": "top", "y": -1e-3}, {"on": "right", "x": -1e-3}],
    }
    partners = ("floor", [0.0, 1.0], "bottom"), ("wall", [1.0, 0.0], "left")
    return {
        "body": [block],
        "rigid": [
            {"name": name, "shape": "plane", "point": [0.0, 0.0], "normal": normal}
            for name, normal, _ in partners
        ],
        "contact": [
            {"name": on, "bodies": ["block", name], "on": [on]} for name, _, on in partners
        ],
    }


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("held", {"body.upper.mesh.size": [3.0, 1.2]}),
        seldom("held", {"body.upper.material.young": 1e11}),
        seldom("held", {"method.compliance": "explicit"}),
        ("held", {"body.lower.traction.0.on": "nowhere"}),
        seldom(
            "load steps", {"body.lower.volume_force": {"value": [0.0, -1e5], "history": "push"}}
        ),
        seldom("drawn", {"contact.0.name": "left", "contact.1.name": "bottom"}),
        seldom("around an axis", {"axisymmetric": False}),
        seldom("drawn", {"contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}]}),
        seldom(
            "drawn",
            {
                "method.target_error": 0.008,
                "body.0.clamp": [{"on": "top", "y": "-1e-3 * x"}, {"on": "right", "x": -1e-3}],
            },
        ),
        seldom(
            "drawn",
            {
                f"rigid.{k}.{key}": [0.0, 0.0, float(key == "normal")]
                for k in (0, 1)
                for key in ("point", "normal")
            },
        ),
    ],
)
def test_each_dependency_counts(scene, overrides, tmp_path):
    """A change that one entry of the key of a stage alone tells of; others touch several entries."""
    scene = drawn(tmp_path) if scene == "drawn" else SCENES[scene]
    with ddmpi.prepare(scene) as model:
        model.solve()
        compare(model, scene, overrides)


def test_discs_are_no_blocks():
    """A mesh around an axis is another one than that of the same shape in the plane."""
    lower = rectangle("lower", [0.0, 0.0], [1.0, 0.5], [2, 1], clamp=["bottom"])
    upper = rectangle("upper", [0.0, 0.5], [1.0, 0.5], [2, 1])
    upper["traction"] = [{"on": "top", "value": [0.0, "-1e5 * (1 + x)"]}]
    friction = {"law": "coulomb", "coefficient": 0.3}
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": friction}
    scene = {"axisymmetric": True, "body": [lower, upper], "contact": [contact]}
    with ddmpi.prepare(scene) as model:
        model.solve()
        compare(model, scene, {"axisymmetric": False})


def test_sides_see_the_friction_of_others():
    """A node that another contact holds along this one has no row of its own at some ends of mortar contacts."""
    with ddmpi.prepare(SCENES["load steps"]) as model:
        model.solve(only="contacts")
        model.solve({"contact.1.friction": {"law": "none"}}, only="contacts")
        found = model._cases._kept.found
    assert "side" in found["lower-floor.0"]
    assert "side" not in found.get("upper-lower.1", ())


@pytest.mark.slow
def test_multigrid_remembers_nothing():
    """Its solves begin from earlier ones: those of the case alone."""
    scene = pinched_blocks(4, compliance="iterative")
    with ddmpi.prepare(scene) as model:
        model.solve({MU: 0.5})
        compare(model, scene, {MU: 0.2})
        assert model.reused == {
            "upper": ["mesh", "stiffness"],
            "lower": ["mesh", "stiffness"],
            "upper-lower": ["rows"],
        }


def test_the_content_of_a_mesh_file_counts(tmp_path):
    """A mesh file that is written anew under its name, in the same second, is read anew."""
    import meshio

    def write(height: float) -> None:
        points = [[0, 0, 0], [1, 0, 0], [1, height, 0], [0, height, 0]]
        meshio.write(
            tmp_path / "block.msh",
            meshio.Mesh(
                points,
                [("line", [[0, 1], [2, 3]]), ("triangle", [[0, 1, 2], [0, 2, 3]])],
                cell_data={"gmsh:physical": [[1, 2], [3, 3]], "gmsh:geometrical": [[1, 2], [3, 3]]},
                field_data={"bottom": [1, 1], "top": [2, 1], "block": [3, 2]},
            ),
            file_format="gmsh22",
            binary=False,
        )

    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    block = {
        "name": "block",
        "mesh": {"file": str(tmp_path / "block.msh")},
        "material": {"young": 1e9, "poisson": 0.0},
        "traction": [{"on": "top", "pressure": 1e6}],
        "clamp": [{"on": "bottom", "x": 0.0}],
    }
    scene = {
        "body": [block],
        "rigid": [floor],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}],
    }
    write(1.0)
    with ddmpi.prepare(scene) as model:
        one = model.solve().summary["displacement_max"]
        model.solve()
        assert "mesh" in model.reused["block"]
        write(2.0)
        assert model.solve().summary["displacement_max"] == pytest.approx(2 * one)


def test_an_answer_to_begin_with():
    """`start` saves steps, the summary names it, and an answer of other nodes is refused."""
    scene = pinched_blocks(6)
    with ddmpi.prepare(scene) as model:
        first = model.solve({MU: 0.3})
        far, near = model.solve({MU: 0.31}), model.solve({MU: 0.31}, start=first)
        assert near.certified
        assert near.summary["outer_iterations"] < far.summary["outer_iterations"]
        assert near.summary["started_from"] == first.summary["run"]
        assert "started_from" not in far.summary
        (state,), (other,) = near.contacts.values(), far.contacts.values()
        assert state.normal_force == pytest.approx(other.normal_force, rel=1e-6)
        with pytest.raises(InputError, match="other nodes"):
            model.solve(
                {f"body.{name}.mesh.divisions": [12, 4] for name in ("upper", "lower")}, start=first
            )
    with (
        ddmpi.prepare(pressed()) as model,
        pytest.raises(InputError, match="a scene without load steps"),
    ):
        model.solve(start=first)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"overrides": [("title", 1)]}, "overrides: expected a table"),
        ({"overrides": {MU: True}}, MU),
        (
            {"overrides": {"contact.lower.gap": 0.0}},
            r"^overrides: contact\.lower\.gap: there is no entry",
        ),
        ({"overrides": {"title": "\udc80"}}, "overrides: title: '.udc80' is not text"),
        ({"start": {}}, "start: expected an"),
        ({"only": 3}, "output.only: expected words"),
        ({"outer": int}, "method.outer = .builtins:int. is no class"),
    ],
)
def test_values_of_wrong_types_are_refused(wrong, words):
    """By one message that names the argument or the key."""
    with ddmpi.prepare(pinched_blocks(3)) as model, pytest.raises(InputError, match=words):
        model.solve(**wrong)


def test_numbers_are_no_results():
    """Nor are they once the model is closed."""
    with ddmpi.prepare(pinched_blocks(3)) as model:
        answer = model.solve()
    for ask in answer.derivative, answer.gradient:
        with pytest.raises(InputError):
            ask(3)


@pytest.mark.parametrize("scene", [3, None, [], b"scene.toml", ""])
def test_what_is_no_scene_is_refused(scene):
    """By words, not as a file that is missing; so is what is no communicator."""
    for call in ddmpi.prepare, ddmpi.solve:
        with pytest.raises(
            InputError, match=r"^scene: expected a path, the text of a scene, or a table"
        ):
            call(scene)
    for comm in (3, MPI.COMM_NULL):
        with pytest.raises(InputError, match=r"^comm: expected a communicator"):
            ddmpi.prepare(pinched_blocks(2), comm=comm)
    with pytest.raises(InputError, match=r"^overrides: expected a table of values by key"):
        ddmpi.converge(pinched_blocks(2), "contacts.upper-lower.force.x", overrides=["a=1"])


def test_memory_is_given_back_by_teams_alone(monkeypatch):
    """Where a rank has whole bodies its freed memory stays: page faults cost a sixth of a run of two blocks."""
    called = []
    monkeypatch.setattr("ddmpi.coupling.ranks.give_back", lambda: called.append(True))
    assert ddmpi.solve(to_toml(pinched_blocks(2))).certified
    assert not called
