"""Figure 3 of the paper: shear stress along the interface at five stages of debonding, against theory.

The lattice is taken through its whole path of equilibrium (dissipation control), snap-back included, and stopped at
five stages. At each it is held against the one-dimensional theory at the same dissipated energy, plain and with the
shear compliance of fibre and matrix in series with the bond. The same model in explicit dynamics follows the path up to
where it turns back.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from pybondem.drivers import EquilibriumPath, dissipation_control
from pybondem.errors import InputError
from pybondem.examples.pullout import PullOutTest, pullout
from pybondem.examples.pullout_result import PullOutResult, run_pullout
from pybondem.examples.pullout_setup import PullOutModel
from pybondem.laws import bilinear
from pybondem.output.sheet import Sheet, Table
from pybondem.paper.effort import Effort
from pybondem.paper.profile_panels import Panel, draw_panels
from pybondem.theory import PullOut, PullOutState

Floats = NDArray[np.float64]
FINE = 20_000  # states of the theory among which the stages are found; some last for a hundredth of a per cent
STEPS, QUICK_STEPS = 20, 6  # of the path, beside those that stop at a stage
ELASTIC = 0.5  # of the load at which softening begins: the elastic stage, as the others midway
EXPLICIT, STATIC = "explicit dynamics", "equilibrium path"
# The values of the public code: the interface is stiff against the shear of the parts, which the theory leaves out.
PAPERS = {
    "E_fibre": 5e10, "E_matrix": 5e9, "nu": 0.2, "bond_radius": 1.0, "free_length": 5.4,
    "interface": bilinear(stiffness=1e9, slip_peak=1e-4, slip_end=3e-3),
}  # fmt: skip


class Stage(NamedTuple):
    """One stage: zones from tip to pulled end, energy dissipated [J], and the theory's state without, with shear."""

    zones: str
    energy: float
    plain: PullOutState
    sheared: PullOutState


class Lattice(NamedTuple):
    """A lattice taken along its path: its test and model, the path, stages with the stress of the joints (m,) [Pa]."""

    test: PullOutTest
    built: PullOutModel
    path: EquilibriumPath
    stages: list[tuple[Stage, Floats]]

    @property
    def x(self) -> Floats:
        """Position of each joint along the interface (m,) [m]."""
        return np.clip(self.built.surface.height, 0.0, self.test.length)


def figure(folder: Path, effort: Effort) -> Sheet:
    """Make the figure: d = 1, 0.7 and 0.5 m for the clean case (quick: 1 m), then the values of the paper's code."""
    clean = [followed(pullout(diameter=d), effort) for d in ((1.0,) if effort.quick else (1.0, 0.7, 0.5))]
    papers = followed(pullout(diameter=1.0 if effort.quick else 0.5, **PAPERS), effort)
    runs = [run_explicitly(each, folder, effort) for each in clean[: 0 if effort.quick else None]]
    sheet = Sheet("fig3", "Figure 3: shear stress along the interface at five stages of debonding", folder)
    sheet.pictures = {
        "Clean case. Points: joints of the lattice; lines: theory, plain (solid) and with the shear compliance of the "
        "parts (dashed). E elastic, S softening, D debonded, from the tip to the pulled end.":
            draw_panels(folder / "fig3-clean.png", [panel(each) for each in clean]),
        "The values of the paper's code, where the theory without shear of fibre and matrix is far from the lattice.":
            draw_panels(folder / "fig3-papers-values.png", [panel(papers)]),
    }  # fmt: skip
    sheet.tables = [
        Table("Clean case: largest difference of shear stress at a joint, in % of the strength", STAGE_HEADS,
              [row for each in clean for row in stage_rows(each)]),
        Table("Clean case: convergence", CONVERGENCE_HEADS,
              [convergence_row(STATIC, each) for each in clean]
              + [explicit_row(each, run) for each, run in zip(clean, runs, strict=False)]),
        Table("Values of the paper's code: the same", STAGE_HEADS, stage_rows(papers)),
    ]  # fmt: skip
    sheet.remarks = REMARKS
    sheet.facts = {"clean": [facts(each) for each in clean], "papers": facts(papers),
                   "explicit": [run.summary["errors"] for run in runs]}  # fmt: skip
    return sheet


# Stages ---------------------------------------------------------------------------------------------------------


def stages_of(test: PullOutTest) -> list[Stage]:
    """Return the stages of a test, one for each sequence of zones that its path passes through."""
    plain, sheared = test.theory(), test.theory(shear_lag=True)
    path = plain.path(FINE)
    words = [word for word in dict.fromkeys(path.zones) if word not in ("E", "D")]
    low = ELASTIC * plain.onset_load()
    found = [Stage("E", 0.0, plain.state_at_load(low), sheared.state_at_load(low))]
    for word in words:
        within = path.dissipated[np.array(path.zones) == word]
        energy = 0.5 * float(within.min() + within.max())
        found.append(Stage(word, energy, state_at(plain, energy), state_at(sheared, energy)))
    return found


def state_at(theory: PullOut, energy: float) -> PullOutState:
    """Return the state in which so much has been dissipated [J]."""
    least = brentq(lambda s: theory.state(s).dissipated - energy, 0.0, theory.slip_end, xtol=1e-14)
    return theory.state(float(least))


def followed(test: PullOutTest, effort: Effort) -> Lattice:
    """Take a test along its path of equilibrium, with a stop at each stage."""
    built, stages = test.build(effort.engine, effort.threads), stages_of(test)
    all_of_it = test.theory().work_of_debonding
    even = np.linspace(0.0, 1.0, (QUICK_STEPS if effort.quick else STEPS) + 1)[1:-1] * all_of_it
    stops = np.unique([*even, *(s.energy for s in stages[1:]), all_of_it])
    path = dissipation_control(
        built.model, built.pulled, test.axis, energy=np.diff(stops, prepend=0.0), watch=built.joints,
        engine=effort.engine, threads=effort.threads, quiet=effort.quiet,
    )  # fmt: skip
    elastic = path.shear[1] * stages[0].plain.load / path.load[1]  # linear up to the first point
    return Lattice(test, built, path, [(stages[0], elastic), *((s, shear_at(path, s.energy)) for s in stages[1:])])


def shear_at(path: EquilibriumPath, energy: float) -> Floats:
    """Return the shear stress of the joints where so much has been dissipated [J]; raises InputError off the path."""
    k = int(np.argmin(np.abs(path.dissipated - energy)))
    if abs(path.dissipated[k] - energy) > 1e-3 * path.dissipated[-1]:
        raise InputError(f"the path of the lattice has no point where {energy:.6g} J are dissipated.")
    return path.shear[k]


def run_explicitly(each: Lattice, folder: Path, effort: Effort) -> PullOutResult:
    """Run the same model in explicit dynamics, into a result folder of its own."""
    inside = folder / f"explicit-d{each.test.diameter:g}"
    return run_pullout(each.built, effort.engine, effort.threads, inside, effort.quiet)


# What is shown --------------------------------------------------------------------------------------------------

STAGE_HEADS = ("d [m]", "zones", "dissipated", "load [kN]", "plain theory", "with shear", "mean of a height, plain",
               "with shear")  # fmt: skip
CONVERGENCE_HEADS = ("", "d [m]", "particles", "joints", "peak load", "shear stress, plain theory", "with shear",
                     "energy of debonding", "cost")  # fmt: skip
REMARKS = [
    "Clean case: fibre and matrix of 10 GPa, radii 1 m and 6 m, bonded over 30 m, nu = 0.1, bond 60 MPa/m up to 0.1 "
    "mm and gone at 0.4 mm: k c_sl = 0.02, so that the one-dimensional theory is nearly exact. Bonds follow from (E, "
    "nu) in closed form; each part is scaled by one static solve so that its axial stiffness is the nominal one. Free "
    "fibre 2 m, matrix held at its far face. The lattice is hexagonal close packing, its c axis along the pull, "
    "fitted to the length.",
    "Each stage is in the middle of the energy that its zones last for (SESD lasts for 0.02 % of it); lattice and "
    "theory are compared at the same dissipated energy, the elastic stage at the same load, half of that at which "
    "softening begins. Differences are the largest of all joints, with no averaging over the joints at one height.",
    "Energy of debonding: for the equilibrium path the work of the load along its points (cubics between them), for "
    "explicit dynamics what damage has dissipated in the energy book, both against p L G_f. Explicit runs follow a "
    "pulled end, which cannot turn back: their stages are six up to the turning point (see their own folders).",
    "Values of the public code: fibre 50 GPa, matrix 5 GPa, nu = 0.2, bond 1 GPa/m up to 0.1 mm and gone at 3 mm, "
    "free fibre 5.4 m; without its plug under the tip, and with bonds that resist bending, as its bonds do: at nu = "
    "0.2 they have no shear stiffness. k c_sl = 0.55 in an isotropic body and 0.83 with the shear modulus of this "
    "lattice: the bond is nearly as stiff as the shear of the parts around it, which the plain theory leaves out. "
    "Joints at one height scatter, because each is as stiff as the spheres that it holds are held; the means of a "
    "height (right) tell what theory can say. Its shear compliance mends the elastic stage; once a front softens it "
    "moves the front too far, and helps no more. No one-dimensional theory can be in good agreement with a "
    "three-dimensional model before all of the bond softens (S).",
]


def panel(each: Lattice) -> Panel:
    """Return the panel of a lattice: stress at the joints, and both theories."""
    x = np.linspace(0.0, each.test.length, 600)
    curves = {
        s.zones: (each.x, shear, s.plain.shear(x), s.sheared.shear(x)) for s, shear in each.stages
    }  # fmt: skip
    return Panel(f"d = {each.test.diameter:g} m", x, curves)


def errors(each: Lattice) -> list[tuple[Stage, Floats, Floats]]:
    """Return for each stage the differences at the joints from the plain theory and from that with shear [-]."""
    scale = each.test.theory().tau_max
    return [
        (s, (shear - s.plain.shear(each.x)) / scale, (shear - s.sheared.shear(each.x)) / scale)
        for s, shear in each.stages
    ]


def by_height(x: Floats, difference: Floats) -> Floats:
    """Return the mean of the differences at each height x."""
    _, level, count = np.unique(np.round(x, 6), return_inverse=True, return_counts=True)
    return np.bincount(level, difference) / count


def stage_rows(each: Lattice) -> list[list[Any]]:
    """Return the rows of the table of stages."""
    all_of_it = each.test.theory().work_of_debonding
    return [
        [f"{each.test.diameter:g}", s.zones, f"{100.0 * s.energy / all_of_it:.0f} %", f"{1e-3 * s.plain.load:.1f}",
         *(f"{largest(d):.2f} %" for d in (plain, sheared, by_height(each.x, plain), by_height(each.x, sheared)))]
        for s, plain, sheared in errors(each)
    ]  # fmt: skip


def largest(difference: Floats) -> float:
    """Return the largest difference in per cent."""
    return 100.0 * float(np.abs(difference).max())


def work_along(path: EquilibriumPath) -> float:
    """Return the work of the load along a path [J], between points by cubics in the dissipated energy."""
    u, load, spent = path.displacement[1:], path.load[1:], path.dissipated[1:]
    at = np.linspace(spent[0], spent[-1], 20_000)
    fine_u, fine_load = (PchipInterpolator(spent, values)(at) for values in (u, load))
    return float(0.5 * u[0] * load[0] + np.trapezoid(fine_load, fine_u))


def convergence_row(how: str, each: Lattice) -> list[Any]:
    """Return the row of a lattice in the table of convergence."""
    theory, path = each.test.theory(), each.path
    found = errors(each)
    work = work_along(path)
    return [
        how, f"{each.test.diameter:g}", len(each.built.model), len(each.built.joints.pairs),
        f"{100.0 * (path.load.max() / theory.peak().load - 1.0):+.2f} %",
        f"{max(largest(plain) for _, plain, _ in found):.2f} %", f"{max(largest(s) for _, _, s in found):.2f} %",
        f"{100.0 * (work / theory.work_of_debonding - 1.0):+.2f} %", f"{path.solves} solves, {path.seconds:.0f} s",
    ]  # fmt: skip


def explicit_row(each: Lattice, run: PullOutResult) -> list[Any]:
    """Return the row of an explicit run in the table of convergence."""
    found = run.summary["errors"]
    shear = max(p.error for p in run.profiles)
    return [
        EXPLICIT, f"{each.test.diameter:g}", len(each.built.model), len(each.built.joints.pairs),
        f"{100.0 * found['peak load']:+.2f} %", f"{100.0 * shear:.2f} %", "",
        f"{100.0 * found['energy of debonding']:+.3f} %", f"{run.steps} steps, {run.seconds:.0f} s",
    ]  # fmt: skip


def facts(each: Lattice) -> dict[str, Any]:
    """Return the numbers of a lattice for programs."""
    return {
        "diameter_m": each.test.diameter, "particles": len(each.built.model), "joints": len(each.built.joints.pairs),
        "displacement_m": each.path.displacement, "load_N": each.path.load, "dissipated_J": each.path.dissipated,
        "x_m": each.x, "stages": {s.zones: shear for s, shear in each.stages},
    }  # fmt: skip
