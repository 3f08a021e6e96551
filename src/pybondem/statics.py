"""Linear statics of a model: the answer that an infinitely slow run would give before anything breaks."""

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator, cg

from pybondem.assembly import Assembly, assemble
from pybondem.boundaries import Boundaries
from pybondem.check import choice, finite_array
from pybondem.engines.choose import make_engine
from pybondem.errors import InputError
from pybondem.model import Model, Selection
from pybondem.neighbours import pieces
from pybondem.stability import Stiffness

Floats = NDArray[np.float64]


class Equilibrium(NamedTuple):
    """Displacements (n, 3) [m], rotations (n, 3) [rad], and the forces that hold them there (n, 3) [N]; model order."""

    displacement: Floats
    rotation: Floats
    force: Floats


def solve(
    model: Model, prescribed: ArrayLike | None = None, load: ArrayLike | None = None, *,
    engine: str = "cpu", threads: int | None = None, tolerance: float = 1e-10,
) -> Equilibrium:  # fmt: skip
    """Return the linear equilibrium of a model whose fixed and driven components are held.

    prescribed (n, 6): displacements [m] and rotations [rad] of the held components; load (n, 6): forces [N] and torques
    [N m] on the free ones; zeros by default, model order. By conjugate gradients on the mass-scaled stiffness,
    matrix-free. Raises InputError where a connected piece has no held component (it could float away), for arrays of
    another shape, or where the iteration does not converge.
    """
    done = assemble(model)
    stiffness = Stiffness(done, make_engine(engine, threads))
    check_supported(done, stiffness)
    n = len(model)
    known = _rows("prescribed", prescribed, done) * (1.0 - stiffness.free)
    scale = stiffness.scale

    def operator(flat: Floats) -> Floats:
        u = flat.reshape(6, n)
        return (scale * stiffness.times(scale * stiffness.free * u)).ravel()

    unbalanced = stiffness.free * _rows("load", load, done) - stiffness.times(known)
    shape = LinearOperator((6 * n, 6 * n), matvec=operator, dtype=np.float64)
    solution, info = cg(shape, (scale * unbalanced).ravel(), rtol=tolerance, maxiter=20 * n + 1000)
    if info != 0:
        raise InputError(f"the static solve did not converge in {info} iterations; is the model held well enough?")
    u = known + stiffness.free * scale * solution.reshape(6, n)
    force = stiffness.all_forces(u)
    at = done.position
    return Equilibrium(u[:3].T[at], u[3:].T[at], force[:3].T[at])


def _rows(name: str, values: ArrayLike | None, done: Assembly) -> Floats:
    """Return values (n, 6) in model order as (6, n) in memory order."""
    n = len(done.order)
    return np.zeros((6, n)) if values is None else finite_array(name, values, (n, 6))[done.order].T


def check_supported(done: Assembly, stiffness: Stiffness) -> None:
    """Raise InputError where a connected piece of the model has no held displacement component."""
    ends = [np.concatenate([b[end] for b in done.bonds.values()] or [np.empty(0, np.uint32)]) for end in "ij"]
    count, label = pieces(len(done.order), *(e.astype(np.int64) for e in ends))
    held = np.bincount(label, (1.0 - stiffness.free[:3]).sum(axis=0), minlength=count)
    if np.any(held == 0.0):
        loose = int(np.argmin(held))
        example = int(done.order[np.flatnonzero(label == loose)[0]])
        raise InputError(
            f"{int((held == 0.0).sum())} of {count} connected pieces have nothing held, among them that of particle "
            f"{example}; fix or drive some of it, or bond it to the rest."
        )


def axial_stiffness(
    model: Model, low: Selection, high: Selection, axis: str, *, engine: str = "cpu", threads: int | None = None
) -> float:
    """Return EA [N] of a bar: its ends moved apart along x, y or z, free to move sideways and to turn.

    low, high: the particles of the two ends; the length is the distance between their means. One static solve; the
    model's own boundary conditions are left out. Raises InputError as `solve` does.
    """
    c = "xyz".index(choice("axis", axis, "xyz"))
    bar = copy.copy(model)
    bar.boundaries = Boundaries()
    bar.fix(low, axis)
    bar.fix(high, axis)
    apart = float(model.x[model.own(high), c].mean() - model.x[model.own(low), c].mean())
    prescribed = np.zeros((len(model), 6))
    prescribed[high.indices, c] = apart  # unit strain: the force is EA
    return float(solve(bar, prescribed, engine=engine, threads=threads).force[high.indices, c].sum())
