"""CalculiX (calculix-ccx): node-to-face contact by penalty springs, linear triangles CPE3, SPOOLES."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from case import Answer, Case

STIFFNESS = STICK = 20.0
"""Of the contact springs, normal and while they stick, in Young's moduli per least nodal length."""

TENSION = 1e-8
"""Stress that open springs bear, in Young's moduli."""


def _rows(rows: Iterable) -> str:
    return "".join(", ".join(map(str, row)) + "\n" for row in rows)


def deck(case: Case) -> str:
    points, triangles = case.points, case.triangles
    clamped = [(i // 2 + 1, i % 2 + 1, i % 2 + 1) for i in case.clamped.tolist()]
    base = np.intersect1d(case.clamped // 2, second_body(case)).tolist()
    if case.rigid:  # two elements that cannot move
        start, low, high = len(points), points[:, 0].min() - 1.0, points[:, 0].max() + 1.0
        points = np.vstack([points, [[low, low - high], [high, low - high], [high, 0.0], [low, 0.0]]])
        triangles = np.vstack([triangles, start + np.array([[0, 1, 2], [0, 2, 3]])])
        base = list(range(start, start + 4))
        clamped += [(i + 1, 1, 2) for i in base]
    lines = ["*NODE, NSET=ALL\n", _rows((i + 1, repr(x), repr(y), 0.0) for i, (x, y) in enumerate(points.tolist())),
             "*ELEMENT, TYPE=CPE3, ELSET=BODIES\n",
             _rows((e + 1, *each) for e, each in enumerate((triangles + 1).tolist())),
             f"*NSET, NSET=WATCHED\n{case.watched + 1}\n*NSET, NSET=BASE\n", _rows((i + 1,) for i in base),
             f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{case.young!r}, {case.poisson!r}\n",
             "*SOLID SECTION, ELSET=BODIES, MATERIAL=STEEL\n1.0\n*BOUNDARY\n", _rows(clamped)]
    for number in np.unique(case.contact):
        first, second = case.pairs[case.contact == number].T
        lines += [f"*SURFACE, NAME=FIRST{number}, TYPE=ELEMENT\n", _rows(faces(case, first)),
                  f"*SURFACE, NAME=SECOND{number}, TYPE=ELEMENT\n",
                  f"{len(triangles)}, S2\n" if case.rigid else _rows(faces(case, second)),
                  "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE\n", f"FIRST{number}, SECOND{number}\n"]
    spring = case.young / case.length.min()
    lines += ["*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n",
              f"{STIFFNESS * spring!r}, {TENSION * case.young!r}\n"]
    if case.friction:
        lines += [f"*FRICTION\n{case.friction!r}, {STICK * spring!r}\n"]
    load = [(i // 2 + 1, i % 2 + 1, repr(value)) for i, value in enumerate(case.load.tolist()) if value]
    lines += ["*STEP, INC=1000\n*STATIC\n1., 1.\n*CLOAD\n", _rows(load), "*NODE PRINT, NSET=WATCHED\nU\n",
              "*NODE PRINT, NSET=BASE, TOTALS=ONLY\nRF\n*CONTACT PRINT\nCSTR\n*END STEP\n"]
    return "".join(lines)


def second_body(case: Case) -> np.ndarray:
    """The nodes of the second body of the first contact, none of the rigid plane."""
    second = case.pairs[case.contact == 0, 1]
    bodies = np.unique(case.body[np.isin(case.triangles, second).any(axis=1)])
    return np.unique(case.triangles[np.isin(case.body, bodies)])


def faces(case: Case, nodes: np.ndarray) -> list[tuple[int, str]]:
    """The boundary sides of elements along some nodes.

    A node that no pair has, because a clamp holds it, may end them.
    """
    sides = np.stack([case.triangles, np.roll(case.triangles, -1, axis=1)], axis=2)
    each, counts = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    inner = set(map(tuple, each[counts > 1].tolist()))
    paired = np.isin(sides, nodes)
    ends = np.isin(2 * sides, case.clamped) & np.isin(case.points[sides, 1], case.points[nodes, 1])
    along = (paired | ends).all(axis=2) & paired.any(axis=2)
    return [(e + 1, f"S{k + 1}") for e, k in np.argwhere(along).tolist()
            if tuple(sorted(sides[e, k].tolist())) not in inner]


def write_input(case: Case, folder: Path) -> None:
    for name in ("contact.dat", "contact.sta"):
        (folder / name).unlink(missing_ok=True)
    (folder / "contact.inp").write_text(deck(case), encoding="utf-8")


def command(folder: Path, count: int) -> list[str]:
    return ["ccx", "contact"]


def _table(text: str, title: str) -> np.ndarray:
    """The last table of that title."""
    blocks = text.split("\n\n")
    last = max(i for i, block in enumerate(blocks) if block.strip().startswith(title))
    return np.array([line.split() for line in blocks[last + 1].strip().splitlines()], float)


def read_output(case: Case, folder: Path) -> Answer:
    """The resultant is what the second body's clamps leave of its loads."""
    text = (folder / "contact.dat").read_text(encoding="utf-8")
    *_, last = increments = (folder / "contact.sta").read_text(encoding="utf-8").splitlines()[2:]
    if "U" in last.split()[2] or float(last.split()[4]) < 1.0:
        raise RuntimeError(f"no convergence beyond {float(last.split()[4]):.3g} of the load")
    load = case.load.copy()
    load[case.clamped] = 0.0  # not part of what CalculiX calls a reaction
    force = -_table(text, "total force")[0, :2] - load.reshape(-1, 2)[second_body(case)].sum(axis=0)
    along = np.array([case.normal[0] @ force, case.tangent[0] @ force])
    return Answer(_table(text, "displacements")[0, 1:3], along, float(_table(text, "contact stress")[:, 1].max()),
                  sum(int(row.split()[3]) for row in increments))
