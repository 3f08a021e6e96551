"""The figure of what a law answers: panels in rows that share a quantity and columns that share a path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.output.figures import PALETTE, axis_label, styled_figure
from pybondem.output.readable import si_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Numbers = NDArray[np.float64]

_WIDTH, _ROW, _ROOM = 1.5, 0.48, 0.27  # of the figure, of each row, and for title and x label, in sizes of a figure
_GREY = "#666666"
_HEAD = 0.12  # of the range, kept free above and below the curves


class Line(NamedTuple):
    """One curve: x and y (k,) in SI units, number of its ink, name to stand beside it, and whether it stands back."""

    x: Numbers
    y: Numbers
    ink: int = 0
    name: str = ""
    thin: bool = False


class Level(NamedTuple):
    """What theory says a curve should come to: a value in SI units and its name."""

    value: float
    name: str


class Panel(NamedTuple):
    """The curves in one panel, the last one on top, and the level that they should come to, if one is known."""

    lines: tuple[Line, ...]
    level: Level | None = None


class Row(NamedTuple):
    """One quantity along every path: label, SI unit, panels; together: all of them have one scale."""

    label: str
    unit: str
    panels: tuple[Panel, ...]
    together: bool = False


class Column(NamedTuple):
    """One path: title above it, and label and SI unit of what is along x."""

    title: str
    label: str
    unit: str


def law_figure(
    columns: Sequence[Column], rows: Sequence[Row], *, title: str, note: str, path_png: str | Path | None = None
) -> Figure:
    """Panels of a law's answers: one row for each quantity, one column for each path.

    Parameters
    ----------
    columns, rows : what is drawn; every row has a panel for each column.
    title, note : above the panels; in small letters below them.
    path_png : the PNG to write, if any (its folder is made); an SVG of the same name is put beside it.

    Returns
    -------
    The figure, drawn headless: it has `savefig`, and belongs to no window and no list of figures.

    Raises
    ------
    InputError : a path that is not a PNG.
    """
    with styled_figure(path_png, width=_WIDTH, height=_ROOM + _ROW * len(rows)) as figure:
        axes = figure.subplots(len(rows), len(columns), sharex="col", squeeze=False)
        across = [
            _factor([p.lines for row in rows for p in row.panels[c : c + 1]], 0, x.unit) for c, x in enumerate(columns)
        ]
        for row, row_axes in zip(rows, axes, strict=True):
            up = _factor([panel.lines for panel in row.panels], 1, row.unit)
            for panel, panel_axes, factor in zip(row.panels, row_axes, across, strict=True):
                _draw(panel_axes, panel, (factor, up))
            _scale(row, row_axes, up)
            row_axes[0].set_ylabel(axis_label(row.label, row.unit, up))
        for column, column_axes, factor in zip(columns, axes.T, across, strict=True):
            column_axes[0].set_title(column.title, fontweight="normal")
            column_axes[-1].set_xlabel(axis_label(column.label, column.unit, factor))
        figure.align_ylabels(axes[:, 0])
        figure.suptitle(title, x=0.01, ha="left", fontsize=14, fontweight="bold")
        figure.supxlabel(note, x=0.99, ha="right", fontsize=10.5, color=_GREY)
    return figure


def _factor(lines: Sequence[tuple[Line, ...]], axis: int, unit: str) -> float:
    """Return the factor that brings all of x (0) or y (1) to the prefixed unit of the largest value."""
    values = [np.abs(line[axis]) for panel in lines for line in panel]
    largest = max((float(v[np.isfinite(v)].max(initial=0.0)) for v in values), default=0.0)
    return si_scale(largest, unit)[0]


def _draw(axes: Axes, panel: Panel, factors: tuple[float, float]) -> None:
    """Draw the curves of a panel, their names beside them, and the level."""
    for line in panel.lines:
        width = 1.3 if line.thin else 2.4
        x, y = line.x * factors[0], line.y * factors[1]
        axes.plot(x, y, color=PALETTE[line.ink], label=line.name or "_", linewidth=width)
    if any(np.any(line.y < 0.0) for line in panel.lines):
        axes.axhline(0.0, color="#BBBBBB", linewidth=0.9, zorder=0.9)
    if any(np.any(line.x < 0.0) for line in panel.lines):
        axes.axvline(0.0, color="#BBBBBB", linewidth=0.9, zorder=0.9)
    if panel.level is not None:
        value = panel.level.value * factors[1]
        axes.axhline(value, color="black", linewidth=1.5, linestyle=(0, (5, 2.5)), zorder=3)
        axes.annotate(
            panel.level.name,
            (0.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(6, 5),
            textcoords="offset points",
            fontsize=11,
        )
    if any(line.name for line in panel.lines):
        named = [handle for handle in reversed(axes.get_lines()) if not str(handle.get_label()).startswith("_")]
        axes.legend(handles=named, labelcolor="linecolor", handlelength=1.1, handletextpad=0.5, fontsize=11)


def _scale(row: Row, axes: Sequence[Axes], factor: float) -> None:
    """Set the ranges of a row: one for all of it, or one for each panel; a panel of zeros gets that of the others."""
    ranges = [_range(panel, factor) for panel in row.panels]
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    if high == low:
        low, high = 0.0, 1.0
    for one, (bottom, top) in zip(axes, ranges, strict=True):
        bottom, top = (low, high) if row.together or top == bottom else (bottom, top)
        free = _HEAD * (top - bottom)
        one.set_ylim(bottom - free * (0.35 if bottom == 0.0 else 1.0), top + free)
        one.locator_params(axis="x", nbins=5)
        one.locator_params(axis="y", nbins=5)


def _range(panel: Panel, factor: float) -> tuple[float, float]:
    """Return the least and the largest value in a panel, zero among them."""
    level = [] if panel.level is None else [np.array([panel.level.value])]
    values = np.concatenate([np.zeros(1), *(line.y for line in panel.lines), *level])
    finite = values[np.isfinite(values)] * factor
    return float(finite.min()), float(finite.max())
