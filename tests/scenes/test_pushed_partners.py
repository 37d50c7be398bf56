"""Rigid partners that forces push: against closed forms and against partners that are moved; what they hold."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, certified, rectangle, run_here, seldom, write_scene
from solid_scenes import box

import ddmpi
from ddmpi.run import equilibrium, report

YOUNG, FORCE = 1e9, 1e6
SHAPES = {
    2: {
        "plane": {"point": [0.0, 1.0], "normal": [0.0, -1.0]},
        "circle": {"center": [1.0, 4.0], "radius": 3.0},
    },
    3: {
        "plane": {"point": [0.0, 0.0, 1.0], "normal": [0.0, 0.0, -1.0]},
        "sphere": {"center": [1.0, 0.5, 4.0], "radius": 3.0},
        "cylinder": {"point": [1.0, 0.0, 4.0], "axis": [0.0, 1.0, 0.0], "radius": 3.0},
    },
}


def refused(scene: dict) -> str:
    """Why there is no answer."""
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    assert not answer.certified
    return answer.reason


def block(
    name: str,
    d: int,
    at: tuple[float, float] = (0.0, 0.0),
    size: tuple[float, float] = (2.0, 1.0),
    divisions: tuple[int, int] = (8, 4),
    order: int = 1,
    poisson: float = 0.3,
    **more,
) -> dict:
    if d == 2:
        return rectangle(name, at, size, divisions, order, YOUNG, poisson, **more)
    return box(
        name,
        (at[0], 0.0, at[1]),
        (size[0], 1.0, size[1]),
        (divisions[0], 2, divisions[1]),
        order,
        YOUNG,
        poisson,
        **more,
    )


def along(d: int, across: float, down: float) -> list[float]:
    return [across, *[0.0] * (d - 2), -down]


def pressed(
    d: int,
    shape: str = "plane",
    force: list | None = None,
    lift: float = 0.0,
    law: dict | None = None,
    order: int = 1,
    **ram,
) -> dict:
    """A block that stands on its clamp, and a ram above it."""
    place = {
        key: np.add(value, along(d, 0.0, -lift)).tolist() if key in ("point", "center") else value
        for key, value in SHAPES[d][shape].items()
    }
    return {
        "body": [block("block", d, order=order, clamp=["bottom"])],
        "rigid": [
            {
                "name": "ram",
                "shape": shape,
                "force": along(d, 0.0, FORCE) if force is None else force,
            }
            | place
            | ram
        ],
        "contact": [
            {"bodies": ["block", "ram"], "on": ["top"]} | ({"friction": law} if law else {})
        ],
    }


LAWS = {
    "none": None,
    "coulomb": {"law": "coulomb", "coefficient": 0.5},
    "tresca": {"law": "tresca", "slip_bound": 4e5},
}


@pytest.mark.parametrize(
    ("d", "shape", "law", "order", "lift"),
    [
        (2, "circle", "coulomb", 1, 0.3),
        (3, "cylinder", "coulomb", 1, 0.0),
        (3, "plane", "tresca", 1, 0.3),
        seldom(2, "circle", "none", 2, 0.0),
        seldom(2, "plane", "tresca", 2, 0.3),
        seldom(3, "sphere", "none", 1, 0.3),
    ],
)
def test_pushed_as_far_as_moved(d, shape, law, order, lift):
    """Force balance to rounding; the same partner, moved as far, is pressed by the same forces; also across a gap."""
    force = along(d, 0.2 * FORCE if law != "none" else 0.0, FORCE)
    scene = pressed(d, shape, force, lift, LAWS[law], order)
    answer = certified(scene)
    ram, (state,) = answer.summary["rigid"]["ram"], answer.contacts.values()
    axes = np.flatnonzero(force)  # along the others it is held
    assert np.abs(np.array(ram["force"]) + force)[axes].max() <= 1e-8 * FORCE
    assert state.forces.sum(axis=0)[axes] == pytest.approx(np.array(force)[axes], abs=1e-8 * FORCE)
    pushed = scene["rigid"][0]
    del pushed["force"]
    moved = certified(scene | {"rigid": [pushed | {"displacement": ram["displacement"]}]})
    (other,) = moved.contacts.values()
    assert np.abs(other.forces - state.forces).max() <= 1e-5 * np.abs(state.forces).max()


def vice(d: int, force: float, weight: float) -> dict:
    """A loose block between a fixed jaw and one that is pushed, with a weight."""
    jaws = [("fixed", 2.0, -1.0), ("moving", -0.1, 1.0)]
    return {
        "body": [block("part", d, volume_force=along(d, 0.0, weight))],
        "rigid": [
            {
                "name": name,
                "shape": "plane",
                "point": along(d, x, 0.0),
                "normal": along(d, sign, 0.0),
            }
            | ({"force": along(d, force, 0.0)} if name == "moving" else {})
            for name, x, sign in jaws
        ],
        "contact": [
            {
                "bodies": ["part", name],
                "on": [on],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
            for name, on in (("fixed", "right"), ("moving", "left"))
        ],
    }


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.clarabel
def test_a_pushed_jaw_holds_a_loose_body(d):
    """Up to the weight that friction bears; beyond it the block slides; without a force, and pulled, nothing holds."""
    answer = certified(vice(d, FORCE, 0.9 * 0.3 * FORCE))
    contacts = answer.summary["contacts"]
    assert sum(each["force"][-1] for each in contacts.values()) == pytest.approx(
        0.54 * FORCE, rel=1e-6
    )
    assert answer.summary["rigid"]["moving"]["displacement"][0] > 0.1
    assert "no equilibrium: part would move along -" + "xyz"[d - 1] in refused(
        vice(d, FORCE, 1.1 * 0.3 * FORCE)
    )
    assert "no equilibrium" in refused(vice(d, -FORCE, 0.0))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.clarabel
def test_a_push_that_nothing_bears(d):
    """The partner moves away, or slides off, in words that name it."""
    assert "no equilibrium: ram would move along " + "xyz"[d - 1] in refused(
        pressed(d, force=along(d, 0.0, -FORCE), lift=0.1)
    )
    assert "no equilibrium: ram would move along x" in refused(
        pressed(d, force=along(d, 0.6 * FORCE, FORCE), law=LAWS["coulomb"])
    )


@pytest.mark.slow
def test_without_clarabel_the_question_is_not_asked(tmp_path, monkeypatch):
    """The log says so once, and what to install; scenes that have an answer are solved."""
    for module in (equilibrium, report):
        monkeypatch.setattr(module, "has_clarabel", lambda: False)
    run = run_here(
        write_scene(vice(2, FORCE, 0.9 * 0.3 * FORCE), tmp_path / "scene.toml"), tmp_path / "out"
    )
    assert run.code == 0 and run.stdout.count("pip install clarabel") == 1
    assert not refused(vice(2, FORCE, 2.0 * 0.3 * FORCE)).startswith("no equilibrium:")


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
def test_load_steps(d):
    """Works balance; without friction a partner that is pushed and moved aside goes as far as in one step."""
    scene = pressed(
        d,
        force=along(d, 0.0, FORCE),
        law=LAWS["coulomb"],
        lift=0.05,
        history="push",
        displacement=along(d, 1e-3, 0.0),
    )
    scene |= {
        "history": {"push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.4]}},
        "time": {"points": [1.0, 2.0], "steps": 4},
        "output": {"steps": "all"},
    }
    summary = certified(scene).summary
    assert summary["energy"]["residual"] <= 1e-10
    for step, factor in zip(
        summary["steps"], [0.25, 0.5, 0.75, 1.0, 0.85, 0.7, 0.55, 0.4], strict=True
    ):
        ram = step["rigid"]["ram"]
        assert ram["force"][-1] == pytest.approx(factor * FORCE, rel=1e-8)
        assert ram["displacement"][0] == pytest.approx(factor * 1e-3, rel=1e-12)
        assert ram["displacement"][-1] < -0.05
    scene["contact"][0]["friction"] = {"law": "none"}
    stepped = certified(scene).summary["rigid"]["ram"]["displacement"]
    for key in ("history", "time", "output"):
        del scene[key]
    del scene["rigid"][0]["history"]
    scene["rigid"][0] |= {"force": along(d, 0.0, 0.4 * FORCE), "displacement": along(d, 4e-4, 0.0)}
    assert stepped == pytest.approx(
        certified(scene).summary["rigid"]["ram"]["displacement"], rel=1e-7
    )


def test_a_partner_falls_on_a_clamped_node():
    """A flat ram that meets a node which clamps hold comes no farther."""
    scene = pressed(2)
    scene["body"][0]["clamp"] = ["bottom", "left"]
    answer = certified(scene)
    assert answer.summary["rigid"]["ram"]["displacement"][1] == pytest.approx(0.0, abs=1e-12)
    assert answer.summary["rigid"]["ram"]["force"] == pytest.approx(
        [0.0, FORCE], rel=1e-9, abs=1e-3
    )


def test_a_ram_around_an_axis():
    """A confined disc on a mat under a ram whose force is that of the whole disc, across a gap: p/k + pH/M."""
    poisson, radius, k = 0.3, 2.0, 1e9
    scene = pressed(2, force=[0.0, -np.pi * radius**2 * FORCE], lift=0.3) | {"axisymmetric": True}
    scene["body"][0] |= {
        "clamp": [{"on": "right", "x": 0.0}],
        "foundation": [{"on": "bottom", "normal": k}],
    }
    answer = certified(scene)
    confined = YOUNG * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson)
    down = 0.3 + FORCE / k + FORCE / confined
    assert answer.summary["rigid"]["ram"]["displacement"] == pytest.approx([0.0, -down], rel=1e-9)
    assert answer.summary["rigid"]["ram"]["force"][1] == pytest.approx(
        np.pi * radius**2 * FORCE, rel=1e-12
    )
    scene["rigid"][0]["force"] = [1.0, -1.0]
    with pytest.raises(ddmpi.errors.InputError, match=r"rigid\.ram\.force: .* pushed along y only"):
        ddmpi.solve(scene, MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("ram", "words"),
    [
        ({"force": [0.0, 0.0]}, "rigid.ram: force must not be zero"),
        (
            {"force": [1.0, -1e4], "displacement": [1e-3, 0.0]},
            "rigid.ram: along x it has both a force and a displacement",
        ),
        ({"force": [0.0, 0.0, 1.0]}, "rigid.ram.force: [0.0, 0.0, 1.0] is in space"),
    ],
)
def test_a_push_is_refused(ram, words):
    scene = pressed(2)
    scene["rigid"][0] |= ram
    assert_refused(scene, words)


def test_the_published_iteration_refuses_it():
    scene = pressed(2) | {"method": {"outer": "relaxation"}}
    with pytest.raises(
        ddmpi.errors.InputError, match="is for two supported bodies with one unilateral contact"
    ):
        ddmpi.solve(scene, MPI.COMM_SELF)
