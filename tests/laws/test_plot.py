"""The figures of laws: the numbers drawn are those of closed forms, in the units that the axes name."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pybondem as bd
from pybondem import laws as library
from pybondem.bonds import ValuedLaw
from pybondem.errors import InputError
from pybondem.laws import paths
from pybondem.laws.plot import plot_law

Floats = NDArray[np.float64]
K = 4e11  # shear stiffness per area of the joints here [Pa/m]; the normal one follows from the note below the figure
SLIP, OPENING = 1, 0  # columns


@bd.damage_law(parameters={"at": "m"}, memory={"torn": "1", "shorn": "1"})
def by_mode(d: Any, m: Any, p: Any) -> Any:
    """A law whose modes break apart from one another: normal beyond an opening, shear beyond a slip twice as large."""
    torn = bd.where(d.opening > p.at, 1.0, m.torn)
    shorn = bd.where(d.slip > 2.0 * p.at, 1.0, m.shorn)
    return bd.Damage(torn, shorn, 0.0, 0.0), torn, shorn


def drawn(law: ValuedLaw, **options: Any) -> dict[tuple[str, int], dict[str, Floats]]:
    """Return the curves of the figure of a law, (points, 2), by row label, column, and "once", "cycles" or name."""
    figure = plot_law(law, **options)
    columns = len({round(axes.get_position().x0, 2) for axes in figure.axes})
    found: dict[tuple[str, int], dict[str, Floats]] = {}
    for k, axes in enumerate(figure.axes):
        label = figure.axes[k - k % columns].get_ylabel()
        curves = {}
        for line in axes.get_lines():
            if len(np.atleast_1d(line.get_xdata())) > 2:
                name = str(line.get_label())
                known = {"loaded once": "once", "in cycles": "cycles"}.get(name, name)
                if known.startswith("_"):
                    known = "cycles" if line.get_linewidth() < 2.0 else "once"
                curves[known] = np.asarray(line.get_xydata())
        found[label, k % columns] = curves
    return found


def at(curve: Floats, x: float) -> float:
    """Return y of a curve of growing x."""
    return float(np.interp(x, curve[:, 0], curve[:, 1]))


def test_bilinear_slip_is_drawn_as_its_closed_form() -> None:
    found = drawn(library.bilinear(1e-5, 5e-5, stiffness=K))
    stress, damage = found["stress [MPa]", SLIP]["once"], found["damage", SLIP]["once"]
    dissipated = found["dissipated [J/m²]", SLIP]["once"]
    assert stress[-1, 0] > 50.0  # µm: it goes to where it has failed
    peak = 1e-6 * K * 1e-5
    for slip in (5.0, 20.0, 35.0, 48.0):
        expected = peak * min(slip / 10.0, (50.0 - slip) / 40.0)
        assert at(stress, slip) == pytest.approx(expected, rel=2e-3, abs=1e-3 * peak)
        assert at(damage, slip) == pytest.approx(1.0 - expected / (1e-6 * K * 1e-6 * slip), abs=5e-3)
    assert dissipated[-1, 1] == pytest.approx(0.5 * K * 1e-5 * 5e-5, rel=1e-3)
    np.testing.assert_allclose(damage[-1, 1], 1.0)


def test_cycles_unload_to_the_origin_and_press_together() -> None:
    found = drawn(library.bilinear_tension(1e-5, 5e-5, stiffness=K))
    cycles, once = found["stress [MPa]", OPENING]["cycles"], found["stress [MPa]", OPENING]["once"]
    stiffness = once[1, 1] / once[1, 0]
    pressed = cycles[cycles[:, 0] < 0.0]
    assert len(pressed) > 10
    np.testing.assert_allclose(pressed[:, 1], stiffness * pressed[:, 0], rtol=1e-6)  # damage does not act on it
    turn = int(np.argmax(cycles[:, 0] > 15.0))
    turn += int(np.argmax(np.diff(cycles[turn:, 0]) < 0.0))
    top = cycles[turn]
    back = cycles[turn : turn + 5]
    assert top[1] == pytest.approx(stiffness * 10.0 * (50.0 - top[0]) / 40.0, rel=1e-3)
    np.testing.assert_allclose(back[:, 1], top[1] / top[0] * back[:, 0], rtol=1e-6)


def test_both_at_once_share_the_damage_of_the_slip() -> None:
    found = drawn(library.bilinear(1e-5, 5e-5, stiffness=K))
    curves, alone = found["stress [MPa]", 2], found["stress [MPa]", SLIP]["once"]
    for slip in (5.0, 30.0):
        assert at(curves["shear"], np.sqrt(2.0) * slip) == pytest.approx(at(alone, slip), rel=1e-2)
    ratio = curves["normal"][1:20, 1] / curves["shear"][1:20, 1]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-3)


def test_plastic_slip_loses_what_its_loops_enclose() -> None:
    found = drawn(library.plastic_slip(yield_stress=5e6, hardening=0.0, stiffness=K))
    assert "damage" not in {label for label, _ in found}
    stress, dissipated = found["stress [MPa]", SLIP]["once"], found["dissipated [J/m²]", SLIP]["once"]
    far = stress[-1, 0]
    assert far > 2.0 * 12.5  # µm: well past the yield slip
    assert at(stress, 0.9 * far) == pytest.approx(5.0, rel=1e-3)
    assert dissipated[-1, 1] == pytest.approx(5e6 * (far - 12.5) * 1e-6, rel=2e-2)
    cycles = found["stress [MPa]", SLIP]["cycles"]
    assert cycles[:, 1].min() == pytest.approx(-5.0, rel=1e-3)
    np.testing.assert_array_equal(found["dissipated [J/m²]", OPENING]["once"][:, 1], 0.0)


def test_each_mode_shows_its_own_damage() -> None:
    found = drawn(by_mode(1e-5, stiffness=K))
    for column, breaks in ((OPENING, 10.0), (SLIP, 20.0)):
        damage = found["damage", column]["once"]
        np.testing.assert_array_equal(damage[:, 1], (damage[:, 0] > breaks).astype(float))
    assert found["damage", 2].keys() == {"normal", "shear"}


def test_a_law_without_a_threshold_is_shown_to_its_end() -> None:
    @bd.damage_law(parameters={"rate": "1/m"}, memory={"longest": "m"})
    def tiring(d: Any, m: Any, p: Any) -> Any:
        longest = bd.maximum(m.longest, d.opening)
        return 1.0 - bd.exp(-p.rate * longest), longest

    damage = drawn(tiring(rate=50.0))["damage", OPENING]["once"]
    assert damage[-1, 1] > 0.97
    for mm in (5.0, 20.0, 60.0):
        assert at(damage, mm) == pytest.approx(1.0 - np.exp(-50.0 * 1e-3 * mm), abs=2e-3)


def test_reach_and_own_path_are_drawn_as_asked() -> None:
    law = library.bilinear(1e-5, 5e-5, stiffness=K)
    assert drawn(law, reach=2e-5)["stress [MPa]", SLIP]["once"][-1, 0] == pytest.approx(20.0)
    own = paths.through([np.zeros(6), paths.deformation(s=3e-5), paths.deformation(n=-1e-6)], 10)
    found = drawn(law, driven=own)
    np.testing.assert_allclose(found["displacement [µm]", 0]["slip s"][:, 1], 1e6 * own[:, 1])
    stress = found["stress [MPa]", 0]["shear s"][:, 1]
    np.testing.assert_allclose(stress[10], 1e-6 * K * 1e-5 * 20.0 / 40.0, rtol=1e-3)
    np.testing.assert_allclose(stress[15], 0.5 * stress[10], rtol=1e-3)
    assert found["damage", 0]["once"].shape == (21, 2)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"reach": 1.0}, "reach of plot is 1 m; it must be at most"),
        ({"reach": -1e-5}, "reach of plot is -1e-05 m"),
        ({"driven": np.zeros((5, 3))}, "driven of plot"),
        ({"driven": np.zeros((1, 6))}, "driven of plot has 1 points"),
        ({"path": "law.pdf"}, "must be a .png"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plot_law(library.bilinear(1e-5, 5e-5), **options)


def test_the_figure_is_written_and_can_be_saved_again(tmp_path: Path) -> None:
    path = tmp_path / "figures" / "law.png"
    figure = library.strength.plot(path=str(path))
    assert path.read_bytes()[:4] == b"\x89PNG"
    text = path.with_suffix(".svg").read_text(encoding="utf-8")
    assert "one bond of 10 mm" in text
    for word in ("strength: tension = 5 MPa, shear = 10 MPa", "opening [µm]", "loaded once", "in cycles"):
        assert f"<!-- {word}" in text
    figure.savefig(tmp_path / "again.png")
    assert (tmp_path / "again.png").stat().st_size > 10_000


def test_laws_do_not_load_matplotlib_before_they_draw() -> None:
    code = "import pybondem as bd, sys; bd.laws.bilinear(1e-5, 5e-5); assert 'matplotlib' not in sys.modules"
    code += "; bd.laws.bilinear.plot(); assert 'matplotlib.figure' in sys.modules"
    code += "; assert 'matplotlib.pyplot' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_law_that_is_not_finite_is_said_below_the_figure(tmp_path: Path) -> None:
    @bd.damage_law(parameters={"at": "m"}, memory={"D": "1"})
    def root(d: Any, m: Any, p: Any) -> Any:
        D = bd.maximum(m.D, 1.0 - bd.sqrt(1.0 - bd.maximum(d.opening, 0.0) / p.at))
        return D, D

    root.plot(at=1e-5, path=tmp_path / "root.png", reach=1.3e-5)
    text = (tmp_path / "root.svg").read_text(encoding="utf-8")
    assert "The law is not finite from opening 10 µm on: it is drawn as it was before." in text
    library.bilinear.plot(path=tmp_path / "sound.png")
    assert "not finite" not in (tmp_path / "sound.svg").read_text(encoding="utf-8")
