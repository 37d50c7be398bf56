"""The JSON schema of a scene, for editors; and docstrings as data, from which the schema has its words."""

import itertools
import re
from inspect import cleandoc
from typing import Any

import msgspec

from ddmpi.scene.copies import TAKEN
from ddmpi.scene.values import LARGEST, Formula, Group, Name, Table

DIALECT = "http://json-schema.org/draft-07/schema#"
"""Draft of the schema; editors support later ones poorly."""

TITLES = {"name": Name, "group": Group, "formula": Formula}
"""Titles of the words that a scene's author chooses."""


def json_schema(root: type) -> dict[str, Any]:
    """The JSON schema of `root`, as a user writes it: keys, types, limits, defaults and, by docstrings, meanings."""
    schema = msgspec.json.schema(root)
    titles = [
        (msgspec.json.schema(kind), {"type": "string", "title": title})
        for title, kind in TITLES.items()
    ]
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
                "description": _plain(meaning)
            }
    body = definitions["BodySpec"]
    body["anyOf"] = [{"required": list(TAKEN)}, {"required": ["copy"]}]
    body["required"] = [key for key in body["required"] if key not in TAKEN]
    return {"$schema": DIALECT, "title": "scene of ddmpi", **schema, "$defs": definitions}


def read_docstring(text: str | None) -> tuple[str, dict[str, dict[str, str]]]:
    """The words of a numpydoc docstring, and by title its sections: what each name, or row of names, means."""
    words, *parts = re.split(r"^(\w+)\n-{3,}\n", cleandoc(text or ""), flags=re.MULTILINE)
    entry = re.compile(r"^(\S.*?)(?: : |\n[ ]+|\n|\Z)((?:.*\n?(?:[ ]+.*\n?)*))", re.MULTILINE)
    return words.strip(), {
        title: {names: " ".join(meaning.split()) for names, meaning in entry.findall(part)}
        for title, part in zip(parts[::2], parts[1::2], strict=True)
    }


def meanings(kind: type) -> dict[str, str]:
    """The meanings of attributes by name, from the docstrings of a class and of its bases."""
    words: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        for names, meaning in (
            read_docstring(vars(base).get("__doc__"))[1].get("Attributes", {}).items()
        ):
            words |= dict.fromkeys(names.split(", "), meaning)
    return words


def _below(kind: type) -> list[type]:
    return [kind, *itertools.chain.from_iterable(map(_below, kind.__subclasses__()))]


def _plain(text: str) -> str:
    """The text without the marks of code."""
    return " ".join(text.replace("``", "").split())


def _told(key: str, value: Any) -> bool:
    """Whether an entry of a schema says something about TOML; defaults that are tables or empty do not."""
    if key == "default" and (value is None or value == [] or isinstance(value, dict)):
        return False
    return key != "discriminator" and value not in (LARGEST, -LARGEST)


def _tidy(node: Any, titles: list[tuple[dict, dict]]) -> Any:
    """A part of the schema in terms of DIALECT, without what TOML cannot write: null, numbers that are not finite."""
    if isinstance(node, list | tuple):
        return [_tidy(entry, titles) for entry in node]
    if not isinstance(node, dict):
        return node
    for wanted, title in titles:
        if node == wanted:
            return _tidy(node, []) | title
    kept = {key: _tidy(value, titles) for key, value in node.items() if _told(key, value)}
    if "prefixItems" in kept:  # all entries of a row are alike
        kept["items"] = kept.pop("prefixItems")[0]
    if "pattern" in kept:
        kept["pattern"] = kept["pattern"].replace(r"\Z", "$")
    if "anyOf" in kept:
        kinds = [kind for kind in kept.pop("anyOf") if kind != {"type": "null"}]
        kept |= kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    return kept
