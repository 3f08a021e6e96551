"""The closing block of a run: what it cost, whether it can be trusted, and what to open."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pybondem.output.readable import compact, duration, quantity

if TYPE_CHECKING:
    from rich.console import Console

# The largest Ek/Es of a run. Below the first value inertia is beyond notice in any figure; the second is the usual
# bound for calling an explicit run quasi-static (kinetic energy at most 5 % of internal energy).
QUASI_STATIC = 1e-3
NEARLY_QUASI_STATIC = 5e-2
# The residual of the energy book over its largest term.
ENERGY_CLOSES = 1e-3
ENERGY_DOUBTFUL = 1e-2
# Unbalanced force ratio at the end: 1e-3 is one part in a thousand of the mean force.
IN_EQUILIBRIUM = 1e-3

_STYLES = {"good": "green", "fair": "yellow", "bad": "bold red"}


STEPS = "time steps"  # the share of wall time that speed is taken from


class Verdict(NamedTuple):
    """A judgement in words: ``grade`` is ``"good"``, ``"fair"`` or ``"bad"``."""

    grade: str
    words: str


def verdicts(
    *,
    kinetic_ratio: float | None = None,
    energy_error: float | None = None,
    unbalanced: float | None = None,
) -> list[Verdict]:
    """Say in words what the checks of a run mean; a check that is None is left out.

    Parameters
    ----------
    kinetic_ratio : largest kinetic over strain energy of the run; leave it out of a run that is meant to be dynamic.
    energy_error : largest residual of the energy book over its largest term.
    unbalanced : unbalanced-force ratio at the end; leave it out of a run that is not meant to end at rest.

    All three are dimensionless. NaN is judged bad: a check that cannot be computed is no comfort.
    """
    found = []
    if kinetic_ratio is not None:
        found.append(_about_inertia(kinetic_ratio))
    if energy_error is not None:
        found.append(_about_energy(abs(energy_error)))
    if unbalanced is not None:
        if unbalanced < IN_EQUILIBRIUM:
            found.append(Verdict("good", f"in equilibrium: unbalanced force ratio {compact(unbalanced, 1)} at the end"))
        else:
            words = f"not in equilibrium: unbalanced force ratio {compact(unbalanced, 1)} at the end"
            found.append(Verdict("fair" if unbalanced < 10 * IN_EQUILIBRIUM else "bad", words))
    return found


def closing_block(
    title: str,
    *,
    wall: float,
    steps: int,
    particles: int,
    outcome: str = "done",
    time: float | None = None,
    shares: Mapping[str, float] | None = None,
    energy_error: float | None = None,
    kinetic_ratio: float | None = None,
    unbalanced: float | None = None,
    broken: int | None = None,
    total_bonds: int | None = None,
    facts: Mapping[str, str] | None = None,
    files: Mapping[str, str | Path] | None = None,
    quiet: bool = False,
    console: Console | None = None,
) -> None:
    """Print what a run leaves to say: on a terminal as a table with coloured verdicts, elsewhere as plain lines.

    Parameters
    ----------
    title : what ran, such as ``"pull-out"``.
    wall : wall time, s.
    steps, particles : of the run.
    outcome : word after the title, such as ``"done"`` or ``"stopped by hand"``.
    time : simulated time, s.
    shares : wall time by stage, s, such as ``{"time steps": 3.1, "output": 0.2}``; the speed is that of "time steps".
    energy_error, kinetic_ratio, unbalanced : checks to judge, see :func:`verdicts`.
    broken, total_bonds : numbers of bonds.
    facts : further lines by label, such as ``{"peak load": "16.3 MN at 1.88 mm"}``.
    files : what to open, by what it is, such as ``{"report": "runs/latest/report.html"}``.
    quiet : print nothing.
    console : rich console to print on; by default the standard output.
    """
    if quiet:
        return
    from rich.console import Console

    rows = _cost_rows(wall, steps, particles, time, shares or {})
    if broken is not None:
        rows.append(("broken bonds", f"{broken}" if total_bonds is None else f"{broken} of {total_bonds}"))
    rows += (facts or {}).items()
    judged = verdicts(kinetic_ratio=kinetic_ratio, energy_error=energy_error, unbalanced=unbalanced)
    paths = [(what, _short(path)) for what, path in (files or {}).items()]
    console = console or Console()
    if console.is_terminal or console.is_jupyter:
        _print_rich(console, f"{title} {outcome}", rows, judged, paths)
    else:
        _print_plain(console, f"{title} {outcome}", rows, judged, paths)


def _about_inertia(ratio: float) -> Verdict:
    if ratio <= 0.0:
        return Verdict("good", "static: there was no kinetic energy")
    if ratio < QUASI_STATIC:
        return Verdict("good", f"quasi-static: Ek/Es stayed under 1e{math.floor(math.log10(ratio)) + 1}")
    if ratio < NEARLY_QUASI_STATIC:
        return Verdict("fair", f"nearly quasi-static: Ek/Es reached {compact(ratio, 1)}; load more slowly to be sure")
    return Verdict(
        "bad", f"not quasi-static: Ek/Es reached {compact(ratio, 1)}; forces include inertia, load more slowly"
    )


def _about_energy(error: float) -> Verdict:
    if error < ENERGY_CLOSES:
        return Verdict("good", f"energy closes: off by {compact(error, 1)} of the largest term")
    if error < ENERGY_DOUBTFUL:
        return Verdict("fair", f"energy nearly closes: off by {compact(error, 1)}; a smaller time step would help")
    return Verdict(
        "bad", f"energy does not close: off by {compact(error, 1)}; do not trust this run, lower the time step"
    )


def _cost_rows(
    wall: float, steps: int, particles: int, time: float | None, shares: Mapping[str, float]
) -> list[tuple[str, str]]:
    stepping = shares.get(STEPS, wall)
    speed = steps * particles / stepping if stepping > 0.0 else float("nan")
    rows = [
        ("wall time", duration(wall) if wall >= 60.0 else quantity(wall, "s")),
        ("speed", f"{compact(speed)} particle-steps/s  ({steps} steps, {particles} particles)"),
    ]
    total = sum(shares.values())
    if total > 0.0:
        parts = sorted(shares.items(), key=lambda item: -item[1])
        rows.append(("time spent", "  ".join(f"{name} {100 * part / total:.0f} %" for name, part in parts)))
    if time is not None:
        rows.append(("simulated", quantity(time, "s")))
    return rows


def _short(path: str | Path) -> str:
    """The path as it can be typed from here."""
    path = Path(path)
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


def _print_rich(
    console: Console,
    heading: str,
    rows: list[tuple[str, str]],
    judged: list[Verdict],
    paths: list[tuple[str, str]],
) -> None:
    from rich.style import Style
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for label, words in rows:
        table.add_row(Text(label), Text(words))
    for k, verdict in enumerate(judged):
        table.add_row(Text("" if k else "verdict"), Text(verdict.words, style=_STYLES[verdict.grade]))
    for label, path in paths:
        link = Style(color="cyan", link=Path(path).absolute().as_uri())
        table.add_row(Text(label), Text(path, style=link))
    console.print()
    console.print(Text(heading, style="bold"))
    console.print(table)


def _print_plain(
    console: Console,
    heading: str,
    rows: list[tuple[str, str]],
    judged: list[Verdict],
    paths: list[tuple[str, str]],
) -> None:
    lines = [*rows, *(("verdict", f"{verdict.words} ({verdict.grade})") for verdict in judged), *paths]
    wide = max(len(label) for label, _ in lines)
    text = [heading, *(f"  {label:<{wide}}  {words}" for label, words in lines)]
    console.print("\n".join(text), markup=False, highlight=False, soft_wrap=True)
