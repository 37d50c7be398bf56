"""What the program promises of each feature in each kind of scene.

A feature is a function of the kind: it returns a scene, and either the words with which the program refuses it, or what
its answer is, by keys of summary.json: from statics, closed forms or Hooke's law in `kinds.py`, never from the program.
Beside these keys stand `field`, the displacement of all nodes by body, and `stored`, the strain energy with that of
springs, which load steps tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from kinds import BRASS, STEEL, Kind, Stuff, turned

LOAD = 3.1e5
"""A stress (Pa)."""

ALONG_THE_AXIS = "an axisymmetric partner is pushed along y only and does not turn"

THICKNESS = "bodies with contacts or foundations have the depth alone"


@dataclass
class Case:
    """A scene with its answer, or with the words that refuse it.

    Attributes
    ----------
    scene : as `ddmpi.solve` takes it
    refused : words of the message; empty where there is an answer
    told : by key of the summary the value, and what beside it is rounding
    fields : by body the displacement (nv, d) at points (nv, d)
    pressures : by contact its pressure (Pa), which is the same at all nodes
    slips : by contact how far each node slides in the last load step (m)
    stored : the strain energy of all bodies and springs, None where statics does not tell it
    """

    scene: dict
    refused: str = ""
    told: dict[str, tuple[Any, float]] = field(default_factory=dict)
    fields: dict[str, Callable] = field(default_factory=dict)
    pressures: dict[str, float] = field(default_factory=dict)
    slips: dict[str, float] = field(default_factory=dict)
    stored: float | None = None

    @property
    def joules(self) -> float:
        """An energy beside which 1e-9 is rounding."""
        return self.stored or LOAD**2 / STEEL.young[0]


FEATURES: dict[str, Callable[[Kind], Case]] = {}
"""All features by name."""


def feature(make: Callable[[Kind], Case]) -> Callable[[Kind], Case]:
    """A feature of the matrix, named by its function."""
    FEATURES[make.__name__.replace("_", " ")] = make
    return make


def told(size: float, **values: Any) -> dict[str, tuple[Any, float]]:
    """Values by key, in which __ stands for a dot; beside `size` is rounding."""
    return {key.replace("__", "."): (value, size) for key, value in values.items()}


# A block that is pulled upwards, by all kinds of loads


def pulled(
    kind: Kind,
    stuff: Stuff = STEEL,
    warm: float = 0.0,
    stress: float = LOAD,
    group: str = "top",
    **keys: Any,
) -> Case:
    """One stress upwards in a block on its guides, by loads on a `group`."""
    strain = kind.strains(stuff, stress, warm)
    force, top = stress * kind.area() * kind.up, kind.low[-1] + kind.size[-1]
    clamp = kind.guides() + keys.pop("clamp", [])
    scene = kind.scene(kind.block(stuff=stuff, clamp=clamp, **keys))
    size = LOAD * kind.area()
    stored = kind.stored(stuff, stress, warm) * kind.area() * kind.size[-1]
    found = told(
        size,
        bodies__block__reactions__bottom__force=-force,
        bodies__block__reactions__bottom__moment=kind.moment(kind.middle(kind.low[-1]), -force),
    )
    if "traction" in keys:
        found |= told(
            size,
            bodies__block__reaction=-force,
            bodies__block__loads__top__force=force,
            bodies__block__loads__top__moment=kind.moment(kind.middle(top), force),
        )
    else:
        found |= told(size, bodies__block__reaction=0.0 * force)
        if stress:
            found |= told(size, bodies__block__reactions__top__force=force)
    return Case(scene, told=found, fields={"block": kind.field(strain)}, stored=stored)


@feature
def traction_by_value(kind: Kind) -> Case:
    return pulled(kind, traction=[{"on": "top", "value": (LOAD * kind.up).tolist()}])


@feature
def target_of_a_result(kind: Kind) -> Case:
    """Stresses that are the same everywhere have no error: the first mesh meets any target."""
    case = pulled(kind, traction=[{"on": "top", "value": (LOAD * kind.up).tolist()}])
    target = {"bodies.block.displacement_max": 1e-3, "bodies.block.energy": {"within": LOAD}}
    case.scene["method"] = {"target": target, "tolerance": 1e-8}
    return replace(case, refused="method.target is for one load step" if kind.steps else "")


@feature
def traction_by_pressure(kind: Kind) -> Case:
    return pulled(kind, stress=-LOAD, traction=[{"on": "top", "pressure": LOAD}])


@feature
def traction_by_force(kind: Kind) -> Case:
    force = (LOAD * kind.area() * kind.up).tolist()
    return pulled(kind, traction=[{"on": "top", "force": force}])


@feature
def traction_by_formula(kind: Kind) -> Case:
    """On a part of the top, as far as the middle node, by a comparison."""
    limit = float(kind.middle(0.0)[0])
    load = kind.up.astype(object)
    load[load == 0.0], load[-1] = 0.0, f"{LOAD} * (x <= {limit})"
    scene = kind.scene(
        kind.block(
            clamp=kind.guides(),
            traction=[{"on": "top", "value": load.tolist()}],
        )
    )
    force, top = LOAD * kind.area(limit) * kind.up, kind.low[-1] + kind.size[-1]
    moment = kind.moment(kind.middle(top, limit), force)
    found = told(
        LOAD * kind.area(),
        bodies__block__loads__top__force=force,
        bodies__block__loads__top__moment=moment,
        bodies__block__reaction=-force,
    )
    return Case(scene, told=found)


@feature
def traction_by_moment(kind: Kind) -> Case:
    size = LOAD * kind.area()
    given = 0.11 * size if kind.d == 2 else [0.13 * size, 0.0, 0.07 * size]
    clamp = ["bottom"] if kind.order == 1 else [*kind.guides(), "bottom"]
    scene = kind.scene(kind.block(clamp=clamp, traction=[{"on": "top", "moment": given}]))
    if kind.axis:
        return Case(scene, refused="traction.0.moment")
    still = np.zeros(kind.d)
    found = told(
        size,
        bodies__block__loads__top__force=still,
        bodies__block__loads__top__moment=np.array(given),
        bodies__block__reaction=still,
        bodies__block__reactions__bottom__moment=-np.array(given),
    )
    return Case(scene, told=found)


@feature
def weight(kind: Kind) -> Case:
    """Between walls: u = −γ (H y − y²/2) / M, which elements of order 2 have, and γ² H³ A / 6 M is stored."""
    gamma, H, M = 5.3e5, kind.size[-1], kind.confined(STEEL)
    scene = kind.scene(
        kind.block(
            clamp=[*kind.walls(), kind.hold("bottom")], volume_force=(-gamma * kind.up).tolist()
        )
    )
    force = -gamma * kind.area() * H * kind.up
    found = told(
        gamma * kind.area() * H,
        bodies__block__reactions__bottom__force=-force,
    )
    if not kind.axis:
        found |= told(
            gamma * kind.area() * H,
            bodies__block__reaction=-force,
        )

    def sunk(points: np.ndarray) -> np.ndarray:
        y = points[:, -1:] - kind.low[-1]
        return -gamma * (H * y - 0.5 * y**2) / M * kind.up

    if kind.order == 1:
        return Case(scene, told=found)
    return Case(
        scene, told=found, fields={"block": sunk}, stored=gamma**2 * H**3 * kind.area() / 6 / M
    )


@feature
def weight_by_formula(kind: Kind) -> Case:
    """It grows along x by 0.6 from side to side; around an axis outer rings have more of it."""
    gamma, (low, *_), (width, *_) = 5.3e5, kind.low, kind.size
    load = (kind.up * 0.0).astype(object)
    load[-1] = f"-{gamma} * (1 + 0.6 * (x - {low}) / {width})"
    scene = kind.scene(kind.block(clamp=["bottom"], volume_force=load.tolist()))
    grown = 0.5 * kind.area()
    if kind.axis:  # ∫ (r - a) 2π r dr over the width
        a, b = low, low + width
        grown = 2 * np.pi * ((b**3 - a**3) / 3 - a * (b**2 - a**2) / 2) / width
    force = gamma * (kind.area() + 0.6 * grown) * kind.size[-1] * kind.up
    borne = np.where(kind.up > 0.0, force, np.nan) if kind.axis else force
    found = told(gamma * kind.area(), bodies__block__reactions__bottom__force=borne)
    return Case(scene, told=found)


@feature
def pressure_that_grows_upwards(kind: Kind) -> Case:
    """On a side, by 0.7 from its bottom to its top, as water's downwards; around an axis it has no resultant."""
    up, low, height = "xyz"[kind.d - 1], kind.low[-1], kind.size[-1]
    load = [{"on": "right", "pressure": f"{LOAD} * (1 + 0.7 * ({up} - {low}) / {height})"}]
    scene = kind.scene(kind.block(clamp=["bottom"], traction=load))
    if kind.axis:
        still = np.array([np.nan, 0.0])
        found = told(LOAD * kind.area(), bodies__block__reactions__bottom__force=still)
        return Case(scene, told=found)
    area = height * (kind.size[1] if kind.d == 3 else kind.thick)
    force = -1.35 * LOAD * area * kind.aside
    at = kind.middle(low + height * (0.5 + 0.7 / 3.0) / 1.35)
    at[0] = kind.low[0] + kind.size[0]
    moment = kind.moment(at, force)
    found = told(
        LOAD * area,
        bodies__block__loads__right__force=force,
        bodies__block__loads__right__moment=moment,
        bodies__block__reaction=-force,
        bodies__block__reactions__bottom__force=-force,
        bodies__block__reactions__bottom__moment=-np.array(moment),
    )
    return Case(scene, told=found)


# Supports


@feature
def moved_clamp(kind: Kind) -> Case:
    way = LOAD / kind.modulus(STEEL) * kind.size[-1]
    return pulled(kind, clamp=[kind.hold("top", way)])


@feature
def clamp_along_the_normal(kind: Kind) -> Case:
    way = LOAD / kind.modulus(STEEL) * kind.size[-1]
    return pulled(kind, clamp=[{"on": "top", "normal": way}])


@feature
def clamp_along_a_direction(kind: Kind) -> Case:
    """At the top, aside as well as up, by what a load leaves it to bear; what its nodes do across it is free."""
    strain, low, share = kind.strains(STEEL, LOAD), 0.0 if kind.axis else kind.low[0], 0.3 * LOAD
    way = 0.6 * kind.aside + 0.8 * kind.up
    lifted = 0.8 * strain[-1, -1] * kind.size[-1]
    held = {"on": "top", "along": [f"{5.0 * part} + 0*x" for part in way.tolist()]}
    held["value"] = f"{0.6 * strain[0, 0]} * (x - {low}) + {lifted}"
    load = LOAD * kind.up - share * way
    case = pulled(kind, clamp=[held], traction=[{"on": "top", "value": load.tolist()}])
    top = kind.middle(kind.low[-1] + kind.size[-1])
    borne = kind.area() * share * np.where(kind.axis * (kind.up == 0.0), np.nan, way)
    case.told |= told(
        LOAD * kind.area(),
        bodies__block__loads__top__force=LOAD * kind.area() * kind.up - borne,
        bodies__block__loads__top__moment=kind.moment(top, kind.area() * load),
        bodies__block__reactions__top__force=borne,
        bodies__block__reaction=borne - LOAD * kind.area() * kind.up,
    )
    return case


@feature
def clamp_by_formula(kind: Kind) -> Case:
    """A clamp that varies: the comparison holds at the node on its limit."""
    limit, way, top = float(kind.middle(0.0)[0]), 3.7e-4, kind.low[-1] + kind.size[-1]
    clamp = [*kind.guides(), kind.hold("top", f"{way} * (x <= {limit})")]
    scene = kind.scene(kind.block(clamp=clamp))

    def lifted(points: np.ndarray) -> np.ndarray:
        u = np.full(points.shape, np.nan)
        above = np.isclose(points[:, -1], top)
        u[above, -1] = way * (points[above, 0] < limit + 1e-9)
        return u

    return Case(scene, fields={"block": lifted})


@feature
def foundation_along_the_normal(kind: Kind) -> Case:
    """A block on a mat that is pressed: it sinks by q / k as a whole, beside its strains."""
    k, clamp = 4.7e8, kind.guides()[1:]
    scene = kind.scene(
        kind.block(
            clamp=clamp,
            foundation=[{"on": "bottom", "normal": k}],
            traction=[{"on": "top", "pressure": LOAD}],
        )
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    strain, force = kind.strains(STEEL, -LOAD), LOAD * kind.area() * kind.up
    stored = 0.5 * LOAD * kind.area() * (LOAD / k - strain[-1, -1] * kind.size[-1])
    found = told(
        LOAD * kind.area(),
        bodies__block__reaction=force,
        bodies__block__reactions__bottom__force=force,
        bodies__block__reactions__bottom__moment=kind.moment(kind.middle(kind.low[-1]), force),
    )
    field = kind.field(strain, -LOAD / k * kind.up)
    return Case(scene, told=found, fields={"block": field}, stored=stored)


@feature
def foundation_along_the_surface(kind: Kind) -> Case:
    """A block that is pushed where its springs are, along them, moves by q / k without strains."""
    k = 3.9e8
    on, way = ("right", kind.up) if kind.axis else ("bottom", kind.aside)
    foundation = [{"on": on, "tangential": k}]
    if not kind.axis:
        foundation[0]["normal"] = 2.3e8
    clamp = [] if kind.d == 2 else [{"on": "front", "y": 0.0}]
    scene = kind.scene(
        kind.block(
            clamp=clamp,
            foundation=foundation,
            traction=[{"on": on, "value": (LOAD * way).tolist()}],
        )
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    area = kind.area()
    if kind.axis:
        area = 2 * np.pi * (kind.low[0] + kind.size[0]) * kind.size[1]
    found = told(LOAD * area, bodies__block__reaction=-LOAD * area * way)
    field = kind.field(np.zeros((kind.d, kind.d)), LOAD / k * way)
    return Case(scene, told=found, fields={"block": field}, stored=0.5 * LOAD**2 / k * area)


# Heat and materials

WARM = 43.0
"""A temperature (K)."""


@feature
def heat_without_hindrance(kind: Kind) -> Case:
    return pulled(kind, warm=WARM, stress=0.0, temperature=WARM)


@feature
def heat_between_supports(kind: Kind) -> Case:
    """A heated block that cannot grow upwards: the stress −E' ε of its free strain ε."""
    free = kind.strains(STEEL, 0.0, WARM)[-1, -1]
    stress = -kind.modulus(STEEL) * free
    return pulled(kind, warm=WARM, stress=stress, temperature=WARM, clamp=[kind.hold("top")])


@feature
def heat_that_grows_upwards(kind: Kind) -> Case:
    """Between walls a layer strains by its own temperature: u = α' (T y + ½ T' y²) with α' = α (1+ν) / (1−ν), in plane
    stress α (1+ν)."""
    up, low, height = "xyz"[kind.d - 1], kind.low[-1], kind.size[-1]
    heat = f"{WARM} * (1 + 0.8 * ({up} - {low}) / {height})"
    clamp = [*kind.walls(), kind.hold("bottom")]
    scene = kind.scene(kind.block(clamp=clamp, temperature=heat))
    nu = STEEL.poisson[0]
    grows = STEEL.expansion[0] * (1 + nu)
    grows /= 1.0 if kind.name in ("stress", "plate") else 1 - nu

    def risen(points: np.ndarray) -> np.ndarray:
        y = points[:, -1:] - low
        return grows * WARM * (y + 0.4 * y**2 / height) * kind.up

    size = STEEL.young[0] * grows * WARM * kind.area()
    found = told(size, bodies__block__reactions__bottom__force=0.0 * kind.up)
    if kind.axis:
        found = {}
    fields = {"block": risen} if kind.order == 2 else {}
    return Case(scene, told=found, fields=fields)


def orthotropic(kind: Kind) -> Stuff:
    """Three unlike moduli; around an axis the same along the radius and around it, as else no stress is even."""
    if kind.axis:
        n12 = 0.17
        return Stuff(
            (3.1e9, 7.3e9, 3.1e9),
            (n12, 0.22, n12 * 7.3 / 3.1),
            (1.9e9, 1.2e9, 1.9e9),
            (1.1e-5, 2.3e-5, 1.1e-5),
        )
    return Stuff(
        (3.1e9, 7.3e9, 5.2e9), (0.17, 0.22, 0.29), (1.9e9, 1.2e9, 2.6e9), (1.1e-5, 2.3e-5, 0.7e-5)
    )


@feature
def orthotropic_material(kind: Kind) -> Case:
    load = [{"on": "top", "value": (LOAD * kind.up).tolist()}]
    return pulled(kind, stuff=orthotropic(kind), traction=load)


@feature
def orthotropic_material_turned(kind: Kind) -> Case:
    """Pulled between its axes it also turns aside."""
    load = [{"on": "top", "value": (LOAD * kind.up).tolist()}]
    axes = turned(28.0) if kind.d == 2 else turned(28.0, (0.3, -0.5, 0.8))
    both = {"axes": [axes[:, 0].tolist(), axes[:, 1].tolist()]}
    turn = {"angle": 28.0} if kind.d == 2 else both
    straight = orthotropic(kind)
    stuff = Stuff(straight.young, straight.poisson, straight.shear, straight.expansion, axes)
    if kind.axis:  # a cone of fibres: no stress is even, but the loads are what they are
        scene = kind.scene(kind.block(stuff=stuff, clamp=kind.guides(), more=turn, traction=load))
        force = LOAD * kind.area() * kind.up
        return Case(scene, told=told(LOAD * kind.area(), bodies__block__reaction=-force))
    return pulled(kind, stuff=stuff, traction=load, more=turn)


@feature
def orthotropic_material_heated(kind: Kind) -> Case:
    return pulled(kind, stuff=orthotropic(kind), warm=WARM, stress=0.0, temperature=WARM)


# Contacts of two blocks, one on the other

BELOW = 0.4375
"""The height of the lower block (m)."""


def stacked(kind: Kind, /, stress: float = -LOAD, walls: bool = False, **contact: Any) -> Case:
    """Two blocks on each other under one stress upwards, free to strain aside or between walls."""
    level = float(kind.low[-1])
    bottom = level - BELOW
    cells = contact.pop("cells", {2: (2, 1), 3: (2, 1, 1)}[kind.d])
    aside = kind.walls() if walls else kind.guides()[1:]
    scene = kind.scene(
        kind.block(
            "upper",
            clamp=aside,
            traction=[{"on": "top", "value": (stress * kind.up).tolist()}],
        ),
        kind.block(
            "lower", BRASS, bottom, height=BELOW, cells=cells, clamp=[*aside, kind.hold("bottom")]
        ),
        contact=[{"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | contact],
        grows=contact.get("kind", "unilateral") == "unilateral",
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)

    def strains(stuff: Stuff) -> np.ndarray:
        if walls:
            return np.diag(stress / kind.confined(stuff) * kind.up)
        return kind.strains(stuff, stress)

    upper, lower = strains(STEEL), strains(BRASS)
    force = -stress * kind.area() * kind.up
    found = told(
        LOAD * kind.area(),
        **{
            "contacts__upper-lower__force": force,
            "contacts__upper-lower__moment": kind.moment(kind.middle(level), force),
            "contacts__upper-lower__normal_force": -stress * kind.area(),
            "contacts__upper-lower__tangential_force": 0.0,
            "contacts__upper-lower__open": 0,
        },
    )
    if (
        "friction" in contact and not kind.axis
    ):  # nothing pulls; around an axis it never acts along this
        found |= told(1.0, **{"contacts__upper-lower__utilisation": 0.0})
    fields = {
        "upper": kind.field(upper, BELOW * lower[-1, -1] * kind.up),
        "lower": kind.field(lower, bottom=bottom),
    }
    heights = ((upper, kind.size[-1]), (lower, BELOW))
    stored = sum(0.5 * stress * strain[-1, -1] * height for strain, height in heights)
    pressures = {"upper-lower": -stress}
    stored *= kind.area()
    return Case(scene, told=found, fields=fields, pressures=pressures, stored=stored)


UNLIKE = {2: (3, 2), 3: (3, 2, 1)}
"""Cells of a lower block that does not match the upper one."""


@feature
def contact_of_matching_nodes(kind: Kind) -> Case:
    return stacked(kind)


@feature
def contact_by_mortar(kind: Kind) -> Case:
    return stacked(kind, cells=UNLIKE[kind.d])


@feature
def contact_by_mortar_with_the_other_slave(kind: Kind) -> Case:
    return stacked(kind, cells=UNLIKE[kind.d], slave="upper")


@feature
def coulombs_friction_that_sticks(kind: Kind) -> Case:
    return stacked(kind, walls=True, friction={"law": "coulomb", "coefficient": 0.37})


@feature
def trescas_friction_that_sticks(kind: Kind) -> Case:
    friction = {"law": "tresca", "slip_bound": 0.4 * LOAD}
    return stacked(kind, walls=True, friction=friction, cells=UNLIKE[kind.d])


@feature
def bond_that_is_pulled(kind: Kind) -> Case:
    return stacked(kind, LOAD, walls=True, kind="bonded")


@feature
def bond_by_mortar_that_is_pulled(kind: Kind) -> Case:
    return stacked(kind, LOAD, walls=True, kind="bonded", cells=UNLIKE[kind.d])


@feature
def guide_that_is_pulled(kind: Kind) -> Case:
    return stacked(kind, LOAD, kind="guided")


@feature
def periodic_cell(kind: Kind) -> Case:
    """A block that is pulled upwards, whose sides are bonded to those of its neighbours: it cannot strain aside."""
    axes = range(kind.d - 1)
    sides = [("left", "right"), ("front", "back")]
    contacts = [
        {"name": f"side{k}", "bodies": ["block", "block"], "on": list(sides[k]), "kind": "bonded"}
        | {"image": {"shift": (-kind.size[k] * np.eye(kind.d)[k]).tolist()}}
        for k in axes
    ]
    traction = [{"on": "top", "value": (LOAD * kind.up).tolist()}]
    scene = kind.scene(kind.block(clamp=[kind.hold("bottom")], traction=traction), contact=contacts)
    if kind.axis:
        return Case(scene, refused="axisymmetric bodies have images along y only")
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    nu = STEEL.poisson[0]
    aside = LOAD * (nu if kind.name == "stress" else nu / (1 - nu))
    strain = np.diag(LOAD / kind.confined(STEEL) * kind.up)
    areas = [np.prod(np.delete(kind.size, k)) for k in axes]
    found = told(
        LOAD * kind.area(),
        bodies__block__reactions__bottom__force=-LOAD * kind.area() * kind.up,
        **{f"contacts__side{k}__normal_force": -aside * areas[k] for k in axes},
    )
    stored = 0.5 * LOAD * strain[-1, -1] * kind.area() * kind.size[-1]
    return Case(scene, told=found, fields={"block": kind.field(strain)}, stored=stored)


@feature
def slit_ring(kind: Kind) -> Case:
    """A ring, around an axis a torus, that is cut open by a slit of almost no width, under one pressure: it is alike
    in all directions, so that the sides of its slit bear this pressure, and every node moves towards one point."""
    middle, (inner, outer), parts, span = kind.low + 1.9, (0.0625, 0.9375), 7, 360.0 - 4e-7
    mesh = {
        "shape": "annulus",
        "center": middle.tolist(),
        "radii": [inner, outer],
        "angles": [0.0, span],
        "divisions": [parts, 1],
        "order": kind.order,
    }
    pressed = [{"on": on, "pressure": LOAD} for on in ("inner", "outer")]
    # one side of the slit stands on a level along which it may slide
    clamp = [{"on": "start", "y": 0.0}] + [{"on": "start & inner", "x": 0.0}] * (not kind.axis)
    scene = kind.scene(
        kind.block(clamp=clamp, traction=pressed) | {"mesh": mesh},
        contact=[{"name": "slit", "bodies": ["block"] * 2, "on": ["start", "end"], "gap": 0.0}],
        grows=True,
    )
    if kind.d == 3:
        return Case(scene, refused="body.block.mesh.shape = annulus")
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    E, n = STEEL.young[0], STEEL.poisson[0]
    shrinks = {"stress": 1 - n, "strain": (1 + n) * (1 - 2 * n), "axis": 1 - 2 * n}[kind.name]
    shrinks *= LOAD / E
    # of an element the sector, whose arc is a chord or, of order 2, a parabola
    turn = np.deg2rad(span / parts)
    sector = 0.5 * np.sin(turn)
    if kind.order == 2:
        sector += 4 / 3 * np.sin(0.5 * turn) * (1 - np.cos(0.5 * turn))
    area, sides = parts * sector * (outer**2 - inner**2), outer - inner
    stored = LOAD * shrinks * area
    if kind.axis:
        sides *= 2 * np.pi * (middle[0] + 0.5 * (inner + outer))
        stored *= 1.5 * 2 * np.pi * middle[0]
    fixed = np.array([0.0 if kind.axis else middle[0] + inner, middle[1]])
    found = told(
        LOAD * sides,
        contacts__slit__force=LOAD * sides * kind.up,
        contacts__slit__normal_force=LOAD * sides,
        bodies__block__reaction=0.0 * kind.up,
    )
    fields = {"block": lambda points: -shrinks * (points - fixed)}
    return Case(scene, told=found, fields=fields, pressures={"slit": LOAD}, stored=stored)


@feature
def drawn_shaft(kind: Kind) -> Case:
    """A cylinder with at least so many elements around it that is pulled aside and along its axis, which bends it."""
    height, size = 0.3125, LOAD * kind.area()
    bottom, top = (np.array([0.75, -0.3125, at]) for at in (0.375, 0.375 + height))
    mesh = {
        "shape": "cylinder",
        "center": bottom.tolist(),
        "axis": [0.0, 0.0, 1.7],
        "radii": [0.0, 0.4375],
        "height": height,
        "size": 0.5,
        "around": 9,
        "order": kind.order,
    }
    force = size * (0.7 * kind.up + 0.17 * kind.aside)
    traction = [{"on": "top", "force": force.tolist()}]
    scene = kind.scene(kind.block(clamp=["bottom"], traction=traction) | {"mesh": mesh})
    if kind.d == 2:
        return Case(scene, refused="body.block.mesh.shape = cylinder")
    found = told(
        size,
        bodies__block__loads__top__force=force,
        bodies__block__loads__top__moment=np.cross(top, force),
        bodies__block__reaction=-force,
        bodies__block__reactions__bottom__moment=-np.cross(top, force),
    )
    return Case(scene, told=found)


@feature
def pretension(kind: Kind) -> Case:
    """A cut between two supports: the given force, with the offset that both blocks give way."""
    case = stacked(kind, LOAD, walls=True, kind="bonded")
    force = LOAD * kind.area()
    upper = case.scene["body"][0]
    del upper["traction"]
    upper["clamp"].append(kind.hold("top"))
    bond = case.scene["contact"][0]
    bond["pretension"] = {"force": -force, "along": (1.7 * kind.up).tolist()}
    if kind.steps:
        bond["pretension"] |= {"force": -force / 0.6, "history": "way"}
    if case.refused:
        return case
    way = sum(
        LOAD * height / kind.confined(stuff)
        for stuff, height in ((STEEL, kind.size[-1]), (BRASS, BELOW))
    )
    case.told = told(
        force,
        **{
            "contacts__upper-lower__force": -force * kind.up,
            "contacts__upper-lower__pretension__force": -force,
        },
    ) | told(way, **{"contacts__upper-lower__pretension__offset": -way})
    pulled_down = LOAD / kind.confined(STEEL) * kind.size[-1] * kind.up
    strain = np.diag(LOAD / kind.confined(STEEL) * kind.up)
    case.fields["upper"] = kind.field(strain, -pulled_down)
    return case


# Contacts with rigid partners


def on_floor(kind: Kind, stress: float, floor: dict | None = None, **contact: Any) -> Case:
    """A block on a rigid floor under one stress upwards."""
    keys = contact.pop("block")
    clamp = kind.guides()[1:] + keys.pop("clamp", [])
    shift = contact.pop("shift", 0.0)
    scene = kind.scene(
        kind.block(clamp=clamp, **keys),
        rigid=[kind.floor(**(floor or {}))],
        contact=[{"bodies": ["block", "floor"], "on": ["bottom"]} | contact],
        grows=True,
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    force = -stress * kind.area() * kind.up
    found = told(
        LOAD * kind.area(),
        **{
            "contacts__block-floor__force": force,
            "contacts__block-floor__moment": kind.moment(kind.middle(kind.low[-1]), force),
            "contacts__block-floor__normal_force": force[-1],
            "rigid__floor__force": -force,
        },
    )
    strain = kind.strains(STEEL, stress)
    stored = kind.stored(STEEL, stress) * kind.area() * kind.size[-1]
    fields, pressures = {"block": kind.field(strain, shift)}, {"block-floor": -stress}
    return Case(scene, told=found, fields=fields, pressures=pressures, stored=stored)


@feature
def rigid_floor(kind: Kind) -> Case:
    return on_floor(kind, -LOAD, block={"traction": [{"on": "top", "pressure": LOAD}]})


@feature
def soft_joint(kind: Kind) -> Case:
    """A block on a layer sinks by the pressure times its softness."""
    sunk, block = 3.1e-4, {"traction": [{"on": "top", "pressure": LOAD}]}
    case = on_floor(kind, -LOAD, block=block, softness=sunk / LOAD, shift=-sunk * kind.up)
    if case.stored is not None:
        case.stored += 0.5 * LOAD * sunk * kind.area()
    return case


@feature
def soft_joint_by_a_table(kind: Kind) -> Case:
    """A layer that gets stiffer, from 0.4 of the load on."""
    table = {"pressure": [0.0, 0.4 * LOAD, 1.6 * LOAD], "closure": [0.0, 2.3e-4, 2.9e-4]}
    sunk, block = 2.6e-4, {"traction": [{"on": "top", "pressure": LOAD}]}
    case = on_floor(kind, -LOAD, block=block, softness=table, shift=-sunk * kind.up)
    if case.stored is not None:
        case.stored += (0.2 * 2.3e-4 + 0.7 * 0.3e-4) * LOAD * kind.area()
    return case


def squeezed(kind: Kind) -> float:
    """How far a block under the stress LOAD gives way (m)."""
    return LOAD / kind.modulus(STEEL) * kind.size[-1]


@feature
def moved_floor(kind: Kind) -> Case:
    way = squeezed(kind) * kind.up
    floor = {"displacement": way.tolist()}
    return on_floor(kind, -LOAD, floor, block={"clamp": [kind.hold("top")]}, shift=way)


@feature
def floor_that_slides(kind: Kind) -> Case:
    """Without friction a block and the floor below go opposite ways; around an axis the block stays."""
    way, back = 2.3e-4, 0.0 if kind.axis else -0.9e-4
    walls = [wall | ({"x": back} if "x" in wall else {}) for wall in kind.walls()]
    scene = kind.scene(
        kind.block(clamp=walls, traction=[{"on": "top", "pressure": LOAD}]),
        rigid=[kind.floor(displacement=(way * kind.aside).tolist())],
        contact=[{"bodies": ["block", "floor"], "on": ["bottom"]}],
        grows=True,
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    force = LOAD * kind.area() * kind.up
    found = told(LOAD * kind.area(), **{"contacts__block-floor__force": force})
    last = 0.5 * (0.6 - 0.35) / 0.6 if kind.steps else 1.0
    slips = {"block-floor": last * (way - back)}
    return Case(scene, told=found, pressures={"block-floor": LOAD}, slips=slips)


@feature
def pushed_floor(kind: Kind) -> Case:
    way = squeezed(kind) * kind.up
    floor = {"force": (LOAD * kind.area() * kind.up).tolist()}
    case = on_floor(kind, -LOAD, floor, block={"clamp": [kind.hold("top")]}, shift=way)
    if not case.refused:
        case.told |= told(way[-1], rigid__floor__displacement=way)
    return case


@feature
def interference(kind: Kind) -> Case:
    way = squeezed(kind)
    block = {"clamp": [kind.hold("top")]}
    return on_floor(kind, -LOAD, block=block, gap=-way, shift=way * kind.up)


@feature
def gap_that_closes(kind: Kind) -> Case:
    """A block above a floor comes down by its gap, and then gives way."""
    way, gap = squeezed(kind), 2.9e-5
    block = {"clamp": [kind.hold("top", -way - gap)]}
    return on_floor(kind, -LOAD, block=block, gap=gap, shift=-gap * kind.up)


def sliding(kind: Kind, friction: dict, bound: float | None) -> Case:
    """A block that is pressed and dragged on a floor, around an axis a ring that is pulled through a tight bore."""
    drag = 0.21  # so far that the block, which grows aside, slips along x to 1e-9
    if kind.axis:
        scene = kind.scene(
            kind.block(clamp=[kind.hold("left", drag)]),
            rigid=[
                {
                    "name": "floor",
                    "shape": "plane",
                    "point": [float(kind.low[0] + kind.size[0]), 0.0],
                    "normal": [-1.0, 0.0],
                }
            ],
            contact=[
                {
                    "bodies": ["block", "floor"],
                    "on": ["right"],
                    "friction": friction,
                    "gap": -1.7e-4,
                }
            ],
            grows=True,
        )
        area = 2 * np.pi * (kind.low[0] + kind.size[0]) * kind.size[1]
    else:
        clamp = [{"on": "top", "x": drag}]
        if kind.d == 3:
            clamp.append({"on": "top", "y": 0.0})
        scene = kind.scene(
            kind.block(clamp=clamp, traction=[{"on": "top", "pressure": LOAD}]),
            rigid=[kind.floor()],
            contact=[{"bodies": ["block", "floor"], "on": ["bottom"], "friction": friction}],
            grows=True,
        )
        area = kind.area()
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)

    def rubs(summary: dict) -> float:
        """Tresca's bound over the area, Coulomb's of the normal force, which statics tell but around an axis."""
        normal = summary["contacts"]["block-floor"]["normal_force"] if kind.axis else LOAD * area
        return bound * area if "slip_bound" in friction else friction["coefficient"] * normal

    def against(summary: dict) -> np.ndarray:
        force = -rubs(summary) * (kind.up if kind.axis else kind.aside)
        if kind.axis:
            return np.where(kind.up > 0.0, force, np.nan)
        return np.where(kind.up > 0.0, LOAD * area, np.where(kind.aside > 0.0, force, np.nan))

    found = told(
        LOAD * area,
        **{
            "contacts__block-floor__tangential_force": lambda summary: rubs(summary),
            "contacts__block-floor__force": against,
            "contacts__block-floor__open": 0,
            "contacts__block-floor__stick": 0,
        },
    )
    found |= told(1.0, **{"contacts__block-floor__utilisation": 1.0})
    return Case(scene, told=found)


@feature
def coulombs_friction_that_slips(kind: Kind) -> Case:
    return sliding(kind, {"law": "coulomb", "coefficient": 0.09}, None)


@feature
def trescas_friction_that_slips(kind: Kind) -> Case:
    bound = 0.08 * LOAD
    return sliding(kind, {"law": "tresca", "slip_bound": bound}, bound)


@feature
def trescas_friction_that_grows(kind: Kind) -> Case:
    """A slip bound by a profile: the force is its mean over the contact, here that of its ends."""
    k = 1 if kind.axis else 0
    ends = [float(kind.low[k]), float(kind.low[k] + kind.size[k])]
    bounds = [0.05 * LOAD, 0.11 * LOAD]
    profile = {"along": "xy"[k], "points": ends, "values": bounds}
    return sliding(kind, {"law": "tresca", "slip_bound": profile}, 0.08 * LOAD)


@feature
def trescas_friction_by_formula(kind: Kind) -> Case:
    """The same bound as that of the profile."""
    k = 1 if kind.axis else 0
    start, slope = kind.low[k], 0.06 * LOAD / kind.size[k]
    return sliding(
        kind,
        {"law": "tresca", "slip_bound": f"{0.05 * LOAD} + {slope} * ({'xy'[k]} - {start})"},
        0.08 * LOAD,
    )


@feature
def friction_that_wears_in(kind: Kind) -> Case:
    """It ends at the coefficient that statics is asked with."""
    case = sliding(kind, {"law": "coulomb", "coefficient": 0.09}, None)
    given = {"value": 0.09 / 0.7, "history": "wear"} if kind.steps else "0.09 + 0*x"
    for contact in case.scene["contact"]:
        contact["friction"] = {"law": "coulomb", "coefficient": given}
    if kind.steps:
        case.scene["history"]["wear"] = {"times": [0.0, 1.0, 2.3], "factors": [1.0, 1.2, 0.7]}
    return case


@feature
def far_motion(kind: Kind) -> Case:
    """A block that is held at its top comes from far above a floor, and is pressed by what is left of its way."""
    way, above = squeezed(kind), 3.7
    block = kind.block(clamp=[*kind.guides()[1:], kind.hold("top")])
    block["motion"] = {"shift": (-(above + way) * kind.up).tolist()}
    floor = kind.floor(point=(kind.low - above * kind.up).tolist())
    contact = [{"bodies": ["block", "floor"], "on": ["bottom"]}]
    scene = kind.scene(block, rigid=[floor], contact=contact, grows=True)
    scene["time"] = scene.get("time", {"points": [1.0], "steps": 1}) | {"motions": "far"}
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    force = LOAD * kind.area() * kind.up
    found = told(
        LOAD * kind.area(),
        **{
            "contacts__block-floor__force": force,
            "contacts__block-floor__normal_force": LOAD * kind.area(),
            "rigid__floor__force": -force,
        },
    )
    return Case(scene, told=found)


@feature
def floor_that_a_force_moves_far(kind: Kind) -> Case:
    """The pushed floor, whose motion is free as of bodies that move far."""
    case = pushed_floor(kind)
    (floor,) = case.scene["rigid"]
    pushed = {key: floor.pop(key) for key in ("force", "history") if key in floor}
    floor["motion"] = pushed | {"free": ["xyz"[kind.d - 1]]}
    time = case.scene.get("time", {"points": [1.0], "steps": 1})
    case.scene["time"] = time | {"motions": "far"}
    return case


def on_round(kind: Kind, shape: str, only: int) -> Case:
    """A block that is pressed on a round partner: the height of the force is the load, wherever they touch."""
    at, radius = kind.middle(kind.low[-1]), 1.9
    centre = (at - radius * kind.up).tolist()
    where = (
        {"point": centre, "axis": [0.0, 1.3, 0.0]} if shape == "cylinder" else {"center": centre}
    )
    scene = kind.scene(
        kind.block(clamp=kind.walls(), traction=[{"on": "top", "pressure": LOAD}]),
        rigid=[{"name": "round", "shape": shape, "radius": radius} | where],
        contact=[{"bodies": ["block", "round"], "on": ["bottom"]}],
        grows=True,
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    if kind.d != only:
        return Case(scene, refused=f"a {shape} is a shape")
    force = np.where(kind.up > 0.0, LOAD * kind.area(), np.nan)
    keys = {"contacts__block-round__force": force, "rigid__round__force": -force}
    return Case(scene, told=told(LOAD * kind.area(), **keys))


@feature
def round_partner_in_the_plane(kind: Kind) -> Case:
    return on_round(kind, "circle", 2)


@feature
def ball(kind: Kind) -> Case:
    return on_round(kind, "sphere", 3)


@feature
def shaft(kind: Kind) -> Case:
    return on_round(kind, "cylinder", 3)


def carried(kind: Kind, shape: dict, moment: Any) -> Case:
    """A partner that is bonded to the top brings its force and moment there, and the clamp bears both."""
    size = LOAD * kind.area()
    pivot = kind.middle(kind.low[-1] + kind.size[-1]) + 0.23 * kind.up
    force = 0.7 * size * kind.up + 0.17 * size * kind.aside
    if kind.axis:
        force = 0.7 * size * kind.up
    turn = {} if moment is None else {"moment": moment, "pivot": pivot.tolist()}
    free = {"free": list("xyz"[: kind.d])} if moment is None and not kind.axis else {}
    scene = kind.scene(
        kind.block(clamp=["bottom"]),
        rigid=[{"name": "tool", "force": force.tolist()} | turn | free | shape],
        contact=[{"bodies": ["block", "tool"], "on": ["top"], "kind": "bonded"}],
    )
    if kind.name == "plate":
        return Case(scene, refused=THICKNESS)
    # around an axis what holds a radius is no resultant
    borne = np.where(kind.up > 0.0, -force, np.nan if kind.axis else -force)
    found = told(size, bodies__block__reactions__bottom__force=borne)
    if moment is not None:
        about = kind.moment(pivot, force) + np.array(moment)
        found |= told(size, bodies__block__reactions__bottom__moment=-about)
    return Case(scene, told=found)


def plate_on_top(kind: Kind) -> dict:
    """A rigid plane that looks down on the top of the block."""
    at = kind.middle(kind.low[-1] + kind.size[-1])
    return {"shape": "plane", "point": at.tolist(), "normal": (-kind.up).tolist()}


def some_moment(kind: Kind) -> Any:
    size = LOAD * kind.area()
    return 0.13 * size if kind.d == 2 else [0.05 * size, 0.11 * size, 0.07 * size]


@feature
def pushed_plate(kind: Kind) -> Case:
    return carried(kind, plate_on_top(kind), None)


@feature
def turned_plate(kind: Kind) -> Case:
    case = carried(kind, plate_on_top(kind), some_moment(kind))
    return Case(case.scene, refused=ALONG_THE_AXIS) if kind.axis else case


@feature
def reference_node(kind: Kind) -> Case:
    case = carried(kind, {"shape": "node"}, some_moment(kind))
    return Case(case.scene, refused=ALONG_THE_AXIS) if kind.axis else case
