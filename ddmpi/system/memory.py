"""Free memory of this machine, and returning memory to it."""

from __future__ import annotations

import contextlib
import ctypes
import gc
from collections.abc import Iterator
from pathlib import Path

_MALLOC = {-1: 2**20, -3: 2**20, -4: 2**16}
"""Settings of mallopt: M_TRIM_THRESHOLD and M_MMAP_THRESHOLD (bytes), M_MMAP_MAX."""

GROUPS = {
    "": ("sys/fs/cgroup", "memory.max"),
    "memory": ("sys/fs/cgroup/memory", "memory.limit_in_bytes"),
}
"""Folder and file of the limit that a batch system sets by control groups: version 2 (no controller named) and 1."""


def free_memory(root: Path = Path("/")) -> float:
    """Bytes that a process can allocate: free memory of the machine, or the limit of the control group if less.

    Infinite if neither is known. `root` is the root of the file system. Not collective.
    """
    lines = [line.split() for line in _read(root / "proc/meminfo").splitlines()]
    known = [1024.0 * int(line[1]) for line in lines if line[0] == "MemAvailable:"]
    for line in _read(root / "proc/self/cgroup").splitlines():
        _, controllers, name = line.split(":", 2)
        if controllers in GROUPS:
            base, limit = GROUPS[controllers]
            group = root / base / name.strip("/")
            while (
                group != (root / base).parent
            ):  # the limit of a group holds for the groups within it
                known += [
                    float(number) for number in _read(group / limit).split() if number.isdecimal()
                ]
                group = group.parent
    return min(known, default=float("inf"))


def give_back() -> None:
    """Return freed memory to the system from now on, if the C library is glibc. Not collective.

    Once PETSc is loaded (Debian's, at least), arrays of all sizes share one heap that never shrinks, in pieces that
    the next large array may not fit into. These are glibc's own settings: large arrays are mapped one by one.
    """
    with contextlib.suppress(AttributeError, OSError):
        library = ctypes.CDLL(None)
        for setting, value in _MALLOC.items():
            library.mallopt(setting, value)
        library.malloc_trim(0)


def _read(path: Path) -> str:
    """The text of a file; empty if it cannot be read."""
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""


@contextlib.contextmanager
def loading() -> Iterator[None]:
    """Load modules without garbage collection, and exclude all present objects from later ones. Not collective.

    For the start of a process only: present objects must not hold PETSc objects, which would outlive PETSc.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
