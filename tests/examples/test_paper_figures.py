"""Figures 3 and 4 of the paper in their quick form, and the page that a figure is written to."""

import csv
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pybondem as bd
from pybondem.cli import app
from pybondem.examples.pullout import pullout
from pybondem.output.sheet import Sheet, Table
from pybondem.paper import FIGURES, Effort, make
from pybondem.paper.failure_curve import Curve, analytic, distances
from pybondem.paper.interface_shear import PAPERS, stages_of


def test_a_sheet_is_a_page_with_its_tables_and_facts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "a.png"
    picture.touch()
    table = Table("Times", ("n", "t [ms]"), [[1, "2.5 | 3"], [2, "[red]"]])
    sheet = Sheet("fig", "A title", tmp_path, {"What it shows.": picture}, [table], ["A remark."], {"n": np.arange(2)})
    page = sheet.write().read_text(encoding="utf-8")
    assert page.startswith("# A title\n\n![What it shows.](a.png)")
    assert "| 1 | 2.5 \\| 3 |" in page
    assert page.rstrip().endswith("A remark.")
    with (tmp_path / "fig-table-1.csv").open(newline="", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["n", "t [ms]"], ["1", "2.5 | 3"], ["2", "[red]"]]
    facts = json.loads((tmp_path / "fig.json").read_text(encoding="utf-8"))
    assert facts["n"] == [0, 1]
    assert "cpu" in facts["made with"]
    sheet.show()
    shown = capsys.readouterr().out
    assert "t [ms]" in shown  # brackets are text, not markup
    assert "[red]" in shown


def test_an_unknown_figure_is_refused_with_what_there_is(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["paper", "fig5", "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "there is no figure 'fig5' (did you mean 'fig" in result.output
    assert all(name in result.output for name in FIGURES)
    assert not (tmp_path / "out").exists()


def test_stages_are_those_of_the_theory_in_order() -> None:
    assert [s.zones for s in stages_of(pullout())] == ["E", "ES", "ESD", "SESD", "SD"]
    assert [s.zones for s in stages_of(pullout(**PAPERS))] == ["E", "ES", "SES", "S"]
    for stage in stages_of(pullout())[1:]:
        assert stage.plain.dissipated == pytest.approx(stage.energy, rel=1e-9)
        assert stage.sheared.dissipated == pytest.approx(stage.energy, rel=1e-9)


def test_distances_are_those_from_the_curve() -> None:
    exact = analytic(pullout().theory())
    u, load = exact.displacement[1500], exact.load[1500]
    curve = Curve("c", np.array([u, u]), np.array([load, load + 0.1 * exact.load.max()]), "", 0.0)
    on, off = distances(curve, exact)
    assert on == pytest.approx(0.0, abs=1e-12)
    assert 0.02 < off <= 0.1


def test_bonds_without_shear_stiffness_need_bending() -> None:
    with pytest.raises(bd.InputError, match="rolling along the interface; give a bond_radius"):
        pullout(nu=0.2)
    with pytest.raises(bd.InputError, match="bond_radius of pullout"):
        pullout(bond_radius=-1.0)


def test_bending_stiffness_of_the_bonds_is_that_of_a_round_section() -> None:
    test = pullout(diameter=1.0, bond_radius=0.8)
    kn, ks, kt, kb = test._bond(1e10).elastic.stiffness(0.5, 1.0)
    R = 0.8 * 0.5 * test.fitted_diameter
    area, second_moment = np.pi * R**2, np.pi * R**4 / 4.0
    assert kb == pytest.approx(kn / area * second_moment)
    assert kt == pytest.approx(ks / area * 2.0 * second_moment)


@pytest.mark.slow
def test_figure_3_quickly(tmp_path: Path) -> None:
    """Every stage within 3 % of the strength, and better with the shear of the parts."""
    sheet = make("fig3", tmp_path, Effort(quick=True, quiet=True))
    rows = sheet.tables[0].rows
    assert [row[1] for row in rows] == ["E", "ES", "ESD", "SESD", "SD"]
    plain, sheared = ([float(row[c].split()[0]) for row in rows] for c in (4, 5))
    assert 0.0 < max(plain) < 3.0
    assert max(sheared) < max(plain)
    means = [float(row[7].split()[0]) for row in rows]
    assert max(means) < max(sheared)
    work = float(sheet.tables[1].rows[0][7].split()[0])  # of the load along the path, against p L G_f
    assert abs(work) < 1.0  # with so few points
    papers = [float(row[4].split()[0]) for row in sheet.tables[2].rows]
    assert max(papers) > 20.0  # where the one-dimensional theory cannot be right
    assert (tmp_path / "fig3.md").exists()
    assert all(path.stat().st_size > 10_000 for path in sheet.pictures.values())


@pytest.mark.slow
def test_figure_4_quickly(tmp_path: Path) -> None:
    """Both curves within 2 % of the analytic path, through snap-back."""
    result = CliRunner().invoke(app, ["paper", "fig4", "--quick", "-q", "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    facts = json.loads((tmp_path / "out" / "fig4.json").read_text(encoding="utf-8"))
    for name in ("dissipation control, 1/6 a step", "dissipation control, 1/6 a step, friction 0.3 of the strength"):
        assert 0.0 < max(facts[name]["distance"]) < 0.02
        u = facts[name]["displacement_m"]
        assert any(b < a for a, b in pairwise(u))  # it goes back
    assert (tmp_path / "out" / "fig4.png").stat().st_size > 10_000
