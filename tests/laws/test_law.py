"""Laws as decorated functions: what they may say, that engines agree, and what is said of functions that are none."""

import math
import re
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import DP0

import pybondem as bd
from pybondem.laws.law import Law

ELASTIC = bd.parallel(E=DP0.E, stiffness_ratio=DP0.E / DP0.G, radius_ratio=DP0.bond_radius / DP0.radius)
SLIPS: dict[str, Any] = {
    "parameters": {"slip_peak": "m", "slip_end": "m"},
    "memory": {"largest": "m"},
}


def softening(d, m, p):
    """Bilinear softening as a user writes it."""
    largest = bd.maximum(m.largest, d.slip)
    kappa = bd.maximum(largest, p.slip_peak)
    return bd.minimum(1.0, p.slip_end * (kappa - p.slip_peak) / (kappa * (p.slip_end - p.slip_peak))), largest


def softening_with_if(d, m, p):
    largest = max(m.largest, d.slip)
    if largest <= p.slip_peak:
        return 0.0, largest
    return min(1.0, p.slip_end * (largest - p.slip_peak) / (largest * (p.slip_end - p.slip_peak))), largest


def scene(law: Any, engine: str, seed: int = 1, **options: Any) -> tuple[bd.Simulation, Any]:
    """Return a simulation of a cluster of 13 grains that fly apart, and its bonds."""
    spheres = bd.packing.fcc(DP0.length, bd.Sphere(1.01 * DP0.length), axis=(1.0, -2.0, 0.5), row=(2.0, 1.0, 3.0))
    model = bd.Model(spheres, density=DP0.density)
    bonds = model.bond(model.touching(), bd.Bond(ELASTIC, law, **options))
    sim = bd.Simulation(model, engine=engine)
    rng = np.random.default_rng(seed)
    with sim.edit("v", "w") as (v, w):
        v[:], w[:] = rng.normal(size=v.shape), 100.0 * rng.normal(size=w.shape)
    return sim, bonds


def state(sim: bd.Simulation, bonds: Any) -> list[NDArray[np.float64]]:
    p, b = sim.particles, sim.bonds(bonds)
    return [p.x, p.q, p.v, p.w, p.force, p.torque, b.damage, b.lost]


# What a law may say ---------------------------------------------------------------------------------------------


def test_a_users_law_has_the_bits_of_the_one_built_in(engine: str) -> None:
    mine = bd.damage_law(softening, **SLIPS)
    found = []
    for law in (mine(1e-5, 4e-5), bd.bilinear(1e-5, 4e-5)):
        sim, bonds = scene(law, engine)
        sim.run(40, quiet=True)
        found.append(state(sim, bonds))
        assert 0.0 < found[-1][6].mean() < 1.0
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


def test_a_law_with_if_is_the_law_without(engine: str) -> None:
    law = bd.damage_law(softening_with_if, **SLIPS)(1e-5, 4e-5)
    assert law.branches
    assert not bd.bilinear(1e-5, 4e-5).branches
    found = []
    for each in (law, bd.bilinear(1e-5, 4e-5)):
        sim, bonds = scene(each, engine)
        sim.run(40, quiet=True)
        found.append(state(sim, bonds))
    for a, b in zip(*found, strict=True):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.abs(b).max())


def test_words_of_python_math_numpy_and_the_package(engine: str) -> None:
    """exp by four ways of calling it, max and abs of Python itself, and a function of one's own."""

    def share(x: Any) -> Any:
        return math.exp(-abs(x)) + np.exp(-x) + bd.exp(-x) + math.pow(x, 2.0)

    def worded(d, p):
        x = max(d.slip / p.scale, 0.1, d.bending)
        return 0.1 * bd.minimum(share(x), 1.0)

    law = bd.damage_law(worded, parameters={"scale": "m"})(1e-5)
    sim, bonds = scene(law, engine)
    sim.run(1, quiet=True)
    slip, bending = (np.array([getattr(b, name) for b in seen(sim, bonds)]) for name in ("slip", "bending"))
    x = np.maximum(np.maximum(slip / 1e-5, 0.1), bending)
    assert sim.bonds(bonds).damage == pytest.approx(0.1 * np.minimum(3.0 * np.exp(-x) + x**2, 1.0), rel=1e-12)


def seen(sim: bd.Simulation, bonds: Any) -> list[Any]:
    """Return what the law of each bond sees, by plain Python."""
    from pybondem.bond_answers import BOND, felt
    from pybondem.physics.frame import relative_pose
    from pybondem.physics.types import Pose, Reference, Section, Stiffness

    p, b, start = sim.particles, sim.bonds(bonds), sim.model.x
    found = []
    for k, (i, j) in enumerate(np.stack([b.i, b.j], axis=1)):
        r0 = tuple(start[j] - start[i])
        ends = (Pose(tuple(p.x[e]), tuple(p.q[e])) for e in (i, j))
        k4 = Stiffness(b.kn[k], b.ks[k], b.kt[k], b.kb[k])
        stretch = BOND.stretch(relative_pose(*ends), Reference(r0, r0))
        found.append(felt(stretch, k4, Section(b.area[k], b.modulus[k]), Reference(r0, r0)))
    return found


def test_stresses_and_stiffness_per_area_are_those_of_the_undamaged_bond(engine: str) -> None:
    def measured(d, m):
        return 0.5, d.normal_stress, d.shear_stress, d.normal_stiffness, d.shear_stiffness

    words = {"normal": "Pa", "shear": "Pa", "kn": "Pa/m", "ks": "Pa/m"}
    sim, bonds = scene(bd.damage_law(measured, memory=words)(), engine)
    sim.run(3, quiet=True)
    b, area = sim.bonds(bonds), math.pi * DP0.bond_radius**2
    shapes = seen(sim, bonds)
    assert b.m_kn == pytest.approx(DP0.kn / area)
    assert b.m_ks == pytest.approx(DP0.ks / area)
    assert b.m_normal == pytest.approx(np.array([DP0.kn * s.opening / area for s in shapes]), rel=1e-9, abs=1e-3)
    assert b.m_shear == pytest.approx(np.array([DP0.ks * s.slip / area for s in shapes]), rel=1e-9, abs=1e-3)


def test_rates_and_the_time_step_can_be_asked_for(engine: str, pair: Callable[..., Any]) -> None:
    def moving(d, m, rate, dt):
        return 0.0, m.time + dt, rate.opening, rate.slip

    law = bd.damage_law(moving, memory={"time": "s", "opening": "m/s", "slip": "m/s"})()
    n = np.array([1.0, 2.0, 2.0]) / 3.0
    model, bonds = pair(n, bd.Bond(ELASTIC, law))
    model.fix(model.select([0]))
    v = 0.2 * n + 0.1 * np.array([2.0, -1.0, 0.0])
    model.drive(model.select([1]), vx=v[0], vy=v[1], vz=v[2], wx=0.0, wy=0.0, wz=0.0)
    sim = bd.Simulation(model, engine=engine, dt=1e-7).run(5, quiet=True)
    b = sim.bonds(bonds)
    assert b.m_time == pytest.approx([5e-7], rel=1e-12)
    assert b.m_opening == pytest.approx([0.2], rel=1e-4)
    assert b.m_slip == pytest.approx([0.1 * math.sqrt(5.0)], rel=1e-4)


# One damage for each mode ---------------------------------------------------------------------------------------


def test_each_mode_has_its_own_damage(engine: str) -> None:
    """The energy that is left is that of the springs that are left."""

    def modes(d):
        return bd.Damage(normal=0.1, shear=0.2, twist=0.3, bending=0.4)

    sim, bonds = scene(bd.damage_law(modes)(), engine)
    other = bd.springs(0.9 * DP0.kn, 0.8 * DP0.ks, 0.7 * DP0.kt, 0.6 * DP0.kb)
    sim.run(5, quiet=True)
    b = sim.bonds(bonds)
    assert b.damages == pytest.approx(np.tile([0.1, 0.2, 0.3, 0.4], (36, 1)))
    assert b.damage == pytest.approx(np.full(36, 0.2))
    model = bd.Model(bd.packing.Particles(sim.model.x, sim.model.radius), density=DP0.density)
    twin_bonds = model.bond(model.touching(), bd.Bond(other))
    twin = bd.Simulation(model, engine=engine)
    with twin.edit("x", "q") as (x, q):
        x[:], q[:] = sim.particles.x, sim.particles.q
    opened = np.array([s.opening for s in seen(sim, bonds)]) > 0.0
    assert opened.any()
    assert b.energy[opened] == pytest.approx(twin.bonds(twin_bonds).energy[opened], rel=1e-9)
    assert np.all(b.energy[~opened] > twin.bonds(twin_bonds).energy[~opened])


def test_the_energy_book_of_modes_closes(engine: str, pair: Callable[..., Any]) -> None:
    """Pulled along the bond and broken at once: what is lost is kn u^2 / 2, to round-off."""

    def snapping(d, m):
        gone = bd.where(d.opening > 1e-5, 1.0, m.gone)
        return bd.Damage(gone, gone, 0.0, 0.0), gone

    law = bd.damage_law(snapping, memory={"gone": "1"})()
    n = np.array([1.0, 2.0, 2.0]) / 3.0
    springs = bd.springs(DP0.kn, DP0.ks, radius_ratio=0.8)
    model, _ = pair(n, bd.Bond(springs, law))
    model.fix(model.select([0]))
    model.drive(model.select([1]), **dict(zip(("vx", "vy", "vz"), n.tolist(), strict=True)), wx=0.0, wy=0.0, wz=0.0)
    sim = bd.Simulation(model, engine=engine, dt=1e-6).run(12, quiet=True)
    book = sim.energies
    assert sim.broken == 1
    assert 0.5 * DP0.kn * 1e-5**2 < book.damage < 0.5 * DP0.kn * 1.2e-5**2
    assert abs(book.residual) < 1e-12 * book.damage


# Bond laws ------------------------------------------------------------------------------------------------------


def elastic_law(d, k):
    return bd.Loads(k.kn * d.n, k.ks * d.s, k.ks * d.t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t)


def test_springs_written_as_a_bond_law_are_the_springs(engine: str) -> None:
    found = []
    for law in (bd.bond_law(elastic_law)(), None):
        sim, bonds = scene(law, engine, damping=0.05)
        sim.run(40, quiet=True)
        p = sim.particles
        found.append(([p.x, p.q, p.v, p.w, p.force, p.torque, sim.bonds(bonds).energy], sim.energies))
    for a, b in zip(found[0][0], found[1][0], strict=True):
        assert a == pytest.approx(b, abs=1e-10 * np.abs(b).max())
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-9 * found[1][1].strain)


def test_a_bond_law_on_a_joint(engine: str) -> None:
    """Normal and shear stiffness per area times area, along and across the interface's own normal."""
    joint = bd.Joint(bd.bond_law(elastic_law)(stiffness=2e9), normal_stiffness=5e9)
    model = bd.Model(bd.packing.Particles(np.array([[0, 0, 0], [0.01, 0, 0]]), np.full(2, 0.005)), density=2500.0)
    normal = np.array([0.6, 0.8, 0.0])
    joints = model.join([[0, 1]], joint, normal=[normal], area=3e-5)
    sim = bd.Simulation(model, engine=engine)
    u = np.array([1e-7, 2e-7, 3e-7])
    with sim.edit("x") as x:
        x[1] += u
    opening = u @ normal
    expected = 3e-5 * (5e9 * opening * normal + 2e9 * (u - opening * normal))
    assert sim.particles.force[0] == pytest.approx(expected, rel=1e-9)
    assert sim.interface(joints)[1] == pytest.approx([2e9 * np.linalg.norm(u - opening * normal)], rel=1e-9)


def test_a_memory_word_named_damage_is_the_damage(engine: str) -> None:
    def breaking(d, k, m):
        damage = bd.where(d.n > 1e-5, 1.0, m.damage)
        return bd.Loads((1.0 - damage) * k.kn * d.n, 0.0, 0.0, 0.0, 0.0, 0.0), damage

    sim, bonds = scene(bd.bond_law(breaking, memory={"damage": "1"})(), engine)
    sim.run(30, quiet=True)
    damage = sim.bonds(bonds).damage
    assert 0 < sim.broken == np.count_nonzero(damage == 1.0)
    assert len(sim.failed_pairs) == sim.broken


def test_the_critical_step_knows_a_bond_law_that_is_stiffer_than_its_elastic_form(engine: str) -> None:
    def stiff(d, k):
        return bd.Loads(4.0 * k.kn * d.n, 0.0, 0.0, 0.0, 0.0, 0.0)

    model = bd.Model(bd.packing.line(2, DP0.length, (1, 2, 3), diameter=2 * DP0.radius), density=DP0.density)
    model.bond(model.touching(), bd.Bond(bd.springs(DP0.kn, DP0.kn), bd.bond_law(stiff)()))
    mass = DP0.density * 4 / 3 * math.pi * DP0.radius**3
    assert bd.Simulation(model, engine=engine).limit.dt == pytest.approx(2.0 / math.sqrt(8.0 * DP0.kn / mass), rel=1e-6)


def test_the_work_on_a_bond_law_is_stored_or_lost(engine: str, pair: Callable[..., Any]) -> None:
    """A slider of 2 N: what is lost is force times slip, once the elastic part is stored."""

    def slider(d, k, m, p):
        trial = k.kn * (d.n - m.slipped)
        force = bd.minimum(bd.maximum(trial, -p.limit), p.limit)
        return bd.Loads(force, 0.0, 0.0, 0.0, 0.0, 0.0), d.n - force / k.kn

    law = bd.bond_law(slider, parameters={"limit": "N"}, memory={"slipped": "m"})(2.0)
    model, _ = pair((0.0, 0.0, 1.0), bd.Bond(bd.springs(DP0.kn, 0.0), law))
    model.fix(model.select([0]))
    model.drive(model.select([1]), vx=0.0, vy=0.0, vz=0.01, wx=0.0, wy=0.0, wz=0.0)
    sim = bd.Simulation(model, engine=engine, dt=1e-7).run(1000, quiet=True)
    book, elastic = sim.energies, 2.0 / DP0.kn
    assert book.strain == pytest.approx(0.5 * 2.0 * elastic, rel=1e-9)
    assert book.damage == pytest.approx(2.0 * (1e-6 - elastic), rel=1e-3)
    assert abs(book.residual) < 1e-8 * book.work  # a step of 1 nm is known to 1e-9 of itself


# Handing over ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hand_over", [False, True])
def test_a_failed_bond_leaves_its_pair_to_a_contact_law(engine: str, hand_over: bool, pair: Callable[..., Any]) -> None:
    bond = bd.Bond(ELASTIC, bd.strength(tension=1e5, shear=1e5), hand_over=hand_over)
    model, _ = pair((0.0, 0.0, 1.0), bond)
    sim = bd.Simulation(model, engine=engine)
    assert len(sim.failed_pairs) == 0
    for z in (1e-5, -1e-6):
        with sim.edit("x") as x:
            x[1, 2] = 0.5 * DP0.length + z
            x[0, 2] = -0.5 * DP0.length
    assert np.array_equal(sim.failed_pairs, [[0, 1]])
    pushed = 0.0 if hand_over else DP0.kn * 1e-6
    assert np.linalg.norm(sim.particles.force[0]) == pytest.approx(pushed, rel=1e-6)
    assert sim.energies.strain == pytest.approx(0.5 * pushed * 1e-6, rel=1e-6)


def test_failed_pairs_are_told_in_the_models_own_order(engine: str) -> None:
    model = bd.Model(bd.packing.line(5, DP0.length, (0, 0, -1), diameter=2 * DP0.radius), density=DP0.density)
    model.bond([[4, 3], [2, 3]], bd.Bond(ELASTIC, bd.strength(1e4, 1e4)))
    model.bond([[1, 0]], bd.Bond(ELASTIC, bd.strength(1e12, 1e12)))
    model.bond([[1, 2]], bd.Bond(ELASTIC))
    sim = bd.Simulation(model, engine=engine)
    assert sim.failed_pairs.shape == (0, 2)
    with sim.edit("x") as x:
        x[:, 2] *= 1.01
    assert sim.broken == 2
    assert np.array_equal(sim.failed_pairs, [[2, 3], [3, 4]])


# Values that differ from bond to bond ----------------------------------------------------------------------------


def test_scattered_strength_reaches_its_bonds(engine: str) -> None:
    spread = bd.scatter.weibull(scale=5e6, modulus=4.0, seed=3, length=0.01)
    sim, bonds = scene(bd.strength(tension=spread, shear=1e9), engine)
    middle = 0.5 * sim.model.x[bonds.pairs].sum(axis=1)
    assert np.array_equal(sim.bonds(bonds).p_tension, spread.values(middle))
    assert np.ptp(sim.bonds(bonds).p_tension) > 1e5


def test_scattered_values_are_looked_at_before_the_first_step() -> None:
    spread = bd.scatter.normal(mean=1e6, deviation=1e6, seed=3)
    with pytest.raises(bd.InputError, match=r"^tension of strength\[\d+\] is -\d+.* Pa; it must be positive"):
        scene(bd.strength(tension=spread, shear=1e9), "interpreted")
    peak, end = bd.scatter.uniform(1e-5, 3e-5, seed=1), 2e-5
    with pytest.raises(bd.InputError, match=r"^bilinear needs slip_end > slip_peak; the values of bond \d+ are"):
        scene(bd.bilinear(peak, end), "interpreted")


# What is said of functions that are no laws -----------------------------------------------------------------------


def test_a_law_tells_its_parameters() -> None:
    assert isinstance(bd.bilinear, Law)
    assert "slip_peak [m]" in repr(bd.bilinear)
    assert bd.bilinear.__doc__ == "Linear softening on the slip."


def wrong(text: str, **declared: Any) -> str:
    """Return what is said of a damage law of this text, or of a bond law where it says `bond_law`."""
    names: dict[str, Any] = {"bd": bd, "np": np, "TABLE": [1.0]}
    exec(compile(text, "law.py", "exec"), names)
    declare = bd.bond_law if "Loads" in text or "six" in text else bd.damage_law
    with pytest.raises(bd.LawError) as caught:
        declare(names["law"], **declared)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "declared", "says"),
    [
        ("def law(d, x):\n return 0.0", {}, r"^law \(law.py, line 1\) takes \(d, x\); a damage law takes d and"),
        ("def law(m, d):\n return 0.0", {}, r"takes \(m, d\); a damage law"),
        ("def law(d, k):\n return 0.0", {}, r"takes \(d, k\); a damage law"),
        ("def law(d, p=1):\n return 0.0", {}, r"takes \(d, p=1\)"),
        ("def law(*d):\n return 0.0", {}, r"takes \(\*d\)"),
        ("def law(d, m):\n return 0.0", {"memory": {"a": "m"}}, r"damage, a: 2 values; it returns 0.0 alone"),
        ("def law(d, m):\n return 0.0, 1.0", {}, r"must return damage: 1 value; it returns 2 values"),
        ("def law(d, m):\n return 0.0, 1.0, 2.0", {"memory": {"a": "m"}}, r"2 values; it returns 3 values"),
        ("def law(d):\n pass", {}, r"must return damage, each a number; it returns None"),
        ("def law(d):\n return d.slip > 1.0", {}, r"must return damage, each a number; it returns False"),
        ("def law(d):\n return 'D'", {}, r"each a number; it returns 'D'"),
        ("def law(d):\n return d.openning", {}, r"reads d.openning \(law.py, line 2\).*did you mean 'opening'"),
        ("def law(d, p):\n return p.rte", {"parameters": {"rate": "1"}}, r"reads p.rte .*mean 'rate'\?\): p has"),
        ("def law(d, m):\n return m.a", {}, r"reads m.a .*: m has nothing declared"),
        ("def law(d):\n return unknown(d.slip)", {}, r"fails \(law.py, line 2\): NameError: name 'unknown'"),
        ("def law(d):\n a = np.zeros(1)\n a[0] = 1.0\n return a[0]", {}, r"line 3\) writes into something"),
        ("def law(d):\n global D\n D = 1.0\n return D", {}, r"line 3\) writes into something"),
        ("def law(d):\n return TABLE[0]", {}, r"uses TABLE, a list from outside, which may change"),
        ("def law(d): # six\n return d.n", {}, r"must return its Loads, as Loads\(n, s, t, twist, bend_s, bend_t\)"),
        ("def law(d): # Loads\n return d.slip", {}, r"reads d.slip .*d has n, s, t, twist"),
        ("def law(d):\n return 0.0", {"parameters": {"a": 3.0}}, r"^parameter 'a' of law is 3.0; give its unit"),
        ("def law(d):\n return 0.0", {"parameters": {"stiffness": "Pa/m"}}, r"cannot have a parameter named 'stiff"),
        ("def law(d, m):\n if d.slip < 0:\n  return m.b\n return 0.0, 0.0", {"memory": {"a": "m"}}, r"reads m.b \(law"),
        ("def f(a):\n T = [a]\n T[0] = 1.0\n return a\ndef law(d):\n return f(d.slip)", {}, r"calls f, \(law.py, line"),
        ("def law(d):\n return law(d)", {}, r"calls itself, or a function that does"),
        ("def law(d):\n return 0.0", {"parameters": {"class": "Pa"}}, r"^'class' cannot be a name"),
        ("def law(d):\n return 0.0", {"memory": {"a b": "Pa"}}, r"^'a b' cannot be a name among the memory of law"),
        ("def law(d):\n return 0.0", {"parameters": ["a"]}, r"^the parameters of law are \['a'\]; give names"),
        ("def law(d):\n return 0.0", {"parameters": {"a": "furlong"}}, r"^parameter 'a' of law: 'furlong' in the unit"),
        ("def law(d):\n return 0.0", {"parameters": {"a": "MPa"}}, r"declared in 'MPa', but values are not converted"),
        ("def law(d):\n return 0.0", {"toughness": {"shear": abs}}, r"toughness of law in 'shear' is"),
        ("law = 3", {}, r"^a damage law is made of a function, def law\(d, m, p\): ...; got 3"),
    ],
)  # fmt: skip
def test_what_is_no_law_is_refused_where_it_is_declared(text: str, declared: dict[str, Any], says: str) -> None:
    said = wrong(text, **declared)
    assert re.search(says, said), said


@pytest.mark.parametrize(
    ("give", "says"),
    [
        (lambda: bd.bilinear(slip_peek=1.0, slip_end=2.0), r"no parameter 'slip_peek' \(did you mean 'slip_peak'\?\)"),
        (
            lambda: bd.bilinear(1e-4),
            r"^bilinear needs a value for slip_end \[m\]; its parameters are slip_peak \[m\], slip",
        ),
        (lambda: bd.bilinear(1.0, 2.0, 3.0), r"^bilinear was given 3 values; its parameters are"),
        (lambda: bd.bilinear(1.0, 2.0, slip_end=2.0), r"^bilinear was given slip_end twice"),
        (lambda: bd.bilinear("a", 2.0), r"^slip_peak of bilinear is 'a'; it must be a number in m"),
        (lambda: bd.bilinear(float("nan"), 2.0), r"^slip_peak of bilinear is nan m; it must be finite"),
        (lambda: bd.bilinear([1.0, np.inf], 2.0), r"^slip_peak of bilinear\[1\] is inf, not finite"),
        (lambda: bd.Bond(ELASTIC, bd.bilinear), r"^the law of Bond is bilinear without values; give it values"),
        (lambda: bd.Joint(bd.bilinear(1e-5, 2e-5)), r"^Joint needs a law with a stiffness per area"),
    ],
)
def test_wrong_values_are_refused(give: Callable[[], Any], says: str) -> None:
    with pytest.raises(bd.InputError, match=says):
        give()


def test_a_value_that_is_not_finite_stops_the_run_with_bond_and_inputs(engine: str, pair: Callable[..., Any]) -> None:
    """A root of what becomes negative in compression; the bond is left as it was, so that no other is spoilt."""

    def rooted(d, m, p):
        return 0.0 * bd.sqrt(d.opening + p.offset), bd.maximum(m.longest, d.opening)

    law = bd.damage_law(rooted, parameters={"offset": "m"}, memory={"longest": "m"})(1e-9)
    model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, law))
    sim = bd.Simulation(model, engine=engine)
    with sim.edit("v") as v:
        v[0, 2], v[1, 2] = 1.0, -1.0
    says = r"^the law rooted stops with ValueError: .* \(test_law.py, line \d+: re" if engine == "interpreted" else (
        r"^the law rooted of the bond between particles 0 and 1, now at opening = -\d.*, offset = 1e-09, longest = .*, "
        r"gave a damage outside 0 to 1, or a value that is not finite, at step 1 \(1 bonds in all\)"
    )  # fmt: skip
    with pytest.raises(bd.LawError, match=says):
        sim.run(100, quiet=True)
    assert np.isfinite(sim.particles.x).all()


def test_what_numba_cannot_compile_is_said_with_the_users_own_line() -> None:
    def guarded(d):
        try:
            damage = d.opening - d.opening
        except ValueError:
            damage = 1.0
        return damage

    law = bd.damage_law(guarded)()
    for engine in ("reference", "interpreted"):
        scene(law, engine)[0].run(1, quiet=True)
    says = r"^guarded cannot be compiled: it cannot hold try and except \(test_law.py, line \d+: .*\).*compile nothing"
    with pytest.raises(bd.LawError, match=says):
        scene(law, "cpu")


# What a law uses is what it was ---------------------------------------------------------------------------------

FROZEN = """
import sys
import numpy as np
import pybondem as bd

SLOPE, TABLE = float(sys.argv[1]), np.array([1.0, 2.0])

def share(a):
    return SLOPE * a

@bd.damage_law
def linear(d):
    return min(1.0, max(0.0, share(d.opening) * TABLE[0]))

def damage(law):
    model = bd.Model(bd.packing.line(2, 0.01, (0, 0, 1), diameter=0.01), density=2500.0)
    bonds = model.bond(model.touching(), bd.Bond(bd.parallel(1e9, 2.0), law))
    sim = bd.Simulation(model, engine=sys.argv[2])
    with sim.edit("x") as x:
        x[1, 2] += 1e-5
    return float(sim.bonds(bonds).damage[0])

first = damage(linear())
SLOPE, TABLE[0] = 7.0, 9.0
def share(a):
    return 0.0
print(first, damage(linear()))
"""


def test_a_law_keeps_what_it_was_declared_with(engine: str, tmp_path: Any) -> None:
    """Numbers, arrays and functions changed later reach no engine; another process with other values gets its own."""
    import os
    import subprocess

    (tmp_path / "law.py").write_text(FROZEN)
    environment = os.environ | {"PYBONDEM_CACHE": str(tmp_path)}
    for slope in (1e4, 2e4):
        words = [sys.executable, "law.py", str(slope), engine]
        out = subprocess.check_output(words, text=True, cwd=tmp_path, env=environment)
        assert [float(word) for word in out.split()] == pytest.approx([slope * 1e-5] * 2, rel=1e-9)


def test_a_list_that_has_the_name_of_a_field_is_no_list_of_the_law() -> None:
    names: dict[str, Any] = {"bd": bd, "opening": []}
    exec("def law(d):\n return 0.0 * d.opening", names)
    bd.damage_law(names["law"])


# Damage that is none --------------------------------------------------------------------------------------------


def test_damage_outside_its_range_stops_the_run(engine: str, pair: Callable[..., Any]) -> None:
    @bd.damage_law
    def growing(d):
        return 1e6 * bd.maximum(d.opening, 0.0)

    model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, growing()))
    sim = bd.Simulation(model, engine=engine)
    with pytest.raises(bd.LawError, match=r"the law growing .* opening = 2e-06.* gave a damage outside 0 to 1"), \
         sim.edit("x") as x:  # fmt: skip
        x[1, 2] += 2e-6


@pytest.mark.parametrize(
    "words", ["min(1.0, {})", "max(0.0, {}, 0.5)", "bd.minimum({}, 1.0)", "np.where(d.slip < 0, 0.0, {})"]
)
def test_no_word_hides_what_is_no_number(words: str, pair: Callable[..., Any]) -> None:
    names: dict[str, Any] = {"bd": bd, "np": np}
    exec(f"def law(d):\n return {words.format('bd.sqrt(1e-6 - d.opening)')}", names)
    law = bd.damage_law(names["law"])()
    for engine in ("cpu", "reference"):
        model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, law))
        sim = bd.Simulation(model, engine=engine)
        with pytest.raises(bd.LawError, match="not finite"), sim.edit("x") as x:
            x[1, 2] += 2e-6


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("if d.opening > 1e-6:\n  raise ValueError('too far')", r"stops with ValueError: too far \(law.py, line 3"),
        ("if d.opening > 1e-6:\n  return 0.0, 0.0, 0.0", "does not return the same"),
        ("if d.opening > 1e-6:\n  return 0.0", "does not return the same"),
    ],
)
def test_a_law_that_stops_in_one_branch_is_named(text: str, says: str, pair: Callable[..., Any]) -> None:
    names: dict[str, Any] = {}
    exec(compile(f"def law(d, m):\n {text}\n return 0.0, m.a", "law.py", "exec"), names)
    law = bd.damage_law(names["law"], memory={"a": "1"})()
    for engine in ("reference",) if "0.0, 0.0, 0.0" in text else ("reference", "interpreted"):
        model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, law))
        sim = bd.Simulation(model, engine=engine)
        with pytest.raises(bd.LawError, match=says), sim.edit("x") as x:
            x[1, 2] += 2e-6


def test_the_energy_of_a_closed_bond_that_is_handed_over_is_booked(engine: str, pair: Callable[..., Any]) -> None:
    """Pressed by 2 um, then sheared until it fails: what it held in compression goes with it."""
    book = []
    for hand_over in (False, True):
        law = bd.strength(tension=1e9, shear=1e6)
        model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, law, hand_over=hand_over))
        model.fix(model.select([0]))
        speed = {
            "vx": bd.table([0.0, 2e-5, 2.1e-5], [0.0, 0.0, 2.0]),
            "vz": bd.table([0.0, 2e-5, 2.1e-5], [-0.1, -0.1, 0.0]),
        }
        model.drive(model.select([1]), **speed, vy=0.0, wx=0.0, wy=0.0, wz=0.0)
        sim = bd.Simulation(model, engine=engine, dt=1e-7).run(time=4e-5, quiet=True)
        assert sim.broken == 1
        book.append(sim.energies)
    closed = 0.5 * DP0.kn * 2e-6**2
    assert book[1].damage - book[0].damage == pytest.approx(closed, rel=0.1)
    for each in book:
        assert abs(each.residual) < 2e-2 * closed


def test_a_bond_law_cannot_be_handed_over() -> None:
    with pytest.raises(bd.InputError, match=r"^elastic_law is a bond law, which answers for a failed bond itself"):
        bd.Bond(ELASTIC, bd.bond_law(elastic_law)(), hand_over=True)


def test_a_bond_that_cannot_be_pulled_is_broken_but_not_failed(engine: str, pair: Callable[..., Any]) -> None:
    @bd.damage_law(memory={"gone": "1"})
    def parting(d, m):
        gone = bd.where(d.opening > 1e-6, 1.0, m.gone)
        return bd.Damage(gone, 0.0, 0.0, gone), gone

    model, _ = pair((0.0, 0.0, 1.0), bd.Bond(ELASTIC, parting()))
    sim = bd.Simulation(model, engine=engine)
    with sim.edit("x") as x:
        x[1, 2] += 2e-6
    assert sim.broken == 1
    assert len(sim.failed_pairs) == 0


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("def law(d):\n if d.slip < 0.0:\n  a = 1.0\n return 0.0 * a", 4),
        (
            "def law(d):\n if d.slip < 0.0:\n  b = 1.0\n elif d.slip > 1.0:\n"
            "  b = a = 2.0\n else:\n  b = 3.0\n return a * b",
            8,
        ),
        ("def law(d):\n for a in (1.0, 2.0):\n  if a > 1.0:\n   c = a\n return 0.0 * c", 5),
    ],
)  # fmt: skip
def test_a_name_with_a_value_in_one_branch_only_is_refused(text: str, line: int) -> None:
    said = wrong(text)
    assert re.fullmatch(rf"law \(law.py, line {line}\) uses [ac], which has a value in some branches only.", said), said


def test_a_name_with_a_value_in_every_branch_is_not() -> None:
    text = (
        "def law(d):\n if d.slip < 0.0:\n  a = 1.0\n elif d.slip > 1.0:\n  a = 0.5\n else:\n  a = 0.1\n return 0.0 * a"
    )
    names: dict[str, Any] = {}
    exec(text, names)
    assert bd.damage_law(names["law"])().branches
