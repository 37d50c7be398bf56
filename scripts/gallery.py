#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The gallery: runs its scenes as a user would, checks the number of each, and keeps a picture of each.

    scripts/study gallery [--only NAME ...] [--output docs/figures] [--runs FOLDER]
    scripts/study gallery --views docs/start/views  # view.html of each run, for the site (not kept in the repository)

Pictures are gallery_NAME.png in the folder --output, animations gallery_NAME.gif, and front_NAME.png for the README.
The words are in docs/start/gallery.md.
tests/scripts/test_gallery.py checks the numbers of `EXHIBITS` on coarser meshes or in fewer load steps, and the page.
"""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, arguments
from matplotlib import colormaps
from PIL import Image, ImageOps
from problems.moving import alone, meshing

from ddmpi.results.tables import read_results

WIDEST, MARGIN = 1000, 16
"""A picture in the page is at most so wide and high, and has a white margin (pixels)."""

FRONT = "bolted_flange"
"""The scene whose contacts the README shows."""

MOVING, FRAMES, SHADES, GREYS, HEAVIEST = 480, 28, (32, 24, 16, 12), 6, 245_000
"""An animation is at most so wide and high (pixels), and has at most so many frames and bytes, with fewer shades of
the stress where it needs that; texts are in so many greys."""


@dataclass(frozen=True)
class Check:
    """How the number of an exhibit is checked.

    Attributes
    ----------
    measure : the number, from the summary of a run with what `beside` adds
    within : by which part of its value a run may differ from it
    settings : what makes the run of the test cheaper
    picture : the file of the run that the page shows
    refused : words of the reason, where the run ends without an answer
    warned : words of each warning of the run, in their order; those of one kind are one warning, of the worst;
        … stands for anything
    """

    measure: Callable[[dict], float]
    within: float
    settings: dict[str, Any] = field(default_factory=dict)
    picture: str = "bodies.png"
    refused: str = ""
    warned: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exhibit(Check):
    """A scene of the gallery: its file in configs/ without .toml, the value and unit that the page tells, and whether
    that shows an animation as well."""

    scene: str = ""
    value: float = 0.0
    unit: str = ""
    moves: bool = False

    @property
    def name(self) -> str:
        return self.scene.rpartition("/")[2]

    @property
    def path(self) -> Path:
        return ROOT / "configs" / f"{self.scene}.toml"

    @property
    def told(self) -> str:
        """The number as the page has it."""
        return f"{self.value:g} {self.unit}"

    def check(self, summary: dict) -> None:
        """Raise ValueError if a run did not end as it should, warned, or has another number."""
        if summary["converged"] == bool(self.refused) or self.refused not in summary["reason"]:
            raise ValueError(f"{self.scene}: {summary['reason']}")
        # cheaper settings have coarser meshes and longer steps, of which a run may warn
        coarse = "discretization error", "too long for energies"
        given = [each for each in summary["warnings"] if not any(w in each for w in coarse)]
        expected = len(given) == len(self.warned) and all(
            all(part in each for part in words.split(" … "))
            for words, each in zip(self.warned, given, strict=True)
        )
        if not expected:
            raise ValueError(f"{self.scene}: {given}")
        found = self.measure(summary)
        if not abs(found - self.value) <= self.within * abs(self.value):
            raise ValueError(
                f"{self.scene}: {found:.6g} {self.unit} instead of {self.told} ± {self.within:.1%}"
            )


def contact(
    name: str, key: str, part: int | None = None, factor: float = 1.0
) -> Callable[[dict], float]:
    """A number of a contact, or a `part` of a pair of them, times `factor`."""

    def measure(summary: dict) -> float:
        value = summary["contacts"][name][key]
        return factor * (value if part is None else value[part])

    return measure


def floor_resultant(summary: dict) -> float:
    """Where the resultant of the floor's forces passes y = 0 (m)."""
    floor = [each for name, each in summary["contacts"].items() if name.endswith("-floor")]
    return sum(each["moment"] for each in floor) / sum(each["force"][1] for each in floor)


def tipping_edge(summary: dict) -> float:
    """x of the edge about which the tower's upper blocks turn (m), from the velocity of the second one."""
    ((centre, velocity),) = (
        (body["centre"], body["velocity"])
        for body in summary["mechanism"]
        if body["name"] == "second"
    )
    return centre[0] - velocity[1] / velocity[2]  # v_y + ω (x − x_c) = 0


def second_cycle(summary: dict) -> float:
    """What the pad dissipates in the second cycle (N mm/mm)."""
    return sum(
        step["contacts"]["pad-base"]["dissipated"]
        for step in summary["steps"]
        if 3.5 < step["time"] <= 5.5
    )


def bolt_over_joint(summary: dict) -> float:
    """By how much the force of the bolt is larger than that of the joint (kN)."""
    return 1e-3 * (
        summary["contacts"]["head"]["force"][-1] - summary["contacts"]["joint"]["force"][-1]
    )


def stiffness_of_a_pair(summary: dict) -> float:
    """The largest stiffness of the gears where one pair of teeth bears alone (N/(mm µm))."""
    angle, stiffness, _ = meshing(summary)
    return float(stiffness[alone(angle)].max())


def at(summary: dict, time: float) -> dict:
    """The contacts at a load step."""
    return next(step["contacts"] for step in summary["steps"] if step["time"] == time)


def total(summary: dict, contacts: tuple[str, ...], part: int) -> float:
    """A component of the force of some contacts."""
    return sum(summary["contacts"][name]["force"][part] for name in contacts)


ONE = {"time.steps": 1}

CHECKS = {
    "pinched_blocks": Check(
        contact("upper-lower", "tangential_force", factor=1e-6),
        1e-5,
        warned=("body.upper: the largest von Mises stress … is at the end of a clamp at (0, 2)",),
    ),
    "punch": Check(
        contact("punch-base", "tangential_force"),
        1e-3,
        warned=(
            "contact.punch-base: the largest pressure … is at a sharp corner of punch in contact at (10, 0)",
            "body.punch: the largest von Mises stress … is at a sharp corner of punch in contact at (-10, 0)",
        ),
    ),
    "roller": Check(contact("cylinder-block", "pressure_max"), 0.01),
    "pin_in_lug": Check(contact("pin-lug", "pressure_max"), 0.01, {"method.target_error": 0.04}),
    "dovetail": Check(
        contact("root-disc", "force", 0, -1.0),
        1e-5,
        {"method.target_error": 0.1},
        warned=(
            "contact.root-disc: the largest pressure … is at a sharp corner of root in contact at (1",
            "the largest von Mises stress … where it grows without limit",
        ),
    ),
    "wedge_in_slot": Check(
        contact("left", "force", 0),
        1e-4,
        {"method.target_error": 0.1},
        warned=(
            "the largest pressure … is at a sharp corner of wedge in contact … 2 such warnings",
            "body.wedge: the largest von Mises stress … is at a sharp corner of wedge in contact at (",
        ),
    ),
    "shrink_fit": Check(contact("fit", "moment", factor=-1e-3), 1e-3, ONE, "steps.png"),
    "shaft_in_hub": Check(
        contact("bush-hub", "moment", factor=-1e-3), 1e-3, picture="contacts.png"
    ),
    "loosened_fit": Check(contact("fit", "moment", factor=1e-3), 1e-3, ONE, "steps.png"),
    "guided_wedge": Check(
        contact("wedge-block", "force", 0, -1.0),
        1e-4,
        warned=(
            "contact.wedge-block: the largest pressure … is at a sharp corner of wedge in contact at (0, 60)",
            "body.wedge: the largest von Mises stress … is at a sharp corner of wedge in contact at (0, 0)",
        ),
    ),
    "heated_bush": Check(lambda summary: summary["bodies"]["bush"]["displacement_max"], 1e-3, ONE),
    "press_fit": Check(lambda summary: summary["displacement_max"], 0.01, ONE, "contact.png"),
    "rail_on_bed": Check(
        contact("rail-wheel", "normal_force"),
        1e-3,
        warned=(
            "contact.rail-wheel: the pressure at (0, 100) is on too few nodes to resolve it, 1",
        ),
    ),
    "vice": Check(contact("part-moving", "force", 1, -1.0), 1e-3, ONE, "contacts.png"),
    "fretting": Check(second_cycle, 1e-3, {"time.steps": 2}, "steps.png"),
    "pushed_block": Check(
        lambda summary: -np.divide(*summary["contacts"]["guide"]["force"]),
        1e-9,
        {"time.steps": 4},
        warned=(
            "contact.guide: the largest pressure … is at a sharp corner of block in contact at (130, 0)",
            "body.block: the largest von Mises stress … is at a sharp corner of block in contact at (130, -0.02)",
        ),
    ),
    "rolling_wheel": Check(
        contact("tread", "force", 1),
        1e-9,
        {
            "time.steps": 2,
            "body.wheel.mesh.divisions": [120, 4],
            "body.rail.mesh.divisions": [30, 4],
        },
    ),
    "cam_and_follower": Check(
        lambda summary: -at(summary, 40.0)["lift"]["force"][1],
        0.02,
        {
            "time.steps": 4,
            "body.cam.mesh.contact_size": 0.5,
            "body.follower.mesh.divisions": [48, 20],
        },
    ),
    "spur_gears": Check(stiffness_of_a_pair, 0.06, {"time.steps": 5}),
    "bolted_plates": Check(
        lambda summary: summary["bodies"]["middle"]["reaction"][0], 1e-5, ONE, "contacts.png"
    ),
    "sliding_floor": Check(
        contact("crate-floor", "force", 0, 1e-3),
        1e-5,
        ONE,
        "steps.png",
        warned=("body.band: the largest von Mises stress … is at the end of the bond at (0, 0.2)",),
    ),
    "wall": Check(
        floor_resultant,
        1e-4,
        picture="contacts.png",
        warned=("contact.a2-b2: at (0.12, 0.21) it is closed at a single node",),
    ),
    "arch": Check(
        contact("v5-v6", "force", 0, -1e-3),
        1e-4,
        {f"body.v{k}.mesh.divisions": [6, 4] for k in range(1, 11)},
        warned=("it is closed at a single node",),
    ),
    "tipping_tower": Check(
        tipping_edge,
        1e-6,
        picture="mechanism.png",
        refused="no equilibrium: second, third and fourth would move most at (",
    ),
    "bonded_block": Check(
        lambda summary: -1e-6 * total(summary, ("lower", "upper"), 1),
        1e-5,
        picture="contacts.png",
        warned=("the largest von Mises stress … is at the end of a clamp at (0, ",),
    ),
    "lined_wheel": Check(contact("wheel-ground", "force", 1), 0.02),
    "turned_bolt": Check(
        bolt_over_joint,
        1e-6,
        ONE | {"body.bolt.mesh.contact_size": 0.8},
        warned=(
            "contact.nut: the largest pressure … is at a sharp corner of bolt in contact at (8.5, -10)",
        ),
    ),
    "tightened_bolt": Check(
        lambda summary: 1e-3 * at(summary, 1.0)["under-head"]["force"][1],
        1e-6,
        ONE,
        warned=(
            "contact.under-head: the largest pressure … is at a sharp corner of head in contact at (",
            "body.nut: the largest von Mises stress … is at a sharp corner of lower in contact at (5.5, -10)",
        ),
    ),
    "pushed_pin": Check(
        lambda summary: 1e-3 * at(summary, 1.0)["fit"]["force"][1], 0.01, {"time.steps": 6}
    ),
    "ball_on_floor": Check(contact("ball-floor", "pressure_max"), 0.03),
    "bolted_flange": Check(
        bolt_over_joint,
        5e-3,
        ONE
        | {"body.bolt.mesh.around": 12, "body.casing.mesh.around": 12}
        | {"body.flange.mesh.size": 14, "body.casing.mesh.size": 14},
        warned=(
            "contact.head: the largest pressure … is at a sharp edge of bolt in contact at (",
            "body.bolt: the largest von Mises stress … is at a re-entrant edge at (",
        ),
    ),
    "shaft_turned_in_hub": Check(
        contact("fit", "moment", 2, -1e-3),
        0.025,
        ONE,
        warned=(
            "contact.fit: the largest pressure … is at a sharp edge of hub in contact at (",
            "body.hub: the largest von Mises stress … is at a sharp edge of hub in contact at (",
        ),
    ),
    "arch_in_space": Check(lambda summary: 1e-3 * total(summary, ("v1-left", "v7-right"), 2), 1e-4),
    "bevel_wheels": Check(
        lambda summary: -summary["turned"]["driven"],
        0.03,
        {
            "time.steps": 3,
            "body.driving.mesh.contact_size": 1.6,
            "body.driven.mesh.contact_size": 1.6,
            "output.animation": False,
        },
        warned=(
            "contact.face: the largest pressure … is at a sharp edge of driv",
            "the largest von Mises stress … is at a sharp edge of driv",
        ),
    ),
}


def read_exhibits(page: str) -> list[Exhibit]:
    """The exhibits in the order of the page, whose sections name scene and number and show pictures."""
    found = []
    for section in re.split(r"^## ", page, flags=re.M)[1:]:
        scene = re.findall(r"^scripts/run\.sh configs/(.*)\.toml$", section, re.M)[0]
        ((value, unit),) = re.findall(r"\*\*([\d.]+)\s([^*]*)\*\*", section)
        found.append(
            Exhibit(
                **vars(CHECKS[scene.rpartition("/")[2]]),
                scene=scene,
                value=float(value),
                unit=" ".join(unit.split()),
                moves=".gif)" in section,
            )
        )
    return found


EXHIBITS = read_exhibits((ROOT / "docs" / "start" / "gallery.md").read_text(encoding="utf-8"))


def beside(folder: Path) -> dict:
    """What a run has left in `folder` beside its summary: of mechanism.json the bodies, as "mechanism"; of frames.csv
    in space the last turns about x by body (degrees), as "turned"."""
    path, frames = folder / "mechanism.json", folder / "frames.csv"
    found = (
        {"mechanism": json.loads(path.read_text(encoding="utf-8"))["bodies"]}
        if path.exists()
        else {}
    )
    if frames.exists():
        with open(frames, newline="", encoding="utf-8") as file:
            found["turned"] = {
                row["body"]: float(row.get("turn_x", "nan")) for row in csv.DictReader(file)
            }
    return found


def run(exhibit: Exhibit, output: Path) -> dict:
    """Run a scene as a user would, unless its results are in `output`; its checked summary. Raises ValueError."""
    if not (output / "summary.json").exists():
        # The environment is without what MPI adds to it.
        done = subprocess.run(
            [
                ROOT / "scripts" / "run.sh",
                exhibit.path,
                "--output",
                output,
                "--set",
                "output.view=true",
            ],
            text=True,
            capture_output=True,
            env=dict(os.environ),
        )
        if done.returncode != (3 if exhibit.refused else 0):
            raise ValueError(
                f"{exhibit.scene} ended with {done.returncode}:\n{done.stdout}{done.stderr}"
            )
    summary = read_results(output).summary | beside(output)
    exhibit.check(summary)
    return summary


def show(exhibit: Exhibit, output: Path, figures: Path) -> None:
    """Keep the pictures of a run."""
    keep(output / exhibit.picture, figures / f"gallery_{exhibit.name}.png")
    if exhibit.moves:
        keep_moving(output / "animation.gif", figures / f"gallery_{exhibit.name}.gif")
    if exhibit.name == FRONT:
        keep(output / "contacts.png", figures / f"front_{exhibit.name}.png")


def keep(picture: Path, path: Path) -> None:
    """A smaller copy of a picture, in 256 colours and without its white margins."""
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    drawn = image.convert("L").point(lambda shade: 255 * (shade < 250)).getbbox()
    image = ImageOps.expand(image.crop(drawn), MARGIN, "white")
    image.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    # a palette by areas alone would lose the largest stresses, whose areas are small
    colours, number = np.unique(np.asarray(image).reshape(-1, 3), axis=0, return_counts=True)
    weight = (number // 2) ** 0.5 * (colours.min(axis=1) < 246)
    palette = Image.fromarray(colours.repeat(np.rint(weight).astype(int), axis=0)[None]).quantize(
        255
    )
    palette.putpalette([*palette.getpalette()[:765], 255, 255, 255])
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)


def keep_moving(animation: Path, path: Path) -> None:
    """A smaller copy of an animation: some of its frames, in few colours."""
    with Image.open(animation) as opened:
        pause, frames = opened.info["duration"], []
        few = -(-opened.n_frames // FRAMES)  # every so many
        for k in range(opened.n_frames - 1, -1, -few):
            opened.seek(k)
            frames.insert(0, opened.convert("RGB"))
    for frame in frames:
        frame.thumbnail((MOVING, MOVING), Image.Resampling.LANCZOS)
    for shades in SHADES:
        # a palette of the picture itself would spend its colours on large areas, and lose the largest stresses
        colours = np.vstack(
            [
                colormaps["viridis"](np.linspace(0.0, 1.0, shades))[:, :3],
                np.linspace(0.0, 1.0, GREYS)[:, None].repeat(3, axis=1),
            ]
        )
        palette = Image.new("P", (1, 1))
        palette.putpalette(np.rint(255 * colours).astype(np.uint8).tobytes())
        first, *others = (
            frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
        )
        first.save(
            path, save_all=True, append_images=others, loop=0, duration=few * pause, optimize=True
        )
        if path.stat().st_size <= HEAVIEST:
            break


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--only", nargs="+", choices=CHECKS, default=CHECKS, metavar="NAME")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "figures")
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="FOLDER",
        help="keep the runs there, and use those that are there",
    )
    parser.add_argument(
        "--views", type=Path, metavar="FOLDER", help="copy the views there, and draw nothing"
    )
    asked = parser.parse_args()
    chosen = [exhibit for exhibit in EXHIBITS if exhibit.name in asked.only]
    figures, right = asked.views or asked.output, True
    figures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        for exhibit in chosen:
            folder = (asked.runs or Path(temporary)) / exhibit.name
            try:
                found = exhibit.measure(run(exhibit, folder))
            except ValueError as error:
                right = False
                print(error, file=sys.stderr)
                continue
            if not asked.views:
                show(exhibit, folder, figures)
            elif not exhibit.refused:
                shutil.copyfile(folder / "view.html", figures / f"{exhibit.name}.html")
            print(f"{exhibit.scene}: {found:.6g} {exhibit.unit}, of {exhibit.told}", flush=True)
    sys.exit(not right)


if __name__ == "__main__":
    main()
