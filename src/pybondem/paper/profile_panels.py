"""Profiles along the interface side by side: points of a lattice on two theories, a panel for each lattice."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.output.figures import INK, PALETTE, axis_label, styled_figure
from pybondem.output.readable import si_scale

Floats = NDArray[np.float64]
MARKERS = ("o", "s", "^", "D", "v")


class Panel(NamedTuple):
    """Title; x of the theories (k,) [m]; by stage: x and stress of points (m,), stress by both theories (k,)."""

    title: str
    x: Floats
    curves: Mapping[str, tuple[Floats, Floats, Floats, Floats]]


def draw_panels(path: Path, panels: Sequence[Panel]) -> Path:
    """Draw panels side by side with one scale of stress, and return the path."""
    from matplotlib.lines import Line2D

    highest = max(float(points.max()) for each in panels for _, points, _, _ in each.curves.values())
    factor, _ = si_scale(highest, "Pa")
    with styled_figure(path, width=0.55 + 0.65 * len(panels), height=1.0) as figure:
        every = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
        for axes, each in zip(every, panels, strict=True):
            for (_, curve), colour, marker in zip(each.curves.items(), PALETTE, MARKERS, strict=False):
                at, points, plain, sheared = curve
                axes.plot(at, factor * points, marker, color=colour, markersize=3.2, markeredgewidth=0.0, alpha=0.55)
                axes.plot(each.x, factor * plain, color=INK, linewidth=1.3)
                axes.plot(each.x, factor * sheared, color=INK, linewidth=1.1, linestyle=(0, (4, 2)))
            axes.set_title(each.title)
            axes.set_xlabel("position along the interface [m]")
        every[0].set_ylabel(axis_label("shear stress", "Pa", factor))
        keys = [
            Line2D([], [], color=colour, marker=marker, linestyle="", label=zones)
            for zones, colour, marker in zip(panels[0].curves, PALETTE, MARKERS, strict=False)
        ]
        keys += [Line2D([], [], color=INK, linewidth=1.3, label="theory"),
                 Line2D([], [], color=INK, linewidth=1.1, linestyle=(0, (4, 2)), label="with shear")]  # fmt: skip
        figure.legend(handles=keys, loc="outside right upper", title="zones", alignment="left")
    return path
