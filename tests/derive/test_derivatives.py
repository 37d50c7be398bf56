"""Derivatives against central differences of fresh answers, gradients against derivatives; what is refused."""

import tomllib
from collections.abc import Sequence
from types import SimpleNamespace

import bolts
import numpy as np
import pytest
from differences import (
    TIGHT,
    changed,
    difference,
    nulls,
    plain,
    results,
    ring,
    rubbed,
    vice,
    with_derivatives,
)
from mpi4py import MPI
from scenes import COULOMB, FLOOR, ROOT, pinched_blocks, rectangle, seldom, tower
from solid_scenes import two_boxes

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.errors import InputError, SolverError
from ddmpi.methods.outer import no_report
from ddmpi.results.checkpoint import read, write
from ddmpi.run.gather import StepLog
from ddmpi.run.solve import Iteration
from ddmpi.run.steps import March
from ddmpi.scene.derivable import derivable
from ddmpi.scene.reader import read_scene
from ddmpi.system.clock import Clock

CLOSE, SAME = 1e-5, 1e-8
"""Central differences of answers to 1e-12 are as precise; gradients and derivatives are solved to 1e-10."""


def check(
    scene: dict, sizes: dict[str, float | None], gradients: Sequence[str] = (), close: float = CLOSE
):
    """The answer with derivatives, once these are those of differences, and gradients those of the derivatives by all
    keys; `sizes` of the numbers that are zero."""
    # An axis cannot move, so there is no derivative by its clamp.
    every = [key for key in derivable(plain(scene)) if key != "body.shaft.clamp.0.x"]
    answer = ddmpi.solve(with_derivatives(scene, every if gradients else [*sizes]), overrides=TIGHT)
    assert answer.certified, answer.reason
    entries = answer.summary["derivatives"]
    assert entries.keys() >= sizes.keys()
    assert not any("derivatives" in warning for warning in answer.summary["warnings"])
    for key, size in sizes.items():
        worst, name = difference(scene, key, entries[key], size=size)
        assert worst < close, f"{key}: {name} differs by {worst:.1e}"
    for result in gradients:
        same_gradient(answer, result)
    return answer


def entry_of(summary, result):
    """The number of a result in an entry of ``derivatives``."""
    for name in result.split("."):
        summary = summary["xyz".index(name)] if name in "xyz" else summary[name]
    return summary


def same_gradient(answer, result: str) -> None:
    """The gradient of a result has the derivatives by all keys, which the answer has."""
    gradient = answer.gradient(result)
    assert gradient.keys() >= {*answer.summary["derivatives"], "gap"}
    size = abs(entry_of(answer.summary, result)) or 1.0
    for key, entry in answer.summary["derivatives"].items():
        # derivatives that are zero are rounding of those of the parts of a result
        assert gradient[key] == pytest.approx(entry_of(entry, result), rel=SAME, abs=1e-8 * size), (
            f"{result} by {key}"
        )


def blocks(law: str = "coulomb", **contact) -> dict:
    """Blocks whose lower one is moved by a clamp."""
    scene = pinched_blocks(4, law)
    scene["body"][1]["clamp"] = [{"on": "left", "x": 2e-5, "y": 0.0}]
    scene["contact"][0] |= contact
    return scene


def skew() -> dict:
    """Blocks whose lower one is held along two directions, one of which changes from node to node."""
    scene = blocks()
    scene["body"][1]["clamp"] = [
        {"on": "left", "along": [3.0, 4.0], "value": -1e-5},
        {"on": "left", "along": ["0.8", "-0.6 - 0.1*y"], "value": 0.0},
    ]
    return scene


SOFT = {"pressure": [0.0, 1e7, 4e7, 1e9], "closure": [0.0, 1e-4, 1.5e-4, 1.6e-4]}


def profile(law: str, key: str, *values: float) -> dict:
    """Blocks that do not match, with a given gap, and friction that changes along them."""
    scene = blocks(
        gap="1e-6 + 1e-6 * x",
        friction={"law": law, key: {"along": "x", "points": [0.0, 3.0], "values": [*values]}},
    )
    scene["body"][1] |= {
        "clamp": pinched_blocks(4)["body"][1]["clamp"],
        "mesh": scene["body"][1]["mesh"] | {"divisions": [9, 3]},
    }
    return scene


PAIR, FIT = "contact.upper-lower", "contact.fit"
CASES = {
    # name: scene, keys whose derivatives are compared with differences, and results whose gradients are with these
    "supported blocks": (
        blocks(gap=0.0),
        {
            f"{PAIR}.friction.coefficient": None,
            "body.upper.traction.0": None,
            "body.upper.traction.1.value.0": None,
            "body.upper.material.young": None,
            "body.lower.clamp.0": None,
            "body.lower.clamp.0.x": 1e-4,
            "body.lower.volume_force.1": 1e6,
        },
        [
            *(
                f"contacts.upper-lower.{name}"
                for name in (
                    "normal_force",
                    "force.x",
                    "tangential_force",
                    "moment",
                    "pressure_max",
                    "dissipated",
                )
            ),
            "bodies.upper.reaction.x",
            "bodies.lower.reaction.y",
        ],
    ),
    "a profile of a slip bound": (
        profile("tresca", "slip_bound", 8e6, 1.5e7),
        {f"{PAIR}.friction.slip_bound": None, f"{PAIR}.gap": None},
        [],
    ),
    "a profile of friction": (
        profile("coulomb", "coefficient", 0.1, 0.5),
        {f"{PAIR}.friction.coefficient": None, f"{PAIR}.gap": None},
        [],
    ),
    # the bound also weighs what was dissipated at first; a gap of zero is a number, too
    "a slip bound": (
        blocks("tresca", gap=0.0),
        {f"{PAIR}.friction.slip_bound": None, f"{PAIR}.gap": 1e-6},
        ["contacts.upper-lower.tangential_force", "contacts.upper-lower.dissipated"],
    ),
    # the slope of the joint's law is that at each node
    "a soft joint": (
        blocks(softness=SOFT, gap=-1e-6),
        {
            "body.upper.traction.0": None,
            f"{PAIR}.gap": None,
            f"{PAIR}.friction.coefficient": None,
            "body.lower.material.young": None,
        },
        ["contacts.upper-lower.pressure_max", "contacts.upper-lower.dissipated"],
    ),
    "clamps along directions": (
        skew(),
        {
            "body.lower.clamp.0": None,
            "body.lower.clamp.0.value": None,
            "body.lower.clamp.1.value": 1e-5,
        },
        [],
    ),
    # motions of a loose body and of a pushed partner follow, by displacement and by force
    "a loose body": (
        vice(),
        {
            "rigid.ram.force": None,
            "rigid.ram.force.0": None,
            "rigid.fixed.displacement": None,
            "rigid.fixed.displacement.1": 1e-3,
            "body.part.traction.0": None,
            "body.part.volume_force.1": 1e-2,
            "contact.part-fixed.friction.coefficient": None,
            "contact.part-ram.friction.coefficient": None,
        },
        [
            "rigid.ram.displacement.x",
            "rigid.fixed.displacement.y",
            "rigid.ram.force.y",
            "contacts.part-fixed.tangential_force",
            "contacts.part-ram.dissipated",
        ],
    ),
    "loose blocks on each other": (
        tower(3, 2),
        {
            "contact.block2-block1.friction.coefficient": None,
            "body.block3.traction.0": None,
            "body.block2.material.young": None,
        },
        [],
    ),
    # the axial reaction follows from equilibrium
    "around an axis with heat": (
        ring(),
        {
            f"{FIT}.gap": None,
            "body.ring.temperature": None,
            "body.ring.material.young": None,
            "body.ring.traction.0": None,
            f"{FIT}.friction.coefficient": None,
        },
        ["bodies.shaft.reaction.y", "contacts.fit.normal_force"],
    ),
    # friction that turns
    "boxes": (
        two_boxes(2, law=COULOMB),
        {
            f"{PAIR}.friction.coefficient": None,
            "body.upper.traction.0": None,
            "body.upper.material.young": None,
            "body.lower.material.young": None,
        },
        [
            "contacts.upper-lower.moment.x",
            "contacts.upper-lower.tangential_force",
            "contacts.upper-lower.dissipated",
            "bodies.upper.reaction.z",
        ],
    ),
    # an interference that grows is there from the first step on
    "a gap with a history": (
        rubbed(steps=1),
        {f"{FIT}.gap": None, f"{FIT}.friction.coefficient": None},
        [],
    ),
    # a bolt keeps its offset once it is tightened, and this its derivative; the force in it then follows the load
    "a pretension that is kept": (
        bolts.joint(n=2),
        {
            "contact.cut.pretension.force": None,
            "body.sleeve.material.young": None,
            "rigid.head.force": None,
        },
        [],
    ),
}
SLOW = (
    "a gap with a history",
    "a loose body",
    "loose blocks on each other",
    "around an axis with heat",
    "a profile of friction",
    "boxes",
    "a pretension that is kept",
    "supported blocks",
    "a slip bound",
    "clamps along directions",
)
CASES["a gap with a history"][0]["contact"][0]["gap"] = {"value": -1e-3, "history": "press"}
CASES["a pretension that is kept"][0]["time"]["points"] = [1.0, 2.0]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in CASES]
)
def test_derivatives_are_those_of_differences(name):
    """And gradients, by one solve of the transposed equations, are derivatives by all keys."""
    check(*CASES[name])


def test_motions_that_follow_a_partner():
    """All that is loose follows the plane that moves by itself."""
    key = "rigid.fixed.displacement"
    entry = ddmpi.solve(with_derivatives(vice(), [key]), overrides=TIGHT).derivative(key)
    assert entry.rigid.ram.displacement == pytest.approx([1e-3, 0.0], rel=1e-6)
    assert np.allclose(entry.bodies.part.displacement, [1e-3, 0.0], rtol=1e-6, atol=1e-9)


def test_a_gradient_by_the_gap_at_every_node():
    """Its sum is the derivative by the gap as a number; open nodes do not count."""
    answer = ddmpi.solve(blocks(gap=0.0), overrides=TIGHT)
    gradient = answer.gradient("contacts.upper-lower.normal_force")
    nodes = gradient.gap["upper-lower"]
    assert nodes.shape == answer.contacts["upper-lower"].gap.shape
    assert nodes.sum() == pytest.approx(gradient["contact.upper-lower.gap"], rel=1e-9)
    closed = answer.contacts["upper-lower"].status != "open"
    assert np.abs(nodes[closed]).min() > 0.0 and not nodes[~closed].any()


def corner() -> dict:
    """A block in a groove of two rigid planes: it sticks and slips on both, and they share its lowest node."""
    turn = np.deg2rad(58.32)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    corners = [0.0 * along, along, along + 1.25 * across, 1.25 * across]
    block = rectangle("v", (0.0, 0.0), (1.0, 1.25), (5, 4)) | {
        "mesh": {
            "shape": "quadrilateral",
            "corners": [corner.tolist() for corner in corners],
            "divisions": [5, 4],
        },
        "volume_force": [-1844.5, -1e5],
    }
    planes = [
        FLOOR | {"name": name, "point": [0.0, 0.0], "normal": normal.tolist()}
        for name, normal in (("p0", across), ("p1", along))
    ]
    contacts = [
        {
            "name": f"c{k}",
            "bodies": ["v", f"p{k}"],
            "on": [on],
            "friction": COULOMB | {"coefficient": friction},
        }
        for k, (on, friction) in enumerate((("bottom", 0.196), ("left", 0.243)))
    ]
    return {"body": [block], "rigid": planes, "contact": contacts}


def test_forces_that_contacts_share_at_a_node_have_no_derivatives():
    """What depends on how contacts share the force at a node is null, with a warning; all else is as of differences."""
    key = "body.v.volume_force.1"
    answer = ddmpi.solve(with_derivatives(corner(), [key]), overrides=TIGHT)
    entry = answer.summary["derivatives"][key]
    assert sum("contacts share the force" in warning for warning in answer.summary["warnings"]) == 1
    lost = {*nulls(entry["contacts"])}
    assert {"c0.normal_force", "c1.normal_force"} <= lost
    assert not lost & {"c0.moment", "c0.pressure_max", "c0.dissipated"}
    assert difference(corner(), key, entry)[0] < CLOSE
    assert np.isnan(answer.derivative(key).contacts.c0.normal_forces).sum() == 1
    with pytest.raises(SolverError, match="only the sum is determined"):
        answer.gradient("contacts.c0.normal_force")


def test_a_node_that_sticks_to_two_partners_follows_neither():
    """A partner that moves alone would tear the node that it shares: derivative and gradient say that there is none."""
    key = "rigid.p0.displacement.0"
    answer = ddmpi.solve(with_derivatives(corner(), [key]), overrides=TIGHT)
    assert answer.summary["derivatives"][key] is None
    gradient = answer.gradient("contacts.c0.moment")
    assert gradient[key] is None and np.isfinite(gradient["body.v.volume_force.1"])


@pytest.mark.parametrize("part", [0, seldom(1)])
def test_parts_of_a_body(part):
    """Moduli of one part: a wheel and its lining."""
    scene = tomllib.loads((ROOT / "configs" / "lined_wheel.toml").read_text(encoding="utf-8"))
    scene["body"][0]["mesh"]["file"] = str(ROOT / "meshes" / "lined_wheel.msh")
    keys, name = (
        ["body.wheel.material.0.young", "body.wheel.material.1.young"],
        "contacts.wheel-ground.pressure_max",
    )
    answer = ddmpi.solve(with_derivatives(scene, keys), overrides=TIGHT)
    # by symmetry the other results hardly change
    _, young = changed(plain(scene), keys[part], None)
    below, above = (
        results(ddmpi.solve(changed(plain(scene), keys[part], by)[0], overrides=TIGHT).summary)
        for by in (-1e-3 * young, 1e-3 * young)
    )
    found = answer.derivative(keys[part]).contacts["wheel-ground"].pressure_max
    assert found == pytest.approx((above[name] - below[name]) / (2e-3 * young), rel=CLOSE)


def test_a_block_grows_with_its_temperature():
    """Free to grow from a corner, by α L a kelvin along each side."""
    young, alpha, size = 2.1e11, 1.3e-5, (0.3, 0.4)
    block = rectangle("block", (0.0, 0.0), size, (2, 2), young=young)
    block["material"] |= {"expansion": alpha, "plane": "stress"}
    block |= {"temperature": 40.0, "clamp": [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}]}
    key = "body.block.temperature"
    answer = ddmpi.solve(with_derivatives({"body": [block]}, [key]), overrides=TIGHT)
    found = answer.derivative(key).bodies["block"]
    expected = alpha * answer.bodies["block"].points
    assert found.displacement == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    "keys",
    [
        (f"{FIT}.friction.coefficient", f"{FIT}.gap", "body.base.material.young"),
        seldom(("body.pad.clamp.0", "body.pad.clamp.1")),
    ],
)
def test_load_steps_are_chained(keys):
    """Where slip begins depends on the steps before; at the ends of legs too."""
    answer = check(rubbed(steps=2), dict.fromkeys(keys))
    steps = answer.summary["steps"]
    assert ["derivatives" in step for step in steps] == [False, True] * 3
    assert steps[-1]["derivatives"] == answer.summary["derivatives"]


def test_until_is_that_of_all_steps():
    """A status that changes in an early step changes the answer, whatever the last step does."""
    scene, key = rubbed(steps=1), "contact.fit.friction.coefficient"
    answer = ddmpi.solve(with_derivatives(scene, [key]), overrides=TIGHT)
    ends = np.array([step["derivatives"][key]["until"] for step in answer.summary["steps"]], float)
    assert (np.diff(ends[:, 0]) >= 0.0).all() and (np.diff(ends[:, 1]) <= 0.0).all()
    alone = scene | {"time": {"points": [1.0], "steps": 1}}
    assert ddmpi.solve(with_derivatives(alone, [key]), overrides=TIGHT).derivative(
        key
    ).until == pytest.approx(ends[0])


def test_a_march_goes_on_from_a_checkpoint(tmp_path):
    """Derivatives go on with those of the steps before, as they come out of a file."""
    keys = ["contact.fit.friction.coefficient", "contact.fit.gap"]
    scene = read_scene("scene", with_derivatives(rubbed(steps=2), keys))

    def begin() -> March:
        assembly = prepare(MPI.COMM_SELF, scene)
        assembly.act(scene.legs[0])
        return March(assembly, Iteration(assembly, scene.method, no_report, Clock()), StepLog())

    whole, states = begin(), []
    whole.run(SimpleNamespace(note=lambda _: states.append(whole.state())))
    assert len(states) == 5
    write(tmp_path / "state", {}, [states[2]])
    again = begin()
    again.restore(read(tmp_path / "state")[1][0])
    again.run()
    for key in keys:
        (one, arrays), (other, more) = (
            (march.log.derived[0][key], march.log.derived[1][key]) for march in (whole, again)
        )
        assert other["contacts"]["fit"]["dissipated"] == pytest.approx(
            one["contacts"]["fit"]["dissipated"], rel=1e-6
        )
        size = np.abs(arrays.contacts.fit.pressure).max()
        assert more.contacts.fit.pressure == pytest.approx(
            arrays.contacts.fit.pressure, rel=1e-6, abs=1e-6 * size
        )
        assert other["until"] == pytest.approx(one["until"], rel=1e-6)


@pytest.mark.slow
def test_both_sides_of_a_change_of_status():
    """At a number at which a node begins to slip, `until` ends there, and the derivative is that of its side."""
    scene, key = pinched_blocks(4), "contact.upper-lower.friction.coefficient"
    scene["contact"][0]["friction"]["coefficient"] = 0.3
    entry = ddmpi.solve(with_derivatives(scene, [key]), overrides=TIGHT).derivative(key)
    for _ in range(4):  # the forecast is linear, so that it is repeated
        scene["contact"][0]["friction"]["coefficient"] = edge = entry.until[1]
        entry = ddmpi.solve(with_derivatives(scene, [key]), overrides=TIGHT).derivative(key)
    assert (
        min(abs(end - edge) for end in entry.until)
        < 1e-7 * edge
        < 1e-3 * (entry.until[1] - entry.until[0])
    )
    worst, name = difference(scene, key, entry, step=1e-3)
    assert worst < CLOSE, name


@pytest.mark.parametrize(
    "key, words",
    [
        (
            "contact.uper-lower.friction.coefficient",
            "nearest ones are contact.upper-lower.friction.coefficient, ",
        ),
        (
            "contact.upper-lower.friction.slip_bound",
            "nearest ones are contact.upper-lower.friction.coefficient, ",
        ),
        ("body.upper.traction.7", "nearest ones are body.upper.traction."),
        ("", "nearest ones are"),
    ],
)
def test_a_key_that_names_nothing_is_refused(key, words):
    """Before any work, with the nearest valid keys."""
    with pytest.raises(InputError, match=r"output.derivatives: .* is no number.*") as caught:
        ddmpi.solve(pinched_blocks(100) | {"output": {"derivatives": [key]}})
    assert words in str(caught.value)


def test_what_else_is_refused():
    """Other methods, a key that stands there twice, a clamp that cannot move alone, keys not asked for."""
    key, scene = "contact.upper-lower.friction.coefficient", pinched_blocks(2)
    with pytest.raises(InputError, match='need outer = "newton"'):
        ddmpi.solve(scene | {"method": {"outer": "anderson"}, "output": {"derivatives": [key]}})
    with pytest.raises(InputError, match="stands there 2 times"):
        ddmpi.solve(scene | {"output": {"derivatives": [key, key]}})
    answer = ddmpi.solve(scene | {"output": {"derivatives": [key]}})
    with pytest.raises(InputError, match="does not name it; did you mean"):
        answer.derivative(key + "s")
    with pytest.raises(InputError, match="only a certified answer has derivatives"):
        ddmpi.solve(
            scene | {"method": {"max_iterations": 1}, "output": {"derivatives": [key]}}
        ).derivative(key)
    scene["body"][0]["clamp"] = [{"on": on, "x": 1e-5, "y": 0.0} for on in ("left", "right")]
    scene["body"][0]["clamp"][1]["on"] = "left"
    with pytest.raises(
        InputError, match=r"output.derivatives: body.upper.clamp.0: .* is prescribed twice"
    ):
        ddmpi.solve(scene | {"output": {"derivatives": ["body.upper.clamp.0"]}})


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
def test_any_number_of_ranks(comm):
    """One, two and three ranks give the same; bodies may have several ranks each."""
    for scene, keys in (
        (
            pinched_blocks(4),
            ["contact.upper-lower.friction.coefficient", "body.lower.material.young"],
        ),
        (tower(3, 2), ["contact.block2-block1.friction.coefficient", "body.block3.traction.0"]),
        (
            two_boxes(2, law=COULOMB),
            ["contact.upper-lower.friction.coefficient", "body.lower.material.young"],
        ),
    ):
        scene = with_derivatives(scene, keys)
        alone, together = (
            ddmpi.solve(scene, world, TIGHT) for world in (comm.Split(comm.rank), comm)
        )
        for key in keys:
            one, all_of_them = alone.derivative(key), together.derivative(key)
            for name, contact in one.contacts.items():
                other, size = all_of_them.contacts[name], np.abs(contact.normal_forces).max()
                assert np.allclose(
                    other.normal_forces, contact.normal_forces, rtol=0.0, atol=1e-6 * size
                )
                assert np.allclose(other.force, contact.force, rtol=0.0, atol=1e-6 * size)
            assert all(
                end == other or end == pytest.approx(other, rel=1e-6, abs=1e-6)
                for end, other in zip(all_of_them.until, one.until, strict=True)
            )
            assert all(
                all_of_them.bodies[name].reaction
                == pytest.approx(body.reaction, rel=1e-6, abs=1e-6 * size)
                for name, body in one.bodies.items()
            )


def test_a_loose_body_that_nothing_holds_along_the_floor_has_no_derivative():
    """Without friction a sideways force has no answer, and its derivative none that could be told."""
    body = rectangle(
        "block", (0, 0), (2, 1), (4, 2), traction=[{"on": "top", "value": [0.0, -1e5]}]
    )
    scene = {
        "body": [body],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}],
    }
    keys = ["body.block.traction.0", "body.block.traction.0.value.0"]
    answer = ddmpi.solve(with_derivatives(scene, keys))
    assert answer.derivative(keys[0]).contacts["block-floor"].normal_force == pytest.approx(
        2e5, rel=1e-6
    )
    assert answer.derivative(keys[1]) is None and answer.summary["derivatives"][keys[1]] is None
    assert any(
        f"derivatives.{keys[1]}: not given, because" in warning
        for warning in answer.summary["warnings"]
    )


# Gradients


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize(
    ("scene", "keys", "contact"),
    [
        (
            pinched_blocks(4),
            ["contact.upper-lower.friction.coefficient", "body.lower.traction.0"],
            "upper-lower",
        ),
        seldom(
            tower(3, 2), ["body.block3.traction.0", "body.block2.volume_force.1"], "block2-block1"
        ),
    ],
    ids=["held", "loose"],
)
def test_gradients_on_two_ranks(comm, scene, keys, contact):
    """There GMRES solves, and all ranks have the same gradient; some nodes slip, so that the system is unsymmetric."""
    answer = ddmpi.solve(with_derivatives(scene, keys), comm, TIGHT)
    same_gradient(answer, f"contacts.{contact}.force.x")
    nodes = answer.gradient(f"contacts.{contact}.normal_force").gap[contact]
    assert np.array_equal(nodes, comm.bcast(nodes))


@pytest.mark.parametrize(
    "result, words",
    [
        ("contacts.upper-lower.force", "no such result; did you mean 'contacts.upper-lower.force."),
        ("contacts.upper-lower.normal_forces", "did you mean 'contacts.upper-lower.normal_force'"),
        ("bodies.uper.reaction.x", "did you mean 'bodies.upper.reaction.x'"),
        ("", "there is no such result"),
    ],
)
def test_a_result_that_there_is_not(result, words):
    """It is refused with the nearest one."""
    answer = ddmpi.solve(pinched_blocks(2))
    with pytest.raises(InputError) as caught:
        answer.gradient(result)
    assert words in str(caught.value)


@pytest.mark.slow
def test_what_has_no_gradient():
    """Load steps, answers without a certificate, and the radial sum of reactions around an axis."""
    with pytest.raises(InputError, match="not possible with load steps"):
        ddmpi.solve(rubbed(steps=1)).gradient("contacts.fit.normal_force")
    with pytest.raises(InputError, match="needs a certified answer"):
        ddmpi.solve(pinched_blocks(4, max_iterations=1)).gradient(
            "contacts.upper-lower.normal_force"
        )
    with pytest.raises(InputError, match="radial reactions"):
        ddmpi.solve(ring()).gradient("bodies.shaft.reaction.x")
