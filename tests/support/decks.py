"""Small decks of Abaqus and CalculiX for tests."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np


def grid(
    name: str,
    divisions: Sequence[int],
    size: Sequence[float],
    origin: Sequence[float] | None = None,
    first: int = 1,
    kind: str = "",
) -> str:
    """Nodes and elements of a rectangle or a box, with the sets NAME of elements and NAME_X0, NAME_X1, … of nodes.

    Elements are in the order of x, then y, then z; the face of an element at the least z is S1, at the largest S2.
    """
    d, n = len(divisions), np.array(divisions)
    origin = origin or [0.0] * d
    kind = kind or ("CPE4" if d == 2 else "C3D8")
    strides = np.cumprod([1, *(n + 1)])
    lines = ["*NODE"]
    places = [at[::-1] for at in product(*(range(k + 1) for k in n[::-1]))]
    for at in places:
        x = [origin[k] + size[k] * at[k] / n[k] for k in range(d)]
        lines.append(f"{first + int(np.dot(at, strides[:d]))}, " + ", ".join(map(repr, x)))
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = corners if d == 2 else [(*at, z) for z in (0, 1) for at in corners]
    for number, at in enumerate(product(*(range(k) for k in n[::-1]))):
        nodes = [
            first + int(np.dot(np.array(at[::-1]) + corner, strides[:d])) for corner in corners
        ]
        lines.append(", ".join(map(str, [first + number, *nodes])))
    for k, axis in enumerate("XYZ"[:d]):
        for end in (0, 1):
            members = [first + int(np.dot(at, strides[:d])) for at in places if at[k] == end * n[k]]
            lines += [f"*NSET, NSET={name}_{axis}{end}", *(f"{member}," for member in members)]
    return "\n".join(lines) + "\n"


STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n210000., 0.3\n*DENSITY\n7.8e-9\n*EXPANSION\n1.2e-5\n"


def step(*cards: str, time: str = "", options: str = "") -> str:
    """A static step with these cards."""
    return (
        f"*STEP{options}\n*STATIC\n" + f"{time}\n" * bool(time) + "\n".join(cards) + "\n*END STEP\n"
    )
