"""The materials of a body of a deck."""

import numpy as np

from ddmpi.decks.cards import (
    Card,
    DeckError,
    Entries,
    axes,
    called,
    entry,
    integer,
    number,
    numbers,
)
from ddmpi.decks.deck import STRIDE
from ddmpi.decks.model import Model
from ddmpi.decks.pieces import Piece, own_name
from ddmpi.errors import InputError


def table(card: Card, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (k, width) of a material and the temperatures (k,) at which they hold; continued lines are joined."""
    lines = []
    row = list[float]()
    with card.reading():
        for words in card.rows:
            row += numbers(words)
            if len(row) >= width:
                lines.append([*row, 0.0][: width + 1])
                row = []
        if not lines or row:
            raise DeckError(f"{width} values are needed")
    values = np.array(lines)
    return values[:, :width], values[:, width]


def _turned(card: Card) -> np.ndarray:
    """(3, 3) rows are the axes of *ORIENTATION, whose second line turns them by an angle (degrees) about one of them.
    Raises DeckError."""
    found = axes(card)
    row = [*card.rows, []][1]
    if angle := number(entry(row, 1, "0")):
        k = integer(row[0])
        if k not in (1, 2, 3):
            raise DeckError("its axes are turned about one of them, 1 to 3")
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        others = [k % 3, (k + 1) % 3]
        found[others] = np.array([[c, s], [-s, c]]) @ found[others]
    return found


class Matter:
    """The materials of a deck as a scene has them, plane ones by the `family` of the elements."""

    def __init__(self, model: Model, family: str) -> None:
        self.model = model
        self.notes = model.notes
        self.family = family
        self.owner: dict[int, int] = {}  # section by element; the last one counts
        for k, (members, _, thick, _, card) in enumerate(model.sections):
            self._tell_others(k)
            self.owner |= dict.fromkeys(members, k)
            if thick < 0.0:
                raise card.error("the thickness is negative")
        depths = {
            section[2] for k, section in enumerate(model.sections) if k in set(self.owner.values())
        }
        self.varies = len(depths) > 1 and family == "CPS"
        if len(depths) > 1 and (family == "CPE" or (family == "CPS" and model.pairs)):
            raise InputError(
                f"plane sections are {' and '.join(map(str, sorted(depths)))} thick; plane strain, and "
                "bodies in contact, have one depth"
            )
        self.depth = depths.pop() if family in ("CPE", "CPS") and len(depths) == 1 else 1.0

    def _tell_others(self, k: int) -> None:
        """Note the elements of a section that have another one before it; those of a step may replace a first one."""
        sections = self.model.sections
        members, *own, card = sections[k]
        before = {self.owner[element] for element in members if element in self.owner}
        cards = [sections[j][4] for j in before if [*sections[j][1:4]] != own]
        lines = [other.line for other in cards if other.word == card.word]
        if lines:
            words = f"elements that line {', '.join(map(str, sorted(lines)))} gives another section"
            self.notes.changed(card, f"{words} have this one, as in CalculiX")

    def sections(self, piece: Piece) -> dict[int, np.ndarray]:
        """The sections of a body, and their elements. Raises InputError for elements without one."""
        own = np.array([self.owner.get(element, -1) for element in piece.elements.tolist()])
        if (own < 0).any():
            raise InputError(
                f"element {piece.elements[own < 0][0] % STRIDE} of {piece.name} has no *SOLID SECTION; is "
                "the deck cut off?"
            )
        return {int(k): piece.elements[own == k] for k in np.unique(own)}

    def of(self, piece: Piece, expansions: dict[str, np.ndarray]) -> list[Entries]:
        """The materials of a body, with the `expansions` (3,) by name where it is heated."""
        different: dict[tuple[str, str], tuple[Entries, list[np.ndarray]]] = {}
        for k, elements in self.sections(piece).items():
            _, name, thick, orientation, card = self.model.sections[k]
            if name not in self.model.materials:
                raise card.error(f"there is no *MATERIAL {name}")
            for heat, some in self._by_heat(name, piece, elements):
                alpha = expansions.get(name, np.zeros(3))
                directed = bool(np.ptp(alpha))
                material = self._elastic(name, self._axes(orientation, card), heat, card, directed)
                if name in expansions:
                    material["expansion"] = alpha.tolist() if directed else float(alpha[0])
                if self.family == "CPS":
                    material["plane"] = "stress"
                    if self.varies:
                        material["thickness"] = thick
                different.setdefault((name, repr(material)), (material, []))[1].append(some)
        if len(different) == 1:
            return [next(iter(different.values()))[0]]
        result = []
        for (name, _), (material, parts) in different.items():
            on = own_name(name, piece.taken)
            piece.materials[on] = np.concatenate(parts)
            result.append({"on": on} | material)
        return result

    def _axes(self, orientation: str, card: Card) -> np.ndarray:
        """(3, 3) rows are the axes of a section's material."""
        if not orientation:
            return np.eye(3)
        known = self.model.orientations
        own = f"{called(card.scope)}.{orientation}"
        if own not in known and orientation not in known:
            raise card.error(f"there is no *ORIENTATION {orientation}")
        given = known[own if own in known else orientation]
        with given.reading():
            return np.zeros((3, 3)) if given.says("SYSTEM", "R")[0] != "R" else _turned(given)

    def _by_heat(
        self, name: str, piece: Piece, elements: np.ndarray
    ) -> list[tuple[float, np.ndarray]]:
        """The elements by their mean temperatures, where the moduli vary with these."""
        card = self.model.materials[name].get("ELASTIC")
        if card is None or len(card.rows) < 2:
            return [(0.0, elements)]
        _, nodal = self.model.temperatures(piece.nodes.tolist())
        heats = np.round(
            np.concatenate(
                [
                    nodal[np.searchsorted(piece.nodes, block.entries[:, 1:])].mean(axis=1)
                    for block in piece.blocks
                ]
            ),
            6,
        )[np.isin(piece.elements, elements)]
        own = piece.elements[np.isin(piece.elements, elements)]
        return [(float(heat), own[heats == heat]) for heat in np.unique(heats)]

    def _elastic(
        self, name: str, axes: np.ndarray, heat: float, section: Card, directed: bool
    ) -> Entries:
        """young, poisson and, of an orthotropic material or of `directed` expansion, shear along x, y and z, at a
        temperature."""
        card = self.model.materials[name].get("ELASTIC")
        if card is None:
            raise section.error(f"the material {name} has no *ELASTIC")
        kind = card.says("TYPE", "ISOTROPIC")
        width = 2 if kind.startswith("ISO") else 21 if kind.startswith("ANISO") else 9
        values, at = table(card, width)
        row = values[0]
        if len(values) > 1:
            order = np.argsort(at)
            row = np.array([np.interp(heat, at[order], column[order]) for column in values.T])
            self.notes.changed(card, "moduli at the mean temperature of each element at the end")
        if width == 2:
            E = float(row[0])
            nu = float(row[1])
            if not directed:
                return {"young": E, "poisson": nu}
            return self._orthotropic(np.repeat([E, nu, 0.5 * E / (1.0 + nu)], 3), axes, card)
        if width == 21:
            self.notes.lost(card, "a material without planes of symmetry")
            return {"young": 1.0, "poisson": 0.0}
        if not kind.startswith(
            "ENGINEERING"
        ):  # the stiffness D1111, D1122, D2222, D1133, D2233, D3333, D1212, …
            stiffness = np.array(
                [[row[0], row[1], row[3]], [row[1], row[2], row[4]], [row[3], row[4], row[5]]]
            )
            if np.linalg.matrix_rank(stiffness) < 3:
                raise card.error("the stiffness is singular")
            S = np.linalg.inv(stiffness)
            young = 1.0 / np.diag(S)
            row = np.array(
                [*young, -S[1, 0] * young[0], -S[2, 0] * young[0], -S[2, 1] * young[1], *row[6:]]
            )
        return self._orthotropic(row, axes, card)

    def _orthotropic(self, row: np.ndarray, axes: np.ndarray, card: Card) -> Entries:
        plain = np.allclose(axes, np.eye(3))
        turned = {}
        if self.family == "C3D" and axes.any():
            turned = {} if plain else {"axes": axes[:2].tolist()}
        elif self.family != "CAX" and abs(axes[2, 2]) == 1.0:  # the third axis is z
            turned = {"angle": float(np.degrees(np.arctan2(axes[0, 1], axes[0, 0])))}
        elif not plain:
            self.notes.lost(card, "axes of a material that turn from place to place")
        shear = row[6:].tolist() if self.family == "C3D" else float(row[6])
        return {"young": row[:3].tolist(), "poisson": row[3:6].tolist(), "shear": shear} | turned
