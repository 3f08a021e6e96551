"""Some laws of the library in bonds and joints of a simulation: the force of a held pair against its closed form."""

from math import asin, cos, exp, sin, sqrt

import numpy as np
import pytest
from laws.driven import AREA, LENGTH
from numpy.typing import NDArray

import pybondem as bd

Floats = NDArray[np.float64]
Laws = dict[str, tuple[dict[str, float], tuple[str, ...]]]
KN, KS = 4e11, 1e11  # stiffness per area [Pa/m]
N, T = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])  # normal of the joints and the direction of slip
CHORD = {"bond": LENGTH * np.array([0.0, 0.0, 1.0]), "joint": LENGTH * np.array([0.0, 0.6, 0.8])}
BOTH = ("bond", "joint")


class Pair:
    """A pair of held spheres under a law, as bond or as joint.

    at: where the pair is, in metres along x; pulled: whether only the rotations of its second sphere are held.
    """

    def __init__(self, model: bd.Model, law: str, values: dict[str, float], kind: str, at: int, pulled: bool) -> None:
        first = np.array([float(at), 0.0, 0.0])
        spheres = bd.packing.Particles([first, first + CHORD[kind]], [sqrt(AREA / np.pi)] * 2)
        model.add(spheres, name=f"pair {at}", density=2500.0)
        self.law, self.kind, self.first, self.second = law, kind, first, 2 * at + 1
        made = getattr(bd.laws, law)
        if kind == "bond":
            bond = bd.Bond(bd.springs(KN * AREA, KS * AREA), made(**values))
            self.bonds = model.bond([[2 * at, 2 * at + 1]], bond)
        else:
            joint = bd.Joint(made(**values, stiffness=KS), normal_stiffness=KN)
            self.bonds = model.join([[2 * at, 2 * at + 1]], joint, normal=[N], area=AREA)
        model.fix(model.select([2 * at]))
        model.fix(model.select([2 * at + 1]), "rx ry rz" if pulled else "x y z rx ry rz")

    def place(self, opening: float, slip: float) -> Floats:
        """Return where the second sphere goes for an opening and a slip [m]."""
        if self.kind == "joint":
            return self.first + CHORD["joint"] + opening * N + slip * T
        return self.first + (LENGTH + opening) * self.axes(slip)[0]

    def axes(self, slip: float) -> tuple[Floats, Floats]:
        """Return the directions of opening and of slip; the slip of a bond is L sin(turn of its chord)."""
        a = asin(slip / LENGTH)
        return (N, T) if self.kind == "joint" else (np.array([0.0, sin(a), cos(a)]), np.array([0.0, cos(a), -sin(a)]))

    def force(self, sim: bd.Simulation, slip: float = 0.0) -> list[float]:
        """Return the force along the opening and along the slip [N]."""
        return [float(sim.bonds(self.bonds).force[0] @ axis) for axis in self.axes(slip)]

    def wanted(self, opening: float, slip: float, normal: float, shear: float) -> list[float]:
        """Return what these forces are for loads on opening and slip: a bond slips by the turn of its chord."""
        lever = cos(asin(slip / LENGTH)) * LENGTH / (LENGTH + opening) if self.kind == "bond" else 1.0
        return [normal, shear * lever]


def pairs_of(laws: Laws, pulled: bool = False) -> tuple[bd.Model, list[Pair]]:
    """Return a model of pairs under laws, given as name -> (values, kinds); pulled: see `Pair`."""
    model, kinds = bd.Model(), [(name, values, kind) for name, (values, kinds) in laws.items() for kind in kinds]
    return model, [Pair(model, name, values, kind, at, pulled) for at, (name, values, kind) in enumerate(kinds)]


def deform(sim: bd.Simulation, pairs: list[Pair], opening: float, slip: float) -> None:
    """Put every pair to an opening and a slip [m]."""
    with sim.edit("x") as x:
        for pair in pairs:
            x[pair.second] = pair.place(opening, slip)


def mixed_damage(opening: float, slip: float, p: dict[str, float]) -> float:
    """Return the damage of exponential_power on first loading, from stresses and energies of the undamaged bond."""
    normal, shear = 0.5 * KN * max(0.0, opening) ** 2, 0.5 * KS * slip**2
    stress = sqrt((KN * max(0.0, opening) / p["tension"]) ** 2 + (KS * slip / p["shear"]) ** 2)  # 1 at the onset
    B, held = shear / (normal + shear), (normal + shear) / stress**2
    G = (((1.0 - B) / p["G_I"]) ** p["alpha"] + (B / p["G_II"]) ** p["alpha"]) ** (-1.0 / p["alpha"])
    return 1.0 - exp(-(stress - 1.0) * 2.0 * held / (G - held)) / stress if stress > 1.0 else 0.0


def concrete_damage(opening: float, slip: float, p: dict[str, float]) -> float:
    """Return the damage of concrete on first loading, at the largest principal strain."""
    strain = np.linalg.eigvalsh([[opening / LENGTH, 0.5 * slip / LENGTH], [0.5 * slip / LENGTH, 0.0]])[1]
    beyond = max(0.0, strain - p["threshold"])
    stress = p["threshold"] * (1.0 - p["alpha"] + p["alpha"] * exp(-p["beta"] * beyond))
    return 1.0 - stress / strain if beyond > 0.0 else 0.0


PATH = [(0.4, 0.2), (1.3, 0.9), (0.5, 0.3), (2.0, 2.5), (1.0, 0.0), (-1.0, 1.0), (4.0, 6.0), (20.0, 20.0), (0.3, 0.1)]


def test_damage_in_bonds_and_joints(engine: str) -> None:
    """Force in every state is (1 - D) times that of the springs, D the largest so far; pressure is borne whole."""
    values = {
        "exponential_power": {"tension": 3e6, "shear": 5e6, "G_I": 100.0, "G_II": 300.0, "alpha": 1.3},
        "concrete": {"threshold": 1e-3, "alpha": 0.96, "beta": 200.0},
    }
    first = {"exponential_power": mixed_damage, "concrete": concrete_damage}
    if engine == "cpu":  # compiles for seconds, for each law in each of both
        model, pairs = pairs_of({"exponential_power": (values["exponential_power"], ("joint",))})
    else:
        model, pairs = pairs_of({name: (values[name], BOTH) for name in values})
    sim = bd.Simulation(model, engine=engine)
    D = dict.fromkeys(values, 0.0)
    for opening, slip in 1e-5 * np.array(PATH):
        deform(sim, pairs, opening, slip)
        D = {name: max(D[name], first[name](opening, slip, values[name])) for name in D}
        for pair in pairs:
            left = 1.0 - D[pair.law]
            normal, shear = KN * AREA * opening * (left if opening > 0.0 else 1.0), KS * AREA * slip * left
            wanted = pair.wanted(opening, slip, normal, shear)
            scale = 1e-10 * KN * AREA * max(abs(opening), slip)
            assert pair.force(sim, slip) == pytest.approx(wanted, rel=1e-8, abs=scale), (pair.law, pair.kind, opening)
            assert sim.bonds(pair.bonds).damage[0] == pytest.approx(D[pair.law], rel=1e-9)
    assert all(0.9 < last < 1.0 for last in D.values())


def test_bond_laws_in_bonds_and_joints(engine: str) -> None:
    """Plastic slip out, back and through against a spring beside a stop; then the heat of 20 steps against the time."""
    plastic, heat = {"yield_stress": 2e6, "hardening": 3e10}, {"expansion": 1e-5, "heating": 50.0, "over": 2e-5}
    kinds = (("bond",), ("joint",)) if engine == "cpu" else (BOTH, BOTH)
    model, pairs = pairs_of({"plastic_slip": (plastic, kinds[0]), "thermal": (heat, kinds[1])})
    sim = bd.Simulation(model, engine=engine, dt=1e-6)
    spring = KS * 3e10 / (KS + 3e10)  # stiffness per area beyond yield
    most, stop, before = 2e6 * (1.0 - spring / KS), 0.0, 0.0
    for slip in (1e-5, 3e-5, 6e-5, 2e-5, -3e-5, -3.5e-5, 0.0):
        deform(sim, pairs, 0.0, slip)
        stop, before = min(most, max(-most, stop + (KS - spring) * (slip - before))), slip
        for pair in pairs:
            if pair.law == "plastic_slip":
                wanted = pair.wanted(0.0, slip, 0.0, AREA * (stop + spring * slip))
                assert pair.force(sim, slip) == pytest.approx(wanted, rel=1e-9, abs=1e-5), (pair.kind, slip)
    for steps in (0, 1, 9, 10, 10):
        sim.run(steps=steps, quiet=True)
        for pair in pairs:
            if pair.law == "thermal":
                wanted = [-KN * AREA * 1e-5 * 50.0 * LENGTH * min(1.0, sim.step / 20), 0.0]
                assert pair.force(sim) == pytest.approx(wanted, rel=1e-9, abs=1e-3), (pair.kind, sim.step)


def test_friction_in_bonds_and_joints(engine: str) -> None:
    """Out, back and through: the damage law along its secant, the bond law as a softening spring beside a stop."""
    peak, end, share = 1e-5, 5e-5, 0.3
    values = {"slip_peak": peak, "slip_end": end, "residual": share}
    kinds = ("joint",) if engine == "cpu" else BOTH
    model, pairs = pairs_of({"bilinear_residual": (values, kinds), "bilinear_friction": (values, kinds)})
    sim = bd.Simulation(model, engine=engine, dt=1e-6)
    stop, before, largest = 0.0, 0.0, peak
    for slip in (0.8e-5, 2e-5, 4e-5, 3e-5, -3e-5, 4.5e-5, 9e-5, 0.0):
        limit = share * KS * peak
        stop = min(limit, max(-limit, stop + share * KS * (slip - before)))
        before, largest = slip, max(largest, abs(slip))
        tied = (1.0 - share) * KS * peak * max(0.0, end - largest) / (end - peak)
        stress = {
            "bilinear_residual": (tied + limit) * slip / largest,
            "bilinear_friction": tied * slip / largest + stop,
        }
        deform(sim, pairs, 0.0, slip)
        for pair in pairs:
            wanted = pair.wanted(0.0, slip, 0.0, AREA * stress[pair.law])
            assert pair.force(sim, slip) == pytest.approx(wanted, rel=1e-9, abs=1e-6), (pair.law, pair.kind, slip)
            cohesion = 1.0 - tied / ((1.0 - share) * KS * largest)
            D = 1.0 - (tied + limit) / (KS * largest) if pair.law == "bilinear_residual" else cohesion
            assert sim.bonds(pair.bonds).damage[0] == pytest.approx(D, rel=1e-9, abs=1e-12)
    assert sim.broken == len(kinds)  # those of the bond law, whose cohesion has gone


def test_rate_strength_in_bonds_and_joints(engine: str) -> None:
    """Pulled at 100 e^2 times the reference rate: broken when the stress is 1 + 0.1 (2 + ln 100) of the strength."""
    values = {"tension": 4e6, "shear": 8e6, "C": 0.1, "reference_rate": 1e-3}
    model, pairs = pairs_of({"rate_strength": (values, ("bond",) if engine == "cpu" else BOTH)}, pulled=True)
    speed, stretch = LENGTH * 0.1 * exp(2.0), 4e6 * (1.0 + 0.1 * (2.0 + 4.605170185988092)) / KN
    for pair in pairs:
        velocity = speed * pair.axes(0.0)[0]
        model.drive(model.select([pair.second]), **{f"v{axis}": float(velocity[k]) for k, axis in enumerate("xyz")})
    sim = bd.Simulation(model, engine=engine, dt=stretch / speed / 400.5)
    sim.run(steps=400, quiet=True)
    for pair in pairs:
        assert pair.force(sim) == pytest.approx([KN * AREA * stretch * 400 / 400.5, 0.0], rel=1e-6, abs=1e-3)
    assert sim.broken == 0
    sim.run(steps=1, quiet=True)
    assert sim.broken == len(pairs)
