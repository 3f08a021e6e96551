"""A discrete pull-out: chains of springs for fibre and matrix, joined by bonds, on its equilibrium path."""

from dataclasses import dataclass

import numpy as np
from numpy import sqrt
from scipy.linalg import solve_banded

from pybondem.theory import PullOut


@dataclass
class TwoChains:
    """Chains of springs for fibre and matrix, followed by arc-length with Newton; unknowns u_f0, u_m0, u_f1, ..."""

    test: PullOut
    n: int = 400

    def __post_init__(self):
        self.h = self.test.length / self.n
        self.area = np.full(self.n + 1, self.test.p * self.h)
        self.area[[0, -1]] /= 2
        self.held = 1 if self.test.support == "pull-pull" else 2 * self.n + 1
        self.end = np.zeros(2 * self.n + 2)
        self.end[-2] = 1.0

    def bond(self, slip, kappa):
        """Stress and its rate with slip: damage that knows the largest slip so far, beside friction that slides."""
        s0, sf, friction = self.test.slip_peak, self.test.slip_end, self.test.residual_stress
        k = self.test.stiffness - friction / s0
        largest = np.maximum(slip, kappa)
        intact = np.clip(s0 * (sf / np.maximum(largest, s0) - 1.0) / (sf - s0), 0.0, 1.0)
        softening = (slip >= kappa) & (slip > s0) & (slip < sf)
        held = slip - np.maximum(kappa - s0, 0.0)  # against the plastic slip so far
        rubs = np.clip(friction / s0 * held, -friction, friction)
        rate = np.where(softening, -k * s0 / (sf - s0), k * intact) + np.where(abs(held) < s0, friction / s0, 0.0)
        return k * intact * slip + rubs, rate

    def residual(self, v, P, kappa):
        """Unbalanced forces, and the tangent stiffness as five diagonals."""
        tau, rate = self.bond(v[::2] - v[1::2], kappa)
        stiffness = np.array([self.test.a_fibre, self.test.a_matrix]) / self.h
        stretch = np.diff(v.reshape(-1, 2), axis=0) * stiffness
        force = np.zeros((self.n + 1, 2))
        force[:-1] -= stretch
        force[1:] += stretch
        force += (self.area * tau)[:, None] * (1.0, -1.0)
        bands = np.zeros((5, v.size))
        neighbours = np.full(self.n + 1, 2.0)
        neighbours[[0, -1]] = 1.0
        bands[2] = (neighbours[:, None] * stiffness + (self.area * rate)[:, None]).ravel()
        bands[0, 2:] = bands[4, :-2] = np.tile(-stiffness, self.n)
        bands[1, 1::2] = bands[3, ::2] = -self.area * rate
        return self.hold(force.ravel() - P * self.end, bands)

    def hold(self, force, bands):
        """Fix one matrix node."""
        at = self.held
        for row in (-2, -1, 1, 2):
            if 0 <= at + row < force.size:
                bands[2 + row, at] = bands[2 - row, at + row] = 0.0
        bands[2, at], force[at] = bands[2, at] if bands[2, at] > 0 else 1.0, 0.0
        return force, bands

    def increment(self, v, P, kappa, toward, step):
        """Newton on the plane at a distance `step` along `toward`, or None where it does not converge."""
        unit = np.append(np.full(v.size, self.test.slip_end * sqrt(v.size)), self.test.long_bond_load())
        both = step * toward * unit
        for _ in range(25):
            force, bands = self.residual(v + both[:-1], P + both[-1], kappa)
            free, loaded = solve_banded((2, 2), bands, np.column_stack([-force, self.end])).T
            free, loaded = np.append(free, 0.0), np.append(loaded, 1.0)
            more = free + (step - toward @ ((both + free) / unit)) / (toward @ (loaded / unit)) * loaded
            both = both + more
            if np.abs(more[:-1]).max() < 1e-11 * self.test.slip_end:
                return both, both / unit / np.linalg.norm(both / unit)
        return None

    def states(self, step):
        """Yield (P, slips, v, kappa) along the equilibrium path until the load has fallen to 2 % of its peak.

        With friction, whose stiffness is singular once every bond slides, until all have softened by 80 %.
        """
        v, P, kappa, highest = np.zeros(self.end.size), 0.0, np.zeros(self.n + 1), 0.0
        toward = np.append(v, 1.0)
        while True:
            found = (self.increment(v, P, kappa, toward, step / 2**halved) for halved in range(10))
            both, toward = next(filter(None, found))
            v, P = v + both[:-1], P + both[-1]
            slip = v[::2] - v[1::2]
            kappa, highest = np.maximum(kappa, slip), max(highest, P)
            yield P, slip, v, kappa
            softened = (slip.min() - self.test.slip_peak) / (self.test.slip_end - self.test.slip_peak)
            if P / highest < 0.02 or (self.test.residual_stress and softened > 0.8):
                return
