"""What a law answers to driven paths, drawn: stress, damage and dissipated energy against deformation.

The answers are those of bonds on an engine (see `trial`), not of the law's formula.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pybondem.bonds import ValuedLaw
from pybondem.check import Floats, finite_array, positive
from pybondem.errors import InputError
from pybondem.laws.paths import COMPONENTS, deformation
from pybondem.laws.subject import Subject, subject
from pybondem.laws.trial import LENGTH, Trial
from pybondem.output.law_figure import Column, Level, Line, Panel, Row, law_figure
from pybondem.output.readable import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS, CYCLE_STEPS = 240, 80  # to the end of a path, and of the cycles
CYCLES = 3
SIZES = np.geomspace(1e-7, 0.1, 241)  # deformations over length among which the end of a law is looked for
LENGTHS = LENGTH * np.array([1.0, 10.0, 100.0, 1000.0])  # of bonds that are long enough to show it [m]
LEFT = 0.05  # of the largest stress: the law is at its end
BENT = 0.02  # of the stiffness: less is taken for a straight line
BEYOND, BEYOND_BEND = 1.15, 2.0  # how far past its end, and past the middle of its bend, a law is driven
PRESSED = 0.8  # closure in the cycles, over the opening of the largest stress
LARGEST = 0.3  # slip over the length of a bond that has a meaning
NOISE = 1e-9  # of the work: round-off in what is dissipated
ONCE, IN_CYCLES, SHEARED = 0, 1, 2  # inks
DIAGONAL = float(np.sqrt(0.5))
DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (DIAGONAL, DIAGONAL))  # opening, slip, and both
MODES = ("normal", "shear", "twist", "bending")
NAMES = ("opening", "slip s", "slip t", "twist", "bending s", "bending t")


class Extent(NamedTuple):
    """How far a law is driven: length of the bond [m]; reach of opening, slip and both at 45 degrees (3,) [m], and
    where the stress is largest on the way (3,) [m]."""

    length: float
    reach: Floats
    peak: Floats


class Driver(NamedTuple):
    """What is driven: bonds or joints with a law, of a length [m], each for a duration [s] to the end of its path."""

    law: ValuedLaw
    element: str
    length: float
    duration: float

    def trial(self, count: int = 1) -> Trial:
        """Return so many new bonds."""
        return Trial(self.law, self.element, count=count, length=self.length)


class Answers(NamedTuple):
    """What one bond answers along a path of (points,): stress (points, 3) [Pa] along n, s and t, moments (points, 3)
    [N m], damage of each mode (points, modes) [-] and dissipated energy per area (points,) [J/m2]."""

    path: Floats
    stress: Floats
    moment: Floats
    damage: Floats
    dissipated: Floats


def plot_law(
    law: ValuedLaw, path: str | Path | None = None, reach: float | None = None, driven: ArrayLike | None = None
) -> Figure:
    """Draw what one bond with a law answers: stress, damage and dissipated energy along driven paths.

    The paths are opening, slip, and both at once at 45 degrees, each loaded once, and opening and slip also loaded and
    unloaded with growing amplitude: opening until it is a little pressed together, slip to and fro. They go to where
    little of the law is left. Where the law declares its toughness, a dashed line is what it should dissipate. Where
    the law returns a number that is not finite, the line below the panels says from which deformation on.

    path: of the PNG to write (an SVG is put beside it); reach [m]: of every path instead; driven: a path (points, 6) of
    n, s, t [m], twist, bend_s, bend_t [rad] (see `laws.paths`), drawn against its points in the place of the others.
    The bond is that of `laws.trial`: a joint where the law brings its stiffness. Returns a matplotlib Figure. Raises
    InputError for a reach or a path that is out of range.
    """
    known = subject(law)
    element = "bond" if law.stiffness is None else "joint"
    extent = _extent(known, element)
    if reach is not None:
        extent = _as_asked(extent, reach)
    driver = Driver(known.law, element, extent.length, known.duration)
    columns: tuple[Column, ...] = _COLUMNS
    if driven is None:
        rows = _rows(driver, extent)
    else:
        own = _driven(driven)
        columns, rows = _OWN_COLUMN, _rows_along(_answers(driver, [own], len(own) - 1)[0])
    note = _note(driver) + _not_finite(columns, rows[-1])
    return law_figure(columns, rows, title=_title(known.law), note=note, path_png=path)


# Paths and answers -----------------------------------------------------------------------------------------------


def _extent(known: Subject, element: str) -> Extent:
    """Return how far a law is driven: to where little of its stress is left, in a bond long enough to show it."""
    found: dict[str, Extent] = {}
    for length in LENGTHS:
        trial = Trial(known.law, element, count=len(DIRECTIONS) * len(SIZES), length=float(length))
        shares = _shares(trial, known.duration, length)
        for how, look in (("ends", _end), ("bends", _bend)):
            seen = np.array([look(share, length * SIZES) for share in shares])
            if how not in found and np.isfinite(seen).any():
                seen = np.where(np.isfinite(seen), seen, np.nanmin(seen))  # what the law leaves alone goes as far
                found[how] = Extent(float(length), seen, length * SIZES[np.argmax(shares * SIZES, axis=1)])
        if "ends" in found:
            break
    straight = np.full(len(DIRECTIONS), 0.01 * LENGTH)
    return found.get("ends") or found.get("bends") or Extent(LENGTH, straight, straight)


def _shares(trial: Trial, duration: float, length: float) -> Floats:
    """Return the share of its stiffness that a bond, deformed at once, has left (directions, sizes)."""
    local = np.zeros((2, 6, trial.count))
    local[1, :2] = (np.array(DIRECTIONS)[:, :, None] * length * SIZES).transpose(1, 0, 2).reshape(2, -1)
    found = trial.follow(local, duration)
    if trial.law.kind == "damage":
        left = 1.0 - found.damages[1, [0, min(1, found.damages.shape[1] - 1)]]
    else:
        left = found.load[1, :2] / np.where(local[1, :2] > 0.0, local[1, :2], np.inf) / trial.stiffness[:2, None]
    whole = trial.stiffness[:2, None] * local[1, :2] ** 2
    shares: Floats = ((left * whole).sum(axis=0) / whole.sum(axis=0)).reshape(len(DIRECTIONS), -1)
    return shares


def _end(share: Floats, size: Floats) -> float:
    """Return how far to go for a law whose stress comes to an end; nan where it does not."""
    stress = share * size
    top = int(np.argmax(stress))
    after = np.flatnonzero(stress[top:] < LEFT * stress[top])
    return BEYOND * float(size[top + after[0]]) if len(after) else np.nan


def _bend(share: Floats, size: Floats) -> float:
    """Return how far to go for a law whose secant stiffness changes: past the middle of the change; nan for none."""
    seen = np.clip(share, -1.0, 2.0)
    change = np.abs(seen - seen[0])
    if change[-1] < BENT:
        return np.nan
    return BEYOND_BEND * float(size[np.argmax(change >= 0.5 * change[-1])])


def _as_asked(extent: Extent, reach: float) -> Extent:
    """Return the extent with a user's reach. Raises InputError for one that the bond is too short for."""
    far = positive("reach of plot", reach, "m")
    if far > LARGEST * extent.length:
        most = f"{LARGEST * extent.length:g} m, for a bond of {extent.length:g} m"
        raise InputError(f"reach of plot is {far:g} m; it must be at most {most}.")
    return extent._replace(reach=np.full(len(DIRECTIONS), far))


def _cycles(far: float, back: float | None = None) -> Floats:
    """Return loading and unloading with growing amplitude up to far (points,), at one speed.

    back: how far past zero each cycle unloads; by default as far as it was loaded.
    """
    peaks = [far * (k + 1) / CYCLES for k in range(CYCLES)]
    corners = [0.0, *(turn for peak in peaks for turn in (peak, -peak if back is None else -back)), 0.0]
    values = [np.zeros(1)]
    for a, b in pairwise(corners):
        count = max(1, round(abs(b - a) / far * CYCLE_STEPS))
        values.append(a + (b - a) * np.arange(1, count + 1) / count)
    return np.concatenate(values)


def _along(values: Floats, **shares: float) -> Floats:
    """Return the path (points, 6) that drives components in proportion."""
    return deformation(**{name: share * values for name, share in shares.items()}).T


def _driven(path: ArrayLike) -> Floats:
    """Return a user's path (points, 6). Raises InputError unless it is one."""
    found = finite_array("driven of plot", path, (None, len(COMPONENTS)))
    if len(found) < 2:
        raise InputError(f"driven of plot has {len(found)} points; a path has at least 2.")
    return found


def _answers(driver: Driver, driven: list[Floats], steps: int) -> list[Answers]:
    """Return the answers of new bonds, one to each path; so many steps take the duration."""
    longest = max(map(len, driven))
    held = [np.concatenate([path, np.repeat(path[-1:], longest - len(path), axis=0)]) for path in driven]
    trial = driver.trial(len(driven))
    found = trial.follow(np.stack(held, axis=2), driver.duration / steps)
    area = float(trial.stiffness[4])
    answers = []
    for k, path in enumerate(driven):
        load, lost = found.load[: len(path), :, k], found.lost[: len(path), k]
        lost = np.where(np.abs(lost) < NOISE * np.abs(found.work[:, k]).max(), 0.0, lost)
        answers.append(Answers(path, load[:, :3] / area, load[:, 3:], found.damages[: len(path), :, k], lost / area))
    return answers


# Rows of the figure ----------------------------------------------------------------------------------------------

_COLUMNS = (
    Column("in opening", "opening", "m"),
    Column("in slip", "slip", "m"),
    Column("in both, at 45°", "displacement", "m"),
)
_OWN_COLUMN = (Column("", "point of the path", ""),)


def _rows(driver: Driver, extent: Extent) -> list[Row]:
    """Return the rows of the figure of opening, slip and both together."""
    far = extent.reach
    size = far[2] * np.arange(STEPS + 1) / STEPS
    straight = [np.outer(size * far[k] / far[2], [*DIRECTIONS[k], 0.0, 0.0, 0.0, 0.0]) for k in range(3)]
    closed = PRESSED * min(float(extent.peak[0]), 0.5 * float(far[0]))
    opened = _along(_cycles(float(far[0]), closed), n=1.0)
    sheared = _along(_cycles(float(far[1])), s=1.0)
    *once, both = _answers(driver, straight, STEPS)
    cycles = _answers(driver, [opened, sheared], CYCLE_STEPS)
    return [
        Row("stress", "Pa", (*_panels(once, cycles, "stress"), Panel(_two(size, both.stress)))),
        *_damage_row(driver.law, once, cycles, Panel(_damages(size, both.damage))),
        Row("dissipated", "J/m²", _energy_panels(driver, once, cycles, Line(size, both.dissipated))),
    ]


def _panels(once: list[Answers], cycles: list[Answers], field: str) -> tuple[Panel, Panel]:
    """Return the panels of opening and slip: one field of the answers, of that mode where each has its own."""

    def line(mode: int, found: Answers, ink: int, name: str) -> Line:
        values: Floats = getattr(found, field)
        y = values if values.ndim == 1 else values[:, min(mode, values.shape[1] - 1)]
        return Line(found.path[:, mode], y, ink, name, ink == IN_CYCLES)

    def panel(mode: int) -> Panel:
        said = ("in cycles", "loaded once") if field == "stress" and mode == 0 else ("", "")
        return Panel((line(mode, cycles[mode], IN_CYCLES, said[0]), line(mode, once[mode], ONCE, said[1])))

    return panel(0), panel(1)


def _two(x: Floats, y: Floats) -> tuple[Line, ...]:
    """Return the curves of the normal and the shear part (points, 2 or more)."""
    return Line(x, y[:, 1], SHEARED, MODES[1]), Line(x, y[:, 0], ONCE, MODES[0])


def _damages(x: Floats, damage: Floats) -> tuple[Line, ...]:
    """Return the curves of damage (points, modes): one, or the normal and the shear one where each has its own."""
    return (Line(x, damage[:, 0]),) if damage.shape[1] == 1 else _two(x, damage)


def _damage_row(law: ValuedLaw, once: list[Answers], cycles: list[Answers], both: Panel) -> list[Row]:
    """Return the row of damage, if the law has any to tell of."""
    if law.kind == "bond" and "damage" not in law.memory._fields:
        return []
    return [Row("damage", "", (*_panels(once, cycles, "damage"), both), together=True)]


def _energy_panels(driver: Driver, once: list[Answers], cycles: list[Answers], both: Line) -> tuple[Panel, ...]:
    """Return the panels of dissipated energy, with the toughness that the law declares."""
    declared = driver.law.declared
    kn, ks, _, _, area = driver.trial().stiffness
    opening, slip = _panels(once, cycles, "dissipated")
    found = []
    for mode, k, panel in (("opening", kn / area, opening), ("slip", ks / area, slip)):
        if mode in declared.toughness:
            value = float(declared.toughness[mode](driver.law.parameters, k))
            panel = panel._replace(level=Level(value, f"toughness {quantity(value, 'J/m²')}"))
        found.append(panel)
    return (*found, Panel((both,)))


def _rows_along(found: Answers) -> list[Row]:
    """Return the rows of the figure of one path of any kind, drawn against its points."""
    point = np.arange(len(found.path), dtype=float)
    moved = [c for c in range(6) if np.any(found.path[:, c])]
    shifts, turns = [c for c in moved if c < 3], [c for c in moved if c >= 3]

    def row(label: str, unit: str, values: Floats, names: Sequence[str]) -> Row:
        lines = [Line(point, y, ink, name) for ink, (y, name) in enumerate(zip(values.T, names, strict=True))]
        return Row(label, unit, (Panel(tuple(reversed(lines))),))

    rows = []
    for which, shift, load, names, first in (
        (shifts, ("displacement", "m"), ("stress", "Pa", found.stress), ("normal", "shear s", "shear t"), 0),
        (turns, ("rotation", "rad"), ("moment", "N m", found.moment), NAMES[3:], 3),
    ):
        if which:
            rows.append(row(*shift, found.path[:, which], [NAMES[c] for c in which]))
            rows.append(row(*load[:2], load[2][:, [c - first for c in which]], [names[c - first] for c in which]))
    if np.any(found.damage):
        rows.append(row("damage", "", found.damage, MODES if found.damage.shape[1] > 1 else [""]))
    return [*rows, row("dissipated", "J/m²", found.dissipated[:, None], [""])]


# Words -----------------------------------------------------------------------------------------------------------


def _title(law: ValuedLaw) -> str:
    """Return the name of a law and its values, in lines that fit the figure."""
    declared: Any = law.declared
    units = {n: "" if p.unit in ("1", "-") else p.unit.replace("m2", "m²") for n, p in declared.parameters.items()}
    values = [f"{name} = {quantity(float(v), units[name])}" for name, v in law.parameters._asdict().items()]
    return textwrap.fill(f"{law.name}: {', '.join(values)}" if values else law.name, 96)


def _note(driver: Driver) -> str:
    """Return what the drawn bond is like."""
    kn, ks, _, _, area = driver.trial().stiffness
    time = f", a path in {quantity(driver.duration, 's')}" if driver.law.flows else ""
    stiffness = f"{quantity(kn / area, 'Pa/m')} in opening, {quantity(ks / area, 'Pa/m')} in slip"
    return f"one {driver.element} of {quantity(driver.length, 'm')}; stiffness per area {stiffness}{time}"


def _not_finite(columns: Sequence[Column], dissipated: Row) -> str:
    """Return where a law first answers with a number that is not finite, in words to go on with: "" where nowhere.

    The bond keeps its last answer from there on; what it dissipated is no number any more.
    """
    said = []
    for column, panel in zip(columns, dissipated.panels, strict=True):
        ends = [line.x[~np.isfinite(line.y)] for line in panel.lines]
        first = [float(x[0]) for x in ends if len(x)]
        if first:
            said.append(f"{column.label} {quantity(min(first, key=abs), column.unit)}")
    return f"\nThe law is not finite from {', '.join(said)} on: it is drawn as it was before." if said else ""
