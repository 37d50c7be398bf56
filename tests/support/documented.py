"""What docs/reference/results.md says that results hold."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "results.md"

NAMES = {
    section.partition("\n")[0]: re.findall(r"^\| `(.+?)` \|", section, re.MULTILINE)
    for section in PAGE.read_text(encoding="utf-8").removeprefix("# ").split("\n## ")
}
"""By the heading of a section what its table has: files, or columns of a file, or entries of the summary."""

FILES, SUMMARY = NAMES["Files of results"], NAMES["summary.json"]

CONTACT = re.compile(r"contact_.+?((?:_sides|_legs)?\.csv|\.png|\.vtu)")

PARTS = {
    "bodies": "NAME",
    "contacts": "NAME",
    "rigid": "NAME",
    "bodies.NAME.loads": "GROUP",
    "bodies.NAME.reactions": "GROUP",
    "bodies.NAME.points": "POINT",
    "errors": "RESULT",
    "derivatives": "KEY",
    **dict.fromkeys(
        (f"derivatives.KEY.{part}" for part in ("contacts", "bodies", "rigid")), "NAME"
    ),
}
"""What stands for the names in tables by name."""


def undocumented(folder: Path) -> list[str]:
    """Files in a folder of results that the page does not know."""
    return sorted(
        path.name
        for path in folder.iterdir()
        if CONTACT.sub(r"contact_NAME\1", path.name) not in FILES
    )


def entries(value: Any, path: str = "") -> Iterator[str]:
    """The names of a summary's entries, as the page has them, with NAME for those of bodies and contacts, and GROUP."""
    if path in SUMMARY or not isinstance(value, dict):
        yield path
        return
    for name, entry in value.items():
        part = PARTS.get(path, name)
        yield from entries(entry, f"{path}.{part}" if path else part)
