"""Types of one body: mesh, material, clamps and loads."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import AffineScalar, AffineVector, Count, Group, Name, Number, Point, Positive, Table, settle


class MeshSpec(Table, frozen=True, kw_only=True):
    """Either a generated shape (``shape, origin, size, divisions``) or a gmsh ``file``.

    ``order`` 1 means linear triangles; 2 means straight-sided quadratic triangles, with a further node in the
    middle of each side. Left out, the order follows another body that names one, then the preset, then the files;
    otherwise it is 1.
    ``refine`` is how often the sides of a file's mesh are halved, or "as needed" for ``method.target_error``.
    """

    shape: Literal["rectangle"] | None = None
    origin: Point = (0.0, 0.0)
    size: tuple[Positive, Positive] | None = None
    divisions: tuple[Count, Count] | None = None
    file: str | None = None
    order: Literal[1, 2] | None = None
    refine: Annotated[int, msgspec.Meta(ge=0, le=8)] | Literal["as needed"] = 0

    @property
    def halvings(self) -> int:
        """How often the sides of the file's mesh are halved."""
        return self.refine if isinstance(self.refine, int) else 0

    @property
    def refinable(self) -> bool:
        """Whether an accuracy target may make the mesh finer."""
        return self.file is None or self.refine == "as needed"

    def __post_init__(self) -> None:
        if self.file is None and self.refine:
            raise ValueError("refine belongs to a file; for a shape, raise divisions")
        if (self.shape is None) == (self.file is None):
            raise ValueError('a mesh is either { shape = "rectangle", size = …, divisions = … } '
                             'or { file = "….msh" }')
        if self.shape is not None and (self.size is None or self.divisions is None):
            raise ValueError("a rectangle needs size = [width, height] and divisions = [nx, ny]")
        if self.file is not None and (self.size or self.divisions or self.origin != (0.0, 0.0)):
            raise ValueError("origin, size and divisions belong to a shape, not to a file")


class SettledMesh(MeshSpec, frozen=True, kw_only=True):
    """A mesh of known order; a shape has no ``file``, a file no ``shape``, ``size`` and ``divisions``."""

    order: Literal[1, 2]


LOCKING = 0.48
"""Largest Poisson's ratio at which the error estimate of linear triangles can be trusted: measured values below 0.3
are right to within a fifth."""


class Material(Table, frozen=True, kw_only=True):
    """Isotropic linear elasticity; ``young`` in Pa."""

    young: Positive
    poisson: Annotated[float, msgspec.Meta(gt=-1, lt=0.5)]
    plane: Literal["strain", "stress"] = "strain"

    @property
    def lame(self) -> tuple[float, float]:
        """First Lamé constant and shear modulus (Pa) of the plane problem."""
        E, nu = self.young, self.poisson
        shear = E / (2 * (1 + nu))
        first = E * nu / ((1 + nu) * (1 - 2 * nu))
        if self.plane == "stress":
            first = E * nu / (1 - nu**2)
        return first, shear

    @property
    def locks(self) -> bool:
        """Whether linear triangles are so much too stiff for this material that error estimates mean nothing."""
        return self.plane == "strain" and self.poisson > LOCKING

    @property
    def plane_modulus(self) -> float:
        """E / (1 − ν²) in plane strain, E in plane stress (Pa)."""
        return self.young / (1 - self.poisson**2) if self.plane == "strain" else self.young


class Clamp(Table, frozen=True, kw_only=True):
    """Prescribed displacement (m) on a boundary group; a component that is left out stays free."""

    on: Group
    x: Number | AffineScalar | None = None
    y: Number | AffineScalar | None = None

    def __post_init__(self) -> None:
        if self.x is None and self.y is None:
            raise ValueError(f'a clamp prescribes x, y or both; to fix both, write clamp = ["{self.on}"]')


class Traction(Table, frozen=True, kw_only=True):
    """Surface traction (Pa) on a boundary group."""

    on: Group
    value: Point | AffineVector


class BodySpec(Table, frozen=True, kw_only=True):
    """One elastic body."""

    name: Name
    mesh: MeshSpec
    material: Material
    clamp: list[Group | Clamp] = []
    traction: list[Traction] = []
    volume_force: Point | AffineVector = (0.0, 0.0)

    @property
    def clamps(self) -> list[Clamp]:
        """All clamps in the long form; a bare group name fixes both components."""
        return [Clamp(on=c, x=0.0, y=0.0) if isinstance(c, str) else c for c in self.clamp]

    def settled(self, order: Literal[1, 2]) -> SettledBody:
        """This body with elements of `order`."""
        return settle(self, SettledBody, mesh=settle(self.mesh, SettledMesh, order=order))


class SettledBody(BodySpec, frozen=True, kw_only=True):
    """One elastic body without optional keys."""

    mesh: SettledMesh

    @property
    def locking(self) -> str:
        """Why the discretization error of this body cannot be estimated; empty if it can."""
        return (f"{self.name}: no estimate: linear triangles lock at nu = {self.material.poisson:g}; mesh.order = 2 "
                "would be right") if self.mesh.order == 1 and self.material.locks else ""
