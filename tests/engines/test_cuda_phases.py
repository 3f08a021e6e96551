"""The algorithm of the CUDA kernels without a GPU: their own phases on the CPU, against the other engines."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from engines import cuda_on_cpu
from engines.cuda_on_cpu import ORDERS, CudaOnCpu
from engines.scenes import DT, LENGTH, E, Scene, assert_near, cluster, families, loaded
from hypothesis import given
from hypothesis import strategies as st

import pybondem as bd
from pybondem.assembly import assemble, energy_program, linear_program, step_program
from pybondem.engines.cuda_bonds import bond_text
from pybondem.engines.cuda_half_bonds import half_bond_text
from pybondem.engines.cuda_partition import half_bonds, share_out
from pybondem.engines.cuda_text import is_step, stage_text
from pybondem.neighbours import own_bonds

VARIANTS = ("bonds", "half-bonds")
variants = pytest.mark.parametrize("variant", VARIANTS)
GLUE = bd.parallel(E=E, stiffness_ratio=2.0, radius_ratio=0.8)
BEFORE: dict[str, Any] = {"damping": bd.local(0.2), "gravity": (1.0, 2.0, -9.81)}


# Scenes ---------------------------------------------------------------------------------------------------------


@bd.damage_law(parameters={"peak": "m", "viscosity": "s"}, memory={"longest": "m", "waited": "s"})
def tiring(d, m, p, rate, dt):
    """A law with all that a law may ask for, and words that are not plain arithmetic."""
    longest = bd.maximum(m.longest, d.slip + bd.maximum(d.opening, 0.0))
    waited = m.waited + dt * bd.where(longest > p.peak, 1.0, 0.0)
    goal = 1.0 - bd.exp(-longest / p.peak) / bd.sqrt(1.0 + rate.slip * p.viscosity / d.length)
    return bd.minimum(1.0, goal * waited / (waited + p.viscosity)), longest, waited


@bd.damage_law(parameters={"peak": "m"}, memory={"opened": "m", "slipped": "m"})
def by_modes(d, m, p):
    """One damage for each mode."""
    opened, slipped = bd.maximum(m.opened, d.opening), bd.maximum(m.slipped, d.slip)
    torn, shorn = bd.minimum(1.0, opened / p.peak), bd.minimum(1.0, slipped / p.peak)
    return bd.Damage(torn, shorn, 0.5 * shorn, 0.0), opened, slipped


def kinds() -> dict[str, bd.Bond | bd.Joint]:
    """Return bonds of every kind that there is: no law, laws of one damage and of four, loads, rates, joints."""
    return {
        **families(),
        "slipping": bd.Bond(GLUE, bd.laws.plastic_slip(yield_stress=2e7, hardening=1e11), damping=0.02),
        "by modes": bd.Bond(GLUE, by_modes(peak=3e-4)),
        "tiring": bd.Bond(GLUE, tiring(peak=4e-4, viscosity=1e-6)),
    }


def conditions(model: bd.Model) -> None:
    """Fix, drive and push a few particles."""
    model.fix(model.select([0]), "x y rz")
    model.drive(model.select([5]), vx=bd.ramp(to=2.0, over=10 * DT), wz=100.0)
    model.push(model.select([1, 5]), fz=bd.ramp(to=50.0, over=5 * DT), ty=0.3)


def with_loose(scene: Scene, many: int) -> Scene:
    """Return a scene with free particles beside it."""
    places = 20.0 * LENGTH + 3.0 * LENGTH * np.indices((many, 1, 1)).reshape(3, -1).T
    rest = {"radius": np.full(many, 0.3 * LENGTH), "q": np.tile([1.0, 0.0, 0.0, 0.0], (many, 1))}
    rest |= {"x0": places, "x": places, "v": np.ones((many, 3)), "w": 100.0 * np.ones((many, 3))}
    return replace(scene, **{name: np.concatenate([getattr(scene, name), value]) for name, value in rest.items()})


def urchin(spikes: int, bond: bd.Bond) -> Scene:
    """Return one large sphere with so many small ones around it, each bonded to it."""
    k = np.arange(spikes) + 0.5
    height, turn = 1.0 - 2.0 * k / spikes, np.pi * (1.0 + 5.0**0.5) * k
    around = np.stack(
        [np.sqrt(1.0 - height**2) * np.cos(turn), np.sqrt(1.0 - height**2) * np.sin(turn), height], axis=1
    )
    large = LENGTH * np.sqrt(spikes)
    x = np.concatenate([[[0.0, 0.0, 0.0]], (large + 0.5 * LENGTH) * around])
    radius = np.concatenate([[large], np.full(spikes, 0.5 * LENGTH)])
    pairs = np.stack([np.zeros(spikes, int), 1 + np.arange(spikes)], axis=1)
    n, q = len(x), np.zeros((len(x), 4))
    q[:, 0] = 1.0
    return Scene({"glue": bond}, x, radius, {"glue": pairs}, {}, x, q, np.zeros((n, 3)), np.zeros((n, 3)))


def everything(seed: int = 3) -> Scene:
    """Return a loaded cluster of every kind of bond, and three free particles."""
    return with_loose(loaded(cluster(seed, kinds()), seed), 3)


def state(sim: bd.Simulation) -> dict[str, np.ndarray]:
    """Return every array of the model as it stands: particles, bonds and loads."""
    homes = {"particle": sim.state.particles, "shared": {"load": sim.state.shared["load"]}, **sim.state.bonds}
    return {
        f"{home} {name}": value.copy()
        for home, fields in homes.items()
        for name, value in fields.items()
        if isinstance(value, np.ndarray)
    }


def ran(scene: Scene, engine: Any, *steps: int, **options: Any) -> dict[str, np.ndarray]:
    """Return the state after advances of so many steps each."""
    sim = scene.build(engine, conditions, **(BEFORE | options))
    for n in steps:
        sim.run(n, quiet=True)
    return state(sim)


def assert_same(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    """Hold two states equal to the last bit."""
    assert found.keys() == expected.keys()
    assert [name for name in found if not np.array_equal(found[name], expected[name])] == []


# Against the other engines --------------------------------------------------------------------------------------


@variants
@pytest.mark.parametrize("seed", [3, 4])
def test_cuda_phases_take_one_step_as_the_reference_does(variant, seed):
    scene = everything(seed)
    truth, found = ran(scene, "reference", 1), ran(scene, CudaOnCpu(variant), 1)
    for name, expected in truth.items():
        assert_near(found[name], expected, 1e-12, name)
    assert sum(np.count_nonzero(v) > 0 for name, v in truth.items() if name.endswith("damage")) >= 4


@variants
def test_cuda_phases_stay_with_the_reference_for_200_steps(variant):
    scene = loaded(cluster(7, kinds()), 7, strain=0.01, turn=0.01, speed=1.0)
    options = {"dt": 0.5 * DT}
    truth, found = ran(scene, "reference", 200, **options), ran(scene, CudaOnCpu(variant), 150, 50, **options)
    for name, expected in truth.items():
        assert_near(found[name], expected, 1e-9, name)


@variants
@pytest.mark.parametrize("options", [{}, {"damping": None}, {"damping": bd.viscous(100.0), "gravity": (0, 0, 0)}])
def test_cuda_phases_have_the_bits_of_plain_loops(variant, options):
    """Where nothing is contracted the order of every operation is that of `engines.loops`."""
    scene = everything(5)
    assert_same(ran(scene, CudaOnCpu(variant), 2, 1, **options), ran(scene, "interpreted", 3, **options))


@pytest.mark.slow
@variants
def test_cuda_phases_compiled_have_the_bits_of_the_cpu_engine_and_stay_inside_their_arrays(variant):
    """By Numba, with a check of every index."""
    glue = {"glue": bd.Bond(GLUE, bd.strength(tension=5e7, shear=7e7), damping=0.02)}
    scene = with_loose(loaded(cluster(9, glue), 9), 2)
    found = ran(scene, CudaOnCpu(variant, threads=16, compiled=True), 300, 1)
    assert_same(found, ran(scene, "cpu", 301))
    assert 0 < np.count_nonzero(found["b0 damage"]) < len(found["b0 damage"])


@variants
def test_cuda_phases_without_pushes_or_dashpots(variant):
    """Velocities foreseen are seen by no bond then: they are only told."""
    scene = loaded(cluster(6, {"glue": bd.Bond(GLUE)}), 6)
    for steps in (1, 2, 3):
        results = []
        for engine in (CudaOnCpu(variant), "interpreted"):
            sim = scene.build(engine)
            sim.run(steps, quiet=True)
            results.append(state(sim))
        assert_same(*results)
        assert np.abs(results[0]["particle v_ahead"]).max() > 0.0


@variants
def test_cuda_phases_of_a_model_without_bonds(variant):
    scene = replace(with_loose(loaded(cluster(2, kinds()), 2), 9), families={})
    assert_same(ran(scene, CudaOnCpu(variant), 2, 1), ran(scene, "interpreted", 3))


@variants
@pytest.mark.parametrize("other", ["reference", pytest.param("cpu", marks=pytest.mark.slow)])
def test_cuda_phases_freeze_damage_as_other_engines_do(variant, other):
    """Laws of one damage and of four, with rates and memories; a bond law is not to be frozen."""
    families = {name: bond for name, bond in kinds().items() if name != "slipping"}
    scene = with_loose(loaded(cluster(16, families), 16), 1)
    results = []
    for engine in (CudaOnCpu(variant, threads=16), other):
        sim, seen = scene.build(engine, conditions, **BEFORE), []
        for steps, sim.damage_grows in ((4, True), (3, False), (2, False), (4, True)):
            seen.append(state(sim.run(steps, quiet=True)))
        for name in (name for name in seen[0] if "damage" in name or " m_" in name or "lost" in name):
            assert np.array_equal(seen[0][name], seen[1][name])
            assert np.array_equal(seen[0][name], seen[2][name])
        changed = {name for name in seen[0] if not np.array_equal(seen[2][name], seen[3][name])}
        assert sum(name.endswith(" damage") for name in changed) >= 3
        results.append(seen)
    for found, expected in zip(*results, strict=True):
        for name, truth in expected.items():
            assert_near(found[name], truth, 1e-11, name)


# Advances in a row, blocks of any size --------------------------------------------------------------------------


@variants
def test_cuda_phases_may_be_cut_into_advances_of_any_length(variant):
    """What is read in one step and written for the next changes places in each step, and starts afresh in a launch."""
    scene = everything(8)
    whole = ran(scene, CudaOnCpu(variant), 12)
    for parts in ((1,) * 12, (2,) * 6, (3, 4, 5), (1, 2, 1, 3, 2, 2, 1)):
        assert_same(ran(scene, CudaOnCpu(variant), *parts), whole)


@variants
@pytest.mark.parametrize("threads", [1, 5, 12, 64, 256])
def test_cuda_phases_do_not_depend_on_the_size_of_blocks(variant, threads):
    """From blocks of one thread, where every particle takes several turns, to one block that holds all."""
    scene = everything(10)
    assert_same(ran(scene, CudaOnCpu(variant, threads=threads), 3), ran(scene, "interpreted", 3))


@variants
@pytest.mark.parametrize("spikes", [256, 520])
def test_cuda_phases_of_a_particle_with_more_bonds_than_a_block_has_threads(variant, spikes):
    scene = urchin(spikes, bd.Bond(GLUE, bd.strength(tension=2e7, shear=2e7), damping=0.1))
    scene = loaded(scene, 1, strain=0.01, turn=0.01)
    engine = CudaOnCpu(variant, threads=256)
    assert_same(ran(scene, engine, 2, dt=DT / 10), ran(scene, "interpreted", 2, dt=DT / 10))


# Races ----------------------------------------------------------------------------------------------------------


@variants
@pytest.mark.parametrize("order", ORDERS[1:])
def test_cuda_phases_do_not_depend_on_the_order_of_blocks_and_threads(variant, order):
    """Nor do they read shared memory that the block has not written: it holds NaN."""
    scene = everything(11)
    found = ran(scene, CudaOnCpu(variant, threads=9, order=order), 3)
    assert_same(found, ran(scene, CudaOnCpu(variant, threads=9), 3))
    assert all(np.isfinite(value).all() for value in found.values())


FAULTS = [  # what is right in the text of the phases, and a race in its place
    ("to_k = other + place", "to_k = half + place"),
    ("shared[5, thread] =", "shared[5, thread - thread % 2] ="),
    ("u = place(c, ", "u = place(c - c % 2, "),
    ("kept_k = place(k, ", "kept_k = place(k - k % 2, "),
]


@pytest.mark.parametrize(("right", "wrong"), FAULTS)
def test_cuda_phases_with_a_race_are_found_out(monkeypatch, right, wrong):
    """The watch itself: a phase that writes where another thread reads or writes gives it away."""
    real = cuda_on_cpu.half_bond_text

    def planted(program, threads):
        text = real(program, threads)
        before, found, after = text.source.rpartition(right)
        assert found
        return text._replace(source=before + wrong + after)

    scene = loaded(cluster(12, {"glue": bd.Bond(GLUE, bd.strength(tension=5e7, shear=7e7))}), 12)
    right_one = ran(scene, CudaOnCpu("half-bonds", 16), 3)
    monkeypatch.setattr(cuda_on_cpu, "half_bond_text", planted)
    with pytest.raises((AssertionError, bd.BondemError)):
        _ = [assert_same(ran(scene, CudaOnCpu("half-bonds", 16, order), 3), right_one) for order in ORDERS]


# The other programs, and what is said of a kernel ---------------------------------------------------------------


@variants
def test_cuda_phases_serve_the_energy_book_and_the_critical_step(variant):
    scene = everything(13)
    sims = [
        scene.build(engine, conditions, **BEFORE).run(3, quiet=True) for engine in (CudaOnCpu(variant), "reference")
    ]
    assert_near(sims[0].energies, sims[1].energies, 1e-12)
    assert_near(sims[0].bond_energy(), sims[1].bond_energy(), 1e-12)
    assert sims[0].limit.dt == pytest.approx(sims[1].limit.dt, rel=1e-9)


@pytest.fixture(scope="module")
def programs() -> dict[str, Any]:
    scene = everything(14)
    done = assemble(scene.build("reference", conditions).model)
    return {
        "step": step_program(done, (0.0, 0.0, 0.0), None),
        "energy": energy_program(done),
        "stiffness": linear_program(done),
    }


def test_cuda_phases_know_a_step(programs):
    assert {name: is_step(program) for name, program in programs.items()} == {
        "step": True, "energy": False, "stiffness": False,
    }  # fmt: skip


@pytest.mark.parametrize("make", [bond_text, half_bond_text])
def test_cuda_phases_write_what_they_say(programs, make):
    """Every array that changes is named, and every one that is named changes in a loaded model."""
    scene = everything(14)
    sim = scene.build(CudaOnCpu("bonds" if make is bond_text else "half-bonds"), conditions, **BEFORE)
    text = sim._runner.text  # type: ignore[attr-defined]
    arrays = {name: value for name, value in text.arguments.items() if isinstance(value, np.ndarray)}
    before = {name: value.copy() for name, value in arrays.items()}
    sim.run(3, quiet=True)
    changed = {name for name, value in arrays.items() if not np.array_equal(value, before[name])}
    assert changed <= text.written
    still = {name for name in text.written - changed if not name.startswith("b") and name != "p_dragged"}
    assert not still


def test_cuda_phases_say_how_many_blocks_they_fill(programs):
    n = programs["step"].particles["force"].shape[1]
    bonds = max(block.count for block in programs["step"].blocks)
    for make in (stage_text, bond_text):
        assert make(programs["step"], threads=8).blocks == -(-max(n, bonds) // 8)
    text = half_bond_text(programs["step"], threads=16)
    assert text.blocks == len(text.private["chunks"].initial)
    assert text.private["seen"].shape == (2 * 16 * 16 * -(-n // 16),)
    assert half_bond_text(programs["step"]).threads == 128


# Who owns what --------------------------------------------------------------------------------------------------


@st.composite
def bonded(draw: Any) -> tuple[int, list[tuple[np.ndarray, np.ndarray]]]:
    """Draw a number of particles, and ends i < j of the bonds of up to three sets."""
    n = draw(st.integers(1, 30))
    pair = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda p: p[0] < p[1])
    sets = draw(st.lists(st.lists(pair, max_size=60) if n > 1 else st.just([]), max_size=3))
    return n, [tuple(np.array(s, np.uint32).reshape(-1, 2).T) for s in sets]


@given(bonded(), st.integers(1, 40))
def test_cuda_blocks_own_particles_and_half_bonds_once_and_in_order(model, threads):
    n, sets = model
    i, j = (np.concatenate([np.empty(0, np.uint32), *(s[side] for s in sets)]) for side in (0, 1))
    first, ends = own_bonds(i, j, n)
    owners, start, chunks = share_out(first, threads)
    assert owners[0] == 0
    assert owners[-1] == n
    particles, halves = np.diff(owners.astype(int)), np.diff(start.astype(int))
    assert (particles >= 1).all()
    assert (particles <= threads).all()
    assert ((halves <= threads) | (particles == 1)).all()
    assert np.array_equal(start, first[owners])  # contiguous: each half-bond once, in the order of the lists
    assert start[-1] == len(ends) == 2 * len(i)
    assert np.array_equal(chunks, np.maximum(1, np.ceil(halves / threads)))
    room = [first[min(b + 1, n)] - start[k] > threads or particles[k] == threads for k, b in enumerate(owners[1:-1])]
    assert all(room)  # greedy: no block could have taken the next particle too


@given(bonded())
def test_cuda_half_bonds_know_their_bonds(model):
    n, sets = model
    i, j = (np.concatenate([np.empty(0, np.uint32), *(s[side] for s in sets)]) for side in (0, 1))
    first, ends = own_bonds(i, j, n)
    found = half_bonds(ends, sets)
    places: dict[int, int] = {}
    for c in range(len(ends)):
        s, k, side = int(found.set[c]), int(found.bond[c]) >> 1, int(found.bond[c]) & 1
        assert sum(len(other[0]) for other in sets[:s]) + k == ends[c] >> 1
        assert side == ends[c] & 1
        assert (found.i[c], found.j[c]) == (sets[s][0][k], sets[s][1][k])
        assert first[sets[s][side][k]] <= c < first[sets[s][side][k] + 1]
        assert found.place[c] == places.setdefault(s, 0)
        places[s] += 1
