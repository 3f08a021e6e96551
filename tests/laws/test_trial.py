"""Laws on trial: poses give the wanted deformation exactly, work is what it should be, paths and units are as said."""

import numpy as np
import pytest
from laws.planted import elastic, elastic_energy

from pybondem import laws
from pybondem.errors import InputError
from pybondem.laws import paths
from pybondem.laws.law import bond_law
from pybondem.laws.poses import Rigid, moved, random_axes, rotation, rotation_vector
from pybondem.laws.trial import Trial, single
from pybondem.laws.units import NONE, Dimension, dimension, in_units
from pybondem.ops import dot, rotate
from pybondem.physics import frame, joint
from pybondem.physics.types import Pose, Reference

LOCAL = paths.deformation(n=-2e-4, s=7e-4, t=-5e-4, twist=0.3, bend_s=-0.2, bend_t=0.1)


@bond_law(potential=lambda d, k: elastic_energy(d, k))
def spring(d, k):
    """Elastic."""
    return elastic(d, k)


def turned_round(seed: int) -> Rigid:
    draw = np.random.default_rng(seed)
    return Rigid(rotation(draw.uniform(-3.0, 3.0, (3, 1)))[:, 0], draw.uniform(-1.0, 1.0, 3), np.zeros(3))


@pytest.mark.parametrize(("element", "physics"), [("bond", frame), ("joint", joint)])
def test_poses_have_the_wanted_deformation(element, physics):
    trial = Trial(spring(), element, count=7)
    at = moved(trial.pose(LOCAL), turned_round(3))
    q, g = turned_round(3).rotation, trial.geometry
    for c in range(trial.count):
        i, j = (Pose(tuple(x[:, c]), tuple(r[:, c])) for x, r in ((at.x_i, at.q_i), (at.x_j, at.q_j)))
        rel = frame.relative_pose(i, j)
        found = physics.stretch(rel, Reference(tuple(g.chord[:, c]), tuple(g.axes[0][:, c])))
        n, s, t = (rotate(q[0], tuple(q[1:]), 2.0, tuple(axis[:, c])) for axis in g.axes)
        assert found.opening == pytest.approx(LOCAL[0], rel=1e-11)
        assert [dot(found.slip, a) for a in (n, s, t)] == pytest.approx([0.0, *LOCAL[1:3]], abs=1e-15)
        assert found.twist == pytest.approx(LOCAL[3], rel=1e-9)
        assert np.linalg.norm(found.bending) == pytest.approx(np.hypot(*LOCAL[4:]), rel=1e-9)
        if element == "bond":  # in a joint bending is across the chord, not the normal
            assert [dot(found.bending, a) for a in (n, s, t)] == pytest.approx([0.0, *LOCAL[4:]], abs=1e-10)


@pytest.mark.parametrize("element", ["bond", "joint"])
def test_work_is_the_energy_of_the_springs(element):
    trial = Trial(spring(), element, count=5)
    history = trial.follow(paths.monotone(LOCAL, 100))
    kn, ks, kt, kb, _ = trial.stiffness
    k = np.array([kn, ks, ks, kt, kb, kb])
    assert history.work[-1] == pytest.approx(0.5 * (k * LOCAL**2).sum(), rel=1e-4)
    assert np.abs(history.lost[-1]).max() < 1e-4 * history.work[-1].min()


def test_loads_of_a_history_are_along_the_axes_of_each_pair():
    trial = Trial(spring(), count=6, seed=2)
    small = 1e-6 * LOCAL
    kn, ks, kt, kb, _ = trial.stiffness
    load = trial.follow(paths.monotone(small, 1)).load[-1]
    expected = np.array([kn, ks, ks, kt, kb, kb]) * small
    assert load == pytest.approx(np.repeat(expected[:, None], 6, axis=1), rel=1e-6)


def test_memory_stays_from_call_to_call_until_reset():
    trial = Trial(laws.bilinear(1e-5, 4e-5), "joint", count=2)
    far, back = trial.pose(paths.deformation(s=[2e-5, 5e-5])), trial.pose(paths.deformation(s=[1e-6, 1e-6]))
    trial.evaluate(far)
    answer = trial.evaluate(back)
    assert answer.memory["largest"] == pytest.approx([2e-5, 5e-5], rel=1e-9)
    assert answer.damage == pytest.approx([4e-5 * 1e-5 / (2e-5 * 3e-5), 1.0], rel=1e-9)
    trial.reset()
    assert trial.evaluate(back).damage == pytest.approx([0.0, 0.0])


def test_exchanged_ends_are_the_same_bond():
    path = paths.wandering(np.abs(LOCAL), seed=1)
    one, other = (Trial(spring(), "joint", count=3, exchanged=e).follow(path) for e in (False, True))
    assert other.load == pytest.approx(one.load, rel=1e-12, abs=1e-12 * np.abs(one.load).max())
    assert np.abs(one.load).max() > 0.0


def test_trial_refuses_an_unknown_element():
    with pytest.raises(InputError, match=r"element of Trial is 'joints'.*did you mean 'joint'"):
        Trial(spring(), "joints")


def test_single_takes_the_median_of_arrays():
    law = single(laws.strength(tension=[4e6, 9e6, 5e6], shear=1e7))
    assert law.parameters.tension == 5e6
    assert law.parameters.shear == 1e7


def test_random_axes_are_right_handed_triads():
    axes = random_axes(50, seed=1)
    assert np.einsum("aic,bic->abc", axes, axes) == pytest.approx(
        np.repeat(np.eye(3)[..., None], 50, axis=2), abs=1e-14
    )
    assert np.linalg.det(axes.transpose(2, 0, 1)) == pytest.approx(np.ones(50))


def test_rotation_vector_undoes_rotation():
    vector = np.array([[0.3, 1e-9, 0.0], [-0.2, 0.0, 0.0], [2.0, 1e-9, 0.0]])
    identity = rotation(np.zeros((3, 3)))
    assert rotation_vector(identity, rotation(vector)) == pytest.approx(vector, rel=1e-12, abs=1e-24)


# Paths -----------------------------------------------------------------------------------------------------------


def test_cyclic_path_unloads_from_growing_peaks():
    path = paths.cyclic(paths.deformation(s=4.0), cycles=4, steps=5)
    assert path.shape == (41, 6)
    assert path[::5, 1].tolist() == [0.0, 1.0, 0.0, 2.0, 0.0, 3.0, 0.0, 4.0, 0.0]
    fro = paths.cyclic(paths.deformation(s=4.0), cycles=2, steps=5, back=-1.0)
    assert fro[::5, 1].tolist() == [0.0, 2.0, -2.0, 4.0, -4.0]


def test_reopened_path_presses_the_bond_together_on_its_way():
    path = paths.reopened(paths.deformation(n=2.0, s=1.0), closed=0.5, further=1.5, steps=4)
    assert path[::4, 0].tolist() == [0.0, 2.0, -1.0, 3.0]
    assert path[::4, 1].tolist() == [0.0, 1.0, 0.0, 1.5]


def test_mixed_path_keeps_its_angle():
    path = paths.mixed(np.radians(30.0), size=[1.0, 2.0], steps=10, about=np.radians(90.0))
    assert path.shape == (11, 6, 2)
    assert path[-1, 0] == pytest.approx([np.cos(np.pi / 6), 2.0 * np.cos(np.pi / 6)])
    assert path[-1, 2] == pytest.approx([0.5, 1.0])
    assert path[:, 1] == pytest.approx(np.zeros((11, 2)), abs=1e-15)


def test_random_paths_are_seeded_and_stay_inside():
    scale = np.abs(LOCAL)
    path = paths.wandering(scale, legs=5, steps=3, seed=4)
    assert np.array_equal(path, paths.wandering(scale, legs=5, steps=3, seed=4))
    assert not np.array_equal(path, paths.wandering(scale, legs=5, steps=3, seed=5))
    assert (np.abs(path) <= scale).all()
    closed = paths.closed(scale, seed=4)
    assert not closed[0].any()
    assert not closed[-1].any()
    assert closed.any()


def test_finer_path_goes_through_the_same_points():
    path = paths.wandering(np.abs(LOCAL), legs=3, steps=2)
    assert paths.finer(path, 4)[::4] == pytest.approx(path, rel=1e-15)


# Units -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("-", (0, 0, 0, 0)), ("1", (0, 0, 0, 0)), ("rad", (0, 0, 0, 0)), ("m", (1, 0, 0, 0)), ("1/m", (-1, 0, 0, 0)),
        ("Pa", (-1, 1, -2, 0)), ("MPa", (-1, 1, -2, 0)), ("Pa/m", (-2, 1, -2, 0)), ("J/m2", (0, 1, -2, 0)),
        ("N m/rad", (2, 1, -2, 0)), ("N s/m", (0, 1, -1, 0)), ("1/K", (0, 0, 0, -1)), ("kg/m3", (-3, 1, 0, 0)),
        ("Pa m0.5", (-0.5, 1, -2, 0)), ("Pa*m^0.5", (-0.5, 1, -2, 0)), ("kg m-1 s-2", (-1, 1, -2, 0)),
        ("mm", (1, 0, 0, 0)), ("J/(kg K)", (2, 0, -2, -1)),
        ("m/s/s", (1, 0, -2, 0)), ("W/m**2", (0, 1, -3, 0)), ("Hz", (0, 0, -1, 0)),
    ],
)  # fmt: skip
def test_units_are_read(unit, powers):
    assert dimension(unit) == Dimension(*powers)


@pytest.mark.parametrize("unit", ["furlong", "Pa_m", "kgf", "m?"])
def test_unknown_units_are_named(unit):
    with pytest.raises(InputError, match="is not known"):
        dimension(unit)


def test_dimensions_in_words():
    assert in_units(dimension("N/m2")) == "Pa"
    assert in_units(NONE) == "-"
    assert in_units(dimension("kg2 m/s")) == "m kg2 s-1"


def test_a_number_grows_with_its_dimension():
    factors = Dimension(length=1e3, mass=1e-3, time=1.0, temperature=1.0)  # millimetres and tonnes
    assert dimension("Pa").scaled(factors) == pytest.approx(1e-6)  # 1 Pa is 1e-6 N/mm2
