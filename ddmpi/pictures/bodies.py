"""Pictures of bodies in the plane and in space: deformed, with the estimated error, as a mechanism, over load steps."""

import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ddmpi.errors import OutputError
from ddmpi.pictures.moved import apart, magnify, painted_by, pressed, rigid_parts
from ddmpi.pictures.scales import BRIGHTEST, pressure_ends, stress_end
from ddmpi.pictures.sheet import (
    COLOURS,
    FILLED,
    Sheet,
    above,
    by_value,
    colours_of,
    filled,
    limits,
    mark,
    rounded,
    signed_colours,
)
from ddmpi.pictures.views import Skin, Surface, View
from ddmpi.results.fields import boundary_of, owners
from ddmpi.results.histories import load_steps
from ddmpi.results.tables import Columns, Results
from ddmpi.scene.motions import Image
from ddmpi.sets import magnitude
from ddmpi.system.files import writing
from ddmpi.system.numbers import ALIKE, Frame, RigidMotion, scaled_unit

MECHANISM = {
    "moved": 0.1,  # its largest displacement in the picture, over the bodies' extent
    "turned": 0.3,  # its largest rotation in the picture (rad)
    "at rest": 1e-3,  # a body is drawn at rest if its velocity is below this fraction of the largest
}
"""How a mechanism is drawn."""

ANIMATION = {
    "frames": 200,  # largest number
    "seconds": 6.0,  # duration, unless there were too few or too many frames a second:
    "slowest": 2.0,
    "fastest": 20.0,
    "pixels": 700,  # of the longer side of the bodies
}
"""How load steps become an animation."""

COMPONENTS = (
    {f"displacement_{axis}": ("displacement", k) for k, axis in enumerate("xyz")}
    | {
        f"stress_{axes}": ("nodal_stress", k)
        for k, axes in enumerate(("xx", "xy", "xz", "yy", "yz", "zz"))
    }
    | {f"principal_{k + 1}": ("nodal_principal", k) for k in range(3)}
)
"""The field at nodes, and its column, that output.animation asks for."""


def skin_of(results: Results) -> Skin:
    """The visible surfaces of the bodies. Raises InputError for a cut that meets none."""
    view = View(results.points, results.output)
    return Skin(view, results.points, results.fields["cells"])


def draw_bodies(results: Results, folder: Path | None = None) -> Any:
    """The deformed bodies, coloured by von Mises stress, with the ends of all load steps whose fields are in the `folder`,
    or by displacement if there is no stress; a figure."""
    (scale, shift), skin, fields = magnify(results), skin_of(results), results.fields
    values, quantity, unit = coloured(results, fields)
    values, still = skin.extended(values), skin.extended(results.points + shift)
    facets, at = skin.facets, still + skin.extended(results.displacement(scale))
    seen = values[np.unique(facets)]
    moved = float(magnitude(results.displacement()).max())
    whole = None if results.output.get("cut") else skin
    top = stress_end(results, folder, whole) if quantity != "displacement" else values.max()
    beyond, rigid = skin.beyond, rigid_parts(results, scale)
    if results.output.get("mirrored"):
        facets, at, still, values, beyond = _both_halves(facets, at, still, values, beyond)
        rigid += [replace(surface, at=surface.at[::-1] * (-1.0, 1.0)) for surface in rigid]
    facets, at, still, values, beyond = _all_sectors(results, facets, at, still, values, beyond)
    factor, unit = scaled_unit(seen.max(), unit)
    image = colours_of(0.0, top / factor or 1.0, "viridis")
    sheet = Sheet(results, np.vstack([still[beyond <= 0.0], at[beyond <= 0.0]]), rigid)
    sheet.outline(still, facets, beyond)
    sheet.show([Surface(at, facets, by_value(values[facets] / factor, image), beyond, plain=True)])
    sheet.colours(image, f"{quantity} ({unit})", "max" if seen.max() > top else "neither")
    most, node = largest_of(fields)
    seen_there = not sheet.view.solid or sheet.shows(at[[node]], beyond[[node]])[0]
    if most and seen_there:
        mark(sheet.axes, sheet.place(at[node])[:2], f"{rounded(most / factor)} {unit}")
    hidden = "" if seen_there else " (out of sight)"
    # The colours are those of nodes, and may go beyond the means over cells, as the mesh is coarse.
    nodal = (
        f" in a cell, {rounded(seen.max() / factor)} {unit} at a node"
        if top > (1.0 + ALIKE) * most
        else ""
    )
    words = (
        f"{quantity} up to {rounded(most / factor)} {unit}{nodal}{hidden}; "
        if quantity != "displacement"
        else ""
    )
    factor, unit = scaled_unit(moved, results.units["length"])
    words += f"displacement × {scale:g}, largest {rounded(moved / factor)} {unit}"
    sheet.title(results.heading(True) + words, "; ")
    return sheet.figure


def coloured(
    results: Results, fields: dict[str, np.ndarray], what: str | bool = True
) -> tuple[np.ndarray, str, str]:
    """The values (nv,) for the colours of bodies, with name and unit: `what` is asked for by output.animation, by
    default von Mises stress, else displacement."""
    length, stress = results.units["length"], results.units["stress"]
    if what in COMPONENTS:
        field, column = COMPONENTS[str(what)]
        unit = length if field == "displacement" else stress
        return fields[field][:, column], str(what).replace("_", " "), unit
    if "nodal_von_mises" in fields and what != "displacement":
        return fields["nodal_von_mises"], "von Mises stress", stress
    return magnitude(fields["displacement"]), "displacement", length


def largest_of(fields: dict[str, np.ndarray]) -> tuple[float, int]:
    """The largest value of `coloured`, and a node where it is. A stress is that of a cell, as in the summary: at nodes
    it is extrapolated."""
    if "nodal_von_mises" not in fields:
        size = magnitude(fields["displacement"])
        return float(size.max()), int(size.argmax())
    cell = fields["von_mises"].argmax()
    corners = fields["cells"][cell]
    corners = corners[corners >= 0]
    return float(fields["von_mises"][cell]), int(
        corners[fields["nodal_von_mises"][corners].argmax()]
    )


def _both_halves(
    facets: np.ndarray, at: np.ndarray, still: np.ndarray, *values: np.ndarray
) -> list[np.ndarray]:
    """Triangles (f, 3), places (nv, 2) and values (nv,) of a half-plane x ≥ 0 together with their mirror images."""
    number = np.arange(len(at))
    # the mirror image of a node on the axis is the node
    other = np.where(still[:, 0] == 0.0, number, number + len(at))
    return [
        np.vstack([facets, other[facets[:, ::-1]]]),
        *(np.vstack([array, array * (-1.0, 1.0)]) for array in (at, still)),
        *(np.tile(array, 2) for array in values),
    ]


def _all_sectors(
    results: Results, facets: np.ndarray, at: np.ndarray, still: np.ndarray, *values: np.ndarray
) -> list[np.ndarray]:
    """Triangles (f, 3), places (nv, d) and values (nv,) of all sectors that are shown."""
    frames = sectors_of(results)
    return [
        np.vstack([facets + k * len(at) for k in range(len(frames))]),
        *(np.vstack([each.at(array) for each in frames]) for array in (at, still)),
        *(np.tile(array, len(frames)) for array in values),
    ]


def sectors_of(results: Results) -> list[Frame]:
    """Where the parts that are shown are: what was computed, and if `output.sectors` asks for them the other sectors of
    its wheel."""
    d = results.dimension
    frames = [Frame.of(np.zeros(d))]
    if results.output.get("sectors"):
        images = (contact["image"] for contact in results.scene["contact"])
        image = msgspec.convert(next(one for one in images if one and one["turn"]), Image)
        for _ in range((image.sectors or 1) - 1):
            frames.append(image.frame(1.0, d).after(frames[-1]))
    return frames


def draw_error(results: Results) -> Any:
    """The estimated discretization error of the visible cells; a figure."""
    estimate = results.summary["discretization_error"]["energy_norm"]
    title = f"estimated discretization error {estimate:.2g} of the energy norm"
    return _draw_cells(results, "error", "estimated error, over the mean (energy norm per", title)


def draw_shares(results: Results) -> Any:
    """Where the errors of results are made; a figure."""
    told = [name for name, entry in results.summary["errors"].items() if entry["bar"] is not None]
    of = told[0] if len(told) == 1 else f"{len(results.summary['errors'])} results"
    words = "part in the error, over the mean (per"
    return _draw_cells(results, "error_share", words, f"where the error of {of} is made")


def _draw_cells(results: Results, field: str, words: str, title: str) -> Any:
    """The values of a field at the visible cells, on a logarithmic scale; `words` lack "area)" or "volume)"."""
    skin, values = skin_of(results), results.fields[field]
    top = values.max() or 1.0
    image = colours_of(1e-3 * top, top, "magma_r", logarithmic=True)
    values = np.maximum(values[skin.cell], 1e-3 * top)[:, None].repeat(3, axis=1)
    sheet = Sheet(results, results.points)
    sheet.show(
        [
            Surface(
                skin.extended(results.points),
                skin.facets,
                by_value(values, image),
                skin.beyond,
                plain=True,
            )
        ]
    )
    sheet.colours(image, f"{words} {'volume' if sheet.view.solid else 'area'})", "min")
    sheet.figure.suptitle(f"{results.heading()}{title}")
    return sheet.figure


def draw_mechanism(results: Results, mechanism: dict[str, Any]) -> Any:
    """The bodies at rest, and moved by the `mechanism`, the content of mechanism.json; a figure."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    points, names = results.points, list(results.summary["bodies"])
    owner, skin = owners(results), skin_of(results)
    centres, d = np.array(middles(results)), results.dimension
    velocity, u, going, turning = np.zeros((len(names), d)), np.zeros_like(points), {}, 1e-300
    for body in mechanism["bodies"]:
        name, speeds, centre = body["name"], np.array(body["velocity"]), np.array(body["centre"])
        motion = RigidMotion(speeds[:d], speeds[d:], centre)
        if name not in names:
            going[name] = motion
            continue
        k = names.index(name)
        centres[k], velocity[k] = centre, motion.displacement
        u[owner == k] = motion.at(points[owner == k])
        turning = max(turning, float(np.linalg.norm(motion.turn)))
    speed = magnitude(u)
    fastest = max(
        [speed.max(), *(np.linalg.norm(motion.displacement) for motion in going.values())]
    )
    step = min(MECHANISM["moved"] * results.extent / fastest, MECHANISM["turned"] / turning)
    moves = np.bincount(owner, speed > MECHANISM["at rest"] * fastest) > 0
    rigid = [*rigid_parts(results), *rigid_parts(results, step, going=going)]
    still, at = skin.extended(points), skin.extended(points + step * u)
    moving = moves[results.fields["body"][skin.cell]]
    sheet = Sheet(results, np.vstack([points, at]), rigid)
    sheet.show(
        [
            Surface(at, skin.facets[some], filled(kind), skin.beyond, edges=COLOURS[kind])
            for some, kind in ((~moving, "still"), (moving, "moved"))
            if some.any()
        ]
    )
    sheet.outline(still, skin.facets[moving], skin.beyond, zorder=4)
    sheet.arrows(centres[moves], step * velocity[moves], COLOURS["force"])
    sheet.write(names, centres + np.where(moves[:, None], step * velocity, 0.0), below=True)
    legend: list[Any] = [
        Line2D([], [], color=COLOURS["still"], linewidth=0.9, label="as the bodies stand"),
        Patch(
            facecolor=FILLED["moved"],
            edgecolor=COLOURS["moved"],
            label="as they would move, not to scale",
        ),
    ]
    if rigid:
        legend.append(Line2D([], [], color=COLOURS["rigid"], linewidth=1.4, label="rigid"))
    above(sheet.axes, legend)
    sheet.title(results.heading() + mechanism["reason"])
    return sheet.figure


def middles(results: Results) -> list[np.ndarray]:
    """A node (d,) of each body for its name, far from the boundary and as near as possible to the middle of its box."""
    from scipy.spatial import cKDTree

    owner, places = owners(results), []
    outer = boundary_of(results.fields["cells"], results.dimension)[0]
    edge = np.unique(outer[outer >= 0])
    for k in range(owner.max() + 1):
        nodes = results.points[owner == k]
        depth = cKDTree(results.points[edge[owner[edge] == k]]).query(nodes)[0]
        off = magnitude(nodes - (nodes.max(axis=0) + nodes.min(axis=0)) / 2)
        places.append(nodes[np.argmin(np.where(depth >= 0.8 * depth.max(), off, np.inf))])
    return places


def animate(results: Results, folder: Path, title: str) -> Path:
    """Write animation.gif, and where ffmpeg is installed animation.mp4: the deformed bodies at the load steps whose
    fields are in the `folder`; the path of the first.

    Colours are what output.animation asks for, see `coloured`; white is zero where signs differ. All frames have the
    same colours, limits and magnification: the one that suits the largest displacement of all. "pressure" is painted on
    the contacts of bodies without displacements, in space drawn apart; without contacts it is as the default. Not
    collective. Raises OutputError.
    """
    import matplotlib.pyplot as plt
    from PIL import Image

    skin, output = skin_of(results), results.output
    what = _asked(results)
    pressing = [contact["name"] for contact in pressed(results) if what == "pressure"]
    shown = [COMPONENTS[what][0] if what in COMPONENTS else "nodal_von_mises"]
    steps = partial(load_steps, results, folder, int(ANIMATION["frames"]))
    seen = partial(steps, () if what in ("pressure", "displacement") else shown)
    least, top, quantity, unit = _ends(results, folder, what, skin, seen())
    largest = max(magnitude(fields["displacement"]).max() for _, fields, _ in steps())
    factor, shift, shifts = *magnify(results, largest), dict[str, np.ndarray]()
    if pressing:
        view, nowhere = View(results.points, output), np.zeros(results.dimension)
        shifts = apart(results, view) if view.solid else {}
        still = [shifts.get(name, nowhere) for name in results.summary["bodies"]]
        factor, shift = 0.0, np.array(still)[owners(results)]

    def moved(fields: Columns) -> np.ndarray:
        at = fields["points"] + factor * fields["displacement"]
        return at[:, : results.dimension] + shift

    low = high = results.points + shift
    for _, fields, _ in steps():
        low, high = np.minimum(low, moved(fields)), np.maximum(high, moved(fields))
    reached = [skin.extended(state)[skin.beyond <= 0.0] for state in (low, high)]
    scale, unit = scaled_unit(max(top, -least), unit)
    image = signed_colours(least / scale, top / scale, "YlOrRd" if pressing else "viridis")
    sheet = Sheet(results, np.vstack(reached), pixels=int(ANIMATION["pixels"]))
    sheet.colours(image, f"{quantity} ({unit})", "both" if least < 0.0 else "max")
    sheet.figure.set_dpi(80)
    frames = []
    for time, fields, surfaces in seen():
        sheet.clear()
        at, words = skin.extended(moved(fields)), f"{title}time {time:.4g}"
        if pressing:
            body = Surface(at, skin.facets, filled("still"), skin.beyond)
            now = replace(results, surfaces=surfaces)
            _draw_pressures(sheet, now, body, pressing, shifts, image, scale, time)
        else:
            values = skin.extended(coloured(results, fields, what)[0])[skin.facets] / scale
            paint = by_value(values, image)
            sheet.meet(rigid_parts(results, factor, time))
            sheet.show([Surface(at, skin.facets, paint, skin.beyond, plain=True)])
            words += f", displacement × {factor:g}"
        sheet.figure.suptitle(words)
        sheet.figure.canvas.draw()
        sheet.figure.set_layout_engine("none")  # as the first frame has it
        frames.append(Image.fromarray(np.asarray(sheet.figure.canvas.buffer_rgba())).convert("RGB"))
    plt.close(sheet.figure)
    return _write_frames(folder / "animation.gif", frames)


def _asked(results: Results) -> str | bool:
    """What an animation shows, as of `coloured`: without contacts no pressures."""
    what = results.output.get("animation") or True
    return True if what == "pressure" and not pressed(results) else what


def _ends(
    results: Results, folder: Path, what: str | bool, skin: Skin, steps: Iterable[Any]
) -> tuple[float, float, str, str]:
    """The ends of an animation's colours, with words and unit: of stresses and pressures those of all pictures, of other
    fields those of its load steps."""
    if what == "pressure":
        return 0.0, pressure_ends(results)[1], what, results.units["stress"]
    _, quantity, unit = coloured(results, results.fields, what)
    if quantity == "von Mises stress":
        return 0.0, stress_end(results, folder), quantity, unit
    least, top, areas = 0.0, 0.0, skin.areas(results.points)
    for _, fields, _ in steps:
        values, *_ = coloured(results, fields, what)
        ends = limits(skin.extended(values), areas, BRIGHTEST)
        least, top = min(least, ends[0]), max(top, ends[1])
    return least, top, quantity, unit


def _draw_pressures(
    sheet: Sheet,
    results: Results,
    body: Surface,
    pressing: Sequence[str],
    shifts: Mapping[str, np.ndarray],
    image: Any,
    scale: float,
    time: float,
) -> None:
    """Draw bodies and the pressures on contacts: painted on both sides of solids, in the plane as lines."""
    if sheet.view.solid:
        painted = painted_by(results, pressing, shifts, image, scale)
        sheet.show([body, *(surface for surface, _ in painted)])
        return
    sheet.meet(rigid_parts(results, 0.0, time))
    sheet.show([body])
    for name in pressing:
        side = results.surfaces[name]
        values = np.nan_to_num(side["pressure"]) / scale
        sheet.facets([(side["points"][:, :2], side["cells"], values)], image)


def _write_frames(path: Path, frames: Sequence[Any]) -> Path:
    """Write pictures of one size as a GIF with one palette, and where ffmpeg is installed as a video. Raises
    OutputError."""
    from PIL import Image

    some = frames[:: len(frames) // 20 + 1]
    pixels = np.concatenate([np.asarray(frame)[::2, ::2].reshape(-1, 3) for frame in some])
    colours, number = np.unique(pixels, axis=0, return_counts=True)
    # by areas alone, the largest stresses would lose their colours
    weight = number**0.3 * (colours.min(axis=1) < 246)
    weighted = colours.repeat(np.rint(weight).astype(int), axis=0)
    palette = Image.fromarray(weighted[None]).quantize(255)
    palette.putpalette([*palette.getpalette()[:765], 255, 255, 255])
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    rate = len(frames) / ANIMATION["seconds"]
    rate = float(np.clip(rate, ANIMATION["slowest"], ANIMATION["fastest"]))
    with writing(path):
        path.unlink(missing_ok=True)  # it may be a link
        first.save(path, save_all=True, append_images=others, loop=0, duration=1000.0 / rate)
    if ffmpeg := shutil.which("ffmpeg"):
        _write_video(path.with_suffix(".mp4"), frames, rate, ffmpeg)
    return path


def _write_video(path: Path, frames: Sequence[Any], rate: float, ffmpeg: str) -> None:
    """Write pictures of one size as a video in H.264, of which the sides are even. Raises OutputError."""
    width, height = frames[0].size
    # no pipe: PETSc ends a program whose pipe is closed
    with writing(path), tempfile.TemporaryFile() as raw:
        path.unlink(missing_ok=True)
        raw.writelines(frame.tobytes() for frame in frames)
        raw.seek(0)
        done = subprocess.run(
            [
                ffmpeg,
                *f"-loglevel error -f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {rate:g} -i -".split(),
                "-vf",
                "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white",
                "-pix_fmt",
                "yuv420p",
                str(path),
            ],
            stdin=raw,
            capture_output=True,
        )
    if done.returncode:
        raise OutputError(
            f"{path}: ffmpeg could not write it: {done.stderr.decode(errors='replace').strip()}"
        )
