"""What one case of a scene leaves for the next, by what it depends on.

A run is a chain of stages: mesh, stiffness, compliance, free displacements, interfaces. Each is a value that a function
makes of others. `Kept` holds the last value of each stage of each body or contact with a key, a digest of all that the
function reads. Where the key of a case is the same, so is the value, to the bit, and it is taken instead of made.
Within a case bodies and contacts that are alike have the same keys, and share what is made for the first of them.
"""

import dataclasses
import gc
import hashlib
import itertools
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sparse

T = TypeVar("T")


def digest(*things: Any) -> str:
    """A key that is the same for the same content: arrays, sparse matrices, dataclasses, tables of these, and anything
    else by its repr, such as tables of a scene. Not collective."""
    total = hashlib.blake2b(digest_size=16)
    _feed(total, things)
    return total.hexdigest()


def _feed(total: Any, thing: Any) -> None:
    total.update(f"<{type(thing).__name__}>".encode())
    if isinstance(thing, np.ndarray):
        total.update(repr((thing.shape, thing.dtype.str)).encode())
        total.update(np.ascontiguousarray(thing).data)
    elif sparse.issparse(thing):
        _feed(total, (thing.shape, thing.indptr, thing.indices, thing.data))
    elif dataclasses.is_dataclass(thing):
        _feed(
            total, {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)}
        )
    elif isinstance(thing, Mapping):
        _feed(total, [*thing, *thing.values()])
    elif isinstance(thing, list | tuple):
        total.update(f"{len(thing)}:".encode())
        for entry in thing:
            _feed(total, entry)
    else:
        total.update(repr(thing).encode())


def _lock(thing: Any) -> None:
    """Let nobody write into the arrays of a value."""
    if isinstance(thing, np.ndarray):
        thing.flags.writeable = False
    elif dataclasses.is_dataclass(thing):
        _lock([getattr(thing, field.name) for field in dataclasses.fields(thing)])
    elif isinstance(thing, Mapping):
        _lock([*thing.values()])
    elif isinstance(thing, list | tuple):
        for entry in thing:
            _lock(entry)


class Kept:
    """The last value of each stage of each body and contact. Not collective: a rank keeps what it makes.

    Parameters
    ----------
    locked : whether arrays of values cannot be written into, as where programs see them in the answers of cases

    Attributes
    ----------
    found : stages that the present case has taken, by body or contact
    """

    def __init__(self, locked: bool = False) -> None:
        self.found: dict[str, list[str]] = {}
        self._locked = locked
        self._entries: dict[tuple[str, str], tuple[str, Any]] = {}
        self._alike: dict[tuple[str, str], Any] = {}  # values of this case, by stage and key
        self._conditions, self._memory = "", 0.0
        self._met: set[tuple[str, str]] = set()
        self._unlike = itertools.count()

    def begin(self, conditions: Any) -> None:
        """Begin a case. `conditions`, such as options, belong to all keys."""
        self.found, self._met, self._conditions = {}, set(), digest(conditions)
        self._alike.clear()

    def get(
        self,
        stage: str,
        owner: str,
        depends: Any,
        make: Callable[[], T],
        lasts: Callable[[T], bool] = lambda value: True,
    ) -> T:
        """The value of a stage of a body or contact that depends on the content of `depends`, see `digest`; made where
        it is not there, and kept and shared if it `lasts`."""
        slot, key = (stage, owner), digest(self._conditions, depends)
        self._met.add(slot)
        if slot in self._entries and self._entries[slot][0] == key:
            self.found.setdefault(owner, []).append(stage)
            return self._alike.setdefault((stage, key), self._entries[slot][1])
        self._entries.pop(slot, None)  # its memory goes before the new value is made
        if (stage, key) not in self._alike:
            value = make()
            if self._locked:
                _lock(value)
            if not lasts(value):
                return value
            self._alike[stage, key] = value
        self._entries[slot] = key, self._alike[stage, key]
        return self._alike[stage, key]

    def key(self, stage: str, owner: str) -> str:
        """The key of a value that this case has got, for what depends on it; unlike all others if none is kept."""
        slot = stage, owner
        return (
            self._entries[slot][0]
            if slot in self._entries and slot in self._met
            else f"{next(self._unlike)}"
        )

    def expect(self, stage: str, depends: Mapping[str, Any]) -> None:
        """Drop the values of a stage that the case will not take, before any is made: `depends` by body or contact."""
        keys = {owner: digest(self._conditions, entry) for owner, entry in depends.items()}
        self._drop(
            {
                slot
                for slot, (key, _) in self._entries.items()
                if slot[0] == stage and keys.get(slot[1]) != key
            }
        )

    def end(self) -> None:
        """Drop what the case has not met, such as the stages of a body that is no more."""
        self._alike.clear()
        self._drop(self._entries.keys() - self._met)

    def _drop(self, slots: set[tuple[str, str]]) -> None:
        for slot in slots:
            del self._entries[slot]
        if slots:
            gc.collect()  # solvers and what calls them back refer to each other in a circle

    def memory(self, measure: Callable[[], float]) -> float:
        """The free memory (bytes) that decides how a body is solved: that of the first case. What is kept fills memory,
        and a case must be solved as it would be by itself."""
        self._memory = self._memory or measure()
        return self._memory
