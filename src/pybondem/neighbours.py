"""Who is next to whom, and in which order particles and bonds are kept."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pybondem.errors import InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_BONDS = 2**31  # exclusive: 2 * bond + side is a whole number of 32 bits


def pairs_within(x: Floats, radius: Floats, gap: float) -> Ints:
    """Return the pairs (m, 2), i < j, sorted, whose surfaces are at most `gap` times (Ri + Rj) apart.

    x: centres (n, 3) [m]; radius (n,) [m]; gap [-]. Spheres are searched by classes of size, each twice the one before,
    so that a few large ones do not make every small one look far.
    """
    if len(x) < 2:
        return np.empty((0, 2), np.int64)
    size = np.floor(np.log2(radius / radius.min())).astype(np.int64)
    classes = [np.flatnonzero(size == s) for s in np.unique(size)]
    found = [
        _pairs_of_classes(x, radius, gap, small, large) for k, large in enumerate(classes) for small in classes[: k + 1]
    ]
    pairs = np.sort(np.concatenate(found), axis=1)
    reach = (1.0 + gap) * (radius[pairs[:, 0]] + radius[pairs[:, 1]])
    pairs = pairs[np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1) <= reach]
    return pairs[np.argsort(pairs[:, 0] * len(x) + pairs[:, 1], kind="stable")]


def _pairs_of_classes(x: Floats, radius: Floats, gap: float, small: Ints, large: Ints) -> Ints:
    """Return all pairs between two classes of spheres (or within one) that may be near enough."""
    reach = (1.0 + gap) * (radius[small].max() + radius[large].max()) * (1.0 + 1e-12)
    tree = cKDTree(x[small])
    if small is large:
        return small[tree.query_pairs(reach, output_type="ndarray").astype(np.int64, copy=False)]
    near = tree.query_ball_point(x[large], reach)
    counts = np.fromiter((len(n) for n in near), np.int64, len(large))
    others = np.concatenate([np.asarray(n, np.int64) for n in near]) if counts.sum() else np.empty(0, np.int64)
    return np.stack([np.repeat(large, counts), small[others]], axis=1)


def same_place(x: Floats, radius: float) -> tuple[int, int] | None:
    """Return the first two particles whose centres are within 1e-9 radius [m] of one another, lower index first."""
    if len(x) < 2:
        return None
    pairs = cKDTree(x).query_pairs(1e-9 * radius, output_type="ndarray")
    return None if len(pairs) == 0 else (int(pairs[0].min()), int(pairs[0].max()))


def memory_order(x: Floats, radius: Floats) -> NDArray[np.int32]:
    """Return the order in which particles are kept: slab by slab along the longest side, row by row in a slab.

    The neighbours of consecutive particles then lie in a few streams of consecutive particles, which gathers follow
    better than a Morton or Hilbert curve (measured: 20 against 25 ns per bond-step at 100 000 particles).
    """
    if len(x) == 0:
        return np.empty(0, np.int32)
    sides = np.ptp(x, axis=0)
    first, second, third = np.argsort(-sides, kind="stable")
    cell = 0.8 * float(np.mean(2.0 * radius))
    slab, row = (np.floor((x[:, a] - x[:, a].min()) / cell + 0.5).astype(np.int64) for a in (first, second))
    return np.lexsort((x[:, third], row, slab)).astype(np.int32)


def own_bonds(i: NDArray[np.uint32], j: NDArray[np.uint32], n: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return each particle's own bonds as (first, ends): ends[first[p] : first[p + 1]] are 2 * bond + side.

    side is 0 where p is the bond's first end, 1 where it is the second; ascending, the order in which they are summed.
    Raises InputError for 2^31 bonds or more.
    """
    listed(len(i))
    bond = np.arange(len(i), dtype=np.uint32)
    owner = np.concatenate([i, j])
    ends = np.concatenate([2 * bond, 2 * bond + np.uint32(1)])
    order = np.lexsort((ends, owner))
    first = np.zeros(n + 1, np.uint32)
    np.cumsum(np.bincount(owner, minlength=n), out=first[1:])
    return first, ends[order]


def listed(bonds: int) -> None:
    """Raise InputError where so many bonds have more ends than a list of whole numbers of 32 bits can name."""
    if bonds >= MOST_BONDS:
        raise InputError(
            f"the model has {bonds:,} bonds; it must have fewer than {MOST_BONDS:,}, since lists of their ends are in "
            "whole numbers of 32 bits. Take fewer particles, or a smaller gap."
        )


def pieces(n: int, i: Ints, j: Ints) -> tuple[int, Ints]:
    """Return the number of connected pieces of n particles under the bonds (i, j), and the piece of each particle."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count, label = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    return int(count), label
