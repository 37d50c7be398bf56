"""Directions by dense factors solve the linear problem of a step, and end the long way between slender bodies."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import COULOMB, FLOOR, certified, pinched_blocks, prepare_scene, rectangle, seldom
from solid_scenes import HELD, box

from ddmpi.coupling.joint import Point
from ddmpi.methods.krylov import Linearised, Regularisation
from ddmpi.methods.newton import Newton


def blocks() -> dict:
    """Clamped blocks, in the plane."""
    return pinched_blocks(3)


def stack(make=rectangle) -> dict:
    """A loose body upon a loose one upon a floor, pressed and pushed aside."""
    d = 2 if make is rectangle else 3
    up, unit = np.eye(d)[-1], (1.0,) * d
    load = [{"on": "top", "value": (-1e6 * up + 2e5 * np.eye(d)[0]).tolist()}]
    return {
        "body": [
            make("upper", tuple(up), unit, (2,) * d, traction=load),
            make("lower", (0.0,) * d, unit, (3,) * d),
        ],
        "rigid": [FLOOR if d == 2 else FLOOR | {"point": [0.0] * d, "normal": up.tolist()}],
        "contact": [
            {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": COULOMB},
            {"bodies": ["lower", "floor"], "on": ["bottom"], "friction": COULOMB},
        ],
    }


SCENES = pytest.mark.parametrize(
    "scene", [blocks, stack, lambda: stack(box)], ids=["blocks", "loose", "loose in space"]
)


def question(newton: Newton) -> tuple:
    """The arguments of a direction from a point near the answer, at a random layer and right-hand side."""
    joint, rng = newton.joint, np.random.default_rng(5)
    assert newton.run(1e-8) == "converged" and not newton.direct.long
    spread = (0.7, 1.3) if joint.rigid.size else (0.2, 2.0)
    point = newton._at.point._replace(s=newton.forces * rng.uniform(*spread, joint.size))
    point = point._replace(
        r=joint.product(point.s, "newton") - joint.d - joint.rigid.spread(point.alpha),
        left=joint.imbalance(point.s, point.alpha),
    )
    laws, c = joint.space.laws, newton.preconditioner.c
    linearised = Linearised.of(laws.linearise(laws.active_sets(point.s - c * point.r)))
    assert linearised.coupling.any() and (joint.space.interfaces[0].dimension == 2) == (
        linearised.turn is None
    )
    layer = rng.uniform(0.0, 1.0, joint.size) / c
    move, wanted = linearised.move(point.s), rng.standard_normal(joint.size) * np.abs(joint.d).max()
    return point, linearised, move, wanted, layer


def check(newton: Newton, asked: tuple, change: Point, precision: float) -> None:
    """r + D y is what is wanted along unknown forces, loose bodies are in balance, and gaps are those of the forces."""
    joint, (point, linearised, move, wanted, layer) = newton.joint, asked
    found = point.along(change, 1.0)
    assert found.r == pytest.approx(
        joint.product(found.s, "newton") - joint.d - joint.rigid.spread(found.alpha),
        abs=1e-9 * np.abs(found.r).max(),
    )
    y = linearised.restrict(found.s - point.s - move)
    left = linearised.restrict(found.r - wanted) + layer[linearised.unknown] * y
    assert np.abs(left).max() < precision * np.abs(wanted).max()
    assert np.abs(found.left).max(initial=0.0) < precision * np.abs(found.s).max()
    assert linearised.expand(y) == pytest.approx(change.s - move, abs=1e-9 * np.abs(found.s).max())


@SCENES
def test_a_direction_by_gmres_solves_its_equations(scene):
    """As precisely as the forcing says, 1e-3."""
    newton = Newton(prepare_scene(MPI.COMM_SELF, scene()).joint, 60)
    asked = question(newton)
    check(newton, asked, newton.direction(*asked, Regularisation()), 1e-2)


@SCENES
def test_a_direct_direction_solves_its_equations(scene):
    """To rounding, and its products are counted."""
    newton = Newton(prepare_scene(MPI.COMM_SELF, scene()).joint, 60)
    joint, asked = newton.joint, question(newton)
    assert newton.direct.direction(*asked, Regularisation()) is None  # GMRES is cheap here
    newton.direct.steps, before = True, joint.multiplications()
    change = newton.direct.direction(*asked, Regularisation())
    assert change is not None
    assert joint.multiplications() == before + 2 * len(joint.members)
    check(newton, asked, change, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("cells", [seldom((2, 2, 30)), (1, 1, 29)])
def test_needles_side_by_side_take_few_steps(cells):
    """Quadratic needles of 1 : 100: ten steps at most, once GMRES has shown by 300 iterations how slender they are."""
    size, load = (0.01, 0.01, 1.0), 60.0
    needles = [
        box(
            "upper",
            (0.01, 0, 0),
            size,
            (2, 2, 30),
            2,
            clamp=[{"on": "bottom"} | HELD],
            traction=[{"on": "right", "value": [-load, 0.1 * load, 0.0]}],
        ),
        box("lower", (0, 0, 0), size, cells, 2, clamp=[{"on": "bottom"} | HELD]),
    ]
    contact = {"bodies": ["upper", "lower"], "on": ["left", "right"], "friction": COULOMB}
    summary = certified(
        {"body": needles, "contact": [contact], "output": {"stress": False}}
    ).summary
    assert summary["outer_iterations"] <= 10 and 40 < summary["inner_iterations"] <= 300
