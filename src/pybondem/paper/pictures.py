"""Figure 2: fibre and matrix, cut open, coloured by part, by stress and by damage; and the same to turn in a browser.

A pull-out run is stopped where the interface is partly debonded. Pictures are cast ray by ray in NumPy, so nothing
but NumPy, SciPy and matplotlib is needed to make them.
"""

import time as clocks
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.damping import local
from pybondem.examples import pullout
from pybondem.examples.pullout_result import last_stable_displacement
from pybondem.examples.pullout_setup import LAYER, PullOutModel
from pybondem.measure import applied, displacement
from pybondem.output.colouring import Colouring, Parts, Scalar
from pybondem.output.figures import PALETTE
from pybondem.output.plate import Note, Panel, plate
from pybondem.output.render import Cut, View, render
from pybondem.output.sheet import Sheet, Table
from pybondem.output.viewer import CutStart, write_view
from pybondem.paper.effort import Effort
from pybondem.paper.particle_stress import particle_stress
from pybondem.simulation import Simulation
from pybondem.theory import PullOut

Floats = NDArray[np.float64]

REACH = 0.97  # of the displacement at the turning point: where the run stops, with elastic, soft and debonded zones
STAGES = 12
VIEW = View((0.45, -1.0, 0.38))
COLOURS = {"fibre": PALETTE[4], "matrix": PALETTE[2]}  # orange and green, as in the paper
PLACES = (0.25, 0.5, 0.75, 1.0)  # along the embedded length, where the force in the fibre is compared
ARROW = 4.5  # m


class Stage(NamedTuple):
    """A moment of the run: displacement [m] and load [N] of the pulled end, axial stress of every particle (n,) [Pa],
    damage of every joint (m,)."""

    displacement: float
    load: float
    stress: Floats
    damage: Floats


@dataclass(frozen=True)
class Paused:
    """The model at its stages, centres (n, 3) [m] at the last, and what it took: seconds by what was done."""

    built: PullOutModel
    x: Floats
    stages: tuple[Stage, ...]
    seconds: dict[str, float]

    @property
    def last(self) -> Stage:
        """The stage that the pictures show."""
        return self.stages[-1]


def figure(folder: Path, effort: Effort) -> Sheet:
    """Run the pull-out up to a partly debonded interface, draw it, and hold load, damage and force against theory."""
    sheet = Sheet("fig2", "Figure 2: fibre and matrix", folder)
    paused = run(effort)
    coloured = fields(paused)
    began = clocks.perf_counter()
    panels = draw(paused, coloured, width=900 if effort.quick else 1900)
    paused.seconds["four pictures"] = clocks.perf_counter() - began
    began = clocks.perf_counter()
    sheet.pictures[caption(paused)] = plate(folder / "fig2.png", panels)
    for panel in panels:
        plate(folder / f"fig2-{panel.title.split(',')[0].replace(' ', '-')}.png", [panel])
    paused.seconds["plates of them"] = clocks.perf_counter() - began
    began = clocks.perf_counter()
    view = browse(folder / "fig2-view.html", paused, coloured)
    paused.seconds["view for the browser"] = clocks.perf_counter() - began
    sheet.tables += tables(paused)
    sheet.remarks += [
        f"To turn, cut and probe in a browser, without a network: [{view.name}]({view.name}), "
        f"{view.stat().st_size / 1e6:.2f} MB.",
        "Stress is the mean over a particle of the forces in its bonds (Love-Weber), over the volume that a particle "
        "has inside: those at the rim of the fibre have fewer bonds, and so less. Damage is the mean over the joints "
        "of a particle; particles without joints are grey. Pictures are cast ray by ray, without a graphics card, a "
        "display or OpenGL.",
    ]
    sheet.facts |= facts(paused)
    return sheet


def run(effort: Effort) -> Paused:
    """Return the pull-out test at stages up to where its interface is partly debonded."""
    began = clocks.perf_counter()
    whole = pullout(diameter=1.0, transits=12.0) if effort.quick else pullout(diameter=0.5)
    end = REACH * last_stable_displacement(whole.theory())
    test = pullout(diameter=whole.diameter, transits=whole.transits * end / whole.end, pull=end)  # at the same speed
    built = test.build(effort.engine, effort.threads)
    sim = Simulation(built.model, engine=effort.engine, threads=effort.threads, safety=0.5, damping=local(test.damping))
    seconds = {"model, time step, compiling": clocks.perf_counter() - began}
    began = clocks.perf_counter()
    steps = STAGES * max(1, round(test.duration / sim.dt / STAGES))
    record = sim.record(steps // STAGES, load=applied(built.pulled, "x"), displacement=displacement(built.pulled, "x"))
    stages: list[Stage] = []
    sim.observe(lambda s: stages.append(look(s, built, record["displacement"].last, record["load"].last)))
    sim.run(steps=steps, title="pull-out", quiet=effort.quiet)
    seconds[f"run, {sim.step} steps"] = clocks.perf_counter() - began
    return Paused(built, sim.particles.x, tuple(stages), seconds)


def look(sim: Simulation, built: PullOutModel, end: float, load: float) -> Stage:
    """Return the stage that a simulation is at."""
    sets = [sim.bonds(bonds) for bonds in built.model.bonds]
    pairs = np.concatenate([bonds.pairs for bonds in built.model.bonds])
    forces = np.concatenate([seen.force for seen in sets])
    volume = built.test.fitted_diameter**3 / np.sqrt(2.0)  # of a close packing, per particle
    stress = particle_stress(sim.particles.x, pairs, forces, volume)[:, 0, 0]
    return Stage(float(end), float(load), stress, sim.bonds(built.joints).damage)


def fields(paused: Paused) -> dict[str, Colouring]:
    """Return what the particles show, by name: part, stress and damage, the last two at every stage."""
    model, stages = paused.built.model, paused.stages
    stress = np.array([stage.stress for stage in stages])
    damage = np.array([damage_of_particles(paused.built, stage.damage) for stage in stages])
    ends = np.percentile(stress[-1], (0.05, 99.95))  # a particle at an edge does not set the scale
    jointed = np.zeros(len(model), np.bool_)
    jointed[paused.built.surface.pairs] = True
    return {
        "part": Parts(model.part_of, {name: COLOURS[name] for name in model.parts}),
        "axial stress": Scalar(stress, "Pa", low=min(0.0, float(ends[0])), high=float(ends[1]), colours="viridis"),
        "damage of the interface": Scalar(damage, low=0.0, high=1.0, colours="plasma", shown=jointed),
    }


def damage_of_particles(built: PullOutModel, damage: Floats) -> Floats:
    """Return the mean damage of each particle's joints (n,); 0 where it has none; damage (m,): of the joints."""
    ends = built.surface.pairs.T.ravel()
    count = np.bincount(ends, minlength=len(built.model))
    return np.bincount(ends, np.tile(damage, 2), minlength=len(built.model)) / np.maximum(count, 1)


def draw(paused: Paused, coloured: dict[str, Colouring], width: int) -> list[Panel]:
    """Return the four pictures."""
    model, test = paused.built.model, paused.built.test
    part, stress, damage = coloured
    matrix = model.part_of == model.parts.index("matrix")
    half = Cut((0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
    half_matrix = Cut(half.point, half.normal, of=matrix)
    tip = test.length + test.fitted_free_length
    notes = (Note("pulled", (tip + 0.5, 0.0, 0.0), (tip + 0.5 + ARROW, 0.0, 0.0)),)
    last = 1e3 * paused.last.displacement
    asked = [
        ("fibre and matrix", part, None),
        ("cut open", part, half_matrix),
        (f"stress, u = {last:.2f} mm", stress, half),
        (f"damage, u = {last:.2f} mm", damage, half_matrix),
    ]
    return [
        Panel(render(paused.x, model.radius, coloured[name], view=VIEW, cut=cut, width=width), coloured[name], name,
              title, notes)
        for title, name, cut in asked
    ]  # fmt: skip


def caption(paused: Paused) -> str:
    """Return what the picture shows, in words."""
    test = paused.built.test
    return (
        f"{len(paused.built.model)} particles of {test.fitted_diameter:.3g} m: fibre and matrix (a), cut open (b), "
        f"axial stress (c) and damage of the interface (d), the fibre end pulled by "
        f"{1e3 * paused.last.displacement:.2f} mm. The matrix is held at its far face."
    )


def browse(path: Path, paused: Paused, coloured: dict[str, Colouring]) -> Path:
    """Write the view for a browser, with all stages."""
    model = paused.built.model
    return write_view(
        path, paused.x, model.radius, coloured, view=VIEW, cut=CutStart("y", 0.5, ("fibre",)), start="axial stress",
        frames=[f"fibre end pulled by {1e3 * stage.displacement:.3f} mm" for stage in paused.stages],
        title=f"Pull-out of a fibre, particles of {paused.built.test.fitted_diameter:.3g} m",
    )  # fmt: skip


# Against theory -------------------------------------------------------------------------------------------------


def tables(paused: Paused) -> list[Table]:
    """Return the stages and the force in the fibre beside theory, and what it took."""
    theory, last = paused.built.test.theory(), paused.last
    peak, stages = theory.peak().load, []
    for stage in paused.stages:
        state = theory.state_at_displacement(stage.displacement)
        stages.append(
            [f"{1e3 * stage.displacement:.3f}", state.zones, f"{1e-3 * stage.load:.1f}", f"{1e-3 * state.load:.1f}",
             f"{100.0 * (stage.load - state.load) / peak:+.2f} %", f"{mean_damage(paused.built, stage):.3f}",
             f"{exact_damage(theory, stage.displacement):.3f}"]
        )  # fmt: skip
    inside = [
        [
            f"{place * paused.built.test.length:.1f}",
            f"{1e-3 * seen:.1f}",
            f"{1e-3 * exact:.1f}",
            f"{100.0 * (seen - exact) / last.load:+.2f} %",
        ]
        for place, seen, exact in zip(PLACES, *forces_in_fibre(paused), strict=True)
    ]
    return [
        Table("Stages of the run", ["u [mm]", "zones", "load [kN]", "theory [kN]", "error, of the peak", "mean damage",
                                    "theory"], stages),
        Table(f"Axial force in the fibre at u = {1e3 * last.displacement:.3f} mm",
              ["x [m]", "from the stresses [kN]", "theory [kN]", "error, of the load"], inside),
        Table("Wall time", ["what", "seconds"], [[what, f"{s:.1f}"] for what, s in paused.seconds.items()]),
    ]  # fmt: skip


def facts(paused: Paused) -> dict[str, object]:
    """Return the numbers of the figure, SI units."""
    seen, exact = forces_in_fibre(paused)
    last, theory = paused.last, paused.built.test.theory()
    return {
        "particles": len(paused.built.model),
        "seconds": paused.seconds,
        "displacement": [stage.displacement for stage in paused.stages],
        "load": [stage.load for stage in paused.stages],
        "load of theory": [theory.state_at_displacement(stage.displacement).load for stage in paused.stages],
        "mean damage": mean_damage(paused.built, last),
        "mean damage of theory": exact_damage(theory, last.displacement),
        "place in the fibre": [place * paused.built.test.length for place in PLACES],
        "force in the fibre": seen,
        "force in the fibre of theory": exact,
    }


def forces_in_fibre(paused: Paused) -> tuple[list[float], list[float]]:
    """Return the axial force in the fibre at PLACES [N], from the stresses of its particles and by theory.

    Stress times volume, summed over a slab across the fibre, is force times thickness; slabs of four layers.
    """
    model, test, last = paused.built.model, paused.built.test, paused.last
    fibre = model.part_of == model.parts.index("fibre")
    volume, layer = test.fitted_diameter**3 / np.sqrt(2.0), LAYER * test.fitted_diameter
    number = np.rint(model.x[fibre, 0] / layer).astype(np.int64)
    force = np.bincount(number, last.stress[fibre] * volume) / layer  # by layer
    state = test.theory().state_at_displacement(last.displacement)
    seen, exact = [], []
    for place in PLACES:
        first = round(place * test.layers) - 2
        at = layer * np.arange(first, first + 4)
        seen.append(float(force[first : first + 4].mean()))
        exact.append(float(state.fibre_force(np.minimum(at, test.length)).mean()))
    return seen, exact


def mean_damage(built: PullOutModel, stage: Stage) -> float:
    """Return the damage of the joints, weighted by the area that each stands for."""
    return float(np.average(stage.damage, weights=built.surface.area))


def exact_damage(theory: PullOut, end: float) -> float:
    """Return the mean damage of the interface by theory, at a displacement of the end [m] on the way up."""
    state, x = theory.state_at_displacement(end), np.linspace(0.0, theory.length, 2001)
    slip = np.maximum(state.slip(x), 1e-300)
    return float(np.mean(1.0 - state.shear(x) / (theory.stiffness * slip)))
