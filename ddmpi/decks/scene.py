"""The scene of a deck: bodies with materials, clamps and loads, contacts, histories; and `ddmpi import`."""

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ddmpi.decks.acting import Acts
from ddmpi.decks.cards import (
    DROPPED,
    EXACT,
    FAMILIES,
    PARAMETERS,
    SOLID,
    VALUES,
    Block,
    Card,
    Course,
    DeckError,
    Entries,
    Notes,
    axes,
    called,
    shape,
)
from ddmpi.decks.deck import Deck, refuse_lost
from ddmpi.decks.equations import Equations
from ddmpi.decks.joints import Joints
from ddmpi.decks.material import Matter
from ddmpi.decks.model import Model
from ddmpi.decks.pieces import Cut, Piece, cut, elements_of, own_name, rows_of, split
from ddmpi.decks.rigid import RigidSets
from ddmpi.errors import InputError
from ddmpi.scene.reader import read_scene, write_toml
from ddmpi.system.files import refuse_taken

VARIANTS = {
    "": "",
    "R": "full integration",
    "I": "no incompatible modes",
    "RI": "full integration",
    "H": "",
    "IH": "no incompatible modes",
    "RH": "full integration",
    "M": "",
    "MH": "",
    "T": "",
    "RT": "full integration",
}
"""What changes in the variants of elements; others are refused."""

CUT = {
    "hexahedron": "tetrahedra",
    "wedge": "tetrahedra",
    "pyramid": "tetrahedra",
    "quad": "triangles",
}
"""Elements that are cut, and into what."""

METALS = 4e4, 1e6
"""Moduli of metals in MPa, neither in Pa nor in ksi."""


class Importer:
    """A scene in the making: bodies, their clamps and loads, and the histories that these follow."""

    def __init__(
        self,
        path: Path,
        amplitudes: Sequence[str] = (),
        changing: Sequence[tuple[Card, str]] = (),
    ) -> None:
        self.notes = Notes(path)
        self.deck = Deck(path)
        self.model = Model(self.deck, self.notes, amplitudes, changing)
        linear = len(self.model.ends) == 1 and all(
            card.word == "TIE" for card, *_ in self.model.pairs
        )
        for card in self.deck.cards:
            if card.word in ("TRANSFORM", "ORIENTATION") and card.says("SYSTEM", "R")[0] == "R":
                with card.reading():
                    axes(card)
            if card.place not in self.model.left_out:
                self._tell_parameters(card, linear)
        self._tell_sets()
        self.cuts: list[Cut] = []
        self.family, blocks = self._elements()
        self.pieces = self._pieces(blocks)
        self.order = 1 if all(piece.straight for piece in self.pieces) else 2
        self.integration = {piece.name: self._integration(piece) for piece in self.pieces}
        self.matter = Matter(self.model, self.family)
        self.acts = Acts(self.matter, self.pieces, self.cuts)

    def _tell_parameters(self, card: Card, linear: bool) -> None:
        """Note parameters that have no meaning in a scene; of a deck that is `linear` *STEP, PERTURBATION has."""
        for name, value in card.given.items():
            key = card.word, name
            values = VALUES.get(key, ())
            if name == "PERTURBATION" and linear:
                continue
            if name not in PARAMETERS.get(card.word, card.given):
                self.notes.lost(card, f"its parameter {name} is not possible")
            elif values and called(value).upper() not in values:
                self.notes.lost(card, f"{name}={value} is not possible")
            elif key in DROPPED:
                self.notes.changed(card, DROPPED[key])

    def _tell_sets(self) -> None:
        """Note what sets name that is not there, and what they get too late."""
        for card, words in self.deck.lost():
            self.notes.changed(card, f"{words}; left out")
        for card, words in self.deck.told:
            self.notes.changed(card, words)

    def _pieces(self, blocks: Sequence[Block]) -> list[Piece]:
        """The bodies of these elements. Raises DeckError where nodes are not there."""
        numbers, points = self.deck.placed()
        rows = rows_of(blocks)
        for block in blocks:
            refuse_lost(block.entries, numbers)
            if self.family != "C3D":
                with block.card.reading():
                    self._refuse_outside(points[np.isin(numbers, block.entries[:, 1:])])
        points = points if self.family == "C3D" else points[:, :2]
        for card in self.model.bolts:
            if "SURFACE" not in card.given:
                self.notes.lost(card, "a pre-tension that is not of a section of solid elements")
                continue
            with card.reading():
                ends = set(self.deck.ends(card, card.given["SURFACE"]))
            rows, section, around = cut(blocks, rows, ends, numbers, points)
            self.cuts.append((card, ends, section, around))
        pieces: list[Piece] = []
        sets = self._element_sets()
        for own in split(blocks, rows):
            elements = frozenset(elements_of(own).tolist())
            named = sets.get(elements) or f"part{len(pieces) + 1}"
            name = own_name(named, [piece.name for piece in pieces])
            pieces.append(Piece(name, own, numbers, points, self.family == "CAX"))
        return pieces

    def _refuse_outside(self, points: np.ndarray) -> None:
        """Raise DeckError for plane elements whose nodes have these points (n, 3) not in one plane across z, and around
        an axis not on one side of it."""
        x, _, z = points.T
        close = EXACT * np.ptp(points, axis=0).max()
        if np.ptp(z) > close:
            raise DeckError("its nodes have different z, and plane elements are seen along z")
        if self.family == "CAX" and x.min() < -close:
            raise DeckError(f"a node has the radius {x.min():g}, on the other side of the axis y")

    def _elements(self) -> tuple[str, list[Block]]:
        """The family of the elements that a scene may have, and these. Raises InputError where there are none."""
        notes = self.notes
        families = defaultdict[str, list[Block]](list)
        for card in self.deck.odd:
            notes.lost(card, f"elements of type {card.given.get('TYPE', '(none)')}")
        for block in self._structural():
            name = block.card.says("TYPE")
            fits = FAMILIES.match(name)
            if not fits or fits[3] not in VARIANTS:
                notes.lost(block.card, f"elements of type {name}")
                continue
            families[fits[1]].append(block)
            notes.taken(block.card, f"elements of type {name}")
        if not families:
            raise InputError(
                "it has no elements that a scene may have: C3D4 to C3D20, CPE, CPS and CAX"
            )
        if len(families) > 1:
            raise InputError(
                f"it has elements of the families {' and '.join(sorted(families))}; a scene has one"
            )
        return families.popitem()

    def _structural(self) -> list[Block]:
        """The elements; where some that a scene may have are in sections, without those of other families that are in
        none: programs that draw meshes write the faces of solids as such ones. Rigid elements need no section."""
        found: list[Block] = []
        own = set[int]()
        for card in self.deck.cards:
            key = self.deck.key("ELSET", card.scope, card.given.get("ELSET", ""))
            if card.word.endswith("SECTION") and key:
                own |= self.deck.members("ELSET", ("", key))
        families = {
            _family(block) for block in self.deck.blocks if not own.isdisjoint(block.entries[:, 0])
        }
        for block in self.deck.blocks:
            if families.isdisjoint(SOLID) or _family(block) in {"R", *families}:
                found.append(block)
            else:
                words = f"elements of type {block.card.says('TYPE')} without a section are left out"
                self.notes.changed(block.card, words)
        return found

    def _integration(self, piece: Piece) -> str | None:
        """The integration of a piece, that of its first elements, with notes of what changes in all."""
        found = list[str | None]()
        for block in piece.blocks:
            integration, words = self._in_scene(block, piece.kept)
            found.append(integration)
            if integration != found[0]:
                words = [f"{block.card.says('TYPE')} as the other elements of its body"]
            if piece.uniform and not piece.kept:
                words = [
                    *words,
                    f"{block.name}: an element of its body is not convex, so that all are cut",
                ]
            for each in words:
                self.notes.changed(block.card, each)
        return found[0]

    def _in_scene(self, block: Block, kept: bool) -> tuple[str | None, list[str]]:
        """The integration that elements have in a scene, and what changes in them; of bodies that are `kept` whole."""
        name = block.card.says("TYPE")
        linear = block.kind in CUT
        fits = FAMILIES.match(name)
        assert fits
        changed = [f"{name} as {block.name}: {VARIANTS[fits[3]]}"] if VARIANTS[fits[3]] else []
        if not kept:
            cut = f"{block.name} cut into quadratic {CUT.get(shape(block.kind))}"
            cut += ": linear ones would be too stiff" * linear
            return None, changed + [cut] * (shape(block.kind) in CUT)
        if self.order > 1:
            raised = [f"{block.name} becomes quadratic, as other elements are"] * linear
            little = f"{name}: reduced integration with a thousandth of the full one, against hourglass modes"
            return ("reduced", [*raised, little]) if "R" in fits[3] else (None, raised)
        if self.family == "CAX":
            return None, changed
        if "I" in fits[3]:
            return "modes", []
        if "R" in fits[3]:
            return "modes", [f"{name}: incompatible modes in place of reduced integration"]
        return "full", [
            f'{name}: full integration, which locks in bending; integration = "modes" does not'
        ]

    def _element_sets(self) -> dict[frozenset[int], str]:
        """Names of sets of elements by their members; those of sections first; within instances their names."""
        found: dict[frozenset[int], str] = {}
        of_sections = {called(card.given["ELSET"]) for *_, card in self.model.sections}
        named = {key: name for (kind, key), name in self.deck.names.items() if kind == "ELSET"}
        for key in sorted(named, key=lambda key: key.rpartition(".")[2] not in of_sections):
            scope = key.rpartition(".")[0]
            name = self.deck.places[scope].name if scope in self.deck.places else named[key]
            members = self.deck.members("ELSET", ("", key)) & self.deck.elements
            found.setdefault(frozenset(members), name)
        return found

    def scene(self, title: str) -> Entries:
        """The scene as plain data, and groups in the pieces. Raises InputError."""
        acts = self.acts
        equations = Equations(self.acts)
        tractions = acts.loads()
        joints = Joints(acts)
        sets = RigidSets(acts)
        bodies = []
        stiffest = 0.0
        for piece in self.pieces:
            heat, expansions = acts.heat(piece)
            materials = self.matter.of(piece, expansions)
            stiffest = max(stiffest, *(np.max(one["young"]) for one in materials))
            bodies.append(
                {
                    "name": piece.name,
                    "mesh": _filled(
                        {
                            "file": f"{piece.name}.inp",
                            "order": self.order,
                            "integration": self.integration[piece.name],
                        }
                    ),
                    "material": materials[0] if len(materials) == 1 else materials,
                    "clamp": acts.clamps(piece) + sets.clamps[piece.name],
                    "traction": tractions[piece.name] + sets.tractions[piece.name],
                    "volume_force": acts.volume_forces(piece),
                    "temperature": heat,
                }
            )
        contacts = [contact for pair in self.model.pairs for contact in joints.contacts(*pair)]
        joints.unmet()
        scene: Entries = {
            "title": title,
            "axisymmetric": self.family == "CAX" or None,
            "body": [*map(_filled, bodies)],
            "rigid": sets.partners,
            "contact": _with_names([*contacts, *sets.bonds, *equations.bonds, *joints.bolts()]),
        }
        said = repr(scene)
        scene["history"] = {
            name: _history(course) for course, name in acts.histories.items() if repr(name) in said
        }
        if acts.timed:
            sliding = any("friction" in contact for contact in contacts)
            scene["time"] = {"points": self.model.ends} | ({} if sliding else {"steps": 1})
        if METALS[0] <= stiffest <= METALS[1]:
            scene["output"] = {"length_unit": "mm", "stress_unit": "MPa"}
        return _filled(scene)


def _family(block: Block) -> str:
    """The first letters of the name of elements."""
    found = re.match("C3D|[A-Z]+", block.card.says("TYPE"))
    assert found
    return found[0]


def _filled(entries: Entries) -> Entries:
    return {key: value for key, value in entries.items() if value not in (None, [], {})}


def _history(course: Course) -> dict[str, list[float]]:
    times, factors = zip(*course, strict=True)
    return {"times": [*times], "factors": [*factors]}


def _with_names(contacts: Sequence[Entries]) -> list[Entries]:
    """Contacts with names of their own, after those of their bodies."""
    names: list[str] = []
    for contact in contacts:
        names.append(own_name("-".join(contact["bodies"]), names))
    return [{"name": name} | contact for name, contact in zip(names, contacts, strict=True)]


def import_deck(
    deck: str | Path, output: str | Path, partial: bool = False, amplitudes: Sequence[str] = ()
) -> str:
    """Write a scene and its meshes into a folder; the lists of what was taken, changed and lost. Times and factors of
    `amplitudes`, such as "RAMP=0,0,1,1", replace those of the deck. Not collective.

    Raises InputError for a deck that is no scene; if loads, supports or contacts were lost, unless `partial`; and
    TakenError where a file would be overwritten.
    """
    path = Path(deck)
    folder = Path(output)
    try:
        importer = Importer(path, amplitudes)
        scene = importer.scene(path.stem)
        if importer.notes.between:  # without friction the state at the end is one
            importer = Importer(path, amplitudes, importer.notes.between)
            scene = importer.scene(path.stem)
    except (InputError, DeckError, OSError) as error:
        raise InputError(f"{deck}: {error}") from None
    lists = {title: importer.notes.words(title) for title in ("taken", "changed", "lost")}
    if lists["lost"] and not partial:
        raise InputError(
            f"{deck}: a scene would be another problem without what is not possible; nothing is written "
            "(--partial writes it all the same)"
            + "".join(f"\n  {line}" for line in lists["lost"])
            + "\n  if its steps are load cases, keep one step per deck"
            * bool(importer.notes.between)
        )
    tried = write_toml(scene)
    kind = 2 if importer.family != "C3D" else 3, importer.order
    read_scene(f"{deck}: its scene", tried, file_kind=lambda spec: kind)
    text = (
        f"# from {path.name}; lengths, stresses and forces are in the units of the deck\n" + tried
    )
    files = ["scene.toml", *(f"{piece.name}.inp" for piece in importer.pieces)]
    refuse_taken(*(folder / name for name in files))
    folder.mkdir(parents=True, exist_ok=True)
    for piece in importer.pieces:
        piece.write(folder / f"{piece.name}.inp")
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return _told(importer, scene, lists, folder)


def _told(importer: Importer, scene: Entries, lists: dict[str, list[str]], folder: Path) -> str:
    """The lists, with the units and the size of the scene."""
    touched = {name for contact in scene.get("contact", []) for name in contact["bodies"]}
    loose = [
        body["name"]
        for body in scene["body"]
        if "clamp" not in body and body["name"] not in touched
    ]
    return "\n".join(
        [
            *(
                f"{title}:\n" + ("".join(f"  {line}\n" for line in lines) or "  nothing\n")
                for title, lines in lists.items()
            ),
            "units: those of the deck, "
            + (
                "by its moduli labelled mm and MPa"
                if "output" in scene
                else "labelled m and Pa; others: length_unit, stress_unit of [output]"
            )
            + "\n",
            *(
                f"warning: no support and no contact holds {name}; what acts on it must be in balance\n"
                for name in loose
            ),
            f"{folder / 'scene.toml'}: {_count(len(importer.pieces), 'body', 'bodies')}, "
            + _count(len(scene.get("contact", [])), "contact", "contacts"),
        ]
    )


def _count(number: int, one: str, several: str) -> str:
    return f"{number or 'no'} {one if number == 1 else several}"
