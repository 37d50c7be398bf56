#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Mutated files: scenes, decks, meshes, drawings, checkpoints and results that somebody has damaged, or worse.

Of each file one copy is mutated by a seeded generator: bytes flipped or zeroed, the end cut off, lines doubled, left
out or exchanged, numbers replaced by 0, -1, 1e300, nan or huge integers, names by others, entries removed. The command
that reads it runs in a child with a limit of time and memory. Counts how the commands end. Exit code 1 if one ends with
a traceback or by a signal: any content has an answer or one message with its exit code.
"""

import contextlib
import io
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from experiment import ROOT, arguments, table  # isort: skip, with which the helpers of the tests can be imported

import made_up
import meshio
import numpy as np
import scenes
from mpi4py import MPI

from ddmpi.cli import main as cli
from ddmpi.results import checkpoint
from ddmpi.system import logs

LIMIT, MEMORY = 30.0, 6 << 30
"""Seconds and bytes that a command may take; a number of a scene may ask for more, which is no fault."""

NUMBERS = re.findall(
    r"\S+",
    "0 -1 1 2 3 0.5 1e300 -1e300 1e-300 nan inf 1e13 99999999999999999999 4294967296 -2147483648",
)

NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+(\.\d*)?([eE][-+]?\d+)?(?![\w.])")

NAME = re.compile(rb"[A-Za-z_][\w-]*")

ENDS = ("0", "2", "3", "4", "5", "6", "traceback", "signal", "time")

WRONG = ("traceback", "signal")


@dataclass(frozen=True)
class Specimen:
    """A folder of files, those that are mutated, and the commands that read them; {} stands for the folder."""

    kind: str
    folder: Path
    files: list[str]
    commands: list[list[str]]
    sealed: bool = False  # a checkpoint, whose digest half of the mutants have right


# Mutations


def flip(data: bytearray, random: Random) -> None:
    for _ in range(random.choice((1, 1, 2, 5, 20))):
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)


def scribble(data: bytearray, random: Random) -> None:
    """Numbers of four or eight bytes, where the headers of binary files have lengths and places."""
    width = random.choice((1, 2, 4, 8))
    at = random.randrange(max(1, len(data) - width))
    value = random.choice(
        (0, 1, (1 << 8 * width) - 1, 1 << (8 * width - 1), random.getrandbits(8 * width))
    )
    data[at : at + width] = value.to_bytes(width, "little")


def cut(data: bytearray, random: Random) -> None:
    del data[random.randrange(len(data)) :]


def hole(data: bytearray, random: Random) -> None:
    at, size = random.randrange(len(data)), random.choice((1, 8, 100, 1000))
    data[at : at + size] = bytes(len(data[at : at + size])) if random.random() < 0.5 else b""


def lines(data: bytearray, random: Random) -> None:
    """A line twice, left out, or in the place of another one."""
    rows = bytes(data).split(b"\n")
    a, b = random.randrange(len(rows)), random.randrange(len(rows))
    match random.randrange(4):
        case 0:
            rows.insert(b, rows[a])
        case 1:
            del rows[a : a + random.choice((1, 1, 1, 5))]
        case 2:
            rows[a], rows[b] = rows[b], rows[a]
        case 3:
            rows[a] = rows[a][: random.randrange(len(rows[a]) + 1)]
    data[:] = b"\n".join(rows)


def replaced(
    pattern: re.Pattern[bytes], choose: Callable[[list[bytes], Random], bytes]
) -> Callable:
    """A mutation of one or several places that match a pattern."""

    def mutate(data: bytearray, random: Random) -> None:
        found = list(pattern.finditer(bytes(data)))
        words = [match[0] for match in found]
        for match in sorted(
            random.sample(found, min(len(found), random.choice((1, 1, 1, 3)))),
            key=lambda match: -match.start(),
        ):
            data[match.start() : match.end()] = choose(words, random)

    return mutate


def another(words: list[bytes], random: Random) -> bytes:
    return random.choice((random.choice(words), b"other", b"", "fü".encode(), b"../a", b"a" * 300))


def entries(data: bytearray, random: Random) -> None:
    """An entry of JSON removed, or of another type; where the data are none, a line."""
    try:
        whole = json.loads(bytes(data))
    except ValueError:
        lines(data, random)
        return
    inner, depth = whole, random.randint(1, 5)
    while isinstance(inner, dict | list) and inner:
        key = random.choice(list(inner) if isinstance(inner, dict) else range(len(inner)))
        depth -= 1
        if depth <= 0 or not (isinstance(inner[key], dict | list) and inner[key]):
            if random.random() < 0.4:
                del inner[key]
            else:
                odd = (
                    None,
                    True,
                    7,
                    -1.5,
                    "word",
                    [],
                    [1],
                    [[None]],
                    {},
                    {"a": None},
                    "../x",
                    10**400,
                    float("nan"),
                )
                inner[key] = random.choice(odd)
            break
        inner = inner[key]
    data[:] = json.dumps(whole).encode()


OF_BYTES = (flip, scribble, cut, hole)
OF_TEXT = (
    lines,
    lines,
    replaced(NUMBER, lambda words, random: random.choice(NUMBERS).encode()),
    replaced(NUMBER, lambda words, random: random.choice(words)),
    replaced(NAME, another),
    entries,
)


def mutated(content: bytes, random: Random) -> bytes:
    """A mutant of a file's content; of text the mutations are mostly those of text."""
    if not content:
        return b"\0"
    data, text = bytearray(content), b"\0" not in content
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if data:
            random.choice(OF_TEXT if text and random.random() < 0.8 else OF_BYTES)(data, random)
    return bytes(data)


def seal(data: bytes) -> bytes:
    """A checkpoint's content with the digest that it should have."""
    rest = data[checkpoint.BLOCK :]
    return checkpoint._head(rest) + rest


# Specimens


MIXED = """
title = "everything"
[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0.0, 1.0], size = [3.0, 1.0], divisions = [4, 2] }
material = { young = 2.1e11, poisson = 0.3, expansion = 1e-5 }
clamp = [{ on = "left", x = 0.0, y = { constant = 1e-6, y_slope = 1e-6 } }]
traction = [{ on = "top", value = ["1e6 * sin(x)", -6.0e7], history = "load" }]
temperature = "20 + x"
[[body]]
name = "lower"
mesh = { shape = "rectangle", size = [3.0, 1.0], divisions = [3, 2] }
material = { young = 2.1e11, poisson = 0.3 }
foundation = [{ on = "bottom", normal = 1e12, tangential = 1e12 }]
volume_force = [0.0, -7.8e4]
[[rigid]]
name = "disc"
shape = "circle"
center = [1.5, 3.0]
radius = 1.0
displacement = [0.0, -1e-4]
[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.3 }
[[contact]]
bodies = ["upper", "disc"]
on = ["top"]
[history.load]
times = [0.0, 1.0, 2.0]
factors = [0.0, 1.0, 0.0]
[time]
points = [1.0, 2.0]
steps = 2
[method]
tolerance = 1e-8
max_iterations = 40
[output]
figures = false
stress_unit = "MPa"
[checkpoint]
iterations = 1
[petsc]
newton_ksp_gmres_restart = 30
"""

STEPPED = re.sub(r"(?s)\[petsc\].*", "", MIXED)

PLATE = """Point(1) = {0, 0, 0, 0.5}; Point(2) = {2, 0, 0, 0.5}; Point(3) = {2, 1, 0, 0.5}; Point(4) = {0, 1, 0, 0.5};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1};
Physical Curve("top") = {3};
Physical Surface("body") = {1};
"""

SOLID = (
    PLATE.partition("Physical")[0]
    + """Extrude {0, 0, 1} { Surface{1}; }
Physical Surface("bottom") = {13};
Physical Surface("top") = {21};
Physical Volume("body") = {1};
"""
)

GMSH = """
import gmsh
gmsh.initialize([], readConfigFiles=False)
gmsh.open({drawn!r})
gmsh.model.mesh.generate(3)
gmsh.option.setNumber("Mesh.MshFileVersion", {version})
gmsh.option.setNumber("Mesh.Binary", {binary})
gmsh.write({path!r})
"""

RUN = ["--no-figures", "--output", "{}/out"]


def on_floor(**mesh) -> dict:
    """A plate of any mesh that is pressed on a rigid floor."""
    plate = {
        "name": "plate",
        "mesh": mesh,
        "material": dict(scenes.STEEL),
        "clamp": [{"on": "top", "x": 0.0, "y": -1e-4}],
    }
    return {
        "body": [plate],
        "rigid": [dict(scenes.FLOOR)],
        "contact": [{"bodies": ["plate", "floor"], "on": ["bottom"]}],
        "method": {"max_iterations": 40},
        "output": {"figures": False},
    }


def plate(space: bool = False) -> meshio.Mesh:
    """A plate of triangles, or of tetrahedra, with its bottom and top as groups in the words of gmsh and of MED."""
    xyz = np.array(
        [[x, y, z] for z in range(1 + space) for y in (0.0, 0.5, 1.0) for x in range(3)], float
    )
    squares = [3 * y + x + np.array([0, 1, 4, 3]) for y in (0, 1) for x in (0, 1)]
    sides = {1: [[0, 1], [1, 2]], 2: [[6, 7], [7, 8]]}
    if space:
        cells = [("hexahedron", np.array([[*square, *(square + 9)] for square in squares]))]
        sides = {tag: [[a, b, b + 9, a + 9] for a, b in pairs] for tag, pairs in sides.items()}
    else:
        cells = [
            (
                "triangle",
                np.array(
                    [[s[i] for i in half] for s in squares for half in ((0, 1, 2), (0, 2, 3))]
                ),
            )
        ]
    cells.append(("quad" if space else "line", np.array(sides[1] + sides[2])))
    tags = [np.full(len(cells[0][1]), 3, np.int32), np.array([1, 1, 2, 2], np.int32)]
    mesh = meshio.Mesh(xyz, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags})
    d = 2 + space
    mesh.field_data = {
        "bottom": np.array([1, d - 1]),
        "top": np.array([2, d - 1]),
        "body": np.array([3, d]),
    }
    return mesh


INP = """*NODE
{nodes}
*ELEMENT, TYPE=CPE3, ELSET=body
{cells}
*NSET, NSET=bottom
1, 2, 3
*NSET, NSET=top
7, 8, 9
"""


def write_mesh(path: Path, form: str, space: bool) -> None:
    """The plate in a format: its ending, for MSH version and whether it is binary."""
    mesh = plate(space)
    match form.split():
        case ["inp"]:
            rows = [
                "\n".join(", ".join(map(str, (k, *row))) for k, row in enumerate(of, 1))
                for of in (mesh.points[:, :2].tolist(), (mesh.cells[0].data + 1).tolist())
            ]
            path.write_text(INP.format(nodes=rows[0], cells=rows[1]))
        case ["msh", version, binary]:
            drawn = path.with_name("drawn.geo")
            drawn.write_text(SOLID if space else PLATE)
            code = GMSH.format(
                drawn=str(drawn), path=str(path), version=version, binary=int(binary == "binary")
            )
            subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True)
            drawn.unlink()
        case ["med"]:
            groups = [-tag for tag in mesh.cell_data["gmsh:physical"]]
            mesh.cell_data, mesh.field_data = {"cell_tags": groups}, {}
            mesh.cell_tags = {-1: ["bottom"], -2: ["top"], -3: ["body"]}
            meshio.med.write(path, mesh)
        case [ending]:
            numbers = mesh.cell_data["gmsh:physical"]
            mesh.cell_data, mesh.field_data = {"CellEntityIds": numbers}, {}
            getattr(meshio, ending).write(path, mesh, binary=ending == "vtk")


def made(folder: Path, wanted: Callable[[str], bool]) -> list[Specimen]:
    """All specimens of the kinds that are wanted, in folders of their own."""
    found = []

    def place(kind: str, name: str) -> Path:
        path = folder / f"{kind} {name}".replace(" ", "_")
        path.mkdir()
        return path

    def scene(path: Path, content: dict | str) -> list[str]:
        text = content if isinstance(content, str) else scenes.to_toml(content)
        (path / "scene.toml").write_text(text, encoding="utf-8")
        return ["run", "{}/scene.toml", *RUN]

    for name, content in {
        "mixed": MIXED,
        "blocks": scenes.pinched_blocks(1),
        "punch": (ROOT / "configs" / "two_boxes.toml").read_text(encoding="utf-8"),
        "ring": (ROOT / "configs" / "press_fit.toml").read_text(encoding="utf-8"),
    }.items():
        if not wanted("scene"):
            break
        path = place("scene", name)
        run = scene(path, content)
        found.append(
            Specimen(
                "scene",
                path,
                ["scene.toml"],
                [run, ["check", *run[1:]]][:: 1 if name != "punch" else -1],
            )
        )
    for deck in [
        *(ROOT / "configs" / "decks").glob("*.inp"),
        *(ROOT / "tests" / "decks").glob("*.inp"),
    ]:
        if not wanted("deck"):
            break
        path = place("deck", deck.stem)
        shutil.copy(deck, path / "deck.inp")
        found.append(
            Specimen(
                "deck",
                path,
                ["deck.inp"],
                [
                    ["import", "{}/deck.inp", "--output", "{}/new", *partial]
                    for partial in ([], ["--partial"])
                ],
            )
        )
    for form in (
        "msh 4.1 text",
        "msh 4.1 binary",
        "msh 2.2 text",
        "msh 2.2 binary",
        "vtu",
        "vtk",
        "med",
        "inp",
    ):
        if not wanted(f"mesh {form.split()[0]}"):
            continue
        for space in (False, True)[: 1 if form == "inp" else 2]:
            path = place(f"mesh {form}", "space" if space else "plane")
            name = f"plate.{form.split()[0]}"
            write_mesh(path / name, form, space)
            content = on_floor(file=name)
            if form in ("vtu", "vtk"):
                content["body"][0]["clamp"][0]["on"], content["contact"][0]["on"] = "2", ["1"]
            if space:
                content["rigid"][0] |= {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}
                content["body"][0]["clamp"][0]["z"] = 0.0
            found.append(Specimen(f"mesh {name[6:]}", path, [name], [scene(path, content)]))
    if wanted("drawing"):
        path = place("drawing", "geo")
        (path / "plate.geo").write_text(PLATE)
        run = scene(path, on_floor(geometry="plate.geo", size=0.5))
        found.append(Specimen("drawing", path, ["plate.geo"], [run]))
    written = {"checkpoint": _checkpoints, "results": _results, "sweep": _sweeps}
    return [
        *found,
        *(each for kind in written if wanted(kind) for each in written[kind](place, scene)),
    ]


def _checkpoints(place: Callable, scene: Callable) -> list[Specimen]:
    """Specimens that runs write before their end."""
    found = []
    remove = checkpoint.Checkpoints.remove
    for name, content in {"steps": STEPPED, "blocks": scenes.pinched_blocks(2)}.items():
        path = place("checkpoint", name)
        run = scene(
            path,
            content if isinstance(content, str) else content | {"checkpoint": {"iterations": 1}},
        )
        checkpoint.Checkpoints.remove = lambda self: None
        command(run, path)
        checkpoint.Checkpoints.remove = remove
        (path / "out" / "checkpoint.h5").rename(path / "checkpoint.h5")
        shutil.rmtree(path / "out")
        restart = [*run[:2], "--no-figures", "--output", "{}/out", "--restart", "{}"]
        found.append(Specimen("checkpoint", path, ["checkpoint.h5"], [restart], sealed=True))
    return found


def _results(place: Callable, scene: Callable) -> list[Specimen]:
    """Specimens that runs write at their end."""
    found = []
    for name, content in {
        "steps": STEPPED,
        "solids": (ROOT / "configs" / "two_boxes.toml").read_text(encoding="utf-8"),
    }.items():
        path = place("results", name)
        command(scene(path, content), path)
        for child in (path / "out").iterdir():
            child.rename(path / child.name)
        command(["view", "{}"], path)
        files = [
            file.name
            for file in path.iterdir()
            if file.is_file() and file.suffix not in (".toml", ".png")
        ]
        ends = (
            ["--from", "0,1.1", "--to", "3,1.9"]
            if name == "steps"
            else ["--from", "0,0,0", "--to", "1,1,1"]
        )
        found.append(
            Specimen(
                "results", path, files, [["report", "{}"], ["view", "{}"], ["path", "{}", *ends]]
            )
        )
    path = place("results", "drawn")
    made_up.results(path, divisions=(6, 2))
    files = [file.name for file in path.iterdir() if file.is_file()]
    found.append(
        Specimen("results", path, files, [["report", "{}"], ["figures", "{}"], ["view", "{}"]])
    )
    return found


def _sweeps(place: Callable, scene: Callable) -> list[Specimen]:
    """A specimen that a sweep writes."""
    path = place("sweep", "blocks")
    scene(path, scenes.pinched_blocks(1))
    vary = ["sweep", "{}/scene.toml", "--vary", "method.tolerance=1e-6,1e-8", "--output", "{}"]
    (path / "scene.toml").rename(path / "kept.toml")
    vary[1] = "{}/kept.toml"
    command([*vary[:-1], "{}/swept"], path)
    files = [
        str(file.relative_to(path))
        for file in sorted((path / "swept").rglob("*"))
        if file.suffix in (".csv", ".json")
    ]
    commands = [
        ["report", "{}/swept"],
        ["sweep-plot", "{}/swept", "n_A:tolerance"],
        [*vary[:-1], "{}/swept", "--gather"],
    ]
    return [Specimen("sweep", path, files, commands)]


# Runs


def command(words: list[str], folder: Path) -> int:
    """A command in this process, with its words on standard error."""
    own, petsc = cli.split_arguments([word.replace("{}", str(folder)) for word in words])
    code = cli._main(MPI.COMM_SELF, own, petsc)
    logs.close()
    return code


def child(words: list[str], folder: Path) -> None:
    """A command in a child, which ends with its exit code, or 99 after a traceback."""
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    sys.stdout, sys.stderr = (
        io.TextIOWrapper(os.fdopen(number, "wb", 0), write_through=True) for number in (1, 2)
    )
    os.chdir(folder)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1):
        signal.signal(number, signal.SIG_DFL)
    try:
        code = command(words, folder)
    except BaseException:
        traceback.print_exc()
        code = 99
    os._exit(code)


@dataclass
class Job:
    """A mutant whose command runs."""

    number: int
    kind: str
    file: str
    words: list[str]
    folder: Path
    process: int = 0
    begun: float = field(default_factory=time.monotonic)

    def ended(self) -> str:
        """How it has ended; empty while it runs."""
        done, status = os.waitpid(self.process, os.WNOHANG)
        if not done and time.monotonic() - self.begun < LIMIT:
            return ""
        if not done:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process, signal.SIGKILL)
            os.waitpid(self.process, 0)
            return "time"
        code = os.waitstatus_to_exitcode(status)
        if code < 0:
            return "signal"
        return str(code) if str(code) in ENDS else "traceback"

    def words_of_end(self, lines: int = 3) -> str:
        said = (
            (self.folder / "said").read_text(encoding="utf-8", errors="replace").strip().split("\n")
        )
        return "\n    ".join(line[:200] for line in said[-lines:])


def whole(specimens: list[Specimen], place: Path) -> None:
    """Raise RuntimeError unless each command ends well on files that nobody has mutated."""
    for k, specimen in enumerate(specimens):
        for words in specimen.commands:
            folder = place / f"whole{k}"
            shutil.copytree(specimen.folder, folder)
            job = forked(Job(k, specimen.kind, "", words, folder))
            while not (end := job.ended()):
                time.sleep(0.01)
            if end != "0":
                raise RuntimeError(f"{specimen.folder.name}: {words}: {end}: {job.words_of_end()}")
            shutil.rmtree(folder)


def forked(job: Job) -> Job:
    """The job, with its command in a child."""
    sys.stdout.flush()
    job.process = os.fork()
    if job.process == 0:
        child(job.words, job.folder)
    return job


def start(number: int, seed: int, specimens: list[Specimen], place: Path) -> Job:
    """Mutate a file of a specimen, and start its command; which ones follow from seed and number alone."""
    random = Random(f"{seed} {number}")
    specimen = specimens[number % len(specimens)]
    file, words = random.choice(specimen.files), random.choice(specimen.commands)
    folder = place / str(number)
    shutil.copytree(specimen.folder, folder)
    content = mutated((folder / file).read_bytes(), random)
    if specimen.sealed and random.random() < 0.8:
        content = seal(content)
    (folder / file).write_bytes(content)
    return forked(Job(number, specimen.kind, file, words, folder))


def main() -> int:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the generator (default: 1)")
    parser.add_argument("--count", type=int, default=200, help="how many files (default: 200)")
    parser.add_argument(
        "--only", type=int, help="the mutant of this number alone, and what its command says"
    )
    parser.add_argument(
        "--kinds", default="", help="words of which a kind has one, such as mesh,sweep"
    )
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="children at a time"
    )
    parser.add_argument("--keep", type=Path, help="new folder for the mutants that end wrongly")
    options = parser.parse_args()
    ends: dict[str, Counter[str]] = defaultdict(Counter)
    wrong, begun = 0, time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "specimens").mkdir()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            specimens = made(
                place / "specimens",
                lambda kind: any(word in kind for word in options.kinds.split(",")),
            )
        whole(specimens, place)
        left = [options.only] if options.only is not None else list(range(options.count))
        jobs: list[Job] = []
        while left or jobs:
            while left and len(jobs) < options.workers:
                jobs.append(start(left.pop(0), options.seed, specimens, place))
            for job in [*jobs]:
                if not (end := job.ended()):
                    continue
                jobs.remove(job)
                ends[job.kind][end] += 1
                if end in WRONG or end == "time" or options.only is not None:
                    print(
                        f"{job.number}: {end}: {job.kind}, {job.file}, {' '.join(job.words)}\n    "
                        f"{job.words_of_end(40 if options.only is not None else 3)}",
                        flush=True,
                    )
                if end in WRONG:
                    wrong += 1
                    if options.keep:
                        shutil.copytree(job.folder, options.keep / str(job.number))
                shutil.rmtree(job.folder, ignore_errors=True)
            time.sleep(0.002)
    rows = [(kind, sum(of.values()), *(of[end] or "" for end in ENDS)) for kind, of in ends.items()]
    totals = [
        "all",
        sum(row[1] for row in rows),
        *(sum(of[end] for of in ends.values()) or "" for end in ENDS),
    ]
    print(*table(("file", "number", *ENDS), [*rows, totals]), sep="\n")
    print(
        f"seed {options.seed}, {totals[1]} files in {time.monotonic() - begun:.0f} s; {wrong} with a traceback or signal"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
