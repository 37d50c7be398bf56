"""Load steps without displacements: the same answers, energies and statuses as with those of every step."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import COULOMB, FLOOR, certified, pinched_blocks, rectangle, seldom
from solid_scenes import box

from ddmpi.coupling.member import Member
from ddmpi.run.steps import March

TRESCA = {"law": "tresca", "slip_bound": 1.0e6}


def heated() -> dict:
    """Blocks whose loads, clamps and heat follow one history, on springs, with unlike meshes."""
    scene = pinched_blocks(2)
    upper, lower = scene["body"]
    upper["mesh"]["divisions"] = [5, 3]
    upper |= {
        "temperature": {"value": 30.0, "history": "press"},
        "foundation": [{"on": "top", "normal": 1e12}],
    }
    upper["material"] = upper["material"] | {"expansion": 1e-5}
    upper["clamp"] = [{"on": "left", "x": 1e-4, "y": 0.0, "history": "press"}]
    for body in (upper, lower):
        for load in body["traction"]:
            load["history"] = "press"
    lower["traction"].append({"on": "right", "value": [1e6, 0.0], "history": "pull"})
    return scene


def loose(make=rectangle, **keys) -> dict:
    """A loose block upon a loose one upon a floor without friction, pressed and pushed aside."""
    d = 2 if make is rectangle else 3
    up, unit = np.eye(d)[-1], (1.0,) * d
    loads = [
        {"on": "top", "value": (-1e6 * up).tolist(), "history": "press"},
        {"on": "right", "value": (-1e5 * np.eye(d)[0]).tolist(), "history": "pull"},
    ]
    stop = {"name": "wall", "shape": "plane", "point": [0.0] * d, "normal": np.eye(d)[0].tolist()}
    return {
        "body": [
            make("upper", tuple(up), unit, (2,) * d, traction=loads),
            make("lower", (0.0,) * d, unit, (3,) * d),
        ],
        "rigid": [FLOOR if d == 2 else FLOOR | {"point": [0.0] * d, "normal": up.tolist()}, stop],
        "contact": [
            {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": COULOMB},
            {"bodies": ["lower", "floor"], "on": ["bottom"]},
            {"bodies": ["lower", "wall"], "on": ["left"]},
        ],
    }


def turned() -> dict:
    """A ring that is pressed upon a disc, both around an axis, and pushed along it."""
    ring = rectangle(
        "ring",
        (1.0, 0.0),
        (0.5, 1.0),
        (2, 4),
        clamp=[{"on": "right", "x": -1e-4, "history": "press"}],
        traction=[{"on": "top", "value": [0.0, -1e4], "history": "pull"}],
    )
    disc = rectangle("disc", (0.0, -0.5), (1.0, 2.0), (3, 6), clamp=["bottom"])
    return {
        "axisymmetric": True,
        "body": [ring, disc],
        "contact": [
            {
                "bodies": ["ring", "disc"],
                "on": ["left", "right"],
                "friction": COULOMB,
                "gap": {"value": -1e-6, "history": "press"},
            }
        ],
    }


SCENES = {
    "heat, clamps, springs": heated,
    "loose": loose,
    "loose in space": lambda: loose(box),
    "axis": turned,
    "tresca": lambda: heated() | {"contact": [heated()["contact"][0] | {"friction": TRESCA}]},
}


def stepped(scene: dict, output: str, **time) -> dict:
    histories = {
        "press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
        "pull": {"times": [1.0, 2.0, 3.0], "factors": [0.1, 1.0, 0.4]},
    }
    return copy.deepcopy(scene) | {
        "history": histories,
        "time": {"points": [1.0, 2.0, 3.0]} | time,
        "output": {"steps": output, "figures": False},
    }


@pytest.mark.parametrize(
    "name",
    ["tresca", *map(seldom, ("loose", "axis", "heat, clamps, springs", "loose in space"))],
)
def test_steps_without_displacements_are_those_with_them(name):
    """Whether displacements are recovered at the ends of legs or in every step, all numbers are the same."""
    answers = [certified(stepped(SCENES[name](), output, steps=3)) for output in ("legs", "all")]
    (lean, whole), rows = (answer.summary for answer in answers), []
    for summary in (lean, whole):
        rows.append(
            np.array(
                [
                    [
                        *contact["force"],
                        contact["normal_force"],
                        contact["tangential_force"],
                        *(1e3 * contact[status] for status in ("open", "slip", "stick")),
                    ]
                    for step in summary["steps"]
                    for contact in step["contacts"].values()
                ]
            )
        )
    assert rows[0] == pytest.approx(rows[1], rel=1e-9, abs=1e-9 * np.abs(rows[1]).max())
    assert lean["energy"] == pytest.approx(
        whole["energy"], rel=1e-9, abs=1e-9 * abs(whole["energy"]["strain_energy"])
    )
    assert lean["energy"]["residual"] < 1e-11
    assert lean["warnings"] == whole["warnings"]
    ours, theirs = (np.array(each.solved.steps.energies) for each in answers)
    assert ours[:, :5] == pytest.approx(theirs[:, :5], rel=1e-9, abs=1e-10 * np.abs(theirs).max())
    assert any(body.member.C.count["certificate"] for body in answers[0].solved.assembly.bodies)
    for name, contact in answers[0].contacts.items():
        other = answers[1].contacts[name]
        for key in ("slip", "slip_total", "gap", "normal_force"):
            size = np.abs(getattr(other, key)).max()
            assert getattr(contact, key) == pytest.approx(
                getattr(other, key), rel=1e-6, abs=1e-7 * size + 1e-16
            ), key


def test_what_a_lean_certificate_doubts_is_judged_by_displacements(monkeypatch):
    """Wrong contact displacements of a lean step are not believed: its answer is looked at with all displacements."""
    at_contacts, displacement, seen = Member.at_contacts, Member.displacement, []

    def wrong(member, s, alpha):
        u, *others = at_contacts(member, s, alpha)
        return u + 1.0, *others

    monkeypatch.setattr(Member, "at_contacts", wrong)
    monkeypatch.setattr(
        Member,
        "displacement",
        lambda *what, **left: seen.append(what) or displacement(*what, **left),
    )
    scene = stepped(turned(), "legs", steps=2)
    answer = certified(scene)
    assert len(answer.summary["steps"]) == 6 and len(seen) > 12


def test_a_step_that_fails_is_halved_so_many_times():
    """Six times after the last success, whatever the shortest step that was planned."""
    march = object.__new__(March)
    march._cuts, march._shortest, march._ahead, march.iterations = 0, 1e-9, [], 0
    march._now, march.outer = SimpleNamespace(time=0.5), SimpleNamespace(history=[])
    failed = SimpleNamespace(
        mechanism=None, stopped="diverged", given=False, unbalanced=False, reason="diverged"
    )
    time, halved = 1.5, 0
    while halved < 20 and march._cut(failed, time):
        time, halved = march._ahead[0], halved + 1
    assert halved == 6 and time == 0.5 + 0.5**6
