"""What `check` tells of the costs of a run: its words, and numbers that do not depend on the machine."""

import json
import re
from pathlib import Path

import pytest
from mpi4py import MPI
from scenes import pinched_blocks, prepare_scene, run_python, seldom, to_toml, write_scene
from solid_scenes import two_boxes

from ddmpi.check import costs
from ddmpi.check.check import check
from ddmpi.check.costs import COSTS, MIB, PHASES, Costs, Speed, forecast
from ddmpi.coupling.assembly import prepare
from ddmpi.run.run import run
from ddmpi.scene.reader import read_scene

MEASURED = {"mesh": 1.0, "assemble": 2.0}


def told(scene: dict, drawn: bool = False) -> Costs:
    """The forecast of a scene on a machine as fast as that of the fits."""
    settled = read_scene("scene.toml", to_toml(scene))
    return forecast(prepare(MPI.COMM_SELF, settled, factor=False), MEASURED, drawn)


@pytest.fixture(autouse=True)
def same_machine(monkeypatch):
    """Its speeds, and the memory of a process that has done nothing else, as these tests' own has."""
    monkeypatch.setattr(costs, "measure_speed", lambda: Speed(1.0, 1.0, 1.0))
    monkeypatch.setattr(costs, "peak_memory", lambda: 90.0)


def test_check_tells_costs_before_a_run(tmp_path, caplog):
    """Memory, time by phase, disk, and a line for Slurm with all that it needs; numbers in costs.json."""
    caplog.set_level("INFO", "ddmpi")
    scene = read_scene("scene.toml", to_toml(pinched_blocks(4)))
    check(MPI.COMM_SELF, scene, "a scene.toml", str(tmp_path / "out"), True)
    said = "\n".join(record.getMessage() for record in caplog.records)
    assert re.search(r"^memory of a run: \d+\.\d MiB$", said, re.M)
    assert re.search(
        r"^time of a run: about \S+ s \(\S+ to \S+ s\): start 0\.5 s, .*outer \S+ to \S+ s,.*output \S+ s$",
        said,
        re.M,
    )
    assert re.search(r"^disk for its results: \d+\.\d MiB$", said, re.M)
    line = re.search(
        r"^in a batch: sbatch (--ntasks=1 --mem=\d+00M --time=00:03:00) .*$", said, re.M
    )
    assert line and line[0].endswith("scripts/slurm/run.sbatch 'a scene.toml'")
    numbers = json.loads((tmp_path / "out" / COSTS).read_text())
    assert numbers["slurm"] == line[1] and list(numbers["seconds"]) == list(PHASES)
    assert numbers["memory"][0] / MIB == pytest.approx(
        float(re.search(r"memory of a run: (\S+)", said)[1]), abs=0.1
    )


@pytest.mark.parametrize("scene", [seldom(pinched_blocks(10)), two_boxes(4)])
def test_the_disk_is_as_told(tmp_path, scene):
    """Within the factor that the page tells, without pictures."""
    settled = read_scene("scene.toml", to_toml(scene))
    run(MPI.COMM_SELF, settled, "scene.toml", str(tmp_path / "out"), False)
    found = sum(path.stat().st_size for path in (tmp_path / "out").iterdir())
    assert told(scene).disk / found == pytest.approx(1.0, rel=0.3)


def test_costs_grow_as_laws_say():
    """Factors in space with n² at last, products with the second power of contact nodes, the rest with n; a slower machine
    takes as much longer."""
    small, large = (told(two_boxes(N)) for N in (4, 8))
    scenes = (read_scene("scene.toml", to_toml(two_boxes(N))) for N in (8, 4))
    n, of_small = (prepare(MPI.COMM_SELF, scene, factor=False).n for scene in scenes)
    for phase in ("factors", "recovery"):
        assert 1.0 < large.seconds[phase][0] / small.seconds[phase][0] < (n / of_small) ** 2
    assert large.memory[0] > small.memory[0] and large.disk > 4.0 * small.disk
    assert large.seconds["mesh"] == (1.0, 1.0, 1.0) and large.seconds["assembly"][0] == 2.0


@pytest.mark.parametrize("compliance", [seldom("explicit"), "direct", seldom("iterative")])
def test_alike_bodies_cost_one_solver(compliance):
    """Seven boxes, of which five inner ones are alike, and seven of unlike materials: a run makes three and seven solvers;
    multigrid is made for each body."""
    cost, solvers = list[Costs](), list[int]()
    for unlike in (0.0, 1e9):
        boxes = [
            {
                "name": f"box{k}",
                "clamp": ["bottom"] * (not k),
                "mesh": {"shape": "box", "origin": [0.0, 0.0, k], "size": [1.0, 1.0, 1.0]}
                | {"divisions": [4, 4, 4]},
                "material": {"young": 2e11 + k * unlike, "poisson": 0.3},
            }
            for k in range(7)
        ]
        pairs = [[f"box{k + 1}", f"box{k}"] for k in range(6)]
        contacts = [{"bodies": pair, "on": ["bottom", "top"]} for pair in pairs]
        scene = {"body": boxes, "contact": contacts, "method": {"compliance": compliance}}
        cost.append(told(scene))
        found = prepare_scene(MPI.COMM_SELF, scene).bodies
        solvers.append(len({id(body.member.C.solver) for body in found}))
    alike, all_unlike = cost
    ratio = solvers[0] / solvers[1]
    assert solvers[1] == 7 and alike.seconds["factors"][0] == pytest.approx(
        ratio * all_unlike.seconds["factors"][0], rel=0.1
    )
    assert alike.seconds["outer"] == all_unlike.seconds["outer"]
    assert (ratio == 1.0) == (compliance == "iterative")


def test_a_slower_machine_takes_longer(monkeypatch):
    """All that is not measured is in proportion to its speeds."""
    fast = told(two_boxes(4), drawn=True)
    monkeypatch.setattr(costs, "measure_speed", lambda: Speed(2.0, 2.0, 2.0))
    slow = told(two_boxes(4), drawn=True)
    for phase in ("start", "factors", "outer", "recovery", "output"):
        assert slow.seconds[phase] == pytest.approx([2.0 * each for each in fast.seconds[phase]])
    assert slow.disk == fast.disk and slow.seconds["mesh"] == fast.seconds["mesh"]


def test_what_is_left_out_costs_nothing():
    """Pictures, fields, errors; load steps cost more, those that nobody knows the number of have a wider range."""
    scene = pinched_blocks(6)
    plain, drawn = told(scene), told(scene, drawn=True)
    assert drawn.memory[0] - plain.memory[0] > 50 * MIB and drawn.disk > plain.disk
    assert drawn.seconds["output"][0] > plain.seconds["output"][0] + 0.5
    alone = told(scene | {"output": {"only": "contacts"}}, drawn=True)
    assert alone.seconds["output"][0] < 0.1 and alone.disk < plain.disk
    asked = told(scene | {"output": {"errors": "main"}})
    assert plain.seconds["errors"][2] == 0.0 < asked.seconds["errors"][0]
    history = {"load": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}}
    steps = [
        told(scene | {"history": history, "time": {"points": [0.5, 1.0]} | more})
        for more in ({"steps": 1}, {"steps": 8}, {})
    ]
    spread = [each.seconds["outer"][2] / each.seconds["outer"][1] for each in steps]
    assert steps[1].seconds["outer"][1] > plain.seconds["outer"][1] and spread[2] > spread[1]
    assert steps[0].disk > plain.disk
    published = told(scene | {"method": {"outer": "relaxation"}})
    assert published.seconds["outer"][2] > plain.seconds["outer"][2]


def test_slurm_gets_more_than_is_told():
    """Half as much again, and the two minutes in which a run writes its checkpoint."""
    seconds = dict.fromkeys(PHASES, (0.0, 0.0, 0.0)) | {"outer": (600.0, 300.0, 7200.0)}
    costs = Costs([1000.0 * MIB, 500.0 * MIB], seconds, 3e9)
    assert costs.slurm() == "--ntasks=2 --mem=2300M --time=03:02:00"
    assert list(costs.lines("s.toml")) == [
        "memory of a run: 1000.0 MiB, 500.0 MiB by rank",
        "time of a run: about 6e+02 s (3e+02 to 7.2e+03 s): outer 3e+02 to 7.2e+03 s",
        "disk for its results: 2.8 GiB",
        "in a batch: sbatch --ntasks=2 --mem=2300M --time=03:02:00 scripts/slurm/run.sbatch s.toml",
    ]
    alike = Costs([1000.0 * MIB] * 2, seconds, 3e9)
    assert next(alike.lines("s.toml")) == "memory of a run: 1000.0 MiB on each rank"


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_each_rank_has_its_memory(tmp_path, ranks):
    """Those with bodies; the line for Slurm has as many tasks."""
    path = write_scene(pinched_blocks(6), tmp_path / "scene.toml")
    output = str(tmp_path / "out")
    done = run_python(["-m", "ddmpi", "check", str(path), "--output", output], ranks)
    assert done.code == 0, done.stderr
    numbers = json.loads((Path(output) / COSTS).read_text())
    assert len(numbers["memory"]) == 2 and numbers["slurm"].startswith("--ntasks=2 ")
