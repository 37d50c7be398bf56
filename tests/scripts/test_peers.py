"""scripts/study peers: every peer that is there finds ddmpi's answer, and one that hangs or fails is a line."""

import numpy as np
import pytest
from scenes import clean_environment

import ddmpi

PLACES = {"blocks": 4, "hertz": 8}
CLOSE = {"calculix": 0.05}
"""Springs, and large rotations; everybody else solves the same equations."""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """Cases by scene with their folders, and ddmpi's answers in this process."""
    from compare_peers import write_case
    from peers import answer_of

    found = {}
    for scene, N in PLACES.items():
        folder = tmp_path_factory.mktemp(scene)
        case = write_case(scene, N, folder)
        solved = ddmpi.solve(folder / "scene.toml")
        (state,), first = solved.contacts.values(), next(iter(solved.bodies.values()))
        s = np.zeros((2, len(case.pairs)))
        at = [int(np.abs(case.points[case.pairs[:, 0], 0] - x).argmin()) for x in state.interface.xy[:, 0]]
        s[:, at] = state.normal_force, state.tangential_force[:, 0]
        u = np.zeros_like(case.points)
        u[:len(first.points)] = first.displacement
        found[scene] = case, folder, answer_of(case, u.ravel(), s, 0)
    return found


@pytest.mark.parametrize(("scene", "name"), [
    *(("blocks", name) for name in ("petsc-dense", "petsc", "scipy-dense", "getfem", "freefem", "calculix")),
    *(("hertz", name) for name in ("scipy", "getfem", "freefem", "calculix"))])
def test_peer_agrees(scene, name, given):
    """A peer's forces, largest pressure and displacement are those of ddmpi on the same mesh."""
    from compare_peers import PEERS, Result, difference, environment, measure, row_of

    peer = PEERS[name]
    if peer.missing():
        pytest.skip(peer.missing())
    case, folder, answer = given[scene]
    result = measure(peer, case, folder, 1, 20.0, environment())
    assert not result.failure
    apart = difference(row_of(case, Result(0.0, 0.0, answer)), row_of(case, result))
    assert apart < CLOSE.get(name, 1e-7)


def test_peers_that_fail(tmp_path, given):
    """A peer that hangs is ended after its time, and one that fails is reported by its last line."""
    from compare_peers import Peer, measure

    def outcome(*command: str, limit: float) -> str:
        peer = Peer("nobody", ("blocks",), lambda: None, lambda folder, count: list(command), lambda case, folder: None)
        return measure(peer, given["blocks"][0], tmp_path, 1, limit, clean_environment()).failure

    assert outcome("sleep", "30", limit=0.3) == "more than 0 s"
    assert outcome("sh", "-c", "echo no licence; exit 3", limit=20.0) == "no licence"
