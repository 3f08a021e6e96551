"""The example of a law of one's own, run as its reader does: its report, its figures, numbers known apart from it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from examples.result_folder import pictures, read_columns, read_summary
from oracles.lattice_statics import Lattice, held
from scipy.integrate import quad

import pybondem as bd

ROOT = Path(__file__).parents[2]
ONSET, END, D, E = 5e-6, 20e-6, 1e-3, 1e9


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the example leaves: its figures, its words (said.txt), and the result folder "out"."""
    where = tmp_path_factory.mktemp("own_law")
    words = ["run", str(ROOT / "examples" / "own_law.py"), "-o", "out", "--threads", "1"]
    command = [sys.executable, "-m", "pybondem", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=where, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    (where / "said.txt").write_text(done.stdout, encoding="utf-8")
    return where


def test_the_law_stands_every_trial_and_has_its_toughness(folder: Path) -> None:
    said = (folder / "said.txt").read_text(encoding="utf-8")
    assert re.search(r"^fading: \d+ passed", said, re.MULTILINE)
    assert "failed" not in said
    assert re.search(r"^toughness +passed", said, re.MULTILINE)
    assert pictures(folder) == {"own_law.png", "own_law_tension.png"}


def test_the_rod_is_as_stiff_as_statics_says_before_it_fades(folder: Path) -> None:
    columns, _ = read_columns(folder / "out" / "history.csv")
    strain, force = columns["strain"], columns["force"]
    elastic = (strain > 1e-3) & (strain < 4e-3)  # no bond opens by more than its length times the strain: 4e-6 m
    slope = np.polyfit(strain[elastic], force[elastic], 1)[0]
    assert slope == pytest.approx(stiffness(), rel=2e-3)
    assert force[-1] < 0.2 * force.max()


def test_broken_bonds_took_at_least_their_toughness(folder: Path) -> None:
    k = E / D
    held_up = quad(lambda x: k * x * (1.0 - (x - ONSET) / (END - ONSET)), ONSET, END)[0]
    G_f = 0.5 * k * ONSET**2 + held_up
    text = (folder / "said.txt").read_text(encoding="utf-8")
    said = re.search(r"G_f = ([\d.]+) J/m2: .* took ([\d.]+) mJ,\nall damage ([\d.]+) mJ", text)
    assert said is not None
    assert float(said[1]) == pytest.approx(G_f, abs=0.051)
    summary = read_summary(folder / "out")
    parted = G_f * np.pi * (0.5 * D) ** 2 * summary["broken"]
    assert float(said[2]) == pytest.approx(1e3 * parted, abs=0.0051)
    assert float(said[3]) == pytest.approx(1e3 * summary["energy"]["damage"], abs=0.0051)
    assert (
        summary["energy"]["damage"] > parted
    )  # shear and bending go with the opening, and bonds that did not break were damaged too


def stiffness() -> float:
    """Return EA [N] of the rod by statics: force on its lower end for a unit strain of its upper one."""
    x = bd.packing.hcp(diameter=D, inside=bd.Cylinder(radius=5e-3, height=20e-3), axis="z").x
    near = bd.Model(bd.packing.Particles(x, np.full(len(x), 0.5 * D)), density=2500.0).touching()
    r = 0.5 * D
    A, I = np.pi * r**2, np.pi * r**4 / 4.0
    k = np.array([E * A, 0.5 * E * A, 0.5 * E * 2.0 * I, E * I]) / D
    low, high = np.flatnonzero(x[:, 2] <= 1e-3), np.flatnonzero(x[:, 2] >= 19e-3)
    apart = float(x[high, 2].mean() - x[low, 2].mean())
    _, force = Lattice(x).bond(near, *k).solve(held(low, "x y z rx ry rz") | held(high, "z", apart))
    return -float(force[low, 2].sum())
