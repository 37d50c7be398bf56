"""What the studies share: tables that outlive interruptions, pages, figures, arguments."""

from __future__ import annotations

import argparse
import csv
import functools
import gc
import inspect
import math
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from mpi4py import MPI

ROOT = Path(__file__).resolve().parents[1]
TABLES = ROOT / "docs" / "tables"
TABLE = r"(?:^\|.*\n)+"
"""The lines of a table in a page."""

sys.path.append(str(ROOT / "tests" / "support"))  # whose helpers the studies use as well
Row = dict


# Tables that outlive interruptions


class Ledger:
    """Rows in a CSV file, each written as soon as it is known; a study that is started again keeps them.

    All ranks hold the same rows; rank 0 writes.

    Parameters
    ----------
    path : the file
    key : the first columns, which tell rows apart
    others : the other columns
    """

    def __init__(
        self, world: MPI.Comm, path: Path, key: tuple[str, ...], others: tuple[str, ...]
    ) -> None:
        self.world, self.path, self.key, self.columns = world, path, key, (*key, *others)
        self.rows: list[Row] = []
        error = None
        if world.rank == 0:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():
                with open(path, newline="", encoding="utf-8") as file:
                    header, *lines = list(csv.reader(file)) or [[]]
                if tuple(header) != self.columns:
                    error = f"{path} has other columns than this script writes; move it away"
                # The last one may be torn.
                complete = [line for line in lines if len(line) == len(self.columns)]
                self.rows = [
                    dict(zip(self.columns, map(_value, line), strict=True)) for line in complete
                ]
        error = world.bcast(error)
        if error:
            sys.exit(error if world.rank == 0 else 1)
        self.rows = world.bcast(self.rows)
        if world.rank == 0:
            with open(path, "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, self.columns)
                writer.writeheader()
                writer.writerows(self.rows)

    def fill(self, keys: Iterable[tuple], measure: Callable[..., Row]) -> list[Row]:
        """Add a row for every key that has none, with a progress bar on stderr; returns all rows. Collective.

        ``measure(*key)`` returns the entries of the other columns; entries that are no columns are left out.
        """
        known = {tuple(row[name] for name in self.key) for row in self.rows}
        for key in self._progress([key for key in keys if tuple(key) not in known]):
            found = measure(*key) | dict(zip(self.key, key, strict=True))
            row = {name: found[name] for name in self.columns}
            self.rows.append(row)
            if self.world.rank == 0:
                with open(self.path, "a", newline="", encoding="utf-8") as file:
                    csv.DictWriter(file, self.columns).writerow(row)
        return self.rows

    def _progress(self, work: list[tuple]) -> Iterator[tuple]:
        start = time.perf_counter()
        for done, item in enumerate([*work, None]):
            if self.world.rank == 0 and work:
                spent = time.perf_counter() - start
                left = (
                    f", {spent / done * (len(work) - done):.0f} s left"
                    if 0 < done < len(work)
                    else ""
                )
                bar, words = "#" * (30 * done // len(work)), " ".join(map(str, item or ()))
                print(
                    f"\r{self.path.stem} [{bar:30}] {done}/{len(work)}  {spent:.0f} s{left}  {words:40.40}",
                    end="" if item else "\n",
                    file=sys.stderr,
                    flush=True,
                )
            if item:
                yield item


def _value(text: str) -> int | float | bool | str:
    if text in ("True", "False"):
        return text == "True"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def where(rows: Iterable[Row], **values) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


# Pages and figures


def table(header: Iterable, rows: Iterable[Iterable]) -> list[str]:
    """A table as lines of Markdown, with an empty one after it."""
    header = list(header)
    return [_line(header), "|---" * len(header) + "|", *map(_line, rows), ""]


def _line(cells: Iterable) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def number(value: float, form: str = ".0e") -> str:
    """For a cell of a table, which is empty where there is no number."""
    return (
        "–"
        if not math.isfinite(value)
        else "0"
        if value == 0 and form.endswith("e")
        else format(value, form)
    )


def processor() -> str:
    """The name of this machine's processor, for a page (Linux)."""
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        named = [line.split(":")[1].strip() for line in file if line.startswith("model name")]
    return re.sub(" +", " ", named[0]) if named else platform.processor()


def publish(
    name: str,
    tables: Mapping[str, list[str]],
    folder: Path,
    complete: bool = True,
    facts: Mapping[str, str] | None = None,
    draw: Callable[[Path], None] | None = None,
) -> None:
    """Write a page of docs/tables/, whose words stand there alone, with new tables to `folder`, and back if the study
    is complete.

    Parameters
    ----------
    tables : lines of those below each heading, in their order; "" is what stands above the first heading
    complete : else the page has no sections but those of the `tables`, new ones at its end
    facts : patterns in the words, and what stands there now
    draw : draws figures into a folder beside the page
    """
    first, *sections = re.split(r"^## ", (TABLES / name).read_text(encoding="utf-8"), flags=re.M)
    parts = {"": first} | {section.partition("\n")[0]: f"## {section}" for section in sections}
    for title, lines in tables.items():
        if lines[0].startswith("### ") and title in parts:  # with headings of their own
            parts[title] = "\n".join([re.split("\n### ", parts[title], maxsplit=1)[0], *lines, ""])
            continue
        if title not in parts and not complete:
            parts[title] = "\n".join([f"## {title}", "", *lines, ""])
            continue
        old, new = (
            re.findall(TABLE, text, re.M)
            for text in (parts.get(title, ""), "\n".join([*lines, ""]))
        )
        if len(old) != len(new):
            sys.exit(
                f"docs/tables/{name} wants a section '{title}' with {len(new)} tables, which a study fills in"
            )
        for before, now in zip(old, new, strict=True):
            parts[title] = parts[title].replace(before, now, 1)
    text = "".join(
        part for title, part in parts.items() if complete or not title or title in tables
    )
    for pattern, fact in (facts or {}).items():
        text = re.sub(pattern, lambda _, fact=fact: fact, text)
    folder.mkdir(parents=True, exist_ok=True)
    for place in [folder, TABLES] if complete else [folder]:
        (place / name).write_text(text, encoding="utf-8")
        if draw:
            draw(place / "figures")


def save_figures(folder: Path, figures: dict[str, Callable], **options) -> None:
    """Draw and write figures, by name, in the style of the program's pictures; options are those of savefig."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from ddmpi.pictures.sheet import STYLE

    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(
        STYLE | {"axes.grid": True, "axes.grid.which": "major", "grid.color": "#e3e3e3"}
    ):
        for name, draw in figures.items():
            figure = draw()
            figure.savefig(folder / f"{name}.png", bbox_inches="tight", **options)
            plt.close(figure)


# Commands


def arguments(description: str | None, name: str = "") -> argparse.ArgumentParser:
    """A parser; with the option --output, by default results/NAME, for a study that writes files."""
    parser = argparse.ArgumentParser(
        description=inspect.cleandoc(description or ""),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if name:
        parser.add_argument("--output", type=Path, default=Path("results") / name, metavar="DIR")
    return parser


def on_two_ranks(main: Callable[[MPI.Comm], None]) -> Callable[[], None]:
    """Decorator for a script's main(world) that refuses other numbers of ranks and frees PETSc's objects at the end."""

    @functools.wraps(main)
    def guarded() -> None:
        world = MPI.COMM_WORLD
        if world.size != 2:
            sys.exit(f"two ranks, please: scripts/study {Path(sys.argv[0]).stem} starts them")
        main(world)
        gc.collect()
        done = world.Ibarrier()
        while not done.Test():  # at the end of MPI one rank would spin while the other one draws
            time.sleep(0.05)

    return guarded
