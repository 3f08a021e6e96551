"""Bond laws, each with one mistake: what `check` must find, and by which finding."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pybondem.bond_answers import BOND, Element
from pybondem.bonds import ValuedLaw
from pybondem.laws.law import bond_law, damage_law
from pybondem.laws.parameters import Parameter
from pybondem.laws.trial import SHEAR
from pybondem.ops import absolute, add, cross, dot, exp, maximum, minimum, minus, norm, sqrt, times, where
from pybondem.physics import frame
from pybondem.physics.types import Frame, Load, Loads

PEAK, END = 1e-5, 4e-5  # [m]
SLIPS = {"peak": "m", "end": "m"}


class Planted(NamedTuple):
    """A law with a mistake, the finding that must name it, and words that its sentence and deformation must hold."""

    law: ValuedLaw
    finding: str
    said: str
    at: str


def softened(x: Any, p: Any) -> Any:
    """Return the damage of bilinear softening at the largest deformation x so far."""
    kappa = maximum(x, p.peak)
    return minimum(1.0, p.end * (kappa - p.peak) / (kappa * (p.end - p.peak)))


def elastic(d: Any, k: Any) -> Loads:
    """Return the loads of an elastic bond."""
    return with_shear(d, k, k.ks * d.s, k.ks * d.t)


def with_shear(d: Any, k: Any, s: Any, t: Any) -> Loads:
    """Return the loads of a bond that is elastic but for its shear forces s, t [N]."""
    return Loads(k.kn * d.n, s, t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t)


def with_normal(d: Any, k: Any, n: Any) -> Loads:
    """Return the loads of a bond that is elastic but for its normal force n [N]."""
    return Loads(n, k.ks * d.s, k.ks * d.t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t)


def elastic_energy(d: Any, k: Any) -> Any:
    """Return the energy of an elastic bond [J]."""
    rotation = k.kt * d.twist * d.twist + k.kb * (d.bend_s * d.bend_s + d.bend_t * d.bend_t)
    return 0.5 * (k.kn * d.n * d.n + k.ks * (d.s * d.s + d.t * d.t) + rotation)


# Damage laws ----------------------------------------------------------------------------------------------------


@damage_law(parameters=SLIPS)
def heals(d: Any, p: Any) -> Any:
    """Forgets the largest slip."""
    return softened(d.slip, p)


@damage_law(parameters=SLIPS, memory={"largest": "m"})
def above_one(d: Any, m: Any, p: Any) -> Any:
    """Goes on growing after failure."""
    largest = maximum(m.largest, d.slip)
    return largest / p.end, largest


@damage_law(parameters=SLIPS, memory={"largest": "m"})
def root_of_opening(d: Any, m: Any, p: Any) -> Any:
    """Takes a root that there is not in compression."""
    largest = maximum(m.largest, sqrt(d.opening * p.end))
    return softened(largest, p), largest


@damage_law(parameters=SLIPS, memory={"largest": "m"})
def nothing_over_nothing(d: Any, m: Any, p: Any) -> Any:
    """Divides by a slip that is exactly zero at first."""
    largest = maximum(m.largest, d.slip * (d.slip / d.slip))
    return softened(largest, p), largest


@damage_law(parameters=SLIPS, memory={"largest": "m", "worst": "1"})
def unloads_elastically(d: Any, m: Any, p: Any) -> Any:
    """Unloads along the elastic slope, as plasticity does, by damage that grows on the way back."""
    largest = maximum(m.largest, d.slip)
    force = (1.0 - softened(largest, p)) * largest - (largest - d.slip)
    share = maximum(0.0, force) / maximum(d.slip, 1e-3 * p.peak)
    worst = maximum(m.worst, maximum(softened(largest, p), where(largest > p.peak, 1.0 - share, 0.0)))
    return worst, largest, worst


@damage_law(parameters=SLIPS, memory={"largest": "m"}, toughness={"slip": lambda p, k: 1.05 * 0.5 * k * p.peak * p.end})
def promises_more(d: Any, m: Any, p: Any) -> Any:
    """Declares a fracture energy that is 5 % too large."""
    largest = maximum(m.largest, d.slip)
    return softened(largest, p), largest


@damage_law(parameters=SLIPS, toughness={"opening": lambda p, k: 0.5 * k * p.peak * p.end}, memory={"largest": "m"})
def promises_another_mode(d: Any, m: Any, p: Any) -> Any:
    """Declares a fracture energy in opening, but fails in slip."""
    largest = maximum(m.largest, d.slip)
    return softened(largest, p), largest


@damage_law(parameters={"peak": "Pa", "end": "m"}, memory={"largest": "m"})
def length_called_stress(d: Any, m: Any, p: Any) -> Any:
    """Declares a length in Pa."""
    largest = maximum(m.largest, d.slip)
    return softened(largest, p), largest


@damage_law(parameters={"rate": Parameter("m", typical=1e4)}, memory={"largest": "m"})
def upside_down(d: Any, m: Any, p: Any) -> Any:
    """Declares 1/m as m."""
    largest = maximum(m.largest, d.slip)
    return 1.0 - 1.0 / (1.0 + p.rate * largest), largest


@damage_law(parameters=SLIPS, memory={"largest": "Pa"})
def memory_in_pascal(d: Any, m: Any, p: Any) -> Any:
    """Keeps a length that it declares in Pa."""
    largest = maximum(m.largest, d.slip)
    return softened(largest, p), largest


@damage_law(memory={"largest": "m"})
def number_with_unit(d: Any, m: Any) -> Any:
    """Holds a length as a bare number."""
    largest = maximum(m.largest, d.slip)
    return minimum(1.0, largest / 4e-5), largest


@damage_law(parameters=SLIPS, memory={"largest": "m"})
def needs_python(d: Any, m: Any, p: Any) -> Any:
    """Cannot be compiled."""
    largest = {"so far": maximum(m.largest, d.slip)}
    return softened(largest["so far"], p), float(f"{largest['so far']!s}")


@damage_law(parameters={"C": "s/m"}, memory={"D": "1"})
def forgets_dt(d: Any, m: Any, p: Any, rate: Any) -> Any:
    """Grows by a rate in every step, however long it is."""
    D = minimum(1.0, m.D + p.C * maximum(rate.opening, 0.0))
    return D, D


@damage_law(parameters={"each": "1", "beyond": "1"}, memory={"D": "1"})
def counts_steps(d: Any, m: Any, p: Any) -> Any:
    """Grows in every evaluation."""
    D = minimum(1.0, m.D + where(d.slip > p.beyond * d.length, p.each, 0.0))
    return D, D


@bond_law(parameters={"c": "N s/m"}, memory={"n": "N"})
def sums_rates(d: Any, k: Any, m: Any, p: Any, rate: Any) -> Any:
    """Sums a rate in a load, not its increments."""
    n = m.n + p.c * rate.n
    return with_normal(d, k, n), n


@damage_law(parameters={"speed": "m/s"}, memory={"last": "m", "D": "1"})
def divides_by_dt(d: Any, m: Any, p: Any, dt: Any) -> Any:
    """Makes a speed of its own, with dt = 0 too."""
    speed = maximum((d.opening - m.last) / dt, 0.0)
    D = maximum(m.D, 1.0 - exp(-speed / p.speed))
    return D, d.opening, D


@damage_law(parameters={"end": "m"}, memory={"largest": "m"})
def crushed(d: Any, m: Any, p: Any) -> Any:
    """Has the opening with the wrong sign."""
    largest = maximum(m.largest, -d.opening)
    return minimum(1.0, largest / p.end), largest


@damage_law(parameters={"end": "m"}, memory={"largest": "m"})
def either_way(d: Any, m: Any, p: Any) -> Any:
    """Is damaged by opening and by closure."""
    largest = maximum(m.largest, absolute(d.opening))
    return minimum(1.0, largest / p.end), largest


@damage_law(parameters={"end": "m"}, memory={"largest": "m"})
def born_damaged(d: Any, m: Any, p: Any) -> Any:
    """Begins with damage."""
    largest = maximum(m.largest, d.opening)
    return minimum(1.0, 0.3 + largest / p.end), largest


# Bond laws ------------------------------------------------------------------------------------------------------


@bond_law
def pulls_when_pressed(d: Any, k: Any) -> Loads:
    """Has a normal force without sign."""
    return with_normal(d, k, k.kn * where(d.n < 0.0, -d.n, d.n))


@bond_law
def pushes_when_opened(d: Any, k: Any) -> Loads:
    """Pushes beyond some opening."""
    return with_normal(d, k, k.kn * d.n * (1.0 - d.n / (0.002 * d.length)))


@bond_law(parameters=SLIPS, memory={"largest": "m", "damage": "1"}, potential=lambda d, k, m: 0.5 * (1.0 - m.damage) * (
    k.kn * d.n * d.n + k.ks * (d.s * d.s + d.t * d.t)))  # fmt: skip
def weak_when_closed(d: Any, k: Any, m: Any, p: Any) -> Any:
    """Lets damage act in compression."""
    largest = maximum(m.largest, d.n)
    damage = softened(largest, p)
    whole = 1.0 - damage
    return (
        Loads(whole * k.kn * d.n, whole * k.ks * d.s, whole * k.ks * d.t, 0.0 * d.n, 0.0 * d.n, 0.0 * d.n),
        largest,
        damage,
    )


@bond_law
def prefers_s(d: Any, k: Any) -> Loads:
    """Is softer along t than along s."""
    return with_shear(d, k, k.ks * d.s, 0.5 * k.ks * d.t)


@bond_law
def turns_the_force(d: Any, k: Any) -> Loads:
    """Answers slip with a force beside it: work from closed paths."""
    return with_shear(d, k, k.ks * (d.s + 0.3 * d.t), k.ks * (d.t - 0.3 * d.s))


@bond_law(parameters={"stiffer": "1"}, memory={"largest": "m"}, potential=lambda d, k: elastic_energy(d, k))
def stiffens_on_the_way_back(d: Any, k: Any, m: Any, p: Any) -> Any:
    """Gives back more than was put in."""
    slip = sqrt(d.s * d.s + d.t * d.t)
    largest = maximum(m.largest, slip)
    k_now = k.ks * where(slip < largest, p.stiffer, 1.0)
    return with_shear(d, k, k_now * d.s, k_now * d.t), largest


@bond_law(potential=lambda d, k: 1.02 * elastic_energy(d, k))
def other_potential(d: Any, k: Any) -> Loads:
    """Declares a potential that is 2 % too large."""
    return elastic(d, k)


@bond_law(parameters={"gap": "m"})
def loaded_at_rest(d: Any, k: Any, p: Any) -> Loads:
    """Is stretched when it is made."""
    return with_normal(d, k, k.kn * (d.n - p.gap))


@bond_law(memory={"s": "N", "t": "N"}, potential=lambda d, k, m: elastic_energy(d, k))
def sums_increments(d: Any, k: Any, m: Any, rate: Any, dt: Any) -> Any:
    """Sums increments of the shear force: right in axes that turn with the bond, wrong in any others."""
    s, t = m.s + k.ks * rate.s * dt, m.t + k.ks * rate.t * dt
    return with_shear(d, k, s, t), s, t


PLANTED = {
    "damage heals": Planted(heals(PEAK, END), "damage", "heals", "slip"),
    "damage above 1": Planted(above_one(PEAK, END), "damage", "from 0 to 1", "slip"),
    "root in compression": Planted(root_of_opening(PEAK, END), "finite", "not finite", "closure"),
    "0/0 at no slip": Planted(nothing_over_nothing(PEAK, END), "finite", "not finite", ""),
    "elastic unloading": Planted(unloads_elastically(PEAK, END), "unloading", "secant", "slip"),
    "5 % too tough": Planted(promises_more(PEAK, END), "toughness", "the law declares", "slip"),
    "tough in another mode": Planted(promises_another_mode(PEAK, END), "toughness", "does not fail", "opening"),
    "length in Pa": Planted(length_called_stress(PEAK, END), "units", "peak is declared in Pa, but the law uses "
                            "it as if it were in m.", "slip"),
    "1/m in m": Planted(upside_down(1e4), "units", "rate is declared in m, but the law uses it as if it were in 1/m.",
                        "slip"),
    "memory in Pa": Planted(memory_in_pascal(PEAK, END), "units", "largest is declared in Pa, but what the "
                           "law keeps in it is in m.", "slip"),
    "number with a unit": Planted(number_with_unit(), "units", "number written in the law", "slip"),
    "not to be compiled": Planted(needs_python(PEAK, END), "engines", "'cpu': needs_python cannot be compiled", ""),
    "pulls when pressed": Planted(pulls_when_pressed(), "closure", "pressed together does not push", "closure"),
    "pushes when opened": Planted(pushes_when_opened(), "closure", "opened pushes", "opening"),
    "weak when closed": Planted(weak_when_closed(PEAK, END), "closure", "pushes back with only", "closure"),
    "prefers s": Planted(prefers_s(), "frame", "not isotropic", "slip"),
    "work from slip": Planted(turns_the_force(), "dissipation", "creates energy", "slip"),
    "stiff on the way back": Planted(stiffens_on_the_way_back(1.2), "dissipation", "creates energy", "slip"),
    "potential too large": Planted(other_potential(), "potential", "slope of the declared potential", "bond"),
    "rate without dt": Planted(forgets_dt(1.0), "time step", "by its rate times dt", "opening"),
    "fast rate without dt": Planted(forgets_dt(1e6), "time step", "by its rate times dt", "opening"),
    "load without dt": Planted(sums_rates(1e3), "time step", "by its rate times dt", "opening"),
    "steps counted": Planted(counts_steps(0.01, 1e-6), "time step", "nothing may count evaluations", "slip"),
    "many steps counted": Planted(counts_steps(1e-6, 1e-6), "time step", "Evaluated again", "slip"),
    "divided by dt": Planted(divides_by_dt(1e-3), "finite", "for dt = 0", "no deformation"),
    "crushed": Planted(crushed(PEAK), "closure", "only pressed together is damaged", "closure"),
    "damaged either way": Planted(either_way(PEAK), "closure", "only pressed together is damaged", "closure"),
    "born damaged": Planted(born_damaged(PEAK), "rest", "undeformed new bond is damaged", "no deformation"),
    "load at rest": Planted(loaded_at_rest(1e-6), "rest", "undeformed bond carries a load", "no deformation"),
}  # fmt: skip


# Elements and sums that no law alone could break -------------------------------------------------------------------


def axes_that_stay(rel: Any, ref: Any) -> Frame:
    """Return axes of a bond that do not turn with the material."""
    n0 = frame.reference_direction(ref)
    s0, t0 = frame.across(rel.n)
    return Frame(rel.n, s0, t0, frame.material(rel, n0), s0, t0)


def load_seen_from_i(rel: Any, ref: Any, k: Any) -> Load:
    """Return the load of a bond whose slip is measured at its first end, not in its middle."""
    e = frame.material(rel, ref.r0)
    e_i = minus(e, cross(rel.s, e))
    slip = minus(times(dot(e_i, rel.n), rel.n), e_i)
    return Load(add(times(k.kn * (rel.length - norm(ref.r0)), rel.n), times(k.ks, slip)), (0.0, 0.0, 0.0))


def load_weak_when_closed(rel: Any, ref: Any, k: Any) -> Load:
    """Return the load of a bond whose normal stiffness goes with its shear stiffness, closed or not."""
    return frame.load(rel, ref, k._replace(kn=minimum(k.kn, k.ks / SHEAR)))


STAYING_AXES: Element = BOND._replace(axes=axes_that_stay)
SEEN_FROM_I: Element = BOND._replace(load=load_seen_from_i)
WEAK_WHEN_CLOSED: Element = BOND._replace(load=load_weak_when_closed)


def short_of_force(gather: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return the gather of an engine that loses some of the forces on second ends."""

    def losing(runner: Any) -> None:
        gather(runner)
        runner._program.particles["force"][0, ::2] *= 0.999

    return losing


def short_of_torque(gather: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return the gather of an engine that loses some of the torques."""

    def losing(runner: Any) -> None:
        gather(runner)
        runner._program.particles["torque"] *= np.float64(0.99)

    return losing
