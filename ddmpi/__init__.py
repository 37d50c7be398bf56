"""ddmpi: contact between linear elastic parts, with Tresca or Coulomb friction, by domain decomposition.

The method is that of Haslinger, Kučera, Sassi and Riton: each body lives on its own MPI ranks,
solves with its own stiffness, and exchanges only interface vectors with its neighbours.

    answer = ddmpi.solve("scene.toml")

See `help(ddmpi.solve)`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mpi4py import MPI

    from ddmpi.run.answer import Answer, Model

__version__ = "0.26.0"

__all__ = ["converge", "prepare", "solve", "to_xarray"]


def solve(
    scene: str | Path | Mapping[str, Any],
    comm: MPI.Comm | None = None,
    overrides: Mapping[str, Any] | None = None,
    progress: bool = False,
    only: str | None = None,
    outer: str | type | None = None,
) -> Answer:
    """Solve a scene; nothing is written. Collective on `comm`.

        >>> import ddmpi
        >>> block = {"name": "block", "mesh": {"shape": "rectangle", "size": [2, 1], "divisions": [4, 2]},
        ...          "material": {"young": 2.1e11, "poisson": 0.3}, "traction": [{"on": "top", "pressure": 1e6}]}
        >>> floor = {"name": "floor", "shape": "plane", "point": [0, 0], "normal": [0, 1]}
        >>> scene = {"body": [block], "rigid": [floor], "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}]}
        >>> answer = ddmpi.solve(scene, overrides={"body.block.traction.0.pressure": 2e6})
        >>> answer.certified, round(answer.contacts["block-floor"].pressure.max())
        (True, 2000000)
        >>> answer.bodies["block"].displacement.shape
        (15, 2)

    Parameters
    ----------
    scene : path of a scene file; or its text, of several lines; or a dict with the same keys, with mesh files in the
        current folder. There a mesh may also be arrays, ``"mesh": {"points": (n, d), "cells": (nt, k), "groups": {NAME:
        (nf, kf) facets or (j,) nodes}}``, with the nodes of cells in the order of meshio, from 0 on; the order of the
        elements is that of the cells. Or it is a `meshio.Mesh` with groups as sets of cells and points
    comm : any number of ranks; MPI.COMM_WORLD if left out. PETSc starts on all ranks of
        MPI.COMM_WORLD together: if `comm` is a part of it, call ``petsc4py.init()`` on all ranks before
    overrides : values by key, as after ``--set``: ``{"contact.upper-lower.friction.coefficient": 0.5}``; the mesh of a
        body, ``"body.upper.mesh"``, may be arrays here, too
    progress : whether rank 0 prints the messages of the command; if not, they go to the logger ``ddmpi`` of the module
        logging: ``logging.basicConfig(level="INFO")`` shows them
    only : "contacts" leaves out fields, stresses and the estimated error, as ``output.only`` does
    outer : as ``method.outer``; or a class of your own that is an outer method, see docs/use/methods.md

    Returns
    -------
    Answer : certified or not: look at ``answer.certified``; the arrays below have shapes in numbers of nodes m of a
        contact, nodes nv and cells nt of a body, and coordinates d

    Raises
    ------
    InputError, SolverError, InterruptionError
        of `ddmpi.errors`, the same on all ranks
    """
    from ddmpi.run.answer import Model  # not before it is needed: MPI and PETSc start with it

    with Model(scene, comm, keep=False) as model:
        return model.solve(overrides, only, progress=progress, outer=outer)


def converge(
    scene: str | Path | Mapping[str, Any],
    of: str,
    within: float = 0.01,
    comm: MPI.Comm | None = None,
    overrides: Mapping[str, Any] | None = None,
    progress: bool = False,
) -> Answer:
    """Solve a scene on finer and finer meshes until the error bar of a result is small; nothing is written. Collective on
    `comm`.

        >>> answer = ddmpi.converge("configs/pinched_blocks.toml", of="contacts.upper-lower.normal_force", within=0.002)
        >>> [mesh["unknowns"] for mesh in answer.meshes("contacts.upper-lower.normal_force")]
        [6072, 23760]

    Parameters
    ----------
    scene, comm, overrides, progress : as of `ddmpi.solve`
    of : the result, by its name in ``output.errors``
    within : largest error bar over the value: ``method.target`` has this and no other

    Returns
    -------
    The answer on the last mesh; ``answer.certified`` says whether its bar is within, ``answer.meshes(of)`` is the table of
    all meshes.

    Raises
    ------
    InputError, SolverError, InterruptionError
        as `ddmpi.solve`
    """
    target = {"method.target": {str(of): within}}
    known = hasattr(overrides, "keys") or not overrides  # what else there is, solve refuses
    return solve(scene, comm, {**(overrides or {}), **target} if known else overrides, progress)


def prepare(scene: str | Path | Mapping[str, Any], comm: MPI.Comm | None = None) -> Model:
    """A scene to be solved again and again; what a change does not touch is kept. Collective on `comm`.

        >>> with ddmpi.prepare("configs/pinched_blocks.toml") as model:
        ...     for friction in (0.3, 0.4):
        ...         answer = model.solve({"contact.upper-lower.friction.coefficient": friction}, only="contacts")
        ...         print(answer.certified, model.reused.get("upper"))
        True None
        True ['mesh', 'stiffness', 'factors', 'compliance']

    Parameters
    ----------
    scene, comm : as of `ddmpi.solve`

    Returns
    -------
    Model : its ``solve(overrides)`` gives what `ddmpi.solve` gives with them, to the bit. ``with`` closes it.

    Raises
    ------
    InputError
        where the scene is wrong without overrides, the same on all ranks
    """
    from ddmpi.run.answer import Model

    model = Model(scene, comm)
    model.settle()
    return model


def to_xarray(folder: str | Path) -> Any:
    """The table of a sweep in its `folder` as a `xarray.Dataset`, a variable for each column of numbers. Not collective.

    Parameters
    ----------
    folder : of ``ddmpi sweep``, after its end

    Returns
    -------
    xarray.Dataset : its dimensions are the varied keys, if all combinations of their values were run, else "case". What
        a case lacks is NaN

    Raises
    ------
    InputError
        where there is no table of a sweep, or xarray is not installed
    """
    from ddmpi.sweep.table import to_xarray as read

    return read(folder)
