"""Figure 1: it times what it says, on forces that are equal, and shows what others have measured."""

import csv
import json
import types
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pybondem as bd
from pybondem.assembly import assemble
from pybondem.engines.choose import make_engine, usable_engines
from pybondem.errors import InputError
from pybondem.paper import Effort, speed, speed_pictures, speed_timing
from pybondem.paper.speed_cylinder import DT, Stepper, cylinder, into_records, shake
from pybondem.paper.speed_gpu import committed
from pybondem.paper.speed_timing import Point, Way, apart, free_memory, measure, sampled, timed, too_large, ways

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
GPU = "Made-up GPU"


@pytest.fixture(scope="module")
def small() -> bd.Model:
    return cylinder(150)


@pytest.fixture
def job(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """The module of the benchmark's cylinder."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import cylinder as job  # type: ignore[import-not-found]

    return job


def record(particles: int = 1_000, bonds: int = 5_000, ns: float = 2.0, **others: Any) -> dict[str, Any]:
    """A record as benchmarks/run.py writes it; ns: of its three repeats, per bond and step, and 10 % about it."""
    return {
        "job": "cylinder", "engine": "cuda:half-bonds", "gpu": GPU, "particles": particles, "bonds": bonds,
        "steps": 500, "commit": "0123456789abcdef", "date": "2030-01-02T03:04:05+00:00",
        "ns_per_bond_step": {"all": [0.9 * ns, ns, 1.1 * ns]}, "array_bytes_per_particle": 800.0, **others,
    }  # fmt: skip


def keep(folder: Path, *records: dict[str, Any], name: str = "gpu.json") -> Path:
    (folder / name).write_text(json.dumps(records))
    return folder


# The cylinder ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("asked", "particles", "bonds"), [(1_000, 982, 4_944), (10_000, 9_981, 55_566)])
def test_the_cylinder_is_that_of_the_benchmarks(asked: int, particles: int, bonds: int, job: types.ModuleType) -> None:
    ours, theirs = cylinder(asked), job.model(job.packing(asked))
    assert (len(ours), len(ours.bonds[0].pairs)) == (particles, bonds)
    np.testing.assert_array_equal(ours.x, theirs.x)
    np.testing.assert_array_equal(ours.mass, theirs.mass)
    np.testing.assert_array_equal(ours.bonds[0].pairs, theirs.bonds[0].pairs)
    springs = job.springs()._asdict()  # from the definition of the job, not from the package
    laid_out = assemble(ours).bonds["b0"]
    assert {name: laid_out[name] for name in springs} == pytest.approx(springs, rel=1e-12)
    for mine, other in zip(ours.boundaries.conditions, theirs.boundaries.conditions, strict=True):
        assert mine.kind == other.kind
        assert mine.schedules == other.schedules
        np.testing.assert_array_equal(mine.indices, other.indices)
    assert job.DT == DT


def test_a_step_is_that_of_a_simulation(small: bd.Model) -> None:
    """What is timed has nothing around it, but is the step that users run, to the last bit."""
    stepper = Stepper(small, make_engine("reference"))
    sim = bd.Simulation(small, engine="reference", dt=DT)
    with sim.edit("v", "w") as (v, w):
        shake(v.T, w.T, np.arange(len(small)))
    for steps in (1, 3):
        stepper.advance(steps)
        sim.run(steps=steps, quiet=True)
        for ours, theirs in zip(stepper.loads, (sim.particles.force, sim.particles.torque), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_every_bond_but_those_within_the_ends_carries_all_six_loads(small: bd.Model) -> None:
    sim = bd.Simulation(small, engine="reference", dt=DT)
    with sim.edit("v", "w") as (v, w):
        shake(v.T, w.T, np.arange(len(small)))
    sim.run(steps=1, quiet=True)
    free = sim.state.tables.hold[0, sim.state.particles["group"]] == 0.0
    ends = sim.state.bonds["b0"]
    load = np.abs(sim.state.shared["load"][:, free[ends["i"]] | free[ends["j"]]])
    assert load.shape[1] > 100
    assert np.all(load.min(axis=1) > 0.0)
    assert np.all(np.median(load, axis=1) > 0.05 * load.max(axis=1))


def test_actions_and_reactions_balance(small: bd.Model) -> None:
    """A truth from outside: bonds alone act here, so that the forces on all particles sum up to nothing."""
    stepper = Stepper(small, make_engine("reference"))
    stepper.advance(2)
    force, torque = stepper.loads
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()
    assert np.abs(torque).max() > 0.0


def loads_of(model: bd.Model, engine: str, records: bool = False) -> Any:
    stepper = Stepper(model, make_engine(engine), records)
    stepper.advance(3)
    return stepper.loads


def test_forces_are_equal_to_round_off(engine: str, small: bd.Model) -> None:
    other = "interpreted" if engine == "reference" else "reference"
    assert apart(loads_of(small, engine), loads_of(small, other)) < 1e-12


def test_forces_over_records_are_equal_too(small: bd.Model) -> None:
    assert apart(loads_of(small, "interpreted", records=True), loads_of(small, "reference")) < 1e-12


def test_records_are_one_structured_array() -> None:
    n = 5
    vector, number = np.arange(3.0 * n).reshape(3, n), np.arange(n, dtype=np.uint32)
    fields: dict[str, Any] = {"x": vector, "group": number, "mass": 2.5, "other": np.zeros(n + 1)}
    into_records(fields, n)
    table = fields["x"].base
    assert table.dtype.names == ("x", "group")
    assert fields["group"].base is table
    assert table[3]["x"].tolist() == [3.0, 8.0, 13.0]
    assert table[3]["group"] == 3
    fields["x"][2, 3] = -1.0
    assert table[3]["x"][2] == -1.0
    assert fields["mass"] == 2.5
    assert len(fields["other"]) == n + 1


# Timing ---------------------------------------------------------------------------------------------------------


class Clock:
    """A clock that goes on only when steps are taken: so many seconds for a call, and for each of its steps."""

    def __init__(self, call: float, step: float) -> None:
        self.call, self.step, self.now, self.calls = call, step, 0.0, 0

    def __call__(self) -> float:
        return self.now

    def advance(self, steps: int) -> None:
        self.now += self.call + self.step * steps
        self.calls += 1


def test_samples_are_means_over_a_hundred_iterations() -> None:
    clock = Clock(call=0.5, step=1e-3)
    samples, steps = timed(clock.advance, 1e-3, 100.0, clock)
    assert steps == 100
    assert samples == pytest.approx([(0.5 + 100 * 1e-3) / 100] * speed_timing.MOST)
    alone = sampled(clock.advance, 1, 7, 100.0, clock)
    assert alone == pytest.approx([0.501] * 7)


def test_slow_steps_are_timed_one_by_one_within_the_budget() -> None:
    clock = Clock(call=0.0, step=2.0)
    samples, steps = timed(clock.advance, 2.0, 20.0, clock)
    assert (len(samples), steps) == (10, 1)
    assert samples == pytest.approx([2.0] * 10)
    clock = Clock(call=0.0, step=50.0)
    assert timed(clock.advance, 50.0, 20.0, clock) == (pytest.approx([50.0] * 3), 1)
    clock = Clock(call=0.0, step=0.1)  # a hundred at the most
    assert len(timed(clock.advance, 0.1, 20.0, clock)[0]) == 100


def test_mean_median_and_quartiles() -> None:
    point = Point("numba", "", 1, 1, 100, (5.0, 1.0, 2.0, 3.0, 14.0))
    assert (point.mean, point.median, point.quartiles) == (5.0, 3.0, (2.0, 3.0, 5.0))


def test_differences_are_relative_to_the_largest_and_seen() -> None:
    force, torque = np.array([[4.0, 0.0, 0.0], [0.0, -8.0, 1.0]]), np.array([[0.5, 0.0, 0.0]])
    other = force.copy()
    other[0, 2] = 2.0
    assert apart((other, torque), (force, torque)) == pytest.approx(0.25)
    assert apart((force, 1.5 * torque), (force, torque)) == pytest.approx(0.5)
    assert np.isnan(apart((force, np.nan * torque), (force, torque)))
    assert np.isnan(apart((np.nan * force, torque), (force, torque)))


def test_what_does_not_fit_is_left_out_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    way = Way("numba", "Numba, 1 thread", "cpu", 1, host_bytes=1_000, gpu_most=5e6)
    assert too_large(way, 2_000_000, 2_000_000_000) == ""
    assert too_large(way, 3_000_000, 2_000_000_000) == "it needs 3 GB of memory, 2 GB are free"
    assert too_large(way, 6_000_000, 10**12) == "the GPU has room for 5 million"
    assert too_large(way, 1_000_000, None) == ""
    assert "not known" in too_large(way, 1_000_001, None)
    monkeypatch.setattr(speed_timing, "free_memory", lambda: 1_000_000)
    points, left_out = measure([100, 2_000], [way], 0.01, quiet=True)
    assert [p.label for p in points] == [way.label]
    assert left_out == ["Numba, 1 thread with 2,000 particles: it needs 0.002 GB of memory, 0.001 GB are free"]


def test_free_memory_is_less_than_the_machine_has() -> None:
    found = free_memory()
    if found is None:
        pytest.skip("this system does not say")
    os = pytest.importorskip("os")
    assert 0 < found <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


# Results of GPUs ------------------------------------------------------------------------------------------------


def test_records_of_gpus_are_read(tmp_path: Path) -> None:
    keep(tmp_path, record(ns=2.0), record(engine="cuda:bonds", ns=1.0), record(10_000, 60_000))
    keep(tmp_path, record(engine="cpu", ns=0.1), record(ns=0.1, law={"name": "bilinear"}), name="others.json")
    one, other = committed(tmp_path)
    assert (one.kind, one.label, one.particles, one.bonds, one.steps) == ("gpu", f"CUDA, {GPU}", 1_000, 5_000, 500)
    assert one.samples == pytest.approx([4.5e-6, 5e-6, 5.5e-6])  # the faster layout, 1 ns for each of 5000 bonds
    assert one.array_bytes == 8e5
    assert one.device == f"{GPU}, 2030-01-02, commit 0123456"
    assert (other.particles, other.median) == (10_000, pytest.approx(120e-6))
    assert committed(tmp_path / "nowhere") == []


def test_records_of_other_jobs_of_a_gpu_session_are_passed_over(tmp_path: Path) -> None:
    """A file with every kind of record that a session on a GPU keeps: some have no engine, some no times like these."""
    others = [
        {"job": "ceilings", "gpu": GPU, "variant": "bonds", "shares": [{"engine": "cuda", "particles": 1_000}]},
        {"job": "cylinder layouts", "gpu": GPU, "variant": "bonds", "particles": 1_000, "particle_steps_per_s": 1e12},
        {"job": "pull-out equality", "engine": "cuda:bonds", "particles": 45_000, "off": {"v": 0.0}, "step_s": 1e-9},
        {"job": "pull-out", "engine": "cuda", "particles": 45_000, "seconds": 20.0},
        {"job": "session", "runs": [{"name": "speed", "exit_code": 0, "seconds": 9}], "failed": []},
        {"kernels": []},
        record(ns=0.1, law={"name": "bilinear"}),
    ]
    (point,) = committed(keep(tmp_path, *others, record(ns=2.0), *others))
    assert point.median == pytest.approx(1e-5)


def test_records_of_the_benchmark_itself_are_read(tmp_path: Path) -> None:
    """A file of the benchmark's own making, from a machine without a GPU, said to be from one."""
    made = json.loads((BENCHMARKS / "results" / "xeon-2-cores.json").read_text())[0]
    (point,) = committed(keep(tmp_path, {**made, "engine": "cuda", "gpu": GPU}))
    assert point.median == pytest.approx(1e-9 * made["ns_per_bond_step"]["median"] * made["bonds"])


@pytest.mark.parametrize(
    "text", ["not JSON", "3", '["a"]', '[{"job": "cylinder"}]', json.dumps([record(ns_per_bond_step={"all": []})])]
)
def test_a_file_that_is_none_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "odd.json").write_text(text)
    with pytest.raises(InputError, match=r"odd\.json does not hold a list of records"):
        committed(tmp_path)


# The figure -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The figure at two very small sizes, with results of a GPU kept for one of them, written."""
    data = keep(tmp_path_factory.mktemp("data"), record(len(cylinder(100)), 400, ns=0.01))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(speed, "QUICK", speed.Plan((100, 200), 200, 0.05))
        made = speed.figure(tmp_path_factory.mktemp("fig1"), Effort(quick=True, threads=2, quiet=True), data)
    made.write()
    return made


def rows(sheet: Any, number: int) -> list[dict[str, str]]:
    """A table of the sheet as it was written."""
    with (sheet.folder / f"fig1-table-{number}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_all_engines_are_timed_at_all_sizes_with_equal_forces(sheet: Any) -> None:
    here = [p for p in sheet.facts["points"] if p["device"] is None]
    kinds = [way.kind for way in ways(2, 200)]
    assert kinds[:3] == ["numpy", "interpreted", "numba"]
    assert [p["kind"] for p in here] == 2 * kinds
    for p in here:
        assert p["difference"] is None if p["kind"] == "numpy" else p["difference"] < 1e-12
        assert len(p["samples"]) >= 3
        assert 0.0 < p["first quartile"] <= p["median"] <= p["third quartile"]
    slow, fast = ({p["particles"]: p["median"] for p in here if p["kind"] == k} for k in ("interpreted", "numba"))
    assert all(slow[n] > 20.0 * fast[n] for n in slow)


def test_the_tables_say_what_was_measured(sheet: Any) -> None:
    times, how, ratios = (rows(sheet, k) for k in (1, 2, 3))
    assert len(times) == len(how) == len(sheet.facts["points"])
    median = {(row["engine"], row["particles"]): float(row["median [ms]"]) for row in times}
    for p in sheet.facts["points"]:
        assert median[p["label"], str(p["particles"])] == pytest.approx(1e3 * p["median"], rel=6e-3)
    for row in times:
        per_bond = 1e6 * median[row["engine"], row["particles"]] / int(row["bonds"])
        assert float(row["ns per bond and step"]) == pytest.approx(per_bond, rel=2e-2)
    quoted = {row["ratio"]: row["the paper"] for row in ratios}
    assert quoted["interpreted Python / Numba, 1 thread"] == "1000 to 1500"
    assert quoted[f"interpreted Python / CUDA, {GPU}"] == "1000 to 5500" or "cuda" in usable_engines()
    for row in ratios:
        above, below = row["ratio"].split(" / ")
        for n in [head for head in row if head.isdigit()]:
            if row[n]:
                assert float(row[n]) == pytest.approx(median[above, n] / median[below, n], rel=2e-2)


@pytest.mark.skipif("cuda" in usable_engines(), reason="this machine's own GPU is shown")
def test_results_kept_with_the_package_are_shown_and_named(sheet: Any) -> None:
    (gpu,) = (p for p in sheet.facts["points"] if p["kind"] == "gpu")
    assert gpu["median"] == pytest.approx(400 * 0.01e-9)
    page = (sheet.folder / "fig1.md").read_text(encoding="utf-8")
    assert f"results kept with the package, not measured in this run ({GPU}, 2030-01-02, commit 0123456)" in page


@pytest.mark.skipif("cuda" in usable_engines(), reason="this machine's own GPU is shown")
def test_without_any_gpu_the_sheet_says_so(sheet: Any) -> None:
    here = [p for p in map(_point, sheet.facts["points"]) if p.kind != "gpu"]
    said = " ".join(speed.remarks(here, speed.QUICK))
    assert "GPU: no curve, for this machine has none: " in said
    assert "no results of another one come with the package" in said


def test_pictures_are_drawn_for_slides_and_papers(sheet: Any) -> None:
    assert len(sheet.pictures) == 2
    for path in sheet.pictures.values():
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.with_suffix(".svg").is_file()
    order = [p.kind for *_, own in speed_pictures.series([*map(_point, sheet.facts["points"])]) for p in own[:1]]
    assert order == [k for k in speed_pictures.LOOKS if k in order]
    assert len(order) == 5


def test_several_gpus_have_colours_of_their_own() -> None:
    points = [Point("gpu", f"CUDA, {k}", 100, 500, 1, (1e-6,)) for k in range(3)]
    colours = [colour for _, colour, _, _ in speed_pictures.series(points)]
    assert len(set(colours)) == 3


def test_sizes_are_those_of_the_paper_and_on_to_ten_million() -> None:
    sizes = speed.FULL.sizes
    assert [n for n in sizes if n <= speed.FULL.most_interpreted][:: len(speed.PAPERS) - 1] == [1_000, 10_000]
    assert sizes[-1] == 10_000_000
    assert all(a < b for a, b in pairwise(sizes))


def _point(fact: dict[str, Any]) -> Point:
    return Point(**{name: fact[name] for name in Point._fields})
