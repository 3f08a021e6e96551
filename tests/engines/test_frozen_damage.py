"""Frozen damage: every damage law keeps its damage and memory, on every engine."""

from typing import Any

import numpy as np
import pytest

import pybondem as bd

K, AREA, PEAK, END = 1e9, 1e-4, 1e-5, 5e-5


def softening(engine: str, law: Any) -> tuple[bd.Simulation, Any]:
    model = bd.Model(bd.packing.line(2, spacing=1e-2, diameter=1e-2), density=2500.0)
    pair = model.touching()
    joints = model.join(pair, bd.Joint(law), normal=[[0.0, 1.0, 0.0]], area=AREA)
    model.fix(model.select([0, 1]), "x y z rx ry rz")
    return bd.Simulation(model, engine=engine), joints


def slide(sim: bd.Simulation, slip: float) -> None:
    """Put the second particle where the joint slips so far."""
    with sim.edit("x") as x:
        x[1, 0] = 1e-2 + slip


def damage_at(slip: float) -> float:
    return END * (slip - PEAK) / (slip * (END - PEAK))


@pytest.mark.parametrize("engine", ["cpu", "reference", "interpreted"])
def test_frozen_damage_neither_grows_nor_remembers(engine: str) -> None:
    sim, joints = softening(engine, bd.bilinear(PEAK, END, stiffness=K))
    slide(sim, 2e-5)
    assert sim.bonds(joints).damage[0] == pytest.approx(damage_at(2e-5), rel=1e-9)
    lost = sim.energies.damage
    sim.damage_grows = False
    slide(sim, 4e-5)  # far beyond, along the secant
    tau = sim.interface(joints)[1][0]
    assert tau == pytest.approx((1.0 - damage_at(2e-5)) * K * 4e-5, rel=1e-9)
    assert sim.energies.damage == lost
    sim.damage_grows = True
    slide(sim, 1e-5)  # what was seen while frozen is forgotten
    assert sim.bonds(joints).damage[0] == pytest.approx(damage_at(2e-5), rel=1e-9)
    slide(sim, 3e-5)
    assert sim.bonds(joints).damage[0] == pytest.approx(damage_at(3e-5), rel=1e-9)


@pytest.mark.parametrize("engine", ["cpu", "reference", "interpreted"])
def test_frozen_damage_of_modes(engine: str) -> None:
    @bd.damage_law(parameters={"end": "m"}, memory={"largest": "m"})
    def split(d, m, p):  # type: ignore[no-untyped-def]
        largest = bd.maximum(m.largest, d.slip)
        grown = bd.minimum(largest / p.end, 1.0)
        return bd.Damage(0.0, grown, 0.5 * grown, 0.0), largest

    sim, joints = softening(engine, split(end=END, stiffness=K))
    slide(sim, 2e-5)
    sim.damage_grows = False
    slide(sim, 4e-5)
    np.testing.assert_allclose(sim.bonds(joints).damages[0], [0.0, 0.4, 0.2, 0.0], rtol=1e-9)
    sim.damage_grows = True
    slide(sim, 4e-5)
    np.testing.assert_allclose(sim.bonds(joints).damages[0], [0.0, 0.8, 0.4, 0.0], rtol=1e-9)


def test_a_bond_law_cannot_be_frozen() -> None:
    sim, _ = softening("reference", bd.laws.plastic_slip(yield_stress=1e3, hardening=0.0, stiffness=K))
    with pytest.raises(bd.InputError, match=r"frozen under plastic_slip: it is a bond law"):
        sim.damage_grows = False
