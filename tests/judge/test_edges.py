"""Largest stresses that grow without limit with finer meshes: at sharp corners in contact, and at ends of bonds."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from scenes import COULOMB, FLOOR, certified, prepare_scene, rectangle
from solid_scenes import box

import ddmpi
from ddmpi.body.stress import Composite
from ddmpi.judge.edges import (
    BOGY,
    Ends,
    edges_of,
    ends_of_clamps,
    mismatch,
    pinned_angle,
    unbounded,
)
from ddmpi.judge.plausible import _in_thin_cell, _singular
from ddmpi.mesh.boundary import SHARPEST, creases
from ddmpi.mesh.elements import normals
from ddmpi.mesh.mesh import Mesh, boundary_facets

SOFT, STEEL = 1e9, 2e11
ROLLERS = [{"on": "bottom", "y": 0.0}, {"on": "left", "x": 0.0}]


def scene(
    at: float = 1.0,
    width: float = 1.0,
    young: tuple[float, float] = (STEEL, STEEL),
    order: int = 1,
    bonded: bool = False,
    halved: bool = False,
    slave: str | None = None,
) -> dict:
    """A block of 1 m height, pressed on one of 3 m, from x = `at` on; `halved` by a plane of symmetry at x = 0."""
    upper = rectangle("upper", (at, 1.0), (width, 1.0), (int(8 * width), 4), young=young[0])
    lower = rectangle("lower", (0.0, 0.0), (3.0, 1.0), (24, 4), young=young[1], clamp=ROLLERS)
    upper["traction"] = [{"on": "top", "pressure": 1e6}]
    for body in (upper, lower):
        body["mesh"]["order"] = order
        body["clamp"] = [*body.get("clamp", []), *([{"on": "left", "x": 0.0}] if halved else [])]
    contact = {"name": "c", "bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    contact |= {"kind": "bonded"} if bonded else {"friction": COULOMB}
    contact |= {"slave": slave, "pairing": "mortar"} if slave else {}
    return {"body": [upper, lower], "contact": [contact]}


def told(about: dict) -> list[str]:
    return [each for each in certified(about).summary["warnings"] if "without limit" in each]


CORNER, BOND = "at a sharp corner of upper in contact at (", "at the end of the bond at ("
SINGULAR = {
    "punch": (scene(), CORNER),
    "quadratic": (scene(order=2), CORNER),
    "within a facet": (scene(at=1.03), CORNER),
    "whose partner is the slave": (scene(at=1.03, slave="lower"), CORNER),
    "hard punch": (scene(young=(STEEL, SOFT)), CORNER),
    "half a punch": (scene(at=0.0, halved=True), CORNER),
    "bond": (scene(bonded=True), BOND),
    "flush bond of unlike bodies": (
        scene(at=0.0, width=3.0, bonded=True, young=(2e9, STEEL)),
        BOND,
    ),
}


@pytest.mark.every(2)
@pytest.mark.parametrize(("about", "what"), SINGULAR.values(), ids=SINGULAR)
def test_stresses_that_grow_without_limit_are_told(about, what):
    """The largest pressure and the largest von Mises stress, with the place, one line each."""
    found = told(about)
    assert len(found) == 2, found
    assert found[0].startswith("contact.c: the largest pressure, ") and what in found[0]
    assert "the largest von Mises stress, " in found[1] and what in found[1]


FINITE = {
    "flush bodies": scene(at=0.0, width=3.0),
    "flush bond of like bodies": scene(at=0.0, width=3.0, bonded=True),
    "soft punch": scene(young=(SOFT, STEEL)),
    "all of it halved": scene(at=0.0, width=3.0, halved=True),
}


@pytest.mark.parametrize("about", FINITE.values(), ids=FINITE)
def test_finite_stresses_are_not_told(about):
    """Of ends that are no corners of both bodies together, and of bodies far softer than what they press on."""
    assert told(about) == []


@pytest.mark.parametrize("friction", [{}, {"friction": COULOMB}])
def test_right_angles_on_a_rigid_plane_are_not_told(friction):
    """A block between two moved sides: its pressure is finite there without friction."""
    block = rectangle("block", (0.0, 0.0), (2.0, 1.0), (8, 4))
    block["clamp"] = [{"on": "top", "y": -1e-4}, {"on": "left", "x": 0.0}]
    contact = {"bodies": ["block", "floor"], "on": ["bottom"], **friction}
    assert told({"body": [block], "rigid": [FLOOR], "contact": [contact]}) == []


def test_a_blunt_corner_on_a_rigid_plane_is_told():
    """A frustum that widens upwards; its angle of 116° is more than a right one."""
    frustum = {
        "name": "frustum",
        "mesh": {
            "shape": "quadrilateral",
            "corners": [[0.0, 0.0], [2.0, 0.0], [2.5, 1.0], [-0.5, 1.0]],
            "divisions": [16, 8],
        },
        "material": {"young": STEEL, "poisson": 0.3},
        "traction": [{"on": "top", "pressure": 1e6}],
    }
    contact = {"bodies": ["frustum", "floor"], "on": ["bottom"]}
    found = told({"body": [frustum], "rigid": [FLOOR], "contact": [contact]})
    assert found and "at a sharp corner of frustum in contact at (" in found[0]


@pytest.mark.slow
@pytest.mark.parametrize("bonded", [False, True])
def test_edges_of_solids_are_told(bonded):
    """Of a cube on a larger one; where it goes on to a plane of symmetry, it has none."""
    upper = box("upper", (0, 0, 1), (1, 1, 1), (4, 4, 4))
    lower = box("lower", (0, 0, 0), (2, 2, 1), (8, 8, 4), clamp=["bottom"])
    upper["traction"] = [{"on": "top", "pressure": 1e6}]
    planes = [{"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}]
    upper["clamp"], lower["clamp"] = planes, ["bottom", *planes]
    contact = {"name": "c", "bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    contact |= {"kind": "bonded"} if bonded else {"friction": COULOMB}
    found = told({"body": [upper, lower], "contact": [contact]})
    what = "at the end of the bond" if bonded else "at a sharp edge of upper in contact"
    assert len(found) == 2 and all(what in each for each in found), found
    assert found[0].split(" at (")[1].startswith(("1, ", "0.", "0, 1"))  # none at (0, 0, 1)


@pytest.mark.parametrize("stress", [False, True])
def test_corners_of_clamps_from_williams_equation(stress):
    """The exponent λ of the stress r^(λ − 1) at a clamped and a free side, by bisection: singular from the angle on
    that is told, and hardly so just below it."""

    def exponent(angle: float, nu: float) -> float:
        kappa = (3.0 - nu) / (1.0 + nu) if stress else 3.0 - 4.0 * nu
        lam = np.linspace(0.3, 1.0, 70001)
        rest = (kappa + 1.0) ** 2 / (4.0 * kappa) - (lam * np.sin(angle)) ** 2 / kappa
        found = np.flatnonzero(np.diff(np.sign(np.sin(lam * angle) ** 2 - rest)))
        return float(lam[found[0]]) if len(found) else 1.0

    for nu in (0.1, 0.3, 0.45):
        least = pinned_angle(nu, stress)
        assert exponent(0.99 * least, nu) > 0.9
        assert exponent(1.01 * least, nu) < 0.97
        assert exponent(np.pi / 2, nu) < 0.9


def clamped(poisson: float = 0.3, **clamp) -> dict:
    """A bracket with a load at its end."""
    block = rectangle("block", (0.0, 0.0), (2.0, 1.0), (16, 8), young=STEEL)
    block["material"]["poisson"] = poisson
    block["clamp"] = [{"on": "left", **clamp}]
    block["traction"] = [{"on": "right", "value": [0.0, -1e6]}]
    return {"body": [block], "contact": []}


@pytest.mark.parametrize(
    ("about", "grows"),
    [
        (clamped(x=0.0, y=0.0), True),
        (clamped(0.0, x=0.0, y=0.0), False),
        (clamped(x="1e-6 * y", y=0.0), True),
    ],
)
def test_the_corner_of_a_clamped_side_is_told(about, grows):
    """A right angle between what cannot move and what is free, unless there is no contraction to hinder."""
    found = told(about)
    assert len(found) == grows, found
    assert all("body.block: " in each and "at the end of a clamp at (" in each for each in found)


def test_the_corner_of_a_clamped_side_of_several_materials():
    """Where no ratio is known, right angles do not count."""
    (body,) = prepare_scene(MPI.COMM_SELF, clamped(x=0.0, y=0.0)).bodies
    assert ends_of_clamps(body).sum() == 2
    two = Composite([body.material] * 2, np.arange(len(body.mesh.triangles)) % 2)
    several = SimpleNamespace(mesh=body.mesh, spec=body.spec, member=body.member, material=two)
    assert not ends_of_clamps(several).any()


def test_a_notch_at_a_plane_of_symmetry_is_a_re_entrant_corner():
    """Half a plate with a notch of 2 · 45°; without the notch the corner has a finite stress."""
    plate = {
        "name": "plate",
        "mesh": {"shape": "quadrilateral", "divisions": [8, 8]},
        "material": {"young": STEEL, "poisson": 0.3},
        "clamp": [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}],
        "traction": [{"on": "right", "value": [1e6, 0.0]}],
    }

    def found(top: float) -> list[str]:
        corners = [[0.0, 0.0], [2.0, 0.0], [2.0, top], [0.0, 1.0]]
        mesh = plate["mesh"] | {"corners": corners}
        return told({"body": [plate | {"mesh": mesh}], "contact": []})

    assert found(1.0) == []
    (notched,) = found(3.0)
    assert "at the end of a clamp at (0, 1)" in notched


def test_dundurs_numbers():
    """Of like bodies none; of a rigid one α = 1, β = (1 − 2 ν) / (2 (1 − ν)); ν = 0 has no singular flush bond."""

    def ends(modulus: float, poisson: float) -> Ends:
        return Ends(
            np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), modulus, poisson, np.zeros(0, bool)
        )

    assert mismatch([ends(1.0, 0.3), ends(1.0, 0.3)]) == pytest.approx(0.0, abs=1e-12)
    hard = mismatch([ends(1e12, 0.3), ends(1.0, 0.3)])
    assert hard == pytest.approx(1.0 - 2.0 * 0.4 / (2.0 * 0.7), rel=1e-6)
    assert mismatch([ends(3.0, 0.0), ends(1.0, 0.0)]) == pytest.approx(0.0, abs=1e-12)
    assert mismatch([ends(2.0, 0.3), ends(1.0, 0.3)]) < 2 * BOGY


def test_the_largest_stress_in_a_sliver_is_told():
    """Where a thin cell alone has it; not where a regular one does, nor where both do."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 1e-3], [0.5, 0.9]])
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 3]]), {})
    body = SimpleNamespace(mesh=mesh, spec=SimpleNamespace(name="b"))

    def found(*stress: float) -> list[str]:
        return list(_in_thin_cell(body, np.array(stress), "Pa"))

    (words,) = found(3.0, 2.0, 1.0)
    assert words.kind == "stress in a thin cell"
    assert words.startswith("body.b.mesh: the largest von Mises stress, 3 Pa, is in a thin cell at")
    assert found(1.0, 2.0, 3.0) == found(3.0, 3.0, 1.0) == []


@pytest.mark.parametrize(("elements", "largest"), [("bricks", 0.0), ("simplices", 2.0)])
def test_a_plate_that_bends_in_one_cell_is_told_the_stress_of_its_surface(elements, largest):
    """σ = 6 M / h² = 6 Pa at its surface, in the mean over a cell 0 or a third; with two cells across nothing is said,
    nor of linear elements, whose estimate tells."""

    def warned(across: int, order: int = 2) -> tuple[float, list[str]]:
        strip = {"shape": "rectangle", "size": [10.0, 1.0], "divisions": [4, across]}
        strip |= {"elements": elements, "order": order}
        block = {"name": "block", "mesh": strip, "material": {"young": 2e5, "poisson": 0.0}}
        block["clamp"] = [{"on": "left", "x": 0.0}, {"on": "left & bottom", "y": 0.0}]
        block["traction"] = [{"on": "right", "moment": 1.0}]
        summary = ddmpi.solve({"body": [block]}, MPI.COMM_SELF).summary
        told = [words for words in summary["warnings"] if "is a mean over a cell" in words]
        return summary["bodies"]["block"]["von_mises_max"], told

    of_cells, (told,) = warned(1)
    assert of_cells == pytest.approx(largest, abs=1e-8)
    assert "at nodes they are up to 6 Pa, at (0, 0); take these, or more cells across" in told
    assert warned(2)[1] == warned(1, 1)[1] == []


@pytest.mark.parametrize("past", [True, False])
def test_means_are_told_below_half_of_the_stress_at_nodes(past):
    """A strip with one cell across under m + y: squares of means are m², at nodes m² + 1, four times that at m = 1/√3."""
    middle = 3.0**-0.5 * (0.999 if past else 1.001)
    strip = {"shape": "rectangle", "origin": [0.0, -1.0], "size": [6.0, 2.0], "divisions": [2, 1]}
    block = {
        "name": "block",
        "mesh": strip | {"order": 2, "elements": "bricks"},
        "material": {"young": 2e11, "poisson": 0.3},
        "clamp": [{"on": "left", "x": 0.0}, {"on": "left & bottom", "y": 0.0}],
        "traction": [{"on": "right", "value": [f"1e6 * ({middle} + y)", 0.0]}],
    }
    warnings = ddmpi.solve({"body": [block]}, MPI.COMM_SELF).summary["warnings"]
    words = "is a mean over a cell, and within cells stresses change their sign"
    assert any(words in warning for warning in warnings) is past, warnings


@pytest.mark.parametrize(("drawn", "said"), [(True, True), (False, False)])
def test_only_a_drawing_can_be_rounded(drawn, said):
    """A mesh that is given is not: the stress beside a re-entrant corner is what is left."""
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    points = np.column_stack([x.ravel(), y.ravel()])
    squares = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (3, 4, 7), (3, 7, 6)]
    mesh = Mesh(points[:8], np.array(squares), {})
    spec = SimpleNamespace(name="b", clamps=[], mesh=SimpleNamespace(drawn=drawn))
    stress = np.array([1.0, 1.0, 1.0, 2.0, 1.0, 1.0])
    (words,) = _singular(SimpleNamespace(mesh=mesh, spec=spec), stress, "Pa")
    assert "is at a re-entrant corner at (1, 1)" in words
    assert ("round it in the drawing" in words) == said


@pytest.mark.parametrize("friction", [None, 0.2])
def test_corners_on_planes_of_symmetry_are_none(friction):
    """A quarter of a fit is round where it is cut: the whole has no corner there, the quarter no infinite stress."""
    law = {"friction": {"law": "coulomb", "coefficient": friction}} if friction else {}

    def quarter(name: str, radii: list[float], cut: list | None) -> dict:
        mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": radii, "angles": [0.0, 90.0]}
        body = {
            "name": name,
            "mesh": mesh | {"divisions": [6, 2]},
            "material": {"young": 2e11, "poisson": 0.3},
        }
        return body | ({} if cut is None else {"clamp": cut})

    planes = [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}]
    rings = {"in": [5.0, 10.0], "out": [9.99, 20.0]}
    contact = {"name": "fit", "bodies": ["in", "out"], "on": ["outer", "inner"]} | law
    scene = {"body": [quarter(*ring, planes) for ring in rings.items()], "contact": [contact]}
    solved = ddmpi.solve(scene).solved
    assert unbounded_of(solved) == set()
    # a fixed end keeps the ring from becoming thinner there
    scene["body"][0]["clamp"] = ["start"]
    solved = ddmpi.solve(scene).solved
    assert "bodies.in.von_mises_max" in unbounded_of(solved)


def unbounded_of(solved) -> set[str]:
    """The results of an answer that may have no limit on finer meshes."""
    return unbounded(solved.assembly, edges_of(solved.assembly, solved.solution.states))


@pytest.mark.every(3)
@pytest.mark.parametrize("law", [{"kind": "bonded"}, {"friction": COULOMB}], ids=["bond", "rubs"])
@pytest.mark.parametrize("around", [False, True])
@pytest.mark.parametrize(("young", "grows"), [((STEEL, STEEL), False), ((2e9, STEEL), True)])
def test_a_bar_that_a_contact_cuts_has_no_corner_there(young, grows, around, law):
    """Of one material it is one bar, also as a shaft; of a soft and a hard half its stress has no limit."""
    held = [{"on": "bottom", "y": 0.0}, *([] if around else [{"on": "left & bottom", "x": 0.0}])]
    lower = rectangle("lower", (0.0, 0.0), (1.0, 1.0), (4, 4), young=young[0], clamp=held)
    upper = rectangle("upper", (0.0, 1.0), (1.0, 1.0), (4, 4), young=young[1])
    upper["traction"] = [{"on": "top", "pressure": -1e6 if "kind" in law else 1e6}]
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | law
    scene = {"body": [lower, upper], "contact": [contact], "axisymmetric": around}
    solved = ddmpi.solve(scene).solved
    found = unbounded_of(solved)
    assert ({f"bodies.{name}.von_mises_max" for name in ("upper", "lower")} <= found) == grows
    assert bool(found) == grows


def around(number: int, cells: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The points of a regular polygon, with so many chords on every other side, and its sides, outward."""
    ends = np.exp(2j * np.pi * np.arange(number + 1) / number)
    at = np.concatenate(
        [np.linspace(*ends[k : k + 2], (1 if k % 2 else cells) + 1)[:-1] for k in range(number)]
    )
    i = np.arange(len(at))
    return np.column_stack([at.real, at.imag]), np.column_stack([i, np.roll(i, -1)])


def raised(points: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mantle of a prism two quadrilaterals high, each as two triangles."""
    n = len(points)
    solid = np.concatenate([np.column_stack([points, np.full(n, z)]) for z in range(3)])
    low = np.concatenate([sides, sides + n])
    high = low + n
    return solid, np.concatenate(
        [np.column_stack([low, high[:, 1]]), np.column_stack([low[:, 0], high[:, ::-1]])]
    )


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize(
    ("number", "cells", "corners"), [(7, 1, 0), (8, 1, 0), (6, 1, 6), (4, 1, 4), (8, 3, 8)]
)
def test_coarse_curves_have_no_corners(number, cells, corners, hollow):
    """Chords that all turn alike are a circle from seven on, in the plane and in space; chamfers of 45° are none."""
    for points, sides in (around(number, cells), raised(*around(number, cells))):
        outward = normals(points[sides]) * (-1.0 if hollow else 1.0)
        bends = creases(points, sides, outward)
        found = bends.corner
        assert found.sum() == corners * (points.shape[1] - 1)
        assert (np.sign(bends.turn[found]) == (-1.0 if hollow else 1.0)).all()


@pytest.mark.parametrize("middle", [0.5, 0.48])
def test_fillets_of_two_chords_have_no_corner(middle):
    """Their ends turn half as much as their middle, but for rounding, whichever way they lie."""
    arc = np.exp(0.5j * np.pi * np.array([0.0, middle, 1.0]))
    one = np.concatenate([[4.0 - 2.0j, 4.0 - 1.0j], 3.0 + arc, [1.0 + 1.0j, 1.0 - 2.0j]])
    i = np.arange(len(one))
    sides = np.column_stack([i, np.roll(i, -1)])
    for turn in range(13):
        at = one * np.exp(0.5j * turn)
        points = np.column_stack([at.real, at.imag])
        bends = creases(points, sides, normals(points[sides]))
        assert (np.abs(bends.turn) > SHARPEST).sum() == 4
        assert bends.corner.sum() == 3


def ring(name: str, radii: list[float], chords: int, end: float = 360.0, **keys) -> dict:
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": radii, "angles": [0.0, end]}
    material = {"young": STEEL, "poisson": 0.3}
    return {"name": name, "mesh": mesh | {"divisions": [chords, 2]}, "material": material} | keys


PRESSED = {"traction": [{"on": "inner", "pressure": 1e6}]}
HOLES = {
    "ring": [ring("a", [1.0, 2.0], 7, **PRESSED, clamp=["outer"])],
    "quarter": [
        ring(
            "a",
            [1.0, 2.0],
            2,
            90.0,
            **PRESSED,
            clamp=[{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}],
        )
    ],
    "bond": [ring("a", [1.0, 2.0], 7, **PRESSED), ring("b", [2.0, 3.0], 7, clamp=["outer"])],
}


@pytest.mark.parametrize("bodies", HOLES.values(), ids=HOLES)
def test_coarse_rings_have_finite_stresses(bodies):
    """Also a quarter of one, cut at planes of symmetry, and where two are bonded."""
    bond = {"bodies": ["a", "b"], "on": ["outer", "inner"], "kind": "bonded"}
    answer = ddmpi.solve({"body": bodies, "contact": [bond][: len(bodies) - 1]})
    assert not [words for words in answer.summary["warnings"] if "without limit" in words]
    assert unbounded_of(answer.solved) == set()


@pytest.mark.parametrize("young", [STEEL, 2e9])
def test_a_corner_inside_a_bond_is_no_end_of_it(young):
    """A square in a square hole: of one material it is one body without a corner."""
    x, y = np.meshgrid(np.arange(7.0), np.arange(7.0))
    points = np.column_stack([x.ravel(), y.ravel()]) - 3.0
    corner = np.arange(49).reshape(7, 7)[:-1, :-1].reshape(-1, 1)
    cells = np.concatenate([np.add(corner, [0, 1, 8]), np.add(corner, [0, 8, 7])])
    inside = (np.abs(points[cells].mean(axis=1)) < 1.0).all(axis=1)
    bodies = []
    for name, chosen, seam in (("peg", inside, 1.0), ("plate", ~inside, 3.0)):
        used, own = np.unique(cells[chosen], return_inverse=True)
        own = own.reshape(-1, 3)
        facets = boundary_facets(own, 2)[0]
        apart = np.abs(points[used][facets]).max(axis=2).max(axis=1)
        mesh = {"points": points[used], "cells": own}
        mesh["groups"] = {"seam": facets[apart == 1.0], "rim": facets[apart == seam]}
        material = {"young": young if name == "peg" else STEEL, "poisson": 0.3}
        bodies.append({"name": name, "mesh": mesh, "material": material})
    bodies[1]["clamp"] = [{"on": "rim", "x": "1e-3 * x", "y": 0.0}]
    bond = {"bodies": ["peg", "plate"], "on": ["seam", "seam"], "kind": "bonded"}
    answer = ddmpi.solve({"body": bodies, "contact": [bond]})
    assert not [words for words in answer.summary["warnings"] if "the end of the bond" in words]
    found = unbounded_of(answer.solved) & {
        "bodies.peg.von_mises_max",
        "contacts.peg-plate.pressure_max",
    }
    assert found == (set() if young == STEEL else {"bodies.peg.von_mises_max"})
