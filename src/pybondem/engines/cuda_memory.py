"""Arrays that live in two places: the host's, which everybody knows, and a copy of each in GPU memory.

Steps run on the copies. An array is copied up after the host has written into it, and down when the host looks at it
after the GPU has; else nothing moves.
"""

import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[Any]


class Memory(Protocol):
    """GPU memory, as `cuda_launch.Device` gives it."""

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Any:
        """Return a new array there."""

    def upload(self, host: Array, there: Any) -> None:
        """Copy an array to one there."""

    def download(self, there: Any, host: Array) -> None:
        """Copy an array there to one of the host."""

    def total(self, there: Any) -> float:
        """Return the sum of an array there."""

    def picked(self, there: Any, at: NDArray[np.integer[Any]]) -> Array:
        """Return items (the last index) of an array there."""


@dataclass
class Copy:
    """The copy of one host array: the array there, the host's as long as others hold it, and which of them is newer."""

    there: Any
    host: weakref.ref[Array]
    newer: Literal["host", "gpu"] | None = "host"


class Mirror:
    """Copies of host arrays, each known by the array's identity; a copy is given up when its host array is.

    It is the `state.Holder` of the fields that it copies.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._copies: dict[int, Copy] = {}

    def missing(self, arrays: Iterable[Array]) -> int:
        """Return the bytes that copies of these arrays still need."""
        return sum(array.nbytes for key, array in {id(a): a for a in arrays}.items() if key not in self._copies)

    def keep(self, array: Array) -> None:
        """Make room for a copy of an array, where there is none; raises EngineError where it does not fit."""
        key, copies = id(array), self._copies
        if key not in copies:
            there = self._memory.empty(array.shape, array.dtype)
            copies[key] = Copy(there, weakref.ref(array, lambda _: copies.pop(key, None)))

    def keep_all(self, arrays: Iterable[Array]) -> None:
        """Make room for copies of arrays; raises EngineError where one does not fit, the others undone then."""
        before = set(self._copies)
        try:
            for array in arrays:
                self.keep(array)
        except BaseException:
            for key in self._copies.keys() - before:
                del self._copies[key]
            raise

    def copy_of(self, array: Array) -> Any:
        """Return the copy of an array, brought up to date."""
        self.keep(array)
        copy = self._copies[id(array)]
        if copy.newer == "host":
            self._memory.upload(array, copy.there)
            copy.newer = None
        return copy.there

    def written(self, array: Array) -> None:
        """Take note that the GPU has written into the copy of an array."""
        self._copies[id(array)].newer = "gpu"

    def fetch(self, array: Array) -> None:
        """Bring a host array up to date."""
        copy = self._newer_there(array)
        if copy is not None:
            self._memory.download(copy.there, array)
            copy.newer = None

    def changed(self, array: Array) -> None:
        """Take note that the host has written into an array, all of which is as it should be now."""
        if id(array) in self._copies:
            self._copies[id(array)].newer = "host"

    def total(self, array: Array) -> float:
        """Return the sum of all items of an array as they are now, taken where they are."""
        copy = self._newer_there(array)
        return float(np.sum(array)) if copy is None else self._memory.total(copy.there)

    def picked(self, array: Array, at: NDArray[np.integer[Any]]) -> Array:
        """Return items (the last index) of an array as they are now, taken where they are."""
        copy = self._newer_there(array) if len(at) else None
        found: Array = array[..., at] if copy is None else self._memory.picked(copy.there, at)
        return found

    def _newer_there(self, array: Array) -> Copy | None:
        """Return the copy of an array where it is newer than the array."""
        copy = self._copies.get(id(array))
        return copy if copy is not None and copy.newer == "gpu" else None


class Rows:
    """Room in GPU memory for a table that is given anew for each call, with a row for each step; it grows."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._room: Any = None
        self._last: Any = None

    def for_table(self, table: Array) -> Any:
        """Return an array there of the shape of a table, its values arbitrary: the last one, where that will do."""
        room = self._room
        if room is None or room.shape[0] < table.shape[0] or room.shape[1:] != table.shape[1:]:
            self._room = self._last = room = None  # which a launch may hold until the next
            self._room = room = self._memory.empty(table.shape, table.dtype)
        if self._last is None or self._last.shape != table.shape:
            self._last = room[: table.shape[0]]
        return self._last
