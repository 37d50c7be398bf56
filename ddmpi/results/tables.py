"""The tables of a run: contact_NAME.csv, contact_NAME_sides.csv, contact_NAME_legs.csv, history.csv, steps.csv and
energy.csv; all files of a run, read back."""

import contextlib
import csv
import io
import json
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ddmpi.errors import DdmpiError, InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState, signed
from ddmpi.mesh.elements import cell_with, circumference, facet_measures
from ddmpi.system.files import contact_files, write_atomically, writing

Columns = dict[str, np.ndarray]
"""A table: the arrays of its columns by name; `status` and `contact` hold words, all others numbers."""

FORMAT = 2  # version of the layout of all result files. Names and meanings of one format stay; entries may be added
WIDE = 68  # letters of a title in a line of the narrowest picture

STATUS = ("open", "slip", "stick")

# The columns of the tables; those of contact_NAME.csv are in `ContactState.table`. docs/reference/results.md says what
# each means.

LEGS_IN = {
    2: (
        "time",
        "x",
        "y",
        "length",
        "normal_stress",
        "tangential_stress",
        "gap",
        "slip",
        "slip_total",
        "utilisation",
        "status",
    ),
    3: (
        "time",
        "x",
        "y",
        "z",
        "area",
        "normal_stress",
        "tangential_stress",
        "gap",
        "slip",
        "slip_total",
        "utilisation",
        "status",
        "force_x",
        "force_y",
        "force_z",
        "slip_x",
        "slip_y",
        "slip_z",
    ),
}
"""By dimension."""

AREAS = {
    "length": "area"
}  # names of columns around an axis, where nodal lengths are those of rings: areas

SIDES = ("x", "y", "length", "normal_stress", "tangential_stress")

HISTORY = ("step", "iteration", "update", "residual", "inner_precision", *STATUS, "n_A")

TOTALS = ("normal_force", "tangential_force", *STATUS, "dissipated", "utilisation")

STEPS_IN = {
    2: ("time", "contact", "force_x", "force_y", "moment", *TOTALS),
    3: (
        "time",
        "contact",
        "force_x",
        "force_y",
        "force_z",
        "moment_x",
        "moment_y",
        "moment_z",
        *TOTALS,
    ),
}
"""By dimension."""

ENERGY = ("time", "external_work", "strain_energy", "interface_work", "dissipated", "residual")

CYCLE = ("cycle",)  # the last column of steps.csv and energy.csv in scenes with [time] cycle

PATH = (
    "distance",
    "x",
    "y",
    "z",
    "body",
    "displacement_x",
    "displacement_y",
    "displacement_z",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xy",
    "stress_yz",
    "stress_xz",
    "principal_1",
    "principal_2",
    "principal_3",
    "von_mises",
)


def write_contact(path: Path, name: str, state: ContactState) -> None:
    """Write contact_NAME.csv into the folder `path`: one line per contact node, in the plane along the contact.

    Where nodes do not match, they are the slave's. Nodes that share a row share its forces.
    Directions are those of the first body. Not collective. Raises OutputError.
    """
    table = state.table()
    write_table(path / contact_files(name).table, table.dtype.names or (), table.tolist())


def write_sides(path: Path, name: str, state: ContactState) -> None:
    """Write contact_NAME_sides.csv into the folder `path`: mean stresses over the sides of quadratic elements.

    Nodal stresses oscillate between corners and middles where a contact is curved or ends; their means over sides,
    by Simpson's rule, do not. A line holds the middle of a side and its arc length; sides with a node that carries no
    force are left out. Linear elements have no such file, and solids have none: their rows stand at the corners of
    facets, and do not oscillate. Not collective. Raises OutputError.
    """
    xy, facets = state.interface.xy, state.interface.geometry.facets
    cell = cell_with(facets.shape[1], xy.shape[1] - 1)
    middle, places = (
        facets[:, (cell.nodes == cell.middle).all(axis=1)].ravel(),
        xy[facets],
    )
    if len(middle) == 0:
        return
    bare = facets[:, :2] == facets[:, 2:]  # ends on an axis, which have no row
    places[:, :2][bare] = (2.0 * places[:, 2:] - places[:, 1::-1])[bare]
    length = facet_measures(places)
    means = (
        side_means(stress[facets], places, state.interface.axisymmetric)
        for stress in (state.pressure, signed(state.shear))
    )
    write_table(
        path / contact_files(name).sides, SIDES, zip(*xy[middle].T, length, *means, strict=True)
    )


def side_means(stress: np.ndarray, places: np.ndarray, axisymmetric: bool) -> np.ndarray:
    """Means (f,) over sides of stresses (f, 3) at their ends and middles at `places` (f, 3, 2), by Simpson's rule."""
    # ∫ σ ds by Simpson's weights 1/6, 1/6, 4/6, around an axis times 2πr
    shares = (
        cell_with(stress.shape[1], 1).mass.sum(axis=1)
        * circumference(places, axisymmetric)
        * np.ones_like(stress)
    )
    return (shares * stress).sum(axis=1) / shares.sum(axis=1)


def named(columns: Iterable[str], axisymmetric: bool) -> list[str]:
    """Names of columns, around an axis with AREAS."""
    return [AREAS.get(column, column) if axisymmetric else column for column in columns]


def leg_columns(dimension: int) -> tuple[str, ...]:
    """The columns of contact_NAME_legs.csv that differ from load step to load step."""
    return LEGS_IN[dimension][LEGS_IN[dimension].index("normal_stress") :]


def leg_values(state: ContactState) -> np.ndarray:
    """The numbers (m, k) of the `leg_columns`; a status is its place in STATUS, a force that of the whole row."""
    status = np.argmax(state.status[:, None] == np.array(STATUS), axis=1)
    columns = [
        state.pressure,
        signed(state.shear),
        state.gap,
        signed(state.slip),
        signed(state.slip_total),
        state.utilised,
        status,
    ]
    if state.interface.dimension > 2:
        columns += [state.forces + 0.0, state.along(state.slip) + 0.0]  # no −0
    return np.column_stack(columns)


def _by_line(state: ContactState, values: np.ndarray) -> list[np.ndarray]:
    """The `leg_columns` with `leg_values` (m, k) by line. Nodes that share a row share its force."""
    lines, share, columns = state.interface.lines, state.interface.shares, []
    for name, column in zip(
        leg_columns(state.interface.dimension), values[lines.row].T, strict=True
    ):
        if name == "status":
            column = np.array(STATUS)[column.astype(int)]
        columns.append(column * share if name.startswith("force") else column)
    return columns


def write_legs(
    path: Path,
    name: str,
    interface: Interface,
    steps: Iterable[tuple[float, ContactState, np.ndarray]],
) -> None:
    """Write contact_NAME_legs.csv into the folder `path`: a line per contact node and load step whose fields are kept.

    Parameters
    ----------
    interface : of the contact at one of the steps
    steps : time, a state of the contact with its nodes, and `leg_values` (m, k), of each load step

    Not collective. Raises OutputError.
    """
    write_table(
        path / contact_files(name).legs,
        named(LEGS_IN[interface.dimension], interface.axisymmetric),
        (
            (time, *row)
            for time, state, values in steps
            for row in zip(
                *state.interface.lines.acting.T,
                state.interface.lines.area,
                *_by_line(state, values),
                strict=True,
            )
        ),
    )


def write_steps(path: Path, steps: Iterable[dict]) -> None:
    """Write steps.csv into the folder `path`: one line per load step and contact. `steps` is the entry of that name in
    the summary (`summary.summarize`). Not collective. Raises OutputError."""
    steps = list(steps)
    cycles = CYCLE if any("cycle" in step for step in steps) else ()
    rows = [
        (
            step["time"],
            name,
            *contact["force"],
            *np.atleast_1d(contact["moment"]),
            *(contact[column] for column in TOTALS),
            *(step.get(column, 0) for column in cycles),
        )
        for step in steps
        for name, contact in step["contacts"].items()
    ]
    write_table(
        path / "steps.csv",
        next(
            [*columns, *cycles]
            for columns in STEPS_IN.values()
            if not rows or len(columns) + len(cycles) == len(rows[0])
        ),
        rows,
    )


def write_energies(path: Path, energies: Iterable[Sequence[float]], steps: Sequence[dict]) -> None:
    """Write energy.csv into the folder `path`: a line for each of the `steps`, as for `write_steps`, with the numbers
    ENERGY. Not collective. Raises OutputError."""
    cycles = CYCLE if any("cycle" in step for step in steps) else ()
    write_table(
        path / "energy.csv",
        [*ENERGY, *cycles],
        (
            (*row, *(step.get(column, 0) for column in cycles))
            for row, step in zip(energies, steps, strict=True)
        ),
    )


def write_path(path: Path, columns: Columns) -> None:
    """Write the columns of `histories.along`. A table of a path is overwritten, any other file is not. Not collective.
    Raises InputError, OutputError."""
    if path.exists() and not (path.is_file() and path.read_bytes().startswith(b"distance,x,y,")):
        raise InputError(
            f"--output {path}: is there already, and no table of a path; name another file"
        )
    text = io.StringIO(newline="")
    _write(text, columns, zip(*columns.values(), strict=True))
    write_atomically(path, text.getvalue().encode())  # in the place of a link, not through it


@contextlib.contextmanager
def reading(path: str | Path, what: str = "a complete folder of results") -> Iterator[None]:
    """A context for reading files with any content: all errors become InputError."""
    try:
        yield
    except DdmpiError:
        raise
    except Exception as error:
        lost = getattr(error, "filename", None) if isinstance(error, FileNotFoundError) else None
        why = "there is no" if lost or isinstance(error, KeyError) else type(error).__name__
        first = Path(lost).name if lost else str(error).partition("\n")[0][:200]
        if isinstance(error, NotADirectoryError):
            why, first = "it is", "no folder"
        raise InputError(f"{path}: not {what}: {why} {first}") from None


def write_table(path: Path, columns: Iterable[str], rows: Iterable[Sequence]) -> None:
    """Write a table with the names of its `columns`. Not collective. Raises OutputError."""
    with writing(path), open(path, "w", newline="", encoding="utf-8") as file:
        _write(file, columns, rows)


def _write(file: TextIO, columns: Iterable[str], rows: Iterable[Sequence]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)


def _cell(value: object) -> object:
    """The value with all its digits; None, null in the summary, is nan."""
    if value is None:
        return "nan"
    return repr(float(value)) if isinstance(value, float | np.floating) else value


@dataclass(frozen=True)
class Results:
    """All results of a run.

    Attributes
    ----------
    summary : the content of summary.json
    contacts : of each contact contact_NAME.csv, with the column initial_gap of result.h5
    facets : of each contact the rows (f, d) of its table that segments or triangles join, as in result.h5
    surfaces : of each contact the points, cells and fields of what it covers, as in contact_NAME.vtu
    sides : the same of contact_NAME_sides.csv; empty with linear elements
    history, steps : history.csv and steps.csv
    energy : energy.csv, and legs : of each contact contact_NAME_legs.csv; empty without [time]
    fields : the data of result.h5 of a load step; `fields["body"]` numbers the bodies as summary["bodies"] lists them
    time : of the load step that summary, contacts, sides and fields are of; None without [time], and of the last one
    frames : frames.csv, where bodies move far
    """

    summary: dict
    contacts: dict[str, Columns]
    sides: dict[str, Columns]
    history: Columns
    steps: Columns
    fields: dict[str, np.ndarray]
    energy: Columns = field(default_factory=dict)
    legs: dict[str, Columns] = field(default_factory=dict)
    facets: dict[str, np.ndarray] = field(default_factory=dict)
    surfaces: dict[str, Columns] = field(default_factory=dict)
    time: float | None = None
    frames: Columns = field(default_factory=dict)

    @property
    def scene(self) -> dict[str, Any]:
        """The scene with all defaults."""
        return self.summary["scene"]

    @property
    def output(self) -> dict[str, Any]:
        """The scene's table `output`, with what is asked of pictures."""
        return self.scene["output"]

    @property
    def units(self) -> dict[str, str]:
        """Labels of quantities."""
        return self.summary["units"]

    @property
    def dimension(self) -> int:
        """That of the points, whose z is zero in the plane."""
        return 2 + int(self.fields["points"][:, 2:].any())

    @property
    def axisymmetric(self) -> bool:
        """Whether the bodies turn around the axis x = 0."""
        return bool(self.scene.get("axisymmetric"))

    @property
    def parts(self) -> list[str]:
        """Names of the bodies, then of the rigid partners."""
        return [
            *self.summary["bodies"],
            *(rigid["name"] for rigid in self.scene.get("rigid", ())),
        ]

    @property
    def points(self) -> np.ndarray:
        """(nv, d) of all bodies (m)."""
        return self.fields["points"][:, : self.dimension]

    @property
    def extent(self) -> float:
        """The longest side of the box around all bodies (m)."""
        return float(np.ptp(self.points, axis=0).max())

    def displacement(self, scale: float = 1.0) -> np.ndarray:
        """(nv, d) times `scale` (m)."""
        return scale * self.fields["displacement"][:, : self.dimension]

    def cells(self, name: str) -> np.ndarray:
        """The cells (c, d) of what a contact covers, without points that stand alone."""
        cells = self.surfaces[name]["cells"]
        return cells[cells[:, 0] != cells[:, 1]]

    def heading(self, timed: bool = False) -> str:
        """What a picture's title begins with: the scene's title, and the time of the load step if it is `timed`."""
        title = textwrap.fill(self.summary["title"], WIDE)
        when = f"time {self.time:g}: " if timed and self.time is not None else ""
        return (f"{title}\n" if title else "") + when


def read_results(folder: str | Path) -> Results:
    """Read all results of a run from its folder. Not collective. Raises InputError if they are not complete, or of
    another format."""
    import h5py

    folder = Path(folder)
    summary = read_summary(folder)
    if only := summary["scene"].get("output", {}).get("only"):
        raise InputError(
            f'{folder}: holds contacts alone, without fields, because of output.only = "{only}"; run the '
            "scene without it"
        )
    with reading(folder):
        for name in summary["contacts"]:
            if "/" in name:
                raise ValueError(f"the contact {name!r} is no part of a file's name")
        tables = {name: folder / contact_files(name).table for name in summary["contacts"]}
        sides = {name: folder / contact_files(name).sides for name in tables}
        with h5py.File(folder / "result.h5", "r") as file:
            fields = read_fields(file)
            surfaces, (lines, facets) = read_surfaces(file), read_lines(file)
        steps = summary["scene"].get("time") is not None
        return Results(
            summary,
            {name: _read_csv(path) | lines.get(name, {}) for name, path in tables.items()},
            {name: _read_csv(path) for name, path in sides.items() if path.exists()},
            _read_csv(folder / "history.csv"),
            _read_csv(folder / "steps.csv"),
            fields,
            _read_csv(folder / "energy.csv") if steps else {},
            {name: _read_csv(folder / contact_files(name).legs) for name in tables if steps},
            facets,
            surfaces,
            frames=_read_csv(folder / "frames.csv")
            if steps and (summary["scene"]["time"].get("motions") == "far")
            else {},
        )


def read_fields(file: Any) -> Columns:
    """The fields of bodies in result.h5 at the last load step; cells of several kinds `together`, as versions before 0.21
    wrote them."""
    fields = {name: data[()] for name, data in datasets(file).items()}
    if "cells" not in fields:
        fields["cells"] = together([data[()] for data in cells_by_kind(file).values()])
    return fields


def read_lines(file: Any, step: str = "") -> tuple[dict[str, Columns], dict[str, np.ndarray]]:
    """What result.h5 adds to the lines of each contact's table, at the last load step or that of the group `step`, and
    the facets that join them."""
    lines = {
        name: {key: data[()] for key, data in group.items() if key != "span"}
        for name, group in file.get(f"{step}/contacts", {}).items()
    }
    return lines, {name: data.pop("facets") for name, data in lines.items()}


def read_surfaces(file: Any, step: str = "") -> dict[str, Columns]:
    """Of each contact the points (n, 3), cells (c, d) and fields of its surface in result.h5, at the last load step or
    that of the group `step`. Empty in results of versions before 0.16."""
    stored, found = (
        datasets(file.get("surfaces", {})) | datasets(file.get(f"{step}/surfaces", {})),
        {},
    )
    for name, group in file.get(f"{step}/contacts", file.get("contacts", {})).items():
        if "span" in group:
            (node, cell), (nodes, cells) = group["span"][()].tolist()
            found[name] = {
                key: data[node : node + nodes] for key, data in stored.items() if key != "cells"
            }
            found[name]["cells"] = stored["cells"][cell : cell + cells] - node
    return found


def cells_by_kind(file: Any) -> dict[str, Any]:
    """The datasets of cells in result.h5 by kind, in the order in which cells stand in others."""
    return dict(sorted(datasets(file["cells"]).items()))


def together(cells: Sequence[np.ndarray]) -> np.ndarray:
    """Cells (n, k) of several kinds as rows (nt, width) as long as the longest ones; others end in −1."""
    width = max(own.shape[1] for own in cells)
    return np.concatenate(
        [np.pad(own, ((0, 0), (0, width - own.shape[1])), constant_values=-1) for own in cells]
    )


def datasets(group: Any) -> dict[str, Any]:
    """The datasets in a group of an HDF5 file, by name."""
    import h5py

    return {name: data for name, data in group.items() if isinstance(data, h5py.Dataset)}


def read_summary(folder: str | Path) -> dict:
    """The content of summary.json of a folder of results. Not collective. Raises InputError as `read_results` does."""
    with reading(folder):
        summary = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))
        format_found = summary.get("format", 1)
        if format_found != FORMAT:
            raise InputError(
                f"{folder}: results in format {format_found}; this version reads format {FORMAT}"
            )
        return summary


def _read_csv(path: Path) -> Columns:
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = zip(*rows, strict=True) if rows else ((),) * len(header)
    return {
        name: np.array(column, str if name in ("status", "contact", "body") else float)
        for name, column in zip(header, columns, strict=True)
    }


def drawn_rows(table: Columns, facets: np.ndarray) -> tuple[Columns, np.ndarray]:
    """The rows of a contact's table that its facets (f, d) join, and the facets by the numbers of these rows."""
    rows, places = np.unique(facets, return_inverse=True)
    return {name: column[rows] for name, column in table.items()}, places.reshape(facets.shape)


def chains(facets: np.ndarray) -> list[np.ndarray]:
    """The rows of the nodes that facets (f, 2) join, chain by chain; a closed chain ends with its first node."""
    runs = np.split(facets, 1 + np.flatnonzero(facets[1:, 0] != facets[:-1, 1]))
    return [np.append(run[:, 0], run[run[:, 0] != run[:, 1]][-1:, 1]) for run in runs]
