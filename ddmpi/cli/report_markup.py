"""Pieces of a report in HTML: numbers, tables, pictures. All text is escaped."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ddmpi.errors import InputError
from ddmpi.system.numbers import scaled_unit

NOISE = 1e-9
"""Numbers below this part of the largest one of their unit in a table are shown as about zero."""

LONG = 12
"""Tables of more rows are folded."""

TYPES = {".png": "image/png", ".gif": "image/gif"}

Cell = str | float | None


class Html(str):
    """Text that is HTML already."""


@dataclass(frozen=True)
class Column:
    """What a column of a table is, its entries, and their unit: numbers of one unit share a prefix.

    `decimals` of all its numbers, where they are not to have equally many digits.
    """

    head: str
    entries: Sequence[Cell]
    unit: str = ""
    decimals: int | None = None


def text(value: object) -> Html:
    return value if isinstance(value, Html) else Html(html.escape(str(value)))


def element(tag: str, *inside: object, **attributes: str) -> Html:
    """An element with its content; ``kind`` stands for the attribute class."""
    given = "".join(f' {name.replace("kind", "class")}="{text(value)}"' for name, value in attributes.items())
    return Html(f"<{tag}{given}>{''.join(map(text, inside))}</{tag}>")


def number(value: float | None, digits: int = 4, unit: str = "") -> str:
    """A number to so many digits, with its unit; integers as they are, a dash where there is none."""
    if value is None:
        return "–"
    factor, unit = scaled_unit(abs(value), unit)
    value = value / factor if factor != 1.0 else value
    shown = f"{value:.{digits - 1}e}"
    exponent = int(shown.partition("e")[2])
    if isinstance(value, int) or not value:
        shown = str(int(value))
    elif -4 <= exponent < 6:
        shown = f"{value:.{max(0, digits - 1 - exponent)}f}"
    return f"{shown} {unit}" if unit else shown


def percent(value: float | None) -> str:
    return "–" if value is None else f"{number(100 * value, 2)} %"


def table(caption: str, *columns: Column, digits: int = 4) -> Html:
    """A table whose first column names its rows. On narrow screens it scrolls."""
    scales = {}
    for unit in {column.unit for column in columns}:
        found = [abs(entry) for column in columns if column.unit == unit
                 for entry in column.entries if isinstance(entry, int | float)]
        largest = max(found, default=0.0)
        scales[unit] = (*scaled_unit(largest, unit), NOISE * largest if unit else 0.0)
    heads = []
    for column in columns:
        unit = scales[column.unit][1]
        numeric = not any(isinstance(entry, str) for entry in column.entries)
        heads.append(element("th", column.head, element("small", " ", unit) if unit else "", scope="col",
                             **{"kind": "number"} if numeric else {}))
    rows = []
    for entries in zip(*(column.entries for column in columns), strict=True):
        first, *others = (_cell(entry, digits, column.decimals, *scales[column.unit]) for column, entry in
                          zip(columns, entries, strict=True))
        kinds: list[dict[str, str]] = [{} if isinstance(entry, str) else {"kind": "number"} for entry in entries]
        rows.append(element("tr", element("th", first, scope="row", **kinds[0]), *(
            element("td", cell, **kind) for cell, kind in zip(others, kinds[1:], strict=True))))
    whole = element("table", element("thead", element("tr", *heads)), element("tbody", *rows))
    return element("figure", element("figcaption", caption), element(
        "div", whole, kind="wide", role="region", tabindex="0", **{"aria-label": caption}), kind="table")


def _cell(entry: Cell, digits: int, decimals: int | None, factor: float, unit: str, noise: float) -> str:
    if isinstance(entry, str):
        return entry
    if entry is not None and decimals is not None:
        return f"{entry / factor:.{decimals}f}"
    if entry is not None and 0.0 < abs(entry) < noise:
        return "≈ 0"
    return number(entry if entry is None or factor == 1.0 else entry / factor, digits)


def facts(entries: Iterable[tuple[str, object, str]]) -> Html:
    """What, its value, and a remark on it, of each, in boxes."""
    return element("dl", *(element("div", element("dt", what), element("dd", value),
                                   element("dd", remark, kind="remark") if remark else "")
                           for what, value, remark in entries), kind="facts")


def pairs(entries: Iterable[tuple[str, object]]) -> Html:
    """What and its value, of each, on a line."""
    return element("dl", *(element("div", element("dt", what), element("dd", value)) for what, value in entries),
                   kind="pairs")


def noted(entries: Iterable[object]) -> Html:
    """A list of what is to be noticed."""
    return element("ul", *(element("li", entry) for entry in entries), kind="note")


def code(content: str) -> Html:
    return element("code", content)


def folded(summary: str, *inside: object) -> Html:
    """Content that is unfolded by its summary, and on paper."""
    return element("details", element("summary", summary), *inside)


def folded_if_long(summary: str, rows: int, content: Html) -> Html:
    """A table of so many rows that not every reader wants."""
    return folded(f"{summary} ({rows})", content) if rows > LONG else content


def section(name: str, title: str, *inside: object) -> Html:
    return element("section", element("h2", title), *inside, id=name)


def scene_section(toml: str, words: str) -> Html:
    return section("scene", "Scene", element("p", words), folded("The scene as TOML", element("pre", code(toml))))


def picture(path: Path, caption: str, alt: str, kind: str = "picture") -> Html:
    """A picture within the page. Raises InputError where it cannot be read."""
    try:
        data = base64.b64encode(path.read_bytes()).decode()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    image = f'<img src="data:{TYPES[path.suffix]};base64,{data}" alt="{text(alt)}">'
    return element("figure", Html(image), element("figcaption", caption), kind=kind)
