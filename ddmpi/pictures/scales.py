"""The ends of colours: those of one field are the same in all pictures and views of a run, whatever they show of it."""

from pathlib import Path

import numpy as np

from ddmpi.pictures.moved import PRESSED, pressed
from ddmpi.pictures.sheet import limits
from ddmpi.pictures.views import Skin, View
from ddmpi.results.fields import group_of
from ddmpi.results.histories import evenly, step_times
from ddmpi.results.tables import Results

BRIGHTEST = 0.998  # share of the area at which colours of stresses end: singular ones must not set the scale
MOST = 200  # most load steps that are read for the ends of stresses


def stress_end(results: Results, folder: Path | None = None, skin: Skin | None = None) -> float:
    """The von Mises stress (Pa) at which colours end: BRIGHTEST of the boundary, in the plane of the bodies, has less, in
    each load step whose fields are in the `folder`. `skin` is that of the bodies without a cut. Not collective."""
    import h5py

    points = results.points
    areas = (skin or Skin(View(points), points, results.fields["cells"])).areas(points)
    of_steps = [results.fields["nodal_von_mises"]]
    times = step_times(folder) if folder and results.energy else []
    if folder and len(times) > 1:
        with h5py.File(folder / "result.h5", "r") as file:
            groups = [file.get(group_of(k), file) for k in evenly(len(times), MOST)]
            of_steps = [group["nodal_von_mises"][()] for group in groups]
    return max(limits(values, areas, BRIGHTEST)[1] for values in of_steps)


def pressure_ends(results: Results) -> tuple[float, float]:
    """The normal stresses (Pa) at which colours of contacts begin and end: 0, and what PRESSED of the area under pressure
    does not exceed, of all `pressed` contacts and load steps; both signs alike where there is tension."""
    stresses, areas = [np.zeros(1)], [np.zeros(1)]
    for contact in pressed(results):
        table = results.contacts[contact["name"]]
        values = (results.legs.get(contact["name"]) or table)["normal_stress"]
        stresses.append(np.nan_to_num(values))
        # the same nodes in each load step, but where bodies move far
        areas.append(np.resize(table["length" if "length" in table else "area"], len(values)))
    values = np.concatenate(stresses)
    under = np.where(values, np.concatenate(areas), 0.0)
    most = limits(np.abs(values), under, PRESSED)[1] if under.any() else 0.0
    return -most if values.min() < 0.0 else 0.0, most
