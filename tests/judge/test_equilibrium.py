"""Whether contact forces can hold loose bodies, how these move where none can, and the words for it."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sparse
from mpi4py import MPI
from rigid_blocks import Blocks, Boxes, arch, beam, pushed, squeezed, tall, tower, wall, wedge
from scenes import seldom

from ddmpi.interface.law import CoulombLaw
from ddmpi.judge.equilibrium import IMBALANCE, SLIGHT, Forces, _Free, describe, find_mechanism
from ddmpi.judge.motions import MotionsOfBody, direction, undetermined
from ddmpi.run import equilibrium

pytestmark = pytest.mark.clarabel


def find(interfaces, G, e, bodies, load=0.0, least=IMBALANCE):
    """The mechanism of a scene; None where there may be equilibrium."""
    G = sparse.csr_matrix(G).toarray()
    ends = np.cumsum([0, *(interface.size for interface in interfaces)])
    forces = []
    for interface, start, stop in zip(interfaces, ends, ends[1:], strict=False):
        motions = np.flatnonzero(G[:, start:stop].any(axis=1))
        forces.append(Forces.of(interface, motions, G[motions, start:stop].T, len(G)))
    return find_mechanism(forces, e, bodies, load, least)


def found(scene):
    return find(*scene.equilibrium())


def words(scene) -> str:
    """What is said of a scene without equilibrium, after the words "no equilibrium"."""
    mechanism = found(scene)
    if mechanism is None:
        return "equilibrium"
    check(scene, mechanism)
    said = describe(mechanism)
    assert said.startswith("no equilibrium: ")
    near = f", as nothing balances {mechanism.imbalance:.0e} of the loads"
    assert said.endswith(near) == (mechanism.imbalance <= 1e-3)
    return said.removeprefix("no equilibrium: ").removesuffix(near)


def check(scene, mechanism) -> None:
    """By velocities at corners and contact nodes alone: nothing is pressed into, and the loads do work."""
    moving = {
        body.name: (body, v) for body, v in zip(mechanism.bodies, mechanism.velocities, strict=True)
    }

    def velocity(name, points):
        return (
            moving[name][0].at(moving[name][1], points) if name in moving else np.zeros_like(points)
        )

    fastest = max(
        np.linalg.norm(velocity(name, body.outline), axis=1).max()
        for name, (body, _) in moving.items()
    )
    assert fastest == pytest.approx(1.0, rel=1e-12)
    for contact in scene.contacts:
        apart = velocity(contact.bodies[1], contact.xy) - velocity(contact.bodies[0], contact.xy)
        opening = np.einsum("md,md->m", apart, contact.normal)
        assert opening.min() >= -2e-6
        assert contact.law.name != "bonded" or np.abs(apart).max() <= 2e-6
    work = sum(
        (scene.turn @ np.array(load)) @ velocity(name, scene.place(at))[0]
        for name, loads in scene.loads.items()
        for load, at in loads
    )
    assert work > 0.0


@pytest.mark.every(5)
@pytest.mark.parametrize("beyond", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("how", [{}, {"length": 1e3, "force": 1e-4}], ids=["m", "mm"])
@pytest.mark.parametrize(
    "law, value, limit", [("coulomb", 0.3, 0.3), ("tresca", 0.3, 0.3), ("coulomb", 9.0, 2.0)]
)
def test_limits_are_told_from_both_sides(law, value, limit, how, beyond):
    """A block that slides, or tips, by 1e-7 of the limit does not stand, and by how much is said; before it stands."""
    under = pushed(limit * (1.0 - beyond), law, value, **how)
    assert find(*under.equilibrium(), least=SLIGHT) is None
    over = pushed(limit * (1.0 + beyond), law, value, **how)
    mechanism = find(*over.equilibrium(), least=SLIGHT)
    assert mechanism is not None
    check(over, mechanism)
    assert 0.05 * beyond < mechanism.imbalance < beyond
    assert "as nothing balances" in describe(mechanism)


# What is said of scenes in the plane


def capped(push):
    """A law that nothing else knows: what it allows is asked of the law itself, not by its name."""

    @dataclass(frozen=True)
    class Capped(CoulombLaw):
        name = "capped"

        def slip_bound(self, pressure):
            return np.minimum(super().slip_bound(pressure), 10.0)

    scene = pushed(push)
    known = scene.contacts[0].law
    scene.contacts[0] = replace(
        scene.contacts[0], law=Capped(known.m, known.sliding, 1, known.coefficient)
    )
    return scene


def bonded_to_a_wall():
    return (
        Blocks()
        .box("a", 0, 0, 1, 1, ((9.0, 9.0), (0.0, 0.25)))
        .contact("a", "floor", (0, 0), (1, 0), "bonded")
    )


def two_bonded(load=0.0):
    """Both weigh the same, and the joint is above the edge."""
    two = (
        Blocks()
        .box("a", 0, 0, 1, 1)
        .box("b", 1, 0, 1, 1)
        .contact("b", "a", (1, 1), (1, 0), "bonded")
    )
    two.loads["b"] += (((0.0, -load), (1.5, 0.5)),)
    return two.contact("a", "floor", (0, 0), (1, 0), "coulomb", 0.5)


def lifted_lid():
    lid = Blocks().box("lid", 0, 1, 1, 0.1, ((0.0, 2.0), (0.5, 1.0)))
    return lid.contact("lid", "box", (0, 1), (1, 1), "coulomb", 1)


def light_lid(push):
    """Of a millionth of the load of the block that bears it."""
    scene = pushed(0.4).box("lid", 0, 1, 1, 0.1, ((push, 0.0), (0.5, 1.0)), weight=1e-6)
    return scene.contact("lid", "block", (0, 1), (1, 1), "coulomb", 0.5)


def bore(couple):
    """A shaft in the plane turns, and is not lifted, though no two of its nodes slide along the same line."""
    turn = np.linspace(0, 2 * np.pi, 2001)[:-1]
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    scene = Blocks().body("shaft", rim, ((0.0, couple), (0.5, 0.0)), ((0.0, -couple), (-0.5, 0.0)))
    return scene.curve("shaft", "bore", rim, rim, "tresca", 1.0)


EQUILIBRIUM, SLIDES = "equilibrium", "block would move along x"

PLANE = [
    # a block is held up to the coefficient of friction times its weight, or to a bound that needs no pressure
    (pushed(0.0), EQUILIBRIUM),
    (pushed(0.499), EQUILIBRIUM),
    (pushed(0.5), EQUILIBRIUM),
    (pushed(0.5001), SLIDES),
    (pushed(0.299, "tresca", 0.3), EQUILIBRIUM),
    (pushed(0.301, "tresca", 0.3), SLIDES),
    (pushed(0.0, "none"), EQUILIBRIUM),
    (pushed(1e-5, "none"), SLIDES),
    (capped(0.499), EQUILIBRIUM),
    (capped(0.501), SLIDES),
    # between wall and jaw if 2 𝓕 times the pressure is at least its weight
    (squeezed(1.0), EQUILIBRIUM),
    (squeezed(0.99), "block would move along -y"),
    # bonds hold, and bodies move as one
    (bonded_to_a_wall(), EQUILIBRIUM),
    (two_bonded(), EQUILIBRIUM),
    (two_bonded(0.1), "a and b would move most at (2, 1), along (0.71, -0.71)"),
    # shifted blocks stand as long as the centre of all above a joint is above it: (n − 1) shift/2 ≤ ½
    (tower(0.25, 5), EQUILIBRIUM),
    (tower(0.5, 3), EQUILIBRIUM),
    (tower(0.75, 2), EQUILIBRIUM),
    (tower(0.75, 3), "b0, b1 and b2 would move most at (-1.5, 3), along (-0.89, -0.45)"),
    (tower(0.25, 6), "b0, b1 (and 4 more) would move most at (-1.25, 6), along (-0.98, -0.2)"),
    (tower(0.3), "b0, b1 (and 3 more) would move most at (-1.2, 5), along (-0.97, -0.23)"),
    # a beam lies on its posts as long as its centre is between them, and tips about the outer edge of one
    (beam(0.0, 0.0, 1.7), EQUILIBRIUM),
    (beam(-0.69, 0.0), "beam would turn clockwise about (0.3, 1)"),
    (beam(-1.1, 0.0, 0.6), "beam would turn counterclockwise about (0, 1)"),
    (beam(0.31, 1.0), "beam would turn clockwise about (1.3, 1)"),
    # a semicircular arch stands from thickness 0.1075 of its mean radius on (Couplet, Heyman), if it does not slide
    (arch(0.109), EQUILIBRIUM),
    (
        arch(0.106),
        "v0, v1 (and 4 more) would move most at (-0.876, 0.585), along (-0.96, 0.29); v26, v27 (and 4 more) "
        "would move most at (0.876, 0.585), along (0.96, 0.29); v6, v7 (and 18 more) would move, too",
    ),
    (
        arch(0.2, 0.3),
        "v11, v12 (and 8 more) would move along -y; v0, v1 (and 20 more) would move, too",
    ),
    # what leaves all its contacts, or has none, however light
    (lifted_lid(), "lid would move along y"),
    (pushed(0.0).box("lid", 0, 3, 1, 0.1), "lid would move along -y"),
    (pushed(0.0).box("lid", 0, 3, 1, 0.1, weight=1e-6), "lid would move along -y"),
    (light_lid(0.4e-6), EQUILIBRIUM),
    (light_lid(0.6e-6), "lid would move along x"),
    # the whole highest row slides, however many ways there are to balance the others
    (wall(4, 4, 0.5), EQUILIBRIUM),
    (wall(4, 4, 30.0), "r3b0, r3b1 (and 2 more) would move along x"),
    # a thousand nodes of a bore
    (bore(0.999), EQUILIBRIUM),
    (bore(1.01), "shaft would turn counterclockwise about (0, 0)"),
    # directions and places turn with the scene, and are mirrored with it
    (pushed(0.6, angle=np.arccos(0.8)), "block would move along (0.8, 0.6)"),
    (pushed(0.6, mirror=True), "block would move along -x"),
    (tall(0.124), EQUILIBRIUM),
    (tall(0.2), "tower would move most at (3, 4), along (-0.97, 0.24)"),
    (tall(0.2, mirror=True), "tower would move most at (-3, 4), along (0.97, 0.24)"),
    (tall(0.2, angle=np.pi), "tower would move most at (-3, -4), along (0.97, -0.24)"),
]


@pytest.mark.parametrize(("scene", "said"), PLANE)
def test_what_stands_and_what_moves(scene, said):
    assert words(scene) == said


@pytest.mark.parametrize("force", [0.5001, 0.6, 2.9])
def test_a_pushed_block_slides_beyond_it(force):
    """It slides along the floor: it is not lifted, as associated flow would have it."""
    assert found(pushed(force)).velocities[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    excess = (force - 0.5) / np.hypot(
        force, 1.0
    )  # over the load; the work on a motion, which lifts it, shows less
    assert 0.7 * excess < found(pushed(force)).imbalance < excess


@pytest.mark.parametrize("weight", [1.0, 1e-2, 1e-5])
def test_light_bodies_fall_as_fast_as_heavy_ones(weight):
    """A mechanism tells accelerations: those of two equal blocks that nothing holds are the same, whatever they weigh."""
    scene = pushed(0.0).box("heavy", 0, 3, 1, 1).box("light", 4, 3, 1, 1, weight=weight)
    mechanism = found(scene)
    assert [body.name for body in mechanism.bodies] == ["block", "heavy", "light"]
    assert mechanism.velocities[0] == pytest.approx(np.zeros(3), abs=1e-6)
    for v in mechanism.velocities[1:]:
        assert v == pytest.approx([0.0, -1.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("force, tips", [(2.99, False), (3.01, True), (5.0, True)])
def test_a_block_that_is_pushed_hard_slides_and_tips(force, tips):
    """A push at a quarter of the height, below the centre, lifts the front of the block that it accelerates, if its
    moment about the centre, force/4, exceeds that of the pressure at the rear edge, 1/2, and of the friction, 1/4."""
    v = found(pushed(force)).velocities[0]
    assert v[0] > 0.5 and (v[2] > 1e-3) == tips


def test_the_imbalance_of_given_friction():
    """What friction of given bounds takes of a push is balanced; the rest is compared with push, weight and moment."""
    loads = np.sqrt(
        0.4**2 + 1.0 + 6.0 * (0.4 / 4) ** 2
    )  # the moment over the radius of gyration, 1/√6
    assert found(pushed(0.4, "tresca", 0.3)).imbalance == pytest.approx(0.1 / loads, rel=1e-5)


@pytest.mark.parametrize(
    "v", [(0.0, -1.0, 0.0), (-1.0, 1.0, 0.0), (np.nan, np.nan, np.nan), (0.0, 0.0, 0.0)]
)
def test_what_a_solver_returns_is_no_proof_by_itself(v, monkeypatch):
    """A motion into the floor, one against the loads, and none at all prove nothing."""
    monkeypatch.setattr(
        _Free, "start", lambda self, slope, bound: (np.array(v), np.zeros_like(slope))
    )
    assert found(pushed(0.6)) is None


def test_what_a_fast_body_without_load_leaves_of_others_is_no_proof(monkeypatch):
    """A body that carries nothing is far faster than all others in the solver's rounding; that these press into their
    contacts is seen beside their own motion."""
    monkeypatch.setattr(
        _Free,
        "start",
        lambda self, slope, bound: (
            np.array([0.0, -5e-7, 0.0, 1.0, 0.0, 0.0]),
            np.zeros_like(slope),
        ),
    )
    scene = pushed(0.0, "none").box("idle", 0, 3, 1, 1, weight=0.0)
    assert found(scene) is None


def test_rounding_is_no_proof_of_a_slight_imbalance(monkeypatch):
    """A motion along the loads that presses into the floor by rounding proves no more than the floor may then bear."""
    scene, into = pushed(0.3, value=0.3), 1e-7
    slide = np.array(
        [1.0, -0.3 - into, 0.0]
    )  # work 0.3 - 0.3 - ..., and friction would lift by 0.3
    lifted = np.array([1.0, 0.3 - into, 0.0])
    for v, beyond in ((lifted, 1e-8), (slide, 1e-8)):
        monkeypatch.setattr(
            _Free, "start", lambda self, slope, bound, v=v: (v, np.ones_like(slope))
        )
        assert find(*pushed(0.3 + beyond, value=0.3).equilibrium(), least=SLIGHT) is None
    assert found(scene) is None


@pytest.mark.parametrize("friction, slope", [(0.1, 0.36), (0.3, 0.7)])
def test_a_wedge_is_driven_by_the_known_force(friction, slope):
    """𝓕 + (𝓕 + tan α)/(1 − 𝓕 tan α) drives it in (its own weight is none), less than the opposite lets it out."""
    most = friction + (friction + slope) / (1 - friction * slope)
    least = (slope - friction) / (1 + friction * slope) - friction
    for push in (0.999 * most, least + 0.001):
        assert words(wedge(push, friction, slope)) == "equilibrium"
    assert (
        words(wedge(1.001 * most, friction, slope))
        == "wedge would move along x; block would move, too"
    )
    assert (
        words(wedge(least - 0.001, friction, slope))
        == "wedge would move along -x; block would move, too"
    )


def test_without_loads_nothing_is_looked_for():
    """No load on a loose body, or loads that cancel but for rounding, are no reason to move."""
    scene = Blocks().box("block", 0, 0, 1, 1, weight=0.0)
    scene.contact("block", "floor", (0, 0), (1, 0))
    interfaces, G, e, bodies = scene.equilibrium()
    assert find(interfaces, G, e, bodies) is None
    assert find(interfaces, G, e + 1e-5, bodies, np.array([1e7])) is None
    assert find(interfaces, G, e + 1e-5, bodies) is not None


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "how",
    [{"force": 1e12, "length": 1e-6}, {"force": 1e-12, "length": 1e6}, {"shift": (1e4, -1e4)}],
    ids=str,
)
def test_units_and_origin_do_not_matter(how):
    """Newtons or giganewtons, metres or micrometres, near the origin or far from it: the same is said."""
    assert words(pushed(0.499, **how)) == words(arch(0.109, **how)) == "equilibrium"
    assert words(pushed(0.51, **how)) == "block would move along x"
    assert "along (-0.96, 0.29)" in words(arch(0.106, **how))
    assert_tips(tall(0.2, **how), (3, 4), "(-0.97, 0.24)")


def assert_tips(scene, at, along: str) -> None:
    """The tower of a scene moves most at a place (d,), in its units, along what is said."""
    said = words(scene).removeprefix("tower would move most at (").removesuffix(f"), along {along}")
    assert np.array(said.split(", "), float) == pytest.approx(
        scene.place(at)[0], abs=0.02 * scene.length
    )


@pytest.mark.every(4)
@pytest.mark.parametrize("seed", range(15))
def test_random_stacks(seed):
    """Ends of straight contacts serve as well as all nodes: curved ones, of which all are kept, give the same."""
    made = []
    for curved in (False, True):
        random = np.random.default_rng(seed)
        scene, x, below = Blocks(angle=random.uniform(0, 6)), 0.0, (0.0, 1.0)
        for k in range(5):
            x += random.uniform(-0.5, 0.5)
            width = random.uniform(0.5, 1.5)
            scene.box(
                f"b{k}", x, k, width, 1, (random.uniform(-0.15, 0.15, 2), (x, k + random.uniform()))
            )
            low, high = max(x, below[0]), min(x + width, below[1])
            if low < high:
                law = random.choice(["coulomb", "tresca", "none", "bonded"], p=[0.5, 0.2, 0.1, 0.2])
                scene.contact(
                    f"b{k}",
                    f"b{k - 1}" if k else "floor",
                    (low, k),
                    (high, k),
                    law,
                    random.uniform(0.2, 0.8),
                    nodes=9,
                )
                if curved:  # by less than what counts, but not straight any more
                    xy = scene.contacts[-1].xy
                    xy[1::2] += 1e-5 * np.random.default_rng(k).standard_normal((4, 2))
            below = (x, x + width)
        made.append(found(scene))
        if made[-1] is not None:
            assert made[-1].imbalance > 1e-3 or curved
            if not curved:
                check(scene, made[-1])
    assert (made[0] is None) == (made[1] is None)
    if made[0] is not None:
        assert made[1].imbalance == pytest.approx(made[0].imbalance, rel=1e-3)


# What stays undetermined


def active(scene, *kinds):
    """Columns of G of the contacts' normal, tangential or all forces, by contact; the bodies, and DᵀD."""
    interfaces, G, _, bodies = scene.equilibrium()
    columns, start = [], 0
    for interface, kind in zip(interfaces, kinds, strict=True):
        columns += {
            "open": [],
            "slip": range(start, start + interface.m),
            "stick": range(start, start + interface.size),
        }[kind]
        start += interface.size
    return G[:, columns], bodies, scene.past()


def test_undetermined_motions():
    """What no closed contact resists is listed: along a floor without friction, about a bore, or everything."""
    assert undetermined(*active(pushed(0.1), "stick")) == []
    assert undetermined(*active(pushed(0.1), "slip")) == [
        "block can move along x without any force"
    ]
    assert undetermined(*active(pushed(0.1, angle=np.pi / 2), "slip")) == [
        "block can move along y without any force"
    ]
    assert undetermined(*active(pushed(0.1), "open")) == [
        "nothing touches block: it can move freely"
    ]
    for along, sign in (
        ("x", 1.0),
        ("-x", -1.0),
    ):  # friction at its limit pushes: against it the block is held
        pushes = np.array([[sign, 0.0, 0.0], [1.0, 0.0, 0.0]])
        said = undetermined(*active(pushed(0.1), "slip"), pushes)
        assert said == [f"block can move along {along} without any force"]
    one = (
        Blocks()
        .box("block", 0, 0, 1, 1)
        .contact("block", "floor", (0, 0), (1, 0), "coulomb", 0.5, nodes=1)
    )
    assert undetermined(*active(one, "stick")) == [
        "block can move most at (1, 1), along (-0.71, 0.71) without any force"
    ]
    assert len(undetermined(*active(one, "slip"))) == 2
    turn = np.linspace(0, 5, 9)
    normal = np.column_stack([np.cos(turn), np.sin(turn)])
    shaft = (
        Blocks(shift=(2, 1)).body("shaft", 0.5 * normal).curve("shaft", "hub", 0.5 * normal, normal)
    )
    assert undetermined(*active(shaft, "slip")) == [
        "shaft can turn counterclockwise about (2, 1) without any force"
    ]


def test_undetermined_motions_of_many_bodies(monkeypatch):
    """Heaps are looked at one by one, those of up to LARGEST bodies."""
    monkeypatch.setattr("ddmpi.judge.motions.LARGEST", few := 8)
    scene = Blocks()
    for k in range(few + 1):
        x, name = 3.0 * k, f"block{k}"
        scene.box(name, x, 0, 1, 1).contact(name, "floor", (x, 0), (x + 1.0, 0), "coulomb", 0.5)
    kinds = ["slip" if k == 7 else "stick" for k in range(few + 1)]
    assert undetermined(*active(scene, *kinds)) == ["block7 can move along x without any force"]
    for k in range(few):
        scene.contact(f"block{k}", f"block{k + 1}", (3.0 * k + 1.0, 0), (3.0 * k + 1.0, 1))
    assert undetermined(*active(scene, *["slip"] * (2 * few + 1))) == []


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_undetermined_motions_of_several_bodies(scale):
    """Bodies that stick to each other slide as one; each that slides on the one below does so alone."""
    scene = tower(0.25, 3, length=scale)
    along = "can move along x without any force"
    assert undetermined(*active(scene, "slip", "stick", "stick")) == [f"b0, b1 and b2 {along}"]
    assert undetermined(*active(scene, "stick", "slip", "stick")) == [f"b1 and b2 {along}"]
    assert len(undetermined(*active(scene, "slip", "slip", "slip"))) == 3
    assert undetermined(*active(scene, "stick", "open", "slip")) != []


@pytest.mark.parametrize("slips", [seldom(None), 30])
def test_a_long_stack_that_sways_is_resisted(slips):
    """By 2e-5 of its resistance to other motions, and by as much as it moves its joints; a joint that slips is seen
    beside that."""
    scene, height = Blocks(), 60
    for k in range(height):
        scene.box(f"b{k}", 0, k, 0.1, 1)
        scene.contact(
            f"b{k}", f"b{k - 1}" if k else "floor", (0, k), (0.1, k), "coulomb", 0.5, nodes=3
        )
    said = undetermined(*active(scene, *("slip" if k == slips else "stick" for k in range(height))))
    above = f"b30, b31 (and {height - 32} more) can move along x without any force"
    assert said == ([] if slips is None else [above])


# In space

AXES = (np.eye(3)[0], np.eye(3)[1])


def slab(push, law="coulomb", value=0.5, angle=0.0, **how):
    """A block of weight one on a floor, pushed along a direction in the floor, low enough not to tip."""
    along = (push * np.cos(angle), push * np.sin(angle), 0.0)
    return (
        Boxes(**how)
        .box("block", (0, 0, 0), (1, 1, 1), (along, (0.5, 0.5, 0.0)))
        .contact("block", "floor", (0, 0, 0), *AXES, law, value)
    )


def column(push, nodes=5, **how):
    """A slender block pushed along x at its top, in the middle of the edge."""
    return (
        Boxes(**how)
        .box("tower", (2, 0, 0), (1, 1, 4), ((push, 0.0, 0.0), (2.5, 0.5, 4.0)))
        .contact("tower", "floor", (2, 0, 0), *AXES, "coulomb", 0.8, nodes)
    )


def thread(force, pitch=0.25, **how):
    """A bolt without friction in a thread, pulled along z: at angle φ the thread's height is pitch times φ."""
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    radial, around = (
        np.column_stack([f(angle), g(angle), 0 * angle])
        for f, g in ((np.cos, np.sin), (lambda a: -np.sin(a), np.cos))
    )
    flank = [0, 0, 1.0] - pitch * around
    scene = Boxes(**how).box("bolt", (-1, -1, 0), (2, 2, 4), ((0, 0, force), (0, 0, 2)), weight=0.0)
    up = np.array([0, 0, 1.0])
    for side in (1, -1):
        scene.curve("bolt", "nut", radial + up, side * flank)
    return scene.curve(
        "bolt", "nut", np.vstack([radial, radial + 3 * up]), np.vstack([radial, radial])
    )


def loaded(push, at=(0.5, 0.5, 0.0), nodes=5, **how):
    """A block of weight ten on a floor of Tresca's friction of 0.5, pushed along (cos 17°, sin 17°)."""
    along = push * np.cos(np.radians(17.0)), push * np.sin(np.radians(17.0)), 0.0
    return (
        Boxes(**how)
        .box("block", (0, 0, 0), (1, 1, 1), (along, at), weight=10.0)
        .contact("block", "floor", (0, 0, 0), *AXES, "tresca", 0.5, nodes)
    )


def two_blocks(lower, upper):
    """The contact that is too weak slides, along the push, and the other one holds."""
    push = 0.7 if lower < upper else 0.4
    along = push * np.cos(np.radians(17.0)), push * np.sin(np.radians(17.0)), 0.0
    scene = Boxes().box("block", (0, 0, 0), (1, 1, 1), weight=10.0)
    scene.box("top", (0.25, 0.25, 1), (0.5, 0.5, 0.5), (along, (0.5, 0.5, 1.0)), weight=10.0)
    scene.contact("block", "floor", (0, 0, 0), *AXES, "tresca", lower, 12)
    return scene.contact(
        "top", "block", (0.25, 0.25, 1), AXES[0] / 2, AXES[1] / 2, "tresca", upper, 12
    )


def on_its_corner():
    """A tower that is pushed along the diagonal turns about the axis through its corner, square to the push."""
    push = 0.2 / np.sqrt(2)
    scene = Boxes().box("tower", (0, 0, 0), (1, 1, 4), ((push, push, 0.0), (0.5, 0.5, 4)))
    return scene.contact("tower", "floor", (0, 0, 0), *AXES, "coulomb", 0.8)


def twisted(couple):
    """A couple beyond what friction at the corners takes, ½ √½, turns a block about its axis."""
    pair = ((0, couple, 0), (1, 0.5, 0)), ((0, -couple, 0), (0, 0.5, 0))
    scene = Boxes().box("block", (0, 0, 0), (1, 1, 1), *pair)
    return scene.contact("block", "floor", (0, 0, 0), *AXES, "coulomb", 0.5)


def stack(shift, push):
    """Three blocks; the highest one is pushed along y."""
    scene = Boxes()
    for k in range(3):
        pushed_at = ((0, push * (k == 2), 0), (shift * k + 0.5, 0.5, k))
        scene.box(f"b{k}", (shift * k, 0, k), (1, 1, 1), pushed_at)
        scene.contact(
            f"b{k}",
            f"b{k - 1}" if k else "floor",
            (shift * k, 0, k),
            np.array([1 - shift * bool(k), 0, 0]),
            AXES[1],
            "coulomb",
            0.5,
        )
    return scene


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (slab(1e-5, "none"), SLIDES),
        (slab(9.0, "bonded"), EQUILIBRIUM),
        (column(0.1249), EQUILIBRIUM),
        (column(0.1251), "tower would move most at (2, 1, 4), along (0.97, 0, 0.24)"),
        (column(-0.15), "tower would move most at (3, 1, 4), along (-0.97, 0, 0.24)"),
        (on_its_corner(), "tower would move most at (0, 0, 4), along (0.67, 0.67, 0.33)"),
        (two_blocks(0.6, 3.0), "block and top would move along (0.96, 0.29, 0)"),
        (two_blocks(0.6, 0.3), "top would move along (0.96, 0.29, 0)"),
        (twisted(0.499 * np.sqrt(0.5)), EQUILIBRIUM),
        (
            twisted(0.6 * np.sqrt(0.5)),
            "block would turn about the axis through (0.5, 0.5, 0.5) along z",
        ),
        (
            twisted(-0.6 * np.sqrt(0.5)),
            "block would turn about the axis through (0.5, 0.5, 0.5) along -z",
        ),
        (thread(1.0), "bolt would turn about the axis through (0, 0, 2) along z"),
        (thread(-1.0), "bolt would turn about the axis through (0, 0, 2) along -z"),
        (thread(1.0, -0.25), "bolt would turn about the axis through (0, 0, 2) along -z"),
        (stack(0.25, 0.45), EQUILIBRIUM),
        (stack(0.25, 0.6), "b2 would move along y"),
        (stack(0.6, 0.0), "b1 and b2 would move most at (2.2, 1, 3), along (0.86, 0, -0.51)"),
    ],
)
def test_what_stands_and_what_moves_in_space(scene, said):
    assert words(scene) == said


@pytest.mark.parametrize("angle", np.radians([0.0, 11.25, 22.5, 290.0]))
def test_a_solid_block_slides_where_it_is_pushed(angle):
    """The cone is round: polygons of 16 sides around it would let the block stay up to 1.02 of the bound at 11.25°."""
    assert words(slab(0.4999, angle=angle)) == "equilibrium"
    x, y = np.cos(angle), np.sin(angle)
    assert found(slab(0.6, angle=angle)).velocities[0] == pytest.approx(
        [x, y, 0, 0, 0, 0], abs=1e-3
    )
    assert words(slab(0.5001, angle=angle)).startswith("block would move along ")


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_block_tips_at_its_limit(share):
    """It tips from a push on its top on that has half its weight times its width over its height."""
    push = 0.125 * share
    assert (found(tall(push)) is None) == (found(column(push)) is None) == (share < 1.0)


@pytest.mark.parametrize("push, nodes", [(0.505, 5), (1.5, 13), (0.7, 40)])
def test_given_friction_lets_a_block_slide_where_it_is_pushed(push, nodes):
    """Just beyond the bound or far beyond it, with few nodes or many, to 0.01 degrees."""
    exact = [np.cos(np.radians(17.0)), np.sin(np.radians(17.0)), 0, 0, 0, 0]
    assert found(loaded(push, nodes=nodes)).velocities[0] == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize(
    "how",
    [{"force": 1e9, "length": 1e3}, {"force": 1e-9, "length": 1e-3}, {"shift": (1e3, -1e3, 1e3)}],
    ids=str,
)
def test_units_and_origin_of_solids_do_not_matter(how):
    """The same is said, at the place that is meant."""
    assert words(column(0.1249, **how)) == "equilibrium"
    assert words(slab(0.6, **how)) == "block would move along x"
    assert_tips(column(0.13, **how), (2, 1, 4), "(0.97, 0, 0.24)")


@pytest.mark.parametrize(
    "make",
    [
        lambda **how: slab(0.6, **how),
        lambda **how: column(0.13, **how),
        lambda **how: thread(1.0, **how),
        lambda **how: loaded(0.6, **how),
        lambda **how: loaded(0.6, (0.5, 0.2, 0.0), **how),
    ],
    ids=["slab", "column", "thread", "loaded", "off centre"],
)
def test_a_turned_solid_moves_as_it_did_but_turned(make):
    """The mechanism does not depend on the axes."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    one, other = found(make()).velocities, found(make(turn=turn)).velocities
    assert other[:, :3] == pytest.approx(one[:, :3] @ turn.T, abs=1e-3)
    assert other[:, 3:] == pytest.approx(one[:, 3:] @ turn.T, abs=1e-3)


@pytest.mark.parametrize("bent", [0.0, 1e-4])
def test_corners_of_flat_contacts_serve_as_well_as_all_nodes(bent):
    """Nodes that are moved out of the plane are all kept, and give the same."""
    scene = column(0.13, nodes=9)
    scene.contacts[0].xy[:, 2] += (
        bent * np.random.default_rng(0).uniform(0, 1, 81) * (scene.contacts[0].xy[:, 0] < 2.9)
    )
    assert found(scene).imbalance == pytest.approx(found(column(0.13)).imbalance, rel=1e-3)


def test_undetermined_motions_in_space():
    """What no closed contact resists is listed: along a floor, about its normal, about a bore, as a screw."""
    tail = "without any force"
    assert undetermined(*active(slab(0.1), "stick")) == []
    assert sorted(undetermined(*active(slab(0.1), "slip"))) == [
        f"block can move along x {tail}",
        f"block can move along y {tail}",
        f"block can turn about the axis through (0.6, 0.6, 0.5) along z {tail}",
    ]  # the centre that the scene has
    assert undetermined(*active(slab(0.1), "open")) == ["nothing touches block: it can move freely"]
    one = Boxes().box("block", (0, 0, 0), (1, 1, 1))
    one.contact("block", "floor", (0, 0, 0), *AXES, "coulomb", 0.5, nodes=1)
    assert sorted(
        undetermined(*active(one, "stick"))
    ) == [  # about the axes through the node at the origin
        f"block can move most at (1, 1, 1), along {way} {tail}"
        for way in ("(-0.71, 0.71, 0)", "(0, -0.71, 0.71)", "(0.71, 0, -0.71)")
    ]
    assert undetermined(*active(thread(1.0), "slip", "slip", "slip")) == [
        f"bolt can turn about the axis through (0, 0, 2) along z {tail}"
    ]


# Motions and words


def test_motions_of_nodes_on_a_line():
    """Nodes that span no area have motions, too."""
    points = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    body = MotionsOfBody.of("line", points, np.ones((3, 2, 1)))
    assert (
        body.basis @ np.ones(1) == pytest.approx([1.0, 1.0, 0.0], abs=1e-12)
        and body.inertia[0, 0] > 0.0
    )


@pytest.mark.parametrize(
    "vector, said",
    [
        ((0, -1e-9), "-y"),
        ((8, 6), "(0.8, 0.6)"),
        ((-1, 1e-4), "-x"),
        ((0, 0, -2), "-z"),
        ((1, 1e-9, 0), "x"),
        ((0, 3, -4), "(0, 0.6, -0.8)"),
    ],
)
def test_directions(vector, said):
    """Directions along an axis are named by it."""
    assert direction(np.array(vector)) == said


def test_motions_of_solids_are_found_from_displacements():
    """Turnings are about the axes by the right hand, and the inertia is that of a box of density one."""
    points = 50.0 + np.array(
        [(x, y, z) for x in (0, 2) for y in (0, 1) for z in (0, 3)] + [(1.0, 0.5, 1.0)]
    )
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    turns = [np.cross(3 * axis, points - points[0]) for axis in axes]
    motions = np.stack([*turns, np.tile([0, 2.0, 0], (9, 1))], axis=2)
    body = MotionsOfBody.of("a", points, motions)
    assert body.centre == pytest.approx([51.0, 50.5, 51.5])
    for k, unit in enumerate(np.eye(4)):
        v = body.basis @ unit
        assert body.at(v, points) == pytest.approx(motions[:, :, k], abs=1e-8)
        assert v[3:] == pytest.approx(3 * axes[k] if k < 3 else np.zeros(3), abs=1e-9)
    shift = body.centre - points[0]  # about points[0], by Steiner
    moment = 9 * ((1.0 + 9.0) / 12 + shift[1:] @ shift[1:])
    assert np.diag(body.inertia)[[0, 3]] == pytest.approx([moment, 4.0], rel=1e-5)


def test_a_drift_is_named_by_how_far_nodes_move(monkeypatch):
    """A plate of 200 m that slides by 1 m and turns by 0.01 m at its farthest corner slides, whatever its size."""
    points = 100.0 * np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    x, y = (points - points.mean(axis=0)).T / np.hypot(100.0, 50.0)
    motions = np.stack(
        [np.outer(np.ones(4), axis) for axis in np.eye(2)] + [np.column_stack([-y, x])], axis=2
    )
    body = MotionsOfBody.of("plate", points, motions)
    monkeypatch.setattr(equilibrium, "with_partners", lambda *parts: [body])
    assembly = SimpleNamespace(
        world=MPI.COMM_SELF, joint=SimpleNamespace(slices={"plate": slice(0, 3)})
    )
    assert "plate would move along -x" in equilibrium.describe_drift(
        assembly, np.array([-1.0, 0.0, 0.01])
    )


def test_nodes_without_friction_bear_none_of_a_push():
    """Of five nodes along a line two have no slip bound: pushes are borne up to the sum of the others."""

    def found_under(push: float):
        scene = pushed(push, "tresca", 0.5)
        (contact,) = scene.contacts
        shares = np.array([0.0, 1.0, 3.0, 1.0, 0.0]) * contact.law.bound
        scene.contacts[:] = [replace(contact, law=replace(contact.law, bound=shares))]
        return found(scene)

    assert found_under(0.49) is None
    assert found_under(0.51) is not None
