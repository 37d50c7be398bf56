"""The errors that studies report (scripts/true_errors.py), against known errors and known solutions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
from true_errors import (
    ClosedForm,
    Contact,
    Rings,
    contact_of,
    interpolate,
    side_difference,
    solve_reference,
    zone_ends,
)

from ddmpi.coupling.assembly import prepare
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.run.solve import solve
from ddmpi.scene.bodies import MeshSpec

pytestmark = pytest.mark.slow

ORDERS = pytest.mark.parametrize("order", [1, 2])


def rectangle(factor: int, order: int) -> tuple[Mesh, MeshSpec]:
    spec = MeshSpec(shape="rectangle", origin=(1.0, -0.5), size=(3.0, 0.7), divisions=(4 * factor, 3 * factor),
                    order=order)
    mesh = generate_rectangle(spec)
    return (mesh if order == 1 else raise_order(mesh, "mesh")), spec


def polynomial(points: np.ndarray, order: int) -> np.ndarray:
    x, y = points.T
    linear = np.column_stack([1 + 2 * x - y, 3 * x + 0.5 * y])
    return linear if order == 1 else linear + np.column_stack([x * x - 3 * x * y, y * y + x * y])


# Displacements on another mesh

@ORDERS
def test_interpolation_reproduces_what_the_elements_hold(order):
    mesh, spec = rectangle(1, order)
    inside = np.array([1.0, -0.5]) + np.random.default_rng(3).uniform(0, 1, (200, 2)) * (3.0, 0.7)
    for points in (mesh.points, inside, rectangle(5, 2)[0].points):
        u = interpolate(mesh, spec, polynomial(mesh.points, order), points)
        assert np.abs(u - polynomial(points, order)).max() <= 1e-12


# Along the interface

def test_zone_ends():
    x = np.linspace(0.0, 1.0, 11)
    inside = np.array([False, True, True, True, False, False, False, True, True, True, True])
    assert zone_ends(x, inside) == pytest.approx([0.05, 0.35, 0.65])
    assert zone_ends(x[::-1], inside) == pytest.approx([0.95, 0.65, 0.35])
    assert zone_ends(x, ~inside) == pytest.approx([0.05, 0.35, 0.65])
    for everything in (True, False):
        assert len(zone_ends(x, np.full(11, everything))) == 0


def contact(x: list[float], length: list[float], middle: list[int], pressure: list[float]) -> Contact:
    """Nodes stick where there is pressure, except for the second node, which slips; shear is half the pressure."""
    status = np.where(np.array(pressure) > 0, "stick", "open")
    status[1] = "slip"
    return Contact(np.column_stack([x, np.zeros(len(x))]), np.array(length), np.array(middle, bool), np.array(pressure),
                   np.array(pressure) / -2, status)


def test_side_means_are_compared_with_those_over_the_same_sides():
    """Pairs of fine sides make a coarse one; a pressure that swings between the fine nodes does not count."""
    fine = contact([1.0, 2.0, 3.0, 4.0, 5.0], [0.5, 1.0, 1.0, 1.0, 0.5], [0] * 5, [2.0, 3.0, 4.0, 5.0, 6.0])
    swinging = replace(fine, pressure=fine.pressure + np.array([1.0, -1.0, 1.0, -1.0, 1.0]))
    coarse = contact([1.0, 3.0, 5.0], [1.0, 2.0, 1.0], [0, 0, 0], [2.0, 4.0, 6.0])
    assert side_difference(coarse, fine) == side_difference(coarse, swinging) == 0.0
    wrong = replace(coarse, pressure=1.1 * coarse.pressure)
    assert side_difference(wrong, fine) == pytest.approx(0.1)


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
