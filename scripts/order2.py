#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Contacts of quadratic elements in space against fine meshes: boxes, the same bonded, a loose stack.

The two boxes of configs/two_boxes.toml on meshes that match or not, and four loose cubes pushed at the top. Errors are
those of the contact force (normal and tangential), of the displacements of all nodes of a fine mesh, and of the top of
the stack. Writes order2.md to the folder --output and to docs/tables/. On one rank; ten minutes beside other work.
"""

import logging
import math
from pathlib import Path

import numpy as np
from experiment import arguments, publish, refilled, table
from peers.scenes import tall
from problems.bodies import answer_of as solved
from solid_scenes import box, two_boxes
from tradeoff import in_box

from ddmpi.run.answer import Answer

BOXES, FINE = ((2, 2), (3, 3), (4, 3), (4, 4), (4, 5), (6, 6), (8, 7), (8, 8)), (12, 11)
"""Cells along the short sides of both boxes."""

STACK, FINEST = (2, 3, 6), 10
"""Cells along a side of each cube."""

BODIES = ("upper", "lower")


def force(answer: Answer) -> np.ndarray:
    totals = answer.contacts["upper-lower"].totals
    return np.array([totals.normal_force, totals.tangential_force])


def away(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def of_boxes(answer: Answer, fine: Answer) -> list[float]:
    """Errors of the force, of the displacements of each box, and of both."""
    moved = [(in_box(answer.bodies[name].points, answer.bodies[name].displacement, 2, fine.bodies[name].points),
              fine.bodies[name].displacement) for name in BODIES]
    return [away(force(answer), force(fine)), *(away(*pair) for pair in moved),
            away(*(np.concatenate(each) for each in zip(*moved, strict=True)))]


def bonded(upper: int, lower: int) -> dict:
    """The boxes, bonded and without the load at their end: one block, but for the meshes."""
    scene = two_boxes(upper, lower, 2)
    del scene["contact"][0]["friction"], scene["body"][0]["traction"][1]
    scene["contact"][0]["kind"] = "bonded"
    return scene


def of_block(n: int, fine: Answer) -> float:
    """The error of the same as one body, without a contact, at the nodes of the fine boxes."""
    upper, lower = bonded(n, n)["body"]
    body = solved({"body": [box("block", (0, 0, 0), (3, 2, 1), (3 * n, 2 * n, n), 2, 2.119e11, 0.277,
                                clamp=upper["clamp"], traction=upper["traction"] + lower["traction"])]}).bodies["block"]
    moved = [in_box(body.points, body.displacement, 2, fine.bodies[name].points) for name in BODIES]
    return away(np.concatenate(moved), np.concatenate([fine.bodies[name].displacement for name in BODIES]))


def top(answer: Answer) -> np.ndarray:
    cube = answer.bodies["cube3"]
    return cube.displacement[cube.points.sum(axis=1).argmax()]


def percent(error: float) -> str:
    return f"{100 * error:.3f} %"


def rates(sizes: list[int], errors: list[float]) -> list[str]:
    """Powers of the size of cells with which errors fall from each mesh to the next."""
    return ["–", *(f"{math.log(errors[k] / errors[k + 1]) / math.log(sizes[k + 1] / sizes[k]):.1f}"
                   for k in range(len(sizes) - 1))]


def main() -> None:
    options = arguments(__doc__, "order2").parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    fine, glued = solved(two_boxes(*FINE, 2)), solved(bonded(*FINE))
    rubbed, whole, alike = [], [], []
    for sizes in BOXES:
        name, same = f"{sizes[0]} : {sizes[1]}", sizes[0] == sizes[1]
        answer = solved(two_boxes(*sizes, 2))
        errors, counts = of_boxes(answer, fine), (answer.summary["m"], answer.summary["inner_iterations"])
        rubbed.append([name, *counts, *map(percent, errors)])
        alike += [(sizes[0], errors[0], errors[3])] if same else []
        alone = percent(of_block(sizes[0], glued)) if same else "–"
        whole.append([name, *map(percent, of_boxes(solved(bonded(*sizes)), glued)), alone])
    exact = top(solved(tall(2 * FINEST, Path(), 2)))
    stack = [away(top(solved(tall(2 * n, Path(), 2))), exact) for n in STACK]
    counts, *errors = map(list, zip(*alike, strict=True))
    four = ("force", "upper box", "lower box", "displacement of both")
    publish("order2.md", refilled("order2.md", {
        "Two boxes with Coulomb friction": [
            *table(("cells", "rows", "GMRES", *four), rubbed),
            *table(("cells", "force", "displacement"), zip(
                counts, *(rates(counts, each) for each in errors), strict=True))],
        "The boxes bonded, and as one block": table(("cells", *four, "of one block"), whole),
        "A loose stack of four cubes": table(("cells", "displacement of the top", "rate"), zip(
            STACK, (f"{100 * error:.2f} %" for error in stack), rates(list(STACK), stack), strict=True))}, True),
        options.output, True)


if __name__ == "__main__":
    main()
