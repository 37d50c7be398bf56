"""summary.json: everything about a run that is not an array, by the names of bodies and contacts."""

import json
import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from ddmpi.interface.state import ContactTotals
from ddmpi.judge.accuracy import price_in_words
from ddmpi.judge.bars import Facts
from ddmpi.judge.certificate import Certificate, ContactResiduals
from ddmpi.judge.equilibrium import Mechanism, describe
from ddmpi.judge.motions import TURN
from ddmpi.results.tables import FORMAT, STATUS
from ddmpi.scene.contacts import Rigid
from ddmpi.scene.motions import Image
from ddmpi.scene.output import units
from ddmpi.scene.results import named
from ddmpi.scene.time import Cycle
from ddmpi.system.files import MECHANISM, writing
from ddmpi.system.numbers import RigidMotion, in_words, moment, place_of_largest, with_error

PRECISION = 1e-8  # components of a force below this fraction of it are told as zero: rounding, and errors of iterations


class Row(NamedTuple):
    """An entry of the summary that the log and the report tell.

    Attributes
    ----------
    words : its name there
    quantity : of its unit, a key of `units`, "angle" or "%"; empty for counts and names
    """

    words: str
    quantity: str = ""


RESIDUALS = {
    "force_mismatch": "difference of the contact forces of the two bodies, over the forces",
    "penetration": "the largest overlap at the nodes, or opening where bonded or guided, over the size of the contact "
    "displacements",
    "complementarity": "force across open nodes, and tension",
    "friction": "distance of tangential forces from the friction law, over the largest force",
    "equilibrium": "imbalance of the forces in a body, over its loads",
}
"""What each residual of the certificate means."""

ROWS = {
    "bodies.NAME.n": Row("unknowns"),
    "bodies.NAME.n_A": Row("solves"),
    "bodies.NAME.displacement_max": Row("largest displacement", "length"),
    "bodies.NAME.von_mises_max": Row("von Mises stress", "stress"),
    "bodies.NAME.energy": Row("strain energy", "energy"),
    "bodies.NAME.points.POINT.displacement": Row("displacement", "length"),
    "bodies.NAME.reaction": Row("reaction", "force"),
    "bodies.NAME.loads.GROUP.force": Row("force", "force"),
    "bodies.NAME.loads.GROUP.moment": Row("moment", "moment"),
    "bodies.NAME.discretization_error": Row("estimated error", "%"),
    "bodies.NAME.solver": Row("solver"),
    "bodies.NAME.compliance": Row("compliance"),
    "bodies.NAME.certificate.equilibrium": Row("equilibrium"),
    "contacts.NAME.m": Row("nodes"),
    "contacts.NAME.force": Row("force", "force"),
    "contacts.NAME.moment": Row("moment", "moment"),
    "contacts.NAME.normal_force": Row("normal force", "force"),
    "contacts.NAME.tangential_force": Row("tangential force", "force"),
    **{f"contacts.NAME.{status}": Row(status) for status in STATUS},
    "contacts.NAME.dissipated": Row("dissipated", "energy"),
    "contacts.NAME.utilisation": Row("friction utilised", "%"),
    "contacts.NAME.pressure_max": Row("largest pressure", "stress"),
    "contacts.NAME.pressure_mean": Row("mean pressure", "stress"),
    **{
        f"contacts.NAME.certificate.{kind}": Row(kind.replace("_", " "))
        for kind in ContactResiduals._fields
    },
    "contacts.NAME.pointwise_penetration": Row("penetration between nodes up to", "length"),
    "contacts.NAME.moment_imbalance": Row("moment imbalance", "moment"),
    "contacts.NAME.moment_imbalance_bound": Row("bound", "moment"),
    "rigid.NAME.displacement": Row("displacement", "length"),
    "rigid.NAME.force": Row("force of bodies", "force"),
    "rigid.NAME.turn": Row("turn", "angle"),
    "rigid.NAME.moment": Row("moment of bodies", "moment"),
    "energy.external_work": Row("work of loads, clamps and rigid partners", "energy"),
    "energy.strain_energy": Row("strain energy", "energy"),
    "energy.interface_work": Row("work of the contact forces", "energy"),
    "energy.dissipated": Row("of it dissipated by friction", "energy"),
    "energy.lost": Row("of it taken by interference, closing gaps and time stepping", "energy"),
}
"""By the dotted name of an entry; NAME is that of a body, a contact or a rigid partner. docs/reference/results.md says
what every entry of summary.json means."""


SLIDES, MANY = 0.9, 0.5
"""A contact that bears less than the first fraction of its friction is told to be far from sliding, if more than the
second fraction of its closed nodes slip."""

NEGLIGIBLE = 1e-4
"""Loads along held motions below this fraction of their bound are not told."""


def tell(summary: Mapping[str, Any], table: str, name: str, key: str, digits: int = 4) -> str:
    """An entry of a body, contact or rigid partner in words: "3 open", "largest pressure 64.42 MPa", "force (3, −4) N"."""
    row, value = ROWS[f"{table}.NAME.{key}"], summary[table][name][key]
    if key == "pressure_max" and as_float(value) < 0.0:  # a bond, all in tension
        row, value = row._replace(words="least tension"), -value
    if not row.quantity:
        return f"{value} {row.words}"
    unit = "rad" if row.quantity == "angle" else summary["units"][row.quantity]
    if not isinstance(value, list):
        place = where(summary[table][name], key)
        return f"{row.words} {as_float(value):.{digits}g} {unit}" + f" at {place}" * bool(place)
    components = np.array([as_float(component) for component in value])
    size = float(np.linalg.norm(components))
    if row.quantity == "force":  # of a fit pressures are in balance by themselves, but for rounding
        # beside the contact itself, or those of a body or a rigid partner: those of others may bear far more
        own = [name]
        if table != "contacts":
            contacts = summary["scene"]["contact"]
            own = [one["name"] for one in contacts if name in one["bodies"]]
        size = max([size, *(as_float(summary["contacts"][one]["normal_force"]) for one in own)])
    components[np.abs(components) < PRECISION * size] = 0.0
    return (
        f"{row.words} ({', '.join(f'{component:.{digits}g}' for component in components)}) {unit}"
    )


def value_of(summary: Mapping[str, Any], result: str) -> float | None:
    """The value of a result by its name; None where the summary has none."""
    one = named(result)
    entry = summary[one.kind].get(one.name, {})
    value = (entry["points"][one.point] if one.point else entry).get(one.what)
    return value[one.axis] if isinstance(value, list) else value


def quantity_of(result: str) -> str:
    """The quantity of a result, a key of `units`."""
    one = named(result)
    return ROWS[f"{one.kind}.NAME.{'points.POINT.' * bool(one.point)}{one.what}"].quantity


def facts_of(
    summary: Mapping[str, Any], results: Iterable[str], unbounded: Collection[str]
) -> dict[str, Facts]:
    """The facts of `results` on which their bars depend, with the names of those that may have no limit on finer meshes.
    Not collective."""
    scales, error = _scales(summary), summary["discretization_error"]["energy_norm"]
    several = summary["scene"].get("time") is not None
    return {
        result: Facts(
            value_of(summary, result),
            scales[quantity_of(result)],
            summary["order"],
            error,
            result in unbounded,
            several and named(result).what == "dissipated",
            not summary["contacts"],
        )
        for result in results
    }


def _scales(summary: Mapping[str, Any]) -> dict[str, float]:
    """By quantity its largest number in bodies, contacts and rigid partners."""
    scales = dict.fromkeys(summary["units"], 0.0)
    for kind in ("bodies", "contacts", "rigid"):
        for entry in summary[kind].values():
            for key, value in entry.items():
                row = ROWS.get(f"{kind}.NAME.{key}")
                if row and row.quantity in scales and value is not None:
                    sizes = np.abs(np.array(value, float))
                    scales[row.quantity] = max(scales[row.quantity], float(np.nanmax(sizes)))
    return scales


def with_bar(
    summary: Mapping[str, Any], result: str, entry: Mapping[str, Any] | None = None
) -> str:
    """A result with its error in words: "3.51e+04 ± 4e+02 N", or "38.1 MPa, no bar: not resolved"; `entry` is that of
    another mesh."""
    entry, unit = entry or summary["errors"][result], summary["units"][quantity_of(result)]
    value, bar = as_float(entry["value"]), entry["bar"]
    if bar is None:
        return f"{value:.4g} {unit}, no bar: {entry['word']}"
    return f"{with_error(value, bar)} {unit}"


def half_in_words(summary: Mapping[str, Any]) -> str:
    """What half of the bars takes at most; empty where there are none."""
    prices = {name: entry.get("half") for name, entry in summary.get("errors", {}).items()}
    prices = {name: price for name, price in prices.items() if price}
    if not prices:
        return ""
    dearest = max(prices, key=lambda name: prices[name]["seconds"])
    return f"half of the bar of {dearest}{', the dearest one,' * (len(prices) > 1)} takes {price_in_words(prices[dearest])}"


def where(entry: Mapping[str, Any], key: str) -> str:
    """The place of a maximum of a summary's entry in words, such as "(1.5, 2)"; empty if it has none."""
    place = entry.get(f"{key}_at")
    return in_words(np.array(place, float), 4) if place is not None else ""


def place_of_all(entries: Iterable[Mapping[str, Any]], key: str) -> np.ndarray | None:
    """The place of the largest value of several entries, by their own largest values and places."""
    placed = [entry for entry in entries if entry.get(f"{key}_at") is not None]
    return (
        place_of_largest(
            np.array([entry[key] for entry in placed]),
            np.array([entry[f"{key}_at"] for entry in placed]),
        )
        if placed
        else None
    )


def held_in_words(summary: Mapping[str, Any]) -> list[str]:
    """What is said of each of the motions that were held, as nothing determines them."""
    lines = []
    for held in summary.get("held_motions", ()):
        unit = summary["units"]["moment" if TURN in held["motion"] else "force"]
        load, bound = as_float(held["moment"]), as_float(held["bound"])
        left = (
            ""
            if load <= NEGLIGIBLE * bound
            else (
                f". The loads leave {load:.3g} {unit} along it, of {bound:.3g} that errors of normals may bear"
            )
        )
        where = "they were" if _of_several(held["motion"]) else "it was"
        lines.append(f"{held['motion']}; held where {where}{left}")
    return lines


def loose_in_words(summary: Mapping[str, Any]) -> list[str]:
    """What is said of each of the motions that nothing determines: Newton's method takes the least, see
    `ddmpi.run.least`."""
    least = summary["outer"] == "newton" and summary["converged"]
    words = {
        (True, False): "it lies where it moves least",
        (True, True): "they lie where they move least",
        (False, False): "how far it has moved is not determined",
        (False, True): "how far they have moved is not determined",
    }
    return [
        f"{motion}; {words[least, _of_several(motion)]}"
        for motion in summary.get("undetermined", ())
    ]


def _of_several(motion: str) -> bool:
    """Whether a motion in words, as of `describe`, is one of several bodies."""
    return " and " in motion.split(" can ")[0]


def count(contacts: Iterable[Mapping[str, Any]]) -> str:
    """The nodes of some contacts by their status, in words: "3 open, 4 slip, 3 stick"."""
    contacts = list(contacts)
    return ", ".join(
        f"{sum(contact[status] for contact in contacts)} {status}" for status in STATUS
    )


def friction_in_words(contact: Mapping[str, Any]) -> str:
    """How much of its friction a contact bears, in words; empty without friction."""
    share = contact.get("utilisation")
    if share is None:
        return ""
    bears = f"bears {100.0 * share:.3g} % of the friction that it could"
    closed = contact["slip"] + contact["stick"]
    if share < SLIDES and contact["slip"] > MANY * closed:
        return f"{contact['slip']} of {closed} closed nodes slip, but the contact {bears}"
    return bears


def largest(entries: Mapping[str, Mapping], key: str) -> tuple[float | None, str]:
    """The largest value of the `entries`, and its name; None, and the first name, if all are None. Of values that are
    equal but for rounding, that of the place which `place_of_all` has."""
    name = max(
        entries,
        default="",
        key=lambda name: -math.inf if entries[name][key] is None else entries[name][key],
    )
    if name and entries[name].get(f"{key}_at") is not None:
        placed = {other: entry for other, entry in entries.items() if entry[key] is not None}
        place = plain(place_of_all(placed.values(), key))
        name = next(
            (other for other, entry in placed.items() if plain(entry[f"{key}_at"]) == place), name
        )
    return entries[name][key] if name else None, name


def as_float(value: float | None) -> float:
    """A number of a summary, NaN for None."""
    return math.nan if value is None else value


def summarize(
    scene: dict,
    run: Mapping[str, Any],
    bodies: Mapping[str, dict],
    contacts: Mapping[str, ContactTotals],
    certificate: Certificate,
) -> dict:
    """The content of summary.json but for provenance and times, as plain data. Not collective.

    Numbers that are not finite become None, JSON's null.

    Parameters
    ----------
    scene : resolved
    run : the entries that do not follow from the others
    bodies : by name, in the order of the scene, their entries but for certificate and n_A, which are added
    contacts : at the end by name, in the order of the scene
    """
    dimension = len(next(iter(bodies.values()))["reaction"])
    method = scene["method"]
    entries = {
        name: body
        | {
            "n_A": sum(body["n_A_by_purpose"].values()),
            "certificate": {"equilibrium": certificate.equilibrium[name]},
        }
        for name, body in bodies.items()
    }
    n_A, m = (
        sum(entry["n_A"] for entry in entries.values()),
        sum(contact.m for contact in contacts.values()),
    )
    return plain(
        {
            "format": FORMAT,
            "title": scene["title"],
            "converged": run["converged"],
            "reason": run["reason"],
            "outer": method["outer"],
            "algorithm": method.get("algorithm") or method["outer"],
            "splitting": method.get("splitting") or "none",
            "friction": ", ".join(dict.fromkeys(contact.law for contact in contacts.values())),
            "n": sum(body["n"] for body in bodies.values()),
            "m": m,
            "n_A": n_A,
            "eff": n_A / (2 * m) if m else None,
            "bodies": entries,
            "contacts": {
                name: _contact(contact)
                | image_of(scene, name)
                | {
                    "certificate": certificate.contacts[name]._asdict(),
                    "dissipated": np.sum(
                        np.array(
                            [step["contacts"][name]["dissipated"] for step in run["steps"]], float
                        )
                    ),
                }
                for name, contact in contacts.items()
            },
            "rigid": rigid_partners(contacts.values()),
            "certificate": {kind: value for kind, (value, _) in certificate.worst().items()},
            "displacement_max": np.max([body["displacement_max"] for body in bodies.values()]),
            "displacement_max_at": place_of_all(bodies.values(), "displacement_max"),
            "units": units(scene, dimension),
            **run,
            "seconds": {},
            "scene": scene,
        }
    )


def rigid_partners(contacts: Iterable[ContactTotals]) -> dict[str, dict[str, np.ndarray]]:
    """Displacement (m) and force (N) (d,) of each rigid partner that bodies may touch, by its name; of one that turns
    also its turn (rad) and the moment about its pivot (N m)."""
    partners: dict[str, dict[str, np.ndarray]] = {}
    for contact in contacts:
        if contact.rigid is not None:
            moved, turn, pivot = contact.rigid
            entry = partners.setdefault(
                contact.bodies[1], {"displacement": moved, "force": np.zeros(len(moved))}
            )
            entry["force"] = entry["force"] - contact.force
            if len(turn):
                about = moment(np.atleast_2d(pivot), contact.force[None])
                entry["turn"] = turn if len(turn) > 1 else turn[0]
                entry["moment"] = entry.get("moment", 0.0) - contact.moment + about
    return partners


def drawn_times(summary: dict, times: Any) -> Any:
    """The times in the histories of the scene of the `times` of load steps, as cycles repeat some and delay others."""
    cycle = (summary["scene"].get("time") or {}).get("cycle")
    return msgspec.convert(cycle, Cycle).drawn(times, summary["cycles"]["run"]) if cycle else times


def factor_at(summary: dict, name: str | None, time: float | None) -> float:
    """The factor of the history `name` at `time`, by default at the last load step; 1 without a history."""
    history = summary["scene"].get("history", {}).get(name)
    if not history:
        return 1.0
    last = max([0.0, *(step["time"] for step in summary.get("steps", ()))])
    drawn = drawn_times(summary, last if time is None else time)
    return float(np.interp(drawn, history["times"], history["factors"]))


def motion_at(summary: dict, rigid: Rigid, time: float | None) -> RigidMotion:
    """The motion of a rigid partner at `time`, by default at the last load step."""
    still = np.array(rigid.displacement)
    if not rigid.yields:
        return RigidMotion(factor_at(summary, rigid.history, time) * still)
    at = {0.0: np.zeros(len(still) + rigid.turns_by)} | {
        step["time"]: np.append(
            *(step["rigid"][rigid.name].get(key, []) for key in ("displacement", "turn"))
        )
        for step in summary.get("steps", ())
    }
    now = max(at) if time is None else time
    moved = np.array(
        [np.interp(now, list(at), component) for component in zip(*at.values(), strict=True)]
    )
    return RigidMotion(moved[: len(still)], moved[len(still) :], np.array(rigid.pivot or still))


def image_of(scene: dict, contact: str) -> dict:
    """The entry `image` of a contact of a resolved scene, if it has one: its turn (degrees) or shift (m), and sectors."""
    asked = next(one.get("image") for one in scene["contact"] if one["name"] == contact)
    if not asked:
        return {}
    image, key = msgspec.convert(asked, Image), "turn" if asked["turn"] else "shift"
    return {"image": {key: asked[key], "sectors": image.sectors}}


def whole_of(
    image: Image, dimension: int, bodies: Mapping[str, dict], contacts: Mapping[str, ContactTotals]
) -> dict:
    """Volumes (m³), energies (J) and forces (N) of all sectors of a wheel, of which `image` is the next one."""
    count, turned = image.sectors or 1, image.frame(1.0, dimension).turned
    # the sum over all turns of a vector is so many times its part along the axis
    along = sum(np.linalg.matrix_power(turned, k) for k in range(count))
    return {
        "sectors": count,
        "bodies": {
            name: {
                "volume": count * body["volume"],
                "energy": body["energy"] and count * body["energy"],
                "reaction": along @ body["reaction"],
            }
            for name, body in bodies.items()
        },
        "contacts": {
            name: {
                "normal_force": count * contact.normal_force,
                "tangential_force": count * contact.tangential_force,
                "force": along @ contact.force,
            }
            for name, contact in contacts.items()
        },
    }


def write_summary(path: Path, summary: dict) -> None:
    """Write summary.json into the folder `path`. Not collective. Raises OutputError."""
    write_json(path / "summary.json", summary)


def write_mechanism(path: Path, mechanism: Mechanism) -> None:
    """Write mechanism.json into the folder `path`: the loose bodies, their centres (m) and their velocities about them.

    A velocity is (v_x, v_y, ω), in space (v_x, v_y, v_z, ω_x, ω_y, ω_z), such that the fastest node has velocity 1.
    Not collective. Raises OutputError.
    """
    write_json(
        path / MECHANISM,
        plain(
            {
                "reason": describe(mechanism),
                "imbalance": mechanism.imbalance,
                "bodies": [
                    {"name": body.name, "centre": body.centre, "velocity": velocity}
                    for body, velocity in zip(mechanism.bodies, mechanism.velocities, strict=True)
                ],
            }
        ),
    )


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write plain data as JSON. Not collective. Raises OutputError."""
    with writing(path):
        path.write_text(
            json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n",
            encoding="utf-8",
            errors="backslashreplace",
        )  # names of folders may have bytes that are no text


def _contact(totals: ContactTotals) -> dict:
    imbalance, bound = totals.moment_imbalance
    return {
        "m": totals.m,
        "pairing": "mortar" if totals.slave else "nodes",
        "slave": totals.slave,
        "friction": totals.law,
        **plain(totals.resultants),
        "pressure_max": totals.pressure_max,
        "pressure_max_at": totals.pressure_max_at,
        "pressure_mean": totals.pressure_mean,
        "pointwise_penetration": totals.deepest,
        "moment_imbalance": imbalance,
        "moment_imbalance_bound": bound,
    }


def plain(value: Any) -> Any:
    """The value as JSON has it: lists for arrays, None for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
