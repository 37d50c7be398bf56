"""What -log_view shows: our phases as stages, our steps as events, counted as the summary counts them."""

import re

import pytest
from scenes import pinched_blocks, run_command, write_scene

pytestmark = pytest.mark.slow

STAGES = {"mesh", "assemble", "factor", "outer", "recover", "output"}
METHODS = {
    "newton": ({}, {"NewtonStep"}),
    "relaxation": ({"theta": 0.3, "tolerance": 1e-2}, {"ContactQP", "NeumannSolve"}),
}


def logged(text: str) -> tuple[set[str], dict[str, int]]:
    """Names of the stages, and how often each event happened in all of them, on the rank with the most."""
    stages = set(re.findall(r"^ *\d+: +(\S+): +\d", text, re.MULTILINE))
    events: dict[str, int] = {}
    for name, count in re.findall(r"^([A-Z][A-Za-z]+) +(\d+) \d+\.\d ", text, re.MULTILINE):
        events[name] = events.get(name, 0) + int(count)
    return stages, events


@pytest.mark.parametrize("name", METHODS)
def test_log_view_tells_the_story(tmp_path, name):
    method, own = METHODS[name]
    run = run_command(
        write_scene(pinched_blocks(2, **method), tmp_path / "scene.toml"),
        tmp_path / "out",
        "--no-figures",
        "-log_view",
    )
    assert run.code == 0, run.output
    stages, events = logged(run.stdout)
    assert stages >= STAGES
    assert set(events) >= own | {
        "LoadResponse",
        "ComplianceMult",
        "Exchange",
        "Displacement",
        "Certificate",
        "Stress",
        "WriteFields",
        "WriteTables",
    }
    assert not {"Figures", "ComplianceForm"} & set(events)
    iterations, solves = (
        run.summary["outer_iterations"],
        [body["n_A_by_purpose"] for body in run.summary["bodies"].values()],
    )
    assert (
        events["LoadResponse"]
        == events["Displacement"]
        == events["Certificate"]
        == events["Stress"]
        == 1
    )
    assert events["ComplianceMult"] == max(
        sum(body.values()) - body["load"] - body["displacement"] for body in solves
    )
    messages = run.summary["exchange"]["messages"]
    collected = 2 + (name == "newton")  # free displacements, the answer; shared nodes
    if name == "newton":
        assert events["NewtonStep"] == iterations
        products = solves[0]["newton"]
        assert messages == products + collected
        # An exchange goes one way, the other way, and into agreement.
        assert 2 * messages < events["Exchange"] <= 3 * messages
    else:
        assert messages == 2 * iterations + 1 + collected
        assert events["Exchange"] == 2 * messages  # both ways at once, and agreement
        assert events["NeumannSolve"] == max(body["neumann"] for body in solves)


def test_log_view_tells_of_what_is_made_on_request(tmp_path):
    run = run_command(
        write_scene(pinched_blocks(2), tmp_path / "scene.toml"),
        tmp_path / "out",
        "-log_view",
        "--set",
        "method.compliance=explicit",
        "-body_pc_factor_mat_solver_type",
        "cholmod",
        ranks=1,
    )
    assert run.code == 0, run.output
    _, events = logged(run.stdout)
    assert events["Figures"] == 1
    assert events["ComplianceForm"] == 2
