"""Loose bodies in places where a run once went wrong: attempts of docs/understand/attempts.md."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import FLOOR, STEEL, rectangle

import ddmpi
from ddmpi.errors import InputError
from ddmpi.run.answer import Answer

WEIGHT = 1.0e5


def block(name: str, x: float, y: float, divisions: int = 3, **more) -> dict:
    """A square of side 1."""
    return rectangle(name, (x, y), (1, 1), (divisions, divisions), **STEEL, **more)


def ring(name: str, angles: tuple[float, float] = (0.0, 360.0), **more) -> dict:
    """Around the origin, with radii 0.3 and 1."""
    mesh = {
        "shape": "annulus",
        "center": [0.0, 0.0],
        "radii": [0.3, 1.0],
        "angles": list(angles),
        "divisions": [24, 3],
    }
    return {"name": name, "mesh": mesh, "material": STEEL, "volume_force": [0.0, -WEIGHT], **more}


def contact(body: str, partner: str, on: str, coefficient: float = 0.3, **more) -> dict:
    return {
        "bodies": [body, partner],
        "on": [on],
        "friction": {"law": "coulomb", "coefficient": coefficient},
        **more,
    }


def solve(bodies: list[dict], rigid: list[dict], contacts: list[dict]) -> Answer:
    return ddmpi.solve({"body": bodies, "rigid": rigid, "contact": contacts}, MPI.COMM_SELF)


def test_a_block_that_a_frictionless_floor_holds_without_deforming_it_at_the_contact():
    """Two contact nodes, whose displacements are rigid motions: nothing overlaps without forces, but it has weight."""
    bodies = [block("block", 0.0, 0.0, 1, volume_force=[0.0, -WEIGHT])]
    answer = solve(bodies, [FLOOR], [{"bodies": ["block", "floor"], "on": ["bottom"]}])
    assert answer.certified, answer.reason
    assert answer.contacts["block-floor"].force == pytest.approx([0.0, WEIGHT], abs=1e-6 * WEIGHT)


@pytest.mark.parametrize("clearance", [1e-3, 1e-2])
def test_a_body_falls_across_a_gap_though_it_touches_something_above(clearance):
    """Friction and a fall far beyond elastic displacements: not the drift of bodies that have no equilibrium."""
    bore = {
        "name": "bore",
        "shape": "circle",
        "center": [0.0, -clearance],
        "radius": 1.0 + clearance,
        "inside": True,
    }
    answer = solve([ring("disc")], [bore], [contact("disc", "bore", "outer")])
    assert answer.certified, answer.reason
    assert np.mean(answer.bodies["disc"].displacement[:, 1]) == pytest.approx(
        -2.0 * clearance, rel=0.01
    )


def test_a_disc_that_a_bore_does_not_keep_from_turning_stays_where_it_falls():
    """Springs do not hang on motions that no contact resists, whose part at the contact is but rounding."""
    bore = {
        "name": "bore",
        "shape": "circle",
        "center": [0.0, 0.0],
        "radius": 1.001,
        "inside": True,
    }
    answer = solve([ring("disc")], [bore], [{"bodies": ["disc", "bore"], "on": ["outer"]}])
    assert answer.certified, answer.reason
    assert answer.summary["displacement_max"] == pytest.approx(1e-3, rel=0.05)
    (warning,) = answer.summary["warnings"]
    assert "closed at a single node" in warning  # and no word on the motions that stay


def test_a_body_that_nothing_touches_stays_where_it_is():
    """Pulled from both sides: what rounding leaves of the sum must not move it."""
    pulled = block(
        "pulled",
        3.0,
        0.0,
        traction=[{"on": "left", "value": [-1e6, 0.0]}, {"on": "right", "value": [1e6, 0.0]}],
    )
    bodies = [block("block", 0.0, 0.0, volume_force=[0.0, -WEIGHT]), pulled]
    answer = solve(bodies, [FLOOR], [contact("block", "floor", "bottom")])
    assert answer.certified
    u = answer.bodies["pulled"].displacement
    assert np.abs(u.mean(axis=0)).max() < 1e-6 * np.abs(u).max()


def test_an_open_node_that_sticks_by_tresca_friction_holds_its_body():
    """As the slip bound holds whether a node is open or not; almost all of it is used up."""
    traction = [{"on": "top", "value": [0.99e6, -3e5]}]
    friction = {"law": "tresca", "slip_bound": 1e6}
    slab = block("slab", 0.0, 0.0, traction=traction)
    slab["mesh"] |= {"size": [4.0, 0.5], "divisions": [8, 2]}
    answer = solve([slab], [FLOOR], [contact("slab", "floor", "bottom") | {"friction": friction}])
    assert answer.certified, answer.reason
    (state,) = answer.contacts.values()
    sticks = np.abs(state.shear[:, 0]) < 0.999e6
    assert sticks.any() and (state.status[sticks] == "open").all()
    assert answer.summary["undetermined"] == []


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_a_round_pin_turns_freely_whatever_the_meshes(order):
    """Where meshes do not match, normals that are a little off resist its turning; it is said to turn freely still."""
    meshes = [
        {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": radii,
            "angles": [0, 360],
            "order": order,
            "divisions": [around, 3],
        }
        for radii, around in (([1.0, 5.0], 48), ([5.0, 12.0], 37))
    ]
    bodies = [
        {"name": "pin", "mesh": meshes[0], "material": STEEL, "volume_force": [0.0, -1.0]},
        {"name": "lug", "mesh": meshes[1], "material": STEEL, "clamp": ["outer"]},
    ]
    between = {"bodies": ["pin", "lug"], "on": ["outer", "inner"], "gap": -0.01}
    answer = solve(bodies, [], [between])
    assert answer.certified, answer.reason
    (motion,) = answer.summary["held_motions"]
    assert motion["motion"] == "pin can turn counterclockwise about (0, 0) without any force"
    assert answer.summary["undetermined"] == []
    rubs = solve(bodies, [], [between | {"friction": {"law": "coulomb", "coefficient": 0.3}}])
    assert rubs.certified
    assert rubs.summary["undetermined"] == rubs.summary["held_motions"] == []


def test_a_second_contact_between_the_same_sides_is_refused():
    """One message names both contacts."""
    bodies = [block("block", 0.0, 0.0, volume_force=[0.0, -WEIGHT])]
    with pytest.raises(
        InputError, match=r"contact\.again: is between the same sides as contact\.block-floor"
    ):
        solve(
            bodies,
            [FLOOR],
            [
                contact("block", "floor", "bottom"),
                contact("block", "floor", "bottom", name="again"),
            ],
        )


@pytest.mark.parametrize("far", [1e-9, 1e-4, 1e2])
def test_a_partner_carries_a_body_without_any_force(far):
    """It moves as the partner does; all that is left of forces is rounding."""
    top = {
        "name": "top",
        "shape": "plane",
        "point": [0.0, 1.0],
        "normal": [0.0, -1.0],
        "displacement": [0.0, -far],
    }
    answer = solve(
        [block("box", 0.0, 0.0, clamp=[{"on": "left", "x": 0.0}])],
        [top],
        [contact("box", "top", "top")],
    )
    assert answer.certified
    assert answer.bodies["box"].displacement == pytest.approx(
        np.tile([0.0, -far], (16, 1)), abs=1e-9 * far
    )
    assert abs(answer.contacts["box-top"].force).max() <= 1e-13 * STEEL["young"] * far
