"""Runs that go on from checkpoints here and there, in this process."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mpi4py import MPI
from scenes import write_scene

from ddmpi.results import checkpoint
from ddmpi.run.run import run
from ddmpi.scene.reader import read_scene_file


def go_on_from_checkpoints(
    scene: dict, folder: Path, some: slice, keys: tuple[str, ...] = ("steps",)
) -> list[str]:
    """Run a scene, and go on from `some` of the checkpoints that it writes: the tables and fields, byte for byte, and
    the `keys` of the summary are those of the run without an interruption. Returns the names of the files."""
    path, kept, write = write_scene(scene, folder / "scene.toml"), [], checkpoint.write

    def keep(target: Path, *arguments) -> None:
        kept.append(folder / f"{len(kept)}")
        kept[-1].mkdir()
        write(kept[-1] / target.name, *arguments)

    def compute(into: Path, restart: Path | None = None) -> dict:
        run(
            MPI.COMM_SELF,
            read_scene_file(path),
            str(path),
            str(into),
            False,
            restart and str(restart),
        )
        summary = json.loads((into / "summary.json").read_text(encoding="utf-8"))
        return {key: summary[key] for key in keys} | {
            each.name: each.read_bytes() for each in [*into.glob("*.csv"), into / "result.h5"]
        }

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "write", keep)
        whole = compute(folder / "whole")
        patch.setattr(checkpoint, "write", lambda *_: None)
        assert len(kept[some]) >= 2
        for place in kept[some]:
            assert compute(place, place) == whole
    return list(whole)
