"""The names of results: those that have gradients, and those whose errors are told."""

import re
from collections.abc import Iterator
from math import comb
from typing import Any, NamedTuple

from ddmpi.errors import nearest

GRADIENTS = {
    "contacts": (
        "force",
        "moment",
        "normal_force",
        "tangential_force",
        "pressure_max",
        "pressure_mean",
        "dissipated",
    ),
    "bodies": ("reaction",),
    "rigid": ("force", "displacement"),
}
"""The results that have gradients, by their entries in the summary."""

ERRORS = GRADIENTS | {
    "bodies": ("reaction", "displacement_max", "von_mises_max", "energy"),
}
"""The results whose errors are told; also displacements of the physical points of bodies."""

POINT = "bodies.{}.points.POINT.displacement"

VECTORS = ("force", "reaction", "displacement")


class Named(NamedTuple):
    """A result by the parts of its name: an entry of the summary, with the number of a component; the physical point of
    a displacement, else empty."""

    kind: str
    name: str
    what: str
    axis: int = 0
    point: str = ""


def named(result: str) -> Named:
    """The parts of a valid name."""
    kind, name, what, *rest = result.split(".")
    point = ".".join(rest[:-2]) if what == "points" else ""
    last = rest[-1] if rest else "x"
    return Named(kind, name, "displacement" if point else what, "xyz".index(last), point)


def with_letters(result: str) -> str:
    """The name with a letter for its component, which may also be 0, 1 or 2."""
    end = re.search(r"\.([012])$", result)
    return f"{result[:-1]}{'xyz'[int(end[1])]}" if end else result


def results(scene: Any, among: dict[str, tuple[str, ...]]) -> Iterator[str]:
    """The full names of the results of a scene `among` those by kind; of errors also of its points, as POINT."""
    groups = {"contacts": scene.contact, "bodies": scene.body, "rigid": scene.rigid}
    for kind, entries in groups.items():
        for entry in entries:
            for what in among[kind]:
                for end in _ends(scene, what):
                    if not (what == "reaction" and scene.axisymmetric and end == ".x"):
                        yield f"{kind}.{entry.name}.{what}{end}"
            if kind == "bodies" and among is ERRORS:
                for end in _ends(scene, "displacement"):
                    yield POINT.format(entry.name) + end


def _ends(scene: Any, what: str) -> list[str]:
    """The components of a result as ends of its name; in the plane there is one moment, for one rotation."""
    vector = what in VECTORS or (what == "moment" and comb(scene.dimension, 2) > 1)
    return [f".{letter}" for letter in "xyz"[: scene.dimension]] if vector else [""]


def main(scene: Any) -> list[str]:
    """The results of ``output.errors = "main"``."""
    held = {body.name for body in scene.body if body.clamp or body.foundation}
    wanted = {
        "contacts": ("normal_force", "force", "pressure_max"),
        "bodies": ("reaction", "displacement_max", "von_mises_max"),
        "rigid": (),
    }
    found = []
    for result in results(scene, wanted):
        one = named(result)
        if one.what == "reaction" and one.name not in held:
            continue
        if one.what == "von_mises_max" and not scene.output.stress:
            continue
        found.append(result)
    return found


def targets(scene: Any) -> dict[str, Any]:
    """The targets of ``method.target`` by the names of results with letters."""
    return {with_letters(result): target for result, target in scene.method.target.items()}


def wanted_errors(scene: Any) -> list[str]:
    """The results whose errors a valid scene wants: those of ``output.errors``, and those with targets."""
    return list(dict.fromkeys([*_asked(scene), *targets(scene)]))


def _asked(scene: Any) -> list[str]:
    """The results that ``output.errors`` names."""
    wanted = scene.output.errors
    return main(scene) if wanted == "main" else [with_letters(result) for result in wanted]


def refuse_unknown(scene: Any) -> None:
    """ValueError where ``output.errors`` or ``method.target`` asks for what there is not."""
    with_targets = [with_letters(result) for result in scene.method.target]
    able = list(results(scene, ERRORS)) if scene.output.errors or with_targets else []
    for key, wanted in (("output.errors", _asked(scene)), ("method.target", with_targets)):
        if wanted and scene.method.outer != "newton":
            raise ValueError(f'{key}: need outer = "newton", not "{scene.method.outer}"')
        if wanted and scene.output.only:
            raise ValueError(
                f'{key}: need the fields that only = "{scene.output.only}" leaves out; drop one of the two'
            )
        for result in wanted:
            place = re.sub(r"^(bodies\.[^.]+\.points\.).+(\.displacement\.)", r"\1POINT\2", result)
            if place not in able:
                near = nearest(result, able) or f" (such as {able[0]!r})"
                raise ValueError(f"{key}: there is no result {result!r}{near}")
            if wanted.count(result) > 1:
                raise ValueError(f"{key}: {result!r} stands there {wanted.count(result)} times")
            if result.endswith("von_mises_max") and not scene.output.stress:
                raise ValueError(f"{key}: {result!r} asks for stresses; drop stress = false")
