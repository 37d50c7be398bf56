"""All pictures of a run, drawn from its files only."""

import functools
import itertools
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ddmpi.errors import InputError
from ddmpi.pictures.bodies import animate, draw_bodies, draw_error, draw_mechanism, draw_shares
from ddmpi.pictures.sheet import STYLE, save, start_drawing
from ddmpi.results.histories import at_step, placed
from ddmpi.results.tables import Results, read_results, reading
from ddmpi.scene.mistakes import explain
from ddmpi.scene.output import Output
from ddmpi.system.files import MECHANISM, contact_files, writing
from ddmpi.system.provenance import identity

EACH = 6  # largest number of contacts with separate pictures; more contacts share one
Pictures = Iterator[tuple[str, Callable[[], Any]]]
"""File names of pictures and the functions that draw their figures."""


def draw_all(
    folder: str | Path,
    number: int = 0,
    drawers: int = 1,
    time: float | None = None,
    into: Path | None = None,
    **asked: Any,
) -> list[Path]:
    """Draw all pictures of the results in `folder` into it, or this process's share of several `drawers`; their paths.

    Pictures of bodies and contacts show the load step at `time`, by default as `at_step` chooses it. `into` is another
    folder for the pictures, without the animation. `asked`, such as a view, replaces keys of the scene's table
    `output`. Without equilibrium there is mechanism.png alone, unless a `time` is given.

    Not collective. Raises InputError without results or matplotlib, where results of an earlier version lack what
    pictures need, or what is asked for is wrong; OutputError if a picture cannot be written.
    """
    with reading(folder):
        plt = start_drawing()
        folder, last, drawn = Path(folder), read_results(folder), []
        if last.surfaces.keys() != last.contacts.keys():
            version = last.summary.get("versions", {}).get("ddmpi", "of unknown number")
            raise InputError(
                f"{folder}: ddmpi {version} wrote these results without what this version draws pictures "
                "from; draw them with that version, or run the scene again"
            )
        _ask(last, asked)
        results, last = placed(at_step(last, folder, time)), placed(last)
        with plt.rc_context(STYLE):
            mechanism = None if time is not None else folder / MECHANISM
            figures = pictures_of(results, last, mechanism, folder)
            for name, draw in itertools.islice(figures, number, None, drawers):
                figure = draw()
                drawn.append((into or folder) / name)
                try:
                    with writing(drawn[-1]):
                        drawn[-1].unlink(missing_ok=True)  # it may be a link
                        save(figure, drawn[-1], identity(results.summary))
                finally:
                    plt.close(figure)
            animated = not into and number == drawers - 1 and results.output.get("animation")
            if animated and len(results.energy.get("time", ())):
                drawn.append(animate(results, folder, results.heading()))
        return drawn


def _ask(results: Results, asked: dict[str, Any]) -> None:
    """Put options that are not None into the scene of the summary. Raises InputError for invalid ones."""
    new = {key: value for key, value in asked.items() if value is not None}
    try:
        msgspec.convert(new, Output)
    except msgspec.ValidationError as error:
        raise InputError(f"--{explain(str(error), new, Output)}") from None
    results.output.update(new)


def pictures_of(
    results: Results, last: Results, mechanism: Path | None = None, folder: Path | None = None
) -> Pictures:
    """The pictures, the longest work first; errors are of the `last` step. A file of a `mechanism` is shown alone. With
    load steps in a `folder` colours have the ends of all."""
    from ddmpi.pictures.contacts import draw_contacts, draw_maps  # they need matplotlib
    from ddmpi.pictures.curves import draw_contact, draw_convergence, draw_steps
    from ddmpi.pictures.levels import draw_levels, has_levels

    if mechanism and mechanism.exists():
        yield (
            "mechanism.png",
            lambda: draw_mechanism(last, json.loads(mechanism.read_text(encoding="utf-8"))),
        )
        return
    yield "bodies.png", lambda: draw_bodies(results, folder)
    yield "convergence.png", lambda: draw_convergence(results)
    if has_levels(last.summary):
        yield "accuracy.png", lambda: draw_levels(last)
    several = len(results.contacts) > 1
    if several:
        yield "contacts.png", lambda: draw_contacts(results)
    contact = draw_contact if results.dimension == 2 else draw_maps
    for name, table in results.contacts.items() if len(results.contacts) <= EACH else ():
        if np.isnan(table["normal_stress"]).all():  # the bodies meet at nodes only
            continue
        yield (
            contact_files(name).picture if several else "contact.png",
            functools.partial(contact, results, name),
        )
    if len(results.energy.get("time", ())):
        yield "steps.png", lambda: draw_steps(results)
    if "error" in results.fields:
        yield "error.png", lambda: draw_error(last)
    if "error_share" in last.fields:
        yield "errors.png", lambda: draw_shares(last)
