"""Scenes around an axis: all methods, clamps on cones, load steps, files, words. test_elsewhere has random ones."""

import numpy as np
import pytest
from elsewhere import Elsewhere, assert_same, found
from mpi4py import MPI
from scenes import COULOMB, FLOOR, certified, rectangle

import ddmpi

TIGHT = {"method": {"tolerance": 1e-12}}


def disc(
    name: str, y: float, divisions: tuple[int, int], order: int = 1, inner: float = 0.0, **more
) -> dict:
    """A disc 1 m high from the radius `inner` to 2 m, with its bottom at y."""
    return rectangle(name, (inner, y), (2.0 - inner, 1.0), divisions, order, **more)


def pressed(
    order: int = 1, law: dict | None = None, loose: bool = False, inner: float = 0.0, **contact
) -> dict:
    """Two discs of unlike stiffness, the upper one pressed at its rim; the lower one held, or loose on a floor."""
    lower = {} if loose else {"clamp": ["bottom"]}
    scene = {
        "axisymmetric": True,
        "body": [
            disc("upper", 1.0, (6, 3), order, inner, traction=[{"on": "top", "pressure": 1e6}]),
            disc("lower", 0.0, (7, 4), order, inner, **lower),
        ],
    }
    scene["body"][1]["material"] = {"young": 3e9, "poisson": 0.2}
    scene["contact"] = [
        {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": law or COULOMB}
        | contact
    ]
    if loose:
        scene["rigid"] = [FLOOR]
        scene["contact"].append(
            {"bodies": ["lower", "floor"], "on": ["bottom"], "friction": COULOMB}
        )
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("order, more", [(2, {}), (1, {"loose": True})], ids=["held", "loose"])
def test_multigrid_knows_the_motion_along_the_axis(order, more):
    """Products by multigrid give the answer of dense compliances."""
    scene = pressed(order, **more)
    assert_same(
        found(scene | TIGHT),
        found(scene | {"method": {"tolerance": 1e-10, "compliance": "iterative"}}),
        within=1e-6,
    )


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_published_iteration(comm):
    """The published iteration and its Anderson form find what Newton's method finds."""
    scene = pressed(2)
    scene["body"][0]["clamp"] = [{"on": "top", "y": -1e-3, "x": 0.0}]
    force = certified(scene | TIGHT).summary["contacts"]["upper-lower"]["force"]
    for method in ({"outer": "relaxation", "theta": 0.2}, {"outer": "anderson"}):
        other = certified(scene | {"method": method | {"tolerance": 1e-8}}, comm)
        assert other.summary["contacts"]["upper-lower"]["force"] == pytest.approx(force, rel=1e-4)


def test_a_clamp_along_the_normal_is_a_cone_without_friction():
    """A ring that slides on a cone by a clamp along the normal moves as on a rigid cone that it is pressed onto."""
    ring = {
        "name": "ring",
        "material": {"young": 1e9, "poisson": 0.3},
        "traction": [{"on": "top", "pressure": 1e6}],
        "mesh": {
            "shape": "quadrilateral",
            "corners": [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.6, 1.0]],
            "divisions": [5, 5],
            "order": 2,
        },
    }
    cone = {"name": "cone", "shape": "plane", "point": [1.0, 0.0], "normal": [1.0, 0.4]}
    scene = {
        "axisymmetric": True,
        "body": [ring],
        "rigid": [cone, FLOOR | {"point": [0.0, -9.0]}],
        "contact": [{"bodies": ["ring", "cone"], "on": ["left"]}],
    } | TIGHT
    one = certified(scene)
    clamped = ring | {"clamp": [{"on": "left", "normal": 0.0}]}
    other = certified(
        scene | {"body": [clamped], "contact": [{"bodies": ["ring", "floor"], "on": ["bottom"]}]}
    )
    assert one.summary["contacts"]["ring-cone"]["open"] == 0
    u = one.bodies["ring"].displacement
    assert other.bodies["ring"].displacement == pytest.approx(u, abs=1e-9 * np.abs(u).max())
    reaction = other.summary["bodies"]["ring"]["reactions"]["left"]["force"]
    assert reaction == pytest.approx(one.summary["contacts"]["ring-cone"]["force"], rel=1e-8)


@pytest.mark.parametrize("length", [1.0, 0.3, 1e9])
def test_a_row_that_half_moves_is_kept_in_all_units(length):
    """The slave's node on the axis faces one that is held there and, half as far as its neighbour, one that is not."""
    scene = pressed(pairing="mortar", slave="lower")
    scene["body"][0]["mesh"]["divisions"], scene["body"][1]["mesh"]["divisions"] = [4, 2], [2, 1]
    assert found(Elsewhere(length=length).scene(scene)).summary["contacts"]["upper-lower"]["m"] == 3


@pytest.mark.slow
def test_clamping_the_axis_is_needless():
    """With and without a clamp at x = 0 the answer is the same, to the last bit, and that clamp bears nothing."""
    scene = pressed(2)
    one = certified(scene)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0}]
    other = certified(scene)
    assert np.array_equal(one.bodies["upper"].displacement, other.bodies["upper"].displacement)
    assert other.summary["bodies"]["upper"]["reactions"]["left"]["force"] == [0.0, 0.0]


@pytest.mark.slow
def test_target_error_refines_the_meshes():
    """An accuracy target is met by meshes that stay around the axis."""
    scene = pressed(2, law={"law": "none"}) | {"method": {"target_error": 0.003}}
    scene["body"][0]["traction"][0]["pressure"] = "1e6 * x"
    scene["body"][1]["clamp"] = [{"on": "bottom", "y": 0.0}]
    answer = certified(scene)
    assert answer.summary["discretization_error"]["energy_norm"] <= 0.003
    assert len(answer.summary["discretization_error"]["levels"]) > 1
    assert answer.summary["contacts"]["upper-lower"]["normal_force"] == pytest.approx(
        2 * np.pi * 8 / 3 * 1e6
    )


@pytest.mark.clarabel
def test_what_slides_along_the_axis_is_named():
    """A sleeve without friction on a shaft can move along y; a load along y then has no equilibrium."""
    scene = pressed(inner=0.5)
    scene["body"] = [disc("shaft", 0.0, (4, 4)), disc("sleeve", 0.0, (4, 4), inner=2.0)]
    scene["body"][0]["clamp"] = ["bottom"]
    scene["body"][1]["mesh"] |= {"origin": [2.0, 0.0], "size": [1.0, 1.0]}
    scene["contact"] = [{"bodies": ["shaft", "sleeve"], "on": ["right", "left"], "gap": -1e-4}]
    answer = certified(scene)
    (held,) = answer.summary["held_motions"]
    assert held["motion"] == "sleeve can move along y without any force"
    scene["body"][1]["volume_force"] = [0.0, -1e3]
    failed = ddmpi.solve(scene, MPI.COMM_SELF)
    assert failed.reason == "no equilibrium: sleeve would move along -y"


@pytest.mark.parametrize("partner", [(24, 4), (19, 4), None], ids=["pairs", "mortar", "rigid"])
def test_rows_on_the_axis_are_merged(partner):
    """With those of the next nodes, on arcs of order 2: the pressure between balls is constant up to the poles."""

    def shell(name, radii, divisions):
        return {
            "name": name,
            "material": {"young": 1e9, "poisson": 0.3},
            "mesh": {
                "shape": "annulus",
                "center": [0.0, 0.0],
                "radii": radii,
                "angles": [-90, 90],
                "divisions": list(divisions),
                "order": 2,
            },
        }

    scene = {"axisymmetric": True, "body": [shell("ball", [1.0, 2.0], (24, 4))]} | TIGHT
    contact = {"bodies": ["ball", "shell"], "on": ["outer", "inner"], "gap": -1e-4}
    if partner:
        scene["body"].append(shell("shell", [2.0, 3.0], partner))
    else:
        contact = {"bodies": ["ball", "shell"], "on": ["outer"], "gap": -1e-4}
        scene["rigid"] = [
            {
                "name": "shell",
                "shape": "circle",
                "center": [0.0, 0.0],
                "radius": 2.0,
                "inside": True,
            }
        ]
    scene["contact"] = [contact]
    state = certified(scene).contacts["ball-shell"]
    lines = state.interface.lines
    ends = np.flatnonzero(lines.xy[:, 0] == 0.0)
    assert len(ends) == 2 and len(lines.row) == state.interface.m + 2
    assert (np.bincount(lines.row)[lines.row[ends]] == 2).all()
    assert state.pressure[lines.row[ends]] == pytest.approx(state.pressure.mean(), rel=0.02)
