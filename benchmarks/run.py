"""Time PyBONDEM on a job, alone or in turns with a peer, or a bond law in turns with its like.

python benchmarks/run.py --job cylinder --particles 10000 --engine cpu --threads 1 --json FILE
python benchmarks/run.py --particles 1000,10000,100000 --threads 1,2
python benchmarks/run.py --particles 10000 --peer lammps
python benchmarks/run.py --particles 10000 --law bilinear,exponential

Prints a table and, with --json, appends a record for each line of it to the list in FILE; README.md says what it holds.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

import lammps_peer
import numpy as np
import user_law
from contender import Contender, Sample
from machine import circumstances

JOBS = ("cylinder",)
PEERS = ("lammps",)
THREADED = ("cpu",)  # engines that --threads means something to
COLUMNS = (
    ("engine", "engine", "s"), ("threads", "threads", "d"), ("particles", "particles", ",d"), ("bonds", "bonds", ",d"),
    ("steps", "steps", ",d"), ("wall", "wall", ".2f"), ("spread", "spread", ".0%"), ("CPU", "cpu", ".2f"),
    ("particle-steps/s", "particle_steps_per_s", ".3g"), ("B/particle", "bytes_per_particle", ",.0f"),
    ("build s", "build_s", ".2f"), ("compile s", "compile_s", ".1f"), ("warm start s", "warm_start_s", ".1f"),
    ("peer wall", "peer_wall", ".1f"), ("peer CPU", "peer_cpu", ".1f"), ("ratio", "ratio", ".2f"),
    ("CPU ratio", "ratio_cpu", ".2f"), ("law", "law_name", "s"), ("active", "active", "s"),
    ("elastic CPU", "elastic_cpu", ".2f"), ("user's CPU", "users_cpu", ".2f"), ("law/elastic", "over_elastic", ".2f"),
    ("user's/law", "users_over_built_in", ".2f"),
)  # fmt: skip


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--job", choices=JOBS, default="cylinder")
    parser.add_argument("--particles", type=_numbers, default=[10_000], help="sizes, with commas")
    parser.add_argument("--engine", type=lambda text: text.split(","), default=["cpu"], help="engines, with commas")
    parser.add_argument("--threads", type=_numbers, default=[1], help="numbers of threads (MPI ranks of a peer)")
    parser.add_argument("--peer", choices=PEERS, help="also time this program, in turns with ours")
    parser.add_argument("--law", type=_laws, metavar="NAME", help="laws, with commas, against elastic and a user's own")
    parser.add_argument("--law-active", action="store_true", help="stretch the specimen at first: its bonds soften")
    parser.add_argument("--no-users", action="store_true", help="time no user's own law beside a law")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append the records to the list in this file")
    parser.add_argument("--repeats", type=_number, default=5)
    parser.add_argument("--seconds", type=float, default=0.6, help="of each repeat")
    parser.add_argument("--steps", type=_number, help="of each repeat, instead of --seconds")
    parser.add_argument("--no-start", action="store_true", help="do not time compilation and start-up (a minute)")
    return parser.parse_args(words)


def _number(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} must be 1 or more")
    return value


def _laws(text: str) -> list[str]:
    found = text.split(",")
    unknown = [name for name in found if name not in user_law.names()]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no law {unknown[0]!r}; there are {', '.join(user_law.names())}")
    return found


def _numbers(text: str) -> list[int]:
    return [_number(part.replace("_", "")) for part in text.split(",")]


# Measuring ------------------------------------------------------------------------------------------------------


def start_up(engine: str, law: str | None = None) -> dict[str, float]:
    """Return the seconds to the first step with nothing compiled yet, with all in the cache, and their difference."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {n: v for n, v in os.environ.items() if n != "NUMBA_CACHE_DIR"} | {"PYBONDEM_CACHE": cache}
        script = [sys.executable, str(Path(__file__).with_name("start.py")), engine, *([law] if law else [])]
        cold, warm = (float(subprocess.check_output(script, env=environment, text=True)) for _ in range(2))
    return {"compile_s": max(0.0, cold - warm), "cold_start_s": cold, "warm_start_s": warm}


def measure(particles: int, engine: str, threads: int | None, options: argparse.Namespace) -> dict[str, Any]:
    """Return the record of one size on one engine, without what is the same for all."""
    ranks = threads or 1
    mine = {"particles": particles, "engine": engine, "threads": threads}
    with Contender("ours.py", mine, []) as ours:
        if options.peer is None:
            steps, samples = _timed([ours], options)
            return _record(mine, ours, steps[0], samples[0])
        with Contender("lammps_peer.py", {"particles": particles}, lammps_peer.launcher(ranks), ranks) as peer:
            difference = _difference(ours, peer)
            steps, samples = _timed([ours, peer], options)
            record = _record(mine, ours, steps[0], samples[0])
            theirs = _figures(peer.facts["bonds"], steps[1], samples[1])
            ratios = {
                name: theirs[key]["median"] / record[key]["median"]
                for name, key in (("ratio", "ns_per_bond_step"), ("ratio_cpu", "ns_per_bond_step_cpu"))
            }
            record["peer"] = {**peer.facts, "ranks": ranks, **theirs, **ratios, "velocity_difference": difference}
            return record


def measure_law(
    name: str, particles: int, engine: str, threads: int | None, options: argparse.Namespace
) -> dict[str, Any]:
    """Return the record of a law, timed in turns with the elastic bond and, unless told not to, the law of a user."""
    mine = {"particles": particles, "engine": engine, "threads": threads, "active": options.law_active}
    with ExitStack() as stack:
        elastic = stack.enter_context(Contender("ours.py", mine, []))
        ours = stack.enter_context(Contender("ours.py", mine | {"law": name}, []))
        every = [ours, elastic]
        if not options.no_users:
            every.append(stack.enter_context(Contender("ours.py", mine | {"law": name, "users": True}, [])))
        steps, samples = _timed([*every], options)
        record = _record(mine, ours, steps[0], samples[0])
        figures = [_figures(c.facts["bonds"], n, s) for c, n, s in zip(every, steps, samples, strict=True)]
    compared = [("over_elastic", 0, 1), *([] if options.no_users else [("users_over_built_in", 2, 0)])]
    ratios = {
        f"{word}{suffix}": _ratio(figures[a][key], figures[b][key])
        for word, a, b in compared
        for suffix, key in (("", "ns_per_bond_step"), ("_cpu", "ns_per_bond_step_cpu"))
    }
    beside = dict(zip(("elastic", "users"), figures[1:], strict=False))  # no user's where none was asked for
    return record | {
        "law": {"name": name, "active": options.law_active, "damaged": record.pop("damaged"), **beside, **ratios}
    }


def _ratio(above: dict[str, Any], below: dict[str, Any]) -> float:
    """Return the median over the rounds of how much longer one takes: what disturbs a round disturbs both."""
    return median(a / b for a, b in zip(above["all"], below["all"], strict=True))


def _timed(contenders: list[Contender], options: argparse.Namespace) -> tuple[list[int], list[list[Sample]]]:
    """Return the steps of a repeat and the samples of each contender, taken in turns: A B A B."""
    steps = [c.steps_for(options.seconds) if options.steps is None else options.steps for c in contenders]
    return steps, _in_turns(contenders, steps, options.repeats)


def _in_turns(contenders: Sequence[Contender], steps: list[int], repeats: int) -> list[list[Sample]]:
    """Return the samples of each contender, taken in turns: A B C A B C."""
    rounds = [[c.advance(n) for c, n in zip(contenders, steps, strict=True)] for _ in range(repeats)]
    return [list(samples) for samples in zip(*rounds, strict=True)]


def _difference(ours: Contender, peer: Contender) -> float:
    """Return how far the velocities of both are apart after the first steps, over their own size (root mean squares).

    Raises RuntimeError where the two do not run the same model.
    """
    for name in ("particles", "bonds"):
        if ours.facts[name] != peer.facts[name]:
            raise RuntimeError(f"the peer has {peer.facts[name]} {name}, we have {ours.facts[name]}.")
    steps = int(np.clip(1_000_000 // ours.facts["particles"], 10, 100))
    for contender in (ours, peer):
        contender.advance(steps)
    a, b = ours.velocities(), peer.velocities()
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(a**2)))


def _figures(bonds: int, steps: int, samples: list[Sample]) -> dict[str, Any]:
    """Return the times of the samples, wall and process CPU, in ns per bond and step."""
    found: dict[str, Any] = {}
    for key, values in (
        ("ns_per_bond_step", [s.wall for s in samples]),
        ("ns_per_bond_step_cpu", [s.cpu for s in samples]),
    ):
        ns = [1e9 * value / (bonds * steps) for value in values]
        middle, low, high = median(ns), min(ns), max(ns)
        found[key] = {"median": middle, "low": low, "high": high, "spread": (high - low) / middle, "all": ns}
    return found | {"steps": steps, "repeats": len(samples)}


def _record(asked: dict[str, Any], ours: Contender, steps: int, samples: list[Sample]) -> dict[str, Any]:
    figures = _figures(ours.facts["bonds"], steps, samples)
    step = median(s.wall for s in samples) / steps
    return {
        "engine": asked["engine"], "threads": asked["threads"], "asked": asked["particles"], **ours.facts, **figures,
        "particle_steps_per_s": ours.facts["particles"] / step, **ours.finish(), "load_average": _load(),
    }  # fmt: skip


def _load() -> float | None:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


# Showing and keeping --------------------------------------------------------------------------------------------


def cells(record: dict[str, Any]) -> list[str]:
    """Return the cells of a record in the table."""
    wall, cpu = record["ns_per_bond_step"], record["ns_per_bond_step_cpu"]
    shown = record | {"wall": wall["median"], "spread": wall["spread"], "cpu": cpu["median"]}
    if peer := record.get("peer"):
        shown |= {"ratio": peer["ratio"], "ratio_cpu": peer["ratio_cpu"]}
        shown |= {"peer_wall": peer["ns_per_bond_step"]["median"], "peer_cpu": peer["ns_per_bond_step_cpu"]["median"]}
    if law := record.get("law"):
        shown |= {"law_name": law["name"], "active": "yes" if law["active"] else "no"}
        shown |= {
            f"{who}_cpu": law[who]["ns_per_bond_step_cpu"]["median"] for who in ("elastic", "users") if who in law
        }
        shown |= {word: law.get(f"{word}_cpu") for word in ("over_elastic", "users_over_built_in")}
    return ["-" if shown.get(key) is None else format(shown[key], style) for _, key, style in COLUMNS]


def table(records: list[dict[str, Any]]) -> str:
    """Return the records as a table: wall and process-CPU time in ns per bond and step, medians of the repeats."""
    rows = [[head for head, _, _ in COLUMNS], *map(cells, records)]
    kept = [k for k in range(len(COLUMNS)) if any(row[k] != "-" for row in rows[1:])]
    width = {k: max(len(row[k]) for row in rows) for k in kept}
    return "\n".join("  ".join(row[k].rjust(width[k]) for k in kept) for row in rows)


def append(path: Path, records: list[dict[str, Any]]) -> None:
    """Append records to the JSON list in a file, made where it is not there. Raises SystemExit for another content."""
    kept = json.loads(path.read_text()) if path.exists() else []
    if not isinstance(kept, list):
        sys.exit(f"{path} does not hold a JSON list; nothing was written.")
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".part")
    fresh.write_text(json.dumps([*kept, *records], indent=1) + "\n")
    os.replace(fresh, path)


def main(words: list[str] | None = None) -> None:
    """Measure what the command line asks for."""
    options = arguments(words)
    if options.peer == "lammps" and not lammps_peer.installed():
        sys.exit(lammps_peer.MISSING)
    if options.law_active and not options.law:
        sys.exit("--law-active is for --law NAME.")
    if options.peer and options.law:
        sys.exit("--peer and --law cannot be timed together: the peer has laws of its own.")
    records: list[dict[str, Any]] = []
    for engine, law in product(options.engine, options.law or [None]):
        start = {} if options.no_start else start_up(engine, law)
        for particles, threads in product(options.particles, options.threads if engine in THREADED else [None]):
            said = f"{engine}, {particles} particles, {threads or 'no'} threads{f', {law}' if law else ''}"
            print(f"{said} ...", file=sys.stderr, flush=True)
            case = (particles, engine, threads, options)
            found = measure(*case) if law is None else measure_law(law, *case)
            records.append({"job": options.job, **circumstances(), **found, **start})
            if options.json:
                append(options.json, records[-1:])
    print(table(records))
    for record in records:
        if "peer" in record:
            away = record["peer"]["velocity_difference"]
            print(f"{record['particles']:,} particles: velocities of the peer differ from ours by {away:.1e}.")


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, subprocess.CalledProcessError) as error:
        sys.exit(f"The benchmark failed: {error}")
