"""Figure 4 of the paper: load against displacement through snap-back, by two drivers, against the analytic path.

Loading and unloading in explicit dynamics (the paper's strategy) and dissipation control, each with two settings of its
steps, on the clean case; and an interface that keeps a residual friction.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.damping import local
from pybondem.drivers import dissipation_control, load_unload
from pybondem.examples.pullout import PullOutTest, pullout
from pybondem.laws.library.bilinear_residual import bilinear_residual
from pybondem.output.figures import INK, PALETTE, axis_label, styled_figure
from pybondem.output.readable import compact, si_scale
from pybondem.output.sheet import Sheet, Table
from pybondem.paper.effort import Effort
from pybondem.theory import PullOut

Floats = NDArray[np.float64]
DIAMETER = 1.0  # of the particles [m]
RESIDUAL = 0.3  # of the strength: friction of the third curve
POINTS = 4000  # of the analytic path
PULLS = 30.0  # transits of a wave through the bonded length in which the displacement of the peak is reached
TURN = 3.0  # transits in which the end goes over from one velocity to another
BEYOND = 1.2  # times the largest displacement of the path: where loading is given up
HEADS = ("driver", "points", "largest distance from the path", "mean", "of the path from the points", "cost")


class Exact(NamedTuple):
    """An analytic path: displacement [m] and load [N], with the fibre that slides out against friction at its end."""

    displacement: Floats
    load: Floats


class Curve(NamedTuple):
    """What a driver has found: displacement [m] and load [N] of its points; its cost in words, seconds.

    reloads: displacement and load of each loading on the way to a point.
    """

    name: str
    displacement: Floats
    load: Floats
    cost: str
    seconds: float
    reloads: tuple[tuple[Floats, Floats], ...] = ()


def figure(folder: Path, effort: Effort) -> Sheet:
    """Make the figure; quick: dissipation control alone, with few steps. A few minutes else."""
    test = pullout(diameter=DIAMETER)
    counts, cycles = ((6,), ()) if effort.quick else ((20, 60), (20, 40))
    curves = [by_dissipation(test, n, effort) for n in counts] + [by_unloading(test, n, effort) for n in cycles]
    rough = pullout(diameter=DIAMETER, interface=bilinear_residual(slip_peak=1e-4, slip_end=4e-4, residual=RESIDUAL,
                                                                   stiffness=6e7))  # fmt: skip
    friction = by_dissipation(rough, counts[0], effort)
    exact, exact_friction = analytic(test.theory()), analytic(rough.theory())
    sheet = Sheet("fig4", "Figure 4: the full failure curve", folder)
    sheet.pictures = {
        "Load against displacement of the pulled end: the analytic path of equilibrium, and points of two drivers. "
        "A residual friction of 0.3 of the strength raises the curve and keeps a load at the end.":
            draw(folder / "fig4.png", curves, exact, friction, exact_friction),
    }  # fmt: skip
    sheet.tables = [Table("Distance of the points from the analytic path, and cost", HEADS,
                          [row(c, exact) for c in curves] + [row(friction, exact_friction)])]  # fmt: skip
    sheet.remarks = REMARKS
    sheet.facts = {
        c.name: {"displacement_m": c.displacement, "load_N": c.load, "distance": distances(c, of), "seconds": c.seconds}
        for c, of in [*((c, exact) for c in curves), (friction, exact_friction)]
    }
    return sheet


# The drivers ----------------------------------------------------------------------------------------------------


def by_dissipation(test: PullOutTest, count: int, effort: Effort) -> Curve:
    """Follow the path with steps that each dissipate 1/count of what debonding takes."""
    built, theory = test.build(effort.engine, effort.threads), test.theory()
    last = theory.residual_load
    path = dissipation_control(
        built.model, built.pulled, test.axis, energy=theory.work_of_debonding / count,
        until=lambda point: point.dissipated > 0.0 and point.load < (1.0 + 1e-3) * last, engine=effort.engine,
        threads=effort.threads, quiet=effort.quiet,
    )  # fmt: skip
    name = f"dissipation control, 1/{count} a step"
    if last > 0.0:
        name += f", friction {RESIDUAL:g} of the strength"
    cost = f"{path.solves} linear solves, {path.seconds:.0f} s"
    return Curve(name, path.displacement[1:], path.load[1:], cost, path.seconds)


def by_unloading(test: PullOutTest, count: int, effort: Effort) -> Curve:
    """Trace the path by loading and unloading, each cycle dissipating 1/count of what debonding takes."""
    built, theory = test.build(effort.engine, effort.threads), test.theory()
    transit = test.length / np.sqrt(min(test.E_fibre, test.E_matrix) / test.density)
    largest = float(theory.path().displacement.max())
    envelope = load_unload(
        built.model, built.pulled, test.axis, growth=theory.work_of_debonding / count,
        speed=theory.peak().displacement / (PULLS * transit), over=TURN * transit, farthest=BEYOND * largest,
        damping=local(0.6), engine=effort.engine, threads=effort.threads, quiet=effort.quiet,
    )  # fmt: skip
    name = f"loading and unloading, 1/{count} a cycle"
    left = max(cycle.residual for cycle in envelope.cycles[:-1]) / largest  # after the last one the fibre is loose
    cost = f"{envelope.steps:,} steps, {envelope.seconds:.0f} s; left at a restart {compact(left, 1)} of the way"
    reloads = tuple((cycle.displacement, cycle.load) for cycle in envelope.cycles)
    return Curve(name, envelope.displacement, envelope.load, cost, envelope.seconds, reloads)


# What is shown --------------------------------------------------------------------------------------------------


def analytic(theory: PullOut) -> Exact:
    """Return the analytic path, and where friction stays the sliding that follows it."""
    path, last = theory.path(POINTS), theory.residual_load
    slides = np.linspace(0.0, theory.slip_end, POINTS // 10)[1:] if last > 0.0 else np.empty(0)
    return Exact(
        np.append(path.displacement, path.displacement[-1] + slides), np.append(path.load, np.full_like(slides, last))
    )


def distances(curve: Curve, exact: Exact) -> Floats:
    """Return the distance of each point from the path, displacement and load over the largest of the path [-]."""
    u, load = exact.displacement / exact.displacement.max(), exact.load / exact.load.max()
    found = zip(curve.displacement / exact.displacement.max(), curve.load / exact.load.max(), strict=True)
    return np.array([np.hypot(u - x, load - y).min() for x, y in found])


def missed(curve: Curve, exact: Exact) -> float:
    """Return the largest distance of the path from the line through the points, the origin before them [-].

    A path that slides on without end is taken as far as the last point.
    """
    size = exact.displacement.max(), exact.load.max()
    points = [np.append(0.0, v) / s for v, s in zip((curve.displacement, curve.load), size, strict=True)]
    path = np.array([exact.displacement / size[0], exact.load / size[1]])
    if exact.load[-1] > 0.0:
        path = path[:, : int(np.hypot(path[0] - points[0][-1], path[1] - points[1][-1]).argmin())]
    steps = np.arange(len(points[0]))
    line = [np.interp(np.linspace(0.0, steps[-1], 40 * len(steps)), steps, v) for v in points]
    return max(float(np.hypot(line[0] - u, line[1] - load).min()) for u, load in path.T[::10])


def row(curve: Curve, exact: Exact) -> list[Any]:
    """Return the row of a curve in the table."""
    apart = 100.0 * distances(curve, exact)
    back = 100.0 * missed(curve, exact)
    return [curve.name, len(apart), f"{apart.max():.2f} %", f"{apart.mean():.2f} %", f"{back:.2f} %", curve.cost]


def draw(path: Path, curves: Sequence[Curve], exact: Exact, friction: Curve, rough: Exact) -> Path:
    """Draw the curves over the analytic paths, and return the picture's path."""
    every = [*curves, friction]
    mm, _ = si_scale(float(exact.displacement.max()), "m")
    kn, _ = si_scale(float(exact.load.max()), "N")
    with styled_figure(path, width=1.15, height=1.45) as picture:
        axes = picture.add_subplot()
        for u, load in next((c.reloads for c in curves if c.reloads), ()):
            axes.plot(mm * u, kn * load, color=PALETTE[5], linewidth=0.6, zorder=1.5)
        for theory, style in ((exact, "-"), (rough, "--")):
            axes.plot(mm * theory.displacement, kn * theory.load, style, color=INK, linewidth=1.4)
        for curve, colour, marker in zip(every, PALETTE, ("o", ".", "s", "^", "D"), strict=False):
            axes.plot(mm * curve.displacement, kn * curve.load, marker, color=colour, label=curve.name, markersize=5)
        axes.set_xlabel(axis_label("displacement of the fibre end", "m", mm))
        axes.set_ylabel(axis_label("load", "N", kn))
        if any(c.reloads for c in curves):
            axes.plot(
                [], [], color=PALETTE[5], linewidth=0.8, label="loading and unloading: the loadings, 1/20 a cycle"
            )
        axes.plot([], [], color=INK, linewidth=1.4, label="theory")
        axes.plot([], [], "--", color=INK, linewidth=1.4, label=f"theory, friction {RESIDUAL:g} of the strength")
        picture.legend(loc="outside lower center", ncols=1, fontsize=10)
    return path


REMARKS = [
    "Clean case: fibre and matrix of 10 GPa, radii 1 m and 6 m, bonded over 30 m, bond 60 MPa/m up to 0.1 mm and gone "
    "at 0.4 mm, free fibre 2 m, matrix held at its far face. Long after the peak load the end has to go back, and the "
    "load falls to nothing on the way.",
    "Distances are those of points from the analytic curve, displacements over the largest displacement of the curve "
    "and loads over its peak. Both drivers see the same lattice, d = 1 m.",
    "Dissipation control solves for equilibrium and dissipates the same energy in each step; its points are "
    "equilibria of the lattice to the tolerance of the solver, so that their distance is that of the lattice from the "
    "one-dimensional theory. Loading and unloading is dynamics: a point is where damage begins to grow on in a "
    "reload, and what overshoots in the motion that ends a cycle stays as damage. The paper reports a curve that "
    "depends on what went before; here it moves by less than the distances of the table when cycles are made half as "
    "large.",
    "Friction: the bond softens to a stress that stays (0.3 of the strength, damage law bilinear_residual). Between "
    "the turning point and the end of snap-back debonded sections slip back a little, which the analytic curve lets "
    "them do without resistance and the law along its secant; all else is the same.",
]
