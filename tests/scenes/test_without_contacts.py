"""Scenes without contacts: each body is solved alone, certified, in the plane, around an axis and in space."""

import pytest
from mpi4py import MPI
from scenes import call, certified, rectangle, run_here, seldom, write_scene
from solid_scenes import box

import ddmpi

LENGTH, FORCE, YOUNG = 2.0, 1e6, 1e9
WAYS = ["plane", "axis", "space"]


def bar(name: str, way: str, at: float = 0.0, order: int = 1, **more) -> dict:
    """A bar of length 2 m, pulled along the last axis, that may contract; plane bars are in plane stress."""
    up = [0.0] * (2 if way == "space" else 1)
    load = {"on": "top", "force": [*up, FORCE], **more}
    if way == "space":
        return box(
            name,
            [at, 0, 0],
            [1, 1, LENGTH],
            [2, 2, 3],
            order,
            young=YOUNG,
            poisson=0.3,
            traction=[load],
            clamp=[{"on": "bottom", "z": 0.0}, {"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}],
        )
    body = rectangle(
        name,
        [at, 0.0],
        [1.0, LENGTH],
        [3, 4],
        order,
        young=YOUNG,
        traction=[load],
        clamp=[{"on": "bottom", "y": 0.0}, {"on": "left", "x": 0.0}],
    )
    body["material"] |= {"plane": "stress"} if way == "plane" else {}
    return body


def stretched(answer, name: str, way: str, factor: float = 1.0) -> None:
    area = {"plane": 1.0, "axis": 3.141592653589793, "space": 1.0}[way]
    moved = answer.bodies[name].displacement[:, -1].max()
    assert moved == pytest.approx(factor * FORCE / area * LENGTH / YOUNG, rel=1e-6)
    assert answer.summary["bodies"][name]["reaction"][-1] == pytest.approx(
        -factor * FORCE, rel=1e-9
    )


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("bodies", [seldom(1), 3])
def test_bodies_alone_on_ranks(comm, bodies):
    """So are several bodies; a warning names each, on fewer and on more ranks than bodies, and load steps go on."""
    scene = {
        "body": [bar(f"bar{k}", "space", 5.0 * k, history="pull") for k in range(bodies)],
        "history": {"pull": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 1},
    }
    answer = certified(scene, comm)
    for name in answer.bodies:
        stretched(answer, name, "space", 0.5)
    alone = [w for w in answer.summary["warnings"] if "no contact names it" in w]
    assert len(alone) == (bodies > 1)
    for warning in alone:
        assert all(f"body.bar{k}" in warning for k in range(bodies))
    assert [step["time"] for step in answer.summary["steps"]] == [1.0, 2.0]


def test_a_body_alone_that_nothing_supports():
    """A loose body without contacts has no equilibrium under a force."""
    body = bar("bar", "space")
    answer = ddmpi.solve({"body": [body | {"clamp": body["clamp"][1:]}]}, MPI.COMM_SELF)
    assert not answer.certified and "no equilibrium: bar would move along z" in answer.reason


@pytest.mark.slow
@pytest.mark.parametrize("way", ["plane", "space"])
def test_files_of_a_body_alone(tmp_path, way):
    """Pictures, tables, the check and the report of a scene without contacts are there, with finite numbers."""
    path = write_scene({"body": [bar("bar", way)]}, tmp_path / "scene.toml")
    run = run_here(path, tmp_path / "run")
    assert run.code == 0 and "friction" not in run.stdout.split("\n")[1] and not run.stderr
    assert {"bodies.png", "result.h5", "steps.csv", "summary.json"} <= {
        file.name for file in run.folder.iterdir()
    }
    assert call("report", str(run.folder)).code == 0
    checked = call("check", str(path), "--output", str(tmp_path / "check"))
    assert checked.code == 0 and not (tmp_path / "check" / "contacts.png").exists()


def squeezed(way: str, share: float = 1.0, floor: bool = False) -> dict:
    """A loose body under a pressure at one end and `share` of it at the other, alone or on a floor without friction."""
    scene = {"axisymmetric": way == "axis", "body": [bar("bar", way)]}
    body = scene["body"][0]
    del body["clamp"], body["traction"]
    body["traction"] = [
        {"on": "top", "pressure": FORCE},
        {"on": "bottom", "pressure": share * FORCE},
    ]
    if floor:
        flat, normal = ([0.0, 0.0], [1.0, 0.0]) if way == "plane" else ([0.0] * 3, [1.0, 0.0, 0.0])
        scene["rigid"] = [{"name": "floor", "shape": "plane", "point": flat, "normal": normal}]
        scene["contact"] = [
            {"bodies": ["bar", "floor"], "on": ["left"], "friction": {"law": "none"}}
        ]
    return scene


@pytest.mark.parametrize(
    "way, floor", [*((way, False) for way in WAYS), ("plane", True), ("space", True)]
)
def test_loads_that_balance_each_other_need_no_force(way, floor):
    """A loose body under equal pressures at both ends is shorter by p L / E, whatever rounding leaves as a resultant."""
    answer = certified(squeezed(way, floor=floor))
    moved = answer.bodies["bar"].displacement[:, -1]
    assert moved.max() - moved.min() == pytest.approx(FORCE * LENGTH / YOUNG, rel=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_loads_that_do_not_balance_each_other_are_no_equilibrium(way):
    """Not even where they differ by a millionth; a billionth is rounding, as of coordinates in a file."""
    answer = ddmpi.solve(squeezed(way, 1.0 + 4e-6), MPI.COMM_SELF)
    assert answer.reason.startswith("no equilibrium: bar would move along")
    certified(squeezed(way, 1.0 + 1e-9))


def test_the_log_says_nothing_of_contacts(caplog):
    """Neither of their nodes in load steps, nor of more than one of what there is once."""
    scene = {
        "body": [bar("bar", "plane", history="pull")],
        "history": {"pull": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}},
        "time": {"points": [1.0], "steps": 1},
    }
    caplog.set_level("INFO", "ddmpi")
    ddmpi.solve(scene, MPI.COMM_SELF)
    assert not any(word in caplog.text for word in ("contact nodes", "open", "friction:"))
    assert "(1 outer iteration, " in caplog.text
