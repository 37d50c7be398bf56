"""How much of its friction a contact bears: closed forms, linear programs, and shrink fits that turn."""

import numpy as np
import pytest
from scenes import certified, rectangle
from scipy.optimize import linprog
from test_interface import blocks, interface_of

from ddmpi.interface.state import contact_state
from ddmpi.interface.utilisation import largest_factor
from ddmpi.results.summary import friction_in_words
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca
from ddmpi.sets import magnitude

SIDES = 256
"""Of the polygons in and around discs, whose radii differ by 7.5e-5."""


def moved(places, tangents, bounds) -> np.ndarray:
    """(n, c, k) bounds times the displacements along tangents (n, c, d), by the k rigid motions of the places (n, d)."""
    x, d = places - places.mean(axis=0), places.shape[1]
    turns = [[-x[:, 1], x[:, 0]]] if d == 2 else [np.cross(axis, x).T for axis in np.eye(3)]
    motions = [np.broadcast_to(axis[:, None], x.T.shape) for axis in np.eye(d)] + turns
    along = np.einsum("ncd,kdn->nck", tangents, np.array(motions))
    return np.asarray(bounds)[:, None, None] * along


def drawn(rng: np.random.Generator, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Motions and shares of some nodes of a closed or an open surface, flat or not."""
    n = int(rng.integers(2, 40))
    places, normals = rng.normal(size=(n, d)), rng.normal(size=(n, d))
    if rng.random() < 0.3:
        places[:, -1], normals = 0.0, np.tile(np.eye(d)[-1], (n, 1))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    tangents = np.linalg.svd(normals[:, None])[2][:, 1:]
    shares = rng.normal(size=(n, d - 1)) * 10.0 ** rng.uniform(-3, 1)
    shares /= np.maximum(1.0, magnitude(shares))[:, None]
    return moved(places, tangents, rng.random(n) ** 4), shares


@pytest.mark.parametrize("d", [2, 3])
def test_the_factor_is_that_of_a_linear_program(d):
    """In the plane of the program itself; in space between those of polygons in and around the discs."""
    rng = np.random.default_rng(61)
    for _ in range({2: 20, 3: 3}[d]):
        motions, shares = drawn(rng, d)
        angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
        corners = np.column_stack([np.cos(angles), np.sin(angles)]) if d == 3 else [[1.0], [-1.0]]
        n, rays = len(shares), len(corners)
        # friction of a node: its corners with weights that add up to one at most
        power = np.einsum("nck,rc->knr", motions, corners).reshape(-1, n * rays)
        wanted = -np.einsum("nck,nc->k", motions, shares)
        found = linprog(
            np.append(np.zeros(n * rays), -1.0),
            np.pad(np.kron(np.eye(n), np.ones(rays)), ((0, 0), (0, 1))),
            np.ones(n),
            np.column_stack([power, wanted]),
            np.zeros(len(wanted)),
        ).x[-1]
        outside = 1.0 / np.cos(np.pi / SIDES) if d == 3 else 1.0
        factor = largest_factor(motions, shares)
        assert found * (1.0 - 1e-6) <= factor <= found * outside * (1.0 + 1e-6)


def test_closed_forms():
    """A row that is pushed, a ring that is turned, a disc that is turned, and two nodes that bear force and torque."""
    row = np.column_stack([np.linspace(0.0, 3.0, 7), np.zeros(7)])
    along = np.tile([[1.0, 0.0]], (7, 1, 1))
    bounds = np.arange(1.0, 8.0)
    for share in (0.25 * np.ones(7), np.eye(7)[6]):
        assert largest_factor(moved(row, along, bounds), share[:, None]) == pytest.approx(
            28.0 / (bounds @ share), rel=2e-7
        )

    angles = 2.0 * np.pi * np.arange(24) / 24
    ring, around = (
        np.column_stack(xy)
        for xy in ((np.cos(angles), np.sin(angles)), (-np.sin(angles), np.cos(angles)))
    )
    motions = moved(ring, around[:, None], np.full(24, 3.0))
    assert largest_factor(motions, np.full((24, 1), 0.8)) == pytest.approx(1.25, rel=2e-7)
    # alternating friction has neither force nor moment
    assert largest_factor(motions, (-1.0) ** np.arange(24)[:, None]) > 1e12

    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 81)]), -1).reshape(-1, 2)
    disc = np.pad(grid[np.linalg.norm(grid, axis=1) <= 1.0], ((0, 0), (0, 1)))
    tangents = np.tile(np.eye(3)[:2], (len(disc), 1, 1))
    turned = np.column_stack([-disc[:, 1], disc[:, 0]])  # τ = p μ r/R bears π μ p R³/2 of 2/3
    factor = largest_factor(moved(disc, tangents, np.ones(len(disc))), turned)
    assert factor == pytest.approx(4.0 / 3.0, rel=2e-3)

    # g at ±a bear the force F across and the torque T together up to F/2 + T/2a = g
    two, across = np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.tile(np.eye(3)[:2], (2, 1, 1))
    shares = np.array([[0.0, -0.1], [0.0, 0.5]])
    assert largest_factor(moved(two, across, [7.0, 7.0]), shares) == pytest.approx(2.0, rel=2e-7)


def stated(friction, pressures, shears):
    contact = interface_of(*blocks(), friction)
    s = np.append(pressures, shears if contact.law.size > 7 else [])
    return contact_state(contact, s, contact.law.bound_at(s), np.zeros(contact.size))


def test_bounds_are_those_of_the_law():
    """Of the pressure, or Tresca's, at open nodes too; without friction, load or with a bond there is no utilisation."""
    pressures, shears = np.array([0.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0]), np.zeros(7)
    shears[1:3] = 1.0, -0.5
    state = stated(Coulomb(coefficient=0.5), pressures, shears)
    assert state.utilised == pytest.approx([0.0, 0.5, 0.25, 0.0, 0.0, 0.0, 0.0])
    assert state.utilisation == pytest.approx(0.5 / 12.0, rel=2e-7)
    assert state.table()["utilisation"] == pytest.approx(state.utilised)
    state = stated(Tresca(slip_bound=2.0), pressures, shears)
    assert state.utilised[1] == pytest.approx(1.0) and state.slip_bound[0] == pytest.approx(0.5)
    assert state.utilisation == pytest.approx(0.5 / 6.0, rel=2e-7)
    for friction, pressure in (
        (Coulomb(coefficient=0.5), 0.0 * pressures),
        (NoFriction(), pressures),
    ):
        assert np.isnan(stated(friction, pressure, 0.0 * shears).totals.utilisation)


def test_friction_in_balance_bears_nothing():
    """What is left of its resultants is rounding, or below what an iteration resolves."""
    for rest in (0.0, 1e-9):
        shears = np.array([0.0, 1.0, -1.0 + rest, 0.3, -0.3, 0.0, 0.0])
        state = stated(Coulomb(coefficient=0.5), np.full(7, 4.0), shears)
        assert state.utilised.max() == pytest.approx(0.5) and state.utilisation == 0.0


def turned_fit(friction: dict, kind: str = "unilateral") -> dict:
    """A shaft shrunk into a hub, whose bore turns to and fro."""

    def part(name: str, radii: list[float], **keys) -> dict:
        mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": radii, "angles": [0, 360]}
        material = {"young": 2.1e5, "poisson": 0.3}
        return {"name": name, "mesh": mesh | {"divisions": [24, 3]}, "material": material} | keys

    turn = {"on": "inner", "x": "-1e-3 * y", "y": "1e-3 * x", "history": "turn"}
    contact = {"bodies": ["shaft", "hub"], "on": ["outer", "inner"], "gap": -0.03, "kind": kind}
    return {
        "body": [
            part("shaft", [20.0, 40.0], clamp=[turn]),
            part("hub", [40.0, 70.0], clamp=["outer"]),
        ],
        "contact": [contact | friction],
        "history": {"turn": {"times": [0, 1, 2, 3], "factors": [0, 0, 1, -1]}},
        "time": {"points": [1.0, 2.0, 3.0], "steps": 4},
    }


def test_a_shrink_fit_at_its_torque_limit_bears_all_of_its_friction():
    """While it sticks, its torque over that of friction all around."""
    answer = certified(turned_fit({"friction": {"law": "coulomb", "coefficient": 0.15}}))
    steps = [step["contacts"]["shaft-hub"] for step in answer.summary["steps"]]
    shares = [step["utilisation"] for step in steps]
    around = [abs(step["moment"]) / (0.15 * 40.0 * step["normal_force"]) for step in steps]
    assert shares == pytest.approx(around, abs=1e-6)
    assert shares[-1] == 1.0 and 0.1 < min(shares[4:]) < 0.9
    assert answer.summary["contacts"]["shaft-hub"]["utilisation"] == 1.0


def test_a_bond_has_no_utilisation():
    contact = certified(turned_fit({}, "bonded")).contacts["shaft-hub"]
    assert np.isnan(contact.utilisation) and not contact.utilised.any()


def test_friction_across_an_axis_has_no_utilisation():
    """A disc that is squeezed slips outwards on a plate, and cannot slip along the axis."""
    bodies = [rectangle("disc", (0, 1), (1, 1), (4, 4)), rectangle("plate", (0, 0), (2, 1), (8, 4))]
    bodies[0]["clamp"], bodies[1]["clamp"] = [{"on": "top", "y": -1e-3}], ["bottom"]
    contact = {"bodies": ["disc", "plate"], "on": ["bottom", "top"]}
    contact["friction"] = {"law": "coulomb", "coefficient": 0.1}
    answer = certified({"axisymmetric": True, "body": bodies, "contact": [contact]})
    assert answer.summary["contacts"]["disc-plate"]["slip"]
    assert answer.summary["contacts"]["disc-plate"]["utilisation"] is None


def test_words():
    """Many slip and the contact does not; all slip; none does; there is no friction."""
    contact = {"utilisation": 0.2834, "open": 3, "slip": 145, "stick": 7}
    words = (
        "145 of 152 closed nodes slip, but the contact bears 28.3 % of the friction that it could"
    )
    assert friction_in_words(contact) == words
    for share, slip in ((1.0, 152), (0.2834, 7)):
        told = friction_in_words(
            contact | {"utilisation": share, "slip": slip, "stick": 152 - slip}
        )
        assert told == f"bears {100.0 * share:.3g} % of the friction that it could"
    assert friction_in_words(contact | {"utilisation": None}) == ""
