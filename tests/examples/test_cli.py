"""The command line as its user meets it: what it runs, prints, writes, refuses, and leaves when it is stopped."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from examples.result_folder import pictures, read_columns, read_series, read_summary
from oracles.lattice_statics import Lattice, bond_matrix, held
from typer.testing import CliRunner

import pybondem as bd
from pybondem import simulation
from pybondem.cli import app

Command = Callable[..., Any]
ROOT = Path(__file__).parents[2]
SPECIMEN = """
import pybondem as bd

grains = bd.packing.hcp(diameter=2e-3, inside=bd.Cylinder(radius=5e-3, height=20e-3), axis="z")
rod = bd.Model(grains, density=2500.0)
rod.bond(rod.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), bd.strength(tension=5e6, shear=10e6)))
bottom, top = rod.where(z=(None, 1e-3)), rod.where(z=(18e-3, None))
rod.fix(bottom)
rod.drive(top, vz=bd.ramp(to=0.1, over=1e-4))
"""
PULL = """
sim = bd.Simulation(rod, damping=bd.local(0.2))
pull = sim.record(every=20, force=bd.reaction(bottom, "z"), strain=bd.strain(bottom, top, "z"))
sim.run(steps=410)
print(f"seen {pull.force.last!r}")
pull.plot("strain", "force", path="mine.png")
"""


def pybondem(*words: str, where: Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, as in a shell."""
    command = [sys.executable, "-m", "pybondem", *words]
    wide = {**os.environ, "COLUMNS": "160"}
    return subprocess.run(command, capture_output=True, text=True, cwd=where, env=wide, timeout=300, check=False)


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """command(words): the same within this process, in an empty folder: quicker where little happens."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    for name, value in vars(simulation.session).items():  # a script sets these for the rest of its process
        monkeypatch.setattr(simulation.session, name, value)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return lambda *words: CliRunner().invoke(app, list(words))


def script(folder: Path, text: str) -> str:
    """Write a script into a folder and return its name."""
    (folder / "my_case.py").write_text(text, encoding="utf-8")
    return "my_case.py"


# Examples -------------------------------------------------------------------------------------------------------


def test_an_example_runs_with_a_changed_value_into_a_given_folder(tmp_path: Path) -> None:
    done = pybondem(
        "run", "cylinder", "-s", "diameter=2e-3", "--set", "strain=2e-4", "-o", "mine/first", where=tmp_path
    )
    assert done.returncode == 0, done.stderr
    summary = read_summary(tmp_path / "mine" / "first")
    assert (summary["outcome"], summary["case"], summary["particles"]) == ("done", "cylinder", 259)
    columns, _ = read_columns(tmp_path / "mine" / "first" / "history.csv")
    assert columns["strain"][-1] == pytest.approx(2e-4, rel=1e-3)
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert "cylinder done" in lines
    assert f"summary {Path('mine', 'first', 'summary.json')}" in lines  # as it can be typed from here
    assert any(line.startswith("stiffness against the static solve") for line in lines)
    assert done.stderr == ""
    assert not (tmp_path / "runs").exists()


def test_a_quiet_run_says_only_where_its_results_are(command: Command, tmp_path: Path) -> None:
    done = command("run", "cylinder", "-s", "diameter=3.5e-3", "-s", "transits=20", "--engine", "reference", "-q")
    assert done.exit_code == 0, done.output
    folder = Path(done.stdout.strip())
    assert folder.parent.name == "runs"
    assert folder.name.startswith("cylinder-2")
    assert read_summary(folder)["engine"] == "reference"
    assert (tmp_path / "runs" / "latest").resolve() == folder.resolve()


def test_examples_lists_what_run_takes(command: Command) -> None:
    done = command("examples")
    assert done.exit_code == 0
    for name in ("cylinder", "pullout"):
        assert f" {name} " in done.stdout


def test_info_names_engines_and_versions(command: Command) -> None:
    done = command("info")
    assert done.exit_code == 0
    facts = dict(line.split(maxsplit=1) for line in done.stdout.splitlines() if len(line.split()) > 1)
    assert {"cpu", "reference", "interpreted"} <= set(facts["engines"].split(", "))
    assert facts["python"] == sys.version.split()[0]
    assert facts["numpy"] == np.__version__
    assert int(facts["threads"]) >= 1
    assert facts["GPU"]


# Scripts --------------------------------------------------------------------------------------------------------


def test_a_script_leaves_a_result_folder(tmp_path: Path) -> None:
    done = pybondem("run", script(tmp_path, SPECIMEN + PULL), "-o", "out", "--engine", "reference", where=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "out"
    summary = read_summary(folder)
    assert {k: summary[k] for k in ("outcome", "case", "engine", "steps", "broken")} == {
        "outcome": "done", "case": "my_case", "engine": "reference", "steps": 410, "broken": 0,
    }  # fmt: skip
    columns, units = read_columns(folder / "history.csv")
    assert units == {"time": "s", "force": "N", "strain": "1"}
    assert len(columns["time"]) == 410 // 20 + 1
    assert f"seen {float(columns['force'][-1])!r}" in done.stdout
    assert "my_case done" in done.stdout
    assert pictures(folder) == {"history-force.png", "history-strain.png"}
    assert (tmp_path / "mine.png").exists()
    particles = read_series(folder / "particles.vtkhdf")
    assert particles.times[-1] == pytest.approx(summary["time_s"], rel=1e-14)


def test_every_simulation_of_a_script_has_a_folder(command: Command, tmp_path: Path) -> None:
    twice = "for speed in (1, 2):\n    sim = bd.Simulation(rod)\n    sim.run(steps=5 * speed)\n    sim.run(steps=1)\n"
    done = command("run", script(tmp_path, SPECIMEN + twice), "-o", "out", "--engine", "reference", "-q")
    assert done.exit_code == 0, done.output
    assert done.stdout == ""
    assert [read_summary(tmp_path / name)["steps"] for name in ("out", "out-2")] == [6, 11]
    assert not (tmp_path / "out-3").exists()


def test_a_script_imports_what_lies_beside_it(command: Command, tmp_path: Path) -> None:
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "lengths_of_mine.py").write_text("D = 2e-3\n", encoding="utf-8")
    (tmp_path / "beside" / "case.py").write_text("from lengths_of_mine import D\nprint(f'got {D}')\n", encoding="utf-8")
    done = command("run", str(Path("beside", "case.py")))
    assert (done.exit_code, done.stdout) == (0, "got 0.002\n")


def test_a_script_that_exits_well_is_done(command: Command, tmp_path: Path) -> None:
    ends = SPECIMEN + "bd.Simulation(rod).run(steps=5)\nraise SystemExit(0)\n"
    done = command("run", script(tmp_path, ends), "-o", "out", "--engine", "reference")
    assert done.exit_code == 0
    assert read_summary(tmp_path / "out")["outcome"] == "done"


def test_a_script_that_fails_leaves_what_it_had(command: Command, tmp_path: Path) -> None:
    fails = SPECIMEN + "bd.Simulation(rod).run(steps=5)\nraise ZeroDivisionError('my own mistake')\n"
    done = command("run", script(tmp_path, fails), "-o", "out", "--engine", "reference", "-q")
    assert done.exit_code == 1
    assert isinstance(done.exception, ZeroDivisionError)
    summary = read_summary(tmp_path / "out")
    assert (summary["outcome"], summary["steps"]) == ("failed", 5)


def test_the_tension_example_breaks_where_statics_says(tmp_path: Path) -> None:
    done = pybondem("run", str(ROOT / "examples" / "tension.py"), "-o", "out", where=tmp_path)
    assert done.returncode == 0, done.stderr
    columns, _ = read_columns(tmp_path / "out" / "history.csv")
    EA, strain = first_break()
    whole = columns["broken"] == 0
    elastic = whole & (columns["strain"] > 1e-3)
    slope = np.polyfit(columns["strain"][elastic], columns["force"][elastic], 1)[0]
    assert slope == pytest.approx(EA, rel=1e-3)
    assert columns["force"].max() == pytest.approx(EA * strain, rel=5e-3)
    last, next_one = columns["strain"][whole][-1], columns["strain"][~whole][0]
    assert last * 0.998 < strain < next_one * 1.002
    assert columns["force"][-1] < 0.2 * columns["force"].max()
    assert pictures(tmp_path) == {"tension.png"}


def first_break() -> tuple[float, float]:
    """Return EA [N] of the specimen of the tension example and the strain at which its first bond fails, by statics.

    Parallel bonds of E = 1 GPa with kn/ks = 2 and the radius of the grains, of 5 MPa in tension, 10 MPa in shear.
    """
    x = bd.packing.hcp(diameter=1e-3, inside=bd.Cylinder(radius=5e-3, height=20e-3), axis="z").x
    near = bd.Model(bd.packing.Particles(x, np.full(len(x), 5e-4)), density=2500.0).touching()
    r, length = 5e-4, 1e-3
    A, I = np.pi * r**2, np.pi * r**4 / 4.0
    k = np.array([1e9 * A, 0.5e9 * A, 0.5e9 * 2.0 * I, 1e9 * I]) / length
    low, high = np.flatnonzero(x[:, 2] <= 1e-3), np.flatnonzero(x[:, 2] >= 19e-3)
    apart = float(x[high, 2].mean() - x[low, 2].mean())
    u, force = Lattice(x).bond(near, *k).solve(held(low, "x y z rx ry rz") | held(high, "z", apart))  # a unit strain
    span = x[near[:, 1]] - x[near[:, 0]]
    ends = (bond_matrix(span, *k) @ np.concatenate([u[near[:, 0]], u[near[:, 1]]], axis=1)[:, :, None])[:, :, 0]
    n = span / np.linalg.norm(span, axis=1)[:, None]
    F, M = ends[:, 6:9], 0.5 * (ends[:, 9:12] - ends[:, 3:6])  # moment at mid-length
    Fn, Mt = (F * n).sum(axis=1), (M * n).sum(axis=1)
    Fs, Mb = np.linalg.norm(F - Fn[:, None] * n, axis=1), np.linalg.norm(M - Mt[:, None] * n, axis=1)
    tension, shear = Fn / A + Mb * r / I, Fs / A + np.abs(Mt) * r / (2.0 * I)
    return -float(force[low, 2].sum()), 1.0 / max(tension.max() / 5e6, shear.max() / 10e6)


# Refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["run", "cylindr"], 2, "there is no example or file 'cylindr' (did you mean 'cylinder'?)"),
        (["run", "nothing.py"], 2, "there is no file 'nothing.py'."),
        (["run", "cylinder", "-s", "diametr=2e-3"], 2, "cylinder has no value 'diametr' (did you mean 'diameter'?)"),
        (["run", "cylinder", "-s", "diameter=2mm"], 2, "diameter='2mm' of cylinder is not a number."),
        (["run", "cylinder", "-s", "diameter"], 2, "--set needs key=value, got 'diameter'."),
        (["run", "cylinder", "-s", "nu=0.4"], 2, "nu of cylinder is 0.4; it must lie between 0 and 0.2."),
        (["run", "cylinder", "-s", "E=nan"], 2, "E of cylinder is nan; it must be finite."),
        (["run", "pullout", "-s", "axis=w"], 2, "axis of pullout is 'w'; it must be one of 'x', 'y', 'z'."),
        (["run", "cylinder", "--engine", "gpu"], 2, "engine is 'gpu'; it must be one of 'cpu', "),
        (["run", "my_case.py", "-s", "diameter=1"], 2, "--set changes values of examples; a script has its own."),
        (["run", "cylinder", "-s", "diameter=3e-3", "--threads", "4096"], 4, "threads is 4096; this machine allows"),
        (["run", "cylinder", "-s", "diameter=3e-3", "--threads", "0"], 4, "threads is 0; this machine allows"),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_sentence(
    command: Command, tmp_path: Path, words: list[str], code: int, says: str
) -> None:
    done = command(*words)
    assert done.exit_code == code, done.output
    assert done.stderr.startswith(f"error: {says}")
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ""
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["run"], ["walk"], ["run", "cylinder", "--speed", "2"]])
def test_words_that_are_no_command_are_refused(command: Command, words: list[str]) -> None:
    done = command(*words)
    assert done.exit_code == 2
    assert "Usage: " in done.stderr


def test_a_folder_with_something_in_it_is_left_alone(command: Command, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear reader", encoding="utf-8")
    done = command("run", "cylinder", "-s", "diameter=3.5e-3", "--engine", "reference", "-o", "out")
    assert done.exit_code == 2
    assert done.stderr.startswith("error: folder out is not empty (it holds letter.txt)")
    done = command("run", script(tmp_path, SPECIMEN + PULL), "--engine", "reference", "-o", "out")
    assert done.exit_code == 2
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["letter.txt"]


def test_an_unstable_step_is_refused_before_anything_is_written(command: Command, tmp_path: Path) -> None:
    unstable = SPECIMEN + "bd.Simulation(rod, dt=1e-3).run(steps=10)\n"
    done = command("run", script(tmp_path, unstable), "-o", "out", "--engine", "reference")
    assert done.exit_code == 3
    assert done.stderr.startswith("error: dt is 0.001 s, above the critical step 1.1")
    assert not (tmp_path / "out").exists()


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_run_that_blows_up_says_so_and_leaves_what_it_had(command: Command, tmp_path: Path) -> None:
    wild = SPECIMEN.replace("to=0.1", "to=1e300") + PULL.replace("steps=410", "steps=5000")
    done = command("run", script(tmp_path, wild), "-o", "out", "--engine", "reference")
    assert done.exit_code == 3
    assert done.stderr.startswith("error: the motion has blown up at step")
    assert read_summary(tmp_path / "out")["outcome"] == "failed"


def test_a_value_that_is_no_number_cannot_be_set(command: Command) -> None:
    done = command("run", "pullout", "-s", "interface=1")
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ")


# Ctrl-C ---------------------------------------------------------------------------------------------------------


def stopped(words: list[str], folder: Path, where: Path) -> subprocess.CompletedProcess[str]:
    """Run the command, press Ctrl-C when its history has grown to ten rows, and return how it ended."""
    command, wide = [sys.executable, "-m", "pybondem", *words], {**os.environ, "COLUMNS": "160"}
    running = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=where, env=wide
    )  # fmt: skip
    try:
        history, patience = folder / "history.csv", time.monotonic() + 200.0
        while not history.exists() or len(history.read_text(encoding="utf-8").splitlines()) < 10:
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < patience, "no history was written"
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=100.0)
    finally:
        running.kill()
    return subprocess.CompletedProcess(command, running.returncode, out, err)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for another process")
@pytest.mark.parametrize("what", ["script", "example"])
def test_a_run_stopped_by_hand_leaves_complete_results(what: str, tmp_path: Path) -> None:
    words = ["cylinder", "-s", "diameter=2e-3", "-s", "transits=1e3"]
    if what == "script":
        words = [script(tmp_path, SPECIMEN + PULL.replace("steps=410", "steps=10**8"))]
    folder = tmp_path / "out"
    done = stopped(["run", *words, "--engine", "reference", "-o", "out"], folder, tmp_path)
    assert done.returncode == 130, done.stderr
    assert "stopped by hand after step" in done.stderr
    assert f"{'my_case' if what == 'script' else 'cylinder'} stopped by hand" in done.stdout
    assert "Traceback" not in done.stderr
    assert "seen" not in done.stdout  # the script does not go on
    summary = read_summary(folder)
    assert summary["outcome"] == "stopped by hand"
    columns, _ = read_columns(folder / "history.csv")
    assert len(columns["time"]) >= 9
    assert columns["time"][-1] <= summary["time_s"]
    assert all(np.isfinite(values).all() for values in columns.values())
    particles, bonds = (read_series(folder / f"{name}.vtkhdf") for name in ("particles", "bonds"))
    assert particles.times == bonds.times
    assert particles.times[-1] == pytest.approx(summary["time_s"], rel=1e-14)
    assert np.isfinite(particles.points).all()
    assert {"history-force.png", "history-strain.png"} <= pictures(folder)
    assert not list(folder.glob(".*"))  # nothing half-written
    again = pybondem("run", *words, "--engine", "reference", "-o", "out", where=tmp_path)
    assert again.returncode == 2
    assert "folder out is not empty" in again.stderr
    assert read_summary(folder) == summary
