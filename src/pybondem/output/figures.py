"""Figures of a run in one style: PNG for slides, SVG beside it for papers and the report.

Drawn with matplotlib's objects, never through pyplot: no global figure list, no change of backend, and no change of
the settings of a notebook that calls this.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.errors import InputError
from pybondem.output.readable import si_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curve = tuple[ArrayLike, ArrayLike]  #: x and y of a curve, (k,) each
Numbers = NDArray[np.float64]

SIZE = (7.2, 4.5)  #: inches
DPI = 200  #: pixels per inch of the PNG: 1440 x 900

# Okabe and Ito's colours, told apart with every common form of colour blindness (the yellow is too pale for lines).
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
INK = "#222222"
_BESIDE = 1.15  # width of a figure whose legend stands beside the axes
_FEW_POINTS = 25  # up to here a curve also shows its points
_LEGEND_INSIDE = 5  # up to so many curves the legend finds room inside the axes
_THEORY_DASHES = ((0, (5, 2.5)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
_MARKERS = ("o", "s", "^", "D", "v", "P")

STYLE: dict[Any, Any] = {
    "font.size": 12,
    "font.family": ["DejaVu Sans"],  # comes with matplotlib: the same figure on every machine
    "axes.labelsize": 13,
    "axes.titlesize": 13,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 10,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "axes.unicode_minus": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.frameon": False,
    "legend.handlelength": 3.0,  # three whole dashes of the theory
    "lines.linewidth": 2.2,
    "lines.markersize": 6,
    "lines.solid_capstyle": "round",
    "lines.dash_capstyle": "butt",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "pybondem",  # the same numbers give the same file
}


def line_figure(
    path_png: str | Path,
    x: ArrayLike,
    ys: Mapping[str, ArrayLike],
    *,
    labels: tuple[str, str],
    units: tuple[str, str],
    theory: Mapping[str, Curve] | None = None,
    title: str = "",
    log: str = "",
) -> Path:
    """Curves over a common x: measured ones as coloured lines, theory in dashed black.

    Parameters
    ----------
    path_png : the PNG to write (its folder is made); an SVG of the same name is put beside it.
    x : (k,) in ``units[0]``.
    ys : (k,) in ``units[1]`` by the name for the legend; one curve alone gets no legend. NaN leaves a gap.
    labels, units : of x and y; SI units such as ``"m"``, or ``""``. The figure picks the prefix (mm, MN).
    theory : (x, y) curves in the same units by name.
    log : axes with a logarithmic scale: ``""``, ``"x"``, ``"y"`` or ``"xy"``.

    Returns
    -------
    The path of the PNG.

    Raises
    ------
    InputError : no curve, lengths that differ, values that are not real numbers, or a path that is not a PNG.
    """
    if not ys:
        raise InputError(f"figure {Path(path_png).name}: ys is empty; give at least one curve by name.")
    if log not in ("", "x", "y", "xy"):
        raise InputError(f"figure {Path(path_png).name}: log is {log!r}; take '', 'x', 'y' or 'xy'.")
    measured = {name: _curve(x, y, name) for name, y in ys.items()}
    expected = {name: _curve(*curve, name) for name, curve in (theory or {}).items()}
    many = len(measured) + len(expected) > _LEGEND_INSIDE
    with styled_figure(path_png, width=_BESIDE if many else 1.0) as figure:
        axes = figure.add_subplot()
        scale = _label_axes(axes, [*measured.values(), *expected.values()], labels, units)
        for (name, curve), look in zip(measured.items(), _looks(), strict=False):
            axes.plot(*_scaled(curve, scale), label=name, marker=_marker(curve), **look)
        _draw_theory(axes, expected, scale)
        for letter in log:
            _make_logarithmic(axes, letter)
        axes.set_title(title)
        if many:
            figure.legend(loc="outside right upper")
        elif len(measured) + len(expected) > 1:
            axes.legend()
    return Path(path_png)


def curve_against_theory(
    path_png: str | Path,
    measured: Curve,
    theory: Curve,
    *,
    labels: tuple[str, str],
    units: tuple[str, str],
    names: tuple[str, str] = ("simulation", "theory"),
    marks: Mapping[str, tuple[float, float]] | None = None,
    title: str = "",
) -> Path:
    """One measured curve with the theory over it, such as load over slip of a pull-out.

    Parameters
    ----------
    path_png : the PNG to write (its folder is made); an SVG of the same name is put beside it.
    measured, theory : (x, y), (k,) each, in ``units``; the two may have different numbers of points.
    labels, units : of x and y; SI units such as ``"m"``, or ``""``. The figure picks the prefix (mm, MN).
    names : of the two curves in the legend.
    marks : points to name on the figure, such as ``{"peak": (1.9e-3, 1.6e7)}``, in ``units``.

    Returns
    -------
    The path of the PNG.

    Raises
    ------
    InputError : lengths that differ, values that are not real numbers, or a path that is not a PNG.
    """
    seen, expected = _curve(*measured, names[0]), _curve(*theory, names[1])
    with styled_figure(path_png) as figure:
        axes = figure.add_subplot()
        scale = _label_axes(axes, [seen, expected], labels, units)
        axes.plot(*_scaled(seen, scale), color=PALETTE[0], label=names[0], marker=_marker(seen), linewidth=2.8)
        _draw_theory(axes, {names[1]: expected}, scale)
        for name, (x, y) in (marks or {}).items():
            place = (x * scale[0], y * scale[1])
            axes.plot(*place, "o", color="white", markeredgecolor=PALETTE[1], markeredgewidth=2, zorder=5)
            offset, edge = (-4, "top") if _rises_to_the_right(seen, x, y) else (4, "bottom")
            axes.annotate(name, place, xytext=(9, offset), textcoords="offset points", va=edge, color=PALETTE[1])
        axes.set_title(title)
        axes.legend()
    return Path(path_png)


def profiles_against_theory(
    path_png: str | Path,
    measured: Mapping[str, Curve],
    theory: Mapping[str, Curve],
    *,
    labels: tuple[str, str],
    units: tuple[str, str],
    legend_title: str = "",
    title: str = "",
) -> Path:
    """Profiles at several stages, such as bond stress along a fibre: points are measured, lines are theory.

    Parameters
    ----------
    path_png : the PNG to write (its folder is made); an SVG of the same name is put beside it.
    measured : (x, y) by stage, in the order of the legend; colours run from the first stage to the last.
    theory : (x, y) by stage, for all stages or some of them.
    labels, units : of x and y; SI units such as ``"m"``, or ``""``. The figure picks the prefix (mm, MPa).
    legend_title : says what the stages are, such as ``"end displacement"``.

    Returns
    -------
    The path of the PNG.

    Raises
    ------
    InputError : no stage, a stage of theory that is not measured, lengths that differ, values that are not real
        numbers, or a path that is not a PNG.
    """
    if not measured:
        raise InputError(f"figure {Path(path_png).name}: measured is empty; give at least one stage by name.")
    odd = [stage for stage in theory if stage not in measured]
    if odd:
        raise InputError(f"figure {Path(path_png).name}: theory has stage {odd[0]!r}, which is not in measured.")
    seen = {stage: _curve(*curve, stage) for stage, curve in measured.items()}
    expected = {stage: _curve(*curve, stage) for stage, curve in theory.items()}
    with styled_figure(path_png, width=_BESIDE) as figure:
        axes = figure.add_subplot()
        scale = _label_axes(axes, [*seen.values(), *expected.values()], labels, units)
        keys = []
        for (stage, curve), colour, marker in zip(seen.items(), _ramp(len(seen)), cycle(_MARKERS), strict=False):
            axes.plot(*_scaled(curve, scale), marker, color=colour, markeredgecolor="white", markeredgewidth=0.6)
            if stage in expected:
                axes.plot(*_scaled(expected[stage], scale), color=colour, linewidth=1.8, zorder=1.8)
            keys.append(_key(stage, color=colour, marker=marker, line=stage in expected))
        axes.set_title(title)
        figure.legend(handles=keys, title=legend_title or None, loc="outside right upper", alignment="left")
        _say_points_and_lines(axes, bool(expected))
    return Path(path_png)


def energy_book(
    path_png: str | Path,
    time: ArrayLike,
    columns: Mapping[str, ArrayLike],
    residual: ArrayLike,
    *,
    title: str = "",
) -> Path:
    """All columns of the energy book over time, and below them what is missing for the book to close.

    The lower panel shows ``residual`` as a share of the largest magnitude that any column ever reaches.

    Parameters
    ----------
    path_png : the PNG to write (its folder is made); an SVG of the same name is put beside it.
    time : (k,) s.
    columns : (k,) J by name: kinetic, strain, dissipated by each means, work of the boundaries.
    residual : (k,) J.

    Returns
    -------
    The path of the PNG.

    Raises
    ------
    InputError : no column, lengths that differ, values that are not real numbers, or a path that is not a PNG.
    """
    if not columns:
        raise InputError(f"figure {Path(path_png).name}: columns is empty; give at least one energy by name.")
    curves = {name: _curve(time, values, name) for name, values in columns.items()}
    missing = _curve(time, residual, "residual")
    largest = max(_largest([curve], 1) for curve in curves.values())
    with styled_figure(path_png, width=_BESIDE, height=1.2) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
        scale = _label_axes(upper, list(curves.values()), ("time", "energy"), ("s", "J"))
        upper.set_xlabel("")
        for (name, curve), look in zip(curves.items(), _looks(), strict=False):
            upper.plot(*_scaled(curve, scale), label=name, **look)
        upper.set_title(title)
        figure.legend(loc="outside right upper")
        share = missing[1] / largest if largest > 0.0 else missing[1]
        lower.axhline(0.0, color=INK, linewidth=0.8)
        lower.plot(missing[0] * scale[0], share, color=INK, linewidth=1.6)
        lower.set_ylabel("residual /\nlargest term")
        lower.set_xlabel(axis_label("time", "s", scale[0]))
        lower.locator_params(axis="y", nbins=3)
        figure.align_ylabels()
    return Path(path_png)


@contextmanager
def styled_figure(path_png: str | Path | None, width: float = 1.0, height: float = 1.0) -> Iterator[Figure]:
    """A figure in the package's style; saved as PNG and SVG, at a path, when the block ends without an error."""
    path = None if path_png is None else Path(path_png)
    if path is not None and path.suffix.lower() != ".png":
        raise InputError(f"figure {path} must be a .png; the .svg is put beside it.")
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(SIZE[0] * width, SIZE[1] * height), layout="constrained")
        yield figure
        if path is None:
            figure.draw_without_rendering()  # ticks take the style when they are first drawn
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=DPI)
            figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})


def _curve(x: ArrayLike, y: ArrayLike, name: str) -> tuple[Numbers, Numbers]:
    both = []
    for values in (x, y):
        array = np.asanyarray(values)
        if isinstance(array, np.ma.MaskedArray) or array.dtype.kind not in "fiub":
            raise InputError(f"curve {name!r} must be real numbers, not {array.dtype}.")
        both.append(np.asarray(array, dtype=np.float64))
    if both[0].ndim != 1 or both[0].shape != both[1].shape or both[0].size == 0:
        raise InputError(f"curve {name!r} has x of shape {both[0].shape} and y of {both[1].shape}; both must be (k,).")
    return both[0], both[1]


def _largest(curves: Sequence[tuple[Numbers, Numbers]], axis: int) -> float:
    finite = [np.abs(curve[axis][np.isfinite(curve[axis])]) for curve in curves]
    return max((float(values.max()) for values in finite if values.size), default=0.0)


def _label_axes(
    axes: Axes, curves: Sequence[tuple[Numbers, Numbers]], labels: tuple[str, str], units: tuple[str, str]
) -> tuple[float, float]:
    """Write the axis labels and return the factors that bring x and y to the units named there."""
    factors = tuple(si_scale(_largest(curves, axis), units[axis])[0] for axis in (0, 1))
    axes.set_xlabel(axis_label(labels[0], units[0], factors[0]))
    axes.set_ylabel(axis_label(labels[1], units[1], factors[1]))
    return factors[0], factors[1]


def axis_label(label: str, unit: str, factor: float) -> str:
    """Text of an axis whose numbers are multiplied by a factor, with the prefixed unit: ``end displacement [mm]``."""
    prefixed = si_scale(1.0 / factor, unit)[1]
    return f"{label} [{prefixed}]" if prefixed else label


def _scaled(curve: tuple[Numbers, Numbers], factors: tuple[float, float]) -> tuple[Numbers, Numbers]:
    return curve[0] * factors[0], curve[1] * factors[1]


def _rises_to_the_right(curve: tuple[Numbers, Numbers], x: float, y: float) -> bool:
    """Whether the branch of the curve that leaves its point nearest to (x, y) to the right goes up there."""
    spans = [float(np.ptp(values[np.isfinite(values)])) or 1.0 for values in curve]
    near = int(np.nanargmin(((curve[0] - x) / spans[0]) ** 2 + ((curve[1] - y) / spans[1]) ** 2))
    step = max(curve[0].size // 20, 1)
    sides = (max(near - step, 0), min(near + step, curve[0].size - 1))
    right = max(sides, key=lambda k: curve[0][k])  # the earlier point, where the path snaps back
    return bool(curve[1][right] > curve[1][near] + 0.02 * spans[1])


def _make_logarithmic(axes: Axes, letter: str) -> None:
    """A logarithmic axis; one of few decades gets plain numbers at 1, 2 and 5."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set(**{f"{letter}scale": "log"})
    axis = axes.xaxis if letter == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    if low > 0.0 and high / low < 1e2:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _draw_theory(axes: Axes, curves: Mapping[str, tuple[Numbers, Numbers]], scale: tuple[float, float]) -> None:
    for (name, curve), dashes in zip(curves.items(), cycle(_THEORY_DASHES), strict=False):
        axes.plot(*_scaled(curve, scale), color="black", linestyle=dashes, linewidth=1.8, label=name, zorder=3)


def _looks() -> Iterator[dict[str, Any]]:
    """Colour and line style of the first curve, the second, ...: all colours solid, then all dash-dotted, and so on."""
    for linestyle in cycle(("-", "-.", ":")):
        for colour in PALETTE:
            yield {"color": colour, "linestyle": linestyle}


def _marker(curve: tuple[Numbers, Numbers]) -> str:
    return "o" if curve[0].size <= _FEW_POINTS else ""


def _ramp(count: int) -> list[Any]:
    """Colours in order from dark to light, for stages that follow one another."""
    from matplotlib import colormaps

    return [colormaps["viridis"](place) for place in np.linspace(0.0, 0.82, count)]


def _key(name: str, *, color: Any, marker: str, line: bool) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, marker=marker, linestyle="-" if line else "", label=name, linewidth=1.8)


def _say_points_and_lines(axes: Axes, theory: bool) -> None:
    if theory:
        axes.annotate(
            "points: simulation    lines: theory",
            (1.0, 1.0),
            xytext=(0, 6),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=11,
            color="#555555",
        )
