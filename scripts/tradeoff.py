"""What accuracy costs: processor time and multiplications against true errors, in the plane and in space.

Two blocks and two boxes with Coulomb friction against fine solutions, rings and tubes with interference and a ball on a
plane against closed forms, a load that is reversed against many load steps: meshes and orders, pairs or mortar,
straight or curved elements, tolerances, load steps. On one rank. With --unseen the estimate of the error on problems
on which nothing of it was chosen (problems/unseen.py), with --orders what linear elements say of quadratic ones.

Writes to the folder --output: tradeoff.csv and tradeoff_unseen.csv (a line per case, written at once, so that an
interrupted study continues), tradeoff_in_plane.md, tradeoff_in_space.md, tradeoff_unseen.md and tradeoff_of_orders.md;
a page all of whose scenes are done is also written to docs/tables/.
"""

import functools
import time
import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, publish, table, where
from mpi4py import MPI
from problems import around_axis, mean_pressure, nodes_off
from problems.bodies import FLOOR, QUARTER, annulus, answer_of, body, contact, courses, held, plane
from problems.forms import fitted_pressure, hertz_values, plane_strain
from problems.revolved import half_ball, tube
from problems.unseen import UNSEEN, Coarse, Fine
from scenes import fretting_pad, other_diagonals, pinched_blocks, tower
from solid_scenes import two_boxes
from true_errors import (
    against_form,
    against_mesh,
    clustered,
    grid,
    ring_stress,
    turned_stress,
)

import ddmpi
from ddmpi.run.answer import Answer

FINE = {"blocks": 64, "tower": 32, "pad": 32, "boxes": 10, "ball": 32}
"""Cells of the reference meshes, of order 2, across a body, and in the plane also between two places along it where
stresses have no limit; of the ball around an axis, on the radius of contact."""

ENDS = {
    "blocks": {"upper": ((0, 3), (1, 2)), "lower": ((0, 3), (0, 1))},
    "tower": {f"block{k}": ((0, 3), (k - 1, k)) for k in (1, 2, 3)},
    "pad": {"pad": ((-0.01, 0.01), (0, 0.01)), "part": ((-0.05, -0.01, 0.01, 0.05), (-0.02, 0))},
}
"""Coordinates of places where stresses have no limit, by scene, body and axis."""

STEPS = 32
"""Load steps per interval of the history that the others are compared with."""

NONE = "–"
"""The value of a choice that a scene does not have."""

SHORT = 0.5
"""Runs of less processor time are repeated (s)."""

LOOSEST = 1e-3
"""Looser tolerances are shown, but not recommended."""

FIT = {"rings": 6e-7, "tubes": 3e-3}
"""Interference of rings and tubes (m). That of tubes is large beside the errors of smooth surfaces over few facets,
which no estimate of a mesh's error contains: 1e-5 m with 6 facets a quarter."""

BALL = {"radius": 0.1, "down": -0.0075}
"""Of the contact of the ball, as its meshes expect it, and how far its flat face moves (m)."""


class Case(NamedTuple):
    """All choices of a run. `N`: cells along a short side, elements on the radius of contact or across a wall;
    `shape`: "curved", or "straight" quadratic elements on curved boundaries; `steps`: of each interval between two
    entries of ``time.points``, or a tolerance."""

    scene: str
    N: int
    order: int = 1
    pairing: str = NONE
    shape: str = NONE
    tolerance: float = 1e-8
    steps: float | str = NONE
    diagonals: str = NONE


OTHER = "other diagonals"
SHAPES = ((1, NONE), (2, "straight"), (2, "curved"))
PAIRINGS = {1: ("nodes", "mortar", "unlike"), 2: ("mortar", "unlike")}
MESHES = {
    "blocks": {1: (4, 8, 16, 32, 64), 2: (4, 8, 16, 32)},
    "boxes": {1: (2, 4, 8), 2: (2, 4, 8)},
}
CASES = [
    *(
        Case(scene, N, order, pairing)
        for scene, meshes in MESHES.items()
        for order in (1, 2)
        for N in meshes[order]
        for pairing in PAIRINGS[order]
    ),
    *(
        Case(scene, N, 1, "nodes", tolerance=tolerance)
        for scene, N in (("blocks", 32), ("boxes", 4))
        for tolerance in (1e-2, 1e-3, 1e-4, 1e-6)
    ),
    *(
        Case(scene, N, order, shape=shape)
        for scene, meshes in (("rings", (4, 16, 64)), ("ball", (3, 5)), ("tubes", (4, 6)))
        for order, shape in SHAPES
        for N in meshes
    ),
    *(
        Case(scene, N, order, diagonals=way)
        for scene, meshes in (("tower", (2, 4, 8)), ("pad", (2, 4, 8)))
        for order in (1, 2)
        for N in meshes
        for way in (NONE, OTHER)
    ),
    *(
        Case(scene, N, order, "mortar", diagonals=OTHER)
        for scene, meshes in (("blocks", (4, 8, 16)), ("boxes", (2, 4, 8)))
        for order in (1, 2)
        for N in meshes
    ),
    *(Case("history", 4, steps=steps) for steps in (1, 2, 4, 8, 16, 0.1, 0.02)),
]
BLOCKS = {
    "one": "energy norm",
    "two": "normal force",
    "three": "tangential force",
    "four": "displacement of a corner",
}
RINGS = {"one": "mean pressure", "two": "pressure at nodes, L2", "three": "energy norm"}
ERRORS = {
    "blocks": BLOCKS,
    "rings": RINGS,
    "boxes": BLOCKS,
    "tower": {"one": "energy norm"},
    "pad": {"one": "energy norm"},
    "ball": {"one": "greatest pressure", "two": "radius of contact", "three": "energy norm"},
    "tubes": RINGS,
    "history": {"one": "tangential force at the end", "two": "dissipated energy"},
}
"""What the columns of errors are, by the scene."""

TITLES = {
    "blocks": "Two blocks with Coulomb friction",
    "rings": "Two rings with interference",
    "tower": "A loose stack of three blocks",
    "pad": "A fretting pad",
    "boxes": "Two boxes with Coulomb friction",
    "ball": "A ball on a rigid plane",
    "tubes": "Two tubes with interference",
    "history": "Boxes pressed, sheared and sheared back",
}
PAGES = {
    "plane": ("blocks", "rings", "tower", "pad"),
    "space": ("boxes", "ball", "tubes", "history"),
}
COLUMNS = (
    "n",
    "outcome",
    "iterations",
    "n_A",
    "cpu_seconds",
    "estimated",
    "one",
    "two",
    "three",
    "four",
)


def make_scene(case: Case, folder: Path) -> dict:
    """The scene of a case; meshes go into the folder."""
    method = {"method": {"tolerance": case.tolerance}}
    drawn = 1 if case.shape == "straight" else case.order
    if case.scene == "ball":
        mesh = half_ball(folder / f"ball{case.N}.msh", BALL["radius"], 0.088 / case.N, drawn) | {
            "order": case.order
        }
        return {
            "body": [body("ball", mesh, 1.0, 0.3, [*QUARTER, *held(top={"z": BALL["down"]})])],
            "rigid": [FLOOR],
            "contact": [contact("ball", "floor", "contact")],
        } | method
    if case.scene in ("rings", "tubes"):

        def wall(name: str, radii: tuple[float, float], h: float) -> dict:
            if case.scene == "tubes":
                mesh = tube(folder / f"{name}.msh", *radii, h, drawn) | {"order": case.order}
                return body(name, mesh, 2e11, 0.3, [*QUARTER, *held(bottom="z", top="z")])
            mesh = annulus(
                radii, (3 * case.N, case.N), "2 straight" if drawn < case.order else drawn, folder
            )
            return body(name, mesh, 2e11, 0.3, QUARTER)

        return {
            "body": [
                wall("inner", (0.3, 0.6 + FIT[case.scene]), 0.3 / case.N),
                wall("outer", (0.6, 0.9), 0.24 / case.N),
            ],
            "contact": [contact("inner", "outer", "outer", "inner")],
        } | method
    if case.scene in ("tower", "pad"):
        scene = tower(3, case.N) if case.scene == "tower" else fretting_pad(case.N)
        for each in scene["body"]:
            each["mesh"] |= {"order": case.order}
        return (other_diagonals(scene) if case.diagonals == OTHER else scene) | method
    scene = pinched_blocks(case.N) if case.scene == "blocks" else two_boxes(case.N)
    for k, each in enumerate(scene["body"]):
        more = k if case.pairing == "unlike" else 0
        each["mesh"] |= {
            "order": case.order,
            "divisions": [int(size * (case.N + more)) for size in each["mesh"]["size"]],
        }
    if case.diagonals == OTHER:
        scene = other_diagonals(scene)
    scene["contact"][0] |= {"name": "upper-lower"} | (
        {"pairing": case.pairing} if case.pairing in ("nodes", "mortar") else {}
    )
    if case.scene == "history":
        upper, lower = scene["body"]
        upper["traction"] = [
            {"on": "back", "value": [0.0, -6e7, 0.0], "history": "press"},
            {"on": "right", "value": [2e7, 0.0, 2e7], "history": "shear"},
        ]
        lower["traction"] = []
        scene["history"] = courses(
            press=[(0.0, 0.0), (1.0, 1.0)], shear=[(1.0, 0.0), (2.0, 1.0), (3.0, -1.0)]
        )
        way = {"tolerance": case.steps} if case.steps < 1 else {"steps": int(case.steps)}
        scene["time"] = {"points": [1.0, 2.0, 3.0]} | way
    return scene | method


def reference(scene: str, n: int, folder: Path) -> dict:
    """A scene on its reference mesh with n cells as of `FINE`."""
    made = make_scene(Case(scene, 2, 2, "mortar" if scene in ("blocks", "boxes") else NONE), folder)
    for each in made["body"]:
        if scene == "boxes":  # finest at the clamp and at the edges
            low = np.array(each["mesh"]["origin"])
            along = clustered((0.0, 6.0), 2 * round(2.6 * n), 2.2)[: round(2.6 * n) + 1]
            lines = [along, *(clustered((y, y + 1.0), n, 1.7) for y in low[1:])]
        else:
            lines = [clustered(ends, n, 3.0) for ends in ENDS[scene][each["name"]]]
        each["mesh"] = grid(folder / f"{scene}_{each['name']}_{n}.msh", lines)
    return made


def relative(value: float, exact: float) -> float:
    return abs(value - exact) / abs(exact)


class Trade:
    """The measurements, and the solutions with which they are compared.

    Parameters
    ----------
    folder : meshes go into it
    finest : N of the reference solutions, by scene
    most : runs of less than `SHORT` are so many
    """

    def __init__(self, folder: Path, finest: dict[str, int], most: int) -> None:
        self.folder, self.finest, self.most = folder / "meshes", finest, most
        self.folder.mkdir(parents=True, exist_ok=True)

    def solved(self, case: Case) -> tuple[Answer, float]:
        """The answer on this rank alone, and the processor time that it took; the least of up to `most` runs."""
        scene, least = make_scene(case, self.folder), np.inf
        for _ in range(self.most):
            start = time.process_time()
            answer = ddmpi.solve(scene, MPI.COMM_SELF)
            least = min(least, time.process_time() - start)
            if least > SHORT:
                break
        return answer, least

    def measure(self, *key) -> Row:
        """A line of the table."""
        case = Case(*key)
        answer, least = self.solved(case)
        summary = answer.summary
        errors = {
            "blocks": self.of_blocks,
            "tower": self.of_stress,
            "pad": self.of_stress,
            "boxes": self.of_blocks,
            "rings": self.of_rings,
            "tubes": self.of_rings,
            "ball": self.of_ball,
            "history": self.of_history,
        }[case.scene](answer, case.scene)
        return (
            dict.fromkeys(COLUMNS, np.nan)
            | dict(zip(BLOCKS, errors, strict=False))
            | {
                "n": summary["n"],
                "outcome": "certified" if answer.certified else answer.reason,
                "cpu_seconds": least,
                "iterations": sum(step["outer_iterations"] for step in summary["steps"]),
                "n_A": summary["n_A"],
                "estimated": (summary["discretization_error"] or {}).get("energy_norm") or np.nan,
            }
        )

    @functools.lru_cache(maxsize=1)  # noqa: B019, there is one object
    def fine(self, scene: str) -> Answer:
        """The reference solution."""
        if scene == "ball":
            mesh = around_axis.half_ball(
                self.folder / "ball_fine.msh", BALL["radius"], self.finest[scene], 2
            )
            return around_axis.turned(
                [body("ball", mesh, 1.0, 0.3, held(top={"y": BALL["down"]}))],
                [contact("ball", "floor", "contact")],
                [plane("floor", (0.0, 0.0), (0.0, 1.0))],
            )
        return ddmpi.solve(reference(scene, self.finest[scene], self.folder), MPI.COMM_SELF)

    def of_stress(self, answer: Answer, scene: str) -> list[float]:
        return [against_mesh(answer, self.fine(scene))]

    def of_blocks(self, answer: Answer, scene: str) -> list[float]:
        """Errors against the fine solution."""
        reference = self.fine(scene)
        contacts = [each.summary["contacts"]["upper-lower"] for each in (answer, reference)]
        ends = [
            each.bodies["upper"].displacement[np.argmax(each.bodies["upper"].points.sum(axis=1))]
            for each in (answer, reference)
        ]
        return [
            *self.of_stress(answer, scene),
            *(
                relative(*(each[key] for each in contacts))
                for key in ("normal_force", "tangential_force")
            ),
            float(np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1])),
        ]

    def of_ball(self, answer: Answer, scene: str) -> list[float]:
        values, _ = hertz_values(
            answer.contacts["ball-floor"], 4, 1.0 / (1.0 - 0.09), 1.0, (1.0, 1.0)
        )
        off = [relative(computed, exact) for computed, exact, _ in values.values()]
        return [*off, against_form(answer, {"ball": turned_stress(self.fine(scene), "ball")})]

    def of_rings(self, answer: Answer, scene: str) -> list[float]:
        # Each tube is loaded at its own radius: p of the inner one there has the force of p of the outer one at 0.6.
        rim, state = 0.6 + FIT[scene], answer.contacts["inner-outer"]
        exact = fitted_pressure(0.3, rim, 0.6, 0.9, plane_strain(2e11, 0.3))
        stresses = {
            "inner": ring_stress(0.3, rim, (0.0, exact * 0.6 / rim), 0.3),
            "outer": ring_stress(0.6, 0.9, (exact, 0.0), 0.3),
        }
        off = [relative(mean_pressure(state), exact), nodes_off(state, exact)]
        return [*off, against_form(answer, stresses)]

    @functools.cached_property
    def many_steps(self) -> dict:
        return self.solved(Case("history", 4, steps=STEPS))[0].summary["contacts"]["upper-lower"]

    def of_history(self, answer: Answer, scene: str) -> list[float]:
        found, exact = answer.summary["contacts"]["upper-lower"], self.many_steps
        off = np.subtract(found["force"], exact["force"])[[0, 2]]
        return [
            float(np.linalg.norm(off) / np.linalg.norm(np.array(exact["force"])[[0, 2]])),
            relative(found["dissipated"], exact["dissipated"]),
        ]


def in_box(points: np.ndarray, u: np.ndarray, order: int, at: np.ndarray) -> np.ndarray:
    """The displacement u (n, d) of a box's nodes `points` (n, d), cells of a grid cut after Kuhn, at others (k, d).

    In a cell the corners on the way from the least to the greatest go along the axes in the order of the coordinates.
    """
    low, size, d = points.min(axis=0), np.ptp(points, axis=0), points.shape[1]
    number = (
        np.array([len(np.unique(np.round(points[:, k] / size[k] * 1e6))) - 1 for k in range(d)])
        // order
    )
    place = np.full(2 * number + 1, -1)
    place[tuple(np.round((points - low) / size * 2 * number).astype(int).T)] = np.arange(
        len(points)
    )
    x = (at - low) / size * number
    cell = np.clip(np.floor(x + 1e-9), 0, number - 1)
    inside = np.clip(x - cell, 0.0, 1.0)
    axes = np.argsort(-inside, axis=1, kind="stable")
    down = np.take_along_axis(inside, axes, axis=1)
    # `part` are the barycentric coordinates.
    part = -np.diff(np.column_stack([np.ones(len(at)), down, np.zeros(len(at))]), axis=1)
    corner = cell[:, None] + np.concatenate(
        [np.zeros((len(at), 1, d)), np.cumsum(np.eye(d)[axes], axis=1)], axis=1
    )
    twice = np.round(2 * corner).astype(int)

    def of(nodes: np.ndarray) -> np.ndarray:
        return u[place[tuple(nodes.T)]]

    if order == 1:
        return sum(part[:, i, None] * of(twice[:, i]) for i in range(d + 1))
    found = sum(
        (part[:, i] * (2 * part[:, i] - 1))[:, None] * of(twice[:, i]) for i in range(d + 1)
    )
    return found + sum(
        (4 * part[:, i] * part[:, j])[:, None] * of((twice[:, i] + twice[:, j]) // 2)
        for i in range(d + 1)
        for j in range(i)
    )


# Pages


def percent(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    digits = 2 - int(np.floor(np.log10(100 * value))) - 1 if value > 0 else 0
    return (
        f"{100 * value:.{min(max(digits, 0), 5)}f} %"
        if value > 1e-7 or value == 0
        else f"{100 * value:.0e} %"
    )


def effectivity(row: Row, scene: str) -> str:
    """The estimated over the true error in the energy norm."""
    key = next((key for key, words in ERRORS[scene].items() if words == "energy norm"), None)
    return f"{row['estimated'] / row[key]:.2f}" if key and row[key] > 0.0 else "–"


def choice(row: Row) -> str:
    """A case in words, without its scene."""
    words = {"nodes": "pairs", "mortar": "mortar", "unlike": "meshes that do not match"}
    if row["scene"] == "history":
        return (
            f"tolerance {row['steps']:g}"
            if row["steps"] < 1
            else f"{row['steps']} load steps per interval"
        )
    more = [
        words.get(row["pairing"], ""),
        row["shape"] if row["shape"] != NONE else "",
        row["diagonals"] if row["diagonals"] != NONE else "",
        f"to {row['tolerance']:.0e}" if row["tolerance"] != 1e-8 else "",
    ]
    return ", ".join([f"order {row['order']}", f"N = {row['N']}", *filter(None, more)])


def write_page(name: str, rows: list[Row], asked: list[str], folder: Path, complete: bool) -> None:
    """The page of the plane or of space."""
    body = []
    for scene in asked:
        own_rows = [
            row
            for row in where(rows, scene=scene)
            if row["outcome"] == "certified" and row["tolerance"] <= LOOSEST
        ]
        for key, words in ERRORS[scene].items():
            good = [
                [row for row in own_rows if row[key] <= target]
                for target in (0.1, 0.05, 0.02, 0.01)
            ]
            best = [
                min(some, key=lambda row: row["cpu_seconds"]) if some else None for some in good
            ]
            body.append(
                [
                    TITLES[scene],
                    words,
                    *(f"{choice(row)}: {row['cpu_seconds']:.2g} s" if row else "–" for row in best),
                ]
            )
    publish(
        f"tradeoff_in_{name}.md",
        {
            "The cheapest way to an error": table(
                ["scene", "error of", "10 %", "5 %", "2 %", "1 %"], body
            )
        }
        | {
            TITLES[scene]: table(
                [
                    "choice",
                    "n",
                    "k",
                    "n_A",
                    "CPU s",
                    *ERRORS[scene].values(),
                    "estimated",
                    "over true",
                ],
                (
                    [
                        choice(row)
                        + (
                            ""
                            if row["outcome"] == "certified"
                            else f" ({row['outcome'].split(';')[0]})"
                        ),
                        row["n"],
                        row["iterations"],
                        row["n_A"],
                        f"{row['cpu_seconds']:.2g}",
                        *(percent(row[key]) for key in ERRORS[scene]),
                        percent(row["estimated"]),
                        effectivity(row, scene),
                    ]
                    for row in where(rows, scene=scene)
                ),
            )
            for scene in asked
        },
        folder,
        complete,
    )


ORDERS = (
    "arch",
    "bonded_block",
    "guided_wedge",
    "lined_wheel",
    "pinched_blocks",
    "punch",
    "rail_on_bed",
    "shaft_in_hub",
    "two_boxes",
    "wall",
)
"""Scenes of the gallery, solved with linear elements, which say what quadratic ones would cost, and with these."""


def write_orders(folder: Path) -> None:
    """Whether the unknowns of quadratic elements that runs with linear ones promise are those that they have."""
    rows = []
    for name in ORDERS:
        path = ROOT / "configs" / f"{name}.toml"
        bodies = range(len(tomllib.loads(path.read_text(encoding="utf-8"))["body"]))
        found = [
            ddmpi.solve(
                path, MPI.COMM_SELF, {f"body.{k}.mesh.order": order for k in bodies}
            ).summary
            for order in (1, 2)
        ]
        errors = [each["discretization_error"] for each in found]
        promised, n = errors[0]["quadratic_n"], found[1]["n"]
        both = [percent(error["energy_norm"]) for error in errors]
        rows.append([name, found[0]["n"], promised, n, f"{promised / n:.2f}", *both])
    titles = ["scene", "n", "promised", "n of order 2", "ratio", "estimate", "of order 2"]
    publish("tradeoff_of_orders.md", {"": table(titles, rows)}, folder)


def write_unseen(folder: Path) -> None:
    """Estimates against true errors on the problems of `UNSEEN`."""
    meshes = folder / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    fine: dict[str, Answer] = {}

    def measure(name: str, N: int, order: int, diagonals: str) -> Row:
        problem = UNSEEN[name]
        if name not in fine:
            fine.clear()  # one at a time
            fine[name] = answer_of(problem.scene(Fine(meshes, problem.fine, problem.least)))
        scene = problem.scene(Coarse(meshes, N, order))
        answer = answer_of(other_diagonals(scene) if diagonals == OTHER else scene)
        return {
            "n": answer.summary["n"],
            "one": against_mesh(answer, fine[name]),
            "estimated": answer.summary["discretization_error"]["energy_norm"],
            "own": fine[name].summary["discretization_error"]["energy_norm"],
        }

    cases = [
        (name, N, order, way)
        for name, each in UNSEEN.items()
        for order in (1, 2)
        for N in each.n
        for way in (NONE, OTHER)[: 1 + each.turned]
    ]
    rows = Ledger(
        MPI.COMM_SELF,
        folder / "tradeoff_unseen.csv",
        ("scene", "N", "order", "diagonals"),
        ("n", "one", "estimated", "own"),
    ).fill(cases, measure)
    lines = (
        [
            UNSEEN[row["scene"]].title,
            ", ".join(
                [f"order {row['order']}", f"N = {row['N']}"]
                + [row["diagonals"]] * (row["diagonals"] != NONE)
            ),
            row["n"],
            percent(row["one"]),
            percent(row["estimated"]),
            f"{row['estimated'] / row['one']:.2f}",
            percent(row["own"]),
        ]
        for row in rows
    )
    titles = ["problem", "mesh", "n", "energy norm", "estimated", "over true", "of the reference"]
    publish("tradeoff_unseen.md", {"": table(titles, lines)}, folder)


def main() -> None:
    parser = arguments(__doc__, "tradeoff")
    parser.add_argument(
        "--orders",
        action="store_true",
        help="only what linear elements say of the unknowns of quadratic ones, on ten scenes",
    )
    parser.add_argument(
        "--unseen", action="store_true", help="only the estimate on problems it was not made for"
    )
    parser.add_argument(
        "--scenes",
        nargs="+",
        default=list(TITLES),
        choices=TITLES,
        metavar="SCENE",
        help="which of %(choices)s (default: all)",
    )
    parser.add_argument(
        "--finest",
        type=int,
        metavar="N",
        help=f"mesh of the reference solutions; finer meshes of the same scene are left out (default: {FINE})",
    )
    parser.add_argument(
        "--runs", type=int, default=3, help="of a case that takes less than half a second"
    )
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    for asked, write in ((options.orders, write_orders), (options.unseen, write_unseen)):
        if asked:
            write(options.output)
    if options.orders or options.unseen:
        return
    finest = {scene: options.finest or N for scene, N in FINE.items()}
    trade = Trade(options.output, finest, options.runs)
    cases = [
        case
        for case in CASES
        if case.scene in options.scenes and finest.get(case.scene, case.N) >= case.N
    ]
    rows = Ledger(MPI.COMM_SELF, options.output / "tradeoff.csv", Case._fields, COLUMNS).fill(
        cases, trade.measure
    )
    for name, scenes in PAGES.items():
        asked = [scene for scene in scenes if scene in options.scenes]
        if asked:
            write_page(
                name, rows, asked, options.output, asked == list(scenes) and not options.finest
            )
    print(f"The pages are in {options.output}")


if __name__ == "__main__":
    main()
