"""Binding: an engine's functions share the code of the originals, in words of their own, all the way down."""

from types import FunctionType

import numpy as np
import pytest
from engines.scenes import DT, LENGTH, cluster, families, loaded

import pybondem as bd
from pybondem import ops
from pybondem.assembly import Drag, assemble, energy_program, linear_program, step_program
from pybondem.engines.binding import bind
from pybondem.engines.cpu import WORDS as CPU_WORDS
from pybondem.engines.reference import WORDS, on_arrays
from pybondem.ops import absolute, sqrt, where
from pybondem.physics import frame, joint
from pybondem.physics.motion import global_drag, local_drag
from pybondem.physics.types import Pose, Reference, Stiffness

HALF = 0.5
ARRAYS = {ops.sqrt: np.sqrt, ops.where: np.where, ops.absolute: np.abs}


def root(a):
    return where(a > 0.0, sqrt(absolute(a)), 0.0)


def twice(a, *, factor=2.0):
    return factor * root(a) + HALF


def mean(a, b):
    return HALF * (root(a) + twice(b))


def keep(function):
    return function


def test_a_bound_function_shares_its_code_and_leaves_the_original_alone():
    bound = bind(mean, ARRAYS, keep, {})
    inner = bound.__globals__["twice"].__globals__["root"]
    assert bound is not mean
    assert (bound.__code__, inner.__code__) == (mean.__code__, root.__code__)
    assert (inner.__globals__["sqrt"], inner.__globals__["where"]) == (np.sqrt, np.where)
    assert (root.__globals__["sqrt"], root.__globals__["where"]) == (ops.sqrt, ops.where)
    assert bound.__globals__["HALF"] == HALF
    a, b = np.array([-1.0, 0.0, 2.0]), np.array([3.0, -4.0, 5.0])
    assert bound(a, b).tolist() == [mean(x, y) for x, y in zip(a.tolist(), b.tolist(), strict=True)]


def test_each_function_is_made_once():
    finished, made = [], {}
    bound = bind(mean, {}, lambda f: finished.append(f.__name__) or f, made)
    assert sorted(finished) == ["absolute", "mean", "root", "twice", "where"]
    assert bound.__globals__["root"] is bound.__globals__["twice"].__globals__["root"]
    assert bind(mean, {}, keep, made) is bound


def test_what_a_function_calls_is_finished_before_it():
    """A compiler must find compiled functions where the original had plain ones."""
    bound = bind(mean, {}, lambda f: ("finished", f), {})
    assert bound[1].__globals__["twice"][0] == "finished"


def test_closures_are_bound_too():
    def scaled(law):
        return lambda a: 3.0 * law(a)

    bound = bind(scaled(root), ARRAYS, keep, {})
    assert bound(np.array([-1.0, 4.0])).tolist() == [0.0, 6.0]


def test_defaults_go_along():
    """Of positional and of keyword-only parameters."""

    def law(a, power=2, *, shift=1.0):
        return a**power + shift

    bound = bind(law, {}, keep, {})
    assert (bound(3.0), bound(3.0, 1), bound(3.0, shift=0.0)) == (10.0, 4.0, 9.0)


def test_functions_within_a_function_know_their_words():
    def law(a):
        def inner(b):
            return where(b > HALF, twice(b), HALF)

        return sum(inner(a + k) for k in (0.0, 1.0))

    bound = bind(law, ARRAYS, keep, {})
    a = np.array([-3.0, 0.2, 4.0])
    assert bound(a).tolist() == [law(x) for x in a.tolist()]


# The package's own programs -------------------------------------------------------------------------------------


def bodies():
    """Every body of every program of a model with every kind of bond."""
    done = cluster(1, families()).build("interpreted").state
    drags = (None, Drag(local_drag, 0.3), Drag(global_drag, 10.0))
    programs = [step_program(done, (0.0, 0.0, 0.0), drag) for drag in drags]
    programs += [energy_program(done), linear_program(done)]
    return [stage.body for program in programs for stage in program.stages if stage.body is not None]


def within(function, seen):
    """Return all that a function uses, functions and words, all the way down."""
    for value in [*function.__globals__.values(), *(cell.cell_contents for cell in function.__closure__ or ())]:
        if callable(value) and value not in seen:
            seen.add(value)
            if isinstance(value, FunctionType):
                within(value, seen)
    return seen


def test_no_word_of_plain_python_is_left_in_a_bound_body():
    numpys = {word for word in CPU_WORDS if getattr(np, word.__name__, None) is word}  # which arrays know themselves
    assert set(CPU_WORDS) - numpys <= set(WORDS)
    for body in bodies():
        bound = on_arrays(body)
        assert bound.__code__ is body.__code__
        assert not within(bound, set()) & set(WORDS)


@pytest.mark.parametrize("element", [frame, joint])
def test_physics_on_arrays_has_the_bits_of_physics_on_numbers(element):
    scene = loaded(cluster(2, families()), 2)
    i, j = scene.pairs["joint"].T
    rng = np.random.default_rng(0)
    arrays = (
        Pose(tuple(scene.x[i].T), tuple(scene.q[i].T)),
        Pose(tuple(scene.x[j].T), tuple(scene.q[j].T)),
        Reference(tuple((scene.x0[j] - scene.x0[i]).T), tuple(scene.normals["joint"].T)),
        Stiffness(*rng.uniform(1e6, 2e6, (4, len(i)))),
    )

    def load(words, a, b, ref, k):
        bound = bind(element.load, words, keep, {})
        force, couple = bound(bind(frame.relative_pose, words, keep, {})(a, b), ref, k)
        return np.array([*force, *couple])

    together = load(WORDS, *arrays)
    for m in range(len(i)):
        one = [type(group)(*(pick(field, m) for field in group)) for group in arrays]
        assert np.array_equal(load({}, *one), together[:, m])


def pick(field, m):
    return tuple(float(c[m]) for c in field) if isinstance(field, tuple) else float(field[m])


def test_uniform_and_individual_parameters_give_the_same_bits(engine):
    """A far pair of its own stiffness, strength and size turns numbers into arrays; the rest must not feel it."""
    grid = bd.packing.fcc(diameter=LENGTH, inside=bd.Sphere(radius=1.2 * LENGTH)).x
    n = len(grid)
    x = np.concatenate([grid, [[40 * LENGTH, 0.0, 0.0], [41 * LENGTH, 0.0, 0.0]]])
    rng = np.random.default_rng(3)
    v, w = rng.normal(size=(n, 3)), 100.0 * rng.normal(size=(n, 3))
    found = []
    for other in (1.0, 1.001):
        radius = np.full(n + 2, 0.5 * LENGTH)
        radius[n:] *= other
        model = bd.Model(bd.packing.Particles(x, radius), density=2500.0)
        pairs = model.touching()
        own = np.where(pairs[:, 0] >= n, other, 1.0)
        elastic = bd.springs(kn=5e6 * own, ks=2e6 * own, kt=20.0 * own, kb=25.0 * own)
        law = bd.strength(tension=1e5 * own, shear=5e4 * own)
        bonds = model.bond(pairs, bd.Bond(elastic, law, damping=0.02))
        sim = bd.Simulation(model, engine=engine, dt=DT)
        assert np.ndim(sim.state.bonds["b0"]["kn"]) == np.ndim(sim.state.particles["mass"]) == (other != 1.0)
        with sim.edit("v", "w") as (vs, ws):
            vs[:n], ws[:n] = v, w
        sim.run(50, quiet=True)
        p, view = sim.particles, sim.bonds(bonds)
        state = [getattr(p, name)[:n] for name in ("x", "q", "v", "w", "force", "torque")]
        state += [getattr(view, name)[pairs[:, 0] < n] for name in ("damage", "energy", "lost", "damped")]
        found.append([np.ascontiguousarray(a).tobytes() for a in state])
        assert 0 < sim.broken < sim.bond_count
    assert found[0] == found[1]


def test_assembling_twice_gives_the_same_program():
    """Two models alike are one program: neither is compiled twice."""
    from pybondem.engines.cpu import fingerprint
    from pybondem.engines.loops import Loops

    def key():
        model = cluster(1, families()).build("interpreted").model
        return fingerprint(Loops(step_program(assemble(model), (0.0, 0.0, -9.81), None)))

    assert key() == key()
