"""summary.json in format 2, and the results read back."""

import json

import made_up
import numpy as np
import pytest
from documented import SUMMARY, entries

from ddmpi.errors import InputError
from ddmpi.interface.state import ContactState
from ddmpi.results.summary import (
    ROWS,
    held_in_words,
    loose_in_words,
    summarize,
    tell,
    units,
    write_summary,
)
from ddmpi.results.tables import leg_values, read_results
from ddmpi.run.gather import StepLog
from ddmpi.system.provenance import provenance

STEP = {
    "force",
    "moment",
    "normal_force",
    "tangential_force",
    "open",
    "slip",
    "stick",
    "dissipated",
    "utilisation",
}


def row() -> dict[str, ContactState]:
    """Both contacts of three blocks side by side."""
    blocks = {name: made_up.block(origin) for name, origin in made_up.ROW.items()}
    return {
        name: made_up.state(
            made_up.interface(name, *(blocks[body] for body in name.split("-")), on)
        )
        for name, on in made_up.CONTACTS["row"].items()
    }


def summary_of(
    contacts: dict[str, ContactState], run=None, residuals=None, **of_the_first_body
) -> dict:
    bodies = {
        name: made_up.body(**(of_the_first_body if name == "left" else {})) for name in made_up.ROW
    }
    return summarize(
        made_up.scene(list(contacts)),
        made_up.run(contacts, **run or {}),
        bodies,
        made_up.totals(contacts),
        made_up.certificate(contacts, bodies, **residuals or {}),
    )


def test_every_entry_is_documented():
    """What a summary holds, load steps included, is what the reference says."""
    balance = dict.fromkeys(
        ("external_work", "strain_energy", "interface_work", "dissipated", "lost", "residual"), 0.0
    )
    by = {
        "until": [None, 0.4],
        "contacts": {"a-b": {}},
        "bodies": {"a": {}},
        "rigid": {"floor": {}},
    }
    more = {
        "reused": {"a": ["mesh"]},
        "energy": balance,
        "cycles": {"run": 3, "change": 0.5},
        "derivatives": {"contact.a-b.gap": by},
        "errors": {
            "bodies.a.energy": {"value": 12.0, "bar": 0.5, "word": "", "half": None},
        },
    }
    summary = summary_of(row(), more) | provenance(0.0, ["host"])
    summary["rigid"] = {
        "floor": {"displacement": [0.0, 0.0], "force": [1.0, 2.0], "turn": 0.0, "moment": 0.0}
    }
    summary["contacts"]["left-middle"]["pretension"] = {"force": 1.0, "offset": 0.0}
    summary["contacts"]["left-middle"]["image"] = {"turn": 60.0, "sectors": 6}
    summary["whole"] = {"sectors": 6, "bodies": {}, "contacts": {}}
    assert set(entries(summary)) == set(SUMMARY) >= set(ROWS)


@pytest.mark.parametrize(
    "length, stress, force, moment, energy",
    [
        ("m", "Pa", "N/m", "N·m/m", "J/m"),
        ("mm", "MPa", "N/mm", "N·mm/mm", "mJ/mm"),
        ("in", "psi", "psi·in", "psi·in·in", "psi·in·in"),
    ],
)
def test_results_carry_their_units(length, stress, force, moment, energy):
    """Units are those of the scene; forces, moments and energies are per unit of depth."""
    found = units({"output": {"length_unit": length, "stress_unit": stress}}, 2)
    assert found == {
        "length": length,
        "stress": stress,
        "force": force,
        "moment": moment,
        "energy": energy,
    }


@pytest.mark.parametrize("several", [False, True])
def test_forces_of_parts_with_a_thickness_are_those_of_all_of_it(several):
    material = {"young": 2e5, "poisson": 0.3, "plane": "stress", "thickness": 6.0}
    body = {"material": [material, {}] if several else material}
    scene = {"output": {"length_unit": "mm", "stress_unit": "MPa"}, "body": [body]}
    assert units(scene, 2)["force"] == "N"
    assert (
        units(scene | {"body": [{"material": material | {"thickness": 1.0}}]}, 2)["force"] == "N/mm"
    )


def test_sums_are_those_of_all_bodies_and_contacts():
    """n, m, n_A and the largest displacement belong to the whole scene."""
    summary = summary_of(row(), n=1000, displacement_max=0.5, n_A_by_purpose={"newton": 7})
    assert (summary["n"], summary["m"], summary["n_A"]) == (1000 + 2 * 432, 18, 7 + 2 * 100)
    assert summary["bodies"]["left"]["n_A"] == 7
    assert summary["eff"] == summary["n_A"] / (2 * 18)
    assert summary["displacement_max"] == 0.5


def test_the_work_of_all_load_steps_is_added_up():
    """dissipated of a contact is that of all load steps; of a step it is its own."""
    log, contacts = StepLog(), row()
    for time in (1.0, 2.0):
        log.note_contacts(time, 3, made_up.totals(contacts))
    again = StepLog()
    again.restore(log.state())
    bodies = {name: made_up.body() for name in made_up.ROW}
    summary = summarize(
        made_up.scene(list(contacts)),
        made_up.run(contacts, steps=again.steps),
        bodies,
        made_up.totals(contacts),
        made_up.certificate(contacts, bodies),
    )
    for name, state in contacts.items():
        assert summary["contacts"][name]["dissipated"] == 2 * state.dissipated > 0.0
        assert [step["contacts"][name] for step in summary["steps"]] == [
            {key: summary["contacts"][name][key] for key in STEP} | {"dissipated": state.dissipated}
        ] * 2
        assert type(summary["steps"][0]["contacts"][name]["open"]) is int


def test_what_is_kept_of_load_steps_outlives_a_restart():
    """Tables, fields, warnings, the worst residuals, and the largest values; places are kept by `run.places`."""
    log, contacts = StepLog(), row()
    log.note_contacts(1.0, 3, made_up.totals(contacts))
    log.energies.append([1.0, 0.0, 1.0, 2.0, 3.0, 4.0])
    log.iterations.append((1, 2, 0.5, 0.25, 1e-9, 3, 4, 5, 6))
    log.kept.append((1.0, np.arange(4.0), np.arange(2.0), *map(leg_values, contacts.values())))
    log.doubt(1.0, ["body.left: moves far, by 0.3"])
    log.judge(made_up.certificate(contacts, made_up.ROW, left_middle={"friction": 0.25}))
    log.most |= {"sizes": np.array([3.0, 2.0, 1.0])}
    log.begin_cycle(1.0)
    log.change, log.cycle = 0.5, 1
    again = StepLog()
    again.restore(log.state())
    np.testing.assert_equal(vars(again), vars(log))
    assert all(
        np.size(value) and np.all(value) if np.isscalar(value) else len(value)
        for name, value in vars(log).items()
        if name != "places"
    )
    assert log.most["sizes"].all()


def test_doubts_of_different_bodies_are_different():
    """Of warnings that differ in numbers alone the first one is told, but names of bodies may end with numbers."""
    log = StepLog()
    log.doubt(1.0, ["nothing touches block1: it can move freely", "block-2 slides by -0.5"])
    log.doubt(2.0, ["block-2 slides by 1.5e-3"])
    told = [
        "nothing touches block1: it can move freely (at time 1)",
        "block-2 slides by -0.5 (at time 1)",
    ]
    assert (
        log.doubts_beside(["nothing touches block2: it can move freely", "block-3 slides by 1"])
        == told
    )
    assert log.doubts_beside(["block-2 slides by 0.1"]) == told[:1]


def test_the_worst_residual_is_at_the_top():
    """Each residual at the top is the largest of all contacts or bodies, whichever they are."""
    summary = summary_of(
        row(),
        residuals={
            "left_middle": {"penetration": 0.5},
            "middle_right": {"friction": 0.25},
            "equilibrium": {"left": 0.125},
        },
    )
    assert summary["certificate"] == {
        "force_mismatch": 0.0,
        "penetration": 0.5,
        "complementarity": 2e-12,
        "friction": 0.25,
        "equilibrium": 0.125,
    }
    assert summary["contacts"]["left-middle"]["certificate"]["penetration"] == 0.5
    assert summary["bodies"]["left"]["certificate"] == {"equilibrium": 0.125}


def test_numbers_that_are_not_finite_are_null(tmp_path):
    """A diverged run has a summary, too; a residual that is no number is the worst."""
    summary = summary_of(
        row(),
        {"energy_norm": np.nan},
        {"middle_right": {"penetration": np.nan, "friction": np.inf}},
        reaction=np.array([np.inf, 1.0]),
    )
    write_summary(tmp_path, summary)
    read = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert read == summary
    assert read["certificate"]["penetration"] is read["certificate"]["friction"] is None
    assert read["discretization_error"]["energy_norm"] is None
    assert read["bodies"]["left"]["reaction"] == [None, 1.0]


def test_laws_of_contacts_may_differ():
    """Each contact names its law of friction; the top names all that there are."""
    blocks = [made_up.block(origin) for origin in made_up.ROW.values()]
    plain = made_up.interface("left-middle", *blocks[:2], ("right", "left"), made_up.NoFriction())
    summary = summary_of(row() | {"left-middle": made_up.state(plain)})
    assert summary["friction"] == "none, coulomb"
    assert [contact["friction"] for contact in summary["contacts"].values()] == ["none", "coulomb"]
    assert summary["contacts"]["left-middle"]["dissipated"] == 0.0


@pytest.mark.parametrize("order", [1, 2])
def test_results_are_read_back(tmp_path, order):
    """read_results finds every table by the names in the summary, and the fields."""
    summary = made_up.results(tmp_path, "row", order)
    results = read_results(tmp_path)
    assert results.summary == summary
    assert list(results.contacts) == ["left-middle", "middle-right"]
    assert list(results.sides) == ([] if order == 1 else list(results.contacts))
    for name, table in results.contacts.items():
        assert table["normal_force"].sum() == summary["contacts"][name]["normal_force"]
        assert (table["status"] == "stick").sum() == summary["contacts"][name]["stick"]
    assert results.history["iteration"].tolist() == list(range(1, 10))
    assert results.steps["contact"].tolist() == list(results.contacts)
    assert results.steps["dissipated"].tolist() == [
        c["dissipated"] for c in summary["contacts"].values()
    ]
    assert np.unique(results.fields["body"]).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    "missing", ["summary.json", "contact_upper-lower.csv", "history.csv", "steps.csv", "result.h5"]
)
def test_incomplete_results_are_refused(tmp_path, missing):
    """Where a file is missing, read_results raises an InputError that names it."""
    made_up.results(tmp_path)
    (tmp_path / missing).unlink()
    with pytest.raises(InputError, match=rf"not a complete folder of results: .*{missing}"):
        read_results(tmp_path)


def test_results_of_another_format_are_refused(tmp_path):
    """Results that an earlier version wrote, without a number of the format, are named as such."""
    summary = made_up.results(tmp_path)
    del summary["format"]
    write_summary(tmp_path, summary)
    with pytest.raises(InputError, match="results in format 1; this version reads format 2"):
        read_results(tmp_path)


def test_forces_that_rounding_leaves_are_told_as_zero():
    """The pressures of a fit balance themselves: what is left is rounding, beside the sum of its normal forces."""
    contact = {"force": [-6.5e-12, 5.6e-13], "normal_force": 4e4}
    summary = {"contacts": {"fit": contact}, "units": {"force": "N/m"}}
    assert tell(summary, "contacts", "fit", "force") == "force (0, 0) N/m"
    contact["force"] = [-3.0, 5.6e-13]
    assert tell(summary, "contacts", "fit", "force") == "force (-3, 0) N/m"


@pytest.mark.parametrize(
    "value, words", [(-5e5, "least tension 5e+05 Pa"), (5e5, "largest pressure 5e+05 Pa")]
)
def test_a_bond_in_tension_has_no_pressure(value, words):
    summary = {"contacts": {"bond": {"pressure_max": value}}, "units": {"stress": "Pa"}}
    assert tell(summary, "contacts", "bond", "pressure_max") == words


def test_a_light_body_beside_a_heavy_one_has_its_own_force():
    """Of 1 N beside 1e9 N no digit is rounding; the log said zero beside two closed nodes and 3.5 Pa."""
    summary = {
        "contacts": {
            "heavy-table": {"force": [2.0, 1e9], "normal_force": 1e9},
            "light-floor": {"force": [1e-12, 1.0], "normal_force": 1.0},
        },
        "bodies": {"table": {"reaction": [2.0, 1e9]}, "floor": {"reaction": [1e-12, 1.0]}},
        "scene": {
            "contact": [
                {"name": "heavy-table", "bodies": ["heavy", "table"]},
                {"name": "light-floor", "bodies": ["light", "floor"]},
            ]
        },
        "units": {"force": "N/m"},
    }
    assert tell(summary, "contacts", "light-floor", "force") == "force (0, 1) N/m"
    assert tell(summary, "bodies", "floor", "reaction") == "reaction (0, 1) N/m"
    assert tell(summary, "contacts", "heavy-table", "force") == "force (0, 1e+09) N/m"
    assert tell(summary, "bodies", "table", "reaction") == "reaction (0, 1e+09) N/m"


@pytest.mark.parametrize(
    ("outer", "converged", "where", "several"),
    [
        ("newton", True, "it lies where it moves least", "they lie where they move least"),
        (
            "newton",
            False,
            "how far it has moved is not determined",
            "how far they have moved is not determined",
        ),
        (
            "published",
            True,
            "how far it has moved is not determined",
            "how far they have moved is not determined",
        ),
    ],
)
def test_where_a_body_lies_that_nothing_holds(outer, converged, where, several):
    """Newton's method moves it least, the paper's does not choose."""
    summary = {"outer": outer, "converged": converged, "undetermined": ["lid can move along y"]}
    assert loose_in_words(summary) == [f"lid can move along y; {where}"]
    both = "lid and nut can move along y"
    assert loose_in_words(summary | {"undetermined": [both]}) == [f"{both}; {several}"]


@pytest.mark.parametrize("load", [2e-3, 1e-12])
def test_what_loads_leave_along_a_held_motion_is_told(load):
    """Beside its bound; what is rounding is not."""
    held = {"motion": "pin can turn about (0, 0)", "moment": load, "bound": 0.5}
    summary = {"held_motions": [held], "units": {"moment": "N m/m", "force": "N/m"}}
    (said,) = held_in_words(summary)
    left = ". The loads leave 0.002 N m/m along it, of 0.5 that errors of normals may bear"
    assert said == f"{held['motion']}; held where it was{left * (load > 1e-9)}"
    both = held | {"motion": "ring and peg can move along x without any force"}
    (said,) = held_in_words(summary | {"held_motions": [both]})
    assert said.startswith(f"{both['motion']}; held where they were")
