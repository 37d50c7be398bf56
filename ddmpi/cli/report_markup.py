"""Pieces of a report in HTML: numbers, tables, pictures, and the template that holds them. All text is escaped."""

import base64
import html
import re
import string
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from ddmpi import __version__
from ddmpi.pictures.script import digest, our_digest
from ddmpi.system.numbers import ALIKE, scaled_unit

LONG = 12
"""Minor tables of more rows are folded."""

TYPES = {".png": "image/png", ".gif": "image/gif"}

BEGINNINGS = (b"\x89PNG", b"GIF8")
"""First bytes of these pictures."""

CONTACT = (
    "Contact NAME: normal and tangential stress with the slip bound, gap and slip, and zones of open, slipping "
    "and sticking nodes.",
    "Contact NAME, laid flat: pressure, zones of open, slipping and sticking nodes, friction with the slip as "
    "arrows, and the gap or slip; circles mark the largest values.",
)

CAPTIONS = {
    "bodies.png": (
        "The deformed bodies with von Mises stress, else displacement; grey outlines are undeformed, and "
        "closed contacts are drawn closed.",
    )
    * 2,
    "contacts.png": (
        "Contact pressures as areas on the undeformed bodies, resultants, and zones of open, slipping and "
        "sticking nodes.",
        "The bodies drawn apart, with the pressure painted on either side of each contact. Arrows are the "
        "resultants on the first body of each.",
    ),
    "contact.png": (CONTACT[0].replace(" NAME", ""), CONTACT[1].replace(" NAME", "")),
    "contact_NAME.png": CONTACT,
    "steps.png": (
        "Forces, energies and contact stresses over the load steps.",
        "Forces, energies and numbers of open, slipping and sticking nodes over the load steps.",
    ),
    "error.png": ("Where the mesh is coarse: the estimated discretization error of each cell.",)
    * 2,
    "errors.png": (
        "Where the errors of results are made: the parts of each cell in their bars, over the mean.",
    )
    * 2,
    "accuracy.png": (
        "Error bars over values on each mesh, and what they have taken. Open circles are forecasts of half the bars, dashed "
        "lines what is asked for.",
    )
    * 2,
    "animation.gif": ("The load steps, one after the other.",) * 2,
}
"""What pictures show, in the plane and in space."""

Cell = str | float | None


class Html(str):
    """Text that is HTML already."""


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, entries, and unit; numbers of one unit share a prefix.

    With `decimals`, all numbers have so many; without, equally many digits.
    """

    head: str
    entries: Sequence[Cell]
    unit: str = ""
    decimals: int | None = None


def fill(values: Mapping[str, object], without: Collection[str] = ()) -> str:
    """The template with its $names replaced, and `without` the sections of these ids.

    Lines and sections that have names, but none with a value, are left out as well.
    """
    template = resources.files("ddmpi.cli").joinpath("report.html").read_text(encoding="utf-8")
    given = {"version": Html(__version__), "policy": Html(" ")} | {
        name: text(value) for name, value in values.items() if value not in (None, "")
    }

    def wanted(section: re.Match[str]) -> str:
        known = given.keys() & re.findall(r"\$(\w+)", section[0])
        return section[0] if known and section["id"] not in without else ""

    template = re.sub(
        r'<section id="(?P<id>\w+)">.*?</section>\n', wanted, template, flags=re.DOTALL
    )
    return string.Template(re.sub(r"(?P<id>).*\$.*\n", wanted, template)).substitute(
        defaultdict(str, given)
    )


def text(value: object) -> Html:
    return value if isinstance(value, Html) else Html(html.escape(str(value)))


def element(tag: str, *inside: object, **attributes: str) -> Html:
    """An element with its content; ``kind`` stands for the attribute class."""
    given = "".join(
        f' {name.replace("kind", "class")}="{text(value)}"' for name, value in attributes.items()
    )
    return Html(f"<{tag}{given}>{''.join(map(text, inside))}</{tag}>")


def number(value: float | None, digits: int = 4, unit: str = "") -> str:
    """A number to so many digits, with its unit; an integer unchanged, a dash for None."""
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


def table(caption: str, *columns: Column, digits: int = 4, minor: bool = False) -> Html:
    """A table whose first column names its rows. On narrow screens it scrolls; a long one that is `minor` is folded."""
    largest = defaultdict[str, float](float)
    for column in columns:
        sizes = [abs(entry) for entry in column.entries if isinstance(entry, int | float)]
        largest[column.unit] = max([largest[column.unit], *sizes])
    heads: list[Html] = []
    cells: list[list[Html]] = []
    for column in columns:
        factor, unit = scaled_unit(largest[column.unit], column.unit)
        noise = ALIKE * largest[column.unit] if unit else 0.0  # smaller ones are about zero
        small = element("small", " ", unit) if unit else ""
        words = any(isinstance(entry, str) for entry in column.entries)
        heads.append(element("th", column.head, small, scope="col", **_number_unless(words)))
        tag, named = ("td", {}) if cells else ("th", {"scope": "row"})
        made = list[Html]()
        for entry in column.entries:
            shown = _cell(entry, digits, column.decimals, factor, noise)
            made.append(element(tag, shown, **named, **_number_unless(isinstance(entry, str))))
        cells.append(made)
    rows = [element("tr", *row) for row in zip(*cells, strict=True)]
    whole = element("table", element("thead", element("tr", *heads)), element("tbody", *rows))
    figure = element(
        "figure",
        element("figcaption", caption),
        element("div", whole, kind="wide", role="region", tabindex="0", **{"aria-label": caption}),
        kind="table",
    )
    if minor and len(rows) > LONG:
        return element("details", element("summary", f"{caption} ({len(rows)})"), figure)
    return figure


def _number_unless(words: bool) -> dict[str, str]:
    """The attribute of cells that are set as numbers."""
    return {} if words else {"kind": "number"}


def _cell(entry: Cell, digits: int, decimals: int | None, factor: float, noise: float) -> str:
    if isinstance(entry, str):
        return entry
    if entry is not None and decimals is not None:
        return f"{entry / factor:.{decimals}f}"
    if entry is not None and 0.0 < abs(entry) < noise:
        return "≈ 0"
    return number(entry if entry is None or factor == 1.0 else entry / factor, digits)


def noted(entries: Sequence[object]) -> Html | str:
    """A list of notes, if there are any."""
    return (
        element("ul", *(element("li", entry) for entry in entries), kind="note") if entries else ""
    )


def page(path: Path, caption: str) -> Html:
    """A view within the page, if its file exists, in a frame of its own origin, which reaches neither the page nor a
    network; the only script that runs is that of the views of this version."""
    if not lies_there(path):
        return Html("")
    view = path.read_text(encoding="utf-8")
    if digest(view) != our_digest():
        caption = (
            "Another version of ddmpi, or somebody else, wrote this view, so it stands still here; "
            "python -m ddmpi view writes it anew."
        )
    frame = element("iframe", srcdoc=view, sandbox="allow-scripts", title=caption, loading="lazy")
    return element("figure", frame, element("figcaption", caption))


def lies_there(path: Path) -> bool:
    """Whether a file lies in the folder itself: a link may lead to any file, which a report would hand on."""
    return path.is_file() and path.resolve().parent == path.parent.resolve()


def picture(path: Path, caption: str, kind: str = "picture") -> Html:
    """A picture within the page, if its file exists."""
    if not lies_there(path) or not (content := path.read_bytes()).startswith(BEGINNINGS):
        return Html("")
    data = base64.b64encode(content).decode()
    image = f'<img src="data:{TYPES[path.suffix]};base64,{data}" alt="{text(caption)}">'
    return element("figure", Html(image), element("figcaption", caption), kind=kind)
