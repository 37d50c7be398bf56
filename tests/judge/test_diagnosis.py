"""What is seen of an iteration that ends without an answer, and what is then worth a try."""

from types import SimpleNamespace

import numpy as np
import pytest
from scenes import COULOMB, FLOOR, pinched_blocks, rectangle, to_toml

from ddmpi.coupling.space import Space
from ddmpi.judge.diagnosis import LOOK_BACK, StatusLog, contraction, diagnose, fitting, helpful
from ddmpi.methods.outer import Step
from ddmpi.scene.reader import read_scene


def steps(*updates: float, residual: float = 1e-3) -> list[Step]:
    return [Step(k, update, residual, 1e-3, 2 * k) for k, update in enumerate(updates, 1)]


def log(*codes: list[int], closed: tuple[int, int, int] = (1, 2, 3)) -> StatusLog:
    """Of three nodes with friction, with their status in the last iterations."""
    found = StatusLog(Space([]))
    found.restore({"recent": [np.array(code) for code in codes], "counts": (closed,)})
    found.frictionless, found.largest_slope = False, 0.3
    found.xy = [np.array([k, 0.5]) for k in range(3)]
    return found


def test_the_factor_of_an_iteration_is_that_of_its_last_steps():
    """Of a geometric sequence exactly, whatever came before; of two steps, and beside a zero, none is known."""
    assert contraction(steps(*(0.7**k for k in range(6)))) == pytest.approx(0.7)
    early = [1e-12] * 3
    late = [0.9**k for k in range(LOOK_BACK + 1)]
    assert contraction(steps(*early, *late)) == pytest.approx(0.9)
    assert contraction(steps(*early, *late[:-1])) != pytest.approx(0.9, rel=0.01)
    assert contraction(steps(1.0, 0.5, 0.25)) == pytest.approx(0.5)
    assert contraction(steps(1.0, 0.5, 0.25, residual=2.0), "residual") == pytest.approx(1.0)
    for unknown in ((1.0, 0.5), (1.0, 0.5, 0.0), (1.0, np.inf, 0.1), ()):
        assert np.isnan(contraction(steps(*unknown)))


def test_nodes_that_change_and_cycles_are_seen():
    a, b, c = [0, 1, 1], [0, 1, 11], [1, 1, 1]
    assert log(a).unsettled().tolist() == log().unsettled().tolist() == []
    assert log(a, a).unsettled().tolist() == []
    assert log(a, b, b).unsettled().tolist() == [2]
    assert log(c, b).unsettled().tolist() == [0, 2]
    assert log(a, b, a).cycles() and log(b, a, b, a).cycles()
    assert not log(a, a).cycles() and not log(a, b).cycles() and not log(a, b, c).cycles()
    assert not log(b, a, a).cycles()
    cleared = log(a, b)
    cleared.clear()
    assert cleared.counts == [] and not len(cleared.unsettled())


def scene_of(data: dict):
    return read_scene("scene of a test", to_toml(data))


def test_what_a_scene_allows():
    """Less friction where nodes may slide, Anderson's method of two supported bodies with one contact that has friction,
    and what an option makes too coarse."""
    two = pinched_blocks(2)
    assert helpful(scene_of(two)) == {"friction", "anderson"}
    assert helpful(scene_of(two), ["newton_ksp_rtol"]) == {"friction", "anderson", "precision"}
    assert helpful(scene_of(two), ["newton_ksp_rtol"], slender=True) == {"precision"}
    assert helpful(scene_of(two), ["mat_mumps_icntl_14"]) == {"friction", "anderson"}
    assert helpful(scene_of(pinched_blocks(2, "none"))) == set()
    loose = pinched_blocks(2)
    del loose["body"][0]["clamp"]
    assert helpful(scene_of(loose)) == {"friction"}
    steady = pinched_blocks(2) | {"time": {"points": [1.0]}}
    assert helpful(scene_of(steady)) == {"friction"}
    block = rectangle("block", (0.0, 0.0), (1.0, 1.0), (1, 1), clamp=["top"])
    contact = {"bodies": ["block", "floor"], "on": ["bottom"], "friction": COULOMB}
    assert helpful(scene_of({"body": [block], "rigid": [FLOOR], "contact": [contact]})) == {
        "friction"
    }
    bond = {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "kind": "bonded"}
    assert helpful(scene_of(two | {"contact": [bond]})) == set()


A, B = [0, 1, 1], [0, 1, 11]
ALL = {"friction", "anderson", "precision"}


@pytest.mark.parametrize(
    ("stopped", "factor", "codes", "closed", "expected"),
    [
        ("max_iterations", 0.9, (A, A), (0, 2, 3), {"iterations", "precision"}),
        ("max_iterations", np.nan, (A, A), (0, 2, 3), {"iterations", "precision"}),
        ("max_iterations", 0.98, (A, A), (0, 2, 3), {"iterations", "precision"}),
        ("max_iterations", 0.99, (A, A), (0, 2, 3), {"precision"}),
        ("stalled", 0.9, (A, A), (0, 2, 1), {"precision"}),
        ("stalled", 0.9, (A, B), (0, 2, 2), {"friction", "anderson", "mesh"}),
        ("stalled", 0.9, (A, B), (0, 2, 3), {"friction", "anderson"}),
        ("stalled", 0.9, (A, B), (9, 0, 0), {"friction", "anderson"}),
        ("diverged", 0.9, (A, B), (0, 2, 1), {"friction", "anderson"}),
    ],
)
def test_what_fits_how_a_run_has_ended(stopped, factor, codes, closed, expected):
    seen = log(*codes, closed=closed)
    history = steps(1.0, 0.5)
    assert fitting(ALL, stopped, history, factor, seen) == expected
    assert fitting((), stopped, history, factor, seen) == expected - ALL
    seen.frictionless = True
    assert fitting(ALL, stopped, history, factor, seen) == expected - {"friction"}
    still = steps(1.0, 0.0)
    assert fitting(ALL, stopped, still, factor, seen) == expected - {"friction", "anderson"}


def test_a_message_says_how_it_went():
    """What is seen, where nodes change, and what to try; beside rounding only a larger tolerance."""
    told: list[tuple] = []

    def advice(*given) -> str:
        told.append(given)
        return "this"

    method = SimpleNamespace(tolerance=1e-8, criterion="update", diverging="too far", advice=advice)
    many = log(A, B, A)
    words = diagnose("why", "stalled", ["x"], method, steps(1.0, 0.5, 0.25), many, ALL)
    assert words.splitlines() == [
        "why (iteration 3, update 2.5e-01, residual 1.0e-03, asked for 1e-08)",
        "  the certificate fails: x",
        "  seen: convergence, a factor of 0.500 per iteration over the last 2",
        "  1 of 3 nodes changed between open, slip and stick in a cycle, at (2, 0.5)",
        "  try: this",
    ]
    ((stopped, factor, iteration, update, fits),) = told
    assert (stopped, iteration, update, fits) == ("stalled", 3, 0.25, {"friction", "anderson"})
    assert factor == pytest.approx(0.5)

    def seen(*updates: float, how: str = "stalled", **keys: float) -> str:
        return diagnose("why", how, [], method, steps(*updates, **keys), log(A, A))

    for factor, said in ((0.7, "convergence"), (0.71, "slow convergence"), (0.99, "no progress")):
        assert f"seen: {said}, a factor" in seen(1.0, factor, factor**2)
    assert "seen: no progress" in seen(1.0, 1.02, 1.02**2 - 1e-9)
    assert "seen: growth" in seen(1.0, 1.03, 1.03**2)
    assert "seen: too far" in seen(1.0, 0.5, 0.25, how="diverged")
    assert "seen" not in seen(1.0, 0.5)
    rounding = seen(1.0, 0.5, 0.25, residual=1e-15)
    assert "the forces no longer change, rounding is reached" in rounding
    assert rounding.endswith(
        "try: a larger method.tolerance; double precision allows no smaller one"
    )
    assert seen(1.0, 0.5, 0.0).endswith("seen: the forces no longer change\n  try: this")
    steep = log(A, A)
    steep.largest_slope = 1.0
    assert "friction coefficient of 1 a" in diagnose("", "", [], method, steps(1.0), steep)
    known = diagnose("", "", [], method, steps(1.0), log(A, A), precision=("beam", 2e-5))
    assert known.endswith("method.tolerance = 3.0e-05, the least that double precision allows here")
    assert "beam yields so much more" in known
