"""An assembly of 18 parts, as CAD would write it: two plates, four bolts with nuts, two brackets screwed on, and a rod
with a tube and two nuts between these. Processor seconds of its import, and of the check of the scene that import writes.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

HEX = np.pi / 3 * np.arange(6)


def prism(occ, at: Sequence[float], corner: float, height: float) -> tuple[int, int]:
    """A hexagonal prism that stands on `at`, of the radius of its corners."""
    corners = [
        occ.addPoint(at[0] + corner * np.cos(a), at[1] + corner * np.sin(a), at[2]) for a in HEX
    ]
    lines = [occ.addLine(corners[k - 1], corners[k]) for k in range(6)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return next(each for each in occ.extrude([(2, face)], 0, 0, height) if each[0] == 3)


def bolt(occ, at: Sequence[float], radius: float, length: float) -> None:
    """A bolt, down from the underside `at` of its head."""
    head = prism(occ, at, 1.9 * radius, 1.4 * radius)
    occ.fuse([head], [(3, occ.addCylinder(*at, 0, 0, -length, radius))])


def nut(occ, at: Sequence[float], radius: float) -> tuple[int, int]:
    """A nut that stands on `at`."""
    body = prism(occ, at, 1.9 * radius, 1.6 * radius)
    return occ.cut([body], [(3, occ.addCylinder(*at, 0, 0, 1.6 * radius, radius))])[0][0]


def bracket(occ) -> tuple[int, int]:
    """An angle whose foot is on z = 20, with a hole in its foot and one in its wall."""
    foot = [(3, occ.addBox(10, -15, 20, 25, 30, 6))]
    angle, _ = occ.fuse(foot, [(3, occ.addBox(10, -15, 20, 6, 30, 42))])
    holes = [occ.addCylinder(25, 0, 19, 0, 0, 8, 3.3), occ.addCylinder(9, 0, 46, 8, 0, 0, 6.6)]
    return occ.cut(angle, [(3, hole) for hole in holes])[0][0]


def draw(path: Path) -> None:
    """Write the assembly."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ, corners = gmsh.model.occ, [(x, y) for x in (-50, 50) for y in (-30, 30)]
    for low in (0, 10):
        holes = [(3, occ.addCylinder(x, y, low, 0, 0, 10, 4.4)) for x, y in corners]
        if low:
            holes += [(3, occ.addCylinder(x, 0, 12, 0, 0, 8, 3)) for x in (-25, 25)]
        occ.cut([(3, occ.addBox(-60, -40, low, 120, 80, 10))], holes)
    for x, y in corners:
        bolt(occ, (x, y, 20), 4, 28)
        nut(occ, (x, y, -6.4), 4)
    for turn in (0.0, np.pi):
        occ.rotate([bracket(occ)], 0, 0, 0, 0, 0, 1, turn)
        bolt(occ, (25 * np.cos(turn), 0, 26), 3, 13)
    occ.addCylinder(-30, 0, 46, 60, 0, 0, 6)
    occ.cut(
        [(3, occ.addCylinder(-10, 0, 46, 20, 0, 0, 10))],
        [(3, occ.addCylinder(-10, 0, 46, 20, 0, 0, 6.6))],
    )
    for turn in (1.0, -1.0):
        made = nut(occ, (0, 0, 16), 6)
        occ.rotate([made], 0, 0, 0, 0, 1, 0, turn * np.pi / 2)
        occ.translate([made], 0, 0, 46)
    occ.synchronize()
    gmsh.write(str(path))
    gmsh.finalize()


def measure(*words: str) -> tuple[float, float, str]:
    """Processor and clock seconds of a command of ddmpi, with all that it starts, and what it says."""
    begun, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "ddmpi", *words], capture_output=True, text=True, check=False
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, time.monotonic() - begun, done.stdout + done.stderr


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", help="a folder for drawing and scene; left out, none is kept")
    parser.add_argument("--words", action="store_true", help="also print what the commands say")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(options.output or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        draw(folder / "assembly.step")
        os.environ["OMP_NUM_THREADS"] = "1"
        scene = folder / "made" / "scene.toml"
        print("| command | processor s | clock s |\n|---|---|---|")
        for name, words in (
            ("import", ["import", str(folder / "assembly.step"), "--output", str(scene.parent)]),
            ("check", ["check", str(scene), "--output", str(folder / "checked")]),
        ):
            spent, clock, said = measure(*words)
            print(f"| {name} | {spent:.1f} | {clock:.1f} |", flush=True)
            if options.words:
                print(said)
        text = scene.read_text(encoding="utf-8")
    print(
        f"\n{text.count('[[body]]')} parts, of which {text.count('copy = ')} are copies; "
        f"{text.count('[[contact]]')} contacts, of which {text.count('pretension = ')} are threads with a pretension"
    )


if __name__ == "__main__":
    main()
