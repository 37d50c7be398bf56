"""Types of one body: material, clamps and loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec.structs import force_setattr, replace

from ddmpi.scene.meshes import AROUND, TOWARDS_CONTACTS, WITH_ORIGIN, MeshSpec, SettledMesh
from ddmpi.scene.motions import Copy, Motions
from ddmpi.scene.values import (
    AffineVector,
    Formula,
    Group,
    Misplaced,
    Name,
    NonNegative,
    Number,
    On,
    Point,
    Positive,
    Scalar,
    Table,
    Vector,
    joined,
    no_z,
    settle,
)
from ddmpi.system.numbers import ALIKE, Frame

LOCKING = 0.48
"""Largest Poisson's ratio for error estimates of linear triangles; right to a fifth for measured errors below 0.3."""

Moduli = Annotated[tuple[Positive, ...], msgspec.Meta(min_length=3, max_length=3)]
Three = Annotated[tuple[Number, ...], msgspec.Meta(min_length=3, max_length=3)]
# not tuple[Number, Number, Number]: msgspec 0.22 crashes where that stands beside a number and garbage is collected


class VolumeForce(AffineVector, frozen=True, kw_only=True):
    """Force per volume (N/m³): linear in the coordinates, or a ``value``.

    Attributes
    ----------
    value : the force, in place of constant and slopes
    history : [history.NAME] whose factor multiplies the value
    """

    value: Vector | AffineVector | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        affine = (self.constant, self.x_slope, self.y_slope, self.z_slope) != (None,) * 4
        if self.value is not None and affine:
            raise ValueError(
                "value does not go with constant and slopes; write them into it, as in value = "
                "{ constant = …, x_slope = … }"
            )
        if self.value is None and self.history is not None:
            raise ValueError(
                'a volume force with a history has a value: write { value = […], history = "…" }'
            )


class Heat(Table, frozen=True, kw_only=True):
    """Temperature over the state free of stress, with a history.

    Attributes
    ----------
    value : temperature (K)
    history : [history.NAME] whose factor multiplies it
    """

    value: Number | Formula
    history: Name | None = None


class Material(Table, frozen=True, kw_only=True):
    """Linear elasticity: isotropic, or orthotropic with axes 1, 2, 3, which are x, y, z; see docs/use/materials.md.

    Attributes
    ----------
    young : Young's modulus (Pa); orthotropic: [E1, E2, E3]
    poisson : Poisson's ratio; linear triangles lock near 0.5, quadratic ones do not;
        orthotropic: [ν12, ν13, ν23], where ν12 = −ε2/ε1 under stress along axis 1
    shear : of an orthotropic material: shear modulus G12 in the plane (Pa), in space [G12, G13, G23]
    angle : of axis 1 of an orthotropic material in the plane, counter-clockwise from x (degrees); left out, 0
    axes : of an orthotropic solid, [along axis 1, beside it in the plane of axes 1 and 2]; left out, those of x and y
    plane : plane strain, the default in the plane, or plane stress; not for solids and axisymmetric bodies
    thickness : of a part in plane stress, over the depth of the others, which is 1; stresses are over its own section
    expansion : coefficient of thermal expansion (1/K), with the body's temperature; orthotropic: also [α1, α2, α3]
    """

    young: Positive | Moduli
    poisson: Annotated[float, msgspec.Meta(gt=-1, lt=0.5)] | Three
    shear: Positive | Moduli | None = None
    angle: Number | None = None
    axes: tuple[Three, Three] | None = None
    plane: Literal["strain", "stress"] | None = None
    thickness: Positive = 1.0
    expansion: Number | Three | None = None

    def __post_init__(self) -> None:
        self._check_kind()
        if self.thickness != 1.0 and self.plane != "stress":
            raise ValueError('thickness: such parts are in plane stress; write plane = "stress"')
        if self.axes and not np.cross(*self.axes).any():
            raise ValueError(
                "axes: both are parallel or zero; the second lies beside axis 1, in the plane of 1 and 2"
            )
        if self.shear is None:
            return
        scale = np.sqrt(self.moduli)
        scaled = self._matrix[:3, :3] * scale[:, None] * scale
        if not np.linalg.eigvalsh(scaled).min() > ALIKE:
            raise ValueError(
                "poisson: no material has these ratios and moduli: the matrix of its compliances is not "
                "positive definite; ν12 is −ε2/ε1 under stress along axis 1, so that |ν12| < √(E1/E2)"
            )

    def _check_kind(self) -> None:
        """ValueError unless all keys are those of an isotropic or of an orthotropic material."""
        orthotropic = self.shear is not None
        rows = [isinstance(value, tuple) for value in (self.young, self.poisson)]
        if rows != [orthotropic, orthotropic]:
            raise ValueError(
                "an isotropic material has young = E and poisson = ν; an orthotropic one young = [E1, E2, "
                "E3], poisson = [ν12, ν13, ν23] and shear = G12 or, in space, [G12, G13, G23]"
            )
        if orthotropic:
            return
        for key in ("angle", "axes"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key}: an isotropic material has no axes; leave it out")
        if isinstance(self.expansion, tuple):
            raise ValueError("expansion: an isotropic material has no axes; write expansion = α")

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if self.plane:
            yield (
                3 if axisymmetric else 2,
                "plane",
                "solids and axisymmetric bodies are neither in plane strain nor in plane stress; leave it out",
            )
        if self.angle is not None:
            yield (
                2,
                "angle",
                "the axes 1, 2, 3 of solids are x, y, z; leave it out, or turn them by axes = [[…], […]]",
            )
        if self.axes:
            yield 3, "axes", "in the plane angle = … turns the axes 1 and 2"
        if isinstance(self.shear, tuple):
            yield 3, "shear", "in the plane it is one number, G12"
        elif self.shear is not None:
            yield 2, "shear", "solids have shear = [G12, G13, G23]"

    @property
    def moduli(self) -> np.ndarray:
        """(3,) Young's moduli along the axes of the material (Pa)."""
        return np.array(self.young) * np.ones(3)

    @property
    def _matrix(self) -> np.ndarray:
        """Compliance matrix (6, 6) of an orthotropic material, for ε11, ε22, ε33, 2 ε12, 2 ε13, 2 ε23 (1/Pa)."""
        # In the plane G13 and G23 do not count.
        E = self.moduli
        G = np.array(self.shear) * np.ones(3)
        assert isinstance(self.poisson, tuple)
        n12, n13, n23 = self.poisson
        S = np.diag(1.0 / np.append(E, G))
        S[0, 1:3] = S[1:3, 0] = -np.array([n12, n13]) / E[0]
        S[1, 2] = S[2, 1] = -n23 / E[1]
        return S

    @property
    def compliance(self) -> np.ndarray:
        """S (3, 3, 3, 3) of ε = S : σ of an orthotropic material, along x, y, z (1/Pa)."""
        half = np.repeat([1.0, 0.5], 3)
        return self._along_axes(self._matrix * half[:, None] * half)

    def _along_axes(self, matrix: np.ndarray) -> np.ndarray:
        """The tensor (3, 3, 3, 3) along x, y, z of components (6, 6) along the axes of the material."""
        number = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
        tensor = matrix[number[:, :, None, None], number]
        for _ in range(4):  # each time the first index, which becomes the last one
            tensor = np.tensordot(tensor, self.rotation, (0, 1))
        return tensor

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) whose columns are the axes 1, 2, 3 of the material."""
        if self.axes:
            one, beside = np.array(self.axes)
            three = np.cross(one, beside)
            return np.column_stack(
                [a / np.linalg.norm(a) for a in (one, np.cross(three, one), three)]
            )
        c = np.cos(np.deg2rad(self.angle or 0.0))
        s = np.sin(np.deg2rad(self.angle or 0.0))
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def axes_in(self, frame: Frame) -> dict[str, Any]:
        """The keys with which its axes are turned with a frame; none if it has no axes, or the frame is not turned."""
        if self.shear is None or (frame.turned == np.eye(len(frame.shift))).all():
            return {}
        if len(frame.shift) == 2:
            return {"angle": (self.angle or 0.0) + frame.angle}
        one, beside, _ = (frame.turned @ self.rotation).T.tolist()
        return {"axes": (tuple(one), tuple(beside))}

    @property
    def expansions(self) -> np.ndarray:
        """α (3, 3) of the strain of a free body (1/K)."""
        R = self.rotation
        return (
            R @ np.diag(np.ones(3) * (self.expansion or 0.0)) @ R.T
            if isinstance(self.expansion, tuple)
            else np.eye(3) * (self.expansion or 0.0)
        )

    @property
    def lame(self) -> tuple[float, float]:
        """First Lamé constant and shear modulus (Pa) of an isotropic material, in plane stress for the plane."""
        E = self.young
        nu = self.poisson
        assert not isinstance(E, tuple) and not isinstance(nu, tuple)
        first = E * nu / (1 - nu**2 if self.plane == "stress" else (1 + nu) * (1 - 2 * nu))
        return first, E / (2 * (1 + nu))

    def tensor(self, dimension: int) -> np.ndarray:
        """C (d, d, d, d) of σ = C : ε (Pa), in the plane or in space."""
        if self.shear is not None:
            C = self._along_axes(np.linalg.inv(self._matrix))
            if self.plane == "stress":
                # σ_zz = 0 eliminates ε_zz.
                C = C - np.multiply.outer(C[..., 2, 2], C[2, 2]) / C[2, 2, 2, 2]
            return C[:dimension, :dimension, :dimension, :dimension]
        first, shear = self.lame
        unit = np.eye(dimension)
        both = np.multiply.outer(unit, unit)  # δ_ij δ_kl
        return first * both + shear * (both.transpose(0, 2, 1, 3) + both.transpose(0, 2, 3, 1))

    @property
    def across(self) -> np.ndarray:
        """a (2, 2) of σ_zz = a : σ in the plane."""
        if self.plane == "stress" or not isinstance(self.poisson, tuple):
            return np.eye(2) * (0.0 if self.plane == "stress" else self.poisson)
        S = self.compliance
        return -S[2, 2, :2, :2] / S[2, 2, 2, 2]

    @property
    def locks(self) -> bool:
        """Whether linear elements lock in this material, so that their error cannot be estimated."""
        return self.plane != "stress" and self.mean_ratio > LOCKING

    @property
    def mean_ratio(self) -> float:
        """Poisson's ratio; of an orthotropic material that of its mean compliances (Reuss)."""
        if not isinstance(self.poisson, tuple):
            return self.poisson
        normal = self._matrix[:3, :3]
        shears = np.trace(self._matrix[3:, 3:])
        bulk = normal.sum()
        shear = (6.0 * np.trace(normal) - 2.0 * normal.sum() + 3.0 * shears) / 15.0
        return float((3.0 * shear - 2.0 * bulk) / (6.0 * shear + 2.0 * bulk))

    @property
    def plane_modulus(self) -> float:
        """E / (1 − ν²), E in plane stress (Pa); of an orthotropic material the mean of its moduli."""
        if isinstance(self.young, tuple) or isinstance(self.poisson, tuple):
            return float(self.moduli.mean())
        return self.young if self.plane == "stress" else self.young / (1 - self.poisson**2)


class PartMaterial(Material, frozen=True, kw_only=True):
    """The material of a part of a body; see docs/use/loads.md.

    Attributes
    ----------
    on : physical surface (of a solid: volume) of the drawing or the mesh file; left out, all other cells
    """

    on: Group | None = None


PRESCRIBED = ("x", "y", "z", "normal", "value")
"""Keys of a clamp whose values are displacements."""


class Clamp(Table, frozen=True, kw_only=True):
    """Prescribed displacement on a boundary group or a physical point, as in { on = "top", x = 0.01, y = "-0.02 * x" }.

    Attributes
    ----------
    on : boundary group or physical point, in space also physical curve; several together, as the faces [8, 27] of a
        drawing; or what groups have in common, an edge or a corner: "left & bottom"
    x, y, z : component of the displacement (m); left out, it is free
    normal : the displacement along the outer normal of a boundary group (m), node by node; the group can slide
    along : a direction of any length, such as [0.6, 0.8] or, around an axis, ["-y", "x", 0.0], node by node
    value : the displacement in this direction (m); the group can slide across it
    history : [history.NAME] whose factor multiplies it
    """

    on: On
    x: Scalar | None = None
    y: Scalar | None = None
    z: Scalar | None = None
    normal: Scalar | None = None
    along: Vector | None = None
    value: Scalar | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        force_setattr(self, "on", joined(self.on))
        if all(getattr(self, name) is None for name in (*PRESCRIBED, "along")):
            raise ValueError(
                "a clamp prescribes one or several of x, y and, in space, z, the normal component, or the value "
                f'along a direction; to fix all, write clamp = ["{self.on}"]'
            )
        if (self.along is None) != (self.value is None):
            raise ValueError("a direction and a value go together: along = [0.6, 0.8], value = 0.0")
        if self.along is not None and not any(self.along):
            raise ValueError("along: the direction must not be zero")

    @property
    def components(self) -> tuple[Scalar | None, ...]:
        """x, y and z."""
        return self.x, self.y, self.z


class Traction(Table, frozen=True, kw_only=True):
    """Surface load on a group: a ``value``, a ``pressure``, a ``force`` or a ``moment``; see docs/use/loads.md.

    Attributes
    ----------
    on : boundary group, or several together, as the faces [8, 27] of a drawing
    value : force per area (Pa), as in [0.0, "-6e7 * (1 + x/3)"]
    pressure : normal stress (Pa) against the outer normal
    force : total force (N; in the plane per metre of depth), spread evenly over the area of the group
    moment : total moment (N m; in the plane a number), by stresses that grow from the group's middle, without a force
    history : [history.NAME] whose factor multiplies it
    follows : with time.motions = "far", whether it turns with the body; left out, it keeps its direction
    """

    on: On
    value: Vector | AffineVector | None = None
    pressure: Scalar | None = None
    force: Point | None = None
    moment: Number | Three | None = None
    history: Name | None = None
    follows: bool | None = None

    def __post_init__(self) -> None:
        force_setattr(self, "on", joined(self.on))
        if [self.value, self.pressure, self.force, self.moment].count(None) != 3:
            raise ValueError(
                "a traction has either a value (Pa), as in value = [0.0, -6e7], or a pressure = 1e6 along "
                "the inner normal, or the total force (N), as in force = [0.0, -1e4], or the total moment "
                "(N m), as in moment = 50.0 or, in space, [0.0, 0.0, 50.0]"
            )

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        if self.moment is not None and axisymmetric:
            yield 3, "moment", no_z(axisymmetric)
        elif isinstance(self.moment, float):
            yield 2, "moment", "in space a moment is [Mx, My, Mz]"

    @property
    def given(self) -> Vector | AffineVector | Scalar:
        """The value, the pressure, the force or the moment, whichever there is."""
        return getattr(self, self.kind)

    @property
    def kind(self) -> str:
        """The key of what is given."""
        keys = ("value", "pressure", "force", "moment")
        return next(key for key in keys if getattr(self, key) is not None)


class Foundation(Table, frozen=True, kw_only=True):
    """Springs between a boundary group and the ground, such as a mat or rubber; see docs/use/supports.md.

    Attributes
    ----------
    on : boundary group, or several together, as the faces [8, 27] of a drawing
    normal : stiffness along the normal, per area (N/m³), in tension as in compression
    tangential : stiffness along the surface, per area (N/m³)
    """

    on: On
    normal: NonNegative = 0.0
    tangential: NonNegative = 0.0

    def __post_init__(self) -> None:
        force_setattr(self, "on", joined(self.on))
        if not self.normal and not self.tangential:
            raise ValueError(
                "a foundation has a stiffness per area, as in normal = 1e9 or tangential = 1e8"
            )


class BodySpec(Table, frozen=True, kw_only=True):
    """One elastic body. It needs no supports if its contacts hold it; else the run names the free motion.

    Attributes
    ----------
    name : unique among bodies and rigid partners
    copy : in place of mesh and material, those of another body, elsewhere
    mesh : see below; all bodies but copies have one
    material : one, or a list with entries for the parts of a drawing or a mesh file
    clamp : boundary groups or physical points: by name or number, with zero displacement, or with given displacements
    foundation : springs on boundary groups, which support the body along their stiffness
    traction : loads on boundary groups
    volume_force : such as weight (N/m³), a list [x, y] or [x, y, z], or a table
    temperature : over the state free of stress (K), a number, a formula, or a table; it takes a material.expansion
    motion : with time.motions = "far", a motion of any size, or several one after the other; clamps move along
    """

    name: Name
    copy: Copy | None = None
    mesh: MeshSpec
    material: Material | Annotated[list[PartMaterial], msgspec.Meta(min_length=1)]
    clamp: list[On | Clamp] = []
    foundation: list[Foundation] = []
    traction: list[Traction] = []
    volume_force: Vector | VolumeForce | None = None
    temperature: Number | Formula | Heat | None = None
    motion: Motions | None = None

    def __post_init__(self) -> None:
        if self.temperature is not None and any(
            material.expansion is None for material in self.materials
        ):
            raise ValueError(
                "temperature: has no effect, because the material has no expansion; write expansion = "
                "1.2e-5 (1/K, of steel) into material, 0 for none"
            )
        if isinstance(self.material, Material):
            return
        surfaces = [part.on for part in self.material]
        named = [on for on in surfaces if on is not None]
        for on in surfaces:
            if surfaces.count(on) > 1:
                raise ValueError(
                    f"material: {surfaces.count(on)} entries are "
                    + (
                        "without on; one may leave it out, and has what the others leave"
                        if on is None
                        else f"on {on!r}; leave all but one of them out"
                    )
                )
        if named and self.mesh.shape:
            raise ValueError(
                f'material: on = "{named[0]}" names a physical surface of a mesh file, and a '
                f"{self.mesh.shape} has none; leave on out, or make a body of each part and join them by "
                'contacts with kind = "bonded"'
            )
        if len({part.plane or "strain" for part in self.material}) > 1:
            raise ValueError(
                "material: entries are in plane strain, the default, and in plane stress; a body is in "
                "one of them, so give all entries the same plane"
            )

    @property
    def original(self) -> str:
        """The body whose mesh and material it has, itself if it is no copy."""
        return self.copy.of if self.copy else self.name

    def placement(self, dimension: int) -> Frame:
        """Where its mesh stands from that of its original."""
        return self.copy.frame(1.0, dimension) if self.copy else Frame.of((0.0,) * dimension)

    @property
    def materials(self) -> Sequence[Material]:
        """All materials of the body."""
        return [self.material] if isinstance(self.material, Material) else self.material

    @property
    def plane(self) -> Literal["strain", "stress"]:
        """Whether a body in the plane is in plane strain or stress."""
        return self.materials[0].plane or "strain"

    @property
    def locking_ratio(self) -> float | None:
        """Poisson's ratio of a material in which linear triangles lock; None if there is none."""
        return max(
            (material.mean_ratio for material in self.materials if material.locks), default=None
        )

    @property
    def clamps(self) -> list[Clamp]:
        """All clamps in the long form; a bare group name fixes all components."""
        return [c if isinstance(c, Clamp) else Clamp(on=c, x=0.0, y=0.0, z=0.0) for c in self.clamp]

    @property
    def acting(self) -> list[tuple[str, Clamp | Traction | Foundation]]:
        """Clamps, loads and foundations on groups, with their keys."""
        return [
            *(("clamp", entry) for entry in self.clamps),
            *(("traction", entry) for entry in self.traction),
            *(("foundation", entry) for entry in self.foundation),
        ]

    @property
    def weight(self) -> tuple[Vector | AffineVector, str | None]:
        """The volume force (N/m³) and its history."""
        force = self.volume_force
        if isinstance(force, VolumeForce) and force.value is not None:
            return force.value, force.history
        return AffineVector() if force is None else force, None

    @property
    def heat(self) -> Heat:
        """The temperature (K), zero if none is given, with its history."""
        return (
            self.temperature
            if isinstance(self.temperature, Heat)
            else Heat(value=self.temperature or 0.0)
        )

    def settled(
        self,
        order: int,
        dimension: int = 2,
        axisymmetric: bool = False,
        refined: bool = False,
    ) -> SettledBody:
        """This body with elements of `order`, in the plane, around an axis or in space; a file is `refined` as needed where
        its mesh does not say otherwise."""
        mesh = self.mesh
        finest = mesh.contact_size or TOWARDS_CONTACTS * mesh.largest if mesh.drawn else None
        origin = mesh.origin or (0.0,) * dimension if mesh.shape in WITH_ORIGIN else None
        plane = self.plane if dimension == 2 and not axisymmetric else None
        place = self.placement(dimension)
        materials = [
            replace(material, plane=plane, **material.axes_in(place)) for material in self.materials
        ]
        around = mesh.around or (AROUND if mesh.drawn else None)
        halvings = "as needed" if refined and mesh.file else 0
        settled_mesh = settle(
            mesh,
            SettledMesh,
            order=order,
            contact_size=finest,
            origin=origin,
            around=around,
            refine=halvings if mesh.refine is None else mesh.refine,
        )
        return settle(
            self,
            SettledBody,
            mesh=settled_mesh,
            material=materials[0] if isinstance(self.material, Material) else materials,
            volume_force=(0.0,) * dimension if self.volume_force is None else self.volume_force,
        )


class SettledBody(BodySpec, frozen=True, kw_only=True):
    """One elastic body without optional keys."""

    mesh: SettledMesh
    volume_force: Vector | VolumeForce

    @property
    def locking(self) -> str:
        """Why the discretization error of this body cannot be estimated; empty if it can."""
        if self.mesh.order != 1 or not self.locking_ratio:
            return ""
        less = ", with incompatible modes less" * self.mesh.has_modes
        return (
            f"{self.name}: no estimate: linear elements lock at nu = {self.locking_ratio:g}{less}; "
            "write mesh.order = 2"
        )
