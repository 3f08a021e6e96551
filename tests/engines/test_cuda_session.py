"""What a session on a GPU is held to, without one: its floors, and the tests that it names."""

import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pybondem as bd
from pybondem.engines.cuda_text import THREADS

ROOT = Path(__file__).parents[2]
STANDARD = ("S1", "S6", "S13")  # that the session names


@pytest.fixture
def benchmark(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """benchmark(name): a module of the benchmarks."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return import_module


@pytest.fixture
def gpu_floors(benchmark: Callable[[str], Any]) -> Any:
    """The module that holds figures against floors."""
    return benchmark("gpu_floors")


def records(rate: float = 1.2e9, law: float = 1.3, off: float = 1e-12) -> list[dict[str, Any]]:
    """Return what a session keeps that reaches its floors, or does not."""
    sizes = {1_000: (982, 2.1e8), 10_000: (9_981, 1.1e9), 1_000_000: (986_326, rate)}
    found: list[dict[str, Any]] = []
    for asked, (particles, reached) in sizes.items():
        for engine, factor in (("cuda:half-bonds", 1.0), ("cuda:bonds", 0.1)):
            one = {"engine": engine, "asked": asked, "particles": particles, "particle_steps_per_s": factor * reached}
            found.append({"job": "cylinder", **one})
    slow = found[-2] | {"engine": "cuda", "particle_steps_per_s": 7e8}
    found.append(slow | {"law": {"name": "bilinear", "active": True, "over_elastic": law}})
    for engine in ("cuda:bonds", "cuda:half-bonds"):
        found.append({"job": "pull-out equality", "engine": engine, "off": {"v": off, "w": 0.0}, "same_bits": True})
    found.append({"job": "pull-out", "engine": "cuda", "seconds": 20.0})
    share = {"engine": "cuda:half-bonds", "particles": 986_326, "memory_share": 0.2, "arithmetic_share": 0.6}
    return [*found, {"job": "ceilings", "variant": "half-bonds", "shares": [share]}]


def missed(gpu_floors: Any, given: list[dict[str, Any]]) -> list[str]:
    return [figure.name for figure in gpu_floors.figures(given) if not figure.met]


def test_cuda_floors_are_met_by_the_variant_of_the_device(gpu_floors):
    assert missed(gpu_floors, records()) == []
    lines = gpu_floors.table(gpu_floors.figures(records())).splitlines()
    assert re.search(r"^particle-steps/s, 1,000,000 particles +1\.2e\+09 +>= 1e\+09 +20\.0% +60\.0%$", lines[3])
    assert not any("MISSED" in line for line in lines)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"rate": 0.9e9}, "particle-steps/s, 1,000,000 particles"),
        ({"law": 1.41}, "bilinear / elastic"),
        ({"off": 2e-9}, "pull-out off the cpu, cuda:bonds"),
    ],
)
def test_a_cuda_floor_that_is_missed_is_named(gpu_floors, given, name):
    assert name in missed(gpu_floors, records(**given))
    line = next(line for line in gpu_floors.table(gpu_floors.figures(records(**given))).splitlines() if name in line)
    assert line.endswith("MISSED")


@pytest.mark.parametrize(
    "other", [{"asked": 10_000}, {"engine": "cuda:bonds"}, {"active": False}, {"name": "exponential"}], ids=str
)
def test_the_cost_of_damage_is_that_of_the_floor_and_no_other(gpu_floors, other):
    slow = next(r for r in records() if "law" in r)
    law = {"over_elastic": 0.1} | {name: value for name, value in other.items() if name in slow["law"]}
    faster = slow | {name: value for name, value in other.items() if name in slow} | {"law": slow["law"] | law}
    assert "bilinear / elastic" in missed(gpu_floors, [*records(law=1.41), faster])


def test_a_cuda_figure_that_was_not_taken_is_missed(gpu_floors):
    assert len(missed(gpu_floors, [])) == len(gpu_floors.figures([])) == 9
    assert "not taken" in gpu_floors.table(gpu_floors.figures([]))


def test_the_cuda_session_names_tests_that_there_are():
    script = (ROOT / "benchmarks" / "gpu_session.sh").read_text()
    named = re.findall(r"^ +(S\d+) (tests/\S+\.py)::(test_\w+)$", script, re.MULTILINE)
    assert {number for number, _, _ in named} == set(STANDARD)
    for _, file, test in named:
        assert re.search(rf"^def {test}\(.*\bengine\b", (ROOT / file).read_text(), re.MULTILINE), test


def test_limits_of_the_runs_of_a_cuda_session_sum_up_to_ten_minutes():
    """But for the run that has what is left, which leaves the last two their time."""
    script = (ROOT / "benchmarks" / "gpu_session.sh").read_text()
    limits = [(name, int(most)) for name, most in re.findall(r'^ +run ("[^"]+"|\w+) (\d+) ', script, re.MULTILINE)]
    times = {'"small $variant"': 2, '"$tool"': 6}
    assert len(limits) == 12
    assert sum(times.get(name, 1) * most for name, most in limits) <= 600
    assert [*dict(limits)][-2:] == ["shares", "floors"]
    rest = re.search(r'run "speed of 8 million" \$\(\(most - SECONDS - (\d+)\)\)', script)
    assert rest is not None
    assert int(rest[1]) >= sum(most for _, most in limits[-2:])
    order = re.search(r"^every=\((.*)\)$", script, re.MULTILINE)
    assert order is not None
    assert order[1].split() == ["standard", "equality", "sanitizer", "tests", "speed", "layouts", "large", "shares"]


def test_the_small_cuda_model_has_what_the_sanitizer_is_to_see(benchmark):
    """Ends of one particle in more than one block, ragged last blocks, both kinds of law at work, odd and even."""
    small = benchmark("gpu_small")
    model = small.model()
    damage, slip = model.bonds
    ends = Counter(np.concatenate([damage.pairs.ravel(), slip.pairs.ravel()]).tolist())
    assert max(ends.values()) > THREADS
    assert len(model) % THREADS != 0
    assert (len(damage.pairs) + len(slip.pairs)) % THREADS != 0
    assert sum(small.LAUNCHES) >= 5
    assert {steps % 2 for steps in small.LAUNCHES} == {0, 1}
    assert {damage.bond.law.kind, slip.bond.law.kind} == {"damage", "bond"}
    sim = bd.Simulation(model, engine="cpu", dt=small.DT)
    assert sim.dt < sim.limit.dt
    rng = np.random.default_rng(7)
    with sim.edit("v", "w") as (v, w):
        v[:], w[:] = rng.normal(size=v.shape), rng.normal(scale=1e3, size=w.shape)
    sim.run(steps=sum(small.LAUNCHES), quiet=True)
    assert (sim.bonds(damage).damage > 0.0).mean() > 0.5
    assert np.abs(sim.bonds(slip).m_slip_s).max() > 0.0


@pytest.mark.skipif(sys.platform == "win32", reason="the session is a script for bash")
def test_a_cuda_session_keeps_what_each_run_came_to(tmp_path):
    """With an interpreter that says it has done everything but for the tests, wherever it is called from."""
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    lines = ["#!/usr/bin/env bash", '[[ " $* " != *" pytest "* ]] || exit 7']
    python.write_text("\n".join([*lines, f'[[ $2 != *append* ]] || exec {sys.executable} "$@"']))
    python.chmod(0o755)
    script = str(ROOT / "benchmarks" / "gpu_session.sh")
    environment = os.environ | {"PYTHON": "bin/python", "OUT": "kept"}
    asked = [script, "standard", "equality"]
    done = subprocess.run(asked, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    (kept,) = (tmp_path / "kept").glob("gpu-*.json")
    assert re.fullmatch(r"gpu-\d{4}-\d\d-\d\d-\d{6}\.json", kept.name)
    (record,) = json.loads(kept.read_text())
    assert record["job"] == "session"
    assert [(one["name"], one["exit_code"]) for one in record["runs"]] == [("S1 S6 S13", 7), ("equality", 0)]
    assert record["failed"] == ["S1 S6 S13 (exit code 7)"]
    assert all(one["seconds"] <= 10 for one in record["runs"])
    refused = subprocess.run([script, "speeds"], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "there is no part speeds" in refused.stderr
