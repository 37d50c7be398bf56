"""Copies: bodies that take mesh and material from another one."""

from collections.abc import Mapping
from typing import Any

from ddmpi.errors import nearest

TAKEN = "mesh", "material"
"""The keys of a body that its copies take."""


def expanded(data: dict) -> dict:
    """The data of a scene in which each copy has the mesh and the material of its original, too.

    What has not the form of a scene stays as it is. Raises ValueError for a copy without an original. Not collective.
    """
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data
    named = {
        body["name"]: body
        for body in bodies
        if isinstance(body, dict) and isinstance(body.get("name"), str)
    }
    return data | {"body": [_expanded(body, named) for body in bodies]}


def _expanded(body: Any, named: Mapping[str, dict]) -> Any:
    """A body with what it takes from its original."""
    name = _original(body)
    if name is None:
        return body
    key = f"body.{body.get('name')}.copy"
    for own in TAKEN:
        if body.get(own) is not None:
            raise ValueError(f"{key}: a copy has the {own} of {name!r}; leave {own} out, or copy")
    if name not in named:
        raise ValueError(
            f"{key}.of: there is no [[body]] {name!r}{nearest(name, list(named))} "
            f"(bodies: {', '.join(named)})"
        )
    if _original(named[name]) is not None:
        raise ValueError(f"{key}.of: {name!r} is a copy itself; {_instead(name, named)}")
    return body | {own: named[name][own] for own in TAKEN if own in named[name]}


def _original(body: Any) -> str | None:
    """The body of which this one is a copy; None if it is none, or if that is not said in words."""
    copy = body.get("copy") if isinstance(body, dict) else None
    name = copy.get("of") if isinstance(copy, dict) else None
    return name if isinstance(name, str) else None


def _instead(name: str, named: Mapping[str, dict]) -> str:
    """What to write for a copy of the copy `name`: the body at the end of the chain, or that there is none."""
    chain = [name]
    while (of := _original(named.get(name))) is not None:
        if of in chain:
            return f"one of {', '.join(chain)} has a mesh and a material of its own"
        chain.append(name := of)
    return f'write of = "{name}", and the motion from there'
