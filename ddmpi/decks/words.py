"""The words of decks: elements, with the corners around their faces and at their edges, and keywords."""

from __future__ import annotations

import math
import re

SIDES: dict[str, list[tuple[int, int]]] = {
    "line": [(0, 1)], "triangle": [(0, 1), (1, 2), (2, 0)], "quad": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "hexahedron": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "pyramid": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]}
"""Corners at the ends of the edges of an element, whose middles come in this order, which is VTK's."""

FACES: dict[str, list[tuple[int, ...]]] = {
    "tetra": [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    "hexahedron": [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    "wedge": [(0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
    "pyramid": [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]}
"""Corners around the faces S1, S2, … of solid elements; those of plane ones are their SIDES."""

ELEMENTS: dict[str, dict[int, str]] = {
    "CPE|CPS|CPEG|CAX|CGAX|S|STRI|M3D|SFM3D|R3D": {3: "triangle", 4: "quad", 6: "triangle6", 65: "triangle6",
                                                   8: "quad8", 9: "quad9"},
    "C3D": {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"},
    "T2D|T3D": {2: "line", 3: "line3"}, "B2|B3": {1: "line", 2: "line3", 3: "line"}}
"""Abaqus's names of elements: letters and a number; further letters are ignored."""

SHAPELESS = ("MASS", "ROTARYI", "SPRING", "DASHPOT", "CONN", "GAP", "DCOUP")
"""Prefixes of the names of elements that have no shape."""

SILENT = frozenset((
    "HEADING", "NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "STEP", "ENDSTEP", "STATIC",
    "PHYSICALCONSTANTS", "CONTROLS", "PREPRINT", "NODEPRINT", "ELPRINT", "NODEFILE", "ELFILE", "CONTACTFILE",
    "CONTACTPRINT", "FACEPRINT", "SECTIONPRINT", "ENERGYPRINT", "ENERGYFILE", "OUTPUT", "NODEOUTPUT",
    "ELEMENTOUTPUT", "CONTACTOUTPUT", "ENERGYOUTPUT", "MONITOR", "PRINT", "RESTART", "TIMEPOINTS", "FILEFORMAT",
    "PARAMETER", "NORMAL", "TRANSFORM", "ORIENTATION", "AMPLITUDE", "ENDPART", "ENDASSEMBLY", "ENDINSTANCE",
    "SURFACESMOOTHING", "PRE-TENSIONSECTION",
    # what these say matters with elements that are lost themselves
    "SHELLSECTION", "BEAMSECTION", "BEAMGENERALSECTION", "MEMBRANESECTION", "MEMBRANE", "FLUIDSECTION", "SPRING",
    "DASHPOT", "MASS",
))
"""Keywords about meshes and output, and those that count where others name them."""

REFUSED = {
    "EQUATION": "equations between nodes", "MPC": "constraints between nodes",
    "DISTRIBUTINGCOUPLING": "couplings",
    "KINEMATICCOUPLING": "couplings",
    "SUBMODEL": "displacements of another model", "CHANGEFRICTION": "friction that changes",
    "CHANGESURFACEBEHAVIOR": "contact laws that change", "CHANGEMATERIAL": "materials that change", "CONTACT":
    "general contact; name each pair of surfaces by *CONTACT PAIR", "PLASTIC": "plasticity",
    "CYCLICHARDENING": "plasticity", "DEFORMATIONPLASTICITY": "plasticity", "CREEP": "creep",
    "HYPERELASTIC": "rubber", "HYPERFOAM": "foam", "USERMATERIAL": "materials of a user's routine",
    "VISCOELASTIC": "viscoelasticity", "CYCLICSYMMETRYMODEL": "cyclic symmetry", "CFLUX": "heat flow"}
"""What becomes impossible by a keyword; any other one that is not read is unknown."""

PROCEDURES = frozenset((
    "STATIC", "DYNAMIC", "FREQUENCY", "BUCKLE", "VISCO", "HEATTRANSFER", "MODALDYNAMIC", "STEADYSTATEDYNAMICS",
    "CFD", "COUPLEDTEMPERATURE-DISPLACEMENT", "UNCOUPLEDTEMPERATURE-DISPLACEMENT", "ELECTROMAGNETICS",
    "COMPLEXFREQUENCY", "NOANALYSIS", "GREEN", "SENSITIVITY", "SUBSTRUCTUREGENERATE", "CRACKPROPAGATION",
))
"""Keywords that say what a step computes."""

NAMED_SUPPORTS = {"ENCASTRE": (1, 3), "PINNED": (1, 3), "XSYMM": (1, 1), "YSYMM": (2, 2), "ZSYMM": (3, 3)}
"""Abaqus's words for supports: the first and the last component that they hold."""


class DeckError(ValueError):
    """A mistake in a deck, in words."""


def element(name: str) -> tuple[str, int]:
    """What meshio calls an element of Abaqus, and the number of its nodes. Raises DeckError for other names."""
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
        raise DeckError(f"the surface {surface} has {name or 'no'} face of a {shape(kind)}; these are S1 to "
                         f"S{len(all_faces)}")
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


def numbers(row: list[str]) -> list[float]:
    """The numbers of a data line; empty entries are zero."""
    return [number(word) if word else 0.0 for word in row]
