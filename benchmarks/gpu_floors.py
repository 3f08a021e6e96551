"""What a GPU session must reach, beside what it has: a table, and which of it was missed.

python benchmarks/gpu_floors.py FILE      reads the records that a session has appended to FILE; exits with 1 where a
                                          floor was missed or never measured
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

Record = dict[str, Any]


class Figure(NamedTuple):
    """A figure: what was reached (None: not measured), what is required, at least (">=") or at most ("<=").

    memory, arithmetic: what it reaches of the measured ceilings, where that means something.
    """

    name: str
    reached: float | None
    bound: str
    required: float
    memory: float | None = None
    arithmetic: float | None = None

    @property
    def met(self) -> bool:
        """Whether it is as required."""
        if self.reached is None:
            return False
        return self.reached >= self.required if self.bound == ">=" else self.reached <= self.required


def figures(records: list[Record]) -> list[Figure]:
    """Return every figure that is required of an H100, with what records of a session say of it."""
    most: Record = _last(records, lambda r: r.get("job") == "ceilings") or {}
    default = ("cuda", f"cuda:{most.get('variant')}")
    rows = []
    for size, what, required in (
        (1_000, "steps/s", 2e5),
        (10_000, "steps/s", 1e5),
        (1_000_000, "particle-steps/s", 1e9),
    ):
        found = _last(records, lambda r, n=size: _is_speed(r, n) and r["engine"] in default)
        rate = found and found["particle_steps_per_s"] / (found["particles"] if what == "steps/s" else 1)
        shares = _shares(most, found) if found else {}
        rows.append(Figure(f"{what}, {size:,} particles", rate or None, ">=", required, **shares))
    law = _last(records, lambda r: _is_cost_of_damage(r) and r["engine"] in default)
    rows.append(Figure("bilinear / elastic", law and law["law"]["over_elastic"], "<=", 1.4))
    for engine in ("cuda:bonds", "cuda:half-bonds"):
        same = _last(records, lambda r, e=engine: r.get("job") == "pull-out equality" and r["engine"] == e)
        rows.append(Figure(f"pull-out off the cpu, {engine}", same and max(same["off"].values()), "<=", 1e-9))
        rows.append(Figure(f"same bits again, {engine}", same and float(same["same_bits"]), ">=", 1.0))
    run = _last(records, lambda r: r.get("job") == "pull-out" and r["engine"] == "cuda")
    rows.append(Figure("pull-out example, s", run and run["seconds"], "<=", 60.0))
    return rows


def _is_speed(record: Record, asked: int) -> bool:
    """Return whether a record is a figure of the elastic cylinder job of a size."""
    return "particle_steps_per_s" in record and record.get("asked") == asked and "law" not in record


def _is_cost_of_damage(record: Record) -> bool:
    """Return whether a record is the cylinder job of a million particles whose bonds soften by the bilinear law."""
    law = record.get("law", {})
    return law.get("name") == "bilinear" and bool(law.get("active")) and record.get("asked") == 1_000_000


def _last(records: list[Record], fits: Callable[[Record], bool]) -> Record | None:
    return next((record for record in reversed(records) if fits(record)), None)


def _shares(most: Record, found: Record) -> dict[str, float]:
    """Return the shares of the ceilings that a record of the cylinder job reaches, as `gpu_ceilings` has kept them."""
    for share in most.get("shares", []):
        if (share["engine"], share["particles"]) == (found["engine"], found["particles"]):
            return {"memory": share["memory_share"], "arithmetic": share["arithmetic_share"]}
    return {}


def table(found: list[Figure]) -> str:
    """Return the figures as a table."""
    head = f"{'figure':36} {'reached':>10} {'required':>12} {'of memory':>10} {'of fp64':>8}"
    lines = [head]
    for f in found:
        reached = "not taken" if f.reached is None else f"{f.reached:.3g}"
        memory, arithmetic = ("-" if share is None else f"{share:.1%}" for share in (f.memory, f.arithmetic))
        said = "" if f.met else "  MISSED"
        lines.append(
            f"{f.name:36} {reached:>10} {f.bound + f' {f.required:.3g}':>12} {memory:>10} {arithmetic:>8}{said}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table; exit with 1 where a floor was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, metavar="FILE")
    path = parser.parse_args().file
    found = figures(json.loads(path.read_text()) if path.exists() else [])
    print(table(found))
    missed = [figure.name for figure in found if not figure.met]
    if missed:
        sys.exit(f"missed: {'; '.join(missed)}")


if __name__ == "__main__":
    main()
