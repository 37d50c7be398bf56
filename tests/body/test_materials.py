"""Several materials in one body: exact fields, stiffness, error estimate, and what is refused."""

import msgspec
import numpy as np
import pytest

from ddmpi.body.estimate import estimate_error
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import (
    Composite,
    components,
    material_of,
    modulus_beside,
)
from ddmpi.errors import InputError
from ddmpi.mesh.boundary import material_numbers
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import raise_order
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec, PartMaterial
from meshes import energy_density, stress_at

CORE, RIM = {"young": 2.1e11, "poisson": 0.3}, {"young": 1.0e9, "poisson": 0.45}
both_orders = pytest.mark.parametrize("order", [1, 2])


def layered(order: int, divisions=(6, 8)) -> Mesh:
    """A block 2 × 1 m, whose surface `core` is its upper half, `rim` the lower one; inner nodes are moved at random."""
    mesh = generate_rectangle(MeshSpec(shape="rectangle", size=(2.0, 1.0), divisions=divisions))
    points = mesh.points.copy()
    inner = (points > 0).all(axis=1) & (points < (2.0, 1.0)).all(axis=1) & (points[:, 1] != 0.5)
    points[inner] += (
        np.random.default_rng(3).uniform(-0.02, 0.02, (inner.sum(), 2)) * 8 / divisions[1]
    )
    upper = points[mesh.triangles, 1].mean(axis=1) > 0.5
    surfaces = {"core": np.flatnonzero(upper), "rim": np.flatnonzero(~upper)}
    mesh = Mesh(points, mesh.triangles, mesh.groups, {}, surfaces)
    return raise_order(mesh, "mesh") if order == 2 else mesh


def body(*parts: dict, **rest) -> BodySpec:
    return BodySpec(
        name="block",
        mesh=MeshSpec(file="unused.msh"),
        material=[PartMaterial(**part) for part in parts],
        **rest,
    )


@both_orders
@pytest.mark.parametrize("ratio", [1.0, 10.0, 1000.0])
def test_estimate_knows_that_stress_jumps_where_materials_meet(order, ratio):
    """The estimate is right within a twentieth, though the stress along the common line jumps by the ratio of E.

    u_x = sin 2x g(y), u_y = 0 with E g' continuous is an elastic field without cross contraction. A recovery across the
    line estimates 6 (order 1) and 230 times the error at a ratio of 10 on this mesh.
    """
    mesh, h = layered(order, (32, 16)), 0.5
    spec = body({"on": "core", "young": 1.0, "poisson": 0.0}, {"young": ratio, "poisson": 0.0})
    material, (x, y) = material_of(mesh, spec), mesh.points.T

    def g(y, E):
        return 1 + 2 * (y - h) / E + (y - h) ** 2, 2 / E + 2 * (y - h)

    u = np.column_stack([np.sin(2 * x) * g(y, np.where(y > h, 1.0, ratio))[0], 0 * x])
    corners = mesh.points[mesh.triangles[:, :3]]
    points, weights = CELLS[2, 1].fine
    x, y = np.einsum("qa,tad->dqt", points, corners)
    E = np.where(corners[..., 1].mean(axis=1) > h, 1.0, ratio)
    value, slope = g(y, E)
    exact = np.stack([2 * E * np.cos(2 * x) * value, E / 2 * np.sin(2 * x) * slope, 0 * x])
    difference, true = components(stress_at(mesh, material, u, points)) - exact, 0.0
    for young in {1.0, ratio}:
        part = np.isclose(E, young)
        density = energy_density(Material(young=young, poisson=0.0), difference[..., part])
        true += weights @ density @ mesh.measures()[part]
    assert estimate_error(mesh, material, u).total ** 0.5 == pytest.approx(true**0.5, rel=0.2)


@both_orders
def test_linear_triangles_lock_in_any_part(order):
    """One part that is nearly incompressible makes the estimate of linear triangles unknown."""
    spec = body({"on": "core", **CORE}, {"young": 1e6, "poisson": 0.4999})
    mesh = layered(order)
    squares = estimate_error(mesh, material_of(mesh, spec), np.sin(mesh.points)).squares
    assert np.isnan(squares).all() == (order == 1)
    assert (
        spec.settled(1).locking
        == "block: no estimate: linear elements lock at nu = 0.4999; write mesh.order = 2"
    )
    assert spec.settled(2).locking == ""
    for keys, words in (
        ({}, ", with incompatible modes less"),
        ({"integration": "full"}, ""),
        ({"integration": "modes"}, ", with incompatible modes less"),
    ):
        mesh = msgspec.structs.replace(
            MeshSpec(shape="rectangle", origin=(0.0, 0.0), size=(1.0, 1.0), divisions=(1, 1)),
            elements="bricks",
            **keys,
        )
        bricks = msgspec.structs.replace(
            spec, mesh=mesh, material=Material(young=1e6, poisson=0.4999)
        ).settled(1)
        assert f"lock at nu = 0.4999{words}; write" in bricks.locking


@both_orders
def test_entries_of_one_material_are_the_body_of_that_material(order):
    """A list whose entries say the same is the same body, bit for bit, as the material alone."""
    mesh = layered(order)
    for spec in (body(CORE), body({"on": "core", **CORE}, {"on": "rim", **CORE})):
        material = material_of(mesh, spec)
        assert isinstance(material, Material)
        one, other = sum_stiffness(mesh, material), sum_stiffness(mesh, Material(**CORE))
        assert np.array_equal(one.upper, other.upper) and np.array_equal(
            one.diagonal, other.diagonal
        )


def test_modulus_beside_a_contact():
    """A side's modulus is that of the material there; where there are several, their harmonic mean by lengths."""
    mesh = layered(2)
    material = material_of(mesh, body({"on": "core", **CORE}, RIM))
    core, rim = (Material(**each).plane_modulus for each in (CORE, RIM))
    assert modulus_beside(mesh, material, mesh.facets("top")) == pytest.approx(core, rel=1e-14)
    assert modulus_beside(mesh, material, mesh.facets("bottom")) == pytest.approx(rim, rel=1e-14)
    assert modulus_beside(mesh, material, mesh.facets("left")) == pytest.approx(
        2 / (1 / core + 1 / rim), rel=1e-12
    )
    assert modulus_beside(mesh, Material(**CORE), mesh.facets("left")) == core


@pytest.mark.parametrize(
    "parts, words",
    [
        (
            ["core", "rimm"],
            r"material\.1\.on: the mesh has no physical surface 'rimm'; did you mean 'rim'\? \(it has core",
        ),
        (
            ["core"],
            r"material: the triangle at \(.*\), in the physical surface 'rim', has no material; add an entry",
        ),
        (
            ["core", "half", None],
            r"material\.1\.on: the triangle at \(.*\) is in the physical surfaces 'half' and 'core', "
            "which would both give it a material",
        ),
        (
            ["core", "empty", None],
            r"material\.1\.on: the physical surface 'empty' of the mesh has a name, but no tri",
        ),
    ],
)
def test_each_triangle_has_one_material(parts, words):
    """A triangle with no material, or with two, is refused; the message names the surface."""
    mesh = layered(1)
    mesh.surfaces["half"], mesh.surfaces["empty"] = mesh.surfaces["core"][::2], np.empty(0, int)
    with pytest.raises(InputError, match=r"^body\.block\." + words):
        material_numbers(mesh, body(*({"on": on, **CORE} for on in parts)))


def test_rest_takes_what_the_others_leave():
    """An entry without `on` is the material of all triangles that no other entry names, wherever it stands."""
    mesh, spec = layered(1), body(CORE, {"on": "rim", **RIM})
    material = material_of(mesh, spec)
    assert isinstance(material, Composite)
    poisson = np.array([each.poisson for each in material.materials])[material.number]
    assert (poisson[mesh.surfaces["rim"]] == 0.45).all() and (
        poisson[mesh.surfaces["core"]] == 0.3
    ).all()
