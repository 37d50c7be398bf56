"""Rigid polygons and boxes in contact along flat pieces: interfaces and equilibrium without meshes or ranks."""

import itertools
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Geometry, Interface, Places
from ddmpi.interface.law import BondedLaw, CoulombLaw, Law, TrescaLaw
from ddmpi.judge.motions import MotionsOfBody
from ddmpi.surface.side import frames


@dataclass
class Blocks:
    """A scene of rigid bodies in the plane; bodies that are not added are rigid partners.

    All positions are turned by `angle`, shifted, and multiplied by `length`; forces by `force`.
    """

    length: float = 1.0
    force: float = 1.0
    angle: float = 0.0
    shift: tuple = (0.0, 0.0)
    mirror: bool = False
    bodies: dict = field(default_factory=dict)
    loads: dict = field(default_factory=dict)
    contacts: list = field(default_factory=list)

    def __post_init__(self):
        c, s = np.cos(self.angle), np.sin(self.angle)
        self.turn = np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if self.mirror else 1.0, 1.0])

    def place(self, points):
        return self.length * (np.atleast_2d(np.array(points, float)) + self.shift) @ self.turn.T

    def body(self, name, corners, *loads, free=(0, 1, 2)):
        """A convex body; loads are pairs of a force and where it acts."""
        points = self.place(corners)
        grid = np.concatenate(
            [np.linspace(a, b, 4) for a, b in zip(points, np.roll(points, 1, axis=0), strict=True)]
        )
        centre = points.mean(axis=0) + 0.1 * self.length  # whatever centre
        x, y = (grid - centre).T / self.length
        rigid = np.stack(
            [
                np.tile(self.turn[:, 0], (len(x), 1)),
                np.tile(self.turn[:, 1], (len(x), 1)),
                np.column_stack([-y, x]),
            ],
            axis=2,
        )[:, :, list(free)]
        self.bodies[name] = (MotionsOfBody.of(name, grid, rigid), centre, list(free))
        self.loads[name] = loads
        return self

    def box(self, name, x, y, width, height, *loads, weight=1.0, free=(0, 1, 2)):
        """A rectangle with its lower left corner at (x, y); its weight acts in its middle."""
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        return self.body(
            name, corners, ((0.0, -weight), (x + width / 2, y + height / 2)), *loads, free=free
        )

    def contact(self, first, second, start, end, law="none", value=0.0, nodes=5):
        """A straight contact, the first body to the left of the way from start to end."""
        t = np.linspace(0.0, 1.0, nodes)[:, None]
        xy = np.array(start, float) + t * (np.array(end, float) - start)
        along = np.array(end, float) - start
        return self.curve(first, second, xy, np.tile([along[1], -along[0]], (nodes, 1)), law, value)

    def curve(self, first, second, xy, normal, law="none", value=0.0):
        """A contact at nodes (m, d) with the first body's outer normals there."""
        normal = normal @ self.turn.T / np.linalg.norm(normal, axis=1)[:, None]
        m, d = normal.shape
        shape = m, np.arange(0 if law == "none" else m), d - 1
        made = {
            "none": lambda: Law(*shape),
            "bonded": lambda: BondedLaw(*shape),
            "coulomb": lambda: CoulombLaw(*shape, np.full(m, value)),
            "tresca": lambda: TrescaLaw(*shape, np.full(m, self.force * value / m)),
        }[law]()
        alone, nodes, at = sparse.identity(m, format="csr"), np.arange(m), self.place(xy)
        self.contacts.append(
            Interface(
                name=f"{first}-{second}",
                bodies=(first, second),
                geometry=Geometry(
                    xy=at,
                    tangents=frames(normal)[:, 1:],
                    area=np.ones(m),
                    at=(at, at),
                    facets=np.empty((0, d), int),
                    laplacian=sparse.csr_matrix((m, m)),
                ),
                rows=Places((nodes, nodes), normal, np.zeros(m), (alone, alone)),
                law=made,
                modulus=1.0,
            )
        )
        return self

    def motions(self, name, at):
        """(k, 2, j) free motions of a body at positions."""
        _, centre, free = self.bodies[name]
        x, y = (at - centre).T / self.length
        return np.stack(
            [
                np.tile(self.turn[:, 0], (len(x), 1)),
                np.tile(self.turn[:, 1], (len(x), 1)),
                np.column_stack([-y, x]),
            ],
            axis=2,
        )[:, :, free]

    def past(self):
        """DᵀD of how far motions move the sides of contacts past each other."""
        moved = []
        for contact in self.contacts:
            signs = dict(zip(contact.bodies, (1.0, -1.0), strict=True))
            parts = [signs.get(name, 0.0) * self.motions(name, contact.xy) for name in self.bodies]
            D = np.concatenate(parts, axis=2)
            moved.append(D.reshape(-1, D.shape[2]))
        D = np.vstack(moved)
        return sparse.csr_matrix(D.T @ D)

    def equilibrium(self):
        """interfaces, G, e, bodies."""
        sizes = [len(free) for _, _, free in self.bodies.values()]
        rows = dict(
            zip(self.bodies, np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1]), strict=True)
        )
        columns = np.cumsum([0, *(contact.law.size for contact in self.contacts)])
        G = np.zeros((sum(sizes), columns[-1]))
        for contact, (start, stop) in zip(self.contacts, itertools.pairwise(columns), strict=True):
            for sign, name in zip((1.0, -1.0), contact.bodies, strict=True):
                if name in self.bodies:
                    motions = self.motions(name, contact.xy[contact.law.node])
                    G[rows[name], start:stop] = sign * np.einsum(
                        "mdj,md->jm", motions, contact.directions
                    )
        e = []
        for name in self.bodies:
            e.append(
                sum(
                    self.force
                    * np.einsum(
                        "dj,d->j",
                        self.motions(name, self.place(at))[0],
                        self.turn @ np.array(load, float),
                    )
                    for load, at in self.loads[name]
                )
                + np.zeros(len(self.bodies[name][2]))
            )
        return (
            self.contacts,
            sparse.csr_matrix(G),
            np.concatenate(e),
            [body for body, _, _ in self.bodies.values()],
        )


@dataclass
class Boxes(Blocks):
    """The same with boxes in space; `turn` is any rotation."""

    shift: tuple = (0.0, 0.0, 0.0)
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self):
        pass

    def body(self, name, corners, *loads, free=range(6)):
        points = self.place(corners)
        self.bodies[name] = (None, points.mean(axis=0) + 0.1 * self.length, list(free))
        self.bodies[name] = (
            MotionsOfBody.of(name, points, self.motions(name, points)),
            *self.bodies[name][1:],
        )
        self.loads[name] = loads
        return self

    def box(self, name, corner, size, *loads, weight=1.0, free=range(6)):
        """Of this `size` (3,) along the axes from its least corner (3,); its weight acts in its middle along -z."""
        corner, size = np.array(corner, float), np.array(size, float)
        corners = corner + size * list(itertools.product((0, 0.5, 1), repeat=3))
        return self.body(name, corners, ((0.0, 0.0, -weight), corner + size / 2), *loads, free=free)

    def contact(self, first, second, corner, along, across, law="none", value=0.0, nodes=5):
        """A flat contact on a parallelogram, the first body where along × across points to."""
        grid = np.array(list(itertools.product(np.linspace(0, 1, nodes), repeat=2)))
        xy = np.array(corner, float) + grid @ np.array([along, across], float)
        return self.curve(
            first, second, xy, np.tile(-np.cross(along, across), (len(xy), 1)), law, value
        )

    def motions(self, name, at):
        _, centre, free = self.bodies[name]
        turns = [np.cross(axis, (at - centre) / self.length) for axis in self.turn.T]
        return np.stack([*(np.tile(axis, (len(at), 1)) for axis in self.turn.T), *turns], axis=2)[
            :, :, free
        ]


def pushed(push, law="coulomb", value=0.5, **how):
    """A block of weight one on a floor, pushed along x."""
    return (
        Blocks(**how)
        .box("block", 0, 0, 1, 1, ((push, 0.0), (0.0, 0.25)))
        .contact("block", "floor", (0, 0), (1, 0), law, value)
    )


def tower(shift, count=5, **how):
    """Blocks on each other, each shifted to the left of the one below."""
    scene = Blocks(**how)
    for k in range(count):
        below = 1.0 - shift * max(k - 1, 0)
        scene.box(f"b{k}", -shift * k, k, 1, 1)
        scene.contact(
            f"b{k}", f"b{k - 1}" if k else "floor", (-shift * k, k), (below, k), "coulomb", 0.5
        )
    return scene


def tall(push, **how):
    """A slender tower pushed to the left at its top."""
    return (
        Blocks(**how)
        .box("tower", 2, 0, 1, 4, ((-push, 0.0), (3.0, 4.0)))
        .contact("tower", "floor", (2, 0), (3, 0), "coulomb", 0.5)
    )


def beam(x, *posts, **how):
    """A beam of length 2 from x on loose posts of width .3."""
    scene = Blocks(**how).box("beam", x, 1, 2, 0.5)
    for k, at in enumerate(posts):
        scene.box(f"post{k}", at, 0, 0.3, 1).contact(
            f"post{k}", "floor", (at, 0), (at + 0.3, 0), "coulomb", 0.3
        )
        scene.contact(
            "beam", f"post{k}", (max(x, at), 1), (min(at + 0.3, x + 2), 1), "coulomb", 0.3
        )
    return scene


def squeezed(pressure, friction=0.5, **how):
    """A block that hangs by friction between a wall and a jaw that is guided along x."""
    return (
        Blocks(**how)
        .box("block", 0, 0, 1, 1)
        .contact("block", "wall", (0, 1), (0, 0), "coulomb", friction)
        .box("jaw", 1, 0, 0.5, 1, ((-pressure, 0.0), (1.5, 0.5)), weight=0.0, free=(0,))
        .contact("jaw", "block", (1, 1), (1, 0), "coulomb", friction)
    )


def wedge(push, friction, slope, **how):
    """A wedge on a floor under a block that is guided along y and weighs one."""
    return (
        Blocks(**how)
        .body("wedge", [(0, 0), (1, 0), (0, slope)], ((push, 0.0), (0.0, slope / 3)))
        .body("block", [(0, slope), (1, 0), (1, 1), (0, 1)], ((0.0, -1.0), (0.5, 0.6)), free=(1,))
        .contact("wedge", "floor", (0, 0), (1, 0), "coulomb", friction)
        .contact("block", "wedge", (0, slope), (1, 0), "coulomb", friction)
    )


def arch(thickness, friction=1.0, count=32, **how):
    """A semicircular arch of voussoirs under its own weight, of mean radius 1."""
    scene, angles = Blocks(**how), np.linspace(np.pi, 0.0, count + 1)

    def joint(angle):
        return [
            (
                (1.0 + side * thickness / 2) * np.cos(angle),
                (1.0 + side * thickness / 2) * np.sin(angle),
            )
            for side in (1, -1)
        ]

    for k, (a, b) in enumerate(itertools.pairwise(angles)):
        corners = [*joint(b)[::-1], *joint(a)]
        (x, y), (x1, y1) = np.transpose(corners), np.roll(np.transpose(corners), -1, axis=1)
        twice = x * y1 - x1 * y
        centre = (
            ((x + x1) * twice).sum() / (3 * twice.sum()),
            ((y + y1) * twice).sum() / (3 * twice.sum()),
        )
        scene.body(f"v{k}", corners, ((0.0, -twice.sum() / 2), centre))
        scene.contact(f"v{k}", f"v{k - 1}" if k else "left", *joint(a), "coulomb", friction)
    return scene.contact(f"v{count - 1}", "right", *joint(0.0)[::-1], "coulomb", friction)


def wall(columns, rows, push, **how):
    """Bricks in running bond on a floor; the first one of the highest row is pushed along x."""
    scene, below = Blocks(**how), []
    for j in range(rows):
        row = [(f"r{j}b{i}", i + 0.5 * (j % 2)) for i in range(columns)]
        for i, (name, x) in enumerate(row):
            load = [((push, 0.0), (x, 0.5 * j + 0.25))] if i == 0 and j == rows - 1 else []
            scene.box(name, x, 0.5 * j, 1, 0.5, *load)
            if i:
                scene.contact(name, row[i - 1][0], (x, 0.5 * j + 0.5), (x, 0.5 * j), "coulomb", 0.5)
            for other, at in below or [("floor", x)]:
                if abs(at - x) < 1.0:
                    scene.contact(
                        name,
                        other,
                        (max(x, at), 0.5 * j),
                        (min(x, at) + 1, 0.5 * j),
                        "coulomb",
                        0.5,
                    )
        below = row
    return scene
