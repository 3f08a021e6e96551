"""The bond laws of the library against separately written mechanics."""

from collections.abc import Callable
from itertools import pairwise
from math import cos, sin

import numpy as np
import pytest
from laws.driven import AREA, LAWS, LENGTH, answers, damages, deformation
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pybondem import laws as library
from pybondem.bonds import ValuedLaw
from pybondem.engines.reference import on_arrays
from pybondem.physics.types import ComponentRates, Components, Stiffness

Floats = NDArray[np.float64]
K = Stiffness(2e6, 1e6, 3.0, 4.0)
YIELD, HARDENING = 2e6, 4e9  # yield force 100 N at a slip of 1e-4 m, back force of 2e5 N/m
LIMIT, BACK = YIELD * AREA, HARDENING * AREA


def slips(s: Floats, t: Floats | float = 0.0) -> list[Components]:
    zero = np.zeros(len(s))
    return [Components(0.0, float(a), float(b), 0.0, 0.0, 0.0, LENGTH, AREA) for a, b in zip(s, t + zero, strict=True)]


def shear_and_plastic(law: ValuedLaw, s: Floats, t: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """Return the shear forces (steps, 2) and the plastic slips (steps, 2) along a path."""
    found = answers(law, slips(s, t), K)
    return np.array([(q.s, q.t) for q, _ in found]), np.array([tuple(m) for _, m in found])


def through(points: list[float], steps: int) -> Floats:
    """Return a path through points, `steps` to each leg."""
    legs = [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(points)]
    return np.append(np.concatenate(legs), points[-1])


# Plastic slip ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardening", [0.0, HARDENING])
def test_plastic_slip_is_a_spring_beside_a_stop(hardening: float) -> None:
    """In one direction the law is an elastic spring and a stop in parallel (Prandtl), which sum increments of slip."""
    law = library.plastic_slip(yield_stress=YIELD, hardening=hardening)
    path = through([0.0, 3e-4, -1e-4, 2.5e-4, -4e-4, 0.0], 37)
    spring = K.ks * hardening * AREA / (K.ks + hardening * AREA)
    limit, stop, wanted = LIMIT * (1.0 - spring / K.ks), 0.0, [0.0]
    for step in np.diff(path):
        stop = min(limit, max(-limit, stop + (K.ks - spring) * step))
        wanted.append(stop)
    shear, _ = shear_and_plastic(law, path)
    np.testing.assert_allclose(shear[:, 0], wanted + spring * path, rtol=0, atol=1e-12 * LIMIT)
    np.testing.assert_array_equal(shear[:, 1], 0.0)


def test_plastic_slip_loses_the_area_of_its_loop() -> None:
    law = library.plastic_slip(yield_stress=YIELD, hardening=HARDENING)
    S = 3e-4
    path = through([0.0, S, -S, S], 3000)
    shear, plastic = shear_and_plastic(law, path)
    loop = slice(3000, None)
    area = np.trapezoid(shear[loop, 0], path[loop])
    assert area == pytest.approx(4.0 * LIMIT * (K.ks * S - LIMIT) / (K.ks + BACK), rel=1e-6)
    assert area == pytest.approx(LIMIT * np.abs(np.diff(plastic[loop, 0])).sum(), rel=1e-6)


def test_plastic_slip_yields_earlier_on_the_way_back() -> None:
    """Bauschinger: hardened to some force, it yields again two yield forces below, not at minus that force."""
    law = library.plastic_slip(yield_stress=YIELD, hardening=HARDENING)
    far = 4e-4
    turn = LIMIT + K.ks * BACK / (K.ks + BACK) * (far - LIMIT / K.ks)
    back = far - 2.0 * LIMIT / K.ks
    shear, plastic = shear_and_plastic(law, np.array([far, back + 1e-9, back - 1e-9]))
    assert shear[:2, 0] == pytest.approx([turn, turn - 2.0 * LIMIT + K.ks * 1e-9], rel=1e-9)
    assert plastic[0, 0] == plastic[1, 0] > plastic[2, 0]


def yielding(x: Callable[[float], Floats], speed: Callable[[float], Floats], start: Floats, end: float) -> Floats:
    """Return the shear force at the end of a path on which all slip is plastic, from the rate equations."""

    def rates(time: float, y: Floats) -> Floats:
        over = K.ks * (x(time) - y) - BACK * y  # the force less the back force
        n = over / np.linalg.norm(over)
        return K.ks * max(0.0, n @ speed(time)) / (K.ks + BACK) * n

    solved = solve_ivp(rates, (0.0, end), start, rtol=1e-10, atol=1e-16)
    return K.ks * (x(end) - solved.y[:, -1])


def test_plastic_slip_around_a_corner_and_a_circle() -> None:
    """Out along s, then on a circle about the origin: rate equations by Runge and Kutta; of first order in the step."""
    law = library.plastic_slip(yield_stress=YIELD, hardening=HARDENING)
    R, angle = 3e-4, 2.0
    first = np.array([(K.ks * R - LIMIT) / (K.ks + BACK), 0.0])
    exact = yielding(
        lambda a: R * np.array([cos(a), sin(a)]), lambda a: R * np.array([-sin(a), cos(a)]), first, angle
    )  # fmt: skip
    errors = []
    for steps in (500, 1000, 2000):
        a = np.linspace(0.0, angle, steps + 1)
        shear, plastic = shear_and_plastic(law, R * np.cos(a), R * np.sin(a))
        errors.append(np.linalg.norm(shear[-1] - exact) / LIMIT)
        over = np.linalg.norm(shear - BACK * plastic, axis=1)
        np.testing.assert_allclose(over, LIMIT, rtol=1e-12)
    assert errors[-1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.1)


def test_plastic_slip_knows_no_direction() -> None:
    """The same path, turned by 0.7 rad about n: the same forces, turned."""
    law = library.plastic_slip(yield_stress=YIELD, hardening=HARDENING)
    s, t = np.random.default_rng(3).uniform(-4e-4, 4e-4, (2, 50))
    R = np.array([[cos(0.7), -sin(0.7)], [sin(0.7), cos(0.7)]])
    shear, _ = shear_and_plastic(law, s, t)
    turned, _ = shear_and_plastic(law, *(R @ [s, t]))
    np.testing.assert_allclose(turned, shear @ R.T, rtol=0, atol=1e-12 * LIMIT)


def test_plastic_slip_stores_and_loses_what_is_worked_on_it() -> None:
    """Work is stored energy and yield force times plastic slip, to first order; and unyielded all six are springs."""
    law = library.plastic_slip(yield_stress=YIELD, hardening=HARDENING)
    a = np.linspace(0.0, 5.0, 4001)
    s, t = 1e-4 * a * np.cos(a), 1e-4 * a * np.sin(2.0 * a)
    found = answers(law, slips(s, t), K)
    shear, plastic = np.array([(q.s, q.t) for q, _ in found]), np.array([tuple(m) for _, m in found])
    work = sum(np.trapezoid(shear[:, k], (s, t)[k]) for k in range(2))
    lost = LIMIT * np.linalg.norm(np.diff(plastic, axis=0), axis=1).sum()
    held = law.potential(slips(s, t)[-1], K, found[-1][1], law.parameters)
    assert work == pytest.approx(held + lost, rel=1e-4)
    d = Components(-1e-5, 3e-5, 4e-5, 0.01, 0.02, -0.03, LENGTH, AREA)
    loads, memory = answers(law, [d], K)[0]
    assert loads == pytest.approx((-20.0, 30.0, 40.0, 0.03, 0.08, -0.12), rel=1e-12)
    U = 0.5 * (2e6 * 1e-10 + 1e6 * 25e-10 + 3.0 * 1e-4 + 4.0 * 13e-4)
    assert law.potential(d, K, memory, law.parameters) == pytest.approx(U, rel=1e-12)


# Cohesion beside friction -----------------------------------------------------------------------------------------

PEAK, END, SHARE = 1e-4, 4e-4, 0.35
FRICTION = library.bilinear_friction(slip_peak=PEAK, slip_end=END, residual=SHARE)
RUBS = SHARE * K.ks * PEAK  # friction force [N]


def three_lines(slip: Floats) -> Floats:
    """Return the shear force while slip grows."""
    top = K.ks * PEAK
    return np.interp(slip, [0.0, PEAK, END, 1.0], [0.0, top, SHARE * top, SHARE * top])


def spring_and_stop(path: Floats) -> Floats:
    """Return the shear force along a path of slip in one direction: a softening spring and a stop (Prandtl)."""
    stop, before, largest, found = 0.0, 0.0, PEAK, []
    for u in path:
        stop = min(RUBS, max(-RUBS, stop + SHARE * K.ks * (u - before)))
        before, largest = u, max(largest, abs(u))
        secant = max(0.0, (1.0 - SHARE) * K.ks * PEAK * (END - largest) / (END - PEAK)) / largest
        found.append(secant * u + stop)
    return np.array(found)


@pytest.mark.parametrize("angle", [0.0, 0.6, 4.0])
def test_friction_has_three_lines_while_slip_grows(angle: float) -> None:
    """In any direction and in steps of any size, as the damage law `bilinear_residual` has."""
    slip = np.sort(np.append(np.random.default_rng(11).uniform(0.0, 3.0 * END, 60), [PEAK, END]))
    damage = library.bilinear_residual(slip_peak=PEAK, slip_end=END, residual=SHARE)
    D = np.array(damages(damage, [deformation(slip=float(x)) for x in slip]))
    for path in (slip, slip[::20]):
        shear, _ = shear_and_plastic(FRICTION, path * cos(angle), path * sin(angle))
        along = shear @ [cos(angle), sin(angle)]
        np.testing.assert_allclose(along, three_lines(path), rtol=0, atol=1e-12 * K.ks * PEAK)
        np.testing.assert_allclose(shear @ [-sin(angle), cos(angle)], 0.0, rtol=0, atol=1e-12 * K.ks * PEAK)
    np.testing.assert_allclose((1.0 - D) * K.ks * slip, three_lines(slip), rtol=0, atol=1e-12 * K.ks * PEAK)


def test_friction_unloads_as_a_softening_spring_and_a_stop() -> None:
    path = through([0.0, 2e-4, 1.5e-4, -2.5e-4, 3e-4, 0.0, 6e-4, -7e-4, 0.0], 41)
    shear, memory = shear_and_plastic(FRICTION, path)
    np.testing.assert_allclose(shear[:, 0], spring_and_stop(path), rtol=0, atol=1e-12 * K.ks * PEAK)
    np.testing.assert_array_equal(shear[:, 1], 0.0)
    assert memory[-1, 0] == 1.0  # the cohesion has gone
    back = through([6e-4, 5e-4], 4)  # its friction alone, unloading with its own stiffness
    shear, _ = shear_and_plastic(FRICTION, back)
    assert shear[-1, 0] == pytest.approx(RUBS - SHARE * K.ks * 1e-4, abs=1e-12 * RUBS)


def test_friction_loses_the_area_of_its_loop() -> None:
    """Once the cohesion has gone, a cycle between -S and S loses 4 tau_r (S - s0)."""
    S = 6e-4
    path = through([0.0, S, -S, S], 3000)
    shear, memory = shear_and_plastic(FRICTION, path)
    area = np.trapezoid(shear[3000:, 0], path[3000:])
    assert area == pytest.approx(4.0 * RUBS * (S - PEAK), rel=1e-6)
    assert area == pytest.approx(RUBS * np.abs(np.diff(memory[3000:, 1])).sum(), rel=1e-6)


def test_friction_around_a_circle() -> None:
    """Out along s, then on a circle about the origin: rate equations by Runge and Kutta; of first order in the step."""
    R, angle = 6e-4, 2.0

    def rates(a: float, w: Floats) -> Floats:
        n = (R * np.array([cos(a), sin(a)]) - w) / PEAK
        return max(0.0, n @ (R * np.array([-sin(a), cos(a)]))) * n

    solved = solve_ivp(rates, (0.0, angle), [R - PEAK, 0.0], rtol=1e-10, atol=1e-16)
    exact = SHARE * K.ks * (R * np.array([cos(angle), sin(angle)]) - solved.y[:, -1])
    errors = []
    for steps in (500, 1000, 2000):
        a = np.linspace(0.0, angle, steps + 1)
        shear, _ = shear_and_plastic(FRICTION, R * np.cos(a), R * np.sin(a))
        errors.append(np.linalg.norm(shear[-1] - exact) / RUBS)
        np.testing.assert_allclose(np.linalg.norm(shear, axis=1), RUBS, rtol=1e-12)
    assert errors[-1] < 5e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.1)


def test_friction_knows_no_direction() -> None:
    s, t = np.random.default_rng(3).uniform(-4e-4, 4e-4, (2, 50))
    R = np.array([[cos(0.7), -sin(0.7)], [sin(0.7), cos(0.7)]])
    shear, _ = shear_and_plastic(FRICTION, s, t)
    turned, _ = shear_and_plastic(FRICTION, *(R @ [s, t]))
    np.testing.assert_allclose(turned, shear @ R.T, rtol=0, atol=1e-12 * K.ks * PEAK)


def test_friction_stores_and_loses_what_is_worked_on_it() -> None:
    """Work is stored energy, that released by damage, and friction force times plastic slip, to first order."""
    a = np.linspace(0.0, 5.0, 8001)
    s, t = 0.8e-4 * a * np.cos(a), 0.8e-4 * a * np.sin(2.0 * a)
    found = answers(FRICTION, slips(s, t), K)
    shear, memory = np.array([(q.s, q.t) for q, _ in found]), np.array([tuple(m) for _, m in found])
    work = sum(np.trapezoid(shear[:, k], (s, t)[k]) for k in range(2))
    rubbed = RUBS * np.linalg.norm(np.diff(memory[:, 1:], axis=0), axis=1).sum()
    released = np.trapezoid(0.5 * (1.0 - SHARE) * K.ks * (s**2 + t**2), memory[:, 0])
    held = FRICTION.potential(slips(s, t)[-1], K, found[-1][1], FRICTION.parameters)
    assert rubbed > 0.2 * work
    assert released > 0.2 * work
    assert work == pytest.approx(held + released + rubbed, rel=1e-4)


def test_tension_twist_and_bending_soften_with_the_cohesion_and_pressure_does_not() -> None:
    d = Components(2e-5, 0.0, 0.0, 0.01, 0.02, -0.03, LENGTH, AREA)
    new, softened, pressed, gone = answers(
        FRICTION, [d, d._replace(s=-1.5e-4, t=2e-4), d._replace(n=-3e-5), d._replace(t=-END)], K
    )
    left = PEAK * (END - 2.5e-4) / (2.5e-4 * (END - PEAK))  # of the cohesion, at a slip of 2.5e-4
    others = np.array([40.0, 0.03, 0.08, -0.12])  # of springs
    for (q, m), share in ((new, 1.0), (softened, left), (pressed, left), (gone, 0.0)):
        assert m.damage == pytest.approx(1.0 - share, rel=1e-12, abs=1e-15)
        normal = q.n if q.n > 0.0 else share * 40.0
        assert (normal, q.twist, q.bend_s, q.bend_t) == pytest.approx(tuple(share * others), rel=1e-12, abs=1e-15)
    assert pressed[0].n == pytest.approx(-60.0, rel=1e-12)
    assert answers(FRICTION, [d._replace(n=1.0, twist=1.0, bend_s=1.0)], K)[0][1] == (0.0, 0.0, 0.0)
    held = FRICTION.potential(d._replace(t=-END), K, gone[1], FRICTION.parameters)
    assert held == pytest.approx(0.5 * RUBS * PEAK, rel=1e-12)  # of friction alone


# Thermal --------------------------------------------------------------------------------------------------------


def test_thermal_grows_over_its_time_and_at_once() -> None:
    """8 mm, 1e-5 /K, 50 K: free of stress 4 um longer; on the way there in proportion to time."""
    d = Components(1e-6, 2e-6, 3e-6, 0.01, 0.02, -0.03, LENGTH, AREA)
    slow = answers(library.thermal(expansion=1e-5, heating=50.0, over=1e-3), [d] * 15, K, dt=1e-4)
    free = 4e-6 * np.minimum(1.0, np.arange(1, 16) / 10.0)
    np.testing.assert_allclose([q.n for q, _ in slow], K.kn * (1e-6 - free), rtol=0, atol=1e-12 * K.kn * 4e-6)
    at_once, _ = answers(library.thermal(expansion=1e-5, heating=-50.0), [d], K)[0]
    assert at_once == pytest.approx((2e6 * 5e-6, 2.0, 3.0, 0.03, 0.08, -0.12), rel=1e-12)
    law = LAWS["thermal"]
    rest = 0.5 * (1e6 * 13e-12 + 3.0 * 1e-4 + 4.0 * 13e-4)
    held = law.potential(d, K, law.memory(elapsed=7.5e-4), law.parameters)
    assert held == pytest.approx(0.5 * 2e6 * 4e-12 + rest, rel=1e-12)


# All of them ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["plastic_slip", "bilinear_friction", "thermal"])
def test_arrays_as_numbers(name: str) -> None:
    random, law, count = np.random.default_rng(5), LAWS[name], 30
    memory = tuple(np.zeros(count) for _ in law.memory._fields)
    history = [Components(*random.uniform(-3e-4, 3e-4, (6, count)), LENGTH, AREA) for _ in range(4)]
    with np.errstate(all="raise"):
        for d in history:
            d = d._replace(s=np.where(np.arange(count) < 3, 0.0, d.s), t=np.where(np.arange(count) < 2, 0.0, d.t))
            found, memory = on_arrays(law.function)(
                d, K, law.memory(*memory), law.parameters, ComponentRates(*(0.0,) * 6), 1e-4
            )
    for b in range(3, count):
        states = [Components(*(float(v[b]) for v in d[:6]), LENGTH, AREA) for d in history]
        alone, _ = answers(law, states, K, dt=1e-4)[-1]
        assert [np.broadcast_to(v, count)[b] for v in found] == pytest.approx(list(alone), rel=1e-12, abs=1e-12)
