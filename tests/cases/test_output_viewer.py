"""The view for a browser: its data are what was given, within the steps of its numbers, and it needs nothing else."""

import base64
import gzip
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.output import viewer
from pybondem.output.colouring import Parts, Scalar
from pybondem.output.render import View
from pybondem.output.viewer import CutStart, quantised, write_view

RNG = np.random.default_rng(11)
N, FRAMES = 500, 3
X = RNG.uniform(-1.0, 1.0, (FRAMES, N, 3)) * (30.0, 2.0, 1e-3) + (5.0, -7.0, 0.0)
RADIUS = RNG.uniform(0.1, 0.3, N)
STRESS = RNG.normal(0.0, 2e6, (FRAMES, N))
SHOWN = RNG.uniform(size=N) < 0.5
PART = RNG.integers(0, 2, N)
COLOURS = {"fibre": "#E69F00", "matrix": "#009E73"}
NAMES = ("u = 0", "u = 1 mm", "u = 2 mm")


class Page(HTMLParser):
    """A page taken apart: its scripts by id, the text of its title, and every attribute."""

    def __init__(self, path):
        super().__init__()
        self.scripts, self.title, self.given = {}, "", []
        self._inside = None
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        self.given += [(tag, *pair) for pair in attributes]
        self._inside = (tag, dict(attributes).get("id"))

    def handle_data(self, data):
        if self._inside and self._inside[0] == "script":
            self.scripts[self._inside[1]] = self.scripts.get(self._inside[1], "") + data
        elif self._inside and self._inside[0] == "title":
            self.title += data

    def handle_endtag(self, tag):
        self._inside = None


def decoded(path):
    """The head of a page and its arrays by name, read as the page reads them."""
    page = Page(path)
    head = json.loads(page.scripts["head"])
    blob = gzip.decompress(base64.b64decode(page.scripts["data"]))
    arrays = {}
    for section in head["sections"]:
        kind = np.dtype(section["type"])
        assert section["offset"] % kind.itemsize == 0, "a typed array of the browser must be aligned"
        arrays[section["name"]] = np.frombuffer(blob, kind, section["length"], section["offset"])
    assert sum(a.nbytes for a in arrays.values()) == len(blob)
    return head, arrays


def fields():
    return {"part": Parts(PART, COLOURS), "stress": Scalar(STRESS, "Pa", shown=SHOWN), "damage": Scalar(RADIUS)}


def written(path, **changes):
    given = {"x": X, "radius": RADIUS, "fields": fields(), "frames": NAMES} | changes
    return write_view(path, given.pop("x"), given.pop("radius"), given.pop("fields"), **given)


def test_the_data_are_those_given_within_the_steps_of_the_numbers(tmp_path):
    head, arrays = decoded(written(tmp_path / "a" / "view.html", start="stress", cut=CutStart("y", 0.25, ["fibre"])))
    assert (head["count"], head["frames"]) == (N, list(NAMES))
    places = arrays["x"].reshape(FRAMES, N, 3).astype(float)
    error = np.abs(head["low"] + (places + 32768.0) * head["step"] - X).max(axis=(0, 1))
    span = np.ptp(X, axis=(0, 1))
    assert np.all(error <= 0.5001 * span / 65535)
    np.testing.assert_allclose(arrays["radius"], RADIUS, rtol=1e-7)
    np.testing.assert_array_equal(arrays["field0"], PART + 1)

    codes, scale = arrays["field1"].reshape(FRAMES, N).astype(float), head["fields"][1]
    assert scale["unit"] == "MPa"
    values = 1e6 * (scale["low"] + (codes - 1.0) / 254.0 * (scale["high"] - scale["low"]))
    assert np.abs(values - STRESS)[:, SHOWN].max() <= 0.5001 * np.ptp(STRESS[:, SHOWN]) / 254
    assert np.all(codes[:, ~SHOWN] == 0.0)
    assert arrays["field2"].size == N
    assert head["start"] == head["start"] | {"field": 1, "cut": 1, "place": 0.25, "whole": ["fibre"]}


def test_colours_and_ticks_of_a_field(tmp_path):
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    head, _ = decoded(written(tmp_path / "view.html"))
    tables = [np.frombuffer(base64.b64decode(f["table"]), np.uint8).reshape(256, 3) / 255.0 for f in head["fields"]]
    assert head["fields"][0]["names"] == list(COLOURS)
    np.testing.assert_allclose(tables[0][1:3], [to_rgb(c) for c in COLOURS.values()], atol=0.002)
    np.testing.assert_allclose(tables[1][1:], colormaps["viridis"](np.linspace(0, 1, 255))[:, :3], atol=0.002)
    scale = head["fields"][1]
    assert len(scale["ticks"]) >= 3
    for place, word in scale["ticks"]:
        value = float(word.replace("−", "-"))
        assert value == pytest.approx(scale["low"] + place * (scale["high"] - scale["low"]), abs=1e-9)


def test_a_view_that_does_not_move_keeps_one_place_each(tmp_path):
    head, arrays = decoded(written(tmp_path / "view.html", x=X[0], radius=0.2))
    assert arrays["x"].size == 3 * N
    assert head["start"]["cut"] == -1
    flat = X[0] * (1.0, 0.0, 1.0) + (0.0, 0.3, 0.0)
    low, step, whole = quantised(flat)
    back = low + (whole.astype(float) + 32768.0) * step
    np.testing.assert_array_equal(back[:, 1], 0.3)
    assert (whole[:, 0].min(), whole[:, 0].max()) == (-32768, 32767)
    assert step[1] == 0.0


def test_it_needs_no_network_and_says_so_to_the_browser(tmp_path):
    path = written(tmp_path / "view.html")
    page, text = Page(path), path.read_text(encoding="utf-8")
    assert not [a for a in page.given if a[1] in ("src", "href", "srcset", "data", "action")]
    code = page.scripts[None]
    for reach in (
        "//www",
        "http:",
        "https:",
        "fetch(",
        "XMLHttpRequest",
        "WebSocket",
        "import(",
        "importScripts",
        "url(",
    ):
        assert reach not in code, reach
    assert not re.search(r"@import|url\(|https?:", text[: text.index("<script")])
    policy = next(value for tag, name, value in page.given if tag == "meta" and name == "content" and "src" in value)
    assert policy == "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
    assert "WebGL2 is not available" in code
    assert "DecompressionStream" in code


def test_names_cannot_break_out_of_the_page(tmp_path):
    evil = "</script><script>alert(1)</script> {{data}} {{head}} & <b>"
    path = write_view(
        tmp_path / "view.html", X[0], RADIUS, {evil: Parts(PART, {evil: "red", "b": "blue"})}, title=evil, frames=[evil]
    )
    page = Page(path)
    assert page.title == evil
    assert set(page.scripts) == {"head", "data", None}
    head, _ = decoded(path)
    assert (head["title"], head["fields"][0]["name"], head["fields"][0]["names"][0], head["frames"]) == (
        evil, evil, evil, [evil],
    )  # fmt: skip


def test_the_same_input_gives_the_same_file(tmp_path):
    first, second = (written(tmp_path / name).read_bytes() for name in ("a.html", "b.html"))
    assert first == second


BAD = [
    ({"x": np.where(X.max() == X, np.nan, X)}, "not finite"),
    ({"x": X[:2]}, r"with 3 frames it must be \(n, 3\) or \(3, n, 3\)"),
    ({"x": X[..., :2]}, "shape"),
    ({"x": X[:, :0]}, "nothing to show"),
    ({"radius": -RADIUS}, "positive"),
    ({"radius": RADIUS[:-1]}, "499 radii"),
    ({"fields": {}}, "at least one field"),
    ({"fields": {"part": PART}}, "field 'part' is a ndarray"),
    ({"fields": {"s": Scalar(STRESS[:2])}}, "2 frames; the view has 3"),
    ({"fields": {"s": Scalar(STRESS[:, 1:])}}, "values for 499 spheres"),
    ({"frames": ()}, "at least one frame"),
    ({"start": "strss"}, "did you mean 'stress'"),
    ({"cut": CutStart("w")}, "axis of the cut"),
    ({"cut": CutStart("x", 1.5)}, "between 0 and 1"),
    ({"cut": CutStart("x", 0.5, ["fiber"])}, "did you mean 'fibre'"),
    ({"view": View((0, 0, 1))}, "parallel"),
]


@pytest.mark.parametrize(("wrong", "says"), BAD, ids=[says for _, says in BAD])
def test_what_cannot_be_shown_is_refused_and_nothing_is_written(tmp_path, wrong, says):
    with pytest.raises(InputError, match=says):
        written(tmp_path / "view.html", **wrong)
    assert not list(tmp_path.iterdir())


def test_another_kind_of_file_and_too_much_data_are_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"must be an \.html"):
        written(tmp_path / "view.png")
    monkeypatch.setattr(viewer, "MOST_BYTES", 1 << 10)
    with pytest.raises(InputError, match="fewer frames"):
        written(tmp_path / "view.html")


BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here to draw the page")
def test_a_browser_draws_the_spheres_where_they_are(tmp_path):
    """Two spheres along x seen from the front: left orange, right green, the ground between them clear."""
    from matplotlib.image import imread

    x, colours = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]], Parts([0, 1], COLOURS)
    path = write_view(tmp_path / "view.html", x, 1.0, {"part": colours}, view=View((0.0, -1.0, 0.0)))
    shot = tmp_path / "shot.png"
    subprocess.run(
        [BROWSER, "--headless=new", "--no-sandbox", f"--user-data-dir={tmp_path / 'profile'}", "--use-gl=angle",
         "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1400,600",
         "--virtual-time-budget=4000", f"--screenshot={shot}", path.as_uri()],
        capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    image = imread(shot)[..., :3]
    metre, row, column = 0.92 * min(1100 / 6, 510 / 2), 310, 560  # the panel takes 300 pixels, the lines above 90
    left, middle, right = (image[row, round(column + k * metre)] for k in (-2.0, 0.0, 2.0))
    assert left[0] > left[1] > left[2] + 0.3
    assert right[1] > right[2] > right[0]
    np.testing.assert_array_equal(middle, 1.0)
    inside = [np.ptp(image[row, round(column + k * metre)]) > 0.1 for k in (-2.97, -1.03, 1.03, 2.97)]
    outside = [np.ptp(image[row, round(column + k * metre)]) == 0.0 for k in (-3.03, -0.97, 0.97, 3.03)]
    assert all(inside + outside)
