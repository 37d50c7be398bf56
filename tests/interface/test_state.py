"""The state of contact nodes: what slip dissipates in a load step."""

import numpy as np
import pytest
from test_interface import blocks, interface_of

from ddmpi.interface.state import contact_state
from ddmpi.scene.contacts import Coulomb, Tresca

COULOMB, TRESCA = Coulomb(coefficient=0.5), Tresca(slip_bound=2.0)


def dissipated(friction, ends: list[tuple[float, float, float]]) -> list[float]:
    """By load step, of seven nodes with the pressures (N), tangential forces (N) and displacements (m) at the ends."""
    contact, found = interface_of(*blocks(), friction), []
    since = None
    for pressure, shear, moved in ends:
        s, u = np.repeat([pressure, shear], 7), np.repeat([0.0, moved], 7)
        found.append(contact_state(contact, s, contact.law.bound_at(s), u, since=since).dissipated)
        since = u, s
    return found


def test_proportional_slip_dissipates_the_same_in_any_number_of_steps():
    """Pressure, friction and slip that grow together: half of the end's friction times the slip."""
    steps = [(4.0 * t, 2.0 * t, 0.1 * t) for t in (0.25, 0.375, 1.0)]
    assert (
        sum(dissipated(COULOMB, steps))
        == pytest.approx(0.7)
        == sum(dissipated(COULOMB, steps[-1:]))
    )


def test_a_loop_dissipates_its_area():
    """To and fro under constant pressure, a leg in one step or in two; nodes that stick dissipate nothing."""
    pressed, there, back = (4.0, 0.0, 0.0), (4.0, 2.0, 0.1), (4.0, -2.0, -0.3)
    assert dissipated(COULOMB, [pressed, there, back]) == pytest.approx([0.0, 1.4, 5.6])
    assert dissipated(COULOMB, [pressed, there, (4.0, -2.0, 0.05), back])[2:] == pytest.approx(
        [0.7, 4.9]
    )
    assert dissipated(COULOMB, [pressed, (4.0, 1.9, 0.1)]) == [0.0, 0.0]


def test_pressure_that_ends_takes_friction_with_it():
    """Slip overcomes the mean of the bounds; open nodes dissipate under Tresca's law only."""
    assert dissipated(COULOMB, [(4.0, 0.0, 0.0), (1.0, -0.5, -0.1)]) == pytest.approx(
        [0.0, 7 * 0.125]
    )
    assert dissipated(COULOMB, [(4.0, 2.0, 0.0), (0.0, 0.0, 0.1)]) == [0.0, 0.0]
    bound = interface_of(*blocks(), TRESCA).law.bound
    contact = interface_of(*blocks(), TRESCA)
    state = contact_state(contact, np.append(np.zeros(7), bound), bound, np.repeat([0.0, 0.1], 7))
    assert (state.status == "open").all() and state.dissipated == pytest.approx(0.1 * bound.sum())
