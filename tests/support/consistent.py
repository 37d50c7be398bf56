"""Whether the numbers of an answer agree with each other: sums, extremes with their places, balances, energies.

Everything is taken from the fields of the bodies and the tables of the contacts by a few lines of numpy, and compared
with the summary.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

ROUNDING = 1e-6
"""A part of a number that is rounding."""

AT_THE_END = ("force", "moment", "normal_force", "tangential_force", "open", "slip", "stick")


def within(found: Any, expected: Any, off: Any, what: str) -> None:
    """What is found is off by at most so much. Not by `pytest.approx`, which takes a tenth of the time of small scenes."""
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    assert found.shape == expected.shape and np.isfinite(expected).all(), what
    assert (np.abs(found - expected) <= off).all(), f"{what}: {found} is not {expected}"


def close(found: Any, expected: Any, size: float, what: str) -> None:
    """Beside `size` a part of ROUNDING counts for nothing."""
    within(found, expected, ROUNDING * np.maximum(np.abs(expected), size), what)


def assert_consistent(answer: Any, left: float = ROUNDING) -> None:
    """Of an answer in one process; `left` is what forces and moments may leave of balance.

    More than rounding is left where gaps and curved sides are lever arms, and where a motion is held. With rounding alone,
    as in the matrix, nothing is excused.
    """
    sharp = left <= ROUNDING
    counts(answer, sharp)
    for name, contact in answer.contacts.items():
        of_table(answer.summary, name, contact.table())
        friction(answer.summary, name, contact.table())
        gaps(answer, name, contact.table(), sharp)
    for name, fields in answer.bodies.items():
        of_fields(answer.summary, name, fields)
    reach = {name: float(np.abs(fields.points).max()) for name, fields in answer.bodies.items()}
    words = " ".join(answer.summary["warnings"])
    if not re.search("are negligible beside|forces are uncertain", words):
        balances(answer.summary, reach, left)
    energies(answer.summary)


def first(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Of the places of largest values that with the smallest x, then y, then z."""
    far = np.abs(places).max() or 1.0
    near = places[values >= values.max() - 1e-6 * np.abs(values).max()]
    return near[np.lexsort(np.round(near.T[::-1] / far, 9))[0]]


def counts(answer: Any, sharp: bool) -> None:
    """Unknowns, nodes, multiplications and iterations add up; steps end as the run does."""
    summary, history = answer.summary, answer.history
    bodies, contacts = summary["bodies"].values(), summary["contacts"].values()
    assert summary["n"] == sum(body["n"] for body in bodies)
    assert summary["m"] == sum(contact["m"] for contact in contacts)
    for body in bodies:
        assert body["n_A"] == sum(body["n_A_by_purpose"].values())
    assert summary["n_A"] == sum(body["n_A"] for body in bodies)
    assert summary["eff"] == (summary["n_A"] / summary["m"] / 2 if summary["m"] else None)
    assert summary["outer_iterations"] == len(history)
    for contact in contacts:
        assert contact["m"] == contact["open"] + contact["slip"] + contact["stick"]
    pushed = any(
        partner["force"] or partner["moment"] is not None for partner in summary["scene"]["rigid"]
    )
    if len(history):
        assert (np.diff(history["n_A"]) >= 0).all()
    moved = pushed or summary["held_motions"] or summary["undetermined"]
    if len(history) and (sharp or not moved):
        for status in ("open", "slip", "stick"):
            assert history[status][-1] == sum(contact[status] for contact in contacts), status
    level = summary["discretization_error"]["levels"][-1]
    error = summary["discretization_error"]["energy_norm"]
    if error is not None:
        assert level["n"] == summary["n"] and level["error"] == error
        squares = sum(body["discretization_error"] ** 2 for body in bodies)
        assert error**2 == pytest.approx(squares, rel=1e-9)
    assert level["dofs"] == sum(fields.points.size for fields in answer.bodies.values())
    # what pushes a partner or a frame has a balance of its own
    apart = pushed or (not sharp and moves_far(summary))
    for kind, value in summary["certificate"].items():
        largest = max(entry["certificate"].get(kind, 0.0) for entry in (*bodies, *contacts))
        assert 0.0 <= largest <= value <= summary["certificate_limit"], kind
        assert value == largest or apart or any("pretension" in each for each in contacts), kind
    steps = summary.get("steps") or []
    cycles = "cycles" in summary  # of them the steps of the last one are kept
    if steps and not cycles:
        assert sum(step["outer_iterations"] for step in steps) == len(history)
    for name, contact in summary["contacts"].items():
        if steps:
            last, spent = steps[-1]["contacts"][name], [s["contacts"][name] for s in steps]
            assert all(last[key] == contact[key] for key in AT_THE_END), name
            listed = sum(s["dissipated"] for s in spent)
            assert contact["dissipated"] == pytest.approx(listed) or (
                cycles and contact["dissipated"] > listed
            ), name


def moves_far(summary: dict) -> bool:
    return (summary["scene"]["time"] or {}).get("motions") == "far"


def of_table(summary: dict, name: str, table: np.ndarray) -> None:
    """Sums and extremes of the lines of a contact, if it has any."""
    if not len(table):
        return
    told = summary["contacts"][name]
    axes = "xyz"[: len(np.atleast_1d(told["force"]))]
    axis = summary["scene"]["axisymmetric"]
    size = np.abs(table["normal_force"]).sum() + np.abs(table["tangential_force"]).sum()
    normal = np.column_stack([table[f"n{each}"] for each in axes])
    at = np.column_stack([table[each] for each in axes])
    if len(axes) == 3:
        force = np.column_stack([table[f"force_{each}"] for each in axes])
        across = force + np.einsum("md,md->m", -force, normal)[:, None] * normal
        close(np.linalg.norm(across, axis=1), table["tangential_force"], size, "lengths")
        close(np.linalg.norm(across.sum(axis=0)), told["tangential_force"], size, "tangential")
    else:
        along = normal[:, ::-1] * [-1.0, 1.0]
        force = (
            -table["normal_force"][:, None] * normal - table["tangential_force"][:, None] * along
        )
        close(table["tangential_force"].sum(), told["tangential_force"], size, "tangential")
    close(-np.einsum("md,md->m", force, normal), table["normal_force"], size, "normal forces")
    close(table["normal_force"].sum(), told["normal_force"], size, "normal")
    close(told["force"], force.sum(axis=0), size, "force")
    assert np.linalg.norm(np.column_stack([*normal.T]), axis=1) == pytest.approx(1.0)
    far = np.abs(at).max()
    if axis:
        assert not np.any(told["moment"])
    elif told["slave"] is None:
        close(told["moment"], np.cross(at, force).sum(axis=0), far * size, "moment")
    area = table["area" if "area" in table.dtype.names else "length"]
    if told["pressure_max"] is not None:
        stress = np.abs(table["normal_stress"]).max()
        apart = told["slave"] is None
        if apart:
            close(table["normal_stress"] * area, table["normal_force"], size, "stress")
            close(table["tangential_stress"] * area, table["tangential_force"], size, "shear")
        close(told["pressure_max"], table["normal_stress"].max(), stress, "largest pressure")
        if told["pressure_max"]:
            place = first(table["normal_stress"], at)
            close(told["pressure_max_at"], place, far, "place of the largest pressure")
        else:
            assert told["pressure_max_at"] is None
        close(told["pressure_mean"] * area.sum(), told["normal_force"], size, "mean pressure")
    used = table["utilisation"]
    assert (used >= 0.0).all() and used.max(initial=0.0) <= 1.0 + 1e-6
    if told["m"] == len(table):
        for status in ("open", "slip", "stick"):
            assert told[status] == (table["status"] == status).sum(), status


def friction(summary: dict, name: str, table: np.ndarray) -> None:
    """Work and utilisation by the law, in one load step from forces and slips."""
    told = summary["contacts"][name]
    law = next(one for one in summary["scene"]["contact"] if one["name"] == name)["friction"]
    size = np.abs(table["tangential_force"])
    area = table["area" if "area" in table.dtype.names else "length"]
    if law["law"] == "none" or told["slave"] is not None:
        return
    kind, share = {"coulomb": ("coefficient", 0.5), "tresca": ("slip_bound", 1.0)}[law["law"]]
    slides = (table["status"] == "slip") * np.abs(table["slip"])
    if not summary.get("steps"):
        close(told["dissipated"], share * (size * slides).sum(), told["dissipated"], "dissipated")
    if isinstance(law[kind], float):
        bound = law[kind] * (table["normal_force"] if share < 1.0 else area)
        closed = bound > 1e-9 * np.abs(table["normal_force"]).max()
        close(table["utilisation"][closed], size[closed] / bound[closed], 1.0, "utilisation")


def gaps(answer: Any, name: str, table: np.ndarray, sharp: bool) -> None:
    """Gaps and slips at nodes, by displacements of both sides."""
    summary = answer.summary
    scene, told = summary["scene"], summary["contacts"][name]
    contact = next(one for one in scene["contact"] if one["name"] == name)
    first_body, second = (answer.bodies.get(body) for body in contact["bodies"])
    if told["slave"] is not None or first_body.in_frame is not None:
        return
    if contact["image"] or contact["pretension"] or len({*contact["bodies"]}) < 2:
        return
    if any("bonds of other contacts" in words for words in summary["warnings"]):
        return  # an overlap that bonds keep is left out
    rigid = next((one for one in scene["rigid"] if one["name"] == contact["bodies"][1]), None)
    beside = first_body.points.shape[1] == 3 or (scene["axisymmetric"] and not sharp)
    if summary["order"] == 2 and beside:
        return  # lines are where the force acts, beside vertices
    if (rigid and rigid["shape"] != "plane") or not isinstance(contact["gap"] or 0.0, float):
        return
    axes = "xyz"[: first_body.points.shape[1]]
    at = np.column_stack([table[each] for each in axes])
    normal = np.column_stack([table[f"n{each}"] for each in axes])

    def at_nearest(fields: Any, values: np.ndarray) -> np.ndarray:
        away = np.abs(fields.points[None] - at[:, None]).max(axis=2)
        return values[away.argmin(axis=1)]

    gap = contact["gap"]
    if gap is None and (sharp or contact["kind"] == "bonded"):
        gap = 0.0  # sides of the matrix touch, and a bond opens from as drawn
    if gap is None and not rigid and summary["order"] == 2:
        return  # between middles that are no nodes of the other side
    u = at_nearest(first_body, first_body.displacement)
    if rigid:
        if "turn" in summary["rigid"][rigid["name"]]:
            return
        v = np.array(summary["rigid"][rigid["name"]]["displacement"]) + 0.0 * u
        gap = (gap or 0.0) + np.einsum("md,md->m", np.array(rigid["point"]) - at, normal)
    else:
        v = at_nearest(second, second.displacement)
        if gap is None:
            gap = np.einsum(
                "md,md->m",
                at_nearest(second, second.points) - at_nearest(first_body, first_body.points),
                normal,
            )
    apart, size = v - u, max(np.abs(u).max(), np.abs(v).max())
    across = np.einsum("md,md->m", apart, normal)
    close(table["gap"], across + gap, size, "gap")
    slip = np.linalg.norm(apart - across[:, None] * normal, axis=1)
    # none is told of a node that is held on an inclined plane
    slides = (table["slip_total"] != 0.0) | sharp
    close(np.abs(table["slip_total"][slides]), slip[slides], size, "slip")


def of_fields(summary: dict, name: str, fields: Any) -> None:
    """Extremes of a body with their places, and stresses by each other."""
    told = summary["bodies"][name]
    far = fields.in_frame is not None
    points = fields.points + fields.displacement if far else fields.points
    moved = np.linalg.norm(fields.in_frame if far else fields.displacement, axis=1)
    close(told["displacement_max"], moved.max(), moved.max(), "displacement")
    if told["displacement_max_at"] is not None:
        at = first(moved, points)
        close(told["displacement_max_at"], at, np.abs(points).max(), "place of the largest")
    assert summary["displacement_max"] == max(
        body["displacement_max"] for body in summary["bodies"].values()
    )
    if fields.von_mises is None:
        return
    close(told["von_mises_max"], fields.von_mises.max(), fields.von_mises.max(), "von Mises")
    stress = fields.stress
    xx, yy, zz, *shears = stress.T
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    expected = np.sqrt(square + 3 * sum(shear**2 for shear in shears))
    close(fields.von_mises, expected, np.abs(stress).max(), "von Mises of stresses")
    corners = points[fields.cells]
    if corners.shape[1:] in ((3, 2), (4, 3)):
        if np.ptp(stress, axis=0).max() <= 1e-7 * np.abs(stress).max():
            even = stress[0] + 0.0 * fields.nodal_stress
            close(fields.nodal_stress, even, np.abs(stress).max(), "stresses at nodes")
        at = first(fields.von_mises, corners.mean(axis=1))
        if told["von_mises_max"]:
            size = np.abs(corners).max()
            close(told["von_mises_max_at"], at, size, "place of the largest stress")
        else:
            assert told["von_mises_max_at"] is None
        if not far:
            stored(summary, told, corners, fields)


def stored(summary: dict, told: dict, corners: np.ndarray, fields: Any) -> None:
    """The energy ½ ∫ σ : ε of cells with even strains, which heat is no part of, from displacements."""
    d = corners.shape[2]
    body = next(one for one in summary["scene"]["body"] if summary["bodies"][one["name"]] is told)
    material = body.get("material")
    if material is None:
        return  # a copy
    if summary["scene"]["axisymmetric"] or body["temperature"] or isinstance(material, list):
        return
    edges = corners[:, 1:] - corners[:, :1]
    moved = fields.displacement[fields.cells]
    gradient = np.linalg.solve(edges, moved[:, 1:] - moved[:, :1])
    strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    which = (
        [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
        if d == 3
        else [(0, 0), (1, 1), None, (0, 1)]
    )
    work = sum(
        stress * strain[:, i, j] * (1 if i == j else 2)
        for stress, (i, j) in ((s, ij) for s, ij in zip(fields.stress.T, which, strict=True) if ij)
    )
    size = np.abs(np.linalg.det(edges)) / (6 if d == 3 else 2)
    energy = 0.5 * (work * size).sum() * material["thickness"]
    acting = sum(np.abs(load["force"]).sum() for load in told["loads"].values())
    close(told["energy"], energy, abs(energy) + 1e-6 * acting * told["displacement_max"], "energy")


def balances(summary: dict, reach: dict[str, float], left: float) -> None:
    """Forces and moments on each body, which is so far from the origin, and on each rigid partner."""
    scene, contacts = summary["scene"], summary["contacts"]
    axis = summary["scene"]["axisymmetric"]
    partners = {one["name"]: one["bodies"] for one in scene["contact"]}
    sharp = left <= ROUNDING
    images = [one["bodies"] for one in scene["contact"] if one["image"] and not sharp]
    turned = {name for bodies in images for name in bodies}
    free = not sharp and (summary["held_motions"] or moves_far(summary))
    for name, partner in summary["rigid"].items():
        on = [one for one, bodies in partners.items() if bodies[1] == name]
        total = sum(np.array(contacts[one]["force"], float) for one in on)
        size = sum(abs(contacts[one]["normal_force"]) for one in on)
        close(partner["force"], -total, size, f"force on {name}")
    acting = [
        part
        for told in summary["bodies"].values()
        for part in (*told["reactions"].values(), *told["loads"].values())
    ]
    every = sum(np.abs(part["force"]).sum() + np.abs(part["moment"]).sum() for part in acting)
    at_times = [contacts, *(step["contacts"] for step in summary.get("steps") or [])]
    every += sum(abs(each["normal_force"]) for known in at_times for each in known.values())
    for body in scene["body"]:
        name = body["name"]
        told = summary["bodies"][name]
        parts, size = [*told["reactions"].values()], every
        reaction = sum(
            (np.array(part["force"], float) for part in parts), 0.0 * np.array(told["reaction"])
        )
        close(told["reaction"], reaction, size, f"reactions of {name}")
        if axis or body.get("temperature") or name in turned:
            continue
        force, moment = reaction, sum(np.array(part["moment"], float) for part in parts)
        for part in told["loads"].values():
            force = force + part["force"]
            moment = moment + np.array(part["moment"])
        for one, on in partners.items():
            for who, sign in zip(on, (1.0, -1.0), strict=True):
                if who == name:
                    force = force + sign * np.array(contacts[one]["force"])
                    moment = moment + sign * np.array(contacts[one]["moment"])
        size = left / ROUNDING * size
        close(force, 0.0 * force, size, f"balance of {name}")
        if not free:
            close(moment, 0.0 * moment, size * (1.0 + reach[name]), f"moments of {name}")


def energies(summary: dict) -> None:
    """What is stored, lost and dissipated."""
    energy = summary.get("energy")
    if energy is None:
        return
    size = max(abs(energy["external_work"]), abs(energy["strain_energy"]))
    lost = energy["interface_work"] - energy["dissipated"]
    close(energy["lost"], lost, size, "lost")
    spent = sum(contact["dissipated"] for contact in summary["contacts"].values())
    close(energy["dissipated"], spent, size, "dissipated")
