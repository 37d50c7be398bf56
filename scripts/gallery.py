#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The gallery: runs its scenes as a user would, checks the number of each, and keeps a picture of each.

    scripts/study gallery [--only NAME ...] [--output docs/figures]
    scripts/study gallery --overlaps [--only NAME ...]  # the part of the processor time that looks for overlaps takes

Pictures are gallery_NAME.png in the folder --output, animations gallery_NAME.gif, and front_NAME.png for the README.
The words are in docs/start/gallery.md.
tests/scripts/test_gallery.py checks the numbers of `EXHIBITS` on coarser meshes or in fewer load steps, and the page.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT
from far import alone, meshing
from matplotlib import colormaps
from PIL import Image, ImageOps
from solid_scenes import two_boxes

from ddmpi.results.tables import read_results
from ddmpi.scene.reader import write_toml

WIDEST = 1000
"""A picture in the page is at most so wide and high (pixels)."""

FRONT = "bolted_flange"
"""The scene whose contacts the README shows."""

MOVING, FRAMES, SHADES, GREYS, BYTES = 480, 28, (32, 24, 16, 12), 6, 245_000
"""An animation is at most so wide and high (pixels), and has at most so many frames and bytes, with fewer shades of
the stress where it needs that; texts are in so many greys."""

MARGIN = 16
"""White margin that is left around a picture (pixels)."""


@dataclass(frozen=True)
class Exhibit:
    """A scene of the gallery and its number.

    Attributes
    ----------
    scene : its file in configs/, without .toml
    picture : the file of the run that the page shows
    value, unit : what the number should be
    within : by which part of it a run may differ from it
    source : where the value comes from
    measure : the number, from the summary of a run, with the bodies of mechanism.json as its entry "mechanism"
    settings : what makes the run of the test cheaper
    refused : words of the reason, where the run ends without an answer
    warned : words of the only warning of the run, if it has one
    moves : whether the page shows its animation as well
    """

    scene: str
    picture: str
    value: float
    unit: str
    within: float
    source: str
    measure: Callable[[dict], float]
    settings: dict[str, Any] = field(default_factory=dict)
    refused: str = ""
    warned: str = ""
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
        if [self.warned in each for each in summary["warnings"]] != [True] * bool(self.warned):
            raise ValueError(f"{self.scene}: {summary['warnings']}")
        found = self.measure(summary)
        if not abs(found - self.value) <= self.within * abs(self.value):
            raise ValueError(f"{self.scene}: {found:.6g} {self.unit} instead of {self.told} ± {self.within:.1%}")


def contact(name: str, key: str, part: int | None = None, factor: float = 1.0) -> Callable[[dict], float]:
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
    (centre, velocity), = ((body["centre"], body["velocity"]) for body in summary["mechanism"]
                           if body["name"] == "second")
    return centre[0] - velocity[1] / velocity[2]  # v_y + ω (x − x_c) = 0


def second_cycle(summary: dict) -> float:
    """What the pad dissipates in the second cycle (N mm/mm)."""
    return sum(step["contacts"]["pad-base"]["dissipated"] for step in summary["steps"] if 3.5 < step["time"] <= 5.5)


def abutments(summary: dict) -> float:
    """What both abutments of the arch in space bear (kN)."""
    return 1e-3 * sum(summary["contacts"][name]["force"][2] for name in ("v1-left", "v7-right"))


def bolt_over_joint(summary: dict) -> float:
    """By how much the force of the bolt is larger than that of the joint (kN)."""
    return 1e-3 * (summary["contacts"]["head"]["force"][-1] - summary["contacts"]["joint"]["force"][-1])


def tightened(summary: dict) -> float:
    """What the bolt presses its head by at the end of tightening, time 1 (kN)."""
    (step,) = (step for step in summary["steps"] if step["time"] == 1.0)
    return 1e-3 * step["contacts"]["under-head"]["force"][1]


def friction_ratio(summary: dict) -> float:
    """Friction over normal force of the block at the end of its way (N/N)."""
    x, y = summary["contacts"]["guide"]["force"]
    return -x / y


def pushed_in(summary: dict) -> float:
    """The force that pushes the pin all the way in, at time 1 (kN)."""
    (step,) = (step for step in summary["steps"] if step["time"] == 1.0)
    return 1e-3 * step["contacts"]["fit"]["force"][1]


def stiffness_of_a_pair(summary: dict) -> float:
    """The largest stiffness of the gears where one pair of teeth bears alone (N/(mm µm))."""
    angle, stiffness, _ = meshing(summary)
    return float(stiffness[alone(angle)].max())


def cam_springs(summary: dict) -> float:
    """The force of the follower's springs at their largest stroke, at the end of the turn (N/mm)."""
    (step,) = (step for step in summary["steps"] if step["time"] == 40.0)
    return -step["contacts"]["lift"]["force"][1]


EXHIBITS = [
    Exhibit("pinched_blocks", "bodies.png", 8.36886, "MN/m", 1e-5, "brute force",
            contact("upper-lower", "tangential_force", factor=1e-6)),
    Exhibit("punch", "bodies.png", 190.8, "N/mm", 1e-3, "mesh halved: 1.0 % less; twice: 1.3 % less",
            contact("punch-base", "tangential_force")),
    Exhibit("roller", "bodies.png", 3585, "MPa", 0.01, "Hertz", contact("cylinder-block", "pressure_max")),
    Exhibit("drawn/pin_in_lug", "bodies.png", 162, "MPa", 0.01, "target 0.5 %: 161.9 MPa",
            contact("pin-lug", "pressure_max"), {"method.target_error": 0.04}),
    Exhibit("drawn/dovetail", "bodies.png", 400, "N/mm", 1e-5, "balance",
            contact("root-disc", "force", 0, -1.0), {"method.target_error": 0.1},
            warned="re-entrant corner at (13, -1)"),
    Exhibit("drawn/wedge_in_slot", "bodies.png", 831.46, "N/mm", 1e-4, "balance",
            contact("left", "force", 0), {"method.target_error": 0.1},
            warned="2.321, -10)"),
    Exhibit("shrink_fit", "steps.png", 283.9, "kN m/m", 1e-3, "Lamé and Coulomb",
            contact("fit", "moment", factor=-1e-3), {"time.steps": 1}),
    Exhibit("shaft_in_hub", "contacts.png", 2.0106, "kN m/m", 1e-3, "balance",
            contact("bush-hub", "moment", factor=-1e-3)),
    Exhibit("loosened_fit", "steps.png", 227.3, "kN mm/mm", 1e-3, "Lamé and Coulomb",
            contact("fit", "moment", factor=1e-3), {"time.steps": 1}),
    Exhibit("guided_wedge", "bodies.png", 5435.5, "N/mm", 1e-4, "balance, as all slips",
            contact("wedge-block", "force", 0, -1.0)),
    Exhibit("heated_bush", "bodies.png", 0.0144, "mm", 1e-3, "free expansion",
            lambda summary: summary["bodies"]["bush"]["displacement_max"], {"time.steps": 1}),
    Exhibit("press_fit", "contact.png", 0.0326, "mm", 0.01, "rod theory",
            lambda summary: summary["displacement_max"], {"time.steps": 1}),
    Exhibit("rail_on_bed", "bodies.png", 603.2, "N/mm", 1e-3, "beam on springs",
            contact("rail-wheel", "normal_force")),
    Exhibit("vice", "contacts.png", 120, "N/mm", 1e-3, "balance",
            contact("part-moving", "force", 1, -1.0), {"time.steps": 1}),
    Exhibit("fretting", "steps.png", 0.424, "N mm/mm", 1e-3, "mesh twice as fine: 2.8 % less", second_cycle,
            {"time.steps": 2}),
    Exhibit("pushed_block", "bodies.png", 0.2, "N/N", 1e-9, "Coulomb", friction_ratio, {"time.steps": 8},
            moves=True),
    Exhibit("rolling_wheel", "bodies.png", 10, "N/mm", 1e-9, "balance", contact("tread", "force", 1), {
        "time.steps": 4}, moves=True),
    Exhibit("drawn/cam_and_follower", "bodies.png", 86.4, "N/mm", 0.02, "springs times stroke, with a rigid cam",
            cam_springs, {"time.steps": 8}, moves=True),
    Exhibit("drawn/spur_gears", "bodies.png", 14.36, "N/(mm µm)", 0.06, "ISO 6336-1", stiffness_of_a_pair,
            {"time.steps": 8}, moves=True),
    Exhibit("bolted_plates", "contacts.png", 3200, "N/mm", 1e-5, "balance",
            lambda summary: summary["bodies"]["middle"]["reaction"][0], {"time.steps": 1}),
    Exhibit("sliding_floor", "steps.png", 5, "kN/m", 1e-5, "balance",
            contact("crate-floor", "force", 0, 1e-3), {"time.steps": 1}),
    Exhibit("wall", "contacts.png", 0.47745, "m", 1e-4, "balance", floor_resultant),
    Exhibit("arch", "bodies.png", 40.194, "kN/m", 1e-4, "statics: the least thrust",
            contact("v5-v6", "force", 0, -1e-3), {f"body.v{k}.mesh.divisions": [6, 4] for k in range(1, 11)}),
    Exhibit("tipping_tower", "mechanism.png", 1, "m", 1e-6, "balance", tipping_edge,
            refused="no equilibrium: second, third and fourth would move most at ("),
    Exhibit("bonded_block", "contacts.png", 3, "MN/m", 1e-5, "balance",
            lambda summary: -1e-6 * sum(summary["contacts"][name]["force"][1] for name in ("lower", "upper"))),
    Exhibit("lined_wheel", "bodies.png", 18.85, "N/mm", 0.02, "balance, with a round bore",
            contact("wheel-ground", "force", 1)),
    Exhibit("drawn/turned_bolt", "bodies.png", 12, "kN", 1e-6, "balance", bolt_over_joint,
            {"time.steps": 1, "body.bolt.mesh.contact_size": 0.8}),
    Exhibit("tightened_bolt", "bodies.png", 20, "kN", 1e-6, "balance", tightened, {"time.steps": 1}),
    Exhibit("drawn/pushed_pin", "bodies.png", 14.84, "kN", 0.01, "Lamé and Coulomb, μ p A", pushed_in,
            {"time.steps": 10}, moves=True),
    Exhibit("drawn/ball_on_floor", "bodies.png", 3.014, "MPa", 0.03, "Hertz", contact("ball-floor", "pressure_max")),
    Exhibit("drawn/bolted_flange", "bodies.png", 10, "kN", 5e-3, "balance", bolt_over_joint,
            {"time.steps": 1}, warned="stands at a re-entrant edge"),
    Exhibit("drawn/shaft_turned_in_hub", "bodies.png", 800, "N m", 0.025, "balance, with a round shaft",
            contact("fit", "moment", 2, -1e-3), {"time.steps": 1}),
    Exhibit("arch_in_space", "bodies.png", 448.77, "kN", 1e-4, "balance", abutments),
]


def mechanism_of(folder: Path) -> dict:
    """The bodies of mechanism.json in `folder` as the entry "mechanism", if a run has left one."""
    path = folder / "mechanism.json"
    return {"mechanism": json.loads(path.read_text(encoding="utf-8"))["bodies"]} if path.exists() else {}


def show(exhibit: Exhibit, figures: Path) -> str:
    """Run a scene as a user would and keep its picture; a line about it. Raises ValueError."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "results"
        done = subprocess.run([ROOT / "scripts" / "run.sh", exhibit.path, "--output", output],
                              text=True, capture_output=True, env=dict(os.environ))  # without what MPI adds to it
        if done.returncode != (3 if exhibit.refused else 0):
            raise ValueError(f"{exhibit.scene} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
        summary = read_results(output).summary | mechanism_of(output)
        exhibit.check(summary)
        keep(output / exhibit.picture, figures / f"gallery_{exhibit.name}.png")
        if exhibit.moves:
            keep_moving(output / "animation.gif", figures / f"gallery_{exhibit.name}.gif")
        if exhibit.name == FRONT:
            keep(output / "contacts.png", figures / f"front_{exhibit.name}.png")
    return (f"{exhibit.scene}: {exhibit.measure(summary):.6g} {exhibit.unit}, of {exhibit.told} ({exhibit.source})")


WATCHED = """
import time
from ddmpi.cli.main import main
from ddmpi.judge import plausible

taken, doubt_overlaps = [], plausible.doubt_overlaps
def watched(*given):
    start = time.process_time()
    found = doubt_overlaps(*given)
    taken.append(time.process_time() - start)
    return found
plausible.doubt_overlaps = watched
try:
    main()
finally:
    print(f"{sum(taken):.3f} of {time.process_time():.2f} s, {sum(taken) / time.process_time():.1%}")
"""
"""A run that says which part of its processor time the search for overlaps took."""


def overlaps(exhibits: list[Exhibit]) -> None:
    """Print that part for exhibits, and for two boxes in space of both orders."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [exhibit.path for exhibit in exhibits]
        for N, order in ((8, 1), (16, 1), (4, 2), (8, 2)):
            paths.append(Path(folder) / f"two_boxes_{N}_order_{order}.toml")
            paths[-1].write_text(write_toml(two_boxes(N, N + 1 - order, order)), encoding="utf-8")
        for path in paths:
            done = subprocess.run([sys.executable, "-c", WATCHED, "run", path, "--no-figures", "--output",
                                   f"{folder}/{path.stem}"], text=True, capture_output=True)
            print(f"{path.stem}: overlaps took {done.stdout.splitlines()[-1]}", flush=True)


def keep(picture: Path, path: Path) -> None:
    """A smaller copy of a picture, in 256 colours and without its white margins."""
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    drawn = image.convert("L").point(lambda shade: 255 * (shade < 250)).getbbox()
    image = ImageOps.expand(image.crop(drawn), MARGIN, "white")
    image.thumbnail((WIDEST, WIDEST), Image.Resampling.LANCZOS)
    image.quantize(dither=Image.Dither.NONE).save(path, optimize=True)


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
        colours = np.vstack([colormaps["viridis"](np.linspace(0.0, 1.0, shades))[:, :3],
                             np.linspace(0.0, 1.0, GREYS)[:, None].repeat(3, axis=1)])
        palette = Image.new("P", (1, 1))
        palette.putpalette(np.rint(255 * colours).astype(np.uint8).tobytes())
        first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
        first.save(path, save_all=True, append_images=others, loop=0, duration=few * pause, optimize=True)
        if path.stat().st_size <= BYTES:
            break


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [exhibit.name for exhibit in EXHIBITS]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "figures")
    parser.add_argument("--overlaps", action="store_true", help="print the time for overlaps, draw nothing")
    asked = parser.parse_args()
    if asked.overlaps:
        return overlaps([exhibit for exhibit in EXHIBITS if exhibit.name in asked.only])
    asked.output.mkdir(parents=True, exist_ok=True)
    wrong = False
    for exhibit in EXHIBITS:
        if exhibit.name in asked.only:
            try:
                print(show(exhibit, asked.output), flush=True)
            except ValueError as error:
                wrong = True
                print(error, file=sys.stderr)
    sys.exit(wrong)


if __name__ == "__main__":
    main()
