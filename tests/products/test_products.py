"""Every feature in every kind of scene: what the program promises of them, by statics, closed forms and Hooke's law."""

import functools
import gc
import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from consistent import assert_consistent, within
from decked import as_deck
from kinds import Kind, in_cycles
from limits import pushed
from mpi4py import MPI
from otherwise import FOOT, Seen, otherwise
from promises import FEATURES, THICKNESS, Case
from restarts import go_on_from_checkpoints
from scenes import assert_refused, by_name, certified, write_scene

import ddmpi
from ddmpi.decks.scene import import_deck
from ddmpi.errors import InputError
from ddmpi.sweep.limit import find_limit

NAMES = ("strain", "stress", "plate", "axis", "space")


def combinations() -> list:
    """Each feature in each kind of scene with both orders, one of them in one load step and the other in several.

    One order of each feature is asked in the quick suite, in the kinds by turns with and without steps.
    """
    found = []
    for name in FEATURES:
        for j, kind in enumerate(NAMES):
            for order in (1, 2):
                quick = order == 1 + len(name) % 2
                one = Kind(kind, order, (order + j + len(name) // 2) % 2 == 0)
                found.append(pytest.param(name, one, marks=[] if quick else pytest.mark.slow))
    return found


@functools.cache
def said_otherwise() -> list:
    """The scenes with an answer, of every other feature one in the quick suite."""
    found = []
    for k, name in enumerate(FEATURES):
        kinds = [Kind(kind, 1 + (j + k) % 2, j % 2 == k // 2 % 2) for j, kind in enumerate(NAMES)]
        answered = [kind for kind in kinds if not FEATURES[name](kind).refused]
        quick = k % len(answered)
        for j, kind in enumerate(answered):
            marks = [] if j == quick and k % 2 == 0 else pytest.mark.slow
            found.append(pytest.param(name, kind, marks=marks))
    return found


@pytest.fixture(scope="module", autouse=True)
def thawed() -> Iterator[None]:
    """What the scenes have left frozen is garbage like any other afterwards."""
    yield
    gc.unfreeze()


@pytest.fixture(autouse=True)
def little_garbage() -> None:
    """What is there before a scene is not looked at after it: each has collected what it left."""
    gc.freeze()


def as_promised(answer, case: Case, kind: Kind, seen: Seen) -> None:
    """Forces, displacements and energies of an answer are those of the case; nothing is said of contacts without one."""
    if not answer.summary["contacts"]:
        warnings = " ".join(answer.summary["warnings"])
        assert "contact." not in warnings and "no contact" not in warnings
        assert answer.summary["certificate"]["penetration"] == 0.0
    for key, (value, size) in case.told.items():
        expected = value
        if callable(value):
            found = seen.value(answer.summary, "contacts.block-floor.normal_force")
            expected = value({"contacts": {"block-floor": {"normal_force": found[0]}}})
        expected = np.atleast_1d(expected)
        asked = ~np.isnan(expected)
        found = seen.value(answer.summary, key)[asked]
        expected = expected[asked]
        within(found, expected, 1e-6 * np.maximum(np.abs(expected), 0.1 * size), key)
    for body, exact in case.fields.items():
        for name in (body, FOOT) if seen.cut else (body,):
            fields = answer.bodies[name]
            expected = exact(seen.points(fields.points))
            known = ~np.isnan(expected)
            size = np.abs(expected[known]).max(initial=0.0)
            found = seen.vectors(fields.displacement)[known]
            within(found, expected[known], 1e-7 * size, name)
    for contact in case.pressures.keys() & answer.contacts.keys():
        pressure = case.pressures[contact]
        found = answer.contacts[contact].pressure / seen.stress
        within(found, np.full(len(found), pressure), 1e-6 * abs(pressure), contact)
    for contact in case.slips.keys() & answer.contacts.keys():
        found = np.linalg.norm(answer.contacts[contact].slip, axis=1) / seen.length
        expected = np.full(len(found), case.slips[contact])
        within(found, expected, np.maximum(1e-6 * expected, 1e-12), contact)
    if kind.steps:
        energy = answer.summary["energy"]
        joules = case.joules * seen.force * seen.length
        largest = max(abs(energy["external_work"]), abs(energy["strain_energy"]))
        # where heat stores nothing both energies are rounding, and so is what is left between them
        assert energy["residual"] * largest < 1e-8 * max(largest, joules)
        if case.stored is not None:
            stored = energy["strain_energy"] / seen.force / seen.length
            assert stored == pytest.approx(case.stored, rel=1e-6, abs=1e-9 * case.joules)


@pytest.mark.parametrize(("name", "kind"), combinations(), ids=str)
def test_a_feature_in_a_kind_of_scene(name, kind):
    """A scene is refused in words, or certified with the forces, displacements and energies that are told."""
    case = FEATURES[name](kind)
    if case.refused:
        assert_refused(case.scene, case.refused)
    else:
        as_promised(certified(case.scene, left=1e-6), case, kind, Seen())


@pytest.mark.parametrize(("name", "kind"), said_otherwise(), ids=str)
def test_a_scene_that_is_said_otherwise_has_the_same_answer(name, kind):
    """Lists in another order, a cut by a bond with a copy, a turn by 37 degrees, other units and another place change
    nothing."""
    case = FEATURES[name](kind)
    scene, seen = otherwise(case.scene, kind)
    as_promised(certified(scene, left=1e-6), case, kind, seen)


def of_bricks() -> list:
    """The scenes with an answer and generated meshes, of every other feature one in the quick suite, with both orders by
    turns."""
    found = []
    for k, name in enumerate(FEATURES):
        kinds = [Kind(kind, 1 + (j + k) % 2, (j + k) % 3 == 0) for j, kind in enumerate(NAMES)]
        answered = [kind for kind in kinds if not FEATURES[name](kind).refused]
        for j, kind in enumerate(answered):
            marks = [] if k % 2 and j == k % len(answered) else pytest.mark.slow
            found.append(pytest.param(name, kind, marks=marks))
    return found


def in_bricks(case: Case, number: int) -> Case:
    """The same with bricks in the first bodies, so many; the others have simplices."""
    for body in case.scene["body"][:number]:
        if "divisions" in body.get("mesh", {}):
            body["mesh"]["elements"] = "bricks"
    return case


@pytest.mark.parametrize(("name", "kind"), of_bricks(), ids=str)
def test_a_feature_in_bricks(name, kind):
    """Bricks of both orders keep all promises; of two bodies one may have simplices."""
    case = in_bricks(FEATURES[name](kind), 1 + len(name) % 2)
    as_promised(certified(case.scene, left=1e-6), case, kind, Seen())


def through_decks() -> list:
    """The scenes that a deck can have, of each feature one in the quick suite."""
    found = []
    for name, feature in FEATURES.items():
        kinds = [Kind(kind, 2, False) for kind in NAMES]
        kinds = [kind for kind in kinds if not feature(kind).refused]
        kinds = [kind for kind in kinds if as_deck(feature(kind).scene, kind)]
        for k, kind in enumerate(kinds):
            marks = [] if k == len(name) % len(kinds) else pytest.mark.slow
            found.append(pytest.param(name, kind, marks=marks))
    return found


@pytest.mark.parametrize(("name", "kind"), through_decks(), ids=str)
def test_a_scene_through_a_deck_has_the_same_answer(tmp_path, name, kind):
    """Displacements and forces are those of the scene; a deck has no clamps of edges, and quadrilaterals and bricks."""
    case = FEATURES[name](kind)
    (tmp_path / "deck.inp").write_text(as_deck(case.scene, kind), encoding="utf-8")
    import_deck(tmp_path / "deck.inp", tmp_path / "scene")
    answer = certified(tmp_path / "scene" / "scene.toml", left=1e-6)
    names = {body["name"]: body["name"].upper() for body in case.scene["body"]}
    fields = {names[body]: exact for body, exact in case.fields.items()}
    told = {}
    for key, expected in case.told.items():
        parts = key.split(".")
        if parts[0] == "bodies" and parts[2:] == ["reaction"]:
            told[f"bodies.{names[parts[1]]}.reaction"] = expected
        if parts[0] == "contacts" and parts[2:] in (["force"], ["normal_force"]):
            (contact,) = answer.summary["contacts"]
            told[f"contacts.{contact}.{parts[2]}"] = expected
    # parts of one thickness have a unit of depth
    as_promised(answer, replace(case, fields=fields, told=told), kind, Seen(force=1 / kind.thick))


def by_turns(first: int) -> list[tuple[str, Kind]]:
    """Each feature in one kind of scene with an answer."""
    found = {}
    for k, (name, kind) in enumerate(parameter.values for parameter in said_otherwise()):
        if name not in found or k % 5 == (first + len(found)) % 5:
            found[name] = kind
    return list(found.items())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), by_turns(0), ids=str)
def test_a_prepared_scene_has_the_same_answer(name, kind):
    """What a model has kept of other materials and of another place is made anew, and what it may keep is that of a run;
    with simplices, bricks or both."""
    case = in_bricks(FEATURES[name](kind), len(name) % 3)
    others = {}
    for body in case.scene["body"]:
        young = body["material"]["young"]
        others[f"body.{body['name']}.material.young"] = (np.array(young) * 1.3).tolist()
        key = "origin" if "origin" in body["mesh"] else "center"
        *place, height = body["mesh"][key]
        others[f"body.{body['name']}.mesh.{key}"] = [*place, height - 1e-3]
    with ddmpi.prepare(case.scene, MPI.COMM_SELF) as model:
        model.solve(others)
        answer = model.solve({})
    assert answer.certified, answer.reason
    assert_consistent(answer)
    as_promised(answer, case, kind, Seen())


@pytest.mark.slow
@pytest.mark.mpi(ranks=[2, 3])
def test_a_feature_on_several_ranks(comm, mpi_ranks):
    """Every feature, on two ranks or on three, as many as bodies or more, has the answer that is told; each rank has its
    bodies, of simplices, bricks or both."""
    for name, kind in by_turns(mpi_ranks)[mpi_ranks % 2 :: 2]:
        case = in_bricks(FEATURES[name](kind), (mpi_ranks + len(name)) % 3)
        answer = certified(case.scene, comm)
        bodies = set(comm.allreduce(list(answer.bodies)))
        assert bodies == {body["name"] for body in case.scene["body"]}, name
        case.fields = {body: exact for body, exact in case.fields.items() if body in answer.bodies}
        as_promised(answer, case, kind, Seen())


def with_errors() -> list:
    """Each feature in one kind of scene, of which the quick suite asks a fourth."""
    marks = [], pytest.mark.slow
    return [pytest.param(*one, marks=marks[k % 4 > 0]) for k, one in enumerate(by_turns(3))]


@pytest.mark.parametrize(("name", "kind"), with_errors(), ids=str)
def test_errors_of_a_feature_are_told(name, kind):
    """Every main result has a bar, which covers what is promised, or a word; the answer is what it is without them."""
    case = in_bricks(FEATURES[name](kind), len(name) % 2)
    scene = case.scene | {"output": {"figures": False, "errors": "main"}}
    if scene.get("time", {}).get("motions") == "far":
        assert_refused(scene, 'output.errors: there are none with time.motions = "far"')
        return
    answer = certified(scene, left=1e-6)
    as_promised(answer, case, kind, Seen())
    errors = answer.summary["errors"]
    assert errors
    for result, entry in errors.items():
        assert (entry["bar"] is None) == bool(entry["word"]), result
        key, _, axis = result.rpartition(".")
        value, size = case.told.get(key if axis in "xyz" else result, (None, 0.0))
        if entry["bar"] is not None and value is not None and not callable(value):
            expected = np.atleast_1d(value)["xyz".index(axis) if axis in "xyz" else 0]
            assert not abs(entry["value"] - expected) > entry["bar"] + 1e-6 * size, result


def in_steps(first: int) -> list[tuple[str, Kind]]:
    """Each feature with an answer in several load steps, in one kind of scene."""
    found = {}
    for k, name in enumerate(FEATURES):
        kinds = [Kind(kind, 1 + (first + k) % 2, True) for kind in NAMES]
        kinds = [kind for kind in kinds if not FEATURES[name](kind).refused]
        if kinds:
            found[name] = kinds[(first + k) % len(kinds)]
    return list(found.items())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), in_steps(0), ids=str)
def test_a_scene_in_cycles_has_the_same_answer(name, kind):
    """The loads end as they do without cycles, which bodies that move far do not have; also in bricks."""
    case = in_bricks(FEATURES[name](kind), (1 + len(name)) % 3)
    scene = in_cycles(case.scene)
    if "motions" in scene["time"]:
        assert_refused(scene, 'time.cycle: does not go with motions = "far"')
    else:
        as_promised(certified(scene, left=1e-6), case, kind, Seen())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), in_steps(1)[::2], ids=str)
def test_a_scene_goes_on_from_its_checkpoints(tmp_path, name, kind):
    """Of every other feature: the tables, fields and promised numbers of the run without an interruption; also in bricks."""
    scene = in_bricks(FEATURES[name](kind), (2 + len(name)) % 3).scene | {
        "checkpoint": {"iterations": 1},
        "output": {"steps": "all"},
    }
    go_on_from_checkpoints(scene, tmp_path, slice(None), ("contacts", "energy", "steps"))


LIMITED = {
    str(kind): kind
    for kind in (
        Kind(name, order, steps) for name in NAMES for order in (1, 2) for steps in (False, True)
    )
}


@pytest.mark.parametrize("kind", by_name(LIMITED, "strain-1-steps", "plate-1-once"))
def test_the_limit_of_a_load_in_a_kind_of_scene(tmp_path, kind):
    """Friction bears a push up to the factor that statics tells, whether pressures or histories are multiplied."""
    scene, load, factor = pushed(kind)
    path = str(write_scene(scene, tmp_path / "scene.toml"))
    if kind.name == "plate":
        with pytest.raises(InputError, match=THICKNESS):
            find_limit(MPI.COMM_SELF, path, [], load, str(tmp_path / "out"))
        return
    find_limit(MPI.COMM_SELF, path, [], load, str(tmp_path / "out"))
    found = json.loads((tmp_path / "out" / "limit.json").read_text(encoding="utf-8"))
    below, above = found["interval"]
    assert below <= factor * (1 + 1e-6) and factor * (1 - 1e-6) <= above <= below * 1.001002
    assert found["factor"] == pytest.approx((below + above) / 2)
    assert found["solves"] <= 5
    assert f"along {'y' if kind.axis else 'x'}" in found["mechanism"].replace("-", "")
