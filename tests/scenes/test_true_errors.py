"""The errors that studies report (scripts/true_errors.py), against known errors and known solutions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from true_errors import (
    ClosedForm,
    Rings,
    contact_of,
    solve_reference,
    zone_ends,
)

from ddmpi.coupling.assembly import prepare
from ddmpi.run.solve import solve

pytestmark = pytest.mark.slow


def test_zone_ends():
    """Zones end between the nodes where they end, whichever way the nodes are numbered."""
    x = np.linspace(0.0, 1.0, 11)
    inside = np.array([False, True, True, True, False, False, False, True, True, True, True])
    assert zone_ends(x, inside) == pytest.approx([0.05, 0.35, 0.65])
    assert zone_ends(x[::-1], inside) == pytest.approx([0.95, 0.65, 0.35])
    assert zone_ends(x, ~inside) == pytest.approx([0.05, 0.35, 0.65])
    for everything in (True, False):
        assert len(zone_ends(x, np.full(11, everything))) == 0


# Against a fine solution

def blocks(N: int, order: int):
    from ddmpi.scene.reader import read_scene

    scene = scenes.pinched_blocks(N, tolerance=1e-10)
    for body in scene["body"]:
        body["mesh"]["order"] = order
    return read_scene("scene of a test", scenes.to_toml(scene))


def solved(comm, scene):
    assembly = prepare(comm, scene)
    return assembly, solve(assembly, scene.method)


@pytest.mark.mpi(ranks=2)
def test_the_fine_solution_itself_and_a_known_distance_from_it(comm):
    """The errors of a fine solution are its own; a stretched one is off by the energy of the stretch."""
    scene = blocks(8, 2)
    fine = solve_reference(comm, scene)
    assembly, solution = solved(comm, scene)
    errors = fine.errors(assembly, solution)
    assert errors.energy == pytest.approx(fine.own_error, rel=1e-6)
    assert max(errors.pressure, errors.side_pressure, errors.shear) <= 1e-7
    assert max(errors.normal_force, errors.tangential_force) <= 1e-7
    assert (errors.contact_end, errors.stick_end) == (0.0, 0.0)
    (body,) = assembly.bodies
    stretched = {name: u + 1e-5 * body.mesh.points * [1, 0] for name, u in solution.displacements.items()}
    first, shear = body.spec.material.lame
    distance = fine.errors(assembly, replace(solution, displacements=stretched)).energy
    added = 2 * 3.0 * (first + 2 * shear) * 1e-10
    assert (distance**2 - fine.own_error**2) * fine.size == pytest.approx(added, rel=1e-6)
    states = {name: replace(state, normal_force=1.01 * state.normal_force) for name, state in solution.states.items()}
    errors = fine.errors(assembly, replace(solution, states=states))
    assert [errors.pressure, errors.normal_force] == pytest.approx([0.01, 0.01], rel=1e-6)


# Against the closed form of two rings

RINGS = Rings(a=0.4, b=1.0, c=1.7, overlap=1e-6)


@pytest.mark.mpi(ranks=2)
def test_solutions_converge_to_the_closed_form(comm, tmp_path):
    """Order 1 at rate 1; order 2 at rate 1.8, because straight sides cut the corners of the circle."""
    exact, errors, folder = ClosedForm(RINGS), {}, Path(comm.bcast(str(tmp_path)))
    for N in (3, 6):
        if comm.rank == 0:
            RINGS.write_meshes(folder, N)
        comm.Barrier()
        for order in (1, 2):
            assembly, solution = solved(comm, RINGS.scene(folder, N, order, "method.tolerance=1e-10"))
            assert solution.certified
            errors[order, N] = exact.errors(assembly, solution)
            assert contact_of(assembly, solution).normal_force == pytest.approx(
                RINGS.normal_force, rel=1.01 * errors[order, N].normal_force)
    for order, expected in ((1, 1.0), (2, 1.8)):
        assert np.log2(errors[order, 3].energy / errors[order, 6].energy) == pytest.approx(expected, abs=0.2)
    for N in (3, 6):  # the kinks at the corners show in the pressure at nodes, not in its means over sides
        assert errors[2, N].side_pressure < 0.1 * errors[2, N].pressure
