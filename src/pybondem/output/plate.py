"""Pictures of spheres with what a reader needs beside them: title, colour bar or names of parts, scale, directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pybondem.check import Floats, whole_number
from pybondem.errors import InputError
from pybondem.output.colouring import Colouring, Parts, Scalar
from pybondem.output.figures import DPI, INK, SIZE, styled_figure
from pybondem.output.readable import quantity, si_scale
from pybondem.output.render import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 1.55  # of a plate, over that of a plain figure
BELOW = 0.85  # inches for the colour bar below a picture and the title above it
LETTERS = "abcdefghijklmnopqrstuvwxyz"


@dataclass(frozen=True)
class Note:
    """Words at a place (3,) [m] of a picture; to (3,) [m]: where an arrow from there ends."""

    text: str
    at: ArrayLike
    to: ArrayLike | None = None


@dataclass(frozen=True)
class Panel:
    """A picture, the field that it shows, what the field is called, a title, and notes."""

    picture: Picture
    field: Colouring
    label: str = ""
    title: str = ""
    notes: Sequence[Note] = ()


def plate(path_png: str | Path, panels: Sequence[Panel], *, columns: int = 2) -> Path:
    """Draw pictures side by side, lettered where there are several, the first with a scale and the directions x, y, z.

    path_png : the PNG to write (its folder is made); an SVG of the same name is put beside it.

    Returns the path of the PNG. Raises InputError for no panel, more than 26, or a path that is not a PNG.
    """
    if not 0 < len(panels) <= len(LETTERS):
        raise InputError(f"a plate has 1 to {len(LETTERS)} panels, not {len(panels)}.")
    columns = min(whole_number("columns", columns), len(panels))
    rows = [panels[k : k + columns] for k in range(0, len(panels), columns)]
    across = SIZE[0] * WIDTH
    heights = [max(across / columns * _aspect(panel) for panel in row) + BELOW for row in rows]
    with styled_figure(path_png, width=WIDTH, height=sum(heights) / SIZE[1]) as figure:
        figure.set_dpi(DPI)  # that of the pictures within the SVG
        grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
        for k, panel in enumerate(panels):
            axes = figure.add_subplot(grid[divmod(k, columns)])
            letter = f"{LETTERS[k]}   " if len(panels) > 1 else ""
            axes.set_title(letter + panel.title)
            _show(axes, panel)
            _explain(figure, axes, panel)
            if k == 0:
                low, high = _extent(panel)
                inch = float(high[0] - low[0]) * columns / across
                _draw_directions(axes, panel, inch, taken=_draw_scale(axes, panel, inch))
    return Path(path_png)


def _aspect(panel: Panel) -> float:
    """Return height over width of a panel, its notes included."""
    low, high = _extent(panel)
    return float((high[1] - low[1]) / (high[0] - low[0]))


def _extent(panel: Panel) -> tuple[Floats, Floats]:
    """Return the corners of a panel in pixels of its picture: upper left, lower right."""
    height, width = panel.picture.pixels.shape[:2]
    places = [np.asarray(p, np.float64) for note in panel.notes for p in (note.at, note.to) if p is not None]
    noted = panel.picture.place(np.array(places)) if places else np.zeros((0, 2))
    corners = np.concatenate([noted, [[0.0, 0.0], [width, height]]])
    return corners.min(axis=0), corners.max(axis=0)


def _show(axes: Axes, panel: Panel) -> None:
    """Draw the picture and its notes."""
    axes.set_axis_off()
    axes.imshow(panel.picture.pixels, interpolation="antialiased")
    low, high = _extent(panel)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(high[1], low[1])
    for note in panel.notes:
        ends = panel.picture.place(np.array([note.at, note.at if note.to is None else note.to]))
        if note.to is not None:
            axes.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6})
        axes.annotate(note.text, ends[1], (0, 4), textcoords="offset points", ha="center", va="bottom", fontsize=10)


def _explain(figure: Figure, axes: Axes, panel: Panel) -> None:
    """Put below a picture the names of its parts, or a colour bar with its unit."""
    field = panel.field
    if isinstance(field, Parts):
        from matplotlib.patches import Patch

        keys = [Patch(facecolor=colour, label=name) for name, colour in field.colours.items()]
        axes.legend(handles=keys, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, handlelength=1.2)
        return
    bar = figure.colorbar(
        _mappable(field), ax=axes, orientation="horizontal", shrink=0.62, aspect=32, pad=0.03, extend=_extend(field)
    )
    unit = si_scale(max(abs(field.low), abs(field.high)), field.unit)[1]
    bar.set_label(f"{panel.label} [{unit}]" if unit else panel.label, fontsize=11)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=10)


def _mappable(field: Scalar) -> Any:
    """Return the colours of a field with its scale in the prefixed unit, for a colour bar."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    factor = si_scale(max(abs(field.low), abs(field.high)), field.unit)[0]
    return ScalarMappable(
        Normalize(field.low * factor, field.high * factor), ListedColormap((field.table()[1:] / 255.0).tolist())
    )


def _extend(field: Scalar) -> str:
    """Return at which ends of the scale values go beyond it, as matplotlib says it."""
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[field.beyond]


def _draw_scale(axes: Axes, panel: Panel, inch: float) -> int:
    """Draw a bar of a round length in the emptiest corner, and return which that is; inch: of the page [pixels]."""
    length = _round_below(1.1 * inch / panel.picture.scale)
    across = length * panel.picture.scale
    corner, (left, low) = _emptiest_corner(panel, across, 0.25 * inch)
    axes.plot([left, left + across], [low, low], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes.annotate(
        quantity(length, "m"), (left + 0.5 * across, low), (0, 3), textcoords="offset points",
        ha="center", va="bottom", fontsize=10,
    )  # fmt: skip
    return corner


def _draw_directions(axes: Axes, panel: Panel, inch: float, taken: int) -> None:
    """Draw the directions x, y, z in the emptiest corner that is not taken; inch: of the page [pixels]."""
    size, arm = 0.75 * inch, 0.28 * inch
    _, (left, low) = _emptiest_corner(panel, size, size, taken)
    middle = np.array([left + 0.5 * size, low - 0.5 * size])
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 8}
    arms = arm * panel.picture.axes[:2].T * (1.0, -1.0)
    start = middle - 0.5 * arms.sum(axis=0)
    for name, along in zip("xyz", arms, strict=True):
        tip = start + along
        word = tip + 0.11 * inch * along / max(float(np.linalg.norm(along)), 0.05 * inch)
        axes.annotate("", (tip[0], tip[1]), (start[0], start[1]), arrowprops=arrow)
        axes.annotate(name, (word[0], word[1]), ha="center", va="center", fontsize=10, style="italic")


def _round_below(length: float) -> float:
    """Return the largest of 1, 2, 5, 10 ... times a power of ten that is not above a length."""
    unit = 10.0 ** np.floor(np.log10(length))
    return float(max(k * unit for k in (1.0, 2.0, 5.0) if k * unit <= length))


def _emptiest_corner(
    panel: Panel, width: float, height: float, taken: int | None = None
) -> tuple[int, tuple[float, float]]:
    """Return in which corner of a panel a box [pixels] covers least of the picture, and the box's lower left there."""
    low, high = _extent(panel)
    opacity = panel.picture.pixels[..., 3]
    edge = 0.012 * (high[0] - low[0])
    corners = [
        (float(left), float(base))
        for base in (high[1] - edge, low[1] + height + edge)
        for left in (low[0] + edge, high[0] - width - edge)
    ]

    def covered(number: int) -> int:
        left, base = corners[number]
        left, right, top, base = (max(0, round(edge)) for edge in (left, left + width, base - height, base))
        return int(np.count_nonzero(opacity[top:base, left:right]))

    best = min((k for k in range(4) if k != taken), key=covered)
    return best, corners[best]
