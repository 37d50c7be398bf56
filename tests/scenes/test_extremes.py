"""The default method at the extremes of material, friction, shape, size and load, on small meshes.

Every scene is certified at 1e-8 and gives the contact forces of the coupled problem, which
`tests/support/brute_force.py` finds by brute force, or is refused for a reason. Most run on one rank, random scenes on
two. The same scenes on larger meshes: scripts/extremes.py.
"""

import copy

import numpy as np
import pytest
from mpi4py import MPI
from scenes import everywhere, exact_forces, pinched_blocks, prepare_scene, the_interface

pytestmark = pytest.mark.slow

N = 6
TOLERANCE, DISTANCE = 1e-8, 1e-6
two_ranks = pytest.mark.mpi(ranks=2)


def scene(*changes, N: int = N, law: str = "coulomb") -> dict:
    """Pinched blocks with `changes` made to the two bodies and the contact, each a function of these three."""
    made = copy.deepcopy(pinched_blocks(N, law, tolerance=TOLERANCE))
    for change in changes:
        change(*made["body"], made["contact"][0])
    return made


def material(upper: float = 1.0, lower: float = 1.0, poisson: tuple[float, float] = (0.277, 0.277)):
    def change(first: dict, second: dict, _contact: dict) -> None:
        for body, factor, nu in ((first, upper, poisson[0]), (second, lower, poisson[1])):
            body["material"] = {"young": 2.119e11 * factor, "poisson": nu}
    return change


def friction(law: str, value: float | dict | None = None):
    key = {"coulomb": "coefficient", "tresca": "slip_bound"}.get(law)

    def change(_first: dict, _second: dict, contact: dict) -> None:
        contact["friction"] = {"law": law} | ({key: value} if key else {})
    return change


def jump(low: float, high: float) -> dict:
    return {"along": "x", "points": [1.5, 1.5], "values": [low, high]}


def mesh(nx: int, ny: int, width: float = 3.0, height: float = 1.0, gap: float = 0.0):
    def change(first: dict, second: dict, _contact: dict) -> None:
        for body, bottom in ((first, height + gap), (second, 0.0)):
            body["mesh"] |= {"origin": [0.0, bottom], "size": [width, height], "divisions": [nx, ny]}
    return change


def loads(upper: dict, lower: dict):
    def change(first: dict, second: dict, _contact: dict) -> None:
        for body, tractions in ((first, upper), (second, lower)):
            body["traction"] = [{"on": on, "value": list(value)} for on, value in tractions.items()]
    return change


def other_order(_first: dict, _second: dict, contact: dict) -> None:
    contact["bodies"].reverse()
    contact["on"].reverse()


def find(comm, made: dict):
    """The assembly, its answer, the outer iteration, and the distance from the coupled problem. Collective."""
    assembly, answer = find_answer(comm, made)
    outer = answer.outer
    exact = exact_forces(assembly)
    distance = np.linalg.norm(everywhere(assembly, outer.forces) - exact) / (np.linalg.norm(exact) or 1.0)
    return assembly, answer, outer, distance


def state_of(answer):
    (state,) = answer.states.values()
    return state


def find_answer(comm, made: dict):
    """The assembly and its answer. Collective."""
    from ddmpi.run.solve import solve

    assembly = prepare_scene(comm, made)
    return assembly, solve(assembly, assembly.scene.method)


def assert_all_certified(comm, scenes: dict[str, dict]) -> None:
    failed = []
    for name, made in scenes.items():
        _, answer, _, distance = find(comm, made)
        if not (answer.certified and distance <= DISTANCE):
            failed.append(f"{name}: {answer.reason}, {answer.violations}, distance {distance:.1e}")
    assert not failed, "\n".join(failed)


def test_stiffness_contrasts_with_either_body_first(comm):
    assert_all_certified(comm, {f"E1/E2 = {factor:g}, {'lower' if swap else 'upper'} body in role 1":
                                scene(material(upper=factor), *swap)
                                for factor in (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6) for swap in ([], [other_order])})


def test_friction_from_none_to_sticking(comm):
    cases = {f"coulomb {F:g}": friction("coulomb", F) for F in (0.0, 1e-6, 0.05, 0.3, 1.0, 3.0, 10.0)}
    cases |= {f"tresca {g:g}": friction("tresca", g) for g in (0.0, 1e3, 1e6, 1.2e7, 1e20)}
    cases |= {"none": friction("none"), "bound jumps": friction("tresca", jump(1e5, 3e7)),
              "coefficient jumps": friction("coulomb", jump(10.0, 0.01)),
              "rough half": friction("coulomb", jump(0.0, 1.0))}
    assert_all_certified(comm, {name: scene(change) for name, change in cases.items()})

    assembly, _, outer, _ = find(comm, scene(friction("none")))
    frictionless = everywhere(assembly, outer.forces)
    for law in ("coulomb", "tresca"):
        assembly, _, outer, _ = find(comm, scene(friction(law, 0.0)))
        normal, tangential = np.split(everywhere(assembly, outer.forces), [assembly.m])
        assert normal == pytest.approx(frictionless, rel=1e-6, abs=1e-6 * normal.max())
        assert not tangential.any()


def test_poisson_ratios_up_to_nearly_incompressible(comm):
    assert_all_certified(comm, {f"{pair}": scene(material(poisson=pair)) for pair in (
        (0.0, 0.0), (0.49, 0.49), (0.4999, 0.4999), (0.0, 0.4999), (0.4999, 0.0), (-0.9, 0.4))})


def test_flat_triangles_slender_bodies_one_node(comm):
    shapes = {"3 x 0.003, 1 x 3 triangles": mesh(3, 1000), "0.1 x 1": mesh(30, 1), "0.01 x 3": mesh(100, 1, 1.0, 3.0),
              "slender": mesh(40, 2, 3.0, 0.1), "one node": mesh(1, 1), "two nodes": mesh(2, 1)}
    assert_all_certified(comm, {name: scene(change) for name, change in shapes.items()})


def test_thin_triangles_in_a_single_row():
    """1000 of 3 mm × 1 m: softening solves its linear problems until the forces are known, too."""
    _, answer = find_answer(MPI.COMM_SELF, scene(mesh(1000, 1)))
    assert answer.certified


def test_bodies_of_a_nanometre_and_of_a_thousand_kilometres(comm):
    _, _, usual, _ = find(comm, scene())
    for width in (1e-9, 1e6):
        _, answer, outer, distance = find(comm, scene(mesh(3 * N, N, width, width / 3)))
        assert answer.certified and distance <= DISTANCE
        assert len(outer.history) == len(usual.history)
        least = 1e-9 * usual.forces.max(initial=0.0)  # the rank that owns no forces has nothing to compare
        assert outer.forces * (3.0 / width) == pytest.approx(usual.forces, rel=1e-9, abs=least)


LIFTING = loads({"top": (0.0, 6e7)}, {"bottom": (0.0, -6e7)})


def test_loads_that_lift_press_one_body_or_are_absent(comm):
    cases = {"lifted": LIFTING, "no load": loads({}, {}),
             "upper only": loads({"top": (0.0, -6e7), "right": (2e7, 3e7)}, {}),
             "lower only": loads({}, {"bottom": (0.0, 4e7)}), "a billionth": loads({"top": (0.0, -0.06)}, {})}
    assert_all_certified(comm, {f"{name}, {law}": scene(change, law=law) for name, change in cases.items()
                                for law in ("coulomb", "tresca", "none")})
    assembly, answer, outer, _ = find(comm, scene(LIFTING))
    assert state_of(answer).count("open") == assembly.m
    assert not outer.forces.any()
    assert len(outer.history) == 1


def test_contact_at_a_corner_only(comm):
    """A gap that only the tip of the upper block, bent down, overcomes."""
    for law in ("coulomb", "tresca"):
        bent = scene(mesh(3 * N, N, gap=0.006), loads({"right": (0.0, -1e8)}, {}), law=law)
        assembly, answer, _, distance = find(comm, bent)
        assert answer.certified and distance <= DISTANCE
        closed = np.flatnonzero(state_of(answer).normal_force)
        assert 1 <= len(closed) <= 3
        assert the_interface(assembly).xy[closed, 0].min() > 2.5


def test_bodies_of_contact_nodes_only(comm):
    """One row of elements, held on the far side: no other node is left, or hardly any."""
    def clamp(*sides: str):
        def change(first: dict, second: dict, _contact: dict) -> None:
            first["clamp"], second["clamp"] = [sides[0]], [sides[1]]
            first["traction"], second["traction"] = [{"on": "right", "value": [2e7, -3e7]}], []
        return change

    assert_all_certified(comm, {f"{sides}": scene(mesh(12, 1), clamp(*sides)) for sides in (
        ("top", "bottom"), ("top", "left"), ("left", "bottom"))})


def clamps(upper: list, lower: list):
    def change(first: dict, second: dict, _contact: dict) -> None:
        for body, held in ((first, upper), (second, lower)):
            body["clamp"] = held
            body["traction"] = [traction for traction in body["traction"] if traction["on"] not in held]
    return change


def test_clamps_that_hold_one_body_only_at_contact_nodes(comm):
    """Left of one body, right of the other; a roller; a rigid foundation, which does not yield at all."""
    roller = [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0, "y": 0.0}]
    cases = {"left and right": clamps(["left"], ["right"]), "right and left": clamps(["right"], ["left"]),
             "roller": clamps(["left"], roller), "foundation": clamps(["left"], ["bottom", "top"]),
             "foundation above": clamps(["bottom"], ["bottom"])}
    assert_all_certified(comm, {f"{name}, {law}": scene(change, law=law) for name, change in cases.items()
                                for law in ("coulomb", "tresca", "none")})
    for made, dropped in ((scene(clamps(["left"], ["right"])), 0), (scene(clamps(["left"], ["bottom", "top"])), 1)):
        assembly, answer, _, _ = find(comm, made)
        assert the_interface(assembly).dropped == dropped
        largest = comm.allreduce(max(np.abs(u).max() for u in answer.displacements.values()), MPI.MAX)
        assert state_of(answer).gap.min() >= -1e-9 * largest


@two_ranks
def test_published_methods_refuse_clamps_that_hold_one_body_only(comm):
    from ddmpi.errors import InputError

    for method in ({"outer": "anderson"}, {"theta": 0.2}):
        with pytest.raises(InputError, match="a clamp holds one body only"):
            prepare_scene(comm, scene(clamps(["left"], ["right"])) | {"method": method})


def test_touching_bodies_without_pressure_that_slide(comm):
    """The upper block is moved along the lower one, by a millimetre and pressed by less than rounding."""
    for law in ("coulomb", "none"):
        for pressed in (0.0, -1e-15, -1e-12, -1e-10, -1e-6):
            held = clamps([{"on": "top", "x": 1e-3, "y": pressed}], ["bottom"])
            made = scene(held, loads({}, {}), law=law)
            _, answer = find_answer(comm, made)
            assert answer.certified, (law, pressed, answer.violations)
    _, answer, _, distance = find(comm, made)  # a millionth of a metre
    assert answer.certified and distance <= DISTANCE


def test_a_huge_friction_coefficient_ends_in_good_order(comm):
    """𝓕 = 100 and more, where there may be no solution: certified and right, or stopped without a claim."""
    for seed, F in ((205, 1e2), (205, 1e4), (207, 1e3)):
        made = random_scene(seed)
        made["contact"][0]["friction"] = {"law": "coulomb", "coefficient": {
            "along": "x", "points": [0.0, 1.0, 2.0, 3.0], "values": [0.0, F, F, 0.5]}}
        made["method"]["max_iterations"] = 150
        _, answer = find_answer(comm, made)
        assert answer.certified or answer.stopped in ("max_iterations", "stalled")
        updates = [step.update for step in answer.outer.history]
        assert sum(update == 0.0 for update in updates) <= 10, "iterations that do nothing"


@two_ranks
@pytest.mark.clarabel
def test_bodies_that_clamps_do_not_hold_are_held_by_contact_or_the_reason_is_named(comm):
    """By friction they are; without it, a body without a clamp along x would slide. The published iteration refuses."""
    from ddmpi.errors import InputError

    def clamps(*groups):
        def change(first: dict, _second: dict, _contact: dict) -> None:
            first["clamp"] = list(groups)
        return change

    for change, slides in ((clamps(), True), (clamps({"on": "left", "x": 0.0}), False),
                           (clamps({"on": "top", "y": 0.0}), True)):
        for law in ("coulomb", "none"):
            _, answer = find_answer(comm, scene(change, law=law))
            assert answer.certified == (law == "coulomb" or not slides), answer.reason
            assert answer.certified or answer.reason == "no equilibrium: upper would move along x"
        for method in ({"theta": 0.2}, {"outer": "anderson"}):
            with pytest.raises(InputError, match=r"method\.outer = .*its clamps do not hold 'upper'.*newton"):
                prepare_scene(comm, scene(change) | {"method": method})


def test_bodies_that_are_too_slender_are_refused_with_the_reason(comm):
    from ddmpi.errors import SolverError

    with pytest.raises(SolverError, match=r"body '(upper|lower)'.*true residual"):
        find(comm, scene(mesh(66, 6, 3.0, 0.003)))  # a cantilever whose stiffness is singular to the last digits


def test_the_table_of_extremes_is_made_of_runs(comm):
    import extremes

    found = extremes.attempt(comm, extremes.squares(6), compare=True)
    assert found["outcome"] == "certified" and found["distance"] <= 1e-6
    assert found["energy"] == pytest.approx(3.6e4, rel=0.1)  # J per metre; 38866 at N = 22


@pytest.mark.parametrize("pairs", [True, False])
@pytest.mark.parametrize("case", ["unit of length 1e-09 m", "unit of force 1e+09 N", "1e+06 m from the origin"])
def test_solids_in_other_units_and_places_have_the_same_answer(case, pairs):
    """To nine digits, and what is written obeys all laws; so the table of extremes in space is made."""
    import extremes

    for group in ("two boxes, held", "three boxes, loose"):
        make, changes, factor = extremes.solid_cases()[group, case]
        base = extremes.attempt_solid(make(pairs, 1), None, None)[1]
        found, _ = extremes.attempt_solid(make(pairs, 1, *changes), base, factor)
        assert found["outcome"] == "certified" and found["violation"] < 1e-7
        assert found["differs"] < (1e-8 if "origin" in case else 1e-9)


@pytest.mark.parametrize("slenderness", [30, 100])
def test_slender_solids_take_few_steps(slenderness):
    """10 to 13 steps; 18 to 28 where GMRES stops by displacements alone, most of which are bending."""
    import extremes

    for pairs in (True, False):
        row, _ = extremes.attempt_solid(extremes.side_by_side(slenderness)(pairs, 1), None, None)
        assert row["outcome"] == "certified" and row["iterations"] <= 17, row


def test_slender_solids_converge_where_multigrid_gives_the_products():
    """In 18 steps; in 44 steps they ended in nothing with products in GMRES as precise as between compact bodies."""
    import extremes

    for pairs in (True, False):
        made = extremes.side_by_side(30)(pairs, 1) | {"method": {"compliance": "iterative"}}
        row, _ = extremes.attempt_solid(made, None, None)
        assert row["outcome"] == "certified" and row["iterations"] <= 22, row


def random_scene(seed: int) -> dict:
    """Blocks of random material, friction and size under random loads, some with a gap or an overlap."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    def profile(low: float, high: float) -> float | dict:
        if random.random() < 0.5:
            return between(low, high)
        points = sorted(random.uniform(0.0, 3.0, 4).tolist())
        return {"along": "x", "points": [*points, points[-1]], "values": [between(low, high) for _ in range(5)]}

    contrast, size = between(1e-6, 1e6), between(0.5, 2.0)
    pressure = 1e8 * min(1.0, contrast)
    nu = tuple(float(random.choice([0.0, 0.277, 0.45, 0.4999, -0.3])) for _ in range(2))
    law = str(random.choice(["coulomb", "coulomb", "tresca", "none"]))
    bound = {"coulomb": lambda: profile(1e-3, 3.0), "tresca": lambda: profile(1e-3 * pressure, 3 * pressure)}
    divisions = int(random.integers(9, 25)), int(random.integers(2, 8))
    gap = float(random.normal() * 1e-4 * pressure / min(1.0, contrast) / 1e8) if random.random() < 0.5 else 0.0
    tractions = [{side: random.normal(size=2) * 0.3 * pressure for side in ("right", outer)} for outer in
                 ("top", "bottom")]
    tractions[0]["top"][1] = -pressure * random.uniform(0.1, 1.0)
    tractions[1]["bottom"][1] = pressure * random.uniform(0.1, 1.0)
    made = scene(material(upper=contrast, poisson=nu), mesh(*divisions, 3.0, size, gap),
                 friction(law, bound[law]() if law in bound else None),
                 loads(*({side: value.tolist() for side, value in body.items()} for body in tractions)))
    for body, outer in zip(made["body"], ("top", "bottom"), strict=True):
        body["clamp"] = [str(random.choice(["left", "right"]))] if random.random() < 0.7 else [outer]
        held = body["clamp"][0]
        body["traction"] = [traction for traction in body["traction"] if traction["on"] != held]
    return made


@two_ranks
def test_random_scenes(comm):
    """Seed 112: an incompressible layer so thin that the residual of the equations understates the error 200 times."""
    assert_all_certified(comm, {f"seed {seed}": random_scene(seed) for seed in (*range(10), 112)})
