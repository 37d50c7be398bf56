#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Round parts that are free to turn without friction, and parts without a load: steps, displacements, pressures.

    scripts/study round_parts                      # all of them, and the table of docs/tables/round_parts.md
    scripts/study round_parts --only shaft         # the scenes whose name has this word, to the screen alone

Contacts resist such a motion by the errors of normals and gaps alone, so that it is held. Prints a line for each scene
with what is left of the loads along held motions, and the bound of it. The study ends with 1 if a scene takes more than
20 steps (the balls 30), or more than FEW and twice those of its half with a plane of symmetry, or has another verdict,
displacement or pressure than it should have: that of its half, of forces in balance, or of the same scene with a little
friction, to the tolerance of the mesh.
"""

import itertools
import math
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from experiment import ROOT, arguments, publish, table
from mpi4py import MPI

import ddmpi

ROUND = ROOT / "scripts" / "round"
Scene = dict[str, Any]
STEEL = {"young": 2.1e5, "poisson": 0.3}
ALLOY = {"young": 7e4, "poisson": 0.33}
SOFT = {"young": 1e5, "poisson": 0.3}
MILLIMETRES = {"length_unit": "mm", "stress_unit": "MPa"}
CERTIFIED, NONE = "converged and certified", "no equilibrium"
ANY = (0.0, math.inf)


FEW = 8
"""So many steps are few, whatever the half of a scene takes."""


class Case(NamedTuple):
    """A scene, and what its answer should be.

    Attributes
    ----------
    name, scene : of the table; as data
    verdict : how the reason begins
    moved : least and most largest displacement of the first body (mm)
    pressed : least and most of `force` (N, per mm in the plane) or `pressure_max` (MPa) of the first contact
    of : which of the two
    steps : most
    half : the same scene with a plane of symmetry, of which it takes at most twice the steps
    held : how many motions are held; None for any number
    """

    name: str
    scene: Scene
    verdict: str = CERTIFIED
    moved: tuple[float, float] = ANY
    pressed: tuple[float, float] = ANY
    of: str = "pressure_max"
    steps: int = 20
    half: Scene | None = None
    held: int | None = None


def ring(x: float, radii: tuple[float, float], divisions: tuple[int, int], order: int) -> Scene:
    return {
        "shape": "annulus",
        "center": [0.0, x],
        "radii": list(radii),
        "angles": [0.0, 360.0],
        "divisions": list(divisions),
        "order": order,
    }


def shaft(
    around: tuple[int, int],
    order: int,
    pull: tuple[float, float] = (0.0, -1000.0),
    moment: float = 0.0,
    clearance: float = 0.05,
) -> Scene:
    """A shaft in a bush with a clearance, which it touches below, under a force and a moment (N, N mm, per mm)."""
    area, inertia = math.pi * (10.0**2 - 4.0**2), math.pi / 4.0 * (10.0**4 - 4.0**4)
    return {
        "body": [
            {
                "name": "shaft",
                "mesh": ring(-clearance, (4.0, 10.0), (around[0], 6), order),
                "material": STEEL,
                "volume_force": [pull[0] / area, f"{pull[1] / area!r} + {moment / inertia!r} * x"],
            },
            {
                "name": "bush",
                "mesh": ring(0.0, (10.0 + clearance, 20.0), (around[1], 6), order),
                "material": ALLOY,
                "clamp": ["outer"],
            },
        ],
        "contact": [{"bodies": ["shaft", "bush"], "on": ["outer", "inner"]}],
        "output": MILLIMETRES,
    }


def half_shaft(around: tuple[int, int], order: int) -> Scene:
    """The right half of the same."""
    scene = shaft((around[0] // 2, around[1] // 2), order)
    for body in scene["body"]:
        body["mesh"]["angles"] = [-90.0, 90.0]
        body["clamp"] = [*body.get("clamp", []), *({"on": on, "x": 0.0} for on in ("start", "end"))]
    return scene


def loose_bush(order: int) -> Scene:
    """The bush is loose in a housing: two turns are free."""
    bodies = [
        ("shaft", -0.1, (4.0, 10.0), (60, 6), STEEL),
        ("bush", -0.05, (10.05, 15.0), (52, 5), ALLOY),
        ("housing", 0.0, (15.05, 30.0), (70, 6), STEEL),
    ]
    body = [
        {"name": name, "mesh": ring(x, radii, divisions, order), "material": material}
        for name, x, radii, divisions, material in bodies
    ]
    body[0]["volume_force"] = [0.0, -3.79]
    body[2]["clamp"] = ["outer"]
    pairs = (["shaft", "bush"], ["bush", "housing"])
    contact = [{"bodies": pair, "on": ["outer", "inner"]} for pair in pairs]
    return {"body": body, "contact": contact, "output": MILLIMETRES}


def pin(size: float, order: int, pull: tuple[float, Any], shape: str = "") -> Scene:
    """A pin of 20 mm hangs in a lug with a bore of 20.1 mm, and is pulled by 1 kN/mm. The `shape` is "half_" for the right
    half, "lobed_" where both have three lobes of a thousandth of the radius."""
    bodies = (("pin", STEEL), ("lug", ALLOY))
    body: list[Scene] = [
        {
            "name": name,
            "mesh": {"geometry": str(ROUND / f"{shape}{name}.geo"), "size": size, "order": order},
            "material": material,
        }
        for name, material in bodies
    ]
    body[0]["volume_force"] = list(pull)
    body[1]["clamp"] = ["top"]
    if shape == "half_":
        for each in body:
            each["clamp"] = [*each.get("clamp", []), {"on": "middle", "x": 0.0}]
    contact: list[Scene] = [{"bodies": ["pin", "lug"], "on": ["rim", "bore"]}]
    return {"body": body, "contact": contact, "output": MILLIMETRES}


def plates(slave: str) -> Scene:
    """A ball is squeezed between two plates, and may turn and roll."""
    low, high = (
        {
            "name": name,
            "material": SOFT,
            "mesh": {
                "shape": "box",
                "origin": [-2.0, -2.0, z],
                "size": [4.0, 4.0, 1.0],
                "divisions": [8, 8, 2],
            },
        }
        for name, z in (("low", -1.0), ("high", 2.0))
    )
    low["clamp"] = ["bottom"]
    high["clamp"] = [{"on": "top", "x": 0.0, "y": 0.0, "z": -0.01}]
    mesh = {"shape": "ball", "center": [0.13, -0.21, 1.0], "radius": 1.0, "size": 0.6, "order": 2}
    contacts = [
        {"bodies": ["ball", plate], "on": ["surface", side], "slave": slave or plate}
        for plate, side in (("low", "top"), ("high", "bottom"))
    ]
    ball = {"name": "ball", "mesh": mesh, "material": SOFT}
    return {"body": [ball, low, high], "contact": contacts, "output": MILLIMETRES}


def lid(friction: float) -> Scene:
    """A lid without a load on a bent beam."""
    contact: Scene = {"bodies": ["lid", "beam"], "on": ["bottom", "top"]}
    if friction:
        contact["friction"] = {"law": "coulomb", "coefficient": friction}
    shapes = (
        ("lid", [2.0, 1.0], [6.0, 1.0], [29, 3]),
        ("beam", [0.0, 0.0], [10.0, 1.0], [40, 4]),
    )
    body: list[Scene] = [
        {
            "name": name,
            "mesh": {"shape": "rectangle", "origin": at, "size": size, "divisions": divisions},
            "material": SOFT,
        }
        for name, at, size, divisions in shapes
    ]
    body[1] |= {"clamp": ["left"], "traction": [{"on": "right", "force": [0.0, 20.0]}]}
    return {"body": body, "contact": [contact], "output": MILLIMETRES}


def cases() -> Iterator[Case]:
    for order, around in itertools.product((1, 2), ((60, 60), (60, 52), (48, 60), (90, 77))):
        name = f"shaft in a bush, {around[0]} : {around[1]}, order {order}"
        half = half_shaft(around, order)
        yield Case(name, shaft(around, order), moved=(0.0175, 0.0195), half=half)
    # the shaft moves by its clearance and what it yields, whatever its moment
    for clearance, pull, moment in (
        (0.05, (0.0, 1044.0), 0),
        (0.05, (0.0, 1044.0), 1),
        (0.05, (0.0, 1044.0), 20),
        (0.05, (0.0, 1044.0), 90),
        (1.0, (-700.0, 700.0), 0),
        (1.0, (-700.0, 700.0), 90),
    ):
        name = f"shaft pulled by {pull} N across a clearance of {clearance:g}, moment {moment} N mm"
        yield Case(
            f"{name}/mm",
            shaft((60, 52), 2, pull, moment, clearance),
            NONE if moment > 1 else CERTIFIED,
            moved=(0.118, 0.121) if clearance < 1.0 else (1.8, 1.9),
            held=1,
        )
    for order in (2, 1):
        yield Case(
            f"shaft, loose bush, housing, order {order}", loose_bush(order), moved=(0.0, 1.0)
        )
    down = -1000.0 / (math.pi * 10.0**2)
    for order, size in itertools.product((1, 2), (2.0, 3.0, 4.0, 5.0, 6.0)):
        name = f"pin in a lug, size {size:g}, order {order}"
        yield Case(
            name,
            pin(size, order, (0.0, down)),
            moved=(0.03, 0.045),
            pressed=(91.0, 95.0),
            half=pin(size, order, (0.0, down), "half_"),
        )
    aslant = (-down / math.sqrt(2.0), down / math.sqrt(2.0))
    for order in (2, 1):
        scene = pin(4.0, order, aslant)
        yield Case(f"pin pulled at 45°, order {order}", scene, pressed=(84.9, 87.5))
    # lobes resist the turn, so that it is not held: with friction of 1e-6 they have 91.5 MPa and 3.14 mm
    slope = 1.0 / (math.pi * 10.0**4 / 4.0)
    for order in (2, 1):
        scene = pin(3.0, order, (0.0, f"{down!r} + {slope!r} * x"), "lobed_")
        name = f"pin with lobes of 0.01 mm and a moment of 1 N mm/mm, order {order}"
        yield Case(name, scene, moved=(3.1, 3.2), pressed=(90.0, 92.5), held=0)
    for moment, verdict in ((1, CERTIFIED), (10, NONE), (100, NONE)):
        # ∫ x² over the disc is π r⁴ / 4
        slope = moment / (math.pi * 10.0**4 / 4.0)
        scene = pin(4.0, 2, (0.0, f"{down!r} + {slope!r} * x"))
        yield Case(f"pin with a moment of {moment} N mm/mm", scene, verdict)
    for slave, force in (("", 66.0), ("ball", 63.7)):
        name = f"ball between plates, slave {slave or 'plates'}"
        within = (force - 0.5, force + 0.5)
        yield Case(name, plates(slave), pressed=within, of="normal_force", steps=30)
    for friction in (0.15, 0.0):
        name = f"lid without a load on a beam, friction {friction:g}"
        yield Case(name, lid(friction), moved=(0.4182, 0.4185))


def look(case: Case) -> tuple[dict[str, str], bool]:
    """A line of the table, and whether the answer is as it should be. Collective."""
    answer = ddmpi.solve(case.scene, MPI.COMM_WORLD)
    summary = answer.summary
    steps, of_half = summary["outer_iterations"], math.inf
    if case.half:
        of_half = ddmpi.solve(case.half, MPI.COMM_WORLD).summary["outer_iterations"]
    first, contact = case.scene["body"][0]["name"], next(iter(summary["contacts"].values()))
    moved = float(np.max(summary["bodies"][first]["displacement_max"]))
    pressed = contact[case.of] or 0.0
    held = [f"{one['moment']:.2g} of {one['bound']:.2g}" for one in summary["held_motions"]]
    right = answer.reason.startswith(case.verdict) and case.held in (None, len(held))
    if case.verdict == CERTIFIED:
        right &= steps <= min(case.steps, max(FEW, 2 * of_half))
        right &= case.moved[0] <= moved <= case.moved[1]
        right &= case.pressed[0] <= pressed <= case.pressed[1]
    certified = case.verdict == CERTIFIED
    row = {
        "scene": case.name,
        "steps": str(steps),
        "steps of its half": str(of_half) if case.half else "",
        "largest displacement (mm)": f"{moved:.4g}" if certified else "",
        "largest pressure (MPa) or force (N)": f"{pressed:.4g}" if certified else "",
        "left along held motions": "; ".join(held),
        "verdict": answer.reason.partition(";")[0].partition(":")[0],
        "as it should be": "yes" if right else "no",
    }
    return row, right


def main() -> int:
    parser = arguments(__doc__, "round_parts")
    parser.add_argument("--only", default="", help="a word in the names of the scenes")
    options = parser.parse_args()
    rank_0, rows, wrong = MPI.COMM_WORLD.rank == 0, list[dict[str, str]](), 0
    for case in cases():
        if options.only not in case.name:
            continue
        row, right = look(case)
        rows.append(row)
        wrong += not right
        if rank_0:
            print(" | ".join(row.values()), flush=True)
    if rank_0:
        print(f"{len(rows) - wrong} of {len(rows)} as they should be")
        if rows and not options.only:
            facts = {r"(?<=version )\d+\.\d+\.\d+": ddmpi.__version__}
            lines = table(rows[0], [row.values() for row in rows])
            publish("round_parts.md", {"": lines}, options.output, facts=facts)
    return int(wrong > 0 or not rows)


if __name__ == "__main__":
    sys.exit(main())
