"""What a run costs, before it begins: memory by rank, time by phase, disk, and a line for Slurm.

Mesh and assembly are measured, as a check makes both. All else is a count of operations, by laws that were fitted to
runs of the gallery and of larger bodies, over the speeds of this machine, which take 0.05 s to measure. Nobody knows
before how many iterations it takes: the outer method has a range, in which nine of ten scenes are.
"""

import json
import math
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ddmpi.body.compliance import bytes_in_words, memory_of_factors, memory_of_multigrid
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.pictures.bodies import ANIMATION
from ddmpi.run.gather import DRAWERS
from ddmpi.scene.results import wanted_errors
from ddmpi.scene.scene import Settled
from ddmpi.system.files import write_atomically
from ddmpi.system.provenance import peak_memory

MIB = 2.0**20

COSTS = "costs.json"
"""The numbers, in the folder of the pictures."""

PHASES = ("start", "mesh", "assembly", "factors", "outer", "recovery", "errors", "output")
"""Recovery includes the estimate of the discretization error and the warnings of the answer."""

REFERENCE = 4.7e-3, 60e9, 40e9
"""Speeds of the machine of the fits: seconds of `_count`, operations a second of a product of matrices, bytes a second
of a sum."""

STREAM = 8e9
"""Its bytes a second of products with factors and dense matrices."""

GROWTH = {2: 1.5, 3: 2.0}
FACTOR = {2: 10.0, 3: 20.0}
"""By dimension operations of factors over n to the power of their growth."""

CONDENSE = 1.1
"""Operations of C over k³."""

EASY = 0.75
"""Speed of factors over that of a product."""

EACH = {2: 2.5e-6, 3: 8e-6}, {2: 2.2e-6, 3: 7e-6}
"""By dimension seconds for each dof to order and to factor it, and to recover displacements and the error."""

NODE = {2: 150.0, 3: 190.0}
"""By dimension bytes of the fields of a load step for each node."""

CELL = {2: 95.0, 3: 105.0}
"""The same for each cell."""

WORK = {2: 1000.0, 3: 300.0}
"""By dimension bytes for each dof while errors are estimated and files written."""

FAR = 3.5e3
"""Bytes for each dof beyond these if bodies move far."""

FIRST = 12.0, 300.0
"""Products with the compliances, from a tenth to nine tenths of scenes, of the first load step."""

NEXT = 1.2, 46.0
"""The same of each load step after it."""

FEW = 20.0, 120.0
"""Of the first step where bodies have multigrid: models of their compliances save products."""

PUBLISHED = 12.0  # times as many, at most, by the published iterations

SHORT = 5e-3  # phases of fewer seconds are not told
LEGS = 1.0, 16.0  # load steps of a leg where time.tolerance chooses them


Range = tuple[float, float, float]
"""What is expected, and from where to where."""


class Speed(NamedTuple):
    """How much slower than the machine of the fits this one is: at Python, at products, and from memory."""

    python: float
    product: float
    memory: float


class Load(NamedTuple):
    """What of a body the costs depend on: dofs, contact unknowns, rows of C, nodes, cells, entries of A, the kind of
    compliance, whether an alike body before it has made that, and the bytes of its factors or multigrid, and of C."""

    dimension: int
    n: int
    k: int
    rows: int
    nodes: int
    cells: int
    entries: float
    kind: str
    made: bool
    solver: float
    dense: float


@dataclass(frozen=True)
class Costs:
    """Of a run on the ranks of a check.

    Attributes
    ----------
    memory : of each rank (bytes)
    seconds : of each phase of PHASES, of the slowest rank: what is expected, and from where to where
    disk : of the results (bytes)
    """

    memory: list[float]
    seconds: dict[str, Range]
    disk: float

    @property
    def total(self) -> Range:
        """Seconds of all phases."""
        expected, low, high = (sum(each) for each in zip(*self.seconds.values(), strict=True))
        return expected, low, high

    def slurm(self) -> str:
        """Options of sbatch: half as much again as the memory and the most time, and the two minutes for a checkpoint."""
        minutes = math.ceil(1.5 * self.total[2] / 60.0) + 2
        mebibytes = 100 * math.ceil(1.5 * sum(self.memory) / MIB / 100.0)
        return (
            f"--ntasks={len(self.memory)} --mem={mebibytes}M "
            f"--time={minutes // 60:02d}:{minutes % 60:02d}:00"
        )

    def lines(self, scene_path: str) -> Iterator[str]:
        """The costs in words."""
        memory = [bytes_in_words(size) for size in self.memory]
        if len(memory) > 1:
            alike = len(set(memory)) == 1
            memory = [f"{memory[0]} on each rank" if alike else f"{', '.join(memory)} by rank"]
        yield f"memory of a run: {memory[0]}"
        parts = [
            f"{phase} {_seconds(low, high)}"
            for phase, (_, low, high) in self.seconds.items()
            if high >= SHORT
        ]
        expected, low, high = self.total
        yield f"time of a run: about {expected:.2g} s ({_seconds(low, high)}): {', '.join(parts)}"
        yield f"disk for its results: {bytes_in_words(self.disk)}"
        yield f"in a batch: sbatch {self.slurm()} scripts/slurm/run.sbatch {shlex.quote(scene_path)}"

    def write(self, folder: Path) -> None:
        """Write COSTS into the folder. Not collective. Raises OutputError."""
        numbers = {
            "memory": [round(size) for size in self.memory],
            "seconds": {
                phase: [round(each, 3) for each in seconds]
                for phase, seconds in self.seconds.items()
            },
            "disk": round(self.disk),
            "slurm": self.slurm(),
        }
        write_atomically(folder / COSTS, json.dumps(numbers, indent=1).encode())


def _seconds(low: float, high: float) -> str:
    """A range of seconds, or one number."""
    one = f"{low:.2g}"
    other = f"{high:.2g}"
    return f"{one} s" if one == other else f"{one} to {other} s"


def measure_speed() -> Speed:
    """That of this process, in 0.05 s. Not collective."""
    matrix = np.ones((600, 600))
    vector = np.ones(2_000_000)
    python, product, memory = REFERENCE
    return Speed(
        _best(_count) / python,
        _best(lambda: matrix @ matrix) / (2.0 * 600.0**3 / product),
        _best(lambda: vector.sum()) / (vector.nbytes / memory),
    )


def _count() -> None:
    counts: dict[int, int] = {}
    for number in range(100_000):
        counts[number % 97] = counts.get(number % 97, 0) + number


def _best(work: Callable[[], object]) -> float:
    """The least processor seconds of three times."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return max(min(seconds), 1e-6)


def forecast(assembly: Assembly, measured: Mapping[str, float], drawn: bool) -> Costs:
    """The costs of a run on the ranks of an `assembly` that is not factored, whose phases mesh and assemble took as
    `measured` (s) on this rank, with pictures if they are `drawn`. Collective."""
    world = assembly.world
    scene = assembly.scene
    pictures = _pictures(scene) if drawn else (0, 0)
    steps = _steps(scene)
    made = _made(assembly.bodies)
    own = [_load(*each, scene.far) for each in zip(assembly.bodies, made, strict=True)]
    everyone = world.allgather((own, measure_speed(), dict(measured), peak_memory() * MIB))
    speed = Speed(*(max(each) for each in zip(*(rank[1] for rank in everyone), strict=True)))
    found = list[dict[str, Range]]()
    memory = list[float]()
    for rank, (loads, _, seconds, now) in enumerate(everyone):
        found.append(_serial(scene, loads, len(loads) + len(scene.contact), speed))
        met = [
            seconds["assemble"] + scene.far * MEET[scene.dimension] * speed.python * count
            for count in steps
        ]
        found[-1] |= {"mesh": _fixed(seconds["mesh"]), "assembly": _range(*met)}
        memory.append(now - CHECKED + _held(scene, loads) + PICTURED * (drawn and rank < DRAWERS))
    every = [load for rank in everyone for load in rank[0]]
    files = _output(every, pictures, speed)
    frame = drawn * speed.python * (0.06 + SHOW[scene.dimension] * sum(load.n for load in every))
    frames = [_frames(scene, count) for count in steps]
    memory[0] += drawn * FRAME * frames[1]
    found[0]["output"] = _range(*(files + frame * number for number in frames))
    slowest = {
        phase: max((rank[phase] for rank in found if phase in rank), key=lambda each: each[2])
        for phase in PHASES
    }
    return Costs(memory, slowest, _disk(scene, every) + PICTURE * sum(pictures))


CHECKED = 40 * MIB
"""Memory of the modules of a check alone (bytes)."""

PICTURED = 100 * MIB
"""Memory of matplotlib with its figures (bytes)."""

FRAME = 1.5e6
"""Memory of each picture of an animation (bytes)."""

PICTURE = 0.15e6
"""The file of a picture (bytes)."""


def _held(scene: Settled, loads: Sequence[Load]) -> float:
    """Bytes of what is made of bodies after their assembly."""
    more = FAR * scene.far
    return sum(
        load.solver * (not load.made) + load.dense + (WORK[load.dimension] + more) * load.n
        for load in loads
    )


def _made(bodies: Sequence[Body]) -> list[bool]:
    """Whether a body's direct solver is that of an alike one before it, with the same A and candidates."""
    found = set()
    made = list[bool]()
    for body in bodies:
        A = body.member.elasticity.A
        B = body.member.body.B
        alike = id(A), *(part.tobytes() for part in (B.indptr, B.indices, B.data))
        made.append(alike in found and body.member.body.kind != "iterative")
        found.add(alike)
    return made


def memory_of_solver(body: Body) -> float:
    """Bytes of the factors of a body, or of its multigrid."""
    member = body.member
    if member.body.kind == "iterative":
        return memory_of_multigrid(member.elasticity.A)
    dense = member.body.kind == "explicit"
    return memory_of_factors(member.elasticity.A.size[0], body.mesh.dimension, dense)


def _load(body: Body, made: bool, far: bool) -> Load:
    """What the costs of a body depend on, whose solver an alike one before it has `made`, in bodies that move `far`."""
    member = body.member
    A = member.elasticity.A
    rows = member.body.B.shape[0]
    copies = COPIES * ((not made) + far) * (member.body.kind == "explicit")
    return Load(
        body.mesh.dimension,
        A.size[0],
        member.size,
        rows,
        len(body.mesh.points),
        len(body.mesh.triangles),
        A.getInfo()["nz_used"],
        member.body.kind,
        made,
        memory_of_solver(body),
        copies * 8.0 * rows**2,
    )


COPIES = 1.5  # of C, half of which is read; twice as many if bodies move far


def _serial(scene: Settled, loads: Sequence[Load], parts: int, speed: Speed) -> dict[str, Range]:
    """The phases of one rank with these bodies, and with so many `parts` of them and contacts, but for the files."""
    steps = _steps(scene)
    both = (0, 1)
    more = 1.0, 1.0 if scene.method.outer == "newton" else PUBLISHED
    each = speed.python * (2e-4 + 6e-5 * parts)

    def products(first: tuple[float, float], end: int) -> float:
        return more[end] * (first[end] + (steps[end] - 1.0) * NEXT[end])

    outer = [
        speed.python * 1.2e-3 * steps[end]
        + each * products(FIRST, end)
        + sum(
            _product(load, speed) * products(FEW if load.kind == "iterative" else FIRST, end)
            for load in loads
        )
        for end in both
    ]
    plain = sum(_recovery(load, speed) for load in loads)
    solves = [plain + (count - 1.0) * sum(_solve(load, speed) for load in loads) for count in steps]
    drawings = {body.mesh.geometry for body in scene.body if body.mesh.geometry}
    errors = len(wanted_errors(scene)) * (2.0 * plain + outer[0])
    return {
        "start": _fixed(speed.python * (0.5 + 0.3 * len(drawings))),
        "factors": _fixed(sum(_factor(load, speed) for load in loads if not load.made)),
        "outer": _range(*outer),
        "recovery": _range(*solves),
        "errors": _fixed(errors),
    }


def _fixed(seconds: float) -> Range:
    return seconds, seconds, seconds


def _range(low: float, high: float) -> Range:
    return math.sqrt(low * high), low, high


def _steps(scene: Settled) -> tuple[float, float]:
    """The least and the most load steps that are likely."""
    if scene.time is None:
        return 1.0, 1.0
    legs = len(scene.time.points)
    steps = scene.time.steps
    low, high = (steps, steps) if steps else LEGS
    return legs * low, legs * high


def _factor(load: Load, speed: Speed) -> float:
    """Seconds to make factors, with C where it is dense, or multigrid."""
    if load.kind == "iterative":
        return speed.memory * SETUP * load.entries
    d = load.dimension
    dense = load.kind == "explicit"
    work = FACTOR[d] * load.n ** GROWTH[d] * (1.0 if dense else PLAIN)
    work += dense * CONDENSE * load.rows**3
    return speed.python * (3e-3 + EACH[0][d] * load.n) + (
        speed.product * work / (EASY * REFERENCE[1])
    )


MEET = {2: 0.05, 3: 0.8}
"""By dimension seconds in which bodies that move far meet in a load step."""

SHOW = {2: 6e-6, 3: 2e-5}
"""By dimension seconds to show a dof in an animation."""

PLAIN = 0.5  # operations of factors without C over those with it

SETUP = 1.9e-7
"""Seconds for each entry of A to set multigrid up."""

CYCLE = 4.2e-11
"""Seconds of a solve by multigrid for a power of the number of entries, to the precision of the outer method, which takes
more iterations on finer meshes."""

SOLVE = {2: 2.5, 3: 1.0}
"""By dimension how often a solve reads factors."""


def _solve(load: Load, speed: Speed) -> float:
    """Seconds of a solve with A."""
    if load.kind == "iterative":
        return speed.python * 1e-3 + speed.memory * CYCLE * load.entries**1.4
    return speed.python * 1e-4 + speed.memory * SOLVE[load.dimension] * load.solver / STREAM


def _product(load: Load, speed: Speed) -> float:
    """Seconds of a product with C."""
    if load.kind != "explicit":
        return _solve(load, speed)
    return speed.memory * 4.0 * load.k**2 / STREAM


def _recovery(load: Load, speed: Speed) -> float:
    """Seconds of displacements, stresses, estimate and warnings."""
    return speed.python * (1.5e-2 + EACH[1][load.dimension] * load.n) + _solve(load, speed)


def _pictures(scene: Settled) -> tuple[int, int]:
    """The number of pictures of a run, and of maps of contacts in space among them."""
    if scene.output.only:
        return 0, 0
    contacts = len(scene.contact) if len(scene.contact) <= LARGEST else 0
    plain = 2 + (len(scene.contact) > 1) + scene.output.error + (scene.time is not None)
    return {2: (plain + contacts, 0), 3: (plain, contacts)}[scene.dimension]


def _frames(scene: Settled, steps: float) -> float:
    """The number of pictures of an animation."""
    number = steps if scene.output.steps == "all" else len(scene.time.points) if scene.time else 0
    return min(number, ANIMATION["frames"]) * bool(scene.output.animation)


LARGEST = 6  # number of contacts with pictures of their own


def _output(loads: Sequence[Load], pictures: tuple[int, int], speed: Speed) -> float:
    """Seconds of files and pictures."""
    cells = sum(load.cells for load in loads)
    plain, maps = pictures
    drawn = (0.1 + 0.16 * plain + 0.35 * maps + 1e-6 * cells) * bool(plain + maps)
    return speed.python * (0.05 + 2e-6 * cells + drawn)


def _disk(scene: Settled, loads: Sequence[Load]) -> float:
    """Bytes of fields and tables."""
    if scene.output.only:
        return 1e5
    states = 1.0
    if scene.time is not None:
        states = _steps(scene)[0] if scene.output.steps == "all" else len(scene.time.points)
    each = [NODE[load.dimension] * load.nodes + CELL[load.dimension] * load.cells for load in loads]
    return 1e5 + 2e4 * len(scene.contact) + states * sum(each)
