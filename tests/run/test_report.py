"""Messages of a run stay short for many bodies and contacts, have units, and say what is meant."""

import re

import pytest
import scenes
from mpi4py import MPI

from ddmpi.run.report import LISTED, _between_nodes, _bodies, describe_files, grouped, some
from ddmpi.run.run import run
from ddmpi.scene.reader import read_scene


def test_equal_lines_are_said_once():
    pairs = [("touches", "a"), ("open", "b"), ("touches", "c")]
    assert list(grouped(pairs)) == [("touches", ["a", "c"]), ("open", ["b"])]


def test_the_answer_is_told_before_it_is_drawn(tmp_path, monkeypatch, caplog):
    """Whatever pictures take, nobody waits for them to know it."""
    caplog.set_level("INFO", "ddmpi")
    told = []
    monkeypatch.setattr("ddmpi.pictures.draw.draw_all", lambda *_: told.append(caplog.text))
    scene = read_scene("scene.toml", scenes.to_toml(scenes.pinched_blocks(4)))
    run(MPI.COMM_SELF, scene, "scene.toml", str(tmp_path / "out"), True)
    assert len(told) == 1 and "certified" in told[0] and "largest displacement" in told[0]
    assert "results in" in caplog.text and "results in" not in told[0]


def test_many_names_are_counted():
    assert some(["a", "b", "c", "d"], "contacts") == "a, b, c, d"
    assert some([f"i{k}" for k in range(12)], "contacts") == "i0, i1, … (12 contacts)"


def test_many_tables_are_one():
    few = ["bodies.png", "contact_a.csv", "contact_b.csv", "summary.json"]
    assert describe_files(few) == ", ".join(few)
    many = [
        "bodies.png",
        *(f"contact_{k}.{end}" for k in range(9) for end in ("csv", "vtu")),
        "summary.json",
    ]
    assert describe_files(many) == "bodies.png, contact_NAME (18 files), summary.json"


def test_what_lies_between_nodes_is_said_of_the_worst_contacts():
    """Of contacts whose nodes do not match, apart from the certificate; of others nothing."""

    def said(**contacts: tuple[str | None, float, float, float]) -> list[str]:
        keys = ("slave", "pointwise_penetration", "moment_imbalance", "moment_imbalance_bound")
        return list(
            _between_nodes(
                {
                    "certificate_limit": 5e-7,
                    "displacement_max": 1.0,
                    "units": {
                        "length": "mm",
                        "stress": "MPa",
                        "force": "N/mm",
                        "moment": "N·mm/mm",
                    },
                    "contacts": {
                        name: dict(zip(keys, values, strict=True))
                        for name, values in contacts.items()
                    },
                }
            )
        )

    assert not said(ab=(None, 1.0, 9.0, 9.0))
    assert not said(ab=("b", 4e-7, 0.0, 0.0))  # what the certificate allows at nodes
    assert said(ab=(None, 1.0, 9.0, 9.0), bc=("b", 2e-3, 0.5, 4.0), cd=("d", 1e-3, 0.75, 3.0)) == [
        "non-matching meshes at bc: penetration between nodes up to 0.002 mm",
        "non-matching meshes at cd: moment imbalance 0.75 N·mm/mm (bound 3)",
    ]
    assert said(bc=("b", 2e-3, 0.5, 4.0)) == [
        "non-matching meshes at bc: penetration between nodes up to 0.002 mm; "
        "moment imbalance 0.5 N·mm/mm (bound 4)"
    ]


def test_what_is_printed_has_units_and_says_how_bodies_are_held(tmp_path):
    """Forces, displacements and stresses have the scene's units; a body without clamps is said to have none."""
    scene = scenes.tower(2, 2) | {"output": {"length_unit": "mm", "stress_unit": "MPa"}}
    path = scenes.write_scene(scene, tmp_path / "scene.toml")
    run = scenes.run_here(path, tmp_path / "out", "--no-figures")
    assert run.code == 0, run.output
    for word in (
        "not supported by clamps (3 rigid motions); direct solver\n",
        " bodies on 1 rank\n",
        ") N/mm on ",
        " MPa at (3, 1)\n",
        " N/mm, largest displacement ",
        " mm at (3, 2), von Mises stress ",
        " pictures (not asked for)\n",
    ):
        assert word in run.stdout, run.stdout
    assert re.search(r"energy norm; with mesh.order = 2 .* about \d+ unknowns", run.stdout)


@pytest.mark.slow
def test_steps_whose_forces_agree_though_slip_is_coarse_are_said_to_dissipate_too_much(tmp_path):
    """A cube that is dragged over a floor: in one step the force is exact, and the work half of the friction's."""
    scene = {
        "history": {"drag": {"times": [1.0, 2.0], "factors": [0.0, 1.0]}},
        "time": {"points": [1.0, 2.0]},
        "body": [
            {
                "name": "block",
                "mesh": {
                    "shape": "box",
                    "origin": [0, 0, 0],
                    "size": [1, 1, 1],
                    "divisions": [1, 1, 1],
                },
                "material": {"young": 1e9, "poisson": 0.0},
                "clamp": [
                    {"on": "top", "x": 1e-3, "history": "drag"},
                    {"on": "top", "y": 0.0, "z": -1e-4},
                ],
            }
        ],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}],
        "contact": [
            {
                "bodies": ["block", "floor"],
                "on": ["bottom"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
        ],
    }
    run = scenes.run_here(
        scenes.write_scene(scene, tmp_path / "scene.toml"), tmp_path / "out", "--no-figures"
    )
    assert run.code == 0, run.output
    assert re.search(
        r"agree to \S+e-\d+, but friction dissipates more than contacts take\n", run.stdout
    ), run.stdout


@pytest.mark.parametrize("stress", [True, False])
def test_of_many_bodies_the_largest_values_are_told(stress):
    """Of stresses where there are some, and of supported bodies their reactions."""
    names = [f"part{k}" for k in range(LISTED + 1)]
    bodies = {
        name: {
            "displacement_max": 1e-3 * (1 + k),
            "displacement_max_at": [float(k), 0.0],
            "von_mises_max": 1e3 * (20 - k) if stress else None,
            "von_mises_max_at": [0.0, float(k)] if stress else None,
        }
        for k, name in enumerate(names)
    }
    scene = {"body": [{"name": name, "clamp": [], "foundation": []} for name in names]}
    units = {"length": "m", "stress": "Pa", "force": "N"}
    (line,) = _bodies({"bodies": bodies, "scene": scene, "units": units})
    assert line.startswith("13 bodies: ")
    assert "0.013 m" in line and "part12" in line
    assert ("2e+04 Pa" in line and "part0" in line) == ("Pa" in line) == stress
