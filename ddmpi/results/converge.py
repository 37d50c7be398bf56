"""converge.json: the meshes of a run with targets of results, and their bars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ddmpi.scene.results import with_letters


def table_of(summary: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """By result with a target: what it is asked to be within, what half its bar takes, and of each mesh unknowns, value, bar,
    word, processor seconds and bytes. Not collective."""
    found = {}
    levels = summary["discretization_error"]["levels"]
    for name, within in summary["scene"]["method"]["target"].items():
        result = with_letters(name)
        found[result] = {
            "within": within,
            "half": summary["errors"][result]["half"],
            "meshes": [
                {"unknowns": level["n"], "seconds": level["seconds"], "bytes": level["bytes"]}
                | level["results"][result]
                for level in levels
                if result in level.get("results", {})
            ],
        }
    return found
