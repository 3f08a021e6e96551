"""The critical time step from the model's own stiffness."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

from pybondem.assembly import Assembly, linear_program
from pybondem.engines.base import Engine
from pybondem.program import Program

Floats = NDArray[np.float64]
FEW = 200  # components for which the matrix is small enough to solve outright
LEAST, MOST = 30, 200  # iterations
TOLERANCE = 2e-3  # of the residual bound, relative
MARGIN = 1.01  # on omega^2: half a percent of the step


@dataclass(frozen=True)
class Limit:
    """The stability limit of a model: critical step [s], highest circular frequency [rad/s], stiffest particle."""

    dt: float
    omega: float
    particle: int


class Stiffness:
    """The model's stiffness as an operator, matrix-free, on the engine: u -> K u, both (6, n).

    program: a linear program, by default that of the undamaged model; free (6, n): 0 for held components, 1 for the
    others; scale (6, n): 1 / sqrt(mass) and 1 / sqrt(inertia).
    """

    def __init__(self, done: Assembly, engine: Engine, program: Program | None = None) -> None:
        self._program = program or linear_program(done)
        self._runner = engine.prepare(self._program)
        held = np.concatenate([done.tables.hold, done.tables.turn_hold])[:, done.particles["group"]]
        self.free = 1.0 - held
        each = [np.broadcast_to(done.particles[name], (3, len(done.order))) for name in ("mass", "inertia")]
        self.scale = 1.0 / np.sqrt(np.concatenate(each))

    def times(self, u: Floats) -> Floats:
        """Return K u on free components for displacements and rotations u (6, n)."""
        return self.free * self.all_forces(u)

    def largest(self) -> float:
        """Return the largest eigenvalue of M^-1/2 K M^-1/2 on free components."""
        return largest_eigenvalue(lambda u: self.scale * self.times(self.scale * u), self.free)

    def all_forces(self, u: Floats) -> Floats:
        """Return the forces and torques (6, n) that hold the displacements and rotations u (6, n)."""
        particles = self._program.particles
        particles["v"][:], particles["w"][:] = u[:3], u[3:]
        self._runner.advance(1, 0.0, {})
        return -np.concatenate([particles["force"], particles["torque"]])


def stability_limit(done: Assembly, engine: Engine) -> Limit:
    """Return the limit of velocity Verlet, 2 / omega_max, and what dashpots leave of it.

    omega_max^2 is the largest eigenvalue of the mass-scaled stiffness M^-1/2 K M^-1/2. Dashpots act on the velocity
    foreseen for the end of the step, and the motion is stable while dt^2 K / 4 + dt C < M: for certain below
    2 (sqrt(c^2 + omega_max^2) - c) / omega_max^2 with c the largest eigenvalue of M^-1/2 C M^-1/2.
    """
    stiffness = Stiffness(done, engine)
    squared = stiffness.largest() if done.blocks else 0.0
    if squared <= 0.0:
        return Limit(np.inf, 0.0, 0)
    damped = any(bonds.bond.damping > 0.0 for bonds in done.model.bonds)
    c = Stiffness(done, engine, linear_program(done, dashpots=True)).largest() if damped else 0.0
    dt = 2.0 * (np.sqrt(c * c + squared) - c) / squared
    return Limit(float(dt), float(np.sqrt(squared)), stiffest_particle(done, stiffness.scale * stiffness.free))


def stiffest_particle(done: Assembly, scale: Floats) -> int:
    """Return the model index of the particle whose own bonds are stiffest for its mass or its inertia.

    By the traces of the two 3 x 3 blocks, of displacements and of rotations, that the bonds of a particle put on the
    diagonal of the mass-scaled stiffness; the fastest mode mostly sits there. scale (6, n): 1 / sqrt(mass),
    1 / sqrt(inertia), 0 for held components.
    """
    n = len(done.order)
    displacement, rotation = np.zeros(n), np.zeros(n)
    for arrays in done.bonds.values():
        kn, ks, kt, kb = (arrays[k] for k in ("kn", "ks", "kt", "kb"))
        lever = 0.5 * ks * (done.chord(arrays) ** 2).sum(axis=0)  # shear over half the length, in two planes
        for end in (arrays["i"], arrays["j"]):
            displacement += np.bincount(end, np.broadcast_to(kn + 2.0 * ks, len(end)), minlength=n)
            rotation += np.bincount(end, kt + 2.0 * kb + lever, minlength=n)
    squares = scale**2
    speed = np.maximum(displacement * squares[:3].max(axis=0), rotation * squares[3:].max(axis=0))
    return int(done.order[np.argmax(speed)])


def largest_eigenvalue(operator: Callable[[Floats], Floats], free: Floats) -> float:
    """Return the largest eigenvalue of a symmetric operator: exact for few components, else from slightly above.

    operator(u) -> K u on arrays of the shape of `free`, which is 1 for components that take part. Lanczos iteration
    without reorthogonalisation (its largest Ritz value is not harmed by the copies that this makes), taken at the
    upper end of its residual bound. That bound holds for the eigenvalue which the iteration has found; a mode that it
    has hardly seen may lie a little above, hence the least number of iterations and the margin.
    """
    components = np.flatnonzero(free)
    if len(components) <= FEW:
        return float(np.linalg.eigvalsh(_matrix(operator, free.shape, components)).max(initial=0.0))
    u = np.random.default_rng(0).standard_normal(free.shape) * free
    u /= np.linalg.norm(u)
    before, beta = np.zeros_like(u), 0.0
    diagonal: list[float] = []
    off: list[float] = []
    value = 0.0
    for k in range(MOST):
        r = operator(u)
        r -= beta * before
        diagonal.append(float(np.vdot(u, r)))
        r -= diagonal[-1] * u
        beta = float(np.linalg.norm(r))
        exhausted = beta <= 1e-10 * abs(diagonal[0])
        if (k >= LEAST and k % 5 == 0) or exhausted or k + 1 == MOST:
            values, vectors = eigh_tridiagonal(np.array(diagonal), np.array(off))
            bound = beta * abs(vectors[-1, -1])
            value = float(values[-1] + bound)
            if bound <= TOLERANCE * value or exhausted:
                break
        before, u = u, r / beta
        off.append(beta)
    return MARGIN * value


def _matrix(operator: Callable[[Floats], Floats], shape: tuple[int, ...], components: NDArray[np.int64]) -> Floats:
    """Return the matrix of an operator on a few components of arrays of the given shape."""
    columns = []
    for component in components:
        u = np.zeros(shape)
        u.flat[component] = 1.0
        columns.append(operator(u).ravel()[components])
    return np.array(columns).reshape(len(components), len(components))
