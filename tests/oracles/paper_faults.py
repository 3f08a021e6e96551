"""What the faults of the paper's public code do: each mechanism re-created small, with the one fault switched on.

The code is S. Dressler's BondDEM (github.com/SDressler-2020/BondDEM, commits of 2021), which goes with S. Dressler and
D. N. Wilke, PyBONDEM-GPU, Powders & Grains 2021. Nothing is copied: these are models of a few spheres, in NumPy, with
its values. Faults are numbered as in docs/paper-faults.md, and

    python tests/oracles/paper_faults.py

prints the column "Measured" of that table. SI units throughout; d is the diameter of the spheres.
"""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import asin, ceil, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from pybondem.theory import PullOut

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# The values of the public code.
E_FIBRE, E_MATRIX, NU, DENSITY = 5e10, 5e9, 0.2, 6000.0
SPEED, STEP = 10.0, 1e-5  # of the pulled end [m/s], of time [s]
SLIP_STIFFNESS, SLIP_PEAK, SLIP_END = 1e9, 1e-4, 3e-3  # of the interface [Pa/m, m, m]
FIBRE_RADIUS, MATRIX_RADIUS, LENGTH, TIP = 1.0, 6.0, 30.0, 5.0  # embedded from x = TIP on
HAND_FACTORS = {0.5: (1.42, 0.01), 0.7: (1.8, 0.001), 1.0: (1.6, 0.03)}  # of normal and shear stiffness, by d
AREA_FACTORS = {0.5: 0.2742, 0.7: 0.342276, 1.0: 0.2454, 2.0: 0.113208}  # of the interface bonds
REACH = 1.05  # bonds are made up to this distance over d
PACKED = pi / sqrt(18.0)  # part of the volume that close-packed spheres fill


def sphere(d: float) -> tuple[float, float]:
    """Return mass [kg] and moment of inertia [kg m2] of a sphere of the public code."""
    mass = pi / 6.0 * d**3 * DENSITY
    return mass, 0.1 * mass * d**2


def contact_modulus(E: float) -> float:
    """Return the Hertz modulus of two equal bodies [Pa]."""
    return E / (2.0 * (1.0 - NU**2))


# Motion ---------------------------------------------------------------------------------------------------------


def lagged_step(state: Floats, angle: float) -> Floats:
    """Return (x, v, a) of an oscillator of frequency 1 a step later, the position moved before the velocity's kick."""
    x, v, before = state
    a = -x
    return np.array([x + angle * v + 0.5 * angle**2 * a, v + 0.5 * angle * (a + before), a])


def verlet_step(state: Floats, angle: float) -> Floats:
    """Return (x, v, a) of the same oscillator by velocity Verlet."""
    x, v, a = state
    moved = x + angle * v + 0.5 * angle**2 * a
    return np.array([moved, v - 0.5 * angle * (moved - a), -moved])


def growth_per_period(step: Callable[[Floats, float], Floats], angle: float) -> float:
    """Return by how much the amplitude of an undamped oscillator grows in a period [-]; angle: w dt [rad].

    Fault 1 (lagged_step): the velocity that moves the position lacks the kick that belongs to it.
    """
    matrix = np.stack([step(unit, angle) for unit in np.eye(3)], axis=1)
    root = max(np.linalg.eigvals(matrix), key=abs)
    return float(abs(root) ** (2.0 * pi / abs(np.angle(root)))) - 1.0


class SpinDamping(NamedTuple):
    """A free pair after a while, over its start; steps: how long a while is in the public code."""

    relative_spin: float
    momentum: float
    energy: float
    steps: float


def spin_damping(sign: float, d: float = 0.5) -> SpinDamping:
    """Return what spin damping makes of a free pair with spins 0 and w within 2 I/c.

    Fault 2 (sign = 1): both ends get the torque -c (w2 - w1); as it should be, the first gets its opposite (sign = -1).
    c has the square of the radius where a moment of inertia asks for its first power.
    """
    mass, inertia = sphere(d)
    bending = HAND_FACTORS[d][0] * contact_modulus(E_MATRIX) / d * pi * (0.5 * d) ** 4 / 4.0
    c = 0.2 * (0.5 * d) ** 2 * sqrt(bending * 2.0 * mass / 5.0)
    w, n = np.array([0.0, 1.0]), 20_000
    for _ in range(n):
        w = w - 2.0 / n * (w[1] - w[0]) * np.array([sign, 1.0])  # in units of I/c
    return SpinDamping(float(w[1] - w[0]), float(w.sum()), float(w @ w), 2.0 * inertia / c / STEP)


class Swing(NamedTuple):
    """Lowest and highest spin over M/(I w)."""

    low: float
    high: float


def swing(above: float, below: float) -> Swing:
    """Return how a free sphere swings under the torque M cos(wt), in the end.

    Local damping takes the part `above` of the torque while the sphere spins forwards, `below` while backwards. Fault 3
    (0.7, 0.07): the two differ.
    """
    spin, n, seen = 0.0, 20_000, []
    for k in range(12 * n):
        kick = 2.0 * pi / n * cos(2.0 * pi * k / n)
        forwards = spin + 0.5 * kick > 0.0
        spin += kick - abs(kick) * (above if forwards else -below)
        seen.append(spin)
    return Swing(min(seen[-n:]), max(seen[-n:]))


# Interface ------------------------------------------------------------------------------------------------------


def interface_load(x: Floats, start: float, k: float, radius: float) -> tuple[Floats, Floats]:
    """Return force on the first and torque on either sphere of an interface bond: slip is that of centres along x.

    x (2, 3) [m]; start: the first's x less the second's when the bond was made [m]; k [N/m].
    """
    force = np.array([-k * (x[0, 0] - x[1, 0] - start), 0.0, 0.0])
    n = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
    return force, radius * np.cross(n, force)


class GlobalSlip(NamedTuple):
    """slip: over the bond's length, seen after a rigid turn; breaks: the turn that breaks it [degrees]; gain: energy
    out of a closed cycle over the energy that the bond stores in it."""

    slip: float
    breaks: float
    gain: float


def global_slip(turn: float = 45.0, d: float = 0.5) -> GlobalSlip:
    """Return what an interface bond across the pull axis makes of a rigid turn [degrees] and a cycle of slip and spin.

    Fault 4: slip is a difference of x of the centres, whatever the direction of the bond and the spins of its ends. In
    the cycle the second sphere moves by s along x, both spin by -s/r, and both are taken back in that order.
    """
    k, s = 1.0, 1e-6 * d
    turned = d * np.array([[0.0, 0.0, 0.0], [-sin(radians(turn)), cos(radians(turn)), 0.0]])
    seen = abs(interface_load(turned, 0.0, k, 0.5 * d)[0][0]) / (k * d)
    corners, work = [(0.0, 0.0), (s, 0.0), (s, -2.0 * s / d), (0.0, -2.0 * s / d), (0.0, 0.0)], 0.0
    for (u, spin), (next_u, next_spin) in pairwise(corners):
        x = np.array([[0.0, 0.0, 0.0], [0.5 * (u + next_u), d, 0.0]])  # linear in each leg: its middle is exact
        force, torque = interface_load(x, 0.0, k, 0.5 * d)
        work += -force[0] * (next_u - u) + 2.0 * torque[2] * (next_spin - spin)
    return GlobalSlip(float(seen), degrees(asin(SLIP_END / d)), float(work / (0.5 * k * s**2)))


def slip_left(normal: float, shear: float, periods: int = 5) -> float:
    """Return what is left of the amplitude of a pair's free slip after some periods [-]; stiffnesses over each other.

    Fault 5 (normal = 0): the dashpot of slip is 0.3 sqrt(2 kn m) and the interface has kn = 0.
    """
    n = 2000
    dt = 2.0 * pi / sqrt(2.0 * shear) / n  # reduced mass 1/2
    c, u, v = 0.3 * sqrt(2.0 * normal), 1.0, 0.0
    for _ in range(periods * n):
        v += 0.5 * dt * 2.0 * (-shear * u - c * v)
        u += dt * v
        v = (v - dt * shear * u) / (1.0 + dt * c)
    return hypot(u, v / sqrt(2.0 * shear))


class Passage(NamedTuple):
    """nearest: smallest distance of centres over d; speed: relative speed afterwards over that before."""

    nearest: float
    speed: float


def passage(kn: float) -> Passage:
    """Return what becomes of two spheres that are pushed together across an interface whose bond has failed.

    Fault 7 (kn = 0): nothing takes over from the bond, and no normal stiffness was there before. kn [N/m] otherwise
    answers to being pressed together; unit mass, d = 1, the spheres meet at unit speed.
    """
    gap, speed, dt, nearest = 1.0, -1.0, 1e-3, 1.0
    for _ in range(2000):
        speed += dt * kn * max(1.0 - gap, 0.0)  # each gets half the relative acceleration 2 F / m
        gap += dt * speed
        speed += dt * kn * max(1.0 - gap, 0.0)
        nearest = min(nearest, abs(gap))
    return Passage(nearest, -speed)


# Bonds ----------------------------------------------------------------------------------------------------------


class Turned(NamedTuple):
    """angle: of a bending moment against where it should point [degrees]; growth: of the stored shear [-]."""

    angle: float
    growth: float


def rigid_turn(steps: int = 157) -> Turned:
    """Return what a rigid quarter turn makes of a bending moment, and a whole turn (steps of 0.01 rad) of stored shear.

    Fault 6: relative spins are summed in global axes, so that nothing turns the sum; stored shear turns by
    u + (n x n') x u, which is longer than u, and is never put back to length or into its plane.
    """
    bending, bend, turning = np.zeros(3), np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]), [[0.0, 0.0, 0.5 * pi]] * 2
    for spin in [bend] * steps + [np.array(turning)] * steps:
        bending += (spin[1] - spin[0]) / steps
    right = np.array([-1.0, 0.0, 0.0])  # about y, turned by 90 degrees about z
    n, u = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    turn = np.array([[cos(0.01), -sin(0.01), 0.0], [sin(0.01), cos(0.01), 0.0], [0.0, 0.0, 1.0]])
    for _ in range(628):
        u = u + np.cross(np.cross(n, turn @ n), u)
        n = turn @ n
    angle = np.arccos(bending @ right / np.linalg.norm(bending))
    return Turned(degrees(float(angle)), float(np.linalg.norm(u)) - 1.0)


def lever_arm(first: float, length: float) -> float:
    """Return the angular momentum that a sheared bond makes, over the couple of its forces: (l - 2r)/l [-].

    Fault 8: both ends get the torque r n x F with the radius of the first, for forces that act l apart.
    """
    n, force = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    couple = np.cross(length * n, -force)
    return float(np.linalg.norm(couple + 2.0 * first * np.cross(n, force)) / np.linalg.norm(couple))


class Modulus(NamedTuple):
    """bond: modulus used over that of the bodies; bulk: Young's modulus of the packing over the nominal one, by d."""

    bond: float
    bulk: dict[float, float]


def bond_modulus() -> Modulus:
    """Return the stiffness that comes of the contact modulus and the hand-made factors.

    Fault 12: bonds get the modulus of two bodies in contact times a factor by d. Bulk: closed form of the hexagonal
    packing along its axis, 6 sqrt2 kn (kn + ks)/(d (5 kn + ks)).
    """
    bulk = {}
    for d, (normal, shear) in HAND_FACTORS.items():
        kn = normal * contact_modulus(1.0) / d * pi * d**2 / 4.0
        bulk[d] = 6.0 * sqrt(2.0) * kn * (1.0 + shear) / (d * (5.0 + shear))
    return Modulus(contact_modulus(1.0), bulk)


# Loading --------------------------------------------------------------------------------------------------------


class Impact(NamedTuple):
    """stress: of the first wave [Pa]; peak: largest quasi-static stress in the fibre [Pa]; travel: of the end while a
    wave crosses the embedded length, over the slip at failure."""

    stress: float
    peak: float
    travel: float


def impact(speed: float = SPEED) -> Impact:
    """Return what it means to start pulling at full speed [m/s].

    Fault 9: 10 m/s from the first step on. The density is that of the packing, 0.74 of the spheres' own.
    """
    density = PACKED * DENSITY
    c = sqrt(E_FIBRE / density)
    slow = PullOut(E_FIBRE, E_MATRIX, FIBRE_RADIUS, MATRIX_RADIUS, LENGTH, SLIP_STIFFNESS, SLIP_PEAK, SLIP_END)
    return Impact(density * c * speed, slow.peak().load / (pi * FIBRE_RADIUS**2), speed * LENGTH / c / SLIP_END)


def unloading_offset() -> float:
    """Return how far from the start a cycle of loading and unloading ends at most, over the slip at failure.

    Fault 10: the end goes back at three times the speed, in cycles of 11 steps, until 3 times the steps back are no
    fewer than the steps forth.
    """
    short = [33 * ceil(cycles / 3) - 11 * cycles for cycles in range(1, 100)]
    return max(short) * SPEED * STEP / SLIP_END


def steps_to_equality(limit: int = 100_000) -> tuple[int | None, float]:
    """Return after how many additions of 0.02 the damage 0.7 is == 1.2 (None: not within the limit), and the 25th sum.

    Fault 17: the loop is to end when it is.
    """
    damage, sums = 0.7, []
    for k in range(1, limit + 1):
        damage += 0.02
        sums.append(damage)
        if damage == 1.2:
            return k, sums[24]
    return None, sums[24]


# Sample ---------------------------------------------------------------------------------------------------------


class Sample(NamedTuple):
    """Centres (n, 3) [m]; kind (n,): 0 held, 1 matrix, 2 fibre, 3 pulled; free: length of free fibre [m]."""

    x: Floats
    kind: Ints
    free: float


@cache
def sample(d: float) -> Sample:
    """Return the pull-out sample of the public code: hexagonal close packing with its axis along x.

    Fault 13: the fibre ends where the range of the generator's layer number does, which depends on d.
    """
    layers, rows = round((LENGTH + 10.0) / d + 20.0), int(2.0 * MATRIX_RADIUS / d) + 4
    i, j, k = np.meshgrid(np.arange(-rows, rows), np.arange(-rows, rows), np.arange(-layers, layers), indexing="ij")
    x = d * sqrt(2.0 / 3.0) * k
    y, z = 0.5 * d * (2 * i + (j + k) % 2), 0.5 * sqrt(3.0) * d * (j + (k % 2) / 3.0)
    rho, end = np.hypot(y, z), float(x.max())
    fibre = (rho <= FIBRE_RADIUS) & (x >= TIP)
    matrix = (rho <= MATRIX_RADIUS) & (x >= 0.0) & (x <= TIP + LENGTH) & ~fibre
    matrix &= (rho > FIBRE_RADIUS) | (x < TIP - 1.5 * d)
    kind = np.select([matrix & (x == 0.0), matrix, fibre & (x == end)], [0, 1, 3], 2)
    there = fibre | matrix
    return Sample(np.stack([x[there], y[there], z[there]], axis=1), kind[there], end - TIP - LENGTH)


def neighbours(x: Floats, d: float) -> Ints:
    """Return all pairs of centres (m, 2) up to the reach of bonds."""
    return cKDTree(x).query_pairs(REACH * d, output_type="ndarray").astype(np.int64)


def interface_area(d: float) -> float:
    """Return the area that the interface bonds stand for over that of the interface, 2 pi r L.

    Fault 19: pi d^2/4 times a factor made by hand for each d.
    """
    there = sample(d)
    ends = np.sort(there.kind[neighbours(there.x, d)], axis=1)
    count = int(np.sum((ends[:, 0] == 1) & (ends[:, 1] == 2)))
    return count * AREA_FACTORS[d] * pi * d**2 / 4.0 / (2.0 * pi * FIBRE_RADIUS * LENGTH)


class Search(NamedTuple):
    """pairs (m, 2), with those found twice twice; past: reads past the end of the table of cells."""

    pairs: Ints
    past: int


def cell_search(x: Floats, d: float, mixed: bool) -> Search:
    """Return the pairs that a search by cells of 4 d finds; pairs are indices into x.

    Fault 14 (mixed): the number of a cell is z wx wy + x wz + y, where y needs the stride of x; and the widths wx, wy,
    wz lack the last, partly filled cell. Different cells then share a number, and a sphere meets the spheres of one
    twice. As it should be: z wx wy + x wy + y with all cells counted.
    """
    cell = ((x - x.min(axis=0)) / (4.0 * d)).astype(np.int64)
    widths = (np.ptp(x, axis=0) / (4.0 * d)).astype(np.int64)
    wx, wy, wz = widths if mixed else widths + 1
    strides = np.array([wz if mixed else wy, 1, wx * wy])
    number = cell @ strides
    order = np.argsort(number, kind="stable")
    cell, number, placed = cell[order], number[order], x[order]
    size = number.max() + 1 if mixed else wx * wy * wz
    starts = np.searchsorted(number, np.arange(size + 1))
    cells, which = np.unique(cell, axis=0, return_inverse=True)
    by_cell = np.argsort(which.reshape(-1), kind="stable")
    members = np.split(by_cell, np.cumsum(np.bincount(which.reshape(-1)))[:-1])
    shifts = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    found, past = [], 0
    for here, own in zip(cells, members, strict=True):
        around = here + shifts
        for at in (around @ strides)[(around >= 0).all(axis=1) & (around <= widths).all(axis=1)]:
            if at >= size:
                past += len(own)
                continue
            others = np.arange(starts[at], starts[at + 1])
            near = cdist(placed[own], placed[others]) <= REACH * d
            a, b = np.nonzero(near & (own[:, None] > others))
            found.append(np.stack([own[a], others[b]], axis=1))
    return Search(order[np.concatenate(found)], past)


def checkerboard(spacing: float, n: int = 6) -> tuple[Floats, Floats]:
    """Return centres (n^3, 3) and radii, 2 and 1 in turns, of a simple cubic packing; spheres touch at spacing 3."""
    sites = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return spacing * sites.astype(float), np.where(sites.sum(axis=1) % 2 == 0, 2.0, 1.0)


def pairs_by_reach(x: Floats, radius: Floats, of_one: bool) -> set[tuple[int, int]]:
    """Return the pairs (i < j) within 1.05 times the sum of their radii.

    Fault 15 (of_one): within 1.05 times twice the radius of the one with the higher index.
    """
    i, j = np.triu_indices(len(x), 1)
    sum_of = 2.0 * radius[j] if of_one else radius[i] + radius[j]
    near = np.linalg.norm(x[j] - x[i], axis=1) <= REACH * sum_of
    return set(zip(i[near].tolist(), j[near].tolist(), strict=True))


def resident_threads(block: int) -> int:
    """Return how many threads a Quadro K2200 (compute capability 5.0, 5 multiprocessors) holds at once.

    Fault 16: blocks of 16. A multiprocessor holds 32 blocks, 64 warps of 32 threads (CUDA C++ programming guide, table
    of technical specifications).
    """
    warps = ceil(block / 32)
    return 5 * min(32, 64 // warps) * block


# The table ------------------------------------------------------------------------------------------------------


def measured() -> dict[int, str]:
    """Return the measured column of docs/paper-faults.md, by number of the fault."""
    spins, turn, seen, modulus = spin_damping(1.0), rigid_turn(), global_slip(), bond_modulus()
    lopsided, hit, passed = swing(0.7, 0.07), impact(), passage(0.0)
    touching, apart = (checkerboard(spacing) for spacing in (3.0, 3.6))
    contacts, found = (pairs_by_reach(*touching, of_one=one) for one in (False, True))
    search = {d: cell_search(sample(d).x, d, mixed=True) for d in (1.0, 0.7, 0.5)}
    bonds = {d: len(np.unique(s.pairs, axis=0)) for d, s in search.items()}
    twice = {d: len(s.pairs) - bonds[d] for d, s in search.items()}
    free = ", ".join(f"{sample(d).free:.1f}" for d in (0.5, 0.7, 1.0, 2.0))
    areas = ", ".join(f"{100 * (interface_area(d) - 1):+.0f} %" for d in (1.0, 2.0))
    return {
        1: f"amplitude {100 * growth_per_period(lagged_step, 0.1):+.1f} % per period at ω Δt = 0.1",
        2: f"free pair of matrix spheres with spins 0 and ω at d = 0.5: after {spins.steps:.0f} steps its relative "
        f"spin is {spins.relative_spin:.2f}, its angular momentum {spins.momentum:.1f} and its energy "
        f"{spins.energy:.1f} times the start's",
        3: f"free sphere under M cos(ωt): spin from {lopsided.low:.2f} to {lopsided.high:+.2f} M/(Iω)",
        4: f"rigid turn by 45°: slip {seen.slip:.2f} d; a turn by {seen.breaks:.2f}° breaks the bond (d = 0.5); a "
        f"closed cycle of slip and spin yields {seen.gain:.1f} times the stored energy",
        5: f"after 5 periods of slip {100 * slip_left(0.0, 1.0):.0f} % of the amplitude is left",
        6: f"rigid turn by 90°: moment {turn.angle:.0f}° off; stored shear {100 * turn.growth:+.1f} % per turn in "
        "steps of 0.01 rad",
        7: f"smallest distance of centres {passed.nearest:.2f} d; they go on at {passed.speed:+.1f} times their speed",
        8: f"part of the couple unbalanced: {100 * lever_arm(0.5, 1.05):.1f} % at l = 1.05 d, "
        f"{100 * lever_arm(1.0, 3.0):.0f} % for radii 1 and 2",
        9: f"first wave {hit.stress / 1e6:.0f} MPa, largest quasi-static stress {hit.peak / 1e6:.1f} MPa: "
        f"{hit.stress / hit.peak:.0f} times; {hit.travel:.0f} times the slip at failure in one transit of a wave",
        10: f"stress jump {4 * hit.stress / 1e6:.0f} MPa; offset of up to {unloading_offset():.2f} of the slip at "
        "failure per cycle",
        12: f"{modulus.bond:.2f} E in place of E; with the factors the packing has "
        f"{modulus.bulk[1.0]:.2f}, {modulus.bulk[0.7]:.2f}, {modulus.bulk[0.5]:.2f} E for d = 1, 0.7, 0.5",
        13: f"free length {free} m for d = 0.5, 0.7, 1, 2",
        14: f"d = 1: {twice[1.0]} of {bonds[1.0]} pairs bonded twice, {search[1.0].past} reads past the table; "
        f"d = 0.7, 0.5: {twice[0.7]}, {twice[0.5]} pairs, {search[0.7].past}, {search[0.5].past} reads",
        15: f"checkerboard of radii 2 and 1: {len(contacts - found)} of {len(contacts)} contacts missed; a fifth "
        f"farther apart, where none touch, {len(pairs_by_reach(*apart, of_one=True))} pairs bonded",
        16: f"{resident_threads(16)} threads at once, of {resident_threads(64)}",
        17: f"0.7 and 25 times 0.02 added: {steps_to_equality(25)[1]:.16f}",
        19: f"area {areas} for d = 1, 2",
    }


if __name__ == "__main__":
    for fault, text in measured().items():
        print(f"{fault:2d}  {text}")
