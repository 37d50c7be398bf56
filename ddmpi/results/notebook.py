"""An answer as a notebook shows it: HTML with a table of the contacts and a picture, in one piece."""

import base64
import html
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.results.fields import table_fields
from ddmpi.results.summary import ROWS, as_float
from ddmpi.results.tables import STATUS, chains
from ddmpi.system.numbers import scaled_unit
from ddmpi.system.provenance import has_matplotlib

SHOWN = 4
"""Most contacts in the picture: those with the largest forces."""

COLUMNS = ("normal_force", "tangential_force", "pressure_max", *STATUS)
"""The entries of a contact in the table."""


def as_html(summary: Mapping[str, Any], contacts: Mapping[str, ContactState]) -> str:
    """The contacts of an answer; where matplotlib is installed with their stresses. Not collective."""
    moved = _amount(summary["displacement_max"], summary["units"]["length"])
    parts = [f"<b>{html.escape(summary['title'] or 'Answer')}</b>: {html.escape(summary['reason'])}; largest "
             f"displacement {moved}", _table(summary)]
    parts += [f"<p>Warning: {html.escape(warning)}</p>" for warning in summary["warnings"]]
    if contacts and has_matplotlib():
        image = base64.b64encode(_picture(summary, contacts)).decode("ascii")
        parts.append(f'<img alt="stresses of the contacts" src="data:image/png;base64,{image}">')
    return "<div>" + "\n".join(parts) + "</div>"


def _table(summary: Mapping[str, Any]) -> str:
    rows = [ROWS[f"contacts.NAME.{key}"] for key in COLUMNS]
    heads = "".join(f"<th>{html.escape(row.words)}</th>" for row in rows)
    lines = [f"<tr><th></th>{heads}</tr>"]
    for name, contact in summary["contacts"].items():
        cells = [_amount(contact[key], summary["units"][row.quantity]) if row.quantity else str(contact[key])
                 for key, row in zip(COLUMNS, rows, strict=True)]
        lines.append(f"<tr><th>{html.escape(name)}</th>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"


def _amount(value: float | None, unit: str) -> str:
    factor, unit = scaled_unit(abs(as_float(value)), unit)
    return "–" if value is None else html.escape(f"{value / factor:.4g} {unit}")


def _picture(summary: Mapping[str, Any], contacts: Mapping[str, ContactState]) -> bytes:
    """A PNG file: in the plane stresses along the contacts, in space the pressure at their nodes."""
    from matplotlib.figure import Figure  # without pyplot: a notebook's own figures are left alone

    shown = sorted(contacts, key=lambda name: -float(np.abs(contacts[name].normal_force).sum()))[:SHOWN]
    figure = Figure(figsize=(6.4, 2.6 * len(shown)), layout="constrained")
    for place, name in enumerate(shown, 1):
        table, units = contacts[name].table(), summary["units"]
        factor, unit = scaled_unit(float(np.nan_to_num(np.abs(table["normal_stress"])).max()), units["stress"])
        if "z" in (table.dtype.names or ()):
            axes, at = figure.add_subplot(len(shown), 1, place), np.column_stack([table[axis] for axis in "xyz"])
            at = at - at.mean(axis=0)  # seen from where the contact is widest
            across = at @ np.linalg.svd(at.T @ at)[2][:2].T
            points = axes.scatter(*across.T, c=table["normal_stress"] / factor, s=8)
            figure.colorbar(points, ax=axes, label=f"pressure ({unit})")
            axes.set(aspect="equal", xlabel=f"along the contact ({units['length']})")
        else:
            axes, start = figure.add_subplot(len(shown), 1, place), 0.0
            for chain in chains(table_fields(contacts[name])["facets"]):
                at = table[chain]  # pieces of a contact one after the other
                arc = start + np.append(0.0, np.cumsum(np.hypot(np.diff(at["x"]), np.diff(at["y"]))))
                for kind, colour in (("normal", "tab:blue"), ("tangential", "tab:orange")):
                    axes.plot(arc, at[f"{kind}_stress"] / factor, ".-", color=colour, label=None if start else kind)
                start = arc[-1]
            axes.set(xlabel=f"along the contact ({units['length']})", ylabel=f"stress ({unit})")
            axes.legend()
        axes.set_title(name.replace("$", r"\$"))
    with io.BytesIO() as file:
        figure.savefig(file, format="png")
        return file.getvalue()
