"""The JSON schema of a scene, for editors; its descriptions are those of the types' docstrings."""

from __future__ import annotations

import inspect
import itertools
import re
from typing import Any

import msgspec

from ddmpi.scene.scene import Scene
from ddmpi.scene.values import LARGEST, Formula, Group, Name, Table

DIALECT = "http://json-schema.org/draft-07/schema#"
"""The editors' tools know little of later ones."""

TITLES = {"name": Name, "group": Group, "formula": Formula}
"""What words are called that a scene's author chooses."""


def read_docstring(text: str | None) -> tuple[str, dict[str, dict[str, str]]]:
    """The words of a numpydoc docstring, and by title its sections: what each name, or row of names, means."""
    words, *parts = re.split(r"^(\w+)\n-{3,}\n", inspect.cleandoc(text or ""), flags=re.MULTILINE)
    entry = re.compile(r"^(\S.*?)(?: : |\n[ ]+|\n|\Z)((?:.*\n?(?:[ ]+.*\n?)*))", re.MULTILINE)
    return words.strip(), {title: {names: " ".join(meaning.split()) for names, meaning in entry.findall(part)}
                           for title, part in zip(parts[::2], parts[1::2], strict=True)}


def meanings(kind: type) -> dict[str, str]:
    """What the docstrings of a class and those that it inherits from say of its attributes, by name."""
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        for names, meaning in read_docstring(vars(each).get("__doc__"))[1].get("Attributes", {}).items():
            found |= dict.fromkeys(names.split(", "), meaning)
    return found


def scene_schema() -> dict[str, Any]:
    """The JSON schema of a scene, as a user writes it: keys, types, limits, defaults and what they mean."""
    schema = msgspec.json.schema(Scene)
    titles = [(msgspec.json.schema(kind), {"type": "string", "title": title}) for title, kind in TITLES.items()]
    tables = {kind.__name__: kind for kind in _below(Table)}
    definitions = {}
    for name, definition in schema["$defs"].items():
        definitions[name] = table = _tidy(definition, titles)
        table.pop("title")
        table["description"] = _plain(read_docstring(tables[name].__doc__)[0])
        for key, meaning in meanings(tables[name]).items():
            # beside a reference, other entries would not be looked at
            value = table["properties"][key]
            table["properties"][key] = ({"allOf": [value]} if "$ref" in value else value) | {
                "description": _plain(meaning)}
    return {"$schema": DIALECT, "title": "scene of ddmpi", **schema, "$defs": definitions}


def _below(kind: type) -> list[type]:
    return [kind, *itertools.chain.from_iterable(map(_below, kind.__subclasses__()))]


def _plain(text: str) -> str:
    """The text without the marks of code."""
    return " ".join(text.replace("``", "").split())


def _tidy(node: Any, titles: list[tuple[dict, dict]]) -> Any:
    """A part of the schema in terms of DIALECT, without what TOML cannot write: null, numbers that are not finite."""
    if isinstance(node, list | tuple):
        return [_tidy(each, titles) for each in node]
    if not isinstance(node, dict):
        return node
    for wanted, title in titles:
        if node == wanted:
            return _tidy(node, []) | title
    kept = {key: _tidy(value, titles) for key, value in node.items()
            if not (key == "default" and (value is None or value in ([], {}) or isinstance(value, dict)))
            and value not in (LARGEST, -LARGEST) and key != "discriminator"}
    if "prefixItems" in kept:  # all entries of a row are alike
        kept["items"] = kept.pop("prefixItems")[0]
    if "pattern" in kept:
        kept["pattern"] = kept["pattern"].replace(r"\Z", "$")
    if "anyOf" in kept:
        kinds = [kind for kind in kept.pop("anyOf") if kind != {"type": "null"}]
        kept |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    return kept
