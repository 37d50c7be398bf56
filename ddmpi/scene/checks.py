"""Checks of all bodies of a scene together."""

from __future__ import annotations

from typing import Any


def check_heat(bodies: list[Any]) -> None:
    """ValueError if materials of `BodySpec` bodies expand, and none has a temperature. Bodies without one keep that of
    the state free of stress."""
    expanding = [
        body.name
        for body in bodies
        if any(material.expansions.any() for material in body.materials)
    ]
    if expanding and all(body.temperature is None for body in bodies):
        raise ValueError(
            f"body.{expanding[0]}.material.expansion: no body has a temperature, so nothing expands; "
            "write temperature = 80.0 (K over the state free of stress) into a [[body]], or leave "
            "expansion out"
        )


def check_thickness(bodies: list[Any], touched: set[str]) -> None:
    """ValueError if a part of a `BodySpec` body with foundations, or with contacts, has a thickness of its own."""
    for body in bodies:
        if (body.foundation or body.name in touched) and any(
            one.thickness != 1.0 for one in body.materials
        ):
            raise ValueError(
                f"body.{body.name}.material.thickness: bodies with contacts or foundations have the depth "
                "alone; leave it out"
            )
