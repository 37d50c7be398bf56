#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The reference pages in docs/reference/, from the code: types, docstrings and arguments say what there is.

    scripts/study reference [FOLDER]

writes scene.md and scene.schema.json (from ddmpi/scene/), commands.md (ddmpi/cli/ and ddmpi/errors.py) and python.md.
tests/scripts/test_reference.py fails where the committed pages are not these. What stands above the first heading of a
page is written by hand there, and so is results.md.
"""

import argparse
import inspect
import json
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from experiment import ROOT, table

import ddmpi.interface.state
import ddmpi.published.apg
import ddmpi.published.mprgp
from ddmpi import errors
from ddmpi.cli.arguments import build_parser
from ddmpi.run import answer
from ddmpi.scene.formulas import FUNCTIONS
from ddmpi.scene.method import PRESETS
from ddmpi.scene.scene import Scene
from ddmpi.scene.schema import json_schema, meanings, read_docstring

PAGES = ROOT / "docs" / "reference"

HIDDEN = ("__repr__", "_repr_html_", "placed", "along", "count")
"""Methods of answers that the page of Python leaves out."""

HEADINGS = {
    "Scene": "A scene",
    "BodySpec": "[[body]]",
    "Copy": "copy",
    "MeshSpec": "mesh",
    "Motion": "motion",
    "Material": "material",
    "PartMaterial": "material of a part",
    "Clamp": "clamp",
    "Foundation": "foundation",
    "Traction": "traction",
    "VolumeForce": "volume_force",
    "Heat": "temperature",
    "AffineVector": "vector with slopes",
    "AffineScalar": "number with slopes",
    "ContactSpec": "[[contact]]",
    "Coulomb": "friction by Coulomb",
    "Tresca": "friction by Tresca",
    "NoFriction": "no friction",
    "Profile": "profile",
    "SignedProfile": "signed profile",
    "Varying": "varying number",
    "Gap": "gap",
    "Closure": "softness",
    "Pretension": "pretension",
    "Image": "image",
    "Plane": "[[rigid]]: a plane",
    "Circle": "[[rigid]]: a circle",
    "Sphere": "[[rigid]]: a sphere",
    "Cylinder": "[[rigid]]: a cylinder",
    "Node": "[[rigid]]: a node",
    "History": "[history.NAME]",
    "Time": "[time]",
    "Cycle": "cycle of load steps",
    "Method": "[method]",
    "Within": "target of a result",
    "Output": "[output]",
    "Cut": "cut",
    "Checkpoint": "[checkpoint]",
}
"""The tables of a scene in the order of the page."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, default=PAGES)
    target = parser.parse_args().folder
    target.mkdir(parents=True, exist_ok=True)
    schema = json_schema(Scene)
    pages = {
        "scene.md": scene_page(schema),
        "commands.md": commands_page(),
        "python.md": python_page(),
        "scene.schema.json": json.dumps(schema, indent=1, ensure_ascii=False),
    }
    for name, text in pages.items():
        (target / name).write_text(text.rstrip() + "\n", encoding="utf-8")


def by_hand(name: str) -> str:
    """What stands above the first heading of a page."""
    return (
        re.split(r"^## ", (PAGES / name).read_text(encoding="utf-8"), maxsplit=1, flags=re.M)[
            0
        ].rstrip()
        + "\n"
    )


# Scenes


def scene_page(schema: Mapping) -> str:
    tables = schema["$defs"]
    missing = tables.keys() ^ HEADINGS.keys()
    if missing:
        sys.exit(f"HEADINGS and the types of a scene differ in {', '.join(missing)}")
    lines = [by_hand("scene.md")]
    for name, heading in HEADINGS.items():
        lines += [f"## {heading}", "", _linked(tables[name]["description"]), ""]
        rows = [
            (
                f"`{key}`",
                _type(value),
                _default(value, key in tables[name]["required"]),
                _linked(value.get("description", "chooses this table")),
            )
            for key, value in tables[name]["properties"].items()
        ]
        lines += table(("key", "takes", "default", "meaning"), rows)
        if name == "Method":
            lines += [
                "Presets fill in what a scene leaves out ([accuracy.md](../use/accuracy.md)):",
                "",
            ]
            keys = list(dict.fromkeys(key for preset in PRESETS.values() for key in preset))
            lines += table(
                ("preset", *keys),
                (
                    [f"`{preset}`", *(values.get(key, "–") for key in keys)]
                    for preset, values in PRESETS.items()
                ),
            )
    lines += [
        "## formula",
        "",
        "Numbers, `x`, `y`, in space `z`, `pi`, `+ - * / **`, the comparisons `< <= > >=` (1 where they hold,",
        f"else 0), brackets, and the functions `{' '.join(name for name in FUNCTIONS if name != 'where')}`",
        "(angles in radians) and `where(condition, one, other)`; see [loads.md](../use/loads.md).",
    ]
    return "\n".join(lines)


def _default(value: Mapping, required: bool) -> str:
    if required:
        return "**needed**"
    return f"`{json.dumps(value['default'])}`" if value.get("default", "") != "" else ""


def _type(node: Mapping) -> str:
    """What a key takes, in words."""
    match node:
        case {"$ref": path}:
            heading = HEADINGS[path.rpartition("/")[2]]
            return (
                f"[{heading.translate(str.maketrans({'[': None, ']': None}))}](#{_anchor(heading)})"
            )
        case {"allOf": [one]}:
            return _type(one)
        case {"anyOf": kinds}:
            return " or ".join(map(_type, kinds))
        case {"enum": values}:
            return ", ".join(f"`{json.dumps(value)}`" for value in values)
        case {"type": "array", "minItems": low, "maxItems": high} if low == high:
            return "[" + ", ".join([_type(node["items"])] * low) + "]"
        case {"type": "array", "minItems": low, "maxItems": high}:
            return f"list of {low} or {high}: {_type(node['items'])}"
        case {"type": "array"}:
            return f"list of {_type(node['items'])}"
        case {"type": "object"}:
            return f"{_type(node['additionalProperties'])} by name"
        case {"type": "string"}:
            title = node.get("title", "text")
            return "[formula](#formula)" if title == "formula" else title
        case {"type": "boolean"}:
            return "`true`, `false`"
        case {"type": "integer" | "number" as kind}:
            signs = {
                "exclusiveMinimum": ">",
                "minimum": "≥",
                "exclusiveMaximum": "<",
                "maximum": "≤",
            }
            limits = [f"{sign} {node[limit]:g}" for limit, sign in signs.items() if limit in node]
            return f"{'whole ' * (kind == 'integer')}number {' and '.join(limits)}".strip()
    raise TypeError(f"no words for {node}")


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w\s-]", "", heading).strip().lower().replace(" ", "-")


def _coded(meanings: Mapping[str, str]) -> Iterable[tuple[str, str]]:
    return ((f"`{name}`", _linked(meaning)) for name, meaning in meanings.items())


def _linked(text: str) -> str:
    """Text with pages of docs/ as links, for a cell of a table."""
    return re.sub(r"docs/(\w+/)(\w+\.md)", r"[\2](../\1\2)", text).replace("|", "\\|")


# Commands


def commands_page() -> str:
    commands = next(
        action
        for action in build_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    helps = {each.dest: each.help for each in commands._choices_actions}
    lines = [by_hand("commands.md")]
    for name, parser in commands.choices.items():
        lines += [f"## {name}", "", f"{helps[name][0].upper()}{helps[name][1:]}.", ""]
        rows = [
            (f"`{_call(action)}`", _linked(action.help or ""))
            for action in parser._actions
            if not isinstance(action, argparse._HelpAction)
        ]
        lines += table(("argument", "meaning"), rows) if rows else []
    codes: dict[int, str] = {}
    for kind in vars(errors).values():
        if (
            isinstance(kind, type)
            and issubclass(kind, errors.DdmpiError)
            and kind is not errors.DdmpiError
        ):
            codes.setdefault(kind.exit_code, read_docstring(kind.__doc__)[0].split("\n\n")[0])
    lines += [
        "## Exit codes",
        "",
        *table(
            ("code", "meaning"),
            [
                (0, "Certified answer."),
                *((code, " ".join(words.split())) for code, words in codes.items()),
                (
                    "other",
                    "A bug (1, with a traceback), or what the system or mpirun says of a killed process.",
                ),
            ],
        ),
    ]
    return "\n".join(lines)


def _call(action: argparse.Action) -> str:
    if not action.option_strings:
        return str(action.metavar)
    return " ".join(
        [action.option_strings[-1], *([str(action.metavar)] if action.nargs != 0 else [])]
    )


# Python


def python_page() -> str:
    lines = [by_hand("python.md")]
    for name, function in (
        ("ddmpi.solve", ddmpi.solve),
        ("ddmpi.converge", ddmpi.converge),
        ("ddmpi.prepare", ddmpi.prepare),
        ("Model.solve", answer.Model.solve),
        ("ddmpi.to_xarray", ddmpi.to_xarray),
    ):
        lines += [f"## {name}{_signature(function)}", "", *_described(function)]
    for heading, kind in {
        "Answer": answer.Answer,
        "Fields": answer.Fields,
        "ContactState": ddmpi.interface.state.ContactState,
    }.items():
        words, rows = read_docstring(kind.__doc__)[0], dict(meanings(kind))
        for name, value in vars(kind).items():
            if isinstance(value, property):
                first = " ".join(
                    inspect.cleandoc(value.__doc__ or "").split("\n\n")[0].split()
                ).rstrip(".")
                rows[name] = first[:1].lower() + first[1:]
        lines += [
            f"## {heading}",
            "",
            words,
            "",
            *table(("attribute", "meaning"), _coded(rows)),
            "",
        ]
        for name, value in vars(kind).items():
            if inspect.isfunction(value) and name not in HIDDEN and value.__doc__:
                lines += [f"### {heading}.{name}{_signature(value)}", "", *_described(value)]
    for kind, room in (
        ("ddmpi.mprgp.MPRGP", ddmpi.published.mprgp),
        ("ddmpi.apg.APG", ddmpi.published.apg),
    ):
        lines += [
            f"## {kind}",
            "",
            *_described(getattr(room, kind.split(".")[-1])),
            inspect.cleandoc(room.__doc__),
            "",
        ]
    return "\n".join(lines)


def _signature(function: Any) -> str:
    parameters = inspect.signature(function).parameters.values()
    parameters = [each for each in parameters if each.name != "self"]
    return (
        "("
        + ", ".join(
            each.name if each.default is each.empty else f"{each.name}={each.default}"
            for each in parameters
        )
        + ")"
    )


def _described(subject: Any) -> list[str]:
    """The docstring of a function or class as Markdown."""
    words, sections = read_docstring(subject.__doc__)
    lines = [words, ""]
    for title, entries in sections.items():
        lines += [
            f"**{title}**",
            "",
            *(
                f"- {names if ' ' in names and not meaning else f'`{names}`'}{': ' * bool(meaning)}{meaning}"
                for names, meaning in entries.items()
            ),
            "",
        ]
    return lines


if __name__ == "__main__":
    main()
