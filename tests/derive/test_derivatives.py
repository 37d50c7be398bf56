"""Derivatives against central differences of fresh answers, and what is refused."""

import tomllib
from types import SimpleNamespace

import bolts
import numpy as np
import pytest
from differences import TIGHT, changed, difference, plain, results, ring, rubbed, vice, with_derivatives
from mpi4py import MPI
from scenes import COULOMB, FLOOR, ROOT, pinched_blocks, rectangle, tower
from solid_scenes import two_boxes

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.errors import InputError
from ddmpi.methods.outer import no_report
from ddmpi.results.checkpoint import read, write
from ddmpi.run.gather import StepLog
from ddmpi.run.solve import Iteration
from ddmpi.run.steps import March
from ddmpi.scene.reader import read_scene
from ddmpi.system.clock import Clock

CLOSE = 1e-5
"""Central differences of answers to 1e-12 are as precise."""


def check(scene: dict, keys: list[str], sizes: dict[str, float] | None = None, close: float = CLOSE):
    """The answer with derivatives, once these are those of differences."""
    answer = ddmpi.solve(with_derivatives(scene, keys), overrides=TIGHT)
    assert answer.certified, answer.reason
    entries = answer.summary["derivatives"]
    assert list(entries) == keys and not any("derivatives" in warning for warning in answer.summary["warnings"])
    for key in keys:
        worst, name = difference(scene, key, entries[key], size=(sizes or {}).get(key))
        assert worst < close, f"{key}: {name} differs by {worst:.1e}"
    return answer


def test_blocks_with_coulomb_friction():
    """Loads, moduli, clamps and friction of supported bodies, as numbers and as factors."""
    scene = pinched_blocks(4)
    scene["body"][1]["clamp"] = [{"on": "left", "x": 2e-5, "y": 0.0}]
    check(scene, ["contact.upper-lower.friction.coefficient", "body.upper.traction.0", "body.upper.traction.1.value.0",
                  "body.upper.material.young", "body.lower.clamp.0", "body.lower.clamp.0.x",
                  "body.lower.volume_force.1"], {"body.lower.volume_force.1": 1e6, "body.lower.clamp.0.x": 1e-4})


@pytest.mark.slow
def test_blocks_that_do_not_match_with_profiles():
    """Mortar, a given gap, and factors on profiles of a slip bound and of friction."""
    bound = {"law": "tresca", "slip_bound": {"along": "x", "points": [0.0, 3.0], "values": [8e6, 1.5e7]}}
    coefficient = {"law": "coulomb", "coefficient": {"along": "x", "points": [0.0, 3.0], "values": [0.1, 0.5]}}
    for friction, key in (bound, "slip_bound"), (coefficient, "coefficient"):
        scene = pinched_blocks(4)
        scene["body"][1]["mesh"]["divisions"] = [9, 3]
        scene["contact"][0] |= {"friction": friction, "gap": "1e-6 + 1e-6 * x"}
        check(scene, [f"contact.upper-lower.friction.{key}", "contact.upper-lower.gap"])


def test_a_number_of_a_slip_bound_and_of_a_gap():
    """A gap of zero is a number, too."""
    scene = pinched_blocks(4, "tresca")
    scene["contact"][0]["gap"] = 0.0
    check(scene, ["contact.upper-lower.friction.slip_bound", "contact.upper-lower.gap"],
          {"contact.upper-lower.gap": 1e-6})


@pytest.mark.slow
def test_a_loose_body_between_rigid_partners():
    """Motions of a loose body and of a pushed partner follow, by displacement and by force."""
    answer = check(vice(), ["rigid.ram.force", "rigid.ram.force.0", "rigid.fixed.displacement",
                            "rigid.fixed.displacement.1", "body.part.traction.0", "body.part.volume_force.1",
                            "contact.part-fixed.friction.coefficient", "contact.part-ram.friction.coefficient"],
                   {"rigid.fixed.displacement.1": 1e-3, "body.part.volume_force.1": 1e-2})
    entry = answer.derivative("rigid.fixed.displacement")  # all follow the plane that moves by itself
    assert entry.rigid.ram.displacement == pytest.approx([1e-3, 0.0], rel=1e-6)
    assert np.allclose(entry.bodies.part.displacement, [1e-3, 0.0], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_loose_blocks_on_each_other():
    """A tower of loose blocks: factors on friction and loads."""
    check(tower(3, 2), ["contact.block2-block1.friction.coefficient", "body.block3.traction.0",
                        "body.block2.material.young"])


@pytest.mark.slow
def test_around_an_axis_with_heat():
    """A heated ring that is shrunk onto a shaft: temperature, interference, moduli of parts."""
    scene = ring()
    check(scene, ["contact.fit.gap", "body.ring.temperature", "body.ring.material.young", "body.ring.traction.0",
                  "contact.fit.friction.coefficient"])


def test_parts_of_a_body():
    """Moduli of one part: a wheel and its lining."""
    scene = tomllib.loads((ROOT / "configs" / "lined_wheel.toml").read_text(encoding="utf-8"))
    scene["body"][0]["mesh"]["file"] = str(ROOT / "meshes" / "lined_wheel.msh")
    keys, name = ["body.wheel.material.0.young", "body.wheel.material.1.young"], "contacts.wheel-ground.pressure_max"
    answer = ddmpi.solve(with_derivatives(scene, keys), overrides=TIGHT)
    for key in keys:  # by symmetry the other results hardly change
        _, young = changed(plain(scene), key, None)
        below, above = (results(ddmpi.solve(changed(plain(scene), key, by)[0], overrides=TIGHT).summary)
                        for by in (-1e-3 * young, 1e-3 * young))
        found = answer.derivative(key).contacts["wheel-ground"].pressure_max
        assert found == pytest.approx((above[name] - below[name]) / (2e-3 * young), rel=CLOSE)


def test_boxes_in_space():
    """Friction that turns."""
    scene = two_boxes(2, law=COULOMB)
    check(scene, ["contact.upper-lower.friction.coefficient", "body.upper.traction.0", "body.upper.material.young",
                  "body.lower.material.young"])


def test_load_steps_are_chained():
    """Where slip begins depends on the steps before; at the ends of legs too."""
    answer = check(rubbed(steps=2), ["contact.fit.friction.coefficient", "contact.fit.gap", "body.pad.clamp.0",
                                     "body.pad.clamp.1", "body.base.material.young"])
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
    assert ddmpi.solve(with_derivatives(alone, [key]), overrides=TIGHT).derivative(key).until == pytest.approx(ends[0])


def test_a_pretension_that_is_kept():
    """A bolt keeps its offset once it is tightened, and this its derivative; the force in it then follows the load."""
    scene = bolts.joint(n=2)
    scene["time"]["points"] = [1.0, 2.0]
    check(scene, ["contact.cut.pretension.force", "body.sleeve.material.young", "rigid.head.force"])


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
        (one, arrays), (other, more) = ((march.log.derived[0][key], march.log.derived[1][key])
                                        for march in (whole, again))
        assert other["contacts"]["fit"]["dissipated"] == pytest.approx(one["contacts"]["fit"]["dissipated"], rel=1e-6)
        size = np.abs(arrays.contacts.fit.pressure).max()
        assert more.contacts.fit.pressure == pytest.approx(arrays.contacts.fit.pressure, rel=1e-6, abs=1e-6 * size)
        assert other["until"] == pytest.approx(one["until"], rel=1e-6)


def test_a_gap_with_a_history():
    """An interference that grows is there from the first step on."""
    scene = rubbed(steps=1)
    scene["contact"][0]["gap"] = {"value": -1e-3, "history": "press"}
    check(scene, ["contact.fit.gap", "contact.fit.friction.coefficient"])


def test_both_sides_of_a_change_of_status():
    """At a number at which a node begins to slip, `until` ends there, and the derivative is that of its side."""
    scene, key = pinched_blocks(4), "contact.upper-lower.friction.coefficient"
    scene["contact"][0]["friction"]["coefficient"] = 0.3
    entry = ddmpi.solve(with_derivatives(scene, [key]), overrides=TIGHT).derivative(key)
    for _ in range(4):  # the forecast is linear, so that it is repeated
        scene["contact"][0]["friction"]["coefficient"] = edge = entry.until[1]
        entry = ddmpi.solve(with_derivatives(scene, [key]), overrides=TIGHT).derivative(key)
    assert min(abs(end - edge) for end in entry.until) < 1e-7 * edge < 1e-3 * (entry.until[1] - entry.until[0])
    worst, name = difference(scene, key, entry, step=1e-3)
    assert worst < CLOSE, name


@pytest.mark.parametrize("key, words", [
    ("contact.uper-lower.friction.coefficient", "nearest ones are contact.upper-lower.friction.coefficient, "),
    ("contact.upper-lower.friction.slip_bound", "nearest ones are contact.upper-lower.friction.coefficient, "),
    ("body.upper.traction.7", "nearest ones are body.upper.traction."), ("", "nearest ones are")])
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
        ddmpi.solve(scene | {"method": {"max_iterations": 1}, "output": {"derivatives": [key]}}).derivative(key)
    scene["body"][0]["clamp"] = [{"on": on, "x": 1e-5, "y": 0.0} for on in ("left", "right")]
    scene["body"][0]["clamp"][1]["on"] = "left"
    with pytest.raises(InputError, match=r"output.derivatives: body.upper.clamp.0: .* is prescribed twice"):
        ddmpi.solve(scene | {"output": {"derivatives": ["body.upper.clamp.0"]}})


@pytest.mark.mpi(ranks=3)
def test_any_number_of_ranks(comm):
    """One, two and three ranks give the same; bodies may have several ranks each."""
    for scene, keys in (pinched_blocks(4), ["contact.upper-lower.friction.coefficient", "body.lower.material.young"]), (
            tower(3, 2), ["contact.block2-block1.friction.coefficient", "body.block3.traction.0"]), (
            two_boxes(2, law=COULOMB), ["contact.upper-lower.friction.coefficient", "body.lower.material.young"]):
        scene = with_derivatives(scene, keys)
        alone, together = (ddmpi.solve(scene, world, TIGHT) for world in (comm.Split(comm.rank), comm))
        for key in keys:
            one, all_of_them = alone.derivative(key), together.derivative(key)
            for name, contact in one.contacts.items():
                other, size = all_of_them.contacts[name], np.abs(contact.normal_forces).max()
                assert np.allclose(other.normal_forces, contact.normal_forces, rtol=0.0, atol=1e-6 * size)
                assert np.allclose(other.force, contact.force, rtol=0.0, atol=1e-6 * size)
            assert all(end == other or end == pytest.approx(other, rel=1e-6, abs=1e-6)
                       for end, other in zip(all_of_them.until, one.until, strict=True))
            assert all(all_of_them.bodies[name].reaction == pytest.approx(body.reaction, rel=1e-6, abs=1e-6 * size)
                       for name, body in one.bodies.items())


def test_a_loose_body_that_nothing_holds_along_the_floor_has_no_derivative():
    """Without friction a sideways force has no answer, and its derivative none that could be told."""
    body = rectangle("block", (0, 0), (2, 1), (4, 2), traction=[{"on": "top", "value": [0.0, -1e5]}])
    scene = {"body": [body], "rigid": [FLOOR], "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}]}
    keys = ["body.block.traction.0", "body.block.traction.0.value.0"]
    answer = ddmpi.solve(with_derivatives(scene, keys))
    assert answer.derivative(keys[0]).contacts["block-floor"].normal_force == pytest.approx(2e5, rel=1e-6)
    assert answer.derivative(keys[1]) is None and answer.summary["derivatives"][keys[1]] is None
    assert any(f"derivatives.{keys[1]}: not given" in warning for warning in answer.summary["warnings"])
