"""The figures: right size, right numbers drawn, right units, and no trace left in the caller's matplotlib."""

import re
import struct
import subprocess
import sys

import matplotlib as mpl
import matplotlib.figure
import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.output.figures import (
    DPI,
    SIZE,
    curve_against_theory,
    energy_book,
    line_figure,
    profiles_against_theory,
)

T = np.linspace(0.0, 1.0, 60)
NAMES = {"labels": ("end displacement", "load"), "units": ("m", "N")}


@pytest.fixture
def drawn(monkeypatch):
    """The figures saved while a test runs, to look at what is on their axes."""
    figures = []
    save = matplotlib.figure.Figure.savefig

    def remember(self, *args, **kwargs):
        if self not in figures:
            figures.append(self)
        save(self, *args, **kwargs)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", remember)
    return figures


def png_size(path):
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


def words(path):
    """What the SVG says: matplotlib leaves each text as a comment beside its outlines."""
    return re.findall(r"<!-- (.*?) -->", path.with_suffix(".svg").read_text(encoding="utf-8"))


def curves(axes):
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}


def test_line_figure_draws_the_numbers_in_the_units_it_names(tmp_path, drawn):
    path = tmp_path / "figures" / "load.png"
    measured = {"d = 0.5 m": 6.0e5 * T, "d = 0.25 m": 6.5e5 * T}
    assert line_figure(path, 2e-3 * T, measured, **NAMES, theory={"theory": ([0, 2e-3], [0, 6.4e5])}, title="A") == path
    assert png_size(path) == (round(SIZE[0] * DPI), round(SIZE[1] * DPI))
    assert {"end displacement [mm]", "load [kN]", "theory", "d = 0.5 m", "A"} <= set(words(path))
    (axes,) = drawn[0].axes
    lines = curves(axes)
    np.testing.assert_allclose(lines["d = 0.5 m"], np.column_stack([2.0 * T, 600.0 * T]))
    np.testing.assert_allclose(lines["theory"], [[0.0, 0.0], [2.0, 640.0]])
    colours = {line.get_label(): line.get_color() for line in axes.get_lines()}
    assert colours["theory"] == "black"
    assert len(set(colours.values())) == 3
    assert all(line.get_marker() in ("", "None") for line in axes.get_lines())


def test_few_points_are_marked_and_one_curve_has_no_legend(tmp_path, drawn):
    line_figure(tmp_path / "a.png", [0, 1, 2], {"force": [0.0, np.nan, 2.0]}, labels=("n", "x"), units=("", ""))
    (axes,) = drawn[0].axes
    assert axes.get_lines()[0].get_marker() == "o"
    assert axes.get_legend() is None
    assert axes.get_xlabel() == "n"


def test_many_curves_are_told_apart_and_named_beside_the_axes(tmp_path, drawn):
    line_figure(tmp_path / "a.png", T, {f"law {k}": T**k for k in range(1, 9)}, **NAMES)
    (axes,) = drawn[0].axes
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.get_lines()}
    assert len(looks) == 8
    assert axes.get_legend() is None
    assert [text.get_text() for text in drawn[0].legends[0].get_texts()] == [f"law {k}" for k in range(1, 9)]


def test_logarithmic_axes(tmp_path, drawn):
    d = np.array([1.0, 0.5, 0.25, 0.125])
    line_figure(tmp_path / "a.png", d, {"error": d**2 / 10}, labels=("d", "error"), units=("m", ""), log="xy")
    (axes,) = drawn[0].axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert {"0.2", "0.5", "1", "0.01", "0.1"} <= set(words(tmp_path / "a.png"))


def test_curve_against_theory_names_its_marks(tmp_path, drawn):
    load = 7e5 * np.sin(np.pi * T)
    path = curve_against_theory(
        tmp_path / "a.png", (1e-3 * T, 1.01 * load), (1e-3 * T[::2], load[::2]), **NAMES, marks={"peak": (5e-4, 7e5)}
    )
    assert png_size(path) == (round(SIZE[0] * DPI), round(SIZE[1] * DPI))
    assert {"simulation", "theory", "peak", "load [kN]", "end displacement [mm]"} <= set(words(path))
    (axes,) = drawn[0].axes
    np.testing.assert_allclose(curves(axes)["theory"], np.column_stack([T[::2], load[::2] / 1e3]))
    np.testing.assert_allclose(curves(axes)["simulation"], np.column_stack([T, 1.01 * load / 1e3]))
    np.testing.assert_allclose(axes.get_lines()[-1].get_xydata(), [[0.5, 700.0]])


@pytest.mark.parametrize(("at", "below"), [(0.2, True), (0.5, False), (0.8, False), (1.5, True)])
def test_labels_of_marks_keep_off_the_curve(tmp_path, drawn, at, below):
    """Up a hill, over its top, down, and back to the left as after a snap-back, where the path rises to the right."""
    s = np.linspace(0.0, 2.0, 401)
    x, y = np.where(s < 1, s, 1.5 - 0.5 * s), np.where(s < 1, np.sin(np.pi * np.minimum(s, 0.9)), 0.3 * (2 - s))
    here = (np.interp(at, s, x), np.interp(at, s, y))
    curve_against_theory(tmp_path / "a.png", (x, y), (x, y), labels=("u", "P"), units=("", ""), marks={"here": here})
    (label,) = drawn[0].axes[0].texts
    assert (label.get_va() == "top") is below


def test_profiles_pair_points_with_lines_by_stage(tmp_path, drawn):
    x, fine = np.linspace(0, 30, 11), np.linspace(0, 30, 101)
    measured = {f"{k} mm": (x, 2e6 * np.exp(-x / (k + 1))) for k in range(3)}
    theory = {f"{k} mm": (fine, 2e6 * np.exp(-fine / (k + 1))) for k in range(2)}
    path = profiles_against_theory(
        tmp_path / "a.png",
        measured,
        theory,
        labels=("position", "bond stress"),
        units=("m", "Pa"),
        legend_title="end displacement",
    )
    assert png_size(path)[1] == round(SIZE[1] * DPI)
    assert {"0 mm", "1 mm", "2 mm", "end displacement", "bond stress [MPa]", "position [m]"} <= set(words(path))
    (axes,) = drawn[0].axes
    points = [line for line in axes.get_lines() if line.get_linestyle() == "None"]
    lines = [line for line in axes.get_lines() if line.get_linestyle() == "-"]
    assert (len(points), len(lines)) == (3, 2)
    assert [line.get_color() for line in lines] == [line.get_color() for line in points[:2]]
    np.testing.assert_allclose(points[2].get_ydata(), 2.0 * np.exp(-x / 3))
    np.testing.assert_allclose(lines[1].get_ydata(), 2.0 * np.exp(-fine / 2))


def test_energy_book_shows_all_columns_and_the_residual_as_a_share(tmp_path, drawn):
    columns = {"kinetic": 1e2 * T, "strain": 3e3 * T**2, "damage": 0 * T, "damping": 2e2 * T, "work": -4e3 * T}
    path = energy_book(tmp_path / "a.png", 0.05 * T, columns, 8.0 * T, title="Energy book")
    assert png_size(path) == (round(1.15 * SIZE[0] * DPI), round(1.2 * SIZE[1] * DPI))
    assert {*columns, "energy [kJ]", "time [ms]"} <= set(words(path))
    upper, lower = drawn[0].axes
    np.testing.assert_allclose(curves(upper)["strain"], np.column_stack([50.0 * T, 3.0 * T**2]))
    np.testing.assert_allclose(lower.get_lines()[-1].get_xydata(), np.column_stack([50.0 * T, 2e-3 * T]))  # 8 / 4000
    assert upper.get_position().height > 2 * lower.get_position().height


def test_a_book_of_nothing_but_zeros_is_drawn(tmp_path):
    energy_book(tmp_path / "a.png", T, {"kinetic": 0 * T}, 0 * T)
    assert png_size(tmp_path / "a.png")[0] > 1000


def test_the_same_numbers_give_the_same_files(tmp_path):
    for name in ("a.png", "b.png"):
        line_figure(tmp_path / name, T, {"force": T**2}, **NAMES)
    for suffix in (".png", ".svg"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_the_callers_settings_come_back(tmp_path):
    before = dict(mpl.rcParams)
    line_figure(tmp_path / "a.png", T, {"force": T}, **NAMES)
    with pytest.raises(InputError):
        curve_against_theory(tmp_path / "a.png", (T, T), (T, T[:5]), **NAMES)
    assert dict(mpl.rcParams) == before


def test_pyplot_is_never_imported(tmp_path):
    script = (
        "import sys; from pybondem.output.figures import line_figure; "
        "line_figure(sys.argv[1], [0, 1], {'a': [0, 1]}, labels=('x', 'y'), units=('m', 'N')); "
        "print('matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "a.png")], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("change", "words_of_error"),
    [
        ({"ys": {}}, "ys is empty"),
        ({"ys": {"a": T[:3]}}, r"curve 'a' has x of shape \(60,\) and y of \(3,\)"),
        ({"ys": {"a": np.ones((60, 2))}}, "both must be"),
        ({"ys": {"a": ["x"] * 60}}, "must be real numbers"),
        ({"x": [], "ys": {"a": []}}, r"shape \(0,\)"),
        ({"theory": {"b": (T, T[:2])}}, "curve 'b'"),
        ({"log": "z"}, "log is 'z'"),
        ({"path_png": "figure.pdf"}, "must be a .png"),
    ],
)
def test_bad_curves_are_refused_and_leave_no_file(tmp_path, change, words_of_error):
    call = {"path_png": "figure.png", "x": T, "ys": {"a": T}} | NAMES | change
    call["path_png"] = tmp_path / call["path_png"]
    with pytest.raises(InputError, match=words_of_error):
        line_figure(**call)
    assert not list(tmp_path.iterdir())


def test_empty_or_unknown_stages_and_columns_are_refused(tmp_path):
    with pytest.raises(InputError, match="measured is empty"):
        profiles_against_theory(tmp_path / "a.png", {}, {}, **NAMES)
    with pytest.raises(InputError, match="stage 'b', which is not in measured"):
        profiles_against_theory(tmp_path / "a.png", {"a": (T, T)}, {"b": (T, T)}, **NAMES)
    with pytest.raises(InputError, match="columns is empty"):
        energy_book(tmp_path / "a.png", T, {}, T)
