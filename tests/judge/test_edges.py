"""Largest stresses that grow without limit with finer meshes: at sharp corners in contact, and at ends of bonds."""

from types import SimpleNamespace

import numpy as np
import pytest
from scenes import COULOMB, FLOOR, certified, rectangle
from solid_scenes import box

from ddmpi.judge.edges import BOGY, Ends, mismatch
from ddmpi.judge.plausible import _in_thin_cell, _singular
from ddmpi.mesh.mesh import Mesh

SOFT, STEEL = 1e9, 2e11


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
    lower = rectangle("lower", (0.0, 0.0), (3.0, 1.0), (24, 4), young=young[1], clamp=["bottom"])
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
    block["clamp"] = [{"on": "top", "y": -1e-4, "x": "1e-5 * x"}]
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


def test_dundurs_numbers():
    """Of like bodies none; of a rigid one α = 1, β = (1 − 2 ν) / (2 (1 − ν)); ν = 0 has no singular flush bond."""

    def ends(modulus: float, poisson: float) -> Ends:
        return Ends(np.zeros((0, 2, 2)), np.zeros(0), modulus, poisson)

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
    assert words.startswith("body.b.mesh: the largest von Mises stress, 3 Pa, is in a thin cell at")
    assert found(1.0, 2.0, 3.0) == found(3.0, 3.0, 1.0) == []


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
