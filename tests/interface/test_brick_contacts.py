"""Contacts of hexahedra: a constant pressure on trapezoids, fits of curved ones, rigid partners, unlike bodies."""

import numpy as np
import pytest
from bricks import grid
from mpi4py import MPI
from scenes import certified, seldom, the_interface

import ddmpi
from ddmpi.coupling.assembly import prepare
from ddmpi.surface.side import bilinear

STEEL = {"young": 2e11, "poisson": 0.3}

BASE = [[0, 0], [1, 0], [0.7, 0.9], [0, 1.3]]


def block(name, low, divisions, order, elements, **keys):
    corners = [[*at, z] for z in (low, low + 1) for at in BASE]
    mesh = {"shape": "hexahedron", "corners": corners, "divisions": divisions, "order": order}
    return {"name": name, "mesh": mesh | {"elements": elements}, "material": STEEL} | keys


@pytest.mark.parametrize(
    ("elements", "order"),
    [
        seldom(("bricks", "bricks"), 2),
        (("bricks", "simplices"), 1),
        seldom(("simplices", "bricks"), 1),
        seldom(("bricks", "bricks"), 1),
        seldom(("bricks", "simplices"), 2),
        seldom(("simplices", "bricks"), 2),
    ],
)
def test_a_pressure_on_trapezoids_is_constant(order, elements):
    """Whose meshes do not match, and of which one side may have triangles."""
    sides = [{"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}]
    load = [{"on": "top", "value": [0.0, 0.0, -1e7]}]
    scene = {
        "body": [
            block("upper", 1, [3, 3, 2], order, elements[0], clamp=sides, traction=load),
            block(
                "lower",
                0,
                [4, 4, 2],
                order,
                elements[1],
                clamp=[*sides, {"on": "bottom", "z": 0.0}],
            ),
        ],
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]}],
    }
    pressure = certified(scene).contacts["upper-lower"].pressure
    assert pressure == pytest.approx(np.full(len(pressure), 1e7), rel=1e-8)


def tube(inner, outer, divisions, order, cut):
    """A quarter of a tube, of hexahedra with curved edges in order 2, as arrays."""
    mesh = grid(divisions, order)
    r, t = inner + (outer - inner) * mesh.points[:, 0], np.pi / 2 * mesh.points[:, 1]
    points = np.stack([r * np.cos(t), r * np.sin(t), 0.25 * mesh.points[:, 2]], axis=1)
    return {
        "points": points,
        "cells": mesh.triangles,
        "groups": mesh.groups,
        "order": order,
        "cut": cut,
    }


@pytest.mark.slow
@pytest.mark.parametrize("order, most", [seldom(1, 0.04), (2, 0.01)])
def test_a_fit_of_tubes_is_better_than_their_cut(order, most):
    """Lamé's pressure between plates, of meshes that do not match; at the same nodes tetrahedra are farther off."""
    held = [
        {"on": "front", "y": 0.0},
        {"on": "back", "x": 0.0},
        *({"on": on, "z": 0.0} for on in ("bottom", "top")),
    ]
    errors = []
    for cut in (False, True):
        bodies = [
            {
                "name": name,
                "mesh": tube(*radii, (2, n, 1), order, cut),
                "material": STEEL,
                "clamp": held,
            }
            for name, radii, n in (("shaft", (0.5, 1.0), 8), ("hub", (1.0, 2.0), 12))
        ]
        contact = {"bodies": ["shaft", "hub"], "on": ["right", "left"], "gap": -1e-4}
        answer = ddmpi.solve({"body": bodies, "contact": [contact]}, MPI.COMM_SELF)
        assert answer.certified
        assert (
            answer.bodies["hub"].cells.shape[1]
            == ({1: 8, 2: 20} if not cut else {1: 4, 2: 10})[order]
        )
        # δ/p = (1 + ν)/E (((1 − 2ν) + a²)/(1 − a²) + ((1 − 2ν) + c²)/(c² − 1)) of radii a, 1, c
        exact = 1e-4 * 2e11 / 1.3 / ((0.4 + 0.25) / 0.75 + (0.4 + 4.0) / 3.0)
        errors.append(np.abs(answer.contacts["shaft-hub"].pressure / exact - 1.0).max())
    assert errors[0] < most and errors[0] < errors[1]


@pytest.mark.parametrize("order", [seldom(1), 2])
def test_gaps_of_drawn_tubes_are_those_of_their_arcs(order):
    """Facets of both halves of a quadrilateral bulge: chords lie many times the overlap off the arcs."""
    bodies = [
        {"name": name, "mesh": tube(*radii, (2, n, 1), order, False), "material": STEEL}
        for name, radii, n in (("shaft", (0.5, 1.0), 8), ("hub", (0.9998, 2.0), 12))
    ]
    scene = {"body": bodies, "contact": [{"bodies": ["shaft", "hub"], "on": ["right", "left"]}]}
    with ddmpi.prepare(scene, MPI.COMM_SELF) as model:
        interface = the_interface(prepare(MPI.COMM_SELF, model.settle()))
    assert interface.opening == pytest.approx(np.full(interface.m, -2e-4), abs=4e-5)


@pytest.mark.parametrize("order", [1, seldom(2)])
def test_a_ball_on_a_block_of_bricks(order):
    """Hertz's force of a rigid ball on a block, as far as the block is a half-space, is that of tetrahedra to 3 %."""
    forces = []
    for elements in ("bricks", "simplices"):
        mesh = {
            "shape": "box",
            "origin": [-0.1, -0.1, -0.1],
            "size": [0.2, 0.2, 0.1],
            "divisions": [9, 9, 5],
        }
        scene = {
            "body": [
                {
                    "name": "block",
                    "mesh": mesh | {"order": order, "elements": elements},
                    "material": STEEL,
                    "clamp": ["bottom"],
                }
            ],
            "rigid": [
                {
                    "name": "ball",
                    "shape": "sphere",
                    "center": [0, 0, 1.0],
                    "radius": 1.0,
                    "displacement": [0, 0, -1e-3],
                }
            ],
            "contact": [{"bodies": ["block", "ball"], "on": ["top"]}],
        }
        forces.append(certified(scene).summary["contacts"]["block-ball"]["normal_force"])
    assert forces[0] == pytest.approx(forces[1], rel=0.12 if order == 1 else 0.03)


def test_a_place_in_a_quadrilateral_is_found():
    """The bilinear map there and back, of trapezoids and of warped ones, seen along their normals; in any unit."""
    random = np.random.default_rng(5)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.6, 0.9, 0], [0, 1.2, 0]]) + 0.05 * random.normal(
        size=(50, 4, 3)
    )
    s, t = random.uniform(0, 1, (2, 50))
    hats = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    place = np.einsum("qc,qcd->qd", hats, corners) + 0.1 * normal
    for unit in (1.0, 1e-6):
        found = bilinear(unit * place, unit * corners, normal)
        assert found == pytest.approx(hats, abs=1e-12)


@pytest.mark.every(5)
@pytest.mark.parametrize("where", ["space", "plane", "axis"])
@pytest.mark.parametrize(
    ("order", "integration"), [(1, "modes"), (1, "full"), (2, "full"), (2, "reduced")]
)
def test_a_brick_body_cut_by_a_bond_is_the_uncut_one(where, order, integration):
    """A bent, in space also twisted, bar of one mesh and of two that match: at order 2 all nodes of a facet are tied."""
    d, u = 3 if where == "space" else 2, []
    for parts in ([3], [1, 2]):
        scene = {"body": [], "contact": [], "axisymmetric": where == "axis"}
        for low, number in zip(np.cumsum([0, *parts[:-1]]).tolist(), parts, strict=True):
            at = BASE if d == 3 else [[0.5, 0.0], [1.8, 0.0]]
            ends = [[[*each[: d - 1], float(z)] for each in at] for z in (low, low + number)]
            body = block(f"b{low}", low, [2] * (d - 1) + [2 * number], order, "bricks")
            body["mesh"] |= {"integration": integration}
            body["mesh"] |= {"corners": ends[0] + (ends[1] if d == 3 else ends[1][::-1])}
            body["mesh"] |= {"shape": "hexahedron" if d == 3 else "quadrilateral"}
            if low == 0:
                body["clamp"] = ["bottom"]
            if low + number == 3:
                body["traction"] = [{"on": "top", "value": [1e6, 2e6, -3e6][:d]}]
            scene["body"].append(body)
        if len(parts) == 2:
            bond = {"bodies": ["b1", "b0"], "on": ["bottom", "top"], "kind": "bonded"}
            scene["contact"] = [bond]
        if where == "axis" and integration == "modes":
            for body in scene["body"]:
                del body["mesh"]["integration"]  # there are no modes around an axis
        answer = ddmpi.solve(scene, MPI.COMM_SELF, overrides={"method.tolerance": 1e-12})
        assert answer.certified
        found = {}
        for body in answer.bodies.values():
            found |= zip(map(tuple, body.points.round(9)), body.displacement, strict=True)
        u.append(np.array([found[at] for at in sorted(found)]))
    assert u[1] == pytest.approx(u[0], abs=1e-9 * np.abs(u[0]).max())
    rows = {"space": {1: 9, 2: 21}}.get(where, {1: 3, 2: 5})[order]
    assert answer.contacts["b1-b0"].interface.m == rows
