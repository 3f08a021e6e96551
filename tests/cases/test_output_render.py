"""Pictures of spheres: pixels against rays cast one by one in another way, areas against closed forms, and words."""

import re
import struct
import time

import matplotlib.figure
import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.output.colouring import Parts, Scalar
from pybondem.output.plate import Note, Panel, plate
from pybondem.output.render import MARGIN, RAYS, Cut, View, render

PRIMARIES = {"red": "#ff0000", "green": "#00ff00", "blue": "#0000ff"}
FRONT = View((0.0, -1.0, 0.0))  # x to the right, z up


def one(count=1):
    return Parts(np.zeros(count, int), {"all": "#808080"})


def crowd(count=40):
    """Spheres of many sizes that intersect, in three colours."""
    rng = np.random.default_rng(3)
    x, radius = rng.uniform(-1.0, 1.0, (count, 3)), rng.uniform(0.1, 0.45, count)
    return x, radius, rng.integers(0, 3, count)


def first_met(x, radius, picture, at, cut):
    """Which sphere each ray meets first, -1 for none, and whether it is alone there: two cut spheres may share a face.

    By intervals of the ray inside sphere and half-space, in space.
    """
    right, up, towards = picture.axes
    start = (picture.corner[0] + at[:, 0] / picture.scale)[:, None] * right
    start = start + (picture.corner[1] - at[:, 1] / picture.scale)[:, None] * up + 100.0 * towards
    arm = start[:, None, :] - x
    b = arm @ -towards
    under = b * b - (np.einsum("ijk,ijk->ij", arm, arm) - radius**2)
    root = np.sqrt(np.maximum(under, 0.0))
    enter, leave = np.where(under > 0.0, -b - root, np.inf), np.where(under > 0.0, -b + root, -np.inf)
    if cut is not None:
        normal, height = cut.plane()
        speed, room = float(-towards @ normal), (height - start @ normal)[:, None]
        of = cut.cuts(len(x))
        if speed > 0.0:
            leave = np.where(of, np.minimum(leave, room / speed), leave)
        else:
            enter = np.where(of, np.maximum(enter, room / speed), enter)
    enter = np.where(enter <= leave, enter, np.inf)
    first, second = np.partition(enter, 1, axis=1)[:, :2].T
    return np.where(np.isfinite(first), enter.argmin(axis=1), -1), second > first + 1e-4


@pytest.mark.parametrize("name", ["whole", "facing", "averted", "some"])
def test_every_ray_meets_the_sphere_that_is_first(name):
    x, radius, part = crowd()
    cut = {
        "whole": None,
        "facing": Cut((0.1, 0.0, 0.0), (1.0, -2.0, 0.5)),
        "averted": Cut((0.0, 0.2, 0.0), (0.3, 1.0, 0.0)),
        "some": Cut((0.0, 0.0, 0.0), (0.0, -1.0, 0.0), of=np.arange(len(x)) % 2 == 0),
    }[name]
    picture = render(x, radius, Parts(part, PRIMARIES), view=View((1.0, -2.0, 0.7)), cut=cut, width=120)
    rows, columns = picture.pixels.shape[:2]
    fine = (np.arange(RAYS) + 0.5) / RAYS
    place = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)[:, :, None, None, :]
    rays = place + np.stack(np.meshgrid(fine, fine), axis=-1)
    answers = first_met(x, radius, picture, rays.reshape(-1, 2), cut)
    met, alone = (answer.reshape(rows, columns, RAYS * RAYS) for answer in answers)
    covered = (met >= 0).mean(axis=2)
    assert np.mean(np.abs(picture.pixels[..., 3] / 255.0 - covered) > 0.01) < 1e-3
    colours = np.where(met >= 0, part[met], -1)
    clear = alone.all(axis=2) & (covered == 1.0) & (colours.min(axis=2) == colours.max(axis=2))
    assert clear.sum() > 2000
    seen = picture.pixels[..., :3].argmax(axis=2)
    assert np.mean(seen[clear] != colours[..., 0][clear]) < 1e-3


def test_a_sphere_and_its_cut_cover_their_closed_form_areas():
    picture = render([[0.3, -2.0, 0.7]], 0.5, one(), view=FRONT, width=400)
    assert picture.scale == pytest.approx(400 * (1.0 - 2.0 * MARGIN) / 1.0)
    area = picture.pixels[..., 3].sum() / 255.0 / picture.scale**2
    assert area == pytest.approx(np.pi * 0.25, rel=1e-3)
    np.testing.assert_allclose(picture.place([[0.3, 7.0, 0.7]])[0], 0.5 * np.array(picture.pixels.shape[1::-1]), atol=1)

    beside = render([[0.0, 0.0, 0.0]], 0.5, one(), view=FRONT, width=400, cut=Cut((0.2, 0, 0), (1, 0, 0)))
    angle = 2.0 * np.arccos(0.2 / 0.5)
    area = beside.pixels[..., 3].sum() / 255.0 / beside.scale**2
    assert area == pytest.approx(np.pi * 0.25 - 0.125 * (angle - np.sin(angle)), rel=2e-3)
    assert beside.pixels.shape == picture.pixels.shape  # a cut does not change the frame

    facing = render([[0.0, 0.0, 0.0]], 0.5, one(), view=FRONT, width=400, cut=Cut((0, 0.3, 0), (0, -1, 0)))
    area = facing.pixels[..., 3].sum() / 255.0 / facing.scale**2
    assert area == pytest.approx(np.pi * (0.25 - 0.09), rel=2e-3)
    inside = facing.pixels[150:250, 150:250, :3]
    assert np.ptp(inside.reshape(-1, 3), axis=0).max() <= 1  # a flat face has one brightness


def test_whole_spheres_go_or_stay_by_their_centres():
    x, radius = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [2.0, 0.0, 0.0]], 0.5
    plane = ((0.2, 0.0, 0.0), (1.0, 0.0, 0.0))
    kept = render(x, radius, one(3), view=FRONT, cut=Cut(*plane, whole=True), width=300)
    area = kept.pixels[..., 3].sum() / 255.0 / kept.scale**2
    assert area == pytest.approx(np.pi * 0.25, rel=5e-3)


def test_light_comes_from_the_upper_left_and_does_not_change_the_hue():
    picture = render([[0.0, 0.0, 0.0]], 1.0, Parts([0], {"orange": "#E69F00"}), view=FRONT, width=200)
    colour = picture.pixels[..., :3].astype(float)
    upper_left, lower_right = colour[60, 60], colour[140, 140]
    assert upper_left.sum() > 1.25 * lower_right.sum()
    assert lower_right[1] / lower_right[0] == pytest.approx(0x9F / 0xE6, abs=0.02)


def test_a_scalar_takes_its_colours_from_the_map_and_shows_the_frame_asked_for():
    from matplotlib import colormaps

    field = Scalar([[0.0, 1.0], [1.0, 0.0]], "Pa", shown=[True, True])
    table = field.table()
    np.testing.assert_allclose(table[[1, 128, 255]] / 255.0, colormaps["viridis"]([0.0, 0.5, 1.0])[:, :3], atol=0.003)
    assert field.bytes().tolist() == [[1, 255], [255, 1]]
    assert Scalar([5.0, -5.0, 0.5], low=0.0, high=1.0, shown=np.array([True, True, False])).bytes().tolist()[0] == [
        255,
        1,
        0,
    ]
    x = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
    first, last = (render(x, 1.0, field, view=FRONT, width=100, frame=k).pixels for k in (0, 1))
    np.testing.assert_array_equal(last, render(x, 1.0, field, view=FRONT, width=100).pixels)
    row = first.shape[0] // 2
    yellow, purple = first[row, 80, :3], first[row, 20, :3]
    assert yellow[1] > 150 > 60 > purple[1]
    assert last[row, 20, 1] > 150


def test_equal_values_still_have_a_scale():
    for values, low, high in (([0.0, 0.0], -0.5, 0.5), ([2.0, 2.0], 1.0, 3.0), ([1e308, -1e308], -1e308, 1e308)):
        field = Scalar(values)
        assert (field.low, field.high) == (low, high)
        assert field.bytes().min() >= 1
    assert Scalar([0.0, 0.0], low=0.0).high == 0.5


def test_the_same_bits_every_time():
    x, radius, part = crowd()
    first, second = (render(x, radius, Parts(part, PRIMARIES), width=80).pixels for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_forty_five_thousand_spheres_within_a_minute():
    side = np.arange(36) * 1.0
    x = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)[:45_000]
    began = time.perf_counter()
    picture = render(x, 0.5, Scalar(x[:, 0], "Pa"), cut=Cut((18.0, 0, 0), (1.0, 0, 0)), width=1600)
    assert time.perf_counter() - began < 60.0
    assert picture.pixels.shape[1] == 1600


GOOD = {"x": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "radius": 0.5, "field": one(2)}
BAD = [
    ({"x": [[0.0, np.nan, 0.0], [1.0, 0.0, 0.0]]}, r"x of the spheres\[0, 1\] is nan"),
    ({"x": np.empty((0, 3))}, "is empty"),
    ({"x": [[0.0, 0.0], [1.0, 0.0]]}, r"shape \(2, 2\)"),
    ({"radius": 0.0}, "positive"),
    ({"radius": [0.5, 0.5, 0.5]}, "2 centres and 3 radii"),
    ({"field": [0, 1]}, "field is a list"),
    ({"field": one(3)}, "field has values for 3 spheres; there are 2"),
    ({"view": View((0.0, 0.0, 1.0))}, "parallel"),
    ({"view": View((0.0, 0.0, 0.0))}, "zero vector"),
    ({"cut": Cut((0, 0, 0), (0, 0, 0))}, "zero vector"),
    ({"cut": Cut((0, 0, 0), (1, 0, 0), of=np.array([1, 0]))}, "must be bool"),
    ({"width": 8}, "width is 8"),
    ({"width": 10_000}, "smaller width"),
    ({"frame": 1}, "frame is 1; the field has 1"),
]


@pytest.mark.parametrize(("wrong", "says"), BAD, ids=[says for _, says in BAD])
def test_what_cannot_be_drawn_is_refused_in_words(wrong, says):
    with pytest.raises(InputError, match=says):
        render(**GOOD | wrong)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Parts([0, 2], {"a": "red", "b": "blue"}), "sphere 1 is of part 2"),
        (lambda: Parts([0.0], {"a": "red"}), "whole numbers"),
        (lambda: Parts(np.ma.array([0]), {"a": "red"}), "whole numbers"),
        (lambda: Parts([0], {"a": "rouge"}), "'rouge' is not a colour"),
        (lambda: Parts([0], {}), "0 colours"),
        (lambda: Scalar([0.0, np.nan]), "is nan"),
        (lambda: Scalar([0.0, np.inf]), "is inf"),
        (lambda: Scalar(np.zeros((2, 2, 2))), "shape"),
        (lambda: Scalar([0.0, 1.0], low=2.0), "must rise"),
        (lambda: Scalar([0.0, 1.0], colours="virids"), "did you mean 'viridis'"),
        (lambda: Scalar([0.0, 1.0], shown=[True]), "one for each of the 2"),
        (lambda: plate("a.png", []), "not 0"),
        (lambda: plate("a.jpg", [Panel(render(**GOOD), one(2))]), "must be a .png"),
    ],
)
def test_fields_and_plates_refuse_what_means_nothing(make, says):
    with pytest.raises(InputError, match=says):
        make()


def test_a_plate_says_what_it_shows_and_how_large(tmp_path, monkeypatch):
    figures = []
    save = matplotlib.figure.Figure.savefig
    monkeypatch.setattr(
        matplotlib.figure.Figure, "savefig", lambda self, *a, **k: (figures.append(self), save(self, *a, **k))
    )
    x, radius, part = crowd()
    stress = Scalar(3e5 * x[:, 0], "Pa", low=0.0, high=2e5)
    panels = [
        Panel(render(x, radius, field, width=300), field, label, title, [Note("pulled", (1, 0, 0), (2, 0, 0))])
        for field, label, title in ((Parts(part, PRIMARIES), "part", "parts"), (stress, "axial stress", "load"))
    ]
    path = plate(tmp_path / "deep" / "plate.png", panels)
    width, height = struct.unpack(">II", path.read_bytes()[16:24])
    assert width >= 1600
    assert height > 400
    words = re.findall(r"<!-- (.*?) -->", path.with_suffix(".svg").read_text(encoding="utf-8"))
    assert {"a   parts", "b   load", "axial stress [kPa]", "red", "green", "blue", "pulled"} <= set(words)
    axes = figures[0].axes[0]
    (bar,) = axes.get_lines()
    length = float(np.ptp(bar.get_xdata())) / panels[0].picture.scale
    says = next(t.get_text() for t in axes.texts if re.fullmatch(r"[\d.]+ m+", t.get_text()))
    assert length == pytest.approx(float(says.split()[0]) * {"m": 1.0, "mm": 1e-3}[says.split()[1]])
    scale = figures[0].axes[-1]
    assert scale.get_xlim() == pytest.approx((0.0, 200.0))  # kPa
