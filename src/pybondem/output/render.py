"""Pictures of spheres, cast ray by ray in NumPy: no graphics card, no display, no OpenGL, the same bits everywhere.

The projection is parallel. Every pixel finds the sphere that its ray meets first, exactly, also where spheres
intersect and where a plane cuts them; then it is lit once. Creases are darkened by unsharp masking of the depths (Luft,
Colditz & Deussen, ACM Trans. Graph. 25, 2006, 1206-1213).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import Floats, axis_vector, finite_array, vector, whole_number
from pybondem.errors import InputError
from pybondem.output.colouring import Colouring, check_colouring, spheres

Singles = NDArray[np.float32]

MARGIN = 0.02  # of the width of a picture, on each side
RAYS = 2  # per pixel and direction: edges are averages of four
MOST_PIXELS = 16_000_000
BAND = 64  # rows of pixels that are lit at a time
# Light: directions to the right, down, and towards the eye, of unit length; GLOSSY lies between key light and eye.
KEY_LIGHT, FILL_LIGHT = np.array([-0.48, -0.6, 0.64]), np.array([0.6, 0.0, 0.8])
GLOSSY = np.array([-0.265, -0.331, 0.9056])
AMBIENT, KEY, FILL, GLOSS = 0.56, 0.46, 0.16, 0.10
CREASES = ((1.2, 0.40), (7.0, 0.30))  # reach in radii, share of the light that a deep crease takes


class View(NamedTuple):
    """Where the eye is: `side` is the direction from the model to it, `up` points upwards in the picture."""

    side: ArrayLike = (0.55, -1.0, 0.42)
    up: ArrayLike = (0.0, 0.0, 1.0)

    def axes(self) -> Floats:
        """Return the directions to the right, up, and towards the eye, as rows (3, 3).

        Raises InputError where the two are parallel.
        """
        towards = axis_vector("side of View", self.side)
        right = np.cross(axis_vector("up of View", self.up), towards)
        if np.linalg.norm(right) < 1e-6:
            raise InputError("side and up of View are parallel; take another up.")
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(towards, right), towards])


@dataclass(frozen=True)
class Cut:
    """Take away what lies beyond a plane: through `point` [m], in the direction of `normal`.

    of (n,) bool: which spheres it cuts, by default all; whole: leave out spheres whose centres lie beyond, and cut
    none through.
    """

    point: ArrayLike
    normal: ArrayLike
    of: ArrayLike | None = None
    whole: bool = False

    def plane(self) -> tuple[Floats, float]:
        """Return the unit normal (3,), and the height of the plane along it [m]."""
        normal = axis_vector("normal of Cut", self.normal)
        return normal, float(normal @ vector("point of Cut", self.point))

    def cuts(self, count: int) -> NDArray[np.bool_]:
        """Return which of `count` spheres it cuts (n,). Raises InputError where `of` says so for another number."""
        which = np.ones(count, np.bool_) if self.of is None else np.asarray(self.of)
        if which.dtype != np.bool_ or which.shape != (count,):
            raise InputError(f"of Cut is {which.dtype} of shape {which.shape}; it must be bool of shape ({count},).")
        return which


class Picture(NamedTuple):
    """A picture: pixels (height, width, 4), red, green, blue, opacity; pixels per metre; and how places fall on it."""

    pixels: NDArray[np.uint8]
    scale: float
    axes: Floats
    corner: Floats

    def place(self, x: ArrayLike) -> Floats:
        """Return where points (m, 3) [m] fall: (m, 2), pixels to the right and down from the upper left corner."""
        seen = finite_array("x of place", x, (None, 3)) @ self.axes.T
        return self.scale * (seen[:, :2] - self.corner) * (1.0, -1.0)


def render(x: ArrayLike, radius: ArrayLike, field: Colouring, *, view: View | None = None, cut: Cut | None = None,
           width: int = 1600, frame: int = -1) -> Picture:  # fmt: skip
    """Return a picture of spheres on a transparent ground.

    x (n, 3) [m], radius (n,) or one [m]; field: what they show; view: by default from the front, the right and above;
    cut: what to take away (the frame of the picture stays that of the whole); width [pixels], the height follows;
    frame: of a field with several. Raises InputError for bad values, and for a picture above 16 million pixels.
    """
    centres, radii = spheres(x, radius)
    check_colouring("field", field, len(centres))
    if not -field.frames <= frame < field.frames:
        raise InputError(f"frame is {frame}; the field has {field.frames}.")
    scene, picture = _scene(centres, radii, (view or View()).axes(), whole_number("width", width, 16), cut)
    depth, owner = _cast(scene)
    colour = (field.table()[field.bytes()[frame]] / 255.0).astype(np.float32)
    return picture._replace(pixels=_lit(scene, depth, owner, colour))


class _Scene(NamedTuple):
    """Spheres in units of rays: to the right, down, towards the eye. Kept is what has normal . x <= height."""

    at: Floats
    radius: Floats
    shown: NDArray[np.bool_]
    shape: tuple[int, int]
    cut: NDArray[np.bool_]
    normal: Floats
    height: float


def _scene(x: Floats, radius: Floats, axes: Floats, width: int, cut: Cut | None) -> tuple[_Scene, Picture]:
    """Return the spheres as the rays see them, and the picture to come, without its pixels."""
    seen = x @ axes.T
    low, high = (seen - radius[:, None]).min(axis=0), (seen + radius[:, None]).max(axis=0)
    scale = width * (1.0 - 2.0 * MARGIN) / float(high[0] - low[0])
    margin = MARGIN * width / scale
    rows = int(np.ceil(scale * (high[1] - low[1] + 2.0 * margin)))
    if width * rows > MOST_PIXELS:
        raise InputError(f"the picture would have {width} x {rows} pixels; give a smaller width.")
    origin, flip, fine = np.array([low[0] - margin, high[1] + margin, low[2]]), np.array([1.0, -1.0, 1.0]), RAYS * scale
    at = fine * (seen - origin) * flip
    shown, crossed, normal, height = np.ones(len(x), np.bool_), np.zeros(len(x), np.bool_), np.zeros(3), 0.0
    if cut is not None:
        along, level = cut.plane()
        normal, height = flip * (axes @ along), fine * (level - float(axes @ along @ origin))
        of = cut.cuts(len(x))
        reach = 0.0 if cut.whole else radius * fine
        shown = ~of | (at @ normal - reach <= height)
        crossed = of & shown & (not cut.whole)
    scene = _Scene(at, fine * radius, shown, (RAYS * rows, RAYS * width), crossed, normal, height)
    return scene, Picture(np.empty((rows, width, 4), np.uint8), scale, axes, origin[:2])


def _cast(scene: _Scene) -> tuple[Singles, NDArray[np.int32]]:
    """Return how near to the eye each ray first meets a sphere, -inf where it meets none, and which sphere, or -1."""
    depth = np.full(scene.shape, -np.inf, np.float32)
    owner = np.full(scene.shape, -1, np.int32)
    nearest_first = np.argsort(-(scene.at[:, 2] + scene.radius), kind="stable")
    lowest = np.maximum(np.ceil(scene.at[:, :2] - scene.radius[:, None] - 0.5), 0.0).astype(np.int64)
    beyond = np.floor(scene.at[:, :2] + scene.radius[:, None] + 0.5).astype(np.int64)
    middle = (np.arange(max(scene.shape)) + 0.5).astype(np.float32)
    for k in nearest_first[scene.shown[nearest_first]].tolist():
        (left, top), (right, bottom) = lowest[k], beyond[k]
        a, b, z = scene.at[k].tolist()
        r = float(scene.radius[k])
        held = depth[top:bottom, left:right]
        if held.size == 0 or held.min() >= z + r:
            continue  # all of it lies behind what is there
        columns, rows = middle[left:right], middle[top:bottom, None]
        square = r * r - np.square(columns - np.float32(a)) - np.square(rows - np.float32(b))
        rise = np.sqrt(np.maximum(square, 0.0))
        front = np.float32(z) + rise
        met = (square > 0.0) & (front > held)
        if scene.cut[k]:
            front, met = _cut_through(scene, columns, rows, z, rise, front, met)
            met &= front > held
        held[met] = front[met]
        owner[top:bottom, left:right][met] = k
    return depth, owner


def _cut_through(
    scene: _Scene, columns: Singles, rows: Singles, z: float, rise: Singles, front: Singles, met: NDArray[np.bool_]
) -> tuple[Singles, NDArray[np.bool_]]:
    """Return where rays meet what a plane leaves of a sphere, and which do; front: where they meet the whole sphere."""
    na, nb, nz = scene.normal.tolist()
    room = np.float32(scene.height) - np.float32(na) * columns - np.float32(nb) * rows
    if abs(nz) < 1e-6:
        return front, met & (room >= 0.0)
    plane = room / np.float32(nz)
    if nz > 0.0:  # the eye is on the side that was taken away
        front = np.minimum(front, plane)
        return front, met & (front >= np.float32(z) - rise)
    return front, met & (front >= plane)


def _lit(scene: _Scene, depth: Singles, owner: NDArray[np.int32], colour: Singles) -> NDArray[np.uint8]:
    """Return the pixels (height, width, 4): the mean of the light of their rays, and the share that met a sphere."""
    light = _light_in_creases(scene, depth[::RAYS, ::RAYS])
    rows, width = scene.shape[0] // RAYS, scene.shape[1] // RAYS
    pixels = np.zeros((rows, width, 4), np.uint8)
    for top in range(0, rows, BAND):
        band = slice(RAYS * top, RAYS * min(top + BAND, rows))
        met = owner[band] >= 0
        rays = np.zeros((*met.shape, 4), np.float32)
        down, right = np.nonzero(met)
        k = owner[band][met]
        normal = _normals(scene, k, np.stack([right + 0.5, down + band.start + 0.5, depth[band][met]], axis=1))
        shade = light[top + down // RAYS, right // RAYS, None] * _brightness(normal)
        gloss = GLOSS * np.maximum(normal @ GLOSSY, 0.0) ** 30
        rays[met] = np.column_stack([np.minimum(colour[k] * shade + gloss[:, None], 1.0), np.ones(len(k))])
        mean = rays.reshape(-1, RAYS, width, RAYS, 4).mean(axis=(1, 3))
        mean[..., :3] /= np.maximum(mean[..., 3:], 1e-6)
        pixels[top : top + BAND] = np.rint(255.0 * mean)
    return pixels


def _normals(scene: _Scene, k: NDArray[np.int32], at: Floats) -> Floats:
    """Return the outward normals (m, 3) where rays met the spheres k; on a cut that of the plane."""
    arm = (at - scene.at[k]) / scene.radius[k, None]
    flat = np.einsum("ij,ij->i", arm, arm) < 0.998  # inside the sphere: on the plane
    arm[flat] = scene.normal
    return arm


def _brightness(normal: Floats) -> Floats:
    """Return the light (m, 1) on surfaces with these normals (m, 3)."""
    light = AMBIENT + KEY * np.maximum(normal @ KEY_LIGHT, 0.0) + FILL * np.maximum(normal @ FILL_LIGHT, 0.0)
    return np.asarray(light)[:, None]


def _light_in_creases(scene: _Scene, depth: Singles) -> Singles:
    """Return the share of light (height, width) that creases leave: where depth is behind its surroundings' mean."""
    met = np.isfinite(depth)
    light = np.ones(depth.shape, np.float32)
    if not np.any(met):
        return light
    filled, weight = np.where(met, depth, 0.0).astype(np.float32), met.astype(np.float32)
    radius = float(np.median(scene.radius))
    for reach, share in CREASES:
        size = 2 * max(1, round(reach * radius / RAYS / 2.0)) + 1
        mean = _blurred(filled, size) / np.maximum(_blurred(weight, size), 1e-6)
        light *= 1.0 - share * np.clip((mean - filled) / (reach * radius), 0.0, 1.0)
    return light


def _blurred(values: Singles, size: int) -> Singles:
    """Return the running mean of the running mean, over `size` pixels each way; nothing lies outside."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(uniform_filter(values, size, mode="constant"), size, mode="constant"))
