"""scripts/study peers: every peer that is there finds ddmpi's answer, and one that hangs or fails is a line."""

import pytest

PLACES = {"boxes": 4, "tall": 3, "ball": 4, "wall": 1}
CLOSE = {"calculix-faces": 0.25, "calculix-mortar": 0.05, "calculix-2": 0.05, "getfem-2": 0.05}
"""Springs, pressures at nodes; other multipliers at order 2. Everybody else solves the same equations."""

SOLVED = {
    "boxes": ("petsc", "getfem", "calculix-faces", "calculix-mortar", "calculix-2", "getfem-2"),
    "tall": ("petsc", "getfem"),
    "wall": ("petsc", "getfem"),
    "ball": ("petsc", "getfem", "calculix-faces"),
}


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A function of scene and order: the case, its folder and the row of ddmpi's run."""
    from compare_peers import PEERS, measure, row_of, write_case

    found = {}

    def solve(scene: str, order: int):
        if (scene, order) not in found:
            folder = tmp_path_factory.mktemp(f"{scene}-{order}")
            case = write_case(scene, PLACES[scene], folder, order)
            result = measure(PEERS["ddmpi" if order == 1 else "ddmpi-2"], case, folder, 60.0)
            assert not result.failure
            found[scene, order] = case, folder, row_of(case, result) | {"scene": scene}
        return found[scene, order]

    return solve


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "name"), [(scene, name) for scene, names in SOLVED.items() for name in names]
)
def test_peer_agrees(scene, name, solved):
    """A peer's forces, largest pressure and displacement are those of ddmpi on the same mesh."""
    from compare_peers import PEERS, difference, measure, row_of

    peer = PEERS[name]
    if peer.missing:
        pytest.skip(f"there is no {peer.needs}")
    case, folder, own = solved(scene, peer.order)
    result = measure(peer, case, folder, 20.0)
    assert not result.failure
    assert difference(own, row_of(case, result)) < CLOSE.get(name, 1e-7)


@pytest.mark.slow
def test_peers_that_fail(tmp_path, solved):
    """A peer that hangs or computes for too long is ended, and one that fails is reported by its last line."""
    from compare_peers import Peer, measure

    def outcome(*command: str, limit: float) -> str:
        peer = Peer("nobody", "sh", lambda folder: list(command), lambda case, folder: None)
        return measure(peer, solved("boxes", 1)[0], tmp_path, limit).failure

    assert outcome("sleep", "30", limit=0.3) == "not done in 0 s"
    assert outcome("sh", "-c", "while true; do :; done", limit=1.0) == "not done in 1 s"
    assert outcome("sh", "-c", "echo no licence; exit 3", limit=20.0) == "no licence (exit code 3)"
