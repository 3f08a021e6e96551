"""One particle through one step of velocity Verlet, kick - drift - kick (Swope et al., J. Chem. Phys. 76, 1982).

`start` (half kick, drift, turn) comes first, then the bonds are evaluated, then `finish` (half kick). Held components
follow their schedule. Every force is booked with half the step times the half-step velocity on either side of it: the
trapezoid rule over the exact displacements, for which the energy balance of the discrete motion closes to round-off
in quadratic potentials.
"""

from pybondem.ops import Number, Quaternion, Vector, absolute, add, dot, quaternion_product, times, where

# Taylor coefficients of cos(a) and sin(a)/a in a^2: exact to round-off up to a turn of 1 rad in a step.
C1, C2, C3, C4, C5, C6, C7 = -1 / 2, 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800, 1 / 479001600, -1 / 87178291200
S1, S2, S3, S4, S5, S6 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800, 1 / 6227020800


def turned(q: Quaternion, w: Vector, dt: Number) -> Quaternion:
    """Return exp(dt w / 2) q, kept at unit length by one Newton step; spin w [rad/s] in global axes, dt [s]."""
    half = times(0.5 * dt, w)
    z = dot(half, half)
    cosine = 1.0 + z * (C1 + z * (C2 + z * (C3 + z * (C4 + z * (C5 + z * (C6 + z * C7))))))
    sine = 1.0 + z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * (S5 + z * S6)))))
    u = times(sine, half)
    p = quaternion_product((cosine, u[0], u[1], u[2]), q)
    scale = 1.5 - 0.5 * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3])
    return scale * p[0], scale * p[1], scale * p[2], scale * p[3]


def choose(hold: Vector, held: Vector, free: Vector) -> Vector:
    """Return each component of `held` where hold is 1, of `free` where it is 0."""
    return (
        where(hold[0] > 0.0, held[0], free[0]),
        where(hold[1] > 0.0, held[1], free[1]),
        where(hold[2] > 0.0, held[2], free[2]),
    )


def kicked(velocity: Vector, force: Vector, mass: Number, dt: Number) -> Vector:
    """Return velocity + dt force / mass."""
    return add(velocity, times(dt / mass, force))


def drifted(x: Vector, v: Vector, dt: Number) -> Vector:
    """Return x + dt v."""
    return add(x, times(dt, v))


def boundary_power(hold: Vector, push: Vector, force: Vector, velocity: Vector) -> Number:
    """Return the power [W] of the boundary: a drive works against the force it meets, a push with its own."""
    return dot(choose(hold, times(-1.0, force), push), velocity)


def sign(a: Number) -> Number:
    """Return -1, 0 or 1."""
    return where(a > 0.0, 1.0, where(a < 0.0, -1.0, 0.0))


def opposing(alpha: Number, force: Vector, velocity: Vector) -> Vector:
    """Return -alpha |F_k| sign(v_k) [N]: local damping (Cundall 1987); alpha [-]."""
    return (
        -alpha * absolute(force[0]) * sign(velocity[0]),
        -alpha * absolute(force[1]) * sign(velocity[1]),
        -alpha * absolute(force[2]) * sign(velocity[2]),
    )


def local_drag(alpha: Number, force: Vector, velocity: Vector, mass: Number, dt: Number) -> Vector:
    """Return the local damping force [N] for the half-step velocity before [m/s] and the force at the step [N]."""
    return opposing(alpha, force, kicked(velocity, force, mass, 0.5 * dt))


def global_drag(rate: Number, force: Vector, velocity: Vector, mass: Number, dt: Number) -> Vector:
    """Return -rate m v [N] with v at the full step, implicitly (stable for every rate [1/s])."""
    at_step = times(1.0 / (1.0 + 0.5 * dt * rate), kicked(velocity, force, mass, 0.5 * dt))
    return times(-rate * mass, at_step)
