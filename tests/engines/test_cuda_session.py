"""What a session on a GPU is held to, without one: its floors, and the tests that it names."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
STANDARD = ("S1", "S6", "S13")  # that the session names


@pytest.fixture(scope="module")
def gpu_floors() -> Any:
    """The module that holds figures against floors."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        import gpu_floors  # type: ignore[import-not-found]
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
    return gpu_floors


def records(rate: float = 1.2e9, law: float = 1.3, off: float = 1e-12) -> list[dict[str, Any]]:
    """Return what a session keeps that reaches its floors, or does not."""
    sizes = {1_000: (982, 2.1e8), 10_000: (9_981, 1.1e9), 1_000_000: (986_326, rate)}
    found: list[dict[str, Any]] = []
    for asked, (particles, reached) in sizes.items():
        for engine, factor in (("cuda:half-bonds", 1.0), ("cuda:bonds", 0.1)):
            one = {"engine": engine, "asked": asked, "particles": particles, "particle_steps_per_s": factor * reached}
            found.append({"job": "cylinder", **one})
    slow = found[-2] | {"engine": "cuda", "particle_steps_per_s": 7e8}
    found.append(slow | {"law": {"name": "bilinear", "over_elastic": law}})
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


def test_a_cuda_figure_that_was_not_taken_is_missed(gpu_floors):
    assert len(missed(gpu_floors, [])) == len(gpu_floors.figures([])) == 9
    assert "not taken" in gpu_floors.table(gpu_floors.figures([]))


def test_the_cuda_session_names_tests_that_there_are():
    script = (ROOT / "benchmarks" / "gpu_session.sh").read_text()
    named = re.findall(r"^ +(S\d+) (tests/\S+\.py)::(test_\w+)$", script, re.MULTILINE)
    assert {number for number, _, _ in named} == set(STANDARD)
    for _, file, test in named:
        assert re.search(rf"^def {test}\(.*\bengine\b", (ROOT / file).read_text(), re.MULTILINE), test
