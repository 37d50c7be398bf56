"""The default method: its preconditioner, what it computes and what it leaves alone, how it ends, what it says."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sparse
from mpi4py import MPI
from scenes import (
    joint_compliance,
    pinched_blocks,
    prepare_scene,
    rectangle,
    run_here,
    the_interface,
    to_toml,
    write_scene,
)
from solid_scenes import two_boxes

import ddmpi
from ddmpi.coupling.space import Space
from ddmpi.errors import SolverError
from ddmpi.interface.interface import Geometry, Interface, Places
from ddmpi.interface.law import CoulombLaw
from ddmpi.judge.diagnosis import StatusLog, diagnose
from ddmpi.methods.half_space import HalfSpace, Model
from ddmpi.methods.krylov import forcing
from ddmpi.methods.newton import Newton
from ddmpi.methods.paths import InteriorPoints, Softening
from ddmpi.scene.method import Method
from ddmpi.surface.side import laplacian

MODULUS = 3e11


# The preconditioner


def interface(x, sliding: list[int], dropped: int = 0, area=None) -> Interface:
    """Contact nodes along y = 0 at `x`; nodes more than twice as far apart as others belong to two chains."""
    x, sliding = np.array(x), np.array(sliding, dtype=int)
    steps = np.diff(x)
    edges = np.where(steps < 2.0 * np.median(steps), steps, 0.0) if area is None else steps
    if area is None:
        area = 0.5 * (np.append(edges, 0.0) + np.insert(edges, 0, 0.0))
        if dropped:  # the first node's neighbour is clamped
            area[0] += 0.5 * edges[0]
    m, nodes = len(x), np.arange(len(x))
    alone, segments = (
        sparse.identity(m, format="csr"),
        np.column_stack([nodes[:-1], nodes[1:]])[edges > 0.0],
    )
    places, row = np.append(x, 2 * x[0] - x[min(1, m - 1)]), np.append(nodes, -1)
    beside = np.array([[0, m]])[: dropped if m > 1 else 0]
    xy, ends = (np.column_stack([along, np.zeros(len(along))]) for along in (x, places))
    return Interface(
        name="upper-lower",
        bodies=("upper", "lower"),
        geometry=Geometry(
            xy=xy,
            tangents=np.tile([1.0, 0.0], (m, 1, 1)),
            area=area,
            at=(xy, xy),
            facets=segments,
            laplacian=laplacian(ends, np.concatenate([segments, beside]), row, m),
        ),
        rows=Places((nodes, nodes), np.tile([0.0, -1.0], (m, 1)), np.zeros(m), (alone, alone)),
        law=CoulombLaw(m, sliding, 1, np.full(len(sliding), 0.3)),
        modulus=MODULUS,
        fixed=Places(gap=np.zeros(dropped)),
    )


def shaped(contact: Interface, **changes: object) -> Interface:
    """The interface with another geometry."""
    return replace(contact, geometry=replace(contact.geometry, **changes))


def dense_stiffness(contact, modulus: float) -> np.ndarray:
    """(E*/2) L^½ (L^-½ K L^-½ + (1.5/total)²)^½ L^½ for each kind of unknown, the root by eigenvectors.

    K is the stiffness of a chain of springs 1/distance, the neighbour that was dropped held fast; L the diagonal of
    nodal lengths.
    """
    x, length, m = contact.xy[:, 0], contact.area, contact.m
    K = np.zeros((m, m))
    for k, distance in enumerate(np.diff(x)):
        if distance < 1.01 * (length[k] + length[k + 1]):
            K[k : k + 2, k : k + 2] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / distance
    if len(contact.fixed.gap):
        K[0, 0] += 1.0 / (x[1] - x[0])
    A = K / np.sqrt(np.outer(length, length)) + (1.5 / length.sum()) ** 2 * np.eye(m)
    values, vectors = np.linalg.eigh(A)
    block = (
        0.5
        * modulus
        * np.sqrt(np.outer(length, length))
        * ((vectors * np.sqrt(values)) @ vectors.T)
    )
    P = np.zeros((contact.size, contact.size))
    P[:m, :m] = block
    P[m:, m:] = block[np.ix_(contact.sliding, contact.sliding)]
    return P


def columns(operator, size: int) -> np.ndarray:
    return np.column_stack([operator.mult(unit) for unit in np.eye(size)])


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-9, 1e6])
@pytest.mark.parametrize(
    ("x", "sliding", "dropped"),
    [
        (np.linspace(0, 3, 40), range(40), 0),
        (np.linspace(0, 3, 60), range(60), 0),
        (np.linspace(0, 3, 40)[1:], range(39), 1),
        (np.linspace(0, 3, 25), [*range(3, 12), *range(15, 25)], 0),
        (np.linspace(0, 3, 25), [], 0),
        (np.linspace(0, 1, 30) ** 1.5, range(30), 0),
        ([*np.linspace(0, 1, 12), *np.linspace(2, 3, 12)], range(24), 0),
        ([0.0, 1.0], [0, 1], 0),
    ],
    ids=[
        "even",
        "sparse",
        "first node dropped",
        "some slide",
        "no friction",
        "graded",
        "two chains",
        "two nodes",
    ],
)
def test_half_space_is_the_square_root(x, sliding, dropped, scale):
    contact = interface([scale * value for value in x], list(sliding), dropped)
    P, expected = (
        columns(HalfSpace(Space([contact])), contact.size),
        dense_stiffness(contact, MODULUS),
    )
    assert np.linalg.norm(P - expected, 2) <= 1e-3 * np.linalg.norm(expected, 2)
    assert np.linalg.norm(np.linalg.solve(expected, P) - np.eye(contact.size), 2) <= 1e-3
    assert np.abs(P - P.T).max() <= 1e-12 * np.abs(P).max()
    assert np.linalg.eigvalsh((P + P.T) / 2).min() > 0.0


@pytest.mark.parametrize("delta", [0.0, 0.01, 1.0, 1e3])
def test_half_space_behind_a_layer(delta):
    """(1 + δ)(M⁻¹ + δ/c)⁻¹, also where the layer is thinner than an element, or thicker than the interface is long."""
    contact = interface(np.linspace(0, 3, 40), range(40))
    contact = shaped(contact, area=np.full(40, contact.area.mean()))
    M = dense_stiffness(contact, MODULUS)
    layer = np.diag(delta / contact.stiffness)
    expected = (1.0 + delta) * np.linalg.inv(np.linalg.inv(M) + layer)
    P = columns(HalfSpace(Space([contact])).softened([delta]), contact.size)
    assert np.linalg.norm(P - expected, 2) <= 0.1 * np.linalg.norm(expected, 2)
    assert np.linalg.norm(np.linalg.solve(expected, P) - np.eye(contact.size), 2) <= 0.2


@pytest.mark.parametrize("start", [0, 5])
def test_half_space_of_a_closed_chain(start):
    """A ring has no ends: wherever its numbers begin, its stiffness is the same, that of its Fourier modes."""
    m, radius = 24, 2.0
    angle = 2 * np.pi * (np.arange(m) + start) / m
    chord = 2 * radius * np.sin(np.pi / m)
    xy, nodes = radius * np.column_stack([np.cos(angle), np.sin(angle)]), np.arange(m)
    around = laplacian(xy, np.column_stack([nodes, np.roll(nodes, -1)]), nodes, m)
    ring = shaped(interface(nodes, nodes), xy=xy, area=np.full(m, chord), laplacian=around)
    P = columns(HalfSpace(Space([ring])), 2 * m)[:m, :m]
    assert np.roll(P, (1, 1), (0, 1)) == pytest.approx(P, rel=1e-10)
    waves = np.hypot(2 * np.sin(np.pi * np.arange(m) / m) / chord, 1.5 / (m * chord))
    assert np.fft.fft(P[0]).real == pytest.approx(0.5 * MODULUS * chord * waves, rel=1e-3)


def test_half_space_of_one_node():
    """Its only neighbour, 0.5 m away, is clamped."""
    one = shaped(
        interface([0.0], [0], 1, area=np.array([0.25])), laplacian=sparse.csr_matrix([[2.0]])
    )
    expected = 0.5 * MODULUS * 0.25 * math.hypot(1.5 / 0.25, math.sqrt(1.0 / (0.5 * 0.25)))
    assert columns(HalfSpace(Space([one])), 2) == pytest.approx(expected * np.eye(2), rel=1e-3)


def test_interfaces_do_not_see_each_other_in_the_preconditioner():
    """The preconditioner of two interfaces has their two blocks on its diagonal and nothing beside them."""
    one, two = interface(np.linspace(0, 3, 5), range(5)), interface(np.linspace(0, 1, 4), [1, 2])
    both = columns(HalfSpace(Space([one, replace(two, name="other")])), one.size + two.size)
    parts = [columns(HalfSpace(Space([each])), each.size) for each in (one, two)]
    beside = scipy.linalg.block_diag(*(np.ones_like(part) for part in parts)) == 0.0
    assert not both[beside].any()
    alone = scipy.linalg.block_diag(*parts)
    assert both == pytest.approx(alone, rel=0.0, abs=1e-13 * np.abs(alone).max())


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_preconditioned_compliance_is_well_conditioned_at_every_h_and_contrast(comm, order):
    for contrast in (1.0, 1e4):
        conditions = []
        for N in (6, 24):
            scene = pinched_blocks(N // order)
            scene["body"][0]["material"]["young"] *= contrast
            for body in scene["body"]:
                body["mesh"]["order"] = order
            assembly = prepare_scene(comm, scene)
            C, P = joint_compliance(assembly), HalfSpace(Space([the_interface(assembly)]))
            values = np.linalg.eigvals(np.column_stack([P.mult(column) for column in C.T]))
            assert np.abs(values.imag).max() <= 1e-9 * np.abs(values).max()
            conditions.append(values.real.max() / values.real.min())
        assert max(conditions) < 1.2 * min(conditions), (
            conditions
        )  # that of C alone grows four times
        assert conditions[-1] < 0.05 * np.linalg.cond(C)


@pytest.mark.slow
def test_the_preconditioner_knows_waves_within_quadratic_facets():
    """Quadratic tetrahedra: but for eight long waves C M has eigenvalues about 1, also for the rows at clamps."""
    assembly = prepare_scene(MPI.COMM_SELF, two_boxes(4, 4, 2))
    C, joint = joint_compliance(assembly), assembly.joint
    few = []  # of the local compliances, and as if all were alike
    for local in (joint.local(), np.ones(joint.size)):
        P = columns(HalfSpace(joint.space, local), joint.size)
        few.append(np.sort(np.linalg.eigvals(C @ P).real)[:-8])
    assert few[0].max() < 3.0 and few[0].min() > 0.05 and 0.7 < np.median(few[0]) < 1.1
    assert few[0].max() / few[0].min() < 0.5 * few[1].max() / few[1].min()
    clamped = joint.local()
    clamped[:3] = 0.0  # as of a node that is clamped on both sides
    half_space = HalfSpace(joint.space, clamped)
    x = np.random.default_rng(0).standard_normal(joint.size)
    assert half_space.mult(half_space.mult(x), inverse=True) == pytest.approx(x, rel=1e-2, abs=1e-2)


# The methods


def solve(assembly, **method):
    from ddmpi.run.solve import solve
    from ddmpi.scene.method import Method

    return solve(assembly, Method(**method).settled())


@pytest.mark.slow
def test_only_what_the_scene_requires_is_multiplied():
    """Without friction there are m unknowns and fewer products; without loads no products at all."""
    smooth, unloaded = pinched_blocks(6, "none"), pinched_blocks(6)
    for body in unloaded["body"]:
        body["traction"] = []
    counts = {}
    for name, scene in (("rough", pinched_blocks(6)), ("smooth", smooth), ("unloaded", unloaded)):
        assembly = prepare_scene(MPI.COMM_SELF, scene)
        answer = solve(assembly)
        assert answer.certified and answer.outer.forces.any() == (name != "unloaded")
        assert len(answer.outer.forces) == assembly.m * (1 if name == "smooth" else 2)
        counts[name] = sum((body.member.C.count for body in assembly.bodies), start=Counter())
    assert set(counts["rough"]) <= {"load", "newton", "displacement"} and not counts["unloaded"]
    assert (counts["rough"]["load"], counts["rough"]["displacement"]) == (2, 2)
    assert counts["smooth"]["newton"] < counts["rough"]["newton"]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "word"), [(Softening, "layer"), (InteriorPoints, "barrier")])
def test_each_path_alone_leads_to_the_same_answer(comm, monkeypatch, path, word):
    """Newton's method is left before its first step: softening, or interior points, have to do it."""
    for law in ("coulomb", "tresca", "none"):
        assembly = prepare_scene(comm, pinched_blocks(6, law))
        usual = solve(assembly).outer
        with monkeypatch.context() as patch:
            patch.setattr("ddmpi.methods.newton.PATIENCE", 0)
            patch.setattr("ddmpi.methods.newton.PATHS", (path,))
            answer = solve(assembly)
            outer = answer.outer
        assert answer.certified, (law, answer.reason)
        assert [step.stage.split()[0] for step in outer.history if step.stage][:4] == [word] * 4
        assert len(outer.history) <= 25
        assert outer.forces == pytest.approx(
            usual.forces, rel=1e-5, abs=1e-6 * np.abs(usual.forces).max(initial=0.0)
        )


# What is said of a run that fails


def line(m: int, coefficient: float = 0.5) -> Space:
    """One interface of m nodes at (0, 1), (1, 1), …"""
    contact = interface(np.arange(float(m)), range(m), area=np.ones(m))
    law = replace(contact.law, coefficient=np.full(m, coefficient))
    contact = shaped(contact, xy=contact.xy + np.array([0.0, 1.0]))
    return Space([replace(contact, law=law)])


def recorded(*statuses: str, coefficient: float = 0.5) -> StatusLog:
    """A log of iterations with a letter per node: open, stick, slip to the right or left."""
    log = StatusLog(line(len(statuses[0]) if statuses else 3, coefficient))
    for letters in statuses:
        normal = np.array([0.0 if letter == "o" else 2.0 for letter in letters])
        tangential = np.array(
            [{"o": 0.0, "s": 0.1, "r": 1.0, "l": -1.0}[letter] for letter in letters]
        )
        log.record(np.concatenate([normal, tangential]), 0.5 * normal)
    return log


@pytest.mark.parametrize(
    ("statuses", "cycles", "unsettled"),
    [
        ([], False, []),
        (["osr"], False, []),
        (["osr", "osr", "osr"], False, []),
        (["ooo", "osr", "osr"], False, [1, 2]),
        (["osr", "osl", "osr"], True, [2]),
        (["osr", "ssr", "srr", "osr"], True, [0, 1]),
        (["osr", "srr", "rrr"], False, [0, 1]),
        (["oos", *["osr"] * 10], False, []),
    ],
    ids=[
        "nothing",
        "one",
        "settled",
        "settled later",
        "two-cycle",
        "three-cycle",
        "moving on",
        "long settled",
    ],
)
def test_status_log(statuses, cycles, unsettled):
    log = recorded(*statuses)
    assert log.cycles() is cycles
    assert log.unsettled().tolist() == unsettled


def history(factor: float, length: int = 15, first: float = 1.0):
    from ddmpi.methods.outer import Step

    return [
        Step(k + 1, first * factor**k, first * factor ** (2 * k), 0.0, 0) for k in range(length)
    ]


@pytest.mark.slow
def test_contraction_factor():
    from ddmpi.judge.diagnosis import contraction

    for factor in (0.3, 0.9, 1.0, 1.5):
        assert contraction(history(factor)) == pytest.approx(factor)
        assert contraction(history(factor), "residual") == pytest.approx(factor**2)
    assert contraction([*history(0.1), *history(0.8, 11)]) == pytest.approx(0.8)  # the latest count
    random = np.random.default_rng(0)
    noisy = [
        type(step)(step.iteration, step.update * float(random.uniform(0.8, 1.25)), 0.0, 0.0, 0)
        for step in history(0.5)
    ]
    assert contraction(noisy) == pytest.approx(0.5, rel=0.1)
    assert math.isnan(contraction(history(0.5, 2)))
    assert math.isnan(contraction(history(0.0, 5)))
    assert math.isnan(contraction(history(1.0, 5, math.inf)))


def diagnosis(
    stopped: str, steps: list, coefficient: float = 0.3, statuses=(), violations=(), **method
) -> str:
    return diagnose(
        "the reason",
        stopped,
        list(violations),
        Method(**method).settled(),
        steps,
        recorded(*statuses, coefficient=coefficient),
        ("friction", "anderson"),
    )


WANTED = 15 + 1.5 * math.log(1e-4 / 0.9**14) / math.log(0.9)


@pytest.mark.parametrize(
    ("stopped", "factor", "keys", "words", "unsaid"),
    [
        (
            "diverged",
            2.0,
            {"theta": 0.9},
            (
                "the reason (iteration 15, update 1.6e+04",
                "divergence",
                "smaller method.theta than 0.9",
                "default method",
            ),
            (),
        ),
        (
            "max_iterations",
            0.9,
            {"theta": 0.1, "tolerance": 1e-4},
            ("slow convergence, a factor of 0.900", f"max_iterations of {WANTED:.0f} or more"),
            ("changed", "unique"),
        ),
        ("max_iterations", 1.1, {"theta": 0.1}, ("growth",), ()),
        ("max_iterations", 1.0, {"theta": 0.1}, ("no progress",), ()),
        (
            "max_iterations",
            1.0,
            {"statuses": ["osr", "osl", "osr"]},
            ("1 of 3 nodes changed between open, slip and stick in a cycle, at (2, 1)", "anderson"),
            (),
        ),
        ("max_iterations", 1.0, {"statuses": ["osr", "osr"]}, (), ("changed",)),
        ("max_iterations", 1.0, {"coefficient": 1.0}, ("need not be unique",), ()),
        ("max_iterations", 1.0, {"coefficient": 10.0}, ("coefficient of 10 ",), ()),
        (
            "converged",
            0.1,
            {"violations": ["penetration 1e-3"]},
            ("the certificate fails: penetration 1e-3",),
            (),
        ),
    ],
)
def test_diagnosis(stopped, factor, keys, words, unsaid):
    """What was seen, how many iterations it would take, which nodes change, that answers need not be unique."""
    text = diagnosis(stopped, history(factor), **keys)
    assert all(each in text for each in words) and not any(each in text for each in unsaid)


@pytest.mark.parametrize(
    "residuals, in_space, wanted",
    [
        ([], True, 1e-3),
        ([0.2], True, 1e-2),
        ([0.2, 0.1], True, 1e-2),
        ([0.2, 0.4], True, 1e-3),
        ([0.0, 0.1], True, 1e-3),
        ([0.2, 0.014], True, 0.9 * 0.07**2),
        ([0.2, 0.002], True, 1e-3),
        ([0.2, 0.1], False, 1e-3),
    ],
)
def test_gmres_is_as_precise_as_steps_are_good(residuals, in_space, wanted):
    """Less precise after a step that gained little, but not the first one, and not in the plane."""
    assert forcing(residuals, in_space) == pytest.approx(wanted, rel=1e-12)


def test_forces_that_stay_and_precision_that_is_reached_are_told():
    """An update of zero is no convergence; a body that rounding decides has a tolerance that it allows."""
    *before, last = history(0.9)
    still = diagnosis("stalled", [*before, last._replace(update=0.0)], theta=0.1)
    assert "seen: the forces no longer change" in still
    assert "seen: the forces no longer change" not in diagnosis(
        "stalled", [*before, last], theta=0.1
    )
    method, log = Method().settled(), recorded("oss", "oss")
    said = [
        diagnose("the reason", "stalled", [], method, history(0.9), log, (), precision)
        for precision in (("upper", 2e-7), None)
    ]
    words = "try: method.tolerance = 3.0e-07, the least that double precision allows here"
    assert [words in each for each in said] == [True, False]


CHANGING, STILL = ["osr", "osl"], ["osr", "osr"]
"""States of three nodes in the last iterations: the third one turns between two directions of slip, or stays."""


def tried(scene: dict, stopped: str, factor: float = 0.9, statuses=CHANGING, options=()) -> str:
    """The advice where a run of the scene ends so."""
    from ddmpi.judge.diagnosis import helpful
    from ddmpi.scene.reader import read_scene

    able, log = helpful(read_scene("scene", to_toml(scene)), options), recorded(*statuses)
    text = diagnose("the reason", stopped, [], Method().settled(), history(factor), log, able)
    return text.partition("try: ")[2]


@pytest.mark.slow
def test_diagnosis_names_what_the_scene_can_do():
    """Less friction where there is some and states change, Anderson where it takes the scene and can end elsewhere."""
    two, smooth = pinched_blocks(2), pinched_blocks(2, "none")
    for words in ("anderson", "less friction, to see where the trouble begins"):
        assert words in tried(two, "stalled")
        assert words not in tried(two, "stalled", statuses=STILL)
        assert words not in tried(smooth, "stalled")
    third = rectangle("third", (9, 0), (1, 1), (1, 1))
    floor = {"name": "floor", "shape": "plane", "point": [0, -9], "normal": [0, 1]}
    for more in ({"time": {"points": [1.0]}}, {"body": [*two["body"], third]}, {"rigid": [floor]}):
        assert "anderson" not in tried(two | more, "stalled")
        assert "less friction" in tried(two | more, "stalled")
    bonded = two | {
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "kind": "bonded"}]
    }
    assert tried(bonded, "max_iterations") == "a larger method.max_iterations"
    assert tried(bonded, "stalled", statuses=STILL) == ""


@pytest.mark.slow
@pytest.mark.parametrize("height, advised", [(0.5, True), (0.03, False)])
def test_no_friction_is_to_blame_for_slender_bodies(tmp_path, height, advised):
    """A run with too few steps names less friction and Anderson, but not beside the warning of a slender body."""
    pressed = {"on": "top", "value": [2e6, -1e7]}
    scene = {
        "body": [
            rectangle("upper", (0, 1), (3, height), (30, 1), clamp=["left"], traction=[pressed]),
            rectangle("lower", (0, 0), (3, 1), (30, 5), clamp=["bottom"]),
        ],
        "contact": [
            {
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.5},
            }
        ],
        "method": {"max_iterations": 2},
    }
    run = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "results")
    assert run.code == 3 and ("times as long as it is thick" in run.stderr) != advised
    for words in ("less friction", "anderson"):
        assert (words in run.stderr) == advised


def test_more_iterations_are_advised_where_they_ran_out_and_made_progress():
    """Not where the run has ended otherwise, nor where the residual does not fall."""
    scene = pinched_blocks(2, "none")
    assert tried(scene, "max_iterations") == "a larger method.max_iterations"
    assert tried(scene, "max_iterations", factor=1.0, statuses=STILL) == ""
    assert "max_iterations" not in tried(scene, "converged")


def test_a_finer_mesh_is_advised_where_few_nodes_open_and_close():
    """Not where none changes, where all are open, where many bear, nor where the iteration ended otherwise."""
    scene, words = pinched_blocks(2, "none"), "a finer mesh where few nodes bear"
    assert words in tried(scene, "stalled")
    assert words not in tried(scene, "max_iterations")
    assert words not in tried(scene, "stalled", statuses=STILL)
    assert words not in tried(scene, "stalled", statuses=["oso", "ooo"])
    assert words not in tried(scene, "stalled", statuses=["ossssss", "sssssss"])


def test_the_precision_of_gmres_is_advised_where_it_was_given():
    """By default each step chooses it, and a tighter one gains nothing."""
    scene, words = pinched_blocks(2), "newton_ksp_rtol"
    assert words in tried(scene, "converged", statuses=STILL, options={"newton_ksp_rtol": "0.1"})
    assert words not in tried(scene, "converged", statuses=STILL)
    assert words not in tried(scene, "stalled", options={"newton_ksp_rtol": "0.1"})


@pytest.mark.slow
def test_the_plan_says_what_is_left_out(tmp_path):
    scene = pinched_blocks(6, "none") | {"output": {"stress": False, "figures": False}}
    scene["body"][1]["traction"] = []
    done = run_here(write_scene(scene, tmp_path / "scene.toml"), tmp_path / "results")
    assert done.code == 0, done.output
    left_out = next(line for line in done.stdout.splitlines() if "left out: " in line).partition(
        "left out: "
    )[2]
    assert left_out.split(", ") == [
        "rigid motions (all bodies are supported)",
        "stress in the files (not asked for)",
        "pictures (not asked for)",
    ]
    assert (
        "upper-lower: all nodes touch at first; no friction; clamps constrain 1 contact node\n"
        in done.stdout
    )
    assert "lower: no loads\n" in done.stdout
    assert "semi-smooth Newton, GMRES with half-plane preconditioner" in done.stdout
    assert "upper, lower: direct solver\n" in done.stdout


# A model of the compliance


@pytest.mark.slow
def test_model_of_the_compliance_learns_products_and_stays_positive():
    """What a product has shown holds for the model, which is symmetric and positive definite as C is."""
    assembly = prepare_scene(MPI.COMM_SELF, pinched_blocks(6, "coulomb"))
    joint, rng = assembly.joint, np.random.default_rng(0)
    half_space, x = HalfSpace(joint.space), rng.standard_normal(joint.size)
    assert np.allclose(
        half_space.mult(half_space.mult(x, inverse=True)), x, rtol=0.0, atol=2e-3 * np.abs(x).max()
    )
    model = Model(joint)
    C, before = (
        np.column_stack([operator.product(e, "test", 0.0) for e in np.eye(joint.size)])
        for operator in (joint, model)
    )
    assert np.abs(np.linalg.solve(C, before) - np.eye(joint.size)).max() > 1e-2
    known = rng.standard_normal((5, joint.size))
    for each in known:
        model.learn(each, C @ each)
    after = np.column_stack([model.product(e, "test", 0.0) for e in np.eye(joint.size)])
    assert np.allclose(known @ after, known @ C, rtol=0.0, atol=1e-6 * np.abs(C).max())
    assert np.allclose(after, after.T, rtol=0.0, atol=1e-9 * np.abs(after).max())
    assert np.linalg.eigvalsh(after)[0] > 0.0


@pytest.mark.slow
def test_multigrid_takes_few_products_and_gives_the_same_forces():
    """Newton's method takes some 240 products for two boxes in space; a model of the compliance leaves few of them."""
    answers = {}
    for kind in ("explicit", "iterative"):
        assembly = prepare_scene(MPI.COMM_SELF, two_boxes(6) | {"method": {"compliance": kind}})
        newton = Newton(assembly.joint, 100)
        assert newton.run(1e-8) == "converged"
        answers[kind] = newton.forces, assembly.joint.multiplications()
    (exact, many), (found, few) = answers.values()
    assert np.abs(found - exact).max() <= 1e-6 * np.abs(exact).max()
    assert few <= 0.4 * many


@pytest.mark.slow
def test_a_type_that_petsc_does_not_have_is_an_error():
    """Of the linear problems of Newton's steps; another one than GMRES has the same answer."""
    scene = pinched_blocks(2)
    answers = [
        ddmpi.solve(scene | {"petsc": petsc}, MPI.COMM_SELF)
        for petsc in ({}, {"newton_ksp_type": "fgmres"})
    ]
    first, second = (answer.contacts["upper-lower"].forces for answer in answers)
    assert second == pytest.approx(first, abs=1e-6 * np.abs(first).max())
    with pytest.raises(SolverError, match=r"the linear problem of a Newton step: .*gmrs"):
        ddmpi.solve(scene | {"petsc": {"newton_ksp_type": "gmrs"}}, MPI.COMM_SELF)


@pytest.mark.slow
def test_a_linear_problem_that_grows_without_limit_is_an_error():
    """Richardson's iteration ends with steps that are small enough, and with larger ones it does not."""

    def converges(scale: float) -> bool:
        petsc = {"newton_ksp_type": "richardson", "newton_ksp_richardson_scale": scale}
        return ddmpi.solve(pinched_blocks(1) | {"petsc": petsc}, MPI.COMM_SELF).certified

    assert converges(0.3)
    failed = r"the linear problem of a Newton step failed with DIVERGED_NANORINF"
    with np.errstate(all="ignore"), pytest.raises(SolverError, match=failed):
        converges(1.0)


def test_contacts_that_share_a_force_leave_it_where_loads_stay():
    """Two blocks side by side on a floor: forces around a loop of contacts that stick change no gap. What the tolerance
    leaves of the loop's gaps led steps far along them, to where nodes slip."""
    rough = {"friction": {"law": "coulomb", "coefficient": 0.5}}
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    blocks = [
        rectangle(name, (x, 0.0), (1.0, 1.0), (2, 2))
        | {
            "material": {"young": young, "poisson": 0.3},
            "traction": [{"on": "top", "pressure": 3e5}, {"on": name, "pressure": 3e4}],
        }
        for name, x, young in (("left", 0.0, 1e10), ("right", 1.0, 2e10))
    ]
    contacts = [
        {"bodies": ["left", "floor"], "on": ["bottom"]} | rough,
        {"bodies": ["right", "floor"], "on": ["bottom"]} | rough,
        {"bodies": ["left", "right"], "on": ["right", "left"]} | rough,
    ]
    scene = {"body": blocks, "rigid": [floor], "contact": contacts}
    joint = prepare_scene(MPI.COMM_SELF, scene).joint
    newton = Newton(joint, max_iterations=50)
    assert newton.run(1e-8) == "converged"
    s, gaps = newton.forces.copy(), newton.gaps.copy()
    for interface, part in joint.space.with_slices():  # slip counts from here on
        joint.d[part][interface.m :] += gaps[part][interface.m :]
        gaps[part][interface.m :] = 0.0
    newton.begin((s, gaps, newton.motions))
    assert newton.run(1e-8) == "converged"
    assert len(newton.history) == 1  # 26, or 31 for other stiffnesses
    assert newton.forces == pytest.approx(s, rel=0.0, abs=1e-6 * np.abs(s).max())  # 0.2
