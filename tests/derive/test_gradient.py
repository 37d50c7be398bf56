"""Gradients by one solve of the transposed equations against the derivatives by each key."""

import numpy as np
import pytest
from differences import TIGHT, ring, rubbed, vice, with_derivatives
from scenes import pinched_blocks, tower
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError
from ddmpi.scene.keys import derivable

CLOSE = 1e-8
"""Both are solved to 1e-10."""


def entry_of(summary, result):
    """The number of a result in an entry of ``derivatives``."""
    for name in result.split("."):
        summary = summary["xyz".index(name)] if name in "xyz" else summary[name]
    return summary


def compare(answer, results) -> None:
    """Every result's gradient with the derivatives by all keys, which the answer has."""
    for result in results:
        gradient = answer.gradient(result)
        assert gradient.keys() >= {*answer.summary["derivatives"], "gap"}
        size = abs(entry_of(answer.summary, result)) or 1.0
        for key, entry in answer.summary["derivatives"].items():
            direct = entry_of(entry, result)
            # derivatives that are zero are rounding of those of the parts of a result
            assert gradient[key] == pytest.approx(direct, rel=CLOSE, abs=1e-8 * size), f"{result} by {key}"


def with_all(scene, world=None):
    """The answer with derivatives by all keys, but for a clamp on an axis, which cannot move."""
    keys = derivable(with_derivatives(scene, []))
    scene = with_derivatives(scene, [key for key in keys if key != "body.shaft.clamp.0.x"])
    return ddmpi.solve(scene, world, TIGHT)


def test_supported_blocks():
    """Loads, clamps, moduli and friction; the gap by number is the sum of those at the nodes."""
    scene = pinched_blocks(4)
    scene["contact"][0]["gap"] = 0.0
    scene["body"][1]["clamp"] = [{"on": "left", "x": 2e-5, "y": 0.0}]
    answer = with_all(scene)
    compare(answer, [f"contacts.upper-lower.{name}" for name in (
        "normal_force", "force.x", "tangential_force", "moment", "pressure_max", "dissipated")])
    compare(answer, ["bodies.upper.reaction.x", "bodies.lower.reaction.y"])
    gradient = answer.gradient("contacts.upper-lower.normal_force")
    nodes = gradient.gap["upper-lower"]
    assert nodes.shape == answer.contacts["upper-lower"].gap.shape
    assert nodes.sum() == pytest.approx(gradient["contact.upper-lower.gap"], rel=1e-9)
    closed = answer.contacts["upper-lower"].status != "open"
    assert np.abs(nodes[closed]).min() > 0.0 and not nodes[~closed].any()


def test_a_slip_bound():
    """The bound also weighs what was dissipated at first."""
    compare(with_all(pinched_blocks(4, "tresca")), ["contacts.upper-lower.tangential_force",
                                                    "contacts.upper-lower.dissipated"])


def test_loose_bodies():
    """Results that follow from motions of bodies and of a pushed partner."""
    compare(with_all(vice()), ["rigid.ram.displacement.x", "rigid.fixed.displacement.y", "rigid.ram.force.y",
                               "contacts.part-fixed.tangential_force", "contacts.part-ram.dissipated"])


def test_boxes_in_space():
    """Friction that turns."""
    compare(with_all(two_boxes(2, law={"law": "coulomb", "coefficient": 0.3})), [
        "contacts.upper-lower.moment.x", "contacts.upper-lower.tangential_force", "contacts.upper-lower.dissipated",
        "bodies.upper.reaction.z"])


@pytest.mark.mpi(ranks=2)
def test_on_two_ranks(comm):
    """There GMRES solves, and all ranks have the same gradient; some nodes slip, so that the system is unsymmetric."""
    for scene, keys, contact in (
            (pinched_blocks(4), ["contact.upper-lower.friction.coefficient", "body.lower.traction.0"], "upper-lower"),
            (tower(3, 2), ["body.block3.traction.0", "body.block2.volume_force.1"], "block2-block1")):
        answer = ddmpi.solve(with_derivatives(scene, keys), comm, TIGHT)
        compare(answer, [f"contacts.{contact}.force.x"])
        nodes = answer.gradient(f"contacts.{contact}.normal_force").gap[contact]
        assert np.array_equal(nodes, comm.bcast(nodes))


@pytest.mark.parametrize("result, words", [
    ("contacts.upper-lower.force", "no such result; did you mean 'contacts.upper-lower.force."),
    ("contacts.upper-lower.normal_forces", "did you mean 'contacts.upper-lower.normal_force'"),
    ("bodies.uper.reaction.x", "did you mean 'bodies.upper.reaction.x'"), ("", "there is no such result")])
def test_a_result_that_there_is_not(result, words):
    """It is refused with the nearest one."""
    answer = ddmpi.solve(pinched_blocks(2))
    with pytest.raises(InputError) as caught:
        answer.gradient(result)
    assert words in str(caught.value)


def test_what_has_no_gradient():
    """Load steps, answers without a certificate, and the radial sum of reactions around an axis."""
    with pytest.raises(InputError, match="not possible with load steps"):
        ddmpi.solve(rubbed(steps=1)).gradient("contacts.fit.normal_force")
    with pytest.raises(InputError, match="needs a certified answer"):
        ddmpi.solve(pinched_blocks(4, max_iterations=1)).gradient("contacts.upper-lower.normal_force")
    with pytest.raises(InputError, match="radial reactions"):
        ddmpi.solve(ring()).gradient("bodies.shaft.reaction.x")


def test_around_an_axis():
    """Temperatures and clamps; the axial reaction follows from equilibrium."""
    compare(with_all(ring()), ["bodies.shaft.reaction.y", "contacts.fit.normal_force"])
