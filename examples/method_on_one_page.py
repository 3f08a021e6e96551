"""The whole method on one page: bonded particles in NumPy alone. A cantilever of spheres, against the closed form."""

import numpy as np

# particles in a line, bonded to the next; bond stiffness of a round beam (parallel bond)
n, d, rho, rb, E, G = 11, 0.01, 2500.0, 0.004, 1e9, 0.45e9
x = np.zeros((n, 3))
x[:, 0] = d * np.arange(n)
q = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
v, w = np.zeros((n, 3)), np.zeros((n, 3))
m = rho * np.pi / 6 * d**3
inertia = 0.1 * m * d**2
i, j = np.arange(n - 1), np.arange(1, n)
r0 = x[j] - x[i]
A, I = np.pi * rb**2, np.pi * rb**4 / 4
kn, ks, kb, kt = E * A / d, G * A / d, E * I / d, G * 2 * I / d


def dot(a, b):
    return (a * b).sum(1, keepdims=True)


def bond_loads(x, q):
    """Poses -> deformation -> force on i, torque on i, torque on j: the gradient of a potential."""
    r = x[j] - x[i]
    length = np.sqrt(dot(r, r))
    normal = r / length
    a, b = q[i], q[j]
    b = np.where(dot(a, b) < 0, -b, b)
    c = dot(a, b)  # relative rotation (c, s), mean rotation a + b
    s = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    t, mean = s / (1 + c), a + b
    first = np.cross(mean[:, 1:], r0)
    e = r0 + (mean[:, :1] * first + np.cross(mean[:, 1:], first)) / (1 + c)  # the bond's direction in the material
    theta = 2 * s * (1 + dot(s, s) / 6 + 3 * dot(s, s) ** 2 / 40)
    twist = dot(theta, normal)
    couple = kb * theta + (kt - kb) * twist * normal  # to first order in the rotation over one bond
    shear = -ks * dot(e, normal) * e + (kt - kb) * twist * theta
    wring = -ks * dot(e, normal) * np.cross(e, normal)
    force = kn * (length - d) * normal + (shear - dot(shear, normal) * normal) / length
    couple = couple + np.cross(t, wring) / 2
    lever = np.cross(r, force) / 2
    return force, lever + couple, lever - couple


def turned(q, w, dt):
    """q <- exp(dt w / 2) q."""
    angle = np.sqrt(dot(w, w)) * dt / 2
    p = np.hstack([np.cos(angle), np.sinc(angle / np.pi) * w * dt / 2])
    scalar = p[:, :1] * q[:, :1] - dot(p[:, 1:], q[:, 1:])
    return np.hstack([scalar, p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])])


load, dt, drag = 1e-3, 4e-6, 800.0  # a small tip load [N], a stable step [s], global damping [1/s]
force, torque = np.zeros((n, 3)), np.zeros((n, 3))
for step in range(12_000):
    v += dt / 2 * force / m
    w += dt / 2 * torque / inertia
    v[0] = w[0] = 0  # clamped
    x += dt * v
    q = turned(q, w, dt)
    f, ti, tj = bond_loads(x, q)
    force, torque = -drag * m * v, -drag * inertia * w
    np.add.at(force, i, f), np.add.at(force, j, -f)
    np.add.at(torque, i, ti), np.add.at(torque, j, tj)
    force[-1, 1] += load * min(1.0, step / 2_000)
    v += dt / 2 * force / m
    w += dt / 2 * torque / inertia

N = n - 1
exact = load * (N / ks + d**2 * N * (4 * N**2 - 1) / (12 * kb))
print(f"tip deflection {x[-1, 1]:.6e} m, closed form {exact:.6e} m, error {x[-1, 1] / exact - 1:+.1e}")
