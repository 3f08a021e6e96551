"""The drivers against closed forms: a joint in series with a spring, a split bond, the exact path of the pull-out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pybondem as bd
from pybondem.drivers import dissipation_control, load_unload
from pybondem.examples.pullout import pullout

K, AREA, PEAK, END = 1e9, 1e-4, 1e-5, 5e-5  # joint: [Pa/m], [m2], [m], [m]
WORK = 0.5 * K * AREA * PEAK * END  # to take the joint apart [J]
SPRING = 1e4  # [N/m]: so soft that the pulled end has to go back


def in_series(law: Any = None, **bond: Any) -> tuple[bd.Model, Any, bd.Selection]:
    """Return three particles in a row: a joint that slips along x, then a spring along x whose end is pulled."""
    model = bd.Model(bd.packing.line(3, spacing=1e-2, diameter=1e-2), density=2500.0)
    joint = bd.Joint(law or bd.bilinear(PEAK, END, stiffness=K), **bond)
    joints = model.join([[0, 1]], joint, normal=[[0.0, 1.0, 0.0]], area=AREA)
    model.bond([[1, 2]], bd.Bond(bd.springs(SPRING, SPRING)))
    model.fix(model.select([0]), "x y z rx ry rz")
    model.fix(model.select([1, 2]), "y z rx ry rz")
    end = model.select([2])
    model.drive(end, vx=1e-3)
    return model, joints, end


def stress(slip: Any) -> Any:
    return K * np.where(slip < PEAK, slip, np.clip(PEAK * (END - slip) / (END - PEAK), 0.0, None))


def spent(slip: Any) -> Any:
    """Energy that the joint has lost [J]: the area under the law less what unloading to the origin gives back."""
    return WORK * np.clip((slip - PEAK) / (END - PEAK), 0.0, 1.0)


@bd.damage_law(parameters={"peak": "m", "end": "m"}, memory={"largest": "m"})
def opening_only(d: Any, m: Any, p: Any) -> Any:
    """Linear softening of the opening alone: one damage for each mode."""
    x = bd.maximum(bd.maximum(m.largest, d.opening), p.peak)
    return bd.Damage(bd.minimum(1.0, p.end * (x - p.peak) / (x * (p.end - p.peak))), 0.0, 0.0, 0.0), x


def test_snap_back_of_a_joint_and_a_spring_is_followed_exactly() -> None:
    model, joints, end = in_series()
    path = dissipation_control(model, end, "x", energy=WORK / 12, watch=joints, quiet=True)
    slip = path.slip[1:, 0]
    np.testing.assert_allclose(path.load[1:], AREA * stress(slip), rtol=2e-4, atol=1e-4)
    np.testing.assert_allclose(path.displacement[1:], slip + AREA * stress(slip) / SPRING, rtol=2e-4)
    np.testing.assert_allclose(path.dissipated[1:], spent(slip), rtol=1e-3, atol=1e-4 * WORK)
    assert np.argmax(path.displacement) < len(slip) - 5  # it turned back, and went on
    assert slip[-1] == pytest.approx(END, rel=5e-3)
    assert path.solves > 12


def test_both_results_draw_themselves(tmp_path: Path) -> None:
    model, _, end = in_series(damping=0.3)
    path = dissipation_control(model, end, "x", energy=WORK / 4, steps=2, quiet=True)
    assert path.plot(tmp_path / "path.png").stat().st_size > 10_000
    speed = 1e-4 / 1e-3
    envelope = load_unload(
        model, end, "x", growth=WORK / 10, speed=speed, over=1e-4, farthest=2e-4, cycles=2, quiet=True
    )
    assert len(envelope.cycles) == 2
    assert envelope.plot(tmp_path / "envelope.png").stat().st_size > 10_000


def test_every_step_dissipates_what_it_was_told() -> None:
    model, _, end = in_series()
    energies = WORK * np.array([0.1, 0.05, 0.2, 0.3])
    path = dissipation_control(model, end, "x", energy=energies, quiet=True)
    np.testing.assert_allclose(np.diff(path.dissipated)[-3:], energies[1:], rtol=1e-9)
    np.testing.assert_allclose(path.dissipated[-4:], np.cumsum(energies), rtol=1e-9)
    assert path.ended == "steps"


@pytest.mark.parametrize("count", [6, 60, 600])
def test_the_energy_is_booked_whatever_the_steps(count: int) -> None:
    model, joints, end = in_series()
    path = dissipation_control(model, end, "x", energy=0.9 * WORK / count, steps=count, watch=joints, quiet=True)
    assert path.dissipated[-1] == pytest.approx(spent(path.slip[-1, 0]), rel=1e-3)


@pytest.mark.parametrize("count", [4, 20, 100])
@pytest.mark.parametrize("apart", [1.01, 1.1])
def test_the_weakest_of_several_bonds_fails_alone(count: int, apart: float) -> None:
    """Five bonds in a row, a spring: what bears least softens, and the others unload."""
    kn, peaks = 1e4, PEAK * apart ** np.array([2.0, 1.0, 0.0, 3.0, 4.0])
    model = bd.Model(bd.packing.line(7, spacing=1e-2, diameter=1e-2), density=2500.0)
    for k, peak in enumerate(peaks):
        model.bond([[k, k + 1]], bd.Bond(bd.springs(kn, kn), opening_only(peak=peak, end=5.0 * peak)))
    model.bond([[5, 6]], bd.Bond(bd.springs(0.2 * kn, kn)))
    model.fix(model.select(range(7)), "y z rx ry rz")
    model.fix(model.select([0]), "x")
    model.fix(end := model.select([6]), "x")
    work = 0.5 * kn * 5.0 * PEAK**2
    path = dissipation_control(model, end, "x", energy=work / count, quiet=True)
    assert path.dissipated[-1] == pytest.approx(work, rel=0.02)
    assert path.load[-1] < 0.02 * path.load.max()
    assert path.load.max() == pytest.approx(kn * PEAK, rel=1e-3)
    opening = path.displacement - path.load * (1.0 / (0.2 * kn) + 4.0 / kn)  # of the weakest
    force = kn * np.where(opening < PEAK, opening, PEAK * np.clip((5.0 * PEAK - opening) / (4.0 * PEAK), 0.0, None))
    np.testing.assert_allclose(path.load, force, rtol=1e-3, atol=2e-3 * kn * PEAK)


def test_the_path_does_not_depend_on_its_steps() -> None:
    loads = []
    for count in (6, 30):
        model, joints, end = in_series()
        path = dissipation_control(model, end, "x", energy=WORK / count, watch=joints, quiet=True)
        loads.append(np.interp(2.5e-5, path.slip[1:, 0], path.load[1:]))
    assert loads[0] == pytest.approx(loads[1], rel=1e-4)


def test_one_damage_for_each_mode_and_bonds_instead_of_joints() -> None:
    kn = 1e4
    model = bd.Model(bd.packing.line(3, spacing=1e-2, diameter=1e-2), density=2500.0)
    model.bond([[0, 1]], bd.Bond(bd.springs(kn, kn), opening_only(peak=PEAK, end=END)))
    model.bond([[1, 2]], bd.Bond(bd.springs(0.2 * kn, kn)))
    model.fix(model.select([0, 1, 2]), "y z rx ry rz")
    model.fix(model.select([0]), "x")
    model.fix(end := model.select([2]), "x")
    path = dissipation_control(model, end, "x", energy=0.05 * kn * PEAK * END / 2, quiet=True)
    opening = path.displacement - path.load / (0.2 * kn)
    force = kn * np.where(opening < PEAK, opening, PEAK * np.clip((END - opening) / (END - PEAK), 0.0, None))
    np.testing.assert_allclose(path.load, force, rtol=2e-4, atol=2e-4 * kn * PEAK)
    assert path.load.max() == pytest.approx(kn * PEAK, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"energy": 0.0}, "energy of dissipation_control"),
        ({"energy": [1e-6, -1e-6]}, "one for each step"),
        ({"axis": "y"}, None),
        ({"watch": "joints"}, "watch of dissipation_control"),
    ],
)
def test_dissipation_control_refuses(change: dict[str, Any], said: str | None) -> None:
    model, _, end = in_series()
    given: dict[str, Any] = {"energy": WORK / 10, "axis": "x", "steps": 2, **change}
    axis = given.pop("axis")
    with pytest.raises(bd.InputError, match=said or "no bond is damaged at any displacement"):
        dissipation_control(model, end, axis, quiet=True, **given)


def test_models_that_are_not_linear_at_frozen_damage_are_refused() -> None:
    model, _, end = in_series(bd.laws.plastic_slip(yield_stress=1e3, hardening=0.0, stiffness=K))
    with pytest.raises(bd.InputError, match="plastic_slip is a bond law"):
        dissipation_control(model, end, "x", energy=1e-6)
    model, _, end = in_series()
    model.push(model.select([1]), fx=1.0)
    with pytest.raises(bd.InputError, match="pushes"):
        dissipation_control(model, end, "x", energy=1e-6)
    model, _, _ = in_series()
    with pytest.raises(bd.InputError, match="the end is free along x"):
        dissipation_control(model, model.select([1]), "x", energy=1e-6)
    whole = bd.Model(bd.packing.line(2, spacing=1e-2, diameter=1e-2), density=2500.0)
    whole.bond([[0, 1]], bd.Bond(bd.springs(SPRING, SPRING)))
    whole.fix(whole.select([0, 1]), "x y z")
    with pytest.raises(bd.InputError, match="no bond of the model has a damage law"):
        dissipation_control(whole, whole.select([1]), "x", energy=1e-6)


def test_a_law_that_jumps_is_named_as_the_reason() -> None:
    model = bd.Model(bd.packing.line(3, spacing=1e-2, diameter=1e-2), density=2500.0)
    model.bond([[0, 1], [1, 2]], bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), bd.strength(tension=5e6, shear=5e6)))
    model.fix(model.select([0]), "x y z rx ry rz")
    model.fix(end := model.select([2]), "x y z rx ry rz")
    with pytest.raises(bd.InputError, match="damage jumps at a displacement of"):
        dissipation_control(model, end, "x", energy=1e-9, quiet=True)
    with pytest.raises(bd.InputError, match=r"damage jumps|cannot even dissipate"):
        dissipation_control(model, end, "x", energy=1e6, quiet=True)


def test_a_path_ends_where_less_is_left_than_a_step() -> None:
    model, _, end = in_series()
    path = dissipation_control(model, end, "x", energy=0.3 * WORK, quiet=True)
    assert path.ended in ("exhausted", "load gone")
    assert path.dissipated[-1] == pytest.approx(WORK, rel=0.01)
    assert path.displacement[-1] < path.displacement.max()


def test_what_was_found_before_ctrl_c_is_not_lost() -> None:
    model, _, end = in_series(damping=0.3)

    def pressed(*_: Any) -> float:
        asked.append(1)
        if len(asked) > 6:
            raise KeyboardInterrupt
        return 0.0

    asked: list[int] = []
    with pytest.raises(bd.Interrupted, match="after 7 steps") as stop:
        dissipation_control(model, end, "x", energy=0.01 * WORK, until=pressed, quiet=True)  # type: ignore[arg-type]
    assert len(stop.value.found.load) == 8
    asked.clear()
    with pytest.raises(bd.Interrupted, match="after 0 cycles"):
        load_unload(model, end, "x", growth=1.0, speed=1e-3, over=1e-4, farthest=1.0, measure=pressed, quiet=True)
    with pytest.raises(bd.InputError, match="measure of load_unload is 'lost'"):
        load_unload(model, end, "x", growth=1.0, speed=1.0, over=1.0, farthest=1.0, measure="lost")  # type: ignore[arg-type]


def test_what_is_no_model_or_no_function_is_refused() -> None:
    model, _, end = in_series()
    with pytest.raises(bd.InputError, match="needs a Model and a Selection"):
        dissipation_control(model, [2], "x", energy=1e-6)  # type: ignore[arg-type]
    with pytest.raises(bd.InputError, match="until of dissipation_control is 3"):
        dissipation_control(model, end, "x", energy=1e-6, until=3)  # type: ignore[arg-type]


# Loading and unloading ------------------------------------------------------------------------------------------


def test_loading_and_unloading_traces_the_same_snap_back() -> None:
    model, _, end = in_series(damping=0.3)
    period = 2.0 * np.pi * np.sqrt(model.mass[1] / (SPRING + K * AREA))
    envelope = load_unload(
        model, end, "x", growth=WORK / 10, speed=1e-4 / (60 * period), over=5 * period, farthest=2e-4, quiet=True
    )
    slip = np.linspace(0.0, END, 20_000)
    path = np.array([slip + AREA * stress(slip) / SPRING, AREA * stress(slip)])
    size = path.max(axis=1)
    for u, load in zip(envelope.displacement, envelope.load, strict=True):
        assert np.hypot(*((path - [[u], [load]]) / size[:, None])).min() < 0.02
    assert len(envelope.cycles) >= 8
    u = envelope.displacement
    assert u[-1] < 0.8 * u.max()  # it turned back
    assert max(cycle.residual for cycle in envelope.cycles) < 1e-3 * u.max()
    assert envelope.steps > 0
    assert envelope.seconds > 0.0


def test_the_end_never_jumps_and_comes_back_to_where_it_was() -> None:
    from pybondem.drivers.load_unload import _Rig, dissipated
    from pybondem.drivers.steered import steered

    model, _, end = in_series(damping=0.3)
    pulled, velocity = steered(model, end, "x")
    sim = bd.Simulation(pulled, damping=bd.local(0.5), safety=0.5)
    rig = _Rig(sim, velocity, end, "x", dissipated, 200 * sim.dt)
    speed = 1e-4 / (4000 * sim.dt)
    assert rig.load(speed, WORK / 10, 2e-4) is not None
    rig.unload(3.0 * speed)
    t = sim.dt * np.arange(sim.step + 1)
    v = velocity.value(t)
    assert np.abs(np.diff(v)).max() < 0.03 * np.abs(v).max()  # smooth over 200 steps: 1.5 / 200 of 4 speeds
    assert v.min() == pytest.approx(-3.0 * speed)
    assert abs(v[-1]) < 1e-15
    assert sim.particles.x[2, 0] == pytest.approx(2e-2, abs=1e-13)


def test_a_load_that_comes_while_the_end_still_gets_faster_is_taken_back_too() -> None:
    model, _, end = in_series(damping=0.3)
    period = 2.0 * np.pi * np.sqrt(model.mass[1] / (SPRING + K * AREA))
    envelope = load_unload(
        model,
        end,
        "x",
        growth=WORK / 5,
        speed=1e-4 / (20 * period),
        over=100 * period,
        farthest=3e-4,
        cycles=2,
        quiet=True,
    )
    assert max(cycle.residual for cycle in envelope.cycles) < 1e-3 * envelope.displacement.max()


def test_other_conditions_of_the_end_stay() -> None:
    from pybondem.drivers.steered import steered

    model, _, end = in_series()
    pulled, _ = steered(model, end, "x")
    held = {(c.kind, tuple(c.indices), tuple(sorted(c.schedules))) for c in pulled.boundaries.conditions}
    assert held == {
        ("fix", (0,), (0, 1, 2, 3, 4, 5)), ("fix", (1,), (1, 2, 3, 4, 5)), ("fix", (2,), (1, 2, 3, 4, 5)),
        ("drive", (2,), (0,)),
    }  # fmt: skip
    assert len(model.boundaries.conditions) == 3


@pytest.mark.parametrize("name", ["growth", "speed", "over", "farthest"])
def test_load_unload_refuses_what_is_not_positive(name: str) -> None:
    model, _, end = in_series()
    values = {"growth": 1e-6, "speed": 1e-3, "over": 1e-4, "farthest": 1e-4, name: 0.0}
    with pytest.raises(bd.InputError, match=f"{name} of load_unload"):
        load_unload(model, end, "x", **values)


def test_load_unload_says_when_nothing_is_damaged() -> None:
    model, _, end = in_series(damping=0.3)
    with pytest.raises(bd.InputError, match="damage grew by 0 up to a displacement of 1e-06 m, where 1e-06 was asked"):
        load_unload(model, end, "x", growth=1e-6, speed=1e-3, over=1e-5, farthest=1e-6, quiet=True)
    model, _, end = in_series(bd.laws.plastic_slip(yield_stress=1e3, hardening=0.0, stiffness=K))
    with pytest.raises(bd.InputError, match="bond law"):
        load_unload(model, end, "x", growth=1e-6, speed=1e-3, over=1e-5, farthest=1e-6, quiet=True)


@pytest.mark.slow
def test_pull_out_path_through_snap_back() -> None:
    """Within 2 % of the analytic path, independent of the steps."""
    test = pullout(diameter=1.0)
    theory = test.theory()
    exact = theory.path(2000)
    size = exact.displacement.max(), exact.load.max()
    for count in (8, 20):
        built = test.build()
        path = dissipation_control(built.model, built.pulled, "x", energy=theory.work_of_debonding / count, quiet=True)
        apart = [
            np.hypot((exact.displacement - p.displacement) / size[0], (exact.load - p.load) / size[1]).min()
            for p in path.points
        ]
        assert max(apart) < 0.02
        assert path.dissipated[-1] == pytest.approx(theory.work_of_debonding, rel=5e-3)
        assert path.displacement[-1] < 0.85 * path.displacement.max()


@pytest.mark.slow
@pytest.mark.parametrize(("count", "slower"), [(8, 1.0), (6, 1.5)])
def test_loading_and_unloading_of_the_pull_out(count: int, slower: float) -> None:
    """Within 2 % of the analytic path through snap-back, for two settings of cycles and speed."""
    test = pullout(diameter=1.0)
    theory, built = test.theory(), test.build()
    exact = theory.path(4000)
    size = exact.displacement.max(), exact.load.max()
    transit = test.length / np.sqrt(test.E_fibre / test.density)
    envelope = load_unload(
        built.model, built.pulled, "x", growth=theory.work_of_debonding / count,
        speed=theory.peak().displacement / (30.0 * slower * transit), over=3.0 * transit, farthest=1.2 * size[0],
        damping=bd.local(0.6), threads=1, quiet=True,
    )  # fmt: skip
    apart = [
        np.hypot((exact.displacement - u) / size[0], (exact.load - load) / size[1]).min()
        for u, load in zip(envelope.displacement, envelope.load, strict=True)
    ]
    assert max(apart) < 0.02
    assert len(apart) >= count - 2
    assert envelope.displacement[-1] < 0.95 * envelope.displacement.max()  # it went back
