"""Bad input through the public interface, fault by fault.

Every fault must raise an error of the package that names the object, the index, the value and what is allowed, before
the first step, and must leave the model as it was. What is only doubtful warns and says why.
"""

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pybondem as bd

nan, inf, TINY = float("nan"), float("inf"), 5e-324
GLUE = bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0))
GROUT = bd.Joint(bd.bilinear(slip_peak=1e-4, slip_end=4e-4, stiffness=6e7))


def rod() -> bd.Model:
    """Five spheres of 10 mm in a row, parts "rod" (4) and "cap" (1); two bonds made, the first sphere held."""
    model = bd.Model(bd.packing.line(4, spacing=1e-2, diameter=1e-2), density=2500.0, name="rod")
    model.add(bd.packing.line(1, start=(4e-2, 0.0, 0.0), spacing=1e-2, diameter=1e-2), name="cap", density=8000.0)
    model.bond([[0, 1], [1, 2]], GLUE)
    model.fix(model.select([0]), "x y")
    return model


def trace(model: bd.Model) -> list[Any]:
    """Return all that a model is made of, in bytes and names."""
    arrays = [model.x, model.radius, model.density, model.part_of, *(b.pairs for b in model.bonds)]
    conditions = [(c.kind, c.indices.tolist(), c.schedules) for c in model.boundaries.conditions]
    return [*(a.tobytes() for a in arrays), list(model.parts), [b.bond for b in model.bonds], conditions]


def assert_refused(do: Callable[[bd.Model], Any], says: str, error: type[Exception] = bd.InputError) -> None:
    """Hold that do(model) raises an error of the package that says so, and that the model is as it was."""
    model = rod()
    before = trace(model)
    with pytest.raises(error, match=says) as caught:
        do(model)
    assert isinstance(caught.value, bd.BondemError)
    assert trace(model) == before
    model.bond([[2, 3]], GLUE)  # and it goes on working
    bd.Simulation(model, engine="interpreted").run(2, quiet=True)


def spheres(x: Any = ((0, 0, 0), (1, 0, 0)), radius: Any = 0.5) -> bd.packing.Particles:
    return bd.packing.Particles(x, radius)


def row(*cases: tuple[Callable[[bd.Model], Any], str]) -> Any:
    return pytest.mark.parametrize(("do", "says"), cases, ids=[re.sub(r"[\\^$]", "", says)[:50] for _, says in cases])


# Numbers that are none ------------------------------------------------------------------------------------------


@row(
    (lambda m: spheres([[0, 0, nan], [nan, 0, 0]]), r"^x of Particles\[0, 2\] is nan, not finite \(2 such values"),
    (lambda m: spheres([[0, 0, 0], [0, -inf, 0]]), r"^x of Particles\[1, 1\] is -inf, not finite"),
    (lambda m: spheres(radius=[0.5, nan]), r"^radius of Particles\[1\] is nan, not finite"),
    (lambda m: spheres(radius=inf), r"^radius of Particles is inf m; it must be finite"),
    (lambda m: m.drive(m.part("cap"), vx=nan), r"^vx of drive is nan; it must be finite"),
    (lambda m: m.push(m.part("cap"), tz=-inf), r"^tz of push is -inf; it must be finite"),
    (lambda m: m.push(m.part("cap"), fx=bd.table([0, nan], [0, 1])), r"^times of table\[1\] is nan, not finite"),
    (lambda m: bd.ramp(to=nan, over=1.0), r"^to of ramp is nan; it must be finite"),
    (lambda m: start(m, gravity=(0, 0, nan)), r"^gravity\[2\] is nan, not finite"),
    (lambda m: m.where(x=(nan, 1.0)), r"^x of where is \(nan, 1\)"),
    (lambda m: m.touching(gap=nan), r"^gap of touching is nan"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[[1, nan, 0]], area=1e-4), r"^normal of join\[0, 1\] is nan"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[[1, 0, 0]], area=nan), r"^area of join(\[0\])? is nan"),
)
def test_no_number(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@pytest.mark.parametrize("name", ["x", "v", "w", "q"])
def test_no_number_in_an_edited_field(name: str) -> None:
    """The error names field, first index and count, and the state stays as it was."""
    sim = bd.Simulation(rod(), engine="interpreted")
    before = getattr(sim.particles, name)

    def spoil() -> None:
        with sim.edit(name) as values:
            values[1, 2] = nan
            values[3, 0] = inf

    with pytest.raises(bd.InputError, match=rf"^{name}\[1, 2\] is nan, not finite \(2 such values in all\)"):
        spoil()
    assert np.array_equal(getattr(sim.particles, name), before)


@row(
    (lambda m: spheres(radius=[0.5, 0.0]), r"^radius of Particles\[1\] is 0.0 m; it must be positive"),
    (lambda m: spheres(radius=[-2.0, 0.5]), r"^radius of Particles\[0\] is -2.0 m; it must be positive"),
    (lambda m: spheres(radius=TINY), r"^radius of Particles is 5e-324 m; it must be positive and at least"),
    (lambda m: spheres(radius=[0.5, TINY]), r"^radius of Particles\[1\] is 5e-324 m; it must be positive and at least"),
)
def test_radius(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@row(
    (lambda m: m.add(spheres(), "new", density=0.0), r"^density of part 'new' is 0.0 kg/m3; it must be positive"),
    (lambda m: m.add(spheres(), "new", density=-1.0), r"^density of part 'new' is -1.0 kg/m3; it must be positive"),
    (lambda m: m.add(spheres(), "new", density=TINY), r"^density of part 'new' is 5e-324 kg/m3; it must be positive"),
    (lambda m: bd.Model(spheres()), r"^Model needs a density"),
    # so small that the mass, or only the moment of inertia, is no normal double any more
    (lambda m: m.add(spheres(radius=[0.5, 1e-110]), "new", density=1.0), r"particle 1 of part 'new', .* mass of 0"),
    (lambda m: m.add(spheres(radius=[0.5, 1e-70]), "new", density=1.0), r"particle 1 of part 'new', .* inertia of 0"),
    (lambda m: m.add(spheres(radius=1e110), "new", density=1.0), r"particle 0 of part 'new', .* mass of inf"),
)
def test_mass(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@row(
    (lambda m: bd.parallel(E=-1.0, stiffness_ratio=2.0), r"^E of parallel is -1.0 Pa; it must be positive"),
    (lambda m: bd.parallel(E=1.0, stiffness_ratio=0.0), r"^stiffness_ratio of parallel is 0.0; it must be positive"),
    (lambda m: bd.parallel(E=1.0, stiffness_ratio=1.0, radius_ratio=-1.0), r"^radius_ratio.* is -1.0; it must be"),
    (lambda m: bd.timoshenko(E=1.0, nu=0.6), r"^nu of timoshenko is 0.6; it must lie between -1 and 0.5"),
    (lambda m: bd.timoshenko(E=1.0, nu=-1.0), r"^nu of timoshenko is -1; it must be above -1"),
    (lambda m: bd.timoshenko(E=1.0, nu=0.2, shear_factor=0.0), r"^shear_factor of timoshenko is 0.0; it must be pos"),
    (lambda m: bd.euler_bernoulli(E=0.0, nu=0.2), r"^E of euler_bernoulli is 0.0 Pa; it must be positive"),
    (lambda m: bd.springs(kn=-1.0, ks=1.0), r"^kn of springs is -1.0 N/m; it must not be negative"),
    (lambda m: bd.springs(kn=1.0, ks=[1.0, -2.0]), r"^ks(\[1\])? of springs(\[1\])? is -2"),
    (lambda m: bd.springs(kn=1.0, ks=1.0, kb=nan), r"^kb of springs is nan N m/rad; it must be finite"),
    (lambda m: bd.strength(tension=-1.0, shear=1.0), r"^tension of strength is -1 Pa; it must be positive"),
    (lambda m: bd.strength(tension=1.0, shear=[1.0, 0.0]), r"^shear of strength\[1\] is 0.* Pa; it must be positive"),
    (
        lambda m: bd.strength(tension=1.0, shear=1.0, moment_share=1.5),
        r"^moment_share of strength is 1.5; it must be between 0 and 1",
    ),
    (
        lambda m: bd.bilinear(slip_peak=2.0, slip_end=1.0),
        r"^bilinear needs slip_end > slip_peak; the values are slip_peak = 2, slip_end = 1",
    ),
    (
        lambda m: bd.bilinear(slip_peak=[1.0, 3.0], slip_end=2.0),
        r"^bilinear needs slip_end > slip_peak; the values of bond 1 are slip_peak = 3, slip_end = 2",
    ),
    (
        lambda m: bd.bilinear(slip_peak=[1, 1], slip_end=[2, 2, 2]),
        r"^the parameters of bilinear have .*slip_peak 2 and slip_end 3",
    ),
    (lambda m: bd.bilinear(slip_peak=1.0, slip_end=2.0, stiffness=0.0), r"^stiffness of bilinear is 0.0 Pa/m"),
    (lambda m: bd.Bond(bd.parallel(1.0, 1.0), damping=-0.1), r"^damping of Bond is -0.1; it must not be negative"),
    (lambda m: bd.Joint(GROUT.law, damping=-0.1), r"^damping of Joint is -0.1; it must not be negative"),
    (lambda m: bd.Joint(GROUT.law, normal_stiffness=-1.0), r"^normal_stiffness of Joint is -1.0 Pa/m; it must not be"),
    (lambda m: bd.Joint(bd.strength(1.0, 1.0)), r"^Joint needs a law with a stiffness per area"),
    (lambda m: bd.Bond("glue"), r"^Bond needs an elastic form .*'glue'"),
    (lambda m: bd.Bond(bd.parallel(1.0, 1.0), "strong"), r"^the law of Bond is 'strong'; give a law with its values"),
    (lambda m: bd.local(1.0), r"^alpha of local damping is 1.0; it must lie between 0 and"),
    (lambda m: bd.local(-0.1), r"^alpha of local damping is -0.1; it must lie between 0 and"),
    (lambda m: bd.viscous(-1.0), r"^rate of viscous damping is -1.0 1/s; it must not be negative"),
    (lambda m: bd.kinetic(0), r"^every of kinetic damping is 0; it must be at least 1"),
    (lambda m: start(m, damping=0.2), r"^damping is 0.2; give local"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[[1, 0, 0]], area=-1e-4), r"^area(\[0\])? of join(\[0\])? is -0.0001 m2"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[[0, 0, 0]], area=1e-4), r"^normal(\[0\])? of join(\[0\])? is"),
)
def test_constants_out_of_range(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


# Bonds ----------------------------------------------------------------------------------------------------------


@row(
    (lambda m: m.bond([[2, 3], [3, 3]], GLUE), r"^bond 1 joins particle 3 with itself"),
    (lambda m: m.join([[3, 3]], GROUT, normal=[[1, 0, 0]], area=1e-4), r"^bond 0 joins particle 3 with itself"),
)
def test_a_bond_of_a_particle_with_itself(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@row(
    (lambda m: m.bond([[2, 3], [3, 2]], GLUE), r"^particles 2 and 3 are bonded twice"),
    (lambda m: m.bond([[2, 3], [1, 0]], GLUE), r"^particles 0 and 1 are bonded twice"),
    (lambda m: m.join([[2, 1]], GROUT, normal=[[1, 0, 0]], area=1e-4), r"^particles 1 and 2 are bonded twice"),
)
def test_a_pair_bonded_twice(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@row(
    (lambda m: m.bond([[2, 3], [3, 5]], GLUE), r"^bond 1 names particle 5; indices run from 0 to 4"),
    (lambda m: m.bond([[-1, 3]], GLUE), r"^bond 0 names particle -1; indices run from 0 to 4"),
    (lambda m: m.bond([[2.0, 3.0]], GLUE), r"^bond indices have type float64; they must be whole numbers"),
    (lambda m: m.bond([[True, False]], GLUE), r"^bond indices have type bool"),
    (lambda m: m.bond(np.array([[2, 2**63]], np.uint64), GLUE), r"^bond 0 names particle 9223372036854775808"),
    (lambda m: m.bond([2, 3], GLUE), r"^bond pairs have shape \(2,\); it must be \(m, 2\)"),
    (lambda m: m.bond([[2, 3, 4]], GLUE), r"^bond pairs have shape \(1, 3\); it must be \(m, 2\)"),
    (lambda m: m.bond([[2, 3], [4]], GLUE), r"^bond pairs has rows of different lengths"),
    (lambda m: m.bond([[2, 3]], GROUT), r"^bond needs a Bond, got Joint; joints go to Model.join"),
    (lambda m: m.join([[2, 3]], GLUE, normal=[[1, 0, 0]], area=1.0), r"^join needs a Joint, got Bond"),
    (lambda m: m.select([0, 5]), r"^selection 1 names particle 5; indices run from 0 to 4"),
    (lambda m: m.select([-1]), r"^selection 0 names particle -1"),
    (lambda m: m.select([0.0]), r"^selection indices have type float64"),
)
def test_an_index_that_is_none(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


def add_on_top(m: bd.Model) -> None:
    m.add(spheres([[9e-2, 0, 0], [3e-2, 0, 0]], radius=5e-3), "top", density=2500.0)


def test_a_bond_without_length() -> None:
    """Of spheres all but at the same place: refused where they are placed or, at the latest, where bonded."""

    def make() -> None:
        model = bd.Model(spheres([[0, 0, 0], [1e-12, 0, 0], [1, 0, 0]]), density=1.0)
        model.bond([[1, 2], [1, 0]], GLUE)

    with pytest.raises(bd.InputError, match=r"(particle 1|\[1, 0\]).* at the same place"):
        make()


def test_a_bond_much_longer_or_shorter_than_its_spheres_warns_of_the_ratio() -> None:
    model = bd.Model(spheres([[0, 0, 0], [1, 0, 0], [2.5, 0, 0], [2.9, 0, 0]]), density=1.0)
    with pytest.warns(UserWarning, match=r"bond 0 is 2.5 times as long as Ri \+ Rj of particles \[0, 2\]"):
        model.bond([[0, 2], [0, 1]], GLUE)
    with pytest.warns(UserWarning, match=r"bond 0 is 0.4 times as long as Ri \+ Rj of particles \[2, 3\]"):
        model.bond([[2, 3]], GLUE)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.bond([[1, 2]], GLUE)  # 1.5 times is no cause for alarm
    assert [len(b.pairs) for b in model.bonds] == [2, 1, 1]


@row(
    (add_on_top, r"particle 1 of part 'top' is at the same place as particle 3"),
    (
        lambda m: m.add(spheres([[1, 1, 1], [2, 2, 2], [1, 1, 1]]), "twins", density=1.0),
        r"particle 2 of part 'twins' is at the same place as .*particle 0",
    ),
    (
        lambda m: bd.Model(spheres([[0, 0, 0], [0, 0, 0]]), density=1.0),
        r"particle 1 of part 'body' is at the same place as .*particle 0",
    ),
)
def test_two_spheres_at_the_same_place(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


def test_no_bonds_made_is_said() -> None:
    model = rod()
    with pytest.warns(UserWarning, match=r"no bonds were made: there are no pairs"):
        model.bond(model.touching(between=("rod", "cap"), gap=0.0)[:0], GLUE)


# Steps ----------------------------------------------------------------------------------------------------------


def test_a_step_above_the_critical_one_names_the_step_and_a_particle_that_sets_it() -> None:
    """Particles 2 and 3 share the one bond that is a hundred times stiffer."""
    model = rod()
    model.bond([[2, 3]], bd.Bond(bd.parallel(E=1e11, stiffness_ratio=2.0)))
    critical = bd.Simulation(model, engine="interpreted").limit.dt
    with pytest.raises(bd.UnstableError, match=r"^dt is .* above the critical step") as caught:
        bd.Simulation(model, engine="interpreted", dt=1.01 * critical)
    assert f"{1.01 * critical:.4g} s" in str(caught.value)
    assert f"{critical:.4g} s" in str(caught.value)
    assert re.search(r"particle (2|3)[;,]", str(caught.value))
    assert bd.Simulation(model, engine="interpreted", dt=0.99 * critical).dt == 0.99 * critical


@row(
    (lambda m: start(m, dt=0.0), r"^dt is 0.0 s; it must be positive"),
    (lambda m: start(m, dt=-1e-6), r"^dt is -1e-06 s; it must be positive"),
    (lambda m: start(m, dt=nan), r"^dt is nan s; it must be finite"),
    (lambda m: start(m, dt="1e-6"), r"^dt is '1e-6'; it must be a number"),
    (lambda m: start(m, safety=0.0), r"^safety is 0.0; it must lie between"),
    (lambda m: start(m, safety=1.5), r"^safety is 1.5; it must lie between"),
    (lambda m: start(m).run(-1, quiet=True), r"^steps is -1; it must be at least 0"),
    (lambda m: start(m).run(1.5, quiet=True), r"^steps is 1.5; it must be a whole number"),
    (lambda m: start(m).run(True, quiet=True), r"^steps is True; it must be a whole number"),
    (lambda m: start(m).run(time=-1.0, quiet=True), r"^time is -1.0 s; it must not be negative"),
    (lambda m: start(m).run(time=inf, quiet=True), r"^time is inf s; it must be finite"),
    (lambda m: start(m).run(quiet=True), r"^run needs steps, or time"),
    (lambda m: start(m).run(1, time=1.0, quiet=True), r"^run needs steps, or time"),
    (lambda m: start(m).run(until=lambda: True, quiet=True), r"^run\(until=...\) looks at its condition after every"),
    (lambda m: start(m).record(every=0), r"^every of record is 0; it must be at least 1"),
    (lambda m: start(m).record(every=2.5), r"^every of record is 2.5; it must be a whole number"),
    (lambda m: start(m).record(every=1, force=3.0), r"^record was given force=3.0; give a measure"),
)
def test_steps_and_times(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


def start(model: bd.Model, **options: Any) -> bd.Simulation:
    return bd.Simulation(model, engine="interpreted", **options)


# Selections and names -------------------------------------------------------------------------------------------


def nobody(m: bd.Model) -> bd.Selection:
    return m.part("rod") & m.part("cap")


@row(
    (lambda m: m.fix(nobody(m)), r"^fix was given <\(rod & cap\): 0 particles>; the selection is empty"),
    (lambda m: m.drive(nobody(m), vx=1.0), r"^drive was given .*; the selection is empty"),
    (lambda m: m.push(nobody(m), fx=1.0), r"^push was given .*; the selection is empty"),
    (lambda m: bd.reaction(nobody(m), "x"), r"^reaction was given .*; the selection is empty"),
    (lambda m: bd.displacement(nobody(m), "x"), r"^displacement was given .*; the selection is empty"),
    (lambda m: bd.strain(m.part("rod"), nobody(m), "x"), r"^strain was given .*; the selection is empty"),
    (lambda m: bd.stress(nobody(m), "x", 1.0), r"^reaction was given .*; the selection is empty"),
    (lambda m: m.select([]), r"^the selection is empty"),
    (lambda m: m.select(np.zeros(5, bool)), r"^the selection is empty"),
    (lambda m: m.where(x=(1.0, 2.0)), r"^no particle lies within x in \(1, 2\) m; the model spans x from 0 to 0.04 m"),
)
def test_an_empty_selection_is_never_everything(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says, bd.SelectionError)


@row(
    (lambda m: m.part("rood"), r"^no part is named 'rood' \(did you mean 'rod'\?\)"),
    (lambda m: m.where(part="cpa"), r"^no part is named 'cpa' \(did you mean 'cap'\?\)"),
    (lambda m: m.touching(part="rot"), r"^no part is named 'rot' \(did you mean 'rod'\?\)"),
    (lambda m: m.touching(between=("rod", "cup")), r"^no part is named 'cup' \(did you mean 'cap'\?\)"),
    (lambda m: m.part("fibre"), r"^no part is named 'fibre'; the parts are: 'rod', 'cap'"),
    (lambda m: m.add(spheres(), "rod", density=1.0), r"^part 'rod' is there already"),
    (
        lambda m: m.fix(m.part("cap"), "x q"),
        r"^component of fix is 'q'; it must be one of 'x', 'y', 'z', 'rx'",
    ),
    (lambda m: m.fix(m.part("cap"), ""), r"^fix was given no component"),
    (lambda m: m.drive(m.part("cap")), r"^drive was given no component"),
    (lambda m: m.fix("cap"), r"^fix needs a Selection"),
    (lambda m: m.drive([4], vx=1.0), r"^drive needs a Selection"),
    (lambda m: m.drive(m.part("cap"), vx="fast"), r"^vx of drive is 'fast'; give a number or one of ramp"),
    (lambda m: bd.reaction(m.part("cap"), "w"), r"^axis is 'w'; it must be one of 'x', 'y', 'z'"),
    (lambda m: bd.Simulation(m, engine="referense"), r"^engine is 'referense'; .*did you mean 'reference'\?"),
    (lambda m: start(m).record(every=1, time=bd.broken()), r"reserved column 'time'"),
    (lambda m: edit(m, "velocity"), r"^field to edit is 'velocity'; it must be one of 'x', 'q', 'v', 'w'"),
    (lambda m: start(m).bonds(rod().bonds[0]), r"^these bonds are not of this model"),
    (lambda m: m.fix(other_model().select([7])), r"^fix was given <selection: 1 particles> of another model"),
    (lambda m: m.push(other_model().select([0, 7]), fx=1.0), r"^push was given .* of another model: this one has 5"),
    (lambda m: m.where(x=5.0), r"^x of where is 5.0; give \(low, high\)"),
    (lambda m: m.where(x=(2.0, 1.0)), r"^x of where is \(2, 1\); low must not exceed high"),
    (lambda m: m.where(x=("a", 1.0)), r"^x of where is \('a', 1.0\); give \(low, high\) in metres"),
    (lambda m: m.where(inside="box"), r"^inside of where is 'box'; .*shape"),
    (lambda m: m.touching(gap=-0.1), r"^gap of touching is -0.1"),
    (lambda m: m.touching(gap="near"), r"^gap of touching is 'near'"),
    (lambda m: bd.Simulation("rod"), r"^Simulation needs a Model, got str"),
    (lambda m: bd.Simulation(m, threads=1.5), r"^threads is 1.5"),
)
def test_names_and_kinds(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


def other_model() -> bd.Model:
    return bd.Model(bd.packing.line(8, spacing=1.0, diameter=1.0), density=1.0)


def edit(model: bd.Model, name: str) -> None:
    with start(model).edit(name):
        pass


@pytest.mark.parametrize("threads", [0, -1, 10_000])
def test_threads(threads: int) -> None:
    with pytest.raises(bd.EngineError, match=rf"^threads is {threads}; this machine allows 1 to \d+"):
        bd.Simulation(rod(), threads=threads)


@row(
    (lambda m: m.drive(m.part("rod"), vx=1.0), r"^drive contradicts fix: both set component x of particle 0"),
    (lambda m: m.fix(m.select([0]), "y"), r"^fix contradicts fix: both set component y of particle 0"),
    (lambda m: m.push(m.select([0, 1]), fy=1.0), r"^push contradicts fix: both set component y of particle 0"),
)
def test_contradictions(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says, bd.SelectionError)


def test_what_does_not_contradict() -> None:
    """Other components, other particles, and pushes, which add up."""
    model = rod()
    model.fix(model.select([0]), "z")
    model.drive(model.select([0]), wx=1.0)
    model.drive(model.select([1]), vx=1.0)
    model.push(model.select([2]), fx=1.0)
    model.push(model.select([2]), fx=2.0)
    sim = bd.Simulation(model, engine="interpreted")
    assert sim.particles.force[2].tolist() == [3.0, 0.0, 0.0]


# Arrays ---------------------------------------------------------------------------------------------------------


@row(
    (lambda m: spheres(radius=[1.0, 1.0, 1.0]), r"^Particles got 2 centres and 3 radii"),
    (lambda m: spheres([[0, 0], [1, 0]]), r"^x of Particles has shape \(2, 2\); it must be \(n, 3\)"),
    (lambda m: spheres([0, 0, 0]), r"^x of Particles has shape \(3,\); it must be \(n, 3\)"),
    (lambda m: spheres([[0, 0, 0], [1, 0]]), r"^x of Particles has rows of different lengths"),
    (lambda m: spheres(radius=[[0.5, 0.5]]), r"^radius of Particles has shape \(1, 2\); it must be \(n,\)"),
    (lambda m: spheres([[2**53 + 1, 0, 0]]), r"^x of Particles\[0, 0\] is 9007199254740993, beyond 2\^53"),
    (lambda m: m.select([True, False]), r"^the mask has shape \(2,\); it must be \(5,\)"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[1, 0, 0], area=1.0), r"^normal of join has shape \(3,\); it must be"),
    (lambda m: m.join([[2, 3]], GROUT, normal=[[1, 0, 0]], area=[1.0, 2.0]), r"^area of join has shape \(2,\)"),
    (lambda m: bd.table([0, 1], [0, 1, 2]), r"^table needs as many values as times; got 2 times and 3 values"),
    (lambda m: bd.table([0, 1, 1], [0, 1, 2]), r"^times of table must increase; times\[2\] = 1 s follows 1 s"),
    (lambda m: bd.springs(kn=[[1.0]], ks=1.0), r"^kn of springs has shape \(1, 1\); it must be \(n,\)"),
    (lambda m: start(m, gravity=(0, 0)), r"^gravity has shape \(2,\); it must be \(3,\)"),
    (lambda m: start(m, gravity=9.81), r"^gravity has shape \(\); it must be \(3,\)"),
)
def test_shapes(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


@pytest.mark.parametrize(
    ("bond", "says"),
    [
        (bd.Bond(bd.springs(kn=[1e6, 1e6, 1e6], ks=1e6)), r"^kn has 3 values; give one number or one per bond \(2\)"),
        (
            bd.Bond(bd.springs(1e6, 1e6), bd.strength([1e6, 2e6, 3e6], 1e6)),
            r"^tension has 3 values; give one number or one",
        ),
        (bd.Bond(bd.springs(1e6, 1e6), bd.bilinear([1e-4] * 4, 4e-4)), r"^slip_peak has 4 values; give one number"),
    ],
)
def test_values_per_bond_are_counted_before_the_first_step(bond: bd.Bond, says: str) -> None:
    model = bd.Model(bd.packing.line(3, spacing=1e-2, diameter=1e-2), density=2500.0)
    model.bond(model.touching(), bond)
    with pytest.raises(bd.InputError, match=says):
        bd.Simulation(model, engine="interpreted")


X = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [3.0, 5.0, 4.0]])


def frozen(a: np.ndarray) -> np.ndarray:
    a.flags.writeable = False
    return a


@pytest.mark.parametrize(
    ("x", "pairs"),
    [
        (X.astype(np.float32), np.array([[0, 1], [1, 2]], np.uint8)),
        (X.astype(np.int16), [[0, 1], [1, 2]]),
        (np.asfortranarray(X), np.asfortranarray([[0, 1], [1, 2]])),
        (frozen(X.copy()), frozen(np.array([[0, 1], [1, 2]]))),
        (np.repeat(X, 2, axis=0)[::2], np.array([[0, 9, 1, 9], [1, 9, 2, 9]])[:, ::2]),
        (X.astype(">f8"), np.array([[0, 1], [1, 2]], ">i4")),
        (X.tolist(), ((0, 1), (1, 2))),
    ],
    ids=["narrow", "whole", "Fortran order", "read-only", "strided", "big-endian", "lists"],
)
def test_what_can_be_taken_over_exactly_is(x: Any, pairs: Any) -> None:
    found = []
    for places, ends in ((x, pairs), (X, np.array([[0, 1], [1, 2]]))):
        model = bd.Model(bd.packing.Particles(places, np.float32(2.0)), density=np.int64(1))
        model.bond(ends, GLUE)
        sim = bd.Simulation(model, engine="interpreted")
        with sim.edit("v") as v:
            v[0] = 1.0
        p = sim.run(3, quiet=True).particles
        assert p.x.dtype == np.float64
        found.append([p.x.tobytes(), p.v.tobytes(), p.force.tobytes(), model.bonds[0].pairs.tobytes()])
    assert found[0] == found[1]


def test_what_is_given_is_copied() -> None:
    x, pairs = X.copy(), np.array([[0, 1], [1, 2]])
    model = bd.Model(bd.packing.Particles(x, 2.0), density=1.0)
    model.bond(pairs, GLUE)
    x[:], pairs[:] = 7.0, 0
    assert model.x.tolist() == X.tolist()
    assert model.bonds[0].pairs.tolist() == [[0, 1], [1, 2]]


masked = np.ma.masked_array


class Frame:
    """Stands for a data frame: an object that turns into an array, a missing value into nan."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.array([[0.0, 0.0, 0.0], [1.0, nan, 0.0]])


@row(
    (lambda m: spheres(np.array([[0, 0, 0], [1, None, 0]], object)), r"^x of Particles has dtype object; it must hold"),
    (lambda m: spheres(np.array([[0, 0, 0]], object)), r"^x of Particles has dtype object; it must hold real numbers"),
    (lambda m: spheres(masked(X, X > 4)), r"^x of Particles is a masked array; fill or drop"),
    (lambda m: spheres(radius=masked([1.0, 1.0], [0, 1])), r"^radius of Particles is a masked array"),
    (lambda m: spheres([["0", "0", "0"]]), r"^x of Particles has dtype <U1; it must hold real numbers"),
    (lambda m: spheres(1j * X), r"^x of Particles has dtype complex128; it must hold real numbers"),
    (lambda m: spheres(X > 0), r"^x of Particles has dtype bool; it must hold real numbers"),
    (lambda m: spheres(Frame()), r"^x of Particles\[1, 1\] is nan, not finite"),
    (lambda m: m.bond(np.array([[2, 3]], object), GLUE), r"^bond indices have type object"),
    (lambda m: m.bond(masked([[2, 3], [3, 4]], [[0, 0], [1, 1]]), GLUE), r"^bond .*masked array"),
    (lambda m: m.select(masked([0, 1], [0, 1])), r"^selection .*masked array"),
    (lambda m: m.select(["0"]), r"^selection indices have type"),
    (lambda m: bd.springs(kn=masked([1.0, 2.0], [0, 1]), ks=1.0), r"^kn of springs is a masked array"),
    (lambda m: bd.strength(tension=np.array([1, 2], object), shear=1.0), r"^tension of strength has dtype object"),
    (lambda m: bd.table(masked([0.0, 1.0], [0, 1]), [0.0, 1.0]), r"^times of table is a masked array"),
    (
        lambda m: m.join([[2, 3]], GROUT, normal=masked([[1.0, 0, 0]], True), area=1.0),
        r"^normal of join is a masked array",
    ),
)
def test_arrays_that_hold_no_numbers(do: Callable[[bd.Model], Any], says: str) -> None:
    assert_refused(do, says)


# Next to nothing ------------------------------------------------------------------------------------------------


def test_no_particles(engine: str) -> None:
    with pytest.raises(bd.InputError, match=r"^the model has no particles"):
        bd.Simulation(bd.Model(), engine=engine)
    with pytest.raises(bd.InputError, match=r"^x of Particles is empty"):
        spheres(np.empty((0, 3)))
    with pytest.raises(bd.SelectionError, match=r"^no part is named 'rod'; the parts are: none"):
        bd.Model().part("rod")
    with pytest.raises(bd.SelectionError, match=r"^no particle lies within"):
        bd.Model().where(x=(0, 1))
    assert bd.Model().touching().shape == (0, 2)


def test_one_free_particle_falls(engine: str) -> None:
    """x = g t^2/2 and v = g t hold in the discrete motion too; every view of no bonds is empty or zero."""
    model = bd.Model(spheres([[1.0, 2.0, 3.0]]), density=1000.0)
    sim = bd.Simulation(model, engine=engine, dt=1e-3, gravity=(0.0, 0.0, -10.0))
    sim.run(500, quiet=True)
    assert sim.particles.x[0] == pytest.approx([1.0, 2.0, 3.0 - 0.5 * 10.0 * 0.25], rel=1e-12)
    assert sim.particles.v[0] == pytest.approx([0.0, 0.0, -5.0], rel=1e-12)
    assert (sim.bond_count, sim.broken, sim.unbalanced) == (0, 0, 0.0)
    assert abs(sim.energies.residual) <= 1e-12 * sim.energies.kinetic
    assert np.isinf(sim.limit.dt)


def test_particles_without_bonds_fly_apart(engine: str) -> None:
    sim = bd.Simulation(bd.Model(spheres(), density=1.0), engine=engine, dt=1e-2)
    with sim.edit("v") as v:
        v[:] = [[0.0, 1.0, 0.0], [0.0, 0.0, -2.0]]
    sim.run(100, quiet=True)
    assert sim.particles.x == pytest.approx(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, -2.0]]), rel=1e-12)
    assert sim.energies.kinetic == pytest.approx(0.5 * model_mass() * 5.0, rel=1e-12)


def model_mass() -> float:
    return 4.0 / 3.0 * np.pi * 0.5**3
