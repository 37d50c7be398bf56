"""The tables of a run: contact_NAME.csv, contact_NAME_sides.csv, history.csv, steps.csv and energy.csv."""

from __future__ import annotations

import contextlib
import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ddmpi.errors import OutputError
from ddmpi.interface.state import ContactState
from ddmpi.mesh.elements import side_lengths

CONTACT = ("x", "y", "nx", "ny", "length", "normal_force", "tangential_force", "normal_stress", "tangential_stress",
           "gap", "slip", "slip_total", "status")

SIDES = ("x", "y", "length", "normal_stress", "tangential_stress")

HISTORY = ("step", "iteration", "update", "residual", "inner_precision", "open", "slip", "stick", "n_A")

STEPS = ("time", "contact", "force_x", "force_y", "moment", "normal_force", "tangential_force", "open", "slip",
         "stick", "dissipated")

ENERGY = ("time", "external_work", "strain_energy", "interface_work", "dissipated", "residual")


def write_contact(path: Path, name: str, state: ContactState) -> None:
    """Write contact_NAME.csv into the folder `path`: one line per contact node, ordered along the contact.

    Where nodes do not match, they are the slave's. Of those that share a row, each has its part of the forces.

    Directions are those of the first body. Not collective. Raises OutputError.
    """
    interface = state.interface
    lines = interface.shown
    share = lines.area / interface.area[lines.row]
    columns = (state.normal_force[lines.row] * share, state.tangential_force.ravel()[lines.row] * share,
               *(each.ravel()[lines.row] for each in (state.pressure, state.shear, state.gap, state.slip,
                                                      state.slip_total, state.status)))
    columns = (*lines.xy.T, *interface.normal[lines.row].T, lines.area, *columns)
    _write_csv(path / f"contact_{name}.csv", CONTACT, zip(*columns, strict=True))


def write_sides(path: Path, name: str, state: ContactState) -> None:
    """Write contact_NAME_sides.csv into the folder `path`: mean stresses over the sides of quadratic elements.

    Nodal stresses oscillate between corners and middles where a contact is curved or ends; their means over sides,
    by Simpson's rule, do not. A line holds the middle of a side and its arc length; sides with a node that carries no
    force are left out. Linear elements have no such file. Not collective. Raises OutputError.
    """
    xy, (start, end, middle) = state.interface.xy, state.interface.edges.T
    if len(middle) == 0:
        return
    length = side_lengths(xy[state.interface.edges])
    means = ((stress[start] + 4 * stress[middle] + stress[end]) / 6 for stress in (state.pressure, state.shear.ravel()))
    _write_csv(path / f"contact_{name}_sides.csv", SIDES, zip(*xy[middle].T, length, *means, strict=True))


def write_history(path: Path, rows: Iterable[Sequence]) -> None:
    """Write history.csv into the folder `path`: one line per outer iteration.

    A row has the load step, the fields of `methods.outer.Step`, its n_A last, and before it the numbers of open,
    slipping and sticking nodes of all contacts. Not collective. Raises OutputError.
    """
    _write_csv(path / "history.csv", HISTORY, rows)


def write_steps(path: Path, steps: Iterable[dict]) -> None:
    """Write steps.csv into the folder `path`: one line per load step and contact.

    `steps` is the entry of that name in the summary (`summary.summarize`). Not collective. Raises OutputError.
    """
    _write_csv(path / "steps.csv", STEPS, (
        (step["time"], name, *contact["force"], *(contact[column] for column in STEPS[4:]))
        for step in steps for name, contact in step["contacts"].items()))


def write_energy(path: Path, rows: Iterable[Sequence]) -> None:
    """Write energy.csv into the folder `path`: one line per load step.

    A row has the time; external work, strain energy, interface work and dissipated energy since time 0; and the
    residual of the step, what its external work exceeds the growth of strain energy and its interface work by (J).
    Not collective. Raises OutputError.
    """
    _write_csv(path / "energy.csv", ENERGY, rows)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """A context in which `path` is written: an error of the system becomes an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"results could not be written: {error.filename or path}: "
                          f"{error.strerror or error}") from None


def _write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence]) -> None:
    with writing(path), open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([_cell(value) for value in row] for row in rows)


def _cell(value: object) -> object:
    """The value with all its digits; what the summary calls null is nan."""
    if value is None:
        return "nan"
    return repr(float(value)) if isinstance(value, float | np.floating) else value
