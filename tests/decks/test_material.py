"""What a deck says of materials: constants of stiffness, of temperatures, and what is refused."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from decks import grid, step

from ddmpi.decks.scene import import_deck
from ddmpi.errors import InputError

YOUNG, POISSON, SHEAR = (11e3, 7e3, 5e3), (0.31, 0.22, 0.17), (3e3, 2e3, 1.5e3)
"""Along 1, 2, 3; of 12, 13, 23."""


def material(
    folder: Path, *elastic: str, partial: bool = False, more: str = ""
) -> tuple[dict, str]:
    """The table of the material of a block with these lines of *ELASTIC, and the lists."""
    deck = grid("A", (1, 1, 1), (1.0, 1.0, 1.0))
    deck += "*MATERIAL, NAME=M\n" + "".join(f"{line}\n" for line in elastic)
    deck += f"*SOLID SECTION, ELSET=A, MATERIAL=M\n{more}*BOUNDARY\nA_Z0, 1, 3\n"
    folder.joinpath("deck.inp").write_text(deck + step("*CLOAD", "A_Z1, 3, 1."), encoding="utf-8")
    lists = import_deck(folder / "deck.inp", folder / "deck", partial)
    scene = tomllib.loads((folder / "deck" / "scene.toml").read_text(encoding="utf-8"))
    return scene["body"][0]["material"], lists


def stiffness() -> np.ndarray:
    """(6, 6) by inverting the compliance: 11, 22, 33, 12, 13, 23."""
    (E1, E2, E3), (n12, n13, n23) = YOUNG, POISSON
    S = np.diag([1 / E1, 1 / E2, 1 / E3, *(1 / np.array(SHEAR))])
    S[0, 1] = S[1, 0] = -n12 / E1
    S[0, 2] = S[2, 0] = -n13 / E1
    S[1, 2] = S[2, 1] = -n23 / E2
    return np.linalg.inv(S)


def rows(numbers) -> list[str]:
    """Eight in the first line."""
    words = [repr(float(number)) for number in numbers]
    return [", ".join(words[:8]), ", ".join(words[8:])]


@pytest.mark.parametrize("kind", ["ORTHO", "ENGINEERING CONSTANTS"])
def test_orthotropic_constants_are_those_of_a_stiffness(tmp_path, kind):
    """D1111, D1122, D2222, D1133, D2233, D3333, D1212, D1313, D2323, or moduli and ratios."""
    D = stiffness()
    pairs = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (3, 3), (4, 4), (5, 5)
    given = [D[pair] for pair in pairs] if kind == "ORTHO" else (*YOUNG, *POISSON, *SHEAR)
    found, _ = material(tmp_path, f"*ELASTIC, TYPE={kind}", *rows(given))
    assert found["young"] == pytest.approx(YOUNG) and found["poisson"] == pytest.approx(POISSON)
    assert found["shear"] == pytest.approx(SHEAR) and "axes" not in found


def test_constants_without_planes_of_symmetry_are_lost(tmp_path):
    given = [f"{100.0 + k}" for k in range(21)]
    lines = [", ".join(given[:8]), ", ".join(given[8:16]), ", ".join(given[16:])]
    found, lists = material(tmp_path, "*ELASTIC, TYPE=ANISO", *lines, partial=True)
    assert found == {"young": 1.0, "poisson": 0.0}
    assert "a material without planes of symmetry" in lists


def test_a_stiffness_that_is_singular_is_refused(tmp_path):
    with pytest.raises(InputError, match="the stiffness is singular"):
        material(tmp_path, "*ELASTIC, TYPE=ORTHO", *rows([1, 1, 1, 0, 0, 1, 1, 1, 1]))


@pytest.mark.parametrize(
    ("heat", "young", "poisson"), [(20, 2e3, 0.2), (50, 1.4e3, 0.26), (900, 1e3, 0.3)]
)
def test_moduli_at_a_temperature(tmp_path, heat, young, poisson):
    """Between two rows, in any order, in proportion; beyond them those of the nearest."""
    heated = f"*INITIAL CONDITIONS, TYPE=TEMPERATURE\nA_Z0, {heat}.\nA_Z1, {heat}.\n"
    hot, cold = "1000., 0.3, 70.", "2000., 0.2, 20."
    found, lists = material(tmp_path, "*ELASTIC", hot, cold, more=heated)
    assert found["young"] == pytest.approx(young) and found["poisson"] == pytest.approx(poisson)
    assert "moduli at the mean temperature" in lists


def test_a_material_without_moduli_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"the material M has no \*ELASTIC"):
        material(tmp_path, "*DENSITY", "1.")
