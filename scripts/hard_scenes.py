#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Hard scenes: where bodies hinge, jam, fall or slide as wholes, and what Newton's method takes for them.

    scripts/study hard_scenes                      # all of them, and the table of docs/tables/hard_scenes.md
    scripts/study hard_scenes --only arch          # the scenes whose name has this word, to the screen alone
    scripts/study hard_scenes --only belt          # all belts around drums, clamped and loose
    mpirun -n 2 python scripts/hard_scenes.py      # the same on two ranks

Prints a line for each scene: its steps, its products, its limits, and the verdict. Products are multiplications by a
body's compliance over the number of bodies. The study ends with 1 if a scene takes more steps or products than its
limit or is not certified, or if the reason for a loose belt beyond its limit is not "no equilibrium found".
"""

import itertools
import math
import sys
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

from experiment import ROOT, arguments, publish, table
from mpi4py import MPI
from problems.bodies import coulomb
from random_assemblies import products
from scenes import to_toml

import ddmpi
from ddmpi.errors import DdmpiError

HARD = ROOT / "scripts" / "hard"
Scene = dict[str, Any]
STEPS, PRODUCTS, ANY = 30, 300, math.inf
"""Most steps, and most products a body where these are limited."""

CERTIFIED, NONE = "converged and certified", "no equilibrium found"
"""How the reason of an answer begins, as it should."""

CLAMPED, LOOSE, PULL = 120, 80, 1e5
"""Most steps of belts, and the stress that pulls at their ends (Pa)."""


def arch(nx: int, ny: int, spread: float) -> Scene:
    """configs/arch.toml with other divisions, and its right springing moved by `spread` metres."""
    scene = tomllib.loads((ROOT / "configs" / "arch.toml").read_text(encoding="utf-8"))
    for body in scene["body"]:
        body["mesh"]["divisions"] = [nx, ny]
    scene["rigid"][1]["displacement"] = [spread, 0.0]
    return scene


def material(modulus: float = 2.1e11) -> dict[str, float]:
    return {"young": modulus, "poisson": 0.3}


def turned(corners: list[tuple[float, float]], degrees: float) -> list[list[float]]:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return [[c * x - s * y, s * x + c * y] for x, y in corners]


def pad(push: tuple[float, float]) -> Scene:
    """A pad (hard/pad.toml) that is pressed on a slope and pushed up along it by `push` (MPa) against soft springs."""
    scene = tomllib.loads((HARD / "pad.toml").read_text(encoding="utf-8"))
    scene["body"][0]["mesh"]["geometry"] = str(HARD / "pad.geo")
    for load in scene["body"][0]["traction"][1:]:
        load["value"] = list(push)
    return scene


def tube(friction: float) -> Scene:
    """A tube that falls through the clearance of a rigid bore, far more than it gives way, and rolls aside."""
    return {
        "body": [
            {
                "name": "tube",
                "material": material(),
                "volume_force": [0.0, -1e5],
                "mesh": {
                    "shape": "annulus",
                    "center": [0.0, 0.0],
                    "radii": [0.9, 1.0],
                    "angles": [0.0, 360.0],
                    "divisions": [96, 4],
                },
                "traction": [{"on": "inner", "value": [3e3, 0.0]}],
            }
        ],
        "rigid": [
            {
                "name": "bore",
                "shape": "circle",
                "center": [0.0, 0.0],
                "radius": 1.002,
                "inside": True,
            }
        ],
        "contact": [{"bodies": ["tube", "bore"], "on": ["outer"], "friction": coulomb(friction)}],
    }


def falling_disc(clearance: float) -> Scene:
    """A disc that touches the top of a bore falls to its bottom."""
    return {
        "body": [
            {
                "name": "disc",
                "material": material(),
                "volume_force": [0.0, -1e5],
                "mesh": {
                    "shape": "annulus",
                    "center": [0.0, 0.0],
                    "radii": [0.3, 1.0],
                    "angles": [0.0, 360.0],
                    "divisions": [48, 6],
                },
            }
        ],
        "rigid": [
            {
                "name": "bore",
                "shape": "circle",
                "center": [0.0, -clearance],
                "radius": 1.0 + clearance,
                "inside": True,
            }
        ],
        "contact": [{"bodies": ["disc", "bore"], "on": ["outer"], "friction": coulomb(0.3)}],
    }


def spanner(slack: float) -> Scene:
    """An open spanner, two jaws bonded to a handle, turns a held square nut; it tilts by its slack before it bears."""
    half, depth = 0.5, 0.4
    gap = half + slack
    parts = {
        "nut": [(-half, -half), (half, -half), (half, half), (-half, half)],
        "upper": [
            (-half, gap),
            (half + depth, gap),
            (half + depth, gap + depth),
            (-half, gap + depth),
        ],
        "lower": [
            (-half, -gap - depth),
            (half + depth, -gap - depth),
            (half + depth, -gap),
            (-half, -gap),
        ],
        "handle": [
            (half + depth, -gap - depth),
            (4.0, -gap - depth),
            (4.0, gap + depth),
            (half + depth, gap + depth),
        ],
    }
    divisions = {"nut": [12, 12], "upper": [17, 5], "lower": [17, 5], "handle": [30, 19]}
    bodies = [
        {
            "name": name,
            "material": material(),
            "clamp": [],
            "mesh": {
                "shape": "quadrilateral",
                "corners": turned(corners, 7.0),
                "divisions": divisions[name],
            },
        }
        for name, corners in parts.items()
    ]
    bodies[0]["clamp"] = ["left"]
    bodies[3]["traction"] = [{"on": "right", "value": turned([(0.0, -2e5)], 7.0)[0]}]
    return {
        "body": bodies,
        "contact": [
            {"bodies": ["upper", "nut"], "on": ["bottom", "top"], "friction": coulomb(0.2)},
            {"bodies": ["lower", "nut"], "on": ["top", "bottom"], "friction": coulomb(0.2)},
            {"bodies": ["upper", "handle"], "on": ["right", "left"], "kind": "bonded"},
            {"bodies": ["lower", "handle"], "on": ["right", "left"], "kind": "bonded"},
        ],
    }


def sprags(friction: float) -> Scene:
    """Three leaning blocks jam between a race that is pressed down and dragged along, and a rigid one."""
    lean, bodies, contacts = 0.25, [], []
    for k in range(3):
        x = 1.5 * k
        bodies.append(
            {
                "name": f"sprag{k}",
                "material": material(),
                "mesh": {
                    "shape": "quadrilateral",
                    "divisions": [6, 12],
                    "corners": [[x, 0.0], [x + 0.5, 0.0], [x + 0.5 + lean, 1.0], [x + lean, 1.0]],
                },
            }
        )
        contacts += [
            {
                "bodies": ["race", f"sprag{k}"],
                "on": ["bottom", "top"],
                "friction": coulomb(friction),
            },
            {"bodies": [f"sprag{k}", "floor"], "on": ["bottom"], "friction": coulomb(friction)},
        ]
    race = {
        "name": "race",
        "material": material(),
        "traction": [{"on": "top", "value": [2e4, -1e5]}],
        "mesh": {
            "shape": "rectangle",
            "origin": [-0.25, 1.0],
            "size": [4.75, 0.5],
            "divisions": [57, 6],
        },
    }
    return {
        "body": [race, *bodies],
        "contact": contacts,
        "rigid": [{"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
    }


def belt(
    thickness: float,
    wrap: float,
    friction: float,
    divisions: int,
    young: float,
    move: float | None = None,
    limit: float = 0.0,
) -> Scene:
    """A belt around a rigid drum of radius 1 m, wrapped by so many degrees, that slips as a whole.

    Its start is pulled by PULL. Its end is moved along this pull by a clamp, `move` metres; without it the end is
    pulled as well, by exp(`limit` μ wrap) times as much. As it is pulled in its middle, it slides from a `limit` of
    1/(1 + thickness/2) on (Euler and Eytelwein).
    """
    first, last = 90.0 - wrap / 2, 90.0 + wrap / 2
    ahead = {
        end: [-math.sin(math.radians(angle)), math.cos(math.radians(angle))]
        for end, angle in (("start", first), ("end", last))
    }
    pulls = {"start": -PULL} | (
        {} if move else {"end": PULL * math.exp(limit * friction * math.radians(wrap))}
    )
    clamp = (
        [{"on": "end"} | {axis: -move * x for axis, x in zip("xy", ahead["end"], strict=True)}]
        if move
        else []
    )
    return {
        "body": [
            {
                "name": "belt",
                "material": material(young),
                "clamp": clamp,
                "traction": [
                    {"on": end, "value": [q * x for x in ahead[end]]} for end, q in pulls.items()
                ],
                "mesh": {
                    "shape": "annulus",
                    "center": [0.0, 0.0],
                    "radii": [1.0, 1.0 + thickness],
                    "angles": [first, last],
                    "divisions": [divisions, 2],
                },
            }
        ],
        "rigid": [{"name": "drum", "shape": "circle", "center": [0.0, 0.0], "radius": 1.0}],
        "contact": [{"bodies": ["belt", "drum"], "on": ["inner"], "friction": coulomb(friction)}],
    }


def belts() -> Iterator[tuple[Any, ...]]:
    """As `cases`: 72 belts with an end that is clamped and moved, and 16 loose ones near their limit."""
    thick, thin = ((0.05, 0.01), (90, 180), (0.1, 0.3)), ((0.01, 0.003), (180, 300), (0.2, 0.5))
    for family, moves, moduli, n in (
        (thick, (1e-4, -1e-2, 1e-2), (2e9,), 48),
        (thin, (-3e-3, -0.05, 0.03), (2e9, 2e11), 120),
    ):
        for t, wrap, friction, move, young in itertools.product(*family, moves, moduli):
            yield (
                f"belt {t:g} m thick, {wrap}°, 𝓕 = {friction}, E = {young:g} Pa, moved by {move:g} m",
                lambda case=(t, wrap, friction, n, young, move): to_toml(belt(*case)),
                CLAMPED,
                ANY,
                CERTIFIED,
            )
    for t, wrap, friction, limit in itertools.product(*thick, (0.97, 0.999)):
        yield (
            f"loose belt {t:g} m thick, {wrap}°, 𝓕 = {friction}, at {limit:.1%} of the limit",
            lambda case=(t, wrap, friction, 48, 2e9, None, limit): to_toml(belt(*case)),
            LOOSE,
            ANY,
            CERTIFIED if limit < 1.0 / (1.0 + t / 2) else NONE,
        )


def cases() -> Iterator[tuple[Any, ...]]:
    """Names, scenes as functions that make text or a file's name, limits of steps and products, and what to say."""
    yield from ((*case, CERTIFIED) for case in _usual_cases())
    yield from belts()


def _usual_cases() -> Iterator[tuple[str, Callable[[], str], int, float]]:
    """Those that are not belts, without what to say."""
    for nx, ny, spread in (
        (12, 8, 5),
        (8, 8, 5),
        (8, 8, 1),
        (16, 16, 20),
        (16, 8, 5),
        (12, 12, 1),
        (12, 12, 5),
        (12, 12, 20),
    ):
        yield (
            f"arch, {nx} × {ny}, spread by {spread} mm",
            lambda nx=nx, ny=ny, spread=spread: to_toml(arch(nx, ny, 1e-3 * spread)),
            STEPS,
            PRODUCTS,
        )
    yield "pipe clamp with two bolts", lambda: str(HARD / "clamp.toml"), 40, 400
    for name, push in (
        ("l100", (86.60254037844388, 50.0)),
        ("soft_springs", (154.32572695438697, 89.1)),
    ):
        yield (
            f"pad on a slope between soft springs, {name}",
            lambda push=push: to_toml(pad(push)),
            40,
            ANY,
        )
    for friction in (0.1, 0.2, 0.3):
        yield (
            f"loose tube, 𝓕 = {friction}",
            lambda friction=friction: to_toml(tube(friction)),
            STEPS,
            ANY,
        )
    for slack in (1e-4, 1e-3):
        yield (
            f"spanner on a nut, slack {slack:g}",
            lambda slack=slack: to_toml(spanner(slack)),
            STEPS,
            ANY,
        )
    for friction in (0.3, 0.5):
        yield (
            f"sprags, 𝓕 = {friction}",
            lambda friction=friction: to_toml(sprags(friction)),
            STEPS,
            ANY,
        )
    for fall in (1e-3, 1e-2):
        yield (
            f"disc that falls by {fall:g}",
            lambda fall=fall: to_toml(falling_disc(fall)),
            STEPS,
            ANY,
        )


def main() -> int:
    parser = arguments(__doc__, "hard_scenes")
    parser.add_argument("--only", default="", help="a word in the names of the scenes")
    options = parser.parse_args()
    rank_0, rows, missed = MPI.COMM_WORLD.rank == 0, [], 0
    for name, scene, steps, most, said in cases():
        if options.only not in name:
            continue
        row, within = measure(scene(), steps, most, said)
        missed += not within
        rows.append((name, *row))
        if rank_0:
            print(*rows[-1], sep=" | ", flush=True)
    if rank_0:
        print(
            f"{len(rows) - missed} of {len(rows)} scenes within their limits, "
            f"{sum(row[1] for row in rows)} steps, {sum(int(row[2]) for row in rows)} products a body"
        )
        if not options.only:
            facts = {r"(?<=version )[\d.]+(?=\s+by)": ddmpi.__version__}
            publish(
                "hard_scenes.md",
                {"": table(["scene", "steps", "products a body", "limits", "verdict"], rows)},
                options.output,
                facts=facts,
            )
    return int(missed > 0 or not rows)


def measure(
    scene: str, steps: int, most: float, said: str
) -> tuple[tuple[int, str, str, str], bool]:
    """Steps, products a body, limits and verdict of a scene, and whether they are as they should be."""
    limits = f"{steps}, {most:.0f}" if most < ANY else f"{steps}"
    try:
        summary = ddmpi.solve(scene, MPI.COMM_WORLD).summary
    except DdmpiError as error:  # agreed among ranks, as the functions of `ddmpi` promise
        return (0, "0", limits, f"NO: {error.kind}: {error}"), False
    taken, made, reason = summary["outer_iterations"], products(summary), summary["reason"]
    within = reason.startswith(said) and taken <= steps and made <= most
    verdict = said if within else f"NO: {reason}"
    return (taken, f"{made:.0f}", limits, verdict), within


if __name__ == "__main__":
    sys.exit(main())
