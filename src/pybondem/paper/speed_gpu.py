"""Times measured on GPUs and kept with the package: records of the benchmark, for machines that have no GPU."""

import json
from pathlib import Path
from typing import Any

from pybondem.errors import InputError
from pybondem.paper.speed_timing import Point

DATA = Path(__file__).with_name("data")


def committed(folder: Path = DATA) -> list[Point]:
    """Return the points of all files *.json in a folder (none where there is no folder), by GPU and size.

    A file holds a list of records as `benchmarks/run.py --engine cuda --json FILE` writes them; records of other
    jobs, engines and of laws are passed over, and of several at one size on one GPU, such as both layouts of the step,
    the fastest is taken. Raises InputError where a file cannot be read as such.
    """
    best: dict[tuple[str, int], Point] = {}
    for path in sorted(folder.glob("*.json")):
        for point in _points(path):
            key = point.label, point.particles
            if key not in best or point.median < best[key].median:
                best[key] = point
    return [best[key] for key in sorted(best)]


def _points(path: Path) -> list[Point]:
    """Return the points of one file."""
    try:
        records = json.loads(path.read_text(encoding="utf-8"))
        jobs = [r for r in records if r.get("job") == "cylinder" and "law" not in r]
        return [_point(r) for r in jobs if r["engine"].startswith("cuda")]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} does not hold a list of records of benchmarks/run.py ({type(error).__name__}: {error}); mend or "
            "remove it."
        ) from None


def _point(record: dict[str, Any]) -> Point:
    """Return a record as a point."""
    n, bonds = int(record["particles"]), int(record["bonds"])
    samples = tuple(1e-9 * bonds * float(ns) for ns in record["ns_per_bond_step"]["all"])
    if not samples:
        raise ValueError("no times")
    arrays = record.get("array_bytes_per_particle")
    commit = str(record.get("commit") or "")[:7]
    device = f"{record['gpu']}, {record['date'][:10]}{f', commit {commit}' if commit else ''}"
    return Point(
        "gpu", f"CUDA, {record['gpu']}", n, bonds, int(record["steps"]), samples, device=device,
        array_bytes=None if arrays is None else n * float(arrays),
    )  # fmt: skip
