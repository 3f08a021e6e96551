"""Which block of threads owns which particles, and what each of its threads reads: the layout of half-bonds.

A half-bond is one end of a bond: entry c of the list `ends` of each particle's own bonds. Its thread evaluates the
whole bond and keeps what acts on its own end, so that a block of threads needs nothing from other blocks in a step.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.uint32]


class Owners(NamedTuple):
    """Particles and half-bonds of each block of threads: block b owns particles owners[b] to owners[b + 1].

    owners (blocks + 1,); half_start (blocks + 1,): their first half-bond; chunks (blocks,): how many turns its threads
    take to evaluate them, more than one only for a particle with more half-bonds than a block has threads.
    """

    owners: Indices
    half_start: Indices
    chunks: Indices


class HalfBonds(NamedTuple):
    """What is known of each half-bond, in the order of `ends` (halves,).

    i, j: ends of the bond, in the bond's own order; bond: 2 * number of the bond in its set + side; set: number of its
    set; place: number among the half-bonds of its set.
    """

    i: Indices
    j: Indices
    bond: Indices
    set: Indices
    place: Indices


def share_out(first: Indices, threads: int) -> Owners:
    """Return the blocks of threads: greedy, each as many particles as its threads can serve, one at least.

    first (n + 1,): the first entry of each particle in the list of half-bonds, and their number.
    """
    until = first.astype(np.int64)
    n = len(until) - 1
    full = np.searchsorted(until, until[:-1] + threads, side="right") - 1
    following = np.clip(full, np.arange(1, n + 1), np.arange(n) + threads).clip(max=n)
    owners = [0]
    while owners[-1] < n:
        owners.append(int(following[owners[-1]]))
    start = until[owners]
    chunks = np.maximum(1, -(-np.diff(start) // threads))
    return Owners(*(np.asarray(a).astype(np.uint32) for a in (owners, start, chunks)))


def half_bonds(ends: Indices, sets: Sequence[tuple[Any, Any]]) -> HalfBonds:
    """Return what is known of each half-bond.

    ends (halves,): 2 * bond + side, bonds numbered through all sets; sets: ends i and j (bonds,) of each set.
    """
    bond = ends >> np.uint32(1)
    if len(sets) == 1:
        (i, j), none = sets[0], np.broadcast_to(np.uint32(0), ends.shape)
        return HalfBonds(i[bond], j[bond], ends, none, np.arange(len(ends), dtype=np.uint32))
    found = HalfBonds(*(np.zeros(len(ends), np.uint32) for _ in HalfBonds._fields))
    first = 0
    for s, (i, j) in enumerate(sets):
        members = np.flatnonzero((bond >= first) & (bond < first + len(i)))
        own = bond[members] - np.uint32(first)
        found.i[members], found.j[members], found.set[members] = i[own], j[own], s
        found.bond[members] = ends[members] - np.uint32(2 * first)
        found.place[members] = np.arange(len(members))
        first += len(i)
    return found
