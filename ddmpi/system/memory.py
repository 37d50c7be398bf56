"""How much memory this machine has to give."""

from __future__ import annotations

from pathlib import Path

GROUPS = {"": ("sys/fs/cgroup", "memory.max"), "memory": ("sys/fs/cgroup/memory", "memory.limit_in_bytes")}
"""Where control groups of version 2 (no controller named) and 1 keep the limit that a batch system sets."""


def free_memory(root: Path = Path("/")) -> float:
    """Bytes that programs can have: what the machine has free, or the limit of the control group if that is
    less; infinite where neither is known.

    `root` is where the file system begins. Not collective.
    """
    lines = [line.split() for line in _read(root / "proc/meminfo").splitlines()]
    known = [1024.0 * int(line[1]) for line in lines if line[0] == "MemAvailable:"]
    for line in _read(root / "proc/self/cgroup").splitlines():
        _, controllers, name = line.split(":", 2)
        if controllers in GROUPS:
            base, limit = GROUPS[controllers]
            group = root / base / name.strip("/")
            while group != (root / base).parent:  # what holds for a group holds for those within it
                known += [float(number) for number in _read(group / limit).split() if number.isdecimal()]
                group = group.parent
    return min(known, default=float("inf"))


def _read(path: Path) -> str:
    """The text of a file; nothing where there is none."""
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""
