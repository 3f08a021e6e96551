"""A view of spheres to turn in a browser: one HTML file that needs no network and no library.

The page (`viewer.html`) casts a ray per pixel on the graphics card, in parallel projection and with the light of
`render`. Centres are 16-bit numbers across the box of all centres, what spheres show is one byte each, together
compressed by gzip; the browser unpacks them.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import Floats, choice, finite_array, fraction
from pybondem.errors import InputError
from pybondem.output.colouring import Colouring, Parts, Scalar, check_colouring, spheres
from pybondem.output.readable import si_scale
from pybondem.output.render import View

STEPS = 65535  # of a 16-bit number
MOST_BYTES = 512 * 2**20  # before compression: what a browser still unpacks
AXES = ("x", "y", "z")


class CutStart(NamedTuple):
    """The cut that a view opens with: across `axis`, at a share 0 to 1 of the box, leaving parts `whole` uncut."""

    axis: str = "y"
    place: float = 0.5
    whole: Sequence[str] = ()


def write_view(
    path: str | Path,
    x: ArrayLike,
    radius: ArrayLike,
    fields: Mapping[str, Colouring],
    *,
    frames: Sequence[str] = ("",),
    title: str = "particles",
    view: View | None = None,
    cut: CutStart | None = None,
    start: str | None = None,
) -> Path:
    """Write spheres as a page to turn, cut open and colour by any of the fields.

    path : the HTML file to write (its folder is made).
    x : (n, 3), or (frames, n, 3) where they move [m]; radius : (n,), or one for all [m].
    fields : what to colour by, by name; a Scalar has values for one frame or for all. The parts of the first Parts
        can be hidden and left uncut.
    frames : what each frame is called, such as "u = 0.2 mm"; with several, the page has a slider.
    view, cut : how it opens; start : the field it opens with, by default the first.

    Returns the path. Raises InputError for bad values, no field, or more than 512 MB before compression.
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"view {path} must be an .html file.")
    centres = _centres(x, len(frames))
    _, radii = spheres(centres[-1], radius)
    _check_fields(fields, len(radii), len(frames))
    low, step, whole_numbers = quantised(centres)
    arrays = {"radius": radii.astype("<f4"), "x": whole_numbers}
    arrays |= {f"field{k}": field.bytes() for k, field in enumerate(fields.values())}
    if sum(a.nbytes for a in arrays.values()) > MOST_BYTES:
        raise InputError(f"view {path.name} would unpack to more than {MOST_BYTES >> 20} MB; give fewer frames.")
    blob, sections = _joined(arrays)
    opening = _opening(fields, view or View(), cut, start)
    head = {
        "title": title, "about": f"{len(radii):,} particles".replace(",", " "), "count": len(radii),
        "frames": list(frames), "low": low.tolist(), "step": step.tolist(), "sections": sections,
        "fields": [_described(name, field) for name, field in fields.items()], "start": opening,
    }  # fmt: skip
    page = files("pybondem.output").joinpath("viewer.html").read_text(encoding="utf-8")
    data = base64.b64encode(gzip.compress(blob, 6, mtime=0)).decode("ascii")
    texts = {"title": html.escape(title), "head": _script_safe(head), "data": data}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(re.sub(r"\{\{(\w+)\}\}", lambda mark: texts[mark[1]], page), encoding="utf-8")
    return path


def quantised(x: Floats) -> tuple[Floats, Floats, NDArray[np.int16]]:
    """Return low (3,) [m], step (3,) [m] and whole numbers q of the shape of x, with x = low + (q + 32768) step.

    The error is at most half a step: 1/131070 of the box of all centres in each direction.
    """
    low = x.min(axis=tuple(range(x.ndim - 1)))
    step = (x.max(axis=tuple(range(x.ndim - 1))) - low) / STEPS
    places = np.rint((x - low) / np.where(step > 0.0, step, 1.0))
    return low, step, (np.clip(places, 0, STEPS) - 32768).astype("<i2")


def _centres(x: ArrayLike, frames: int) -> Floats:
    """Return centres (1 or frames, n, 3) [m]."""
    if frames < 1:
        raise InputError("a view has at least one frame; leave frames out where there is one.")
    centres = finite_array("x of the view", x, (None,) * (np.ndim(x) - 1) + (3,))
    if centres.ndim == 2:
        return centres[None]
    if centres.ndim != 3 or len(centres) != frames:
        raise InputError(
            f"x of the view has shape {centres.shape}; with {frames} frames it must be (n, 3) or ({frames}, n, 3)."
        )
    return centres


def _check_fields(fields: Mapping[str, Colouring], count: int, frames: int) -> None:
    if not fields:
        raise InputError("a view needs at least one field to colour by, such as Parts(...).")
    for name, field in fields.items():
        check_colouring(f"field {name!r}", field, count)
        if field.frames not in (1, frames):
            raise InputError(f"field {name!r} has {field.frames} frames; the view has {frames}.")


def _joined(arrays: Mapping[str, NDArray[Any]]) -> tuple[bytes, list[dict[str, Any]]]:
    """Return arrays one after the other, and where each stands; the widest numbers come first, so that all align."""
    blob, sections = bytearray(), []
    for name, array in arrays.items():
        sections.append({"name": name, "type": array.dtype.name, "offset": len(blob), "length": array.size})
        blob += np.ascontiguousarray(array).tobytes()
    return bytes(blob), sections


def _opening(fields: Mapping[str, Colouring], view: View, cut: CutStart | None, start: str | None) -> dict[str, Any]:
    """Return how the page opens."""
    names = list(fields)
    first = names.index(choice("start of the view", start, names)) if start is not None else 0
    known = next((list(f.colours) for f in fields.values() if isinstance(f, Parts)), [])
    for name in cut.whole if cut else ():
        choice("whole of the cut", name, known)
    _, up, side = view.axes().tolist()
    return {
        "field": first, "side": side, "up": up,
        "cut": AXES.index(choice("axis of the cut", cut.axis, AXES)) if cut else -1,
        "place": fraction("place of the cut", cut.place) if cut else 0.5, "whole": list(cut.whole) if cut else [],
    }  # fmt: skip


def _described(name: str, field: Colouring) -> dict[str, Any]:
    """Return what the page must know of a field: numbers in the prefixed unit, its colours, and ticks of its bar."""
    table = base64.b64encode(field.table().tobytes()).decode("ascii")
    if isinstance(field, Parts):
        return {"name": name, "kind": "parts", "unit": "", "names": list(field.colours), "table": table}
    factor, unit = si_scale(max(abs(field.low), abs(field.high)), field.unit)
    low, high = field.low * factor, field.high * factor
    return {"name": name, "kind": "scalar", "unit": unit, "low": low, "high": high, "table": table,
            "ticks": _ticks(field, low, high)}  # fmt: skip


def _ticks(field: Scalar, low: float, high: float) -> list[tuple[float, str]]:
    """Return places (0 to 1) and words of round numbers along a colour bar; ends that hold for more say so."""
    from matplotlib.ticker import MaxNLocator

    values = [v for v in MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high) if low <= v <= high]
    digits = max(len(f"{v:.6g}".partition(".")[2]) for v in values)
    words = [f"{v:.{digits}f}" if max(map(abs, values)) < 1e5 else f"{v:.3g}" for v in values]
    return [((v - low) / (high - low), word.replace("-", "−")) for v, word in zip(values, words, strict=True)]


def _script_safe(head: Mapping[str, Any]) -> str:
    """Return JSON that cannot end the script element it stands in."""
    return json.dumps(head, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
