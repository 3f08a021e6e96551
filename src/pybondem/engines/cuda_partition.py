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
    following = np.clip(full, np.arange(1, n + 1), np.arange(n) + threads).clip(max=n).tolist()
    owners = [0]
    while owners[-1] < n:
        owners.append(following[owners[-1]])
    start = until[owners]
    chunks = np.maximum(1, -(-np.diff(start) // threads))
    return Owners(*(np.asarray(a).astype(np.uint32) for a in (owners, start, chunks)))


def half_bonds(ends: Indices, sets: Sequence[tuple[Any, Any]]) -> HalfBonds:
    """Return what is known of each half-bond.

    ends (halves,): 2 * bond + side, bonds numbered through all sets; sets: ends i and j (bonds,) of each set.
    """
    nothing = np.empty(0, np.uint32)
    i, j = (np.concatenate([nothing, *(pair[side] for pair in sets)]) for side in (0, 1))
    counts = [len(pair[0]) for pair in sets]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    bond = ends >> np.uint32(1)
    own_set = np.searchsorted(first, bond, side="right") - 1
    place = np.zeros(len(ends), np.int64)
    for s in range(len(sets)):
        members = own_set == s
        place[members] = np.arange(members.sum())
    code = ends.astype(np.int64) - 2 * first[own_set]
    return HalfBonds(i[bond], j[bond], code.astype(np.uint32), own_set.astype(np.uint32), place.astype(np.uint32))
