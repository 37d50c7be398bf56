"""The answer of `ddmpi.solve`, also as a notebook shows it, and the model of `ddmpi.prepare`."""

import base64
import copy
import html
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from mpi4py import MPI

from ddmpi.derive.entries import Entry, joined
from ddmpi.derive.gradient import gradient
from ddmpi.errors import InputError, unknown
from ddmpi.interface.state import ContactState
from ddmpi.mesh.build import kind_of_files
from ddmpi.methods.newton import Newton
from ddmpi.petsc.options import RunOptions
from ddmpi.results.converge import table_of
from ddmpi.results.fields import Fields, table_fields
from ddmpi.results.summary import ROWS, where
from ddmpi.results.tables import HISTORY, STATUS, chains
from ddmpi.run.gather import Solved
from ddmpi.run.report import LISTED, NAMED, describe_contact
from ddmpi.run.run import Cases
from ddmpi.scene.given import Given, values_with_names, with_names
from ddmpi.scene.keys import override
from ddmpi.scene.petsc import code_of, refuse_reaching
from ddmpi.scene.reader import as_data, checked, read_data, read_text
from ddmpi.scene.results import with_letters
from ddmpi.scene.scene import Settled
from ddmpi.system import logs
from ddmpi.system.agreement import agreed, from_first, in_lockstep, merged
from ddmpi.system.clock import Clock
from ddmpi.system.numbers import in_words, scaled_unit
from ddmpi.system.provenance import has_matplotlib, optional

COLUMNS = (
    "force",
    "moment",
    "normal_force",
    "utilisation",
    "pressure_max",
    *STATUS,
)  # the entries of a contact in the table


CHANGES = ("update", "residual", "inner_precision")
RECORD = [(name, float if name in CHANGES else int) for name in HISTORY]
"""The columns of history.csv, of which all but the changes are counts, with their types."""


@dataclass(frozen=True)
class Answer:
    """An answer, as one rank has it.

    Attributes
    ----------
    summary : what a run writes as summary.json; the same on all ranks
    contacts : state by contact: normal_force, pressure, shear, gap, slip, status, force, …; the same on all ranks
    bodies : fields of the bodies of this rank, by name; none with only="contacts"
    solved : all else that was computed, for studies of the method; None on ranks without a body; no stable interface
    derived : derivatives of arrays by key: of nodes by contact, the same on all ranks, and of this rank's bodies
    history : (iterations,) records, as the lines of history.csv: step, iteration, update, residual, inner_precision, open,
        slip, stick and n_A, in all load steps; the same on all ranks
    """

    summary: dict[str, Any]
    contacts: Mapping[str, ContactState]
    bodies: Mapping[str, Fields]
    solved: Solved | None
    derived: Mapping[str, Entry] = field(default_factory=dict)
    history: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __copy__(self) -> Self:
        return replace(self)

    def __reduce__(self) -> tuple[Any, ...]:
        if self.solved:  # pickle and deepcopy come here
            raise TypeError(
                "an Answer holds matrices and communicators, which cannot be pickled or copied deeply; "
                "dataclasses.replace(answer, solved=None) can, and has all results, but no gradients"
            )
        return Answer, tuple(getattr(self, each.name) for each in fields(self))

    @property
    def certified(self) -> bool:
        """Whether the certificate and, if the scene asks for one, the accuracy target are met."""
        return self.summary["converged"]

    @property
    def reason(self) -> str:
        """How the run ended, in words."""
        return self.summary["reason"]

    def derivative(self, key: str) -> Entry | None:
        """The derivatives of the answer by a key of ``output.derivatives``: its entry of the summary, with arrays of
        nodes and bodies, such as ``.contacts["fit"].pressure``; None where they are not precise. Not collective.

        Raises InputError for another key, and where the answer is not certified.
        """
        entries = self.summary.get("derivatives", {})
        if not self.certified:
            raise InputError(
                f"derivative({key!r}): {self.reason}; only a certified answer has derivatives"
            )
        if key not in entries:
            raise InputError(
                f"derivative({key!r}): output.derivatives of the scene does not name it"
                f"{unknown(str(key), entries)}"
            )
        return joined(entries[key], self.derived[key]) if entries[key] else None

    def gradient(self, result: str) -> Entry:
        """The derivatives of one result, such as "contacts.fit.normal_force" or "bodies.shaft.reaction.y", by all keys
        by which the scene can be differentiated, and under "gap" by the gap at every node of each contact.

        It takes one solve for all of them. Collective. Raises InputError for a result that there is not, of load steps,
        and on more ranks than bodies; and SolverError where the equations are not solved precisely.
        """
        if not self.solved or self.summary["ranks"] > len(self.summary["bodies"]):
            raise InputError(
                "gradient: not possible with several ranks a body; start on fewer ranks, or set "
                "output.derivatives"
            )
        if self.solved.assembly.world == MPI.COMM_NULL:
            raise InputError(
                "gradient: a case failed, which closed the model of this answer; ask for gradients before"
            )
        solution = self.solved.solution
        if not solution.certified or not isinstance(solution.outer, Newton):
            raise InputError('gradient: needs a certified answer of outer = "newton"')
        return gradient(self.solved.assembly, solution.outer, solution, str(result))

    def error(self, result: str) -> Entry:
        """The error of a result of ``output.errors`` by the mesh: its entry of the summary, with ``cells``, by body of
        this rank the contributions (nt,) of its cells, whose sum estimates the exact value less this one. Not
        collective. Raises InputError for another result."""
        entries, same = self.summary.get("errors", {}), with_letters(str(result))
        if same not in entries:
            raise InputError(
                f"error({result!r}): output.errors of the scene does not name it"
                f"{unknown(same, entries)}"
            )
        cells = self.solved.errors[same].cells if self.solved else {}
        return Entry(entries[same], cells=cells)

    def to_meshio(self, body: str) -> Any:
        """A body of this rank as a `meshio.Mesh`, see `Fields.to_meshio`. Not collective. Raises InputError for another
        name."""
        if body not in list(self.bodies):
            raise InputError(
                f"to_meshio({body!r}): there is no such body on this rank, or no fields"
                f"{unknown(str(body), self.bodies)}"
            )
        return self.bodies[body].to_meshio()

    def to_pyvista(self, body: str) -> Any:
        """A body of this rank as a `pyvista.UnstructuredGrid`, with the fields of `to_meshio`. Not collective. Raises
        InputError for another name, and where pyvista is not installed."""
        return optional("pyvista", "to_pyvista").wrap(self.to_meshio(body))

    def meshes(self, result: str) -> list[dict[str, Any]]:
        """The meshes of a result of ``method.target``: unknowns, value, bar, word, processor seconds and bytes. Not
        collective. Raises InputError for another result."""
        told, same = table_of(self.summary), with_letters(str(result))
        if same not in told:
            raise InputError(
                f"meshes({result!r}): method.target of the scene does not name it"
                f"{unknown(same, told)}"
            )
        return told[same]["meshes"]

    def __repr__(self) -> str:
        summary, contacts = self.summary, list(self.summary["contacts"])
        lines = [
            f"Answer({summary['title']!r}, certified={self.certified}, reason={self.reason!r})",
            f"largest displacement {summary['displacement_max']:.4g} {summary['units']['length']}"
            + f" at {where(summary, 'displacement_max')}" * (summary["displacement_max"] > 0.0),
        ]
        for name in contacts[:LISTED]:
            lines += describe_contact(summary, name, self.contacts[name].interface.bodies[0])
        if len(contacts) > LISTED:
            lines.append(f"and {len(contacts) - LISTED} more contacts")
        return "\n    ".join(lines)

    def _repr_html_(self) -> str:
        """What a notebook shows: the table of the contacts, and where matplotlib is installed their stresses. Not
        collective."""
        summary, contacts = self.summary, self.contacts
        moved = _amount(summary["displacement_max"], summary["units"]["length"])
        place = where(summary, "displacement_max")
        moved += f" at {place}" * bool(place)
        parts = [
            f"<b>{html.escape(summary['title'] or 'Answer')}</b>: {html.escape(summary['reason'])}; largest "
            f"displacement {moved}",
            _table(summary),
        ]
        parts += [f"<p>Warning: {html.escape(warning)}</p>" for warning in summary["warnings"]]
        if contacts and has_matplotlib():
            image = base64.b64encode(_picture(summary, contacts)).decode("ascii")
            parts.append(
                f'<img alt="stresses of the contacts" src="data:image/png;base64,{image}">'
            )
        return "<div>" + "\n".join(parts) + "</div>"


class Model:
    """A scene that is solved again and again: `ddmpi.prepare`.

    Attributes
    ----------
    reused : what of each body and contact the last solve has taken from those before, as `summary["reused"]`
    """

    def __init__(
        self, scene: str | Path | Mapping[str, Any], comm: MPI.Comm | None = None, keep: bool = True
    ) -> None:
        if not isinstance(comm, MPI.Comm | None) or comm == MPI.COMM_NULL:
            raise InputError(f"comm: expected a communicator of mpi4py (got {comm!r})")
        self._world = in_lockstep(MPI.COMM_WORLD if comm is None else comm)
        in_words = isinstance(scene, Mapping) or "\n" in str(scene)
        self._path = path = "scene" if in_words else str(scene)
        self._given, self._varied = list[Given](), list[Given]()
        with agreed(self._world):
            if isinstance(scene, Mapping):
                scene, self._given = with_names(scene)

        def read() -> dict:
            if not isinstance(scene, str | os.PathLike | Mapping) or scene == "":
                raise InputError(
                    f"scene: expected a path, the text of a scene, or a table (got {scene!r})"
                )
            if not isinstance(scene, Mapping):
                return read_data(path, str(scene) if in_words else read_text(path))
            data = read_data(path, scene)
            if named := refuse_reaching(path, data):
                raise InputError(f"{path}: {code_of(named)}")
            return data

        self._data = from_first(self._world, read)
        self._cases: Cases | None = Cases(self._world, keep)
        self.reused: dict[str, list[str]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free all that is kept. Collective."""
        if self._cases is not None:
            self._cases.end()
        self._cases = None

    def write(self, overrides: Mapping[str, Any], output: str, figures: bool) -> None:
        """Run with these values by key, and write results and pictures into the folder `output`. Collective. Raises what
        `ddmpi.run.run.compute` does."""
        settled, options = self.settle(overrides), RunOptions()
        drawn = figures and settled.output.figures
        options.use(settled.petsc)
        try:
            assert self._cases
            self._cases.compute(settled, self._path, Clock(), output=output, figures=drawn)
        finally:
            options.use({})

    def settle(
        self,
        overrides: Mapping[str, Any] | None = None,
        only: str | None = None,
        outer: str | type | None = None,
    ) -> Settled:
        """The scene with all defaults and these values by key. Collective. Raises InputError."""
        with agreed(self._world):
            if not isinstance(overrides, Mapping | None):
                raise InputError(
                    f"overrides: expected a table of values by key (got {overrides!r})"
                )
            values, self._varied = values_with_names(overrides or {})

        def read() -> Settled:
            data = copy.deepcopy(self._data)
            name = f"{outer.__module__}:{outer.__qualname__}" if isinstance(outer, type) else outer
            given = {
                key: value
                for key, value in (("output.only", only), ("method.outer", name))
                if value is not None
            }
            for key, value in {**values, **given}.items():
                override(data, str(key), as_data(value, "overrides", str(key)), "overrides: ")
            return checked(self._path, data, kind_of_files(self._path))

        return from_first(self._world, read)

    def solve(
        self,
        overrides: Mapping[str, Any] | None = None,
        only: str | None = None,
        start: Answer | None = None,
        progress: bool = False,
        outer: str | type | None = None,
    ) -> Answer:
        """The answer with these values by key, that of a run by itself to the bit. Collective.

        Parameters
        ----------
        overrides, only, progress, outer : as of `ddmpi.solve`; other solves of the model do not see them
        start : an answer from whose contact forces the iteration begins. It then takes fewer steps; where several sets
            of forces are in equilibrium, as in walls of loose bodies, it may end in others, which are certified, too

        Raises
        ------
        InputError, SolverError, InterruptionError
            the same on all ranks. The model can be used further on
        """
        if self._cases is None:
            raise InputError("this model is closed; ddmpi.prepare makes another one")
        if not isinstance(start, Answer | None):
            raise InputError(f"start: expected an answer (got {start!r})")
        world = self._world
        settled = self.settle(overrides, only, outer)
        clock = Clock()
        options = RunOptions()
        motions = start.solved.solution.outer.motions if start and start.solved else None
        begin = (start.contacts, motions) if start else None
        options.use(settled.petsc)
        try:
            with logs.told_by_first(world.rank, progress):
                solved = self._cases.compute(
                    settled,
                    self._path,
                    clock,
                    write=False,
                    start=begin,
                    outer=outer if isinstance(outer, type) else None,
                )
        finally:
            options.use({})
        seconds = clock.largest(world)
        states = merged(world, solved.solution.states if solved else {})
        arrays, none = solved.steps.derived[1] if solved else {}, Entry(contacts={}, bodies={})
        derived = {}
        for key in settled.output.derivatives:
            entry = arrays.get(key, none)
            derived[key] = Entry(contacts=merged(world, entry.contacts), bodies=entry.bodies)
        more = {"started_from": start.summary["run"]} if start else {}
        told = None
        if solved:
            told = solved.summary | {"seconds": seconds} | more, solved.steps.iterations
        summary, iterations = world.bcast(told)
        self.reused = summary["reused"]
        return Answer(
            summary,
            {contact.name: states[contact.name] for contact in settled.contact},
            solved.fields if solved else {},
            solved,
            derived,
            np.array(iterations, RECORD),
        )


def _table(summary: Mapping[str, Any]) -> str:
    rows = [ROWS[f"contacts.NAME.{key}"] for key in COLUMNS]
    heads = "".join(f"<th>{html.escape(row.words)}</th>" for row in rows)
    lines = [f"<tr><th></th>{heads}</tr>"]
    for name, contact in summary["contacts"].items():
        units = [summary["units"].get(row.quantity, row.quantity) for row in rows]
        cells = [
            _amount(contact.get(key), unit) if unit else str(contact[key])
            for key, unit in zip(COLUMNS, units, strict=True)
        ]
        lines.append(
            f"<tr><th>{html.escape(name)}</th>"
            + "".join(f"<td>{cell}</td>" for cell in cells)
            + "</tr>"
        )
    return "<table>" + "\n".join(lines) + "</table>"


def _amount(value: Sequence[float | None] | float | None, unit: str) -> str:
    """A number or a vector with its unit."""
    if value is None:
        return "–"
    values = np.array(value, float)
    factor, unit = scaled_unit(float(np.abs(values).max()), unit)
    words = in_words(values / factor, 4) if values.ndim else f"{values / factor:.4g}"
    return html.escape(f"{words} {unit}")


def _picture(summary: Mapping[str, Any], contacts: Mapping[str, ContactState]) -> bytes:
    """A PNG file of the contacts with the largest forces: in the plane stresses along them, in space pressures."""
    from matplotlib.figure import Figure  # without pyplot: a notebook's own figures are left alone

    shown = sorted(contacts, key=lambda name: -float(np.abs(contacts[name].normal_force).sum()))[
        :NAMED
    ]
    figure = Figure(figsize=(6.4, 2.6 * len(shown)), layout="constrained")
    for place, name in enumerate(shown, 1):
        table, units = contacts[name].table(), summary["units"]
        factor, unit = scaled_unit(
            float(np.nan_to_num(np.abs(table["normal_stress"])).max()), units["stress"]
        )
        if "z" in (table.dtype.names or ()):
            axes = figure.add_subplot(len(shown), 1, place)
            at = np.column_stack([table[axis] for axis in "xyz"])
            at = at - at.mean(axis=0)  # seen from where the contact is widest
            across = at @ np.linalg.svd(at.T @ at)[2][:2].T
            points = axes.scatter(*across.T, c=table["normal_stress"] / factor, s=8)
            figure.colorbar(points, ax=axes, label=f"pressure ({unit})")
            axes.set(aspect="equal", xlabel=f"along the contact ({units['length']})")
        else:
            axes, start = figure.add_subplot(len(shown), 1, place), 0.0
            for chain in chains(table_fields(contacts[name])["facets"]):
                at = table[chain]  # pieces of a contact one after the other
                arc = start + np.append(
                    0.0, np.cumsum(np.hypot(np.diff(at["x"]), np.diff(at["y"])))
                )
                for kind, colour in (("normal", "tab:blue"), ("tangential", "tab:orange")):
                    axes.plot(
                        arc,
                        at[f"{kind}_stress"] / factor,
                        ".-",
                        color=colour,
                        label=None if start else kind,
                    )
                start = arc[-1]
            axes.set(xlabel=f"along the contact ({units['length']})", ylabel=f"stress ({unit})")
            axes.legend()
        axes.set_title(name.replace("$", r"\$"))
    with io.BytesIO() as file:
        figure.savefig(file, format="png")
        return file.getvalue()
