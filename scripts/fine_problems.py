"""Verification problems without a closed form: contacts compared with the solution on a fine mesh."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from problem import (
    Found,
    Order,
    Value,
    along,
    body,
    contact,
    degrees,
    draw,
    problem,
    side_means,
    solved,
)

from ddmpi.run.answer import Answer

FINE = 48
"""n of the mesh whose solution stands for the exact one, with quadratic elements."""


def pin_in_lug(n: int, order: Order, folder: Path) -> Answer:
    """A quarter of a pin, of 20 mm diameter, in the hole of half a lug."""
    R, play = 10.0, 0.05
    size = f"{5.0 / n} + 0.15 * Max(0, Sqrt(x * x + (y + {R}) * (y + {R})) - 10)"
    pin = draw(folder / "pin.msh", {"o": (0.0, 0.0), "a": (0.0, -R), "b": (R, 0.0)},
               {"rim": ("a", "o", "b"), "diameter": ("b", "o"), "axis": ("o", "a")}, size, order)
    lug = draw(folder / "lug.msh", {"o": (0.0, play), "a": (0.0, -R), "b": (R + play, play), "c": (0.0, R + 2 * play),
                                    "d": (0.0, 50.0), "e": (25.0, 50.0), "f": (25.0, -25.0), "g": (0.0, -25.0)},
               {"high": ("c", "o", "b"), "low": ("b", "o", "a"), "axis1": ("a", "g"), "bottom": ("g", "f"),
                "side": ("f", "e"), "top": ("e", "d"), "axis2": ("d", "c")}, f"1.2 * ({size})", order,
               {"hole": ["high", "low"], "axis": ["axis1", "axis2"]})
    axis = {"on": "axis", "x": 0.0}
    return solved([body("pin", pin, 2.1e5, 0.3, [axis], {"diameter": (0.0, -300.0)}),
                   body("lug", lug, 7e4, 0.33, [axis, {"on": "top", "y": 0.0}])],
                  [contact("pin", "lug", "rim", "hole")])


def dovetail_root(n: int, order: Order, folder: Path) -> Answer:
    """Half of a blade's root in half of its slot, which touch on a flank at 45°."""
    size = f"{2.0 / n} + 0.2 * Max(0, Sqrt((x - 8) * (x - 8) + (y - 7) * (y - 7)) - 4)"
    blade = draw(folder / "blade.msh", {"a": (0.0, 0.0), "b": (11.0, 0.0), "c": (11.0, 4.0), "d": (5.0, 10.0),
                                        "e": (5.0, 20.0), "f": (0.0, 20.0)},
                 {"bottom": ("a", "b"), "side": ("b", "c"), "flank": ("c", "d"), "neck": ("d", "e"), "top": ("e", "f"),
                  "axis": ("f", "a")}, size, order)
    r, s = 2.0, np.sqrt(0.5)
    upper, lower = (6.5 + s * r, 8.5 + s * r), (9.5 + s * r, 5.5 + s * r)  # centres of the fillets
    slot = draw(folder / "slot.msh",
                {"u": upper, "l": lower, "a": (6.5, 8.5), "b": (9.5, 5.5), "c": (lower[0], lower[1] - r),
                 "d": (13.0, lower[1] - r), "e": (13.0, -2.0), "f": (0.0, -2.0), "g": (0.0, -12.0), "h": (30.0, -12.0),
                 "i": (30.0, 16.0), "j": (upper[0] - r, 16.0), "k": (upper[0] - r, upper[1])},
                {"fillet1": ("k", "u", "a"), "flat": ("a", "b"), "fillet2": ("b", "l", "c"), "s1": ("c", "d"),
                 "s2": ("d", "e"), "s3": ("e", "f"), "axis": ("f", "g"), "bottom": ("g", "h"), "s4": ("h", "i"),
                 "s5": ("i", "j"), "s6": ("j", "k")}, f"1.25 * ({size})", order,
                {"flank": ["fillet1", "flat", "fillet2"]})
    axis = {"on": "axis", "x": 0.0}
    return solved([body("blade", blade, 1.1e5, 0.3, [axis], {"top": (0.0, 100.0)}),
                   body("slot", slot, 2.1e5, 0.3, [axis, {"on": "bottom", "y": 0.0}, {"on": "s4", "x": 0.0}])],
                  [contact("blade", "slot", "flank", "flank", friction={"law": "coulomb", "coefficient": 0.2})])


@functools.cache
def fine(case: Callable[[int, Order, Path], Answer]) -> Answer:
    with tempfile.TemporaryDirectory() as folder:
        return case(FINE, 2, Path(folder))


def compared(answer: Answer, reference: Answer, name: str, allowed: dict[str, float],
             position: Callable[[np.ndarray], np.ndarray], xlabel: str) -> Found:
    """Peaks, resultants, where they act, energies and displacements beside those of the fine mesh."""
    def numbers(each: Answer) -> dict[str, float]:
        contact, bodies, state = each.summary["contacts"][name], each.summary["bodies"], each.contacts[name]
        return {"place of the normal force (mm)": float(position(state.interface.xy) @ state.normal_force
                                                        / state.normal_force.sum()),
                "largest mean pressure of a side (MPa)": float(side_means(state).pressure.max()),
                "normal force (N/mm)": contact["normal_force"],
                "tangential force (N/mm)": abs(contact["tangential_force"]),
                "strain energy (N)": sum(one["energy"] for one in bodies.values()),
                "largest displacement (mm)": each.summary["displacement_max"]}

    state, exact = reference.contacts[name], numbers(reference)
    order = np.argsort(position(state.interface.xy))
    known, p = position(state.interface.xy)[order], state.pressure[order]
    curve = along(answer.contacts[name], lambda x: np.interp(x, known, p), position, xlabel, "pressure (MPa)")
    return Found({word: Value(value, exact[word], allowed[word]) for word, value in numbers(answer).items()
                  if word in allowed}, answer, replace(curve, known="fine mesh"))


@problem("pin", "Pin in a clearance hole", (4, 8, 16), "nodes on half the radius, near the contact",
         view=(0.0, 26.0, -26.0, 26.0),
         shows="A contact whose width nobody knows beforehand, between surfaces of nearly the same curvature.",
         scene="A steel pin of 20 mm diameter in a hole with 0.1 mm play, in an aluminium lug of 50 mm width, drawn; "
               "half of the pin's lower half is loaded by 3 kN/mm on its diameter, no friction, nodes 1 : 1.2 apart; "
               "the lug is held at its upper end.",
         source=f"No formula: compared with quadratic elements, {FINE} nodes on half the radius.")
def pin(n: int, order: Order, folder: Path) -> Found:
    loose = 0.3 / n if order == 1 else 0.1 / n
    return compared(pin_in_lug(n, order, folder), fine(pin_in_lug), "pin-lug",
                    {"largest mean pressure of a side (MPa)": loose, "normal force (N/mm)": loose,
                     "strain energy (N)": loose, "largest displacement (mm)": loose},
                    lambda xy: degrees(np.column_stack([-xy[:, 1], xy[:, 0]])), "angle from the lowest point (°)")


@problem("dovetail", "Dovetail", (4, 8, 16), "nodes on 2 mm near the contact", view=(0.0, 31.0, -13.0, 21.0),
         shows="An inclined contact with rounded ends and friction, as of a blade's root.",
         scene="Half of a root of 110 GPa in half of a slot of 210 GPa, ν = 0.3, plane strain, drawn; they touch on "
               "a flank at 45° whose ends are rounded by 2 mm, and rollers stand for the neighbours on the right; "
               "100 MPa pull the neck, Coulomb 0.2, nodes 1 : 1.25 apart.",
         source=f"No formula: compared with quadratic elements, {FINE} nodes on 2 mm.")
def dovetail(n: int, order: Order, folder: Path) -> Found:
    loose = 0.2 / n if order == 1 else 0.06 / n
    return compared(dovetail_root(n, order, folder), fine(dovetail_root), "blade-slot",
                    {"place of the normal force (mm)": 6 * loose, "normal force (N/mm)": loose,
                     "tangential force (N/mm)": loose, "strain energy (N)": loose,
                     "largest displacement (mm)": 2 * loose},
                    lambda xy: (xy[:, 0] - xy[:, 1]) / np.sqrt(2.0), "along the flank (mm)")
