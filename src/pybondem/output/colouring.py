"""What spheres show: the part that they are of, or a number on a scale.

Both become one byte per sphere and a table of 256 colours, which pictures (`render`) and the view in a browser
(`viewer`) share. Byte 0 is for spheres that have nothing to show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import Floats, finite_array, finite_number, nearest, positive, positive_array
from pybondem.errors import InputError

Bytes = NDArray[np.uint8]

NEUTRAL = "#C7CBD1"  # of spheres with nothing to show
LEVELS = 255  # of a scalar: bytes 1 to 255


@dataclass(frozen=True, init=False, eq=False)
class Parts:
    """Spheres coloured by part.

    of (n,): number of the part of each sphere, from 0; colours: name and colour of every part, in that order, the
    colour as matplotlib takes it ("#E69F00", "tab:green"). Raises InputError for a number without a name, more than
    255 parts, or a colour that is none.
    """

    of: NDArray[np.int64]
    colours: Mapping[str, str]

    def __init__(self, of: ArrayLike, colours: Mapping[str, str]) -> None:
        numbers = np.asanyarray(of)
        if isinstance(numbers, np.ma.MaskedArray) or numbers.dtype.kind not in "iu" or numbers.ndim != 1:
            raise InputError(f"of Parts is {numbers.dtype} of shape {numbers.shape}; it must be whole numbers (n,).")
        if not 0 < len(colours) <= LEVELS:
            raise InputError(f"Parts has {len(colours)} colours; it must have 1 to {LEVELS}, one for each part.")
        if numbers.size and not 0 <= int(numbers.min()) <= int(numbers.max()) < len(colours):
            bad = int(np.argmax((numbers < 0) | (numbers >= len(colours))))
            raise InputError(
                f"of Parts says that sphere {bad} is of part {numbers[bad]}; "
                f"there are colours for 0 to {len(colours) - 1}."
            )
        object.__setattr__(self, "of", numbers.astype(np.int64))
        object.__setattr__(self, "colours", {str(name): _hex(colour) for name, colour in colours.items()})

    @property
    def frames(self) -> int:
        """1: parts do not change."""
        return 1

    def bytes(self) -> Bytes:
        """Return one byte per sphere (1, n): the number of its part, plus 1."""
        return (self.of + 1).astype(np.uint8)[None]

    def table(self) -> Bytes:
        """Return the colour of each byte (256, 3), red, green, blue."""
        return _table([NEUTRAL, *self.colours.values()])


@dataclass(frozen=True, init=False, eq=False)
class Scalar:
    """Spheres coloured by a number.

    values (n,) or (frames, n), in `unit` (SI, such as "Pa", or ""); low, high: ends of the scale, by default those of
    the values shown, beyond which the end colours hold; colours: a colour map of matplotlib; shown (n,) bool: where
    there is something to show, the other spheres are grey. Raises InputError for values that are not finite numbers,
    for a scale that does not rise, and for a colour map that does not exist.
    """

    values: Floats
    unit: str
    low: float
    high: float
    colours: str
    shown: NDArray[np.bool_]

    def __init__(self, values: ArrayLike, unit: str = "", *, low: float | None = None, high: float | None = None,
                 colours: str = "viridis", shown: ArrayLike | None = None) -> None:  # fmt: skip
        numbers = finite_array("values of Scalar", values, (None,) * (1 if np.ndim(values) < 2 else 2))
        numbers = np.atleast_2d(numbers)
        mask = np.ones(numbers.shape[1], np.bool_) if shown is None else np.asarray(shown)
        if mask.dtype != np.bool_ or mask.shape != numbers.shape[1:]:
            raise InputError(
                f"shown of Scalar is {mask.dtype} of shape {mask.shape}; it must be bool, one for each of the "
                f"{numbers.shape[1]} spheres."
            )
        seen = numbers[:, mask] if np.any(mask) else np.zeros((1, 1))
        least, most = _widened(float(seen.min()), float(seen.max()), low is None, high is None)
        ends = {
            "low": least if low is None else finite_number("low of Scalar", low, unit or "1"),
            "high": most if high is None else finite_number("high of Scalar", high, unit or "1"),
        }
        if not ends["low"] < ends["high"]:
            raise InputError(f"the scale of Scalar runs from {ends['low']:g} to {ends['high']:g}; it must rise.")
        _check_map(colours)
        for name, value in {"values": numbers, "unit": unit, "colours": colours, "shown": mask, **ends}.items():
            object.__setattr__(self, name, value)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.values)

    @property
    def beyond(self) -> tuple[bool, bool]:
        """Whether values lie below, and above, the ends of the scale."""
        seen = self.values[:, self.shown]
        return bool(np.any(seen < self.low)), bool(np.any(seen > self.high))

    def bytes(self) -> Bytes:
        """Return one byte per sphere and frame (frames, n): 1 at `low` to 255 at `high`, 0 where nothing is shown."""
        half = 0.5 * self.high - 0.5 * self.low  # halves, so that no difference overflows
        place = np.clip((0.5 * self.values - 0.5 * self.low) / half, 0.0, 1.0)
        return np.where(self.shown, 1.0 + np.rint(place * (LEVELS - 1)), 0.0).astype(np.uint8)

    def table(self) -> Bytes:
        """Return the colour of each byte (256, 3), red, green, blue."""
        from matplotlib import colormaps

        scale = np.rint(255.0 * colormaps[self.colours](np.linspace(0.0, 1.0, LEVELS))[:, :3]).astype(np.uint8)
        return np.concatenate([_table([NEUTRAL])[:1], scale])


Colouring = Parts | Scalar


def spheres(x: ArrayLike, radius: ArrayLike) -> tuple[Floats, Floats]:
    """Return centres (n, 3) [m] and radii (n,) [m] of spheres to show, checked; radius: (n,), or one for all.

    Raises InputError for no sphere, shapes that do not match, values that are not finite, radii that are not positive.
    """
    centres = finite_array("x of the spheres", x, (None, 3))
    if len(centres) == 0:
        raise InputError("x of the spheres is empty; there is nothing to show.")
    if np.ndim(radius) == 0:
        return centres, np.full(len(centres), positive("radius of the spheres", radius, "m"))
    radii = positive_array("radius of the spheres", radius, (None,), "m")
    if len(radii) != len(centres):
        raise InputError(f"there are {len(centres)} centres and {len(radii)} radii; give one radius each.")
    return centres, radii


def check_colouring(name: str, field: object, count: int) -> None:
    """Raise InputError unless `field` colours `count` spheres."""
    if not isinstance(field, Parts | Scalar):
        raise InputError(f"{name} is a {type(field).__name__}; it must be Parts(...) or Scalar(...).")
    given = field.bytes().shape[1]
    if given != count:
        raise InputError(f"{name} has values for {given} spheres; there are {count}.")


def _widened(least: float, most: float, free_below: bool, free_above: bool) -> tuple[float, float]:
    """Return the ends of a scale; where all values are equal, room on the sides that are not given."""
    if least < most:
        return least, most
    room = 0.5 * abs(least) or 0.5
    return least - room * free_below, most + room * free_above


def _check_map(name: object) -> None:
    from matplotlib import colormaps

    if name not in colormaps:
        raise InputError(f"matplotlib has no colour map {name!r}{nearest(name, colormaps)}; take 'viridis'.")


def _hex(colour: str) -> str:
    from matplotlib.colors import to_hex

    try:
        return str(to_hex(colour))
    except ValueError:
        raise InputError(f"{colour!r} is not a colour; write it as '#E69F00' or 'orange'.") from None


def _table(colours: list[str]) -> Bytes:
    """Return colours as a table of 256 rows; the rows that are not given are black."""
    table = np.zeros((256, 3), np.uint8)
    table[: len(colours)] = [[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in colours]
    return table
