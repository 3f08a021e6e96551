"""The two pictures of figure 1: time of a step by number of particles, and how many times faster than interpreted."""

from collections.abc import Iterator, Sequence
from math import log10, sqrt
from pathlib import Path
from typing import TYPE_CHECKING

from pybondem.output.figures import INK, PALETTE, styled_figure
from pybondem.paper.speed_timing import Kind, Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# From the slowest down: colour and marker of each kind; a second GPU and more take further colours.
LOOKS: dict[Kind, tuple[str, str]] = {
    "interpreted": (PALETTE[1], "s"),
    "numpy": (PALETTE[4], "^"),
    "numba": (PALETTE[5], "o"),
    "threads": (PALETTE[0], "D"),
    "gpu": (PALETTE[2], "v"),
}
MORE_GPUS = (PALETTE[2], PALETTE[3])
PAPERS_SIZES = (1_000, 10_000)
# How many times faster than their interpreted Python, as the paper's section 3.1 says.
CPU_OF_PAPER, GPU_OF_PAPER = (1000, 1500), (1000, 5500)
GREY = "#666666"
APART = 0.05  # of the height of the axes: names at the ends of curves keep this distance
Row = tuple[float, float, float, float]  # x, lower end, middle, upper end


def draw_times(path: Path, points: Sequence[Point]) -> Path:
    """Draw the time of a step over the number of particles, medians with their quartiles, and return the path."""
    with styled_figure(path, width=1.2, height=1.15) as figure:
        axes = figure.add_subplot()
        _logarithmic(axes, "s")
        axes.set_ylabel("time of a step")
        ends = [
            _curve(axes, [(p.particles, *p.quartiles) for p in own], name, colour, marker)
            for name, colour, marker, own in series(points)
        ]
        axes.axvspan(*PAPERS_SIZES, color="#F1F1F1", zorder=0, linewidth=0)
        middle = sqrt(PAPERS_SIZES[0] * PAPERS_SIZES[1])
        axes.annotate(
            "sizes of the paper", (middle, 1.0), xycoords=axes.get_xaxis_transform(), xytext=(0, -5),
            textcoords="offset points", ha="center", va="top", fontsize=10, color=GREY,
        )  # fmt: skip
        _name_ends(axes, ends)
    return path


def draw_gains(path: Path, points: Sequence[Point]) -> Path:
    """Draw how many times faster than interpreted Python each is, with what the paper quotes, and return the path."""
    from matplotlib.ticker import LogLocator

    base = {p.particles: p for p in points if p.kind == "interpreted"}
    with styled_figure(path, width=1.2, height=1.15) as figure:
        axes = figure.add_subplot()
        _logarithmic(axes, "")
        axes.set_ylabel("times faster than interpreted Python")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        _quote(axes)
        ends = []
        for name, colour, marker, own in series(points):
            rows = [(p.particles, *_gain(base[p.particles], p)) for p in own if p.particles in base]
            if rows and own[0].kind != "interpreted":
                ends.append(_curve(axes, rows, name, colour, marker))
        _name_ends(axes, ends)
    return path


def series(points: Sequence[Point]) -> Iterator[tuple[str, str, str, list[Point]]]:
    """Yield name, colour, marker and points of each curve, from interpreted Python to GPUs."""
    for kind, (colour, marker) in LOOKS.items():
        for number, label in enumerate(dict.fromkeys(p.label for p in points if p.kind == kind)):
            own = sorted((p for p in points if p.label == label), key=lambda p: p.particles)
            yield label, [colour, *MORE_GPUS[1:], INK][min(number, len(MORE_GPUS))], marker, own


def _gain(base: Point, point: Point) -> tuple[float, float, float]:
    """Return the least ratio that the quartiles allow, the ratio of the medians, and the largest one."""
    low, middle, high = base.quartiles
    own_low, own_middle, own_high = point.quartiles
    return low / own_high, middle / own_middle, high / own_low


def _curve(axes: "Axes", rows: Sequence[Row], name: str, colour: str, marker: str) -> tuple[float, float, str, str]:
    """Draw a curve with bars; returns its last point, its name and its colour."""
    x, low, middle, high = zip(*rows, strict=True)
    reach = [[m - a for m, a in zip(middle, low, strict=True)], [b - m for m, b in zip(middle, high, strict=True)]]
    axes.errorbar(
        x, middle, reach, color=colour, marker=marker, markeredgecolor="white", markeredgewidth=0.6, capsize=3,
        elinewidth=1.4,
    )  # fmt: skip
    return x[-1], middle[-1], name, colour


def _name_ends(axes: "Axes", ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Write the name of each curve to the right of its last point, names at the same place above one another."""
    bottom, top = (log10(y) for y in axes.get_ylim())
    lowest: dict[int, float] = {}  # by decade of x
    for x, y, name, colour in sorted(ends, key=lambda end: end[1]):
        place, height = round(log10(x)), (log10(y) - bottom) / (top - bottom)
        lines = _in_two_lines(name)
        height = max(height, lowest.get(place, -1.0))
        lowest[place] = height + APART * (1 + lines.count("\n"))
        axes.annotate(
            lines, (x, 10.0 ** (bottom + height * (top - bottom))), xytext=(9, 0), textcoords="offset points",
            va="center", color=colour, fontsize=11.5, fontweight="bold", annotation_clip=False,
        )  # fmt: skip


def _in_two_lines(name: str) -> str:
    """Return a name that leaves room for the curves beside it: broken after the first word, but for short ones."""
    first, _, rest = name.partition(" ")
    return f"{first} {rest}" if first == "Numba," else f"{first}\n{rest}"


def _quote(axes: "Axes") -> None:
    """Mark the ratios that the paper quotes."""
    from matplotlib.patches import Rectangle

    first, last = PAPERS_SIZES
    for (low, high), face in ((GPU_OF_PAPER, "#EBEBEB"), (CPU_OF_PAPER, "#D3D3D3")):
        axes.add_patch(Rectangle((first, low), last - first, high - low, facecolor=face, linewidth=0, zorder=0.5))
    for text, y, offset, edge in (
        ("the paper, Numba on a GPU (Quadro K2200): {} to {}".format(*GPU_OF_PAPER), GPU_OF_PAPER[1], 3, "bottom"),
        ("the paper, Numba on one thread: {} to {}".format(*CPU_OF_PAPER), CPU_OF_PAPER[0], -3, "top"),
    ):
        axes.annotate(
            text, (first, y), xytext=(4, offset), textcoords="offset points", va=edge, fontsize=11, color=GREY
        )


def _logarithmic(axes: "Axes", unit: str) -> None:
    """Make both axes logarithmic, the upright one with prefixed units where it has a unit."""
    from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    plain = FuncFormatter(lambda value, _: _in_words(value))
    axes.xaxis.set_major_formatter(plain)
    axes.yaxis.set_major_formatter(EngFormatter(unit) if unit else plain)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("particles")


def _in_words(value: float) -> str:
    """Return a number of particles, or a ratio, as text: 10 000, 1 million."""
    if value >= 1e6:
        return f"{value / 1e6:g} million"
    return f"{value:,.0f}".replace(",", " ") if value >= 1 else f"{value:g}"
