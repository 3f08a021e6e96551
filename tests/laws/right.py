"""Right laws of every kind, which `check` must not accuse."""

from laws.planted import END, PEAK, elastic_energy, softened, with_normal, with_shear

from pybondem import laws, scatter
from pybondem.laws.law import bond_law, damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import exp, maximum, minimum, sqrt, where
from pybondem.physics.types import Damage, Loads


@damage_law(parameters={"rate": Parameter("1/m", "growth of damage with opening", above=0.0)}, memory={"longest": "m"})
def tiring(d, m, p):
    """Stiffness that decays with the largest opening so far."""
    longest = maximum(m.longest, d.opening)
    return 1.0 - exp(-p.rate * longest), longest


@damage_law(parameters={"peak": "m", "end": "m"}, memory={"opening": "m", "slip": "m"})
def each_mode(d, m, p):
    """A damage of its own for each mode."""
    opening, slip = maximum(m.opening, d.opening), maximum(m.slip, d.slip)
    return Damage(softened(opening, p), softened(slip, p), 0.5 * softened(slip, p), 0.0 * slip), opening, slip


@damage_law(parameters={"peak": "m", "end": "m"}, memory={"largest": "m"})
def by_cases(d, m, p):
    """Bilinear softening with Python's own if."""
    largest = m.largest
    if d.slip > largest:
        largest = d.slip
    if largest <= p.peak:
        return 0.0, largest
    if largest >= p.end:
        return 1.0, largest
    return p.end * (largest - p.peak) / (largest * (p.end - p.peak)), largest


@bond_law(parameters={"viscosity": "N s/m"}, potential=lambda d, k: elastic_energy(d, k))
def viscous_slip(d, k, p, rate):
    """Kelvin and Voigt in slip."""
    return with_shear(d, k, k.ks * d.s + p.viscosity * rate.s, k.ks * d.t + p.viscosity * rate.t)


def stiffening_energy(d, k, p):
    return elastic_energy(d, k) + 0.25 * k.kn * (d.n * d.n) * (d.n * d.n) / (p.size * p.size)


@bond_law(parameters={"size": "m"}, potential=stiffening_energy)
def stiffening(d, k, p):
    """Non-linear elastic opening."""
    return with_normal(d, k, k.kn * d.n * (1.0 + d.n * d.n / (p.size * p.size)))


@bond_law(parameters={"peak": "m", "end": "m"}, memory={"largest": "m", "damage": "1"}, potential=lambda d, k, m: (
    elastic_energy(d, k) - 0.5 * m.damage * k.ks * (d.s * d.s + d.t * d.t)))  # fmt: skip
def bilinear_loads(d, k, m, p):
    """Bilinear softening of the slip as a bond law."""
    largest = maximum(m.largest, sqrt(d.s * d.s + d.t * d.t))
    damage = softened(largest, p)
    whole = 1.0 - damage
    return with_shear(d, k, whole * k.ks * d.s, whole * k.ks * d.t), largest, damage


@damage_law(parameters={"largest": "m"}, memory={"largest": "1"})
def one_name_twice(d, m, p):
    """A parameter and a word of memory of one name, in different units."""
    largest = maximum(m.largest, d.opening / p.largest)
    return 1.0 - exp(-largest), largest


@bond_law(parameters={"E": "Pa"})
def own_modulus(d, p):
    """Elastic, by a modulus of its own, without a potential."""
    axial = p.E * d.area / d.length
    turning = 0.1 * axial * d.area
    return Loads(axial * d.n, 0.4 * axial * d.s, 0.4 * axial * d.t,
                 turning * d.twist, turning * d.bend_s, turning * d.bend_t)  # fmt: skip


@bond_law(parameters={"peak": "m", "end": "m"}, memory={"largest": "m", "damage": "1"})
def softening_loads(d, k, m, p):
    """Bilinear softening of the slip as a bond law, without a potential."""
    largest = maximum(m.largest, sqrt(d.s * d.s + d.t * d.t))
    damage = softened(largest, p)
    return with_shear(d, k, (1.0 - damage) * k.ks * d.s, (1.0 - damage) * k.ks * d.t), largest, damage


@bond_law(parameters={"viscosity": "N s/m"})
def kelvin_voigt(d, k, p, rate):
    """Kelvin and Voigt in slip, without a potential."""
    return with_shear(d, k, k.ks * d.s + p.viscosity * rate.s, k.ks * d.t + p.viscosity * rate.t)


@bond_law(parameters={"friction": "1"}, memory={"slip_s": "m", "slip_t": "m"})
def coulomb(d, k, m, p):
    """Friction without cohesion."""
    n = minimum(k.kn * d.n, 0.0)
    s, t = k.ks * (d.s - m.slip_s), k.ks * (d.t - m.slip_t)
    size = sqrt(s * s + t * t)
    share = where(size > -p.friction * n, -p.friction * n / maximum(size, 1e-300), 1.0)
    s, t = share * s, share * t
    return Loads(n, s, t, 0.0 * n, 0.0 * n, 0.0 * n), d.s - s / k.ks, d.t - t / k.ks


def maxwell_energy(d, k, m):
    n, s, t = d.n - m.n, d.s - m.s, d.t - m.t
    rotation = k.kt * d.twist * d.twist + k.kb * (d.bend_s * d.bend_s + d.bend_t * d.bend_t)
    return 0.5 * (k.kn * n * n + k.ks * (s * s + t * t) + rotation)


def with_forces(d, k, n, s, t):
    """Return springs of elastic elongation and slip n, s, t, and elastic moments."""
    return Loads(k.kn * n, k.ks * s, k.ks * t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t)


@bond_law(parameters={"time": "s"}, memory={"n": "m", "s": "m", "t": "m"}, potential=maxwell_energy)
def maxwell(d, k, m, p, dt):
    """Maxwell, integrated backwards."""
    share = dt / (p.time + dt)
    n, s, t = m.n + share * (d.n - m.n), m.s + share * (d.s - m.s), m.t + share * (d.t - m.t)
    return with_forces(d, k, d.n - n, d.s - s, d.t - t), n, s, t


@bond_law(parameters={"time": "s"}, memory={"n": "m", "s": "m", "t": "m"}, potential=maxwell_energy)
def maxwell_forwards(d, k, m, p, dt):
    """Maxwell, integrated forwards."""
    share = dt / p.time
    n, s, t = m.n + share * (d.n - m.n), m.s + share * (d.s - m.s), m.t + share * (d.t - m.t)
    return with_forces(d, k, d.n - n, d.s - s, d.t - t), n, s, t


@damage_law(parameters={"cycles": "1", "size": "m"}, memory={"last": "m", "D": "1"})
def fatigue(d, m, p):
    """Damage that grows in every loading."""
    damage = minimum(1.0, m.D + maximum(0.0, d.slip - m.last) / (p.size * p.cycles))
    return damage, d.slip, damage


@damage_law(parameters={"T": "K", "T0": "K", "size": "m"}, memory={"largest": "m"})
def arrhenius(d, m, p):
    """Damage that grows faster when it is hot."""
    largest = maximum(m.largest, d.opening)
    return 1.0 - exp(-largest / p.size * exp(-p.T / p.T0)), largest


@damage_law(parameters={"rate": "1/s", "beyond": "m"}, memory={"D": "1"})
def creep(d, m, p, dt):
    """Damage that grows in time, beyond an opening."""
    damage = minimum(1.0, m.D + p.rate * dt * where(d.opening > p.beyond, 1.0, 0.0))
    return damage, damage


@damage_law(parameters={"dose": "m s"}, memory={"dose": "m s", "broken": "1"})
def breaks_after_a_while(d, m, p, dt):
    """Brittle, once slip has lasted."""
    dose = m.dose + dt * d.slip
    broken = where(dose > p.dose, 1.0, m.broken)
    return broken, dose, broken


@damage_law(parameters={"time": "s"}, memory={"age": "s"})
def ageing(d, m, p, dt):
    """Damage by time alone."""
    age = m.age + dt
    return 1.0 - exp(-age / p.time), age


@bond_law(parameters={"T": "K", "T0": "K", "expansion": "1/K"}, potential=lambda d, k, p: elastic_energy(
    d._replace(n=d.n - p.expansion * p.T * d.length * exp(-p.T0 / p.T)), k))  # fmt: skip
def expands(d, k, p):
    """Expands with its temperature, by which it is divided."""
    return with_normal(d, k, k.kn * (d.n - p.expansion * p.T * d.length * exp(-p.T0 / p.T)))


RIGHT = {
    "one name twice": one_name_twice(PEAK),
    "own modulus": own_modulus(1e9),
    "softening loads": softening_loads(PEAK, END),
    "Kelvin and Voigt": kelvin_voigt(1e3),
    "Coulomb": coulomb(0.5),
    "Maxwell": maxwell(0.01),
    "slow Maxwell": maxwell(10.0),
    "Maxwell forwards": maxwell_forwards(1e-3),
    "fatigue": fatigue(50.0, PEAK),
    "Arrhenius": arrhenius(300.0, 300.0, PEAK),
    "creep": creep(1.0, PEAK),
    "dose": breaks_after_a_while(PEAK),
    "ageing": ageing(10.0),
    "tiring": tiring(50.0),
    "each_mode": each_mode(PEAK, END),
    "by_cases": by_cases(PEAK, END),
    "viscous_slip": viscous_slip(1e3),
    "stiffening": stiffening(1e-4),
    "bilinear_loads": bilinear_loads(PEAK, END),
    "tiny": laws.bilinear(1e-9, 4e-9),
    "huge": laws.bilinear(0.1, 0.4),
    "soft joint": laws.bilinear(1e-4, 4e-4, stiffness=6e7),
    "many values": laws.strength(tension=[4e6, 5e6, 6e6], shear=scatter.weibull(scale=1e7, modulus=8.0, seed=1)),
}
