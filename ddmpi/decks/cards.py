"""The keywords of an Abaqus or CalculiX deck, with their parameters and data lines, parts where they are used; the
words for elements, with the corners around their faces and at their edges; and loads, contacts and rigid sets."""

import contextlib
import math
import os
import re
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ddmpi.errors import InputError

SIDES: dict[str, list[tuple[int, int]]] = {
    shape: [(int(side[0]), int(side[1])) for side in sides.split()]
    for shape, sides in {
        "line": "01",
        "triangle": "01 12 20",
        "quad": "01 12 23 30",
        "tetra": "01 12 20 03 13 23",
        "hexahedron": "01 12 23 30 45 56 67 74 04 15 26 37",
        "wedge": "01 12 20 34 45 53 03 14 25",
        "pyramid": "01 12 23 30 04 14 24 34",
    }.items()
}
"""Corners at the ends of the edges of an element, whose middles come in this order, which is VTK's."""

FACES: dict[str, list[tuple[int, ...]]] = {
    shape: [tuple(map(int, face)) for face in faces.split()]
    for shape, faces in {
        "tetra": "012 013 123 203",
        "hexahedron": "0123 4567 0154 1265 2376 3047",
        "wedge": "012 345 0143 1254 2035",
        "pyramid": "0123 014 124 234 304",
    }.items()
}
"""Corners around the faces S1, S2, … of solid elements; those of plane ones are their SIDES."""

ELEMENTS: dict[str, dict[int, str]] = {
    "CPE|CPS|CPEG|CAX|CGAX|S|STRI|M3D|SFM3D|R3D": {
        3: "triangle",
        4: "quad",
        6: "triangle6",
        65: "triangle6",
        8: "quad8",
        9: "quad9",
    },
    "C3D": {
        4: "tetra",
        5: "pyramid",
        6: "wedge",
        8: "hexahedron",
        10: "tetra10",
        15: "wedge15",
        20: "hexahedron20",
    },
    "T2D|T3D": {2: "line", 3: "line3"},
    "B2|B3": {1: "line", 2: "line3", 3: "line"},
}
"""Abaqus's names of elements: letters and a number; further letters are ignored."""

KEPT = ("quad", "hexahedron")
"""Shapes that bodies keep which have elements of no other shape; all but simplices are cut elsewhere."""

AROUND = {
    "quad": ["013", "120", "231", "302"],
    "hexahedron": ["0134", "1205", "2316", "3027", "4750", "5461", "6572", "7643"],
}
"""Of these shapes each corner with those at the other ends of its edges, right-handed."""


def are_upright(corners: np.ndarray, shape: str) -> np.ndarray:
    """(n,) bool, of which quadrilaterals or hexahedra with `corners` (n, c, d) the maps turn at no corner."""
    first, *others = np.array([list(map(int, each)) for each in AROUND[shape]]).T
    edges = corners[:, np.array(others)] - corners[:, first][:, None]
    turn = np.linalg.det(edges.transpose(0, 2, 1, 3))
    return (turn > 0.0).all(axis=1) | (turn < 0.0).all(axis=1)


SOLID = ("C3D", "CPE", "CPS", "CAX")
"""Families of elements that a scene may have."""

FAMILIES = re.compile(rf"({'|'.join(SOLID)})(\d+)([A-Z]*)$")
"""Elements that a scene may have: family, nodes and variant."""

SHAPELESS = ("MASS", "ROTARYI", "SPRING", "DASHPOT", "CONN", "GAP", "DCOUP")
"""Prefixes of the names of elements that have no shape."""


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


SILENT = _words(
    "HEADING ENDSTEP PHYSICALCONSTANTS CONTROLS PREPRINT NODEPRINT ELPRINT NODEFILE ELFILE "
    "CONTACTFILE CONTACTPRINT FACEPRINT SECTIONPRINT ENERGYPRINT ENERGYFILE OUTPUT NODEOUTPUT "
    "ELEMENTOUTPUT CONTACTOUTPUT ENERGYOUTPUT MONITOR PRINT TIMEPOINTS FILEFORMAT "
    "PARAMETER NORMAL ENDPART ENDASSEMBLY ENDINSTANCE SURFACESMOOTHING PRE-TENSIONSECTION "
    "SHELLSECTION BEAMSECTION BEAMGENERALSECTION MEMBRANESECTION MEMBRANE FLUIDSECTION SPRING "
    "DASHPOT MASS"
)
"""Keywords about output, those that count where others name them, and those of elements that are lost themselves."""

WITHOUT_EFFECT = {
    word: what
    for what, words in {
        "heat changes no static answer": "CONDUCTIVITY SPECIFICHEAT LATENTHEAT GAPCONDUCTANCE GAPHEATGENERATION "
        "INELASTICHEATFRACTION JOULEHEATFRACTION CFLUX DFLUX FILM RADIATE",
        "currents change no static answer": "ELECTRICALCONDUCTIVITY MAGNETICPERMEABILITY",
        "speeds change no static answer": "DAMPING CONTACTDAMPING",
        "how programs iterate changes no answer": "CONTACTCONTROLS",
        "there are no hourglass modes to control": "SECTIONCONTROLS",
    }.items()
    for word in words.split()
}
"""Keywords of data that other programs write always, and why they change nothing here."""

PERTURBATIONS = _words(
    "FREQUENCY BUCKLE COMPLEXFREQUENCY MODALDYNAMIC STEADYSTATEDYNAMICS GREEN SENSITIVITY "
    "SUBSTRUCTUREGENERATE NOANALYSIS"
)
"""Steps that leave the state of a deck as it is."""

OF_STEPS = _words(
    "STATIC CLOAD DLOAD DSLOAD TEMPERATURE MODELCHANGE CHANGESOLIDSECTION CHANGEFRICTION CHANGESURFACEBEHAVIOR"
)
"""Keywords that have no meaning outside of steps."""

BEFORE_STEPS = _words(
    "SOLIDSECTION MATERIAL TRANSFORM INITIALCONDITIONS CONTACTPAIR SURFACEINTERACTION CLEARANCE TIE RIGIDBODY COUPLING "
    "EQUATION MPC PRE-TENSIONSECTION CYCLICSYMMETRYMODEL"
)
"""Keywords of the model, which have no meaning within steps."""

REFUSED = {
    "DISTRIBUTINGCOUPLING": "couplings",
    "KINEMATICCOUPLING": "couplings",
    "SUBMODEL": "displacements of another model",
    "CHANGEMATERIAL": "materials that change",
    "CONTACT": "general contact; name each pair of surfaces by *CONTACT PAIR",
    "PLASTIC": "plasticity",
    "CYCLICHARDENING": "plasticity",
    "DEFORMATIONPLASTICITY": "plasticity",
    "CREEP": "creep",
    "HYPERELASTIC": "rubber",
    "HYPERFOAM": "foam",
    "USERMATERIAL": "materials of a user's routine",
    "VISCOELASTIC": "viscoelasticity",
}
"""What becomes impossible by a keyword; any other one that is not read is unknown."""

NAMED_SUPPORTS = {
    "ENCASTRE": "123456",
    "PINNED": "123",
    "XSYMM": "156",
    "YSYMM": "246",
    "ZSYMM": "345",
    "XASYMM": "234",
    "YASYMM": "135",
    "ZASYMM": "126",
}
"""Abaqus's words for supports: the components that they hold; nodes of solids have the first three."""

OVER_TIME = "OP AMPLITUDE TIMEDELAY "

PARAMETERS = {
    word: _words(names)
    for word, names in {
        "NODE": "NSET SYSTEM",
        "ELEMENT": "TYPE ELSET",
        "SURFACE": "NAME TYPE INTERNAL",
        "NSET": "NSET ELSET GENERATE INSTANCE INTERNAL UNSORTED",
        "ELSET": "ELSET GENERATE INSTANCE INTERNAL UNSORTED",
        "TRANSFORM": "NSET TYPE",
        "ORIENTATION": "NAME SYSTEM DEFINITION",
        "MATERIAL": "NAME",
        "SOLIDSECTION": "ELSET MATERIAL ORIENTATION CONTROLS OFFSET",
        "CHANGESOLIDSECTION": "ELSET MATERIAL ORIENTATION",
        "ELASTIC": "TYPE MODULI",
        "DENSITY": "",
        "EXPANSION": "TYPE ZERO",
        "INITIALCONDITIONS": "TYPE FILE",
        "AMPLITUDE": "NAME TIME DEFINITION VALUE USER SMOOTH SHIFTX SHIFTY",
        "STEP": "NAME NLGEOM INC INCF UNSYMM EXTRAPOLATION CONVERTSDI SOLVER AMPLITUDE",
        "STATIC": "DIRECT SOLVER STABILIZE ALLSDTOL CONTINUE FACTOR",
        "BOUNDARY": OVER_TIME + "TYPE FIXED SUBMODEL USER STEP",
        "CLOAD": OVER_TIME + "FOLLOWER",
        "DLOAD": OVER_TIME + "FOLLOWER CONSTANTRESULTANT",
        "DSLOAD": OVER_TIME + "FOLLOWER CONSTANTRESULTANT",
        "TEMPERATURE": OVER_TIME + "FILE USER",
        "RESTART": "WRITE FREQUENCY OVERLAY NUMBERINTERVAL TIMEMARKS TIMEINTERVAL SINGLE",
        "MODELCHANGE": "TYPE REMOVE ADD",
        "FRICTION": "SLIPTOLERANCE LAGRANGE ELASTICSLIP",
        "SURFACEINTERACTION": "NAME",
        "CHANGEFRICTION": "INTERACTION",
        "CHANGESURFACEBEHAVIOR": "INTERACTION",
        "SURFACEBEHAVIOR": "PRESSURE-OVERCLOSURE NOSEPARATION PENALTY AUGMENTEDLAGRANGE DIRECT",
        "CONTACTPAIR": "INTERACTION TYPE SMALLSLIDING ADJUST MECHANICALCONSTRAINT CPSET EXTENSIONZONE HCRIT NOTHICKNESS "
        "SMOOTH TRACKING SUPPLEMENTARYCONSTRAINTS SLIDINGTRANSITION",
        "CLEARANCE": "SLAVE MASTER VALUE",
        "PRE-TENSIONSECTION": "SURFACE NODE ELEMENT",
        "TIE": "NAME ADJUST POSITIONTOLERANCE TYPE NOROTATION NOTHICKNESS CONSTRAINTRATIO CYCLICSYMMETRY",
        "CYCLICSYMMETRYMODEL": "N TIE NGRAPH ELSET CHECK",
        "RIGIDBODY": "NSET TIENSET REFNODE ROTNODE ELSET PINNSET ANALYTICALSURFACE",
        "COUPLING": "CONSTRAINTNAME REFNODE SURFACE",
        "KINEMATIC": "",
        "DISTRIBUTING": "WEIGHTINGMETHOD COUPLING",
        "EQUATION": "",
        "MPC": "",
    }.items()
}
"""Keywords that are read, and their parameters that are read or change no answer; any other parameter is lost."""

VALUES = {
    tuple(key.split()): _words(values)
    for keys, values in {
        "BOUNDARY OP|CLOAD OP|DLOAD OP|DSLOAD OP|TEMPERATURE OP": "NEW MOD",
        "AMPLITUDE TIME": "STEPTIME TOTALTIME",
        "STEP AMPLITUDE": "STEP RAMP",
        "SURFACE TYPE": "NODE ELEMENT",
        "CONTACTPAIR TYPE": "NODETOSURFACE SURFACETOSURFACE MORTAR LINMORTAR PGMORTAR PGLINMORTAR",
        "ELASTIC TYPE": "ISO ISOTROPIC ANISO ANISOTROPIC ORTHO ORTHOTROPIC ENGINEERINGCONSTANTS",
        "EXPANSION TYPE": "ISO ISOTROPIC ANISO ANISOTROPIC ORTHO ORTHOTROPIC",
    }.items()
    for key in keys.split("|")
}
"""The values, in capitals without blanks, that some parameters of keywords have; any other one is lost."""

DROPPED = {
    tuple(key.split()): f"{key.split()[1]}: {words}"
    for keys, words in {
        "STATIC STABILIZE": "left out, as equilibria need no damping",
        "SURFACEBEHAVIOR PENALTY|CONTACTPAIR MECHANICALCONSTRAINT": "hard contact, the stiffness is dropped",
        "FRICTION SLIPTOLERANCE|FRICTION ELASTICSLIP": "nodes stick without slip",
    }.items()
    for key in keys.split("|")
}
"""Parameters of keywords, and what is said of them, as a scene does without."""

SUDDEN = 1e-3
"""A load that jumps comes over this fraction of its step, in which other loads change by no more of theirs."""

EVERY = "*"
"""The name of a set of all elements, which no set of a deck can have."""

EXACT = 1e-6
"""Directions, values on linear functions, moments of forces and layers of nodes are equal up to this fraction."""


class DeckError(ValueError):
    """A mistake in a deck, in words, without the line in which it is."""


def element(name: str) -> tuple[str, int]:
    """What meshio calls an element of Abaqus, nothing where it has no shape, and the number of its nodes. Raises
    DeckError for other names."""
    if name.upper().startswith(SHAPELESS):
        return "", 0
    for families, kinds in ELEMENTS.items():
        found = re.match(rf"({families})(\d+)", name.upper())
        if found and int(found[2]) in kinds:
            kind = kinds[int(found[2])]
            return kind, int(re.sub(r"\D", "", kind) or corners(kind))
    raise DeckError(f"the element type {name} is not known")


def shape(kind: str) -> str:
    """The shape of an element by meshio's name, whatever its order."""
    return re.sub(r"\d", "", kind)


def corners(kind: str) -> int:
    """Number of corners of an element by meshio's name."""
    return 1 + max(map(max, SIDES[shape(kind)]))


def faces(kind: str) -> list[tuple[int, ...]]:
    """Corners around the faces of an element in the order of Abaqus; the sides of a plane one."""
    return FACES.get(shape(kind)) or list(SIDES[shape(kind)])


def face(kind: str, name: str, surface: str) -> tuple[int, ...]:
    """The corners of the face S1, S2, … of an element, or of the whole of a shell (SPOS, SNEG). Raises DeckError."""
    all_faces = faces(kind)
    if name in ("SPOS", "SNEG") and shape(kind) in ("triangle", "quad"):
        return tuple(range(len(all_faces)))
    if not re.fullmatch(r"[SE]\d", name) or not 1 <= int(name[1]) <= len(all_faces):
        raise DeckError(
            f"the surface {surface} has {name or 'no'} face of a {shape(kind)}; these are S1 to "
            f"S{len(all_faces)}"
        )
    return all_faces[int(name[1]) - 1]


def number(word: str) -> float:
    """A number as decks write it, with E or D before the exponent. Raises DeckError."""
    try:
        value = float(word.upper().replace("D", "E"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DeckError(f'"{word}" is not a number')
    return value


def integer(word: str) -> int:
    """The number of a node, an element or a component. Raises DeckError."""
    if not re.fullmatch(r"[+-]?\d{1,18}", word):
        raise DeckError(f'"{word}" is not an integer')
    return int(word)


def component(word: str) -> int:
    """The number of a component. Raises DeckError."""
    if integer(word) < 1:
        raise DeckError(f"there is no component {word}")
    return integer(word)


def called(name: str) -> str:
    """A name as it is compared: without blanks, and whatever its case."""
    return "".join(name.split()).lower()


def numbers(row: list[str]) -> list[float]:
    """The numbers of a data line; empty entries are zero."""
    return [number(word) if word else 0.0 for word in row]


def entry(row: list[str], k: int, default: str = "") -> str:
    """The entry k of a data line, or the default where it is empty or missing."""
    return (row[k] if k < len(row) else "") or default


def vector(values: Sequence[float], size: int = 3) -> np.ndarray:
    """The first values as an array (size,); missing ones are zero."""
    return np.array([*values, *[0.0] * size][:size])


def held(row: list[str]) -> tuple[Sequence[int], float]:
    """The components that a data line of *BOUNDARY gives, and their value. Raises DeckError."""
    if row[1].upper() in NAMED_SUPPORTS:
        return [*map(int, NAMED_SUPPORTS[row[1].upper()])], 0.0
    first = component(entry(row, 1, "1"))
    last = component(entry(row, 2, str(first)))
    if last < first:
        raise DeckError(f"it gives the components {first} to {last}")
    return range(first, last + 1), number(entry(row, 3, "0"))


def along(values: Sequence[float]) -> np.ndarray:
    """The unit vector (3,) along such components, of which missing ones are zero. Raises DeckError where all are."""
    if not vector(values).any():
        raise DeckError("a direction is zero")
    return vector(values) / np.linalg.norm(vector(values))


class Card(NamedTuple):
    """One keyword of a deck.

    Attributes
    ----------
    word : the keyword in capitals without blanks, such as SOLIDSECTION
    given : its parameters, names in capitals without blanks, values as written
    rows : the entries of its data lines
    line : its number in `path`
    path : the file, which may be an included one
    name : the keyword in capitals, with single blanks
    scope : name of the instance to which it belongs; empty outside of instances
    place : its number in the deck with all that this includes
    """

    word: str
    given: dict[str, str]
    rows: list[list[str]]
    line: int
    path: Path
    name: str
    scope: str = ""
    place: int = 0

    def says(self, name: str, default: str = "") -> str:
        """The value of a parameter in capitals, or the default."""
        return self.given.get(name, default).upper()

    def name_of(self, name: str) -> str:
        """The value of a parameter as names are compared; empty where it is not given."""
        return called(self.given.get(name, ""))

    def values(self) -> list[float]:
        """The numbers of the first data line, if there is one. Raises DeckError."""
        return numbers(self.rows[0] if self.rows else [])

    def error(self, what: object) -> InputError:
        """A mistake in this keyword, with its line and file."""
        return InputError(f"line {self.line} of {self.path.name}: *{self.name}: {what}")

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Mistakes in what the block reads of this keyword as InputError, with its line and file."""
        try:
            yield
        except DeckError as error:
            raise self.error(error) from None
        except KeyError as error:
            raise self.error(f"it lacks {error.args[0]}") from None
        except IndexError:
            raise self.error("a data line is too short") from None


class Block(NamedTuple):
    """Elements of one keyword: meshio's name, their numbers and nodes (k, 1 + n), and the keyword."""

    kind: str
    entries: np.ndarray
    card: Card

    @property
    def name(self) -> str:
        """Abaqus's name of the family and the number of nodes."""
        return re.sub(r"(\d)[A-Z]+$", r"\1", self.card.says("TYPE"))


Course = tuple[tuple[float, float], ...]
"""Values over time."""

End = tuple[int, int]
"""An element, and the number of one of its faces."""

Entries = dict[str, Any]
"""Keys of a table of a scene, and their values."""


class Acting(NamedTuple):
    """A load or a support: its keyword, its value over time, linear between points (time, value), and what its
    amplitude multiplies."""

    card: Card
    course: Course
    value: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it is ever other than zero."""
        return any(value for _, value in self.course)


class Rigid(NamedTuple):
    """A rigid set of nodes, or one over which forces are `spread`: keyword, nodes, and the reference nodes whose
    displacements are the shift of the set and its turn; one with six components may be both. With `only` the set moves as
    one along this axis alone, the normal of its flat face."""

    card: Card
    nodes: set[int]
    ref: int
    turn: int
    spread: bool = False
    only: int | None = None


class Notes:
    """What became of the keywords: each with the list in which it is, "taken", "changed" or "lost", and the reason."""

    def __init__(self, main: Path) -> None:
        self.main = main
        self.entries = list[tuple[str, Card, str]]()
        self.between = list[tuple[Card, str]]()  # what is lost as it changes from step to step

    def taken(self, card: Card, reason: str) -> None:
        """Note that a keyword is in the scene, and as what."""
        self.entries.append(("taken", card, reason))

    def changed(self, card: Card, reason: str) -> None:
        """Note how a keyword is otherwise in the scene."""
        self.entries.append(("changed", card, reason))

    def lost(self, card: Card, reason: str) -> None:
        """Note why a keyword, or a part of it, is not in the scene."""
        self.entries.append(("lost", card, reason))

    def lost_between_steps(self, card: Card, reason: str) -> None:
        """Note what is lost as it changes from step to step in ways that a scene has not."""
        self.lost(card, reason)
        self.between.append((card, reason))

    def words(self, which: str) -> list[str]:
        """A line of text for each entry of a list, in the order of the deck. A keyword that is lost, if only in part,
        is not listed as taken."""
        lost = {card.place for kind, card, _ in self.entries if (kind, which) == ("lost", "taken")}
        lines = defaultdict[tuple[str, str], dict[int, str]](
            dict
        )  # by keyword and reason, then by place in the deck
        for kind, card, reason in self.entries:
            if kind == which and card.place not in lost:
                where = "" if card.path == self.main else f" of {card.path.name}"
                lines[card.name, reason][card.place] = f"{card.line}{where}"
        return [
            f"line{'s' * (len(some) > 1)} {', '.join(some[place] for place in sorted(some)[:6])}"
            + f" and {len(some) - 6} more" * (len(some) > 6)
            + f": *{name}: {reason}"
            for (name, reason), some in sorted(lines.items(), key=lambda entry: sorted(entry[1]))
        ]


class Instance(NamedTuple):
    """A part as it stands in the assembly: names, and the rows that shift and turn it."""

    name: str
    part: str
    place: list[list[str]]


def _headed(line: str, number: int, path: Path) -> Card:
    """A keyword with its parameters, and without data. Raises InputError for a parameter with two values."""
    word, *rest = line[1:].split(",")
    name = " ".join(word.split()).upper()
    given = dict[str, str]()
    card = Card(name.replace(" ", ""), given, [], number, path, name)
    for key, _, value in (entry.partition("=") for entry in rest):
        key = "".join(key.split()).upper()
        value = value.strip().strip('"')
        if key and given.setdefault(key, value) != value:
            raise card.error(f"it has two {key}")
    return card


def _goes_on(line: str, following: str) -> bool:
    """Whether a line after that of a keyword, which ends with a comma, has more parameters, and no data."""
    word = "".join(line[1:].partition(",")[0].split()).upper()
    if following.startswith("*"):
        return False
    parts = [entry.partition("=") for entry in following.split(",") if entry.strip()]
    known = PARAMETERS.get(word, frozenset())
    return all(
        equal or "".join(name.split()).upper() in known or name.strip().upper() == "INPUT"
        for name, equal, _ in parts
    )


def factors(amplitude: Card) -> np.ndarray:
    """Times and factors (k, 2) of *AMPLITUDE. Raises InputError."""
    with amplitude.reading():
        words = [word for row in amplitude.rows for word in row]
        if not words or "" in words or len(words) % 2:
            raise DeckError("it needs pairs of a time and a factor")
        values = numbers(words)
        if (np.diff(values[::2]) < 0.0).any():
            raise DeckError("its times must not fall")
        shift = [number(amplitude.given.get(key) or "0") for key in ("SHIFTX", "SHIFTY")]
    return np.reshape(values, (-1, 2)) + shift


def axes(card: Card, place: Sequence[float] = ()) -> np.ndarray:
    """(3, 3) the directions of *TRANSFORM or *ORIENTATION at a place, as rows: along the first of two vectors, in their
    plane and across it; or radial, around and along the axis of a cylinder. Raises DeckError for others."""
    row = card.values()
    kind = card.says("TYPE", "R")[:1]
    a, b = vector(row, 6).reshape(2, 3)
    third = b - a if kind == "C" else np.cross(a, b)
    if (
        kind not in ("R", "C")
        or card.says("DEFINITION", "COORDINATES") != "COORDINATES"
        or any(row[6:])
        or not third.any()
    ):
        raise DeckError("axes are those of two vectors, or of a cylinder by two points on its axis")
    third = third / np.linalg.norm(third)
    off = vector(place) - a
    first = off - third * (off @ third) if kind == "C" else a
    first = first / (np.linalg.norm(first) or 1.0)
    return np.array([first, np.cross(third, first), third])


def read_cards(path: Path) -> list[Card]:
    """Each keyword of a deck and of what it includes. Raises DeckError where there is none or a file includes itself,
    InputError where an included one is not there, and OSError."""
    cards: list[Card] = []
    _read(path, cards, (), [])
    if not cards:
        raise DeckError("it has no keyword, such as *NODE")
    return cards


INCLUDED = 1000
"""How often a deck may include files: a few files that include each other twice would have no end."""

DEEPEST = 50
"""How deep files may be included within each other."""


def _lines(path: Path, within: tuple[Path, ...], read: list[Path]) -> list[tuple[int, str]]:
    """The lines of a file that lies `within` others, after those that were `read`, by number, without comments. Raises
    DeckError, OSError."""
    data = path.read_bytes()
    if path.resolve() in within:
        raise DeckError(f"{path} includes itself")
    read.append(path)
    if len(read) > INCLUDED or len(within) > DEEPEST:
        raise DeckError(
            f"files are included more than {INCLUDED} times, or within each other more than {DEEPEST} times"
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    # a form feed, or a letter of other code pages, ends no line
    every = enumerate(map(str.strip, re.split("\r\n?|\n", text)), 1)
    return [(number, line) for number, line in every if line and not line.startswith("**")]


def _read(path: Path, cards: list[Card], within: tuple[Path, ...], read: list[Path]) -> None:
    """Append the keywords of a file to the `cards`; data lines at the beginning of an included one are of the last."""
    lines = deque(_lines(path, within, read))
    while lines:
        number, line = lines.popleft()
        if not line.startswith("*"):
            if not cards:
                raise DeckError(
                    f"line {number} of {path.name}: data without a keyword, such as *NODE"
                )
            words = line.replace('"', "").rstrip(", ").split(",")
            cards[-1].rows.append([*map(str.strip, words)])
            continue
        while line.endswith(",") and lines and _goes_on(line, lines[0][1]):
            line += lines.popleft()[1]
        card = _headed(line, number, path)
        if card.word != "INCLUDE":
            cards.append(card)
        if card.word == "INCLUDE" or (card.word in PARAMETERS and "INPUT" in card.given):
            with card.reading():
                name = card.given.pop("INPUT")
                if not os.path.isfile(other := path.parent / name):
                    raise DeckError(f"no such file: {name}")
            _read(other, cards, (*within, path.resolve()), read)
