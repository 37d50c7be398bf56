"""Words for mistakes in a scene: the key as a user writes it, and the nearest valid one."""

from __future__ import annotations

import difflib
import re
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec


def nearest(word: str, words: list[str]) -> str:
    """The end of a message that proposes the most similar of `words`; empty where none is similar."""
    close = difflib.get_close_matches(word, words, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def explain(message: str, data: dict, root: type) -> str:
    """Turn msgspec's message and JSON path into a user's key of `root`'s data, and the nearest valid one."""
    match = re.fullmatch(r"(.*?)(?: - at `(?:key in )?\$(.*)`)?", message, re.DOTALL)
    problem, path = match[1], match[2] or ""
    parts = re.findall(r"\w+|\.\.\.", path)
    kind, here, named = root, data, []
    for part in parts:
        if part == "...":  # msgspec does not say which entry of a table of free names it was
            part = next((name for name, value in here.items() if isinstance(value, dict | list)), part)
        if isinstance(here, list) and part.isdecimal():
            here = here[int(part)] if int(part) < len(here) else {}
            part = (here.get("name") or part) if isinstance(here, dict) else part
        elif isinstance(here, dict):
            here = here.get(part, {})
        named.append(str(part))
        kind = _member(kind, part, here)
    key = ".".join(named)
    unknown = re.search(r"unknown field `(.*?)`", problem)
    missing = re.search(r"missing required field `(.*?)`", problem)
    if unknown:
        fields = _fields(kind)
        full = ".".join([*named, unknown[1]])
        return f"{full}: unknown key{nearest(unknown[1], fields)} (valid here: {', '.join(fields)})"
    if missing:
        return f"{'.'.join([*named, missing[1]])}: this key is required and missing"
    kinds = [kind, *get_args(kind)]  # a Literal, or one in a union
    allowed = [str(a) for k in kinds if get_origin(k) is Literal for a in get_args(k)]
    if not allowed and parts and parts[-1] == "law":
        allowed = ["coulomb", "tresca", "none"]
    if "Invalid" in problem and allowed:
        number = "a number or " * (float in kinds)
        return (f"{key}: {here!r} is not valid; expected {number}one of {', '.join(allowed)}"
                f"{nearest(str(here), allowed)}")
    got = f" (got {here!r})" if parts and not isinstance(here, dict | list) else ""
    problem = problem.replace("object", "a table").replace("array", "a list")
    return (f"{key}: " if key else "") + problem[:1].lower() + problem[1:].replace("`", "") + got


def _fields(kind: Any) -> list[str]:
    if not (isinstance(kind, type) and issubclass(kind, msgspec.Struct)):
        return []
    tag = kind.__struct_config__.tag_field
    return ([tag] if tag else []) + list(kind.__struct_fields__)


def _member(kind: Any, part: str, here: Any) -> Any:
    """The type that stands at key `part` of `kind`; for a union, the one that fits the data."""
    if kind is None:
        return None
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and part in kind.__struct_fields__:
        kind = get_type_hints(kind)[part]
    else:  # an entry of a list
        inner = get_args(kind)
        kind = inner[0] if inner else None
    options = [o for o in (get_args(kind) if not isinstance(kind, type) else ())
               if isinstance(o, type) and issubclass(o, msgspec.Struct)]
    if options and isinstance(here, dict):
        tagged = [o for o in options if o.__struct_config__.tag == here.get("law", object())]
        return (tagged or options)[0]
    return kind
