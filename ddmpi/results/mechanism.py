"""The mechanism of a run without equilibrium: its file, and its picture, which is drawn from that file only."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.judge.equilibrium import Mechanism, describe
from ddmpi.results.pictures import STYLE, draw_all, start_drawing
from ddmpi.results.tables import read_results, reading, writing
from ddmpi.system.provenance import identity

FILE, PICTURE = "mechanism.json", "mechanism.png"

STANDS = {"facecolor": "#f0f1f3", "edgecolor": "#9aa0a8", "linewidth": 0.7}

MOVES = {"facecolor": "#c8501e40", "edgecolor": "#c8501e", "linewidth": 0.9}

SURFACE = "#404040"

LARGEST = 0.1
"""The fastest node is drawn moved by this part of the scene's extent."""

TURNED = 0.5
"""No body is drawn turned by more than this angle."""

AT_REST = 1e-3
"""A body whose velocity is below this part of the largest one is not drawn moved."""

NAMED = 15
"""Names are written on at most this many bodies."""


def draw_results(folder: str | Path, number: int = 0, drawers: int = 1, time: float | None = None) -> list[Path]:
    """Draw the pictures of a folder of results: the mechanism where there is one, else all that `draw_all` draws.

    Where several `drawers` share the work, this is the one with that `number`. With a `time`, the pictures are those of
    the load step there.

    Not collective. Raises InputError without results or matplotlib, OutputError if a picture cannot be written.
    """
    with reading(folder):
        if time is not None or not (Path(folder) / FILE).exists():
            return draw_all(folder, number, drawers, time)
        return [] if number else [draw_mechanism(folder, identity(read_results(folder).summary))]


def write_mechanism(folder: Path, mechanism: Mechanism, bodies: Iterable[tuple[str, np.ndarray, np.ndarray]],
                    surfaces: Iterable[tuple[str, np.ndarray]] = (), title: str = "", unit: str = "m") -> None:
    """Write mechanism.json into `folder`. Not collective. Raises OutputError.

    Parameters
    ----------
    bodies : name, nodes (nv, 2) and triangles (nt, 3 or 6) of each body of the scene, loose or not
    surfaces : name and points (k, 2) of each contact with a rigid partner, along the surface
    title, unit : the scene's, and its unit of length
    """
    moving = {body.name: (body.centre.tolist(), velocity.tolist())
              for body, velocity in zip(mechanism.bodies, mechanism.velocities, strict=True)}
    listed: list[dict[str, Any]] = []
    for name, points, triangles in bodies:
        centre, velocity = moving.get(name, (points.mean(axis=0).tolist(), [0.0, 0.0, 0.0]))
        listed.append({"name": name, "centre": centre, "velocity": velocity, "loose": name in moving,
                       "outline": [points[loop].tolist() for loop in outlines(triangles)]})
    content = {"title": title, "reason": describe(mechanism), "imbalance": mechanism.imbalance, "length_unit": unit,
               "bodies": listed, "surfaces": [{"name": name, "points": points.tolist()} for name, points in surfaces]}
    with writing(folder / FILE):
        (folder / FILE).write_text(json.dumps(content, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


def draw_mechanism(folder: str | Path, metadata: dict[str, str] | None = None) -> Path:
    """Draw mechanism.png from mechanism.json of the same folder; its path. Not collective.

    Raises InputError if the file cannot be read or without matplotlib, OutputError if the picture cannot be written.
    """
    plt = start_drawing()
    folder = Path(folder)
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder / FILE}: cannot be read: {error}") from None
    with plt.rc_context(STYLE):
        figure = _figure(content)
        try:
            with writing(folder / PICTURE):
                (folder / PICTURE).unlink(missing_ok=True)  # it may be a link
                figure.savefig(folder / PICTURE, metadata=metadata)
        finally:
            plt.close(figure)
    return folder / PICTURE


def _figure(content: dict[str, Any]):
    """The bodies as they stand and as they would move."""
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.patheffects import withStroke

    bodies, surfaces = content["bodies"], [np.array(each["points"]) for each in content["surfaces"]]
    outlines = [[np.array(loop) for loop in body["outline"]] for body in bodies]
    velocities = np.array([body["velocity"] for body in bodies])
    nodes = np.concatenate([np.concatenate(loops) for loops in outlines])
    extent = float(np.ptp(nodes, axis=0).max())
    step = min(LARGEST * extent, TURNED / max(np.abs(velocities[:, 2]).max(), 1e-300))

    motions = [(np.array(body["centre"]), step * v) for body, v in zip(bodies, velocities, strict=True)]
    moved = [[move(loop, *motion) for loop in loops] for loops, motion in zip(outlines, motions, strict=True)]
    far = [max(np.linalg.norm(b - a, axis=1).max() for a, b in zip(old, new, strict=True))
           for old, new in zip(outlines, moved, strict=True)]
    moves = np.array(far) > AT_REST * max(far)

    everything = np.concatenate([nodes, *(np.concatenate(loops) for loops in moved), *surfaces])
    width, height = np.ptp(everything, axis=0)
    size = (8.6, 2.0 + 7.6 * height / width) if width > 1.4 * height else (1.6 + 6.0 * width / height, 7.0)
    figure, axes = plt.subplots(figsize=np.clip(size, (6.4, 3.4), (10.0, 8.0)), layout="constrained")
    for loops, loose in zip(outlines, [body["loose"] for body in bodies], strict=True):
        axes.add_patch(_patch(loops, **STANDS | ({} if loose else {"facecolor": "#d5d8dc"}), zorder=1))
    for points in surfaces:
        axes.plot(*points.T, color=SURFACE, linewidth=1.8, solid_capstyle="butt", zorder=4)
    for loops in (loops for loops, own in zip(moved, moves, strict=True) if own):
        axes.add_patch(_patch(loops, **MOVES, zorder=2))
    for (centre, motion), own in zip(motions, moves, strict=True):
        to = move(centre[None], centre, motion)[0]
        if own and np.linalg.norm(to - centre) > 0.1 * max(far):
            axes.annotate("", to, centre, zorder=5, arrowprops={"arrowstyle": "-|>", "color": "#7a2c0c",
                                                                "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9})
    if len(bodies) <= NAMED:
        for body, (centre, motion), own in zip(bodies, motions, moves, strict=True):
            axes.annotate(body["name"], move(centre[None], centre, motion)[0] if own else centre, (0, -5),
                          textcoords="offset points", ha="center", va="top", fontsize=8, zorder=6,
                          path_effects=[withStroke(linewidth=2, foreground="#ffffffb0")])
    margin = 0.04 * max(width, height)
    low, high = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    unit = content["length_unit"]
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=f"x ({unit})",
             ylabel=f"y ({unit})")
    legend = [Patch(**STANDS, label="as the bodies stand"), Patch(**MOVES, label="as they would move, not to scale")]
    if surfaces:
        legend.append(Line2D([], [], color=SURFACE, linewidth=1.8, label="rigid"))
    axes.legend(handles=legend, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(legend), fontsize=9)
    figure.suptitle(_title(content, figure.get_figwidth()))
    return figure


def move(points: np.ndarray, centre: np.ndarray, motion: Sequence[float]) -> np.ndarray:
    """Where points (k, 2) are after a steady motion (x, y, angle) of the body about its centre, as a true rotation."""
    x, y, angle = motion
    straight = np.sinc(angle / np.pi)  # the centre moves along an arc
    aside = angle / 2 * np.sinc(angle / 2 / np.pi) ** 2
    shift = np.array([straight * x - aside * y, straight * y + aside * x])
    cos, sin = np.cos(angle), np.sin(angle)
    return centre + shift + (points - centre) @ np.array([[cos, sin], [-sin, cos]])


def outlines(triangles: np.ndarray) -> list[np.ndarray]:
    """The boundary of triangles (nt, 3 or 6), counterclockwise, as closed loops of nodes; holes the other way."""
    corners = [0, 1, 2] if triangles.shape[1] == 3 else [0, 3, 1, 4, 2, 5]
    ring = triangles[:, corners]
    after: dict[int, list[int]] = {}
    edges = np.stack([ring, np.roll(ring, -1, axis=1)], axis=-1).reshape(-1, 2)
    own = {(int(a), int(b)) for a, b in edges}
    for a, b in sorted(own):
        if (b, a) not in own:
            after.setdefault(a, []).append(b)
    loops = []
    while after:
        loop = [next(iter(after))]
        while loop[-1] in after:
            following = after[loop[-1]]
            loop.append(following.pop())
            if not following:
                del after[loop[-2]]
        loops.append(np.array(loop[:-1]))
    return loops


def _patch(loops: list[np.ndarray], **style):
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    return PathPatch(Curve.make_compound_path(*(Curve(np.vstack([loop, loop[:1]]), closed=True) for loop in loops)),
                     **style)


def _title(content: dict[str, Any], width: float) -> str:
    title = f"{content['title']}\n" if content["title"] else ""
    return (title + "\n".join(textwrap.wrap(content["reason"], int(11 * width)))).replace("$", r"\$")
