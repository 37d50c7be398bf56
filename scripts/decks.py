#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Decks of CalculiX's own test suite, imported, solved and compared with their reference displacements.

The suite is Debian's package calculix-ccx-test; --suite names the folder of another copy. Where a deck has no reference
displacements, CalculiX itself (ccx) computes them, if it is installed. Writes to --output decks.csv, a line per deck,
so that an interrupted study continues, decks.md, scenes and results; without --only the page goes to docs/tables/, too.
"""

from __future__ import annotations

import gzip
import re
import shutil
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np
from experiment import Ledger, Row, arguments, publish, table, where
from mpi4py import MPI
from peers import nodal
from scipy.spatial import cKDTree

from ddmpi.decks.cards import DeckError
from ddmpi.decks.deck import STRIDE, flattened
from ddmpi.decks.scene import Importer, import_deck
from ddmpi.errors import DdmpiError
from ddmpi.results.tables import read_results

SUITE = Path("/usr/share/doc/calculix-ccx-test/examples/test")

LARGEST, NODAL = 0.03, 0.05
"""A deck agrees if its largest displacement and its nodal error are within these."""

LIMIT = 600
"""Longest time of a run (s)."""

OTHER = frozenset(
    (
        "PLASTIC",
        "DYNAMIC",
        "HEATTRANSFER",
        "HYPERELASTIC",
        "HYPERFOAM",
        "FREQUENCY",
        "BUCKLE",
        "CREEP",
        "VISCO",
        "CYCLICSYMMETRYMODEL",
        "GREEN",
        "SUBSTRUCTUREGENERATE",
        "SENSITIVITY",
        "MODALDYNAMIC",
        "STEADYSTATEDYNAMICS",
        "COUPLEDTEMPERATURE-DISPLACEMENT",
        "ELECTROMAGNETICS",
        "UNCOUPLEDTEMPERATURE-DISPLACEMENT",
        "CFD",
        "COMPLEXFREQUENCY",
        "NOANALYSIS",
        "DEFORMATIONPLASTICITY",
        "CYCLICHARDENING",
        "DEPVAR",
        "USERMATERIAL",
    )
)
"""Keywords of other physics."""

SOLIDS = re.compile(r"(C3D(4|6|8|10|15|20)(R|I|RI|T)?|(CAX|CPE|CPS)\d+R?)$")
"""Elements of statics of solids."""

GIVEN = {"beamuamp": ["QUADRATIC=0,0,0.5,0.25,1,1"]}
"""Amplitudes of routines of a user, which a deck does not have: as `--amplitude` of `ddmpi import` gives them."""

GLOBAL = re.compile(r"^\*NODE *PRINT.*GLOBAL *= *YES", re.IGNORECASE | re.MULTILINE)
"""A deck that prints along x, y and z."""

HARD = 100
"""CalculiX's contact is a penalty; where a deck differs, it is compared with this many times the stiffness, too."""

LINEAR = re.compile(
    r"(\*SURFACE *BEHAVIOR, *PRESSURE-OVERCLOSURE *= *LINEAR *\n\s*)([\d.EeDd+-]+)", re.IGNORECASE
)
"""The stiffness of linear contact in a deck."""


def unpacked(suite: Path, folder: Path) -> list[Path]:
    """The decks of the suite and their references, as plain files in a folder."""
    for path in suite.iterdir():
        if path.suffix == ".gz":
            (folder / path.stem).write_bytes(gzip.decompress(path.read_bytes()))
        elif path.is_file():
            shutil.copyfile(path, folder / path.name)
    return sorted(folder.glob("*.inp"))


def is_static(deck: Path) -> bool:
    """Whether a deck computes the statics of solids, and has no constraints between nodes."""
    try:
        cards, _ = flattened(deck)
    except DeckError:  # of which `tried` tells
        return False
    words = {card.word for card in cards}
    types = {card.given.get("TYPE", "").upper() for card in cards if card.word == "ELEMENT"}
    return (
        bool(types)
        and all(SOLIDS.match(kind) for kind in types)
        and "STATIC" in words
        and not words & (OTHER | {"EQUATION", "MPC", "SUBMODEL"})
    )


def printed(deck: Path) -> dict[int, list[float]]:
    """The displacements by node at the last time that the reference of a deck has."""
    found: dict[float, dict[int, list[float]]] = {}
    own: dict[int, list[float]] | None = None
    for line in deck.with_suffix(".dat.ref").read_text(errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["displacements"]:
            own = found.setdefault(float(words[-1]), {})
        elif words and not words[0].isdigit():
            own = None
        elif own is not None and len(words) == 4:
            own[int(words[0])] = [float(word) for word in words[1:]]
    return found[max(found)] if found else {}


def along_axes(importer: Importer, node: int, u: list[float], text: str) -> list[float]:
    """A displacement that the deck prints, along x, y and z: at nodes of a *TRANSFORM it is along theirs."""
    if node not in importer.model.transforms or GLOBAL.search(text):
        return u
    return list(sum(value * importer.acts.way(node, k) for k, value in enumerate(u, start=1)))


def stiffer(text: str) -> str:
    """A deck with stiffnesses of linear contact that are HARD times as large."""
    return LINEAR.sub(lambda match: f"{match[1]}{HARD * float(match[2]):g}", text)


def static_part(text: str) -> str:
    """A deck up to the end of its last static step."""
    steps = re.split(r"^(?=\*STEP)", text, flags=re.MULTILINE | re.IGNORECASE)
    static = [
        k
        for k, step in enumerate(steps)
        if re.search(r"^\*STATIC", step, re.MULTILINE | re.IGNORECASE)
    ]
    return "".join(steps[: static[-1] + 1])


def computed(deck: Path, text: str, folder: Path) -> dict[int, list[float]]:
    """The displacements by node at the end, by CalculiX; none where it is not there or fails."""
    if not shutil.which("ccx"):
        return {}
    at = [
        match.start() for match in re.finditer(r"^\*END *STEP", text, re.MULTILINE | re.IGNORECASE)
    ][-1:]
    for k in at:
        (folder / deck.name).write_text(text[:k] + "*NODE FILE\nU\n" + text[k:])
    try:
        subprocess.run(
            ["ccx", deck.stem], cwd=folder, capture_output=True, timeout=LIMIT, check=False
        )
        nodes, u = nodal(
            (folder / deck.with_suffix(".frd").name).read_text(errors="replace"), "DISP"
        )
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return {}
    return dict(zip(nodes, u.tolist(), strict=True))


def compared(
    deck: Path, scene: Path, reference: dict[int, list[float]]
) -> tuple[float, float, float]:
    """The largest displacement, that of the reference, and the nodal error, of the nodes that both have."""
    results = read_results(scene / "results")
    fields, importer = results.fields, Importer(deck, GIVEN.get(deck.stem, []))
    ours, theirs = [], []
    for number, piece in enumerate(importer.pieces):
        cells = fields["cells"][fields["body"] == number]
        own = np.unique(cells[cells >= 0])
        place = cKDTree(fields["points"][own][:, : piece.points.shape[1]]).query(piece.points)[1]
        for node, u in zip(piece.nodes.tolist(), fields["displacement"][own][place], strict=True):
            # a node at the section of a bolt is that of one body in the reference
            if node % STRIDE in reference and importer.acts.home[node] is piece:
                ours.append(u[: piece.points.shape[1]])
                theirs.append(reference[node % STRIDE][: piece.points.shape[1]])
    a, b = np.array(ours), np.array(theirs)
    if not len(a):
        return np.nan, np.nan, np.nan
    sizes = [float(np.linalg.norm(u, axis=1).max()) for u in (a, b)]
    return sizes[0], sizes[1], float(np.linalg.norm(a - b) / (np.linalg.norm(b) or 1.0))


def judged(deck: Path, scene: Path, reference: dict[int, list[float]]) -> tuple[bool, str]:
    """Whether a solved deck agrees with displacements, and words."""
    size, right, error = compared(deck, scene, reference)
    if not right:
        return size == 0.0, f"largest displacement {size:.3g} for {right:g}"
    return abs(size - right) <= LARGEST * right and error <= NODAL, (
        f"largest displacement {size:.4g} for {right:.4g} ({100 * (size / right - 1):+.1f} %), nodal error "
        f"{100 * error:.1f} % of {len(reference)} nodes"
    )


def tried(deck: Path, folder: Path) -> tuple[str, str]:
    """How a deck ends, and words."""
    scene, text = folder / deck.stem, deck.read_text(errors="replace")
    try:
        import_deck(deck, scene, amplitudes=GIVEN.get(deck.stem, []))
    except DdmpiError as error:
        lines = str(error).replace(f"{deck}: ", "").splitlines()
        return "refused", lines[min(1, len(lines) - 1)].strip()
    except Exception:
        return "traceback", traceback.format_exc().splitlines()[-1]
    try:
        run = subprocess.run(
            [
                sys.executable,
                "-P",
                "-m",
                "ddmpi",
                "run",
                str(scene / "scene.toml"),
                "--output",
                str(scene / "results"),
                "--no-figures",
                "--quiet",
            ],
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "not solved", f"not within {LIMIT} s"
    if run.returncode:
        return "not solved", run.stderr.strip().splitlines()[-1][:200].replace(str(folder), "")
    importer = Importer(deck, GIVEN.get(deck.stem, []))
    pieces = importer.pieces
    nodes = {node % STRIDE for piece in pieces for node in piece.nodes.tolist()}
    reference = {
        node: along_axes(importer, node, u, text)
        for node, u in printed(deck).items()
        if node in nodes
    }
    if importer.model.left_out:  # the last displacements are modes of the steps that are left out
        text, reference = static_part(text), {}
    if not any(any(u) for u in reference.values()):
        reference = computed(deck, text, scene)
    if not reference:
        return "no reference", ""
    agrees, words = judged(deck, scene, reference)
    if not agrees and stiffer(text) != text:
        hard, others = judged(deck, scene, computed(deck, stiffer(text), scene) or reference)
        agrees, words = hard, f"{words}; with contact {HARD} times as stiff in CalculiX: {others}"
    return "agrees" if agrees else "differs", words


def write_page(rows: list[Row], folder: Path, complete: bool) -> None:
    """docs/tables/decks.md, which also has why decks differ."""
    rows = sorted(rows, key=lambda row: row["deck"])
    counts = [
        [end or "all", *(len(some) for some in (of, where(of, static=True)))]
        for end in [*sorted({row["end"] for row in rows}), ""]
        for of in [where(rows, end=end) if end else rows]
    ]
    publish(
        "decks.md",
        {
            "Ends": table(("end", "decks", "static ones"), counts),
            "Decks": table(
                ("deck", "static", "end", "details, or the line that is not possible"),
                (
                    (
                        row["deck"],
                        "yes" if row["static"] else "",
                        row["end"],
                        row["words"].replace("*", "\\*"),
                    )
                    for row in rows
                ),
            ),
        },
        folder,
        complete,
    )


def main() -> None:
    parser = arguments(__doc__, "decks")
    parser.add_argument("--suite", type=Path, default=SUITE, help="folder of the decks")
    parser.add_argument(
        "--only", default="", help="decks with this word in their names; writes no page"
    )
    options = parser.parse_args()
    if not options.suite.is_dir():
        sys.exit(
            f"{options.suite} is not there: apt-get install calculix-ccx-test, or name a copy by --suite"
        )
    ledger = Ledger(
        MPI.COMM_SELF, options.output / "decks.csv", ("deck",), ("static", "end", "words")
    )
    with tempfile.TemporaryDirectory() as name:
        decks = {
            deck.stem: deck
            for deck in unpacked(options.suite, Path(name))
            if options.only in deck.stem
        }

        def measure(stem: str) -> Row:
            end, words = tried(decks[stem], options.output)
            return {"static": is_static(decks[stem]), "end": end, "words": words}

        rows = ledger.fill([(stem,) for stem in decks], measure)
    write_page(rows, options.output, not options.only)


if __name__ == "__main__":
    main()
