"""Types of the output: files, pictures and checkpoints, and the units in their words."""

from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import Misplaced, NonNegative, Number, Table

Side = Literal["front", "back", "left", "right", "top", "bottom", "iso"]
Field = Literal[
    "von_mises",
    "displacement",
    "displacement_x",
    "displacement_y",
    "displacement_z",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xy",
    "stress_yz",
    "stress_xz",
    "principal_1",
    "principal_2",
    "principal_3",
    "pressure",
]
"""What an animation may show: fields of bodies by the names of a path's columns, or the pressure of contacts."""

Elevation = Annotated[float, msgspec.Meta(ge=-90, le=90)]

VIEWS = {
    "front": (-90.0, 0.0),
    "back": (90.0, 0.0),
    "left": (180.0, 0.0),
    "right": (0.0, 0.0),
    "top": (-90.0, 90.0),
    "bottom": (-90.0, -90.0),
    "iso": (-45.0, 35.264),
}
"""Views of solids by name: azimuth and elevation (degrees)."""


class Cut(Table, frozen=True, kw_only=True):
    """A plane at which pictures cut solids open, as in ``cut = { x = 0.5 }``, in coordinates before bodies move.

    Attributes
    ----------
    x, y, z : coordinate of the plane; exactly one of them
    """

    x: Number | None = None
    y: Number | None = None
    z: Number | None = None

    def __post_init__(self) -> None:
        if (self.x, self.y, self.z).count(None) != 2:
            raise ValueError("a cut has one of x, y and z, as in { x = 0.5 }")


class Output(Table, frozen=True, kw_only=True):
    """Fields and pictures that are written beside the tables; others are not computed.

    Attributes
    ----------
    only : "contacts": certificate, contacts, reactions and rigid partners alone, in tables and summary.json; no fields,
        stresses, pictures, estimate of the discretization error, nor warnings that need fields. Left out, all
    stress : stress and von Mises stress of the bodies
    error : field and picture of the estimated discretization error
    figures : pictures
    steps : load steps whose fields are written: ends of legs, or all
    animation : animation.gif plays the load steps with fields: von Mises stress or what it names
    length_unit, stress_unit : labels in pictures, summary and messages; numbers are in the scene's own units
    magnification : of displacements and gaps in bodies.png; left out, it suits the picture
    mirrored : bodies.png of an axisymmetric scene also shows the other half
    sectors : bodies.png and view.html of a sector, of a contact with a turned image, show the whole wheel
    view : true for view.html, in which a browser turns the bodies; or the side from which pictures show solids: front,
        back (along y), left, right (x), bottom, top (z), iso, or [azimuth, elevation] in degrees, about z from x on
        and above the plane of x and y; left out, a corner that suits them
    cut : plane at which pictures cut solids open; left out, none
    derivatives : keys by which the answer is differentiated; see docs/use/derivatives.md
    errors : results whose errors by the mesh are told, such as "contacts.fit.normal_force", or "main"; see
        docs/use/accuracy.md
    cache : meshes of drawings that take longer than a second are kept for later commands, in .ddmpi-meshes beside the
        folder of results, or in the folder that is named, seen from there; false for none
    """

    only: Literal["contacts"] | None = None
    stress: bool = True
    error: bool = False
    figures: bool = True
    steps: Literal["legs", "all"] = "legs"
    animation: bool | Field = False
    length_unit: str = "m"
    stress_unit: str = "Pa"
    magnification: Annotated[float, msgspec.Meta(gt=0.0, le=1e12)] | None = None
    mirrored: bool = False
    sectors: bool = False
    view: bool | Side | tuple[Number, Elevation] | None = None
    cut: Cut | None = None
    derivatives: list[str] = []
    errors: Literal["main"] | list[str] = []
    cache: bool | Annotated[str, msgspec.Meta(min_length=1)] = True

    def __post_init__(self) -> None:
        for key in ("error", "animation", "view"):
            if self.only and (
                getattr(self, key) is True or (key == "animation" and self.animation)
            ):
                raise ValueError(
                    f'{key} = true asks for what only = "{self.only}" leaves out; drop one of the two'
                )
        if not self.stress and str(self.animation).startswith(("von", "stress", "principal")):
            raise ValueError(
                f'animation = "{self.animation}" asks for stresses; drop stress = false'
            )

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        for name in ("view", "cut"):
            if getattr(self, name) not in (None, True, False):
                yield 3, name, "only pictures of solids have a view and a cut; leave it out"


class Checkpoint(Table, frozen=True, kw_only=True):
    """Intervals at which the state of the run is written, apart from signals; see docs/use/restart.md.

    Attributes
    ----------
    seconds : least time between checkpoints (s); zero for never
    iterations : least number of outer iterations between checkpoints; zero for never
    """

    seconds: NonNegative = 600.0
    iterations: Annotated[int, msgspec.Meta(ge=0)] = 0


UNITS = {
    ("Pa·m", True): ("N", "N·m", "J"),
    ("MPa·mm", True): ("N", "N·mm", "mJ"),
    ("Pa·m", False): ("N/m", "N·m/m", "J/m"),
    ("MPa·mm", False): ("N/mm", "N·mm/mm", "mJ/mm"),
}
"""Forces, moments and energies by stress and length, of whole bodies or per unit of depth."""


def _thick(scene: dict) -> bool:
    """Whether parts have a thickness, so that forces are those of all of it."""
    given = [body.get("material") or () for body in scene.get("body", ())]
    entries = [entry for one in given for entry in (one if isinstance(one, list) else [one])]
    return any(entry and entry.get("thickness", 1.0) != 1.0 for entry in entries)


def units(scene: dict, dimension: int) -> dict[str, str]:
    """Labels of lengths, stresses, forces, moments and energies; in the plane the last three are per unit of depth, unless
    parts have a thickness."""
    length = scene["output"]["length_unit"]
    stress = scene["output"]["stress_unit"]
    product = f"{stress}·{length}"
    whole = dimension == 3 or bool(scene.get("axisymmetric")) or _thick(scene)
    power = f"{product}³" if whole else f"{product}·{length}"
    unnamed = (f"{product}²" if whole else product), power, power
    force, moment, energy = UNITS.get((product, whole), unnamed)
    return {"length": length, "stress": stress, "force": force, "moment": moment, "energy": energy}
