"""The keys of a scene by which its answer can be differentiated."""

import difflib
import re

from ddmpi.scene.keys import flatten

WHOLE = (
    r"body\.[^.]+\.(?:(?:traction|clamp)\.\d+|volume_force|temperature)"
    r"|rigid\.[^.]+\.(?:displacement|force|moment)|contact\.[^.]+\.(?:gap|friction\.(?:coefficient|slip_bound))"
)
"""What the derivatives of an answer take as a whole, by a factor on it, unless it is one number."""

NUMBER = (
    r"body\.[^.]+\.(?:material(?:\.\d+)?\.young|volume_force\.\d"
    r"|traction\.\d+\.(?:pressure|moment|(?:value|force|moment)\.\d)|clamp\.\d+\.(?:x|y|z|normal|value))"
    r"|rigid\.[^.]+\.(?:displacement|force|moment)\.\d|contact\.[^.]+\.(?:gap\.value|pretension\.force)"
)
"""Other numbers by which an answer can be differentiated."""


def derivable(scene: dict) -> list[str]:
    """The keys of a resolved scene by which its answer can be differentiated: numbers, and what stands for a factor."""
    keys: dict[str, None] = {}
    moved = _pushed_or_moved(scene["rigid"])
    for leaf, value in flatten(_entries(scene)):
        whole = re.match(WHOLE, leaf)
        if whole and value is not None:
            keys[whole[0]] = None
        vector = isinstance(value, list | tuple)
        numbers = (
            {f"{leaf}.{k}": entry for k, entry in enumerate(value)} if vector else {leaf: value}
        )
        for key, number in numbers.items():
            if type(number) in (int, float) and re.fullmatch(NUMBER, key) and key not in moved:
                keys[key] = None
    return list(keys)


def _entries(scene: dict) -> dict:
    """Bodies, contacts and rigid partners, with all clamps as tables."""
    bodies = []
    for body in scene["body"]:
        clamps = [{"on": one} if isinstance(one, str) else one for one in body["clamp"]]
        bodies.append(body | {"clamp": clamps})
    return {"body": bodies, "contact": scene["contact"], "rigid": scene["rigid"]}


def _pushed_or_moved(partners: list[dict]) -> set[str]:
    """Keys of rigid partners without effect: along an axis a partner is either pushed or moved."""
    return {
        f"rigid.{rigid['name']}.{'displacement' if force else 'force'}.{axis}"
        for rigid in partners
        for axis, force in enumerate(rigid.get("force") or ())
    }


def refuse_underivable(scene: dict) -> None:
    """ValueError where ``output.derivatives`` names a key by which nothing can be differentiated."""
    wanted = scene["output"]["derivatives"]
    if wanted and scene["method"]["outer"] != "newton":
        raise ValueError(
            f'output.derivatives: need outer = "newton", not "{scene["method"]["outer"]}"'
        )
    for contact in scene["contact"] if wanted else ():
        if any(
            isinstance(value, dict) and value.get("history")
            for value in contact["friction"].values()
        ):
            raise ValueError(
                f"output.derivatives: friction that follows a history, as that of {contact['name']!r}, has none yet"
            )
    able = derivable(scene) if wanted else []
    for key in wanted:
        if key not in able:
            raise ValueError(
                f"output.derivatives: {key!r} is no number, load, clamp or displacement of this scene by "
                f"which its answer can be differentiated; the nearest ones are "
                f"{', '.join(difflib.get_close_matches(key, able, n=3, cutoff=0.0))}"
            )
        if wanted.count(key) > 1:
            raise ValueError(f"output.derivatives: {key!r} stands there {wanted.count(key)} times")
