"""The damage laws of the library against tractions, energies and strengths written down apart from them."""

import ast
from collections.abc import Callable
from itertools import pairwise
from math import cos, exp, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws.driven import DAMAGE_LAWS, KN, KS, LAWS, LENGTH, damages, deformation
from scipy.integrate import quad

from pybondem import laws as library
from pybondem.bonds import ValuedLaw
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError
from pybondem.physics.types import Deformation, Rate

Traction = Callable[[float], float]
quick = settings(max_examples=40, deadline=None, derandomize=True)


# Tractions as they are published: stress [Pa] against opening or slip x [m] that has never been larger ----------


def falling(k: float, peak: float, end: float) -> Traction:
    return lambda x: k * x if x <= peak else max(0.0, k * peak * (end - x) / (end - peak))


def decaying(k: float, peak: float, decay: float) -> Traction:
    return lambda x: k * x if x <= peak else k * peak * exp(-(x - peak) / decay)


def flat(k: float, peak: float, plateau: float, end: float) -> Traction:
    return lambda x: min(k * min(x, peak), max(0.0, k * peak * (end - x) / (end - plateau)))


def staying(k: float, peak: float, end: float, share: float) -> Traction:
    return lambda x: max(falling(k, peak, peak + (end - peak) / (1.0 - share))(x), min(k * x, share * k * peak))


# law, component, stiffness per area, traction, its corners (far out, the exponential one has nothing left), G_f [J/m2]
PURE = {
    "bilinear": ("slip", KS, falling(KS, 1e-5, 5e-5), [1e-5, 5e-5], 12.5),
    "bilinear_tension": ("opening", KN, falling(KN, 1e-5, 5e-5), [1e-5, 5e-5], 50.0),
    "exponential": ("slip", KS, decaying(KS, 1e-5, 2e-5), [1e-5, 1e-4, 4e-4, 1e-3], 12.5),
    "exponential_tension": ("opening", KN, decaying(KN, 1e-5, 2e-5), [1e-5, 1e-4, 4e-4, 1e-3], 50.0),
    "trapezoidal": ("slip", KS, flat(KS, 1e-5, 3e-5, 6e-5), [1e-5, 3e-5, 6e-5], 20.0),
    "trapezoidal_tension": ("opening", KN, flat(KN, 1e-5, 3e-5, 6e-5), [1e-5, 3e-5, 6e-5], 80.0),
}
SECANT = PURE | {"bilinear_residual": ("slip", KS, staying(KS, 1e-5, 5e-5, 0.3), [1e-5, 5e-5], np.inf)}


def area_below(traction: Traction, corners: list[float]) -> float:
    """Return the integral of a traction [J/m2] from 0 to its last corner."""
    small = 1e-11 * corners[0] * traction(corners[0])
    return sum(quad(traction, a, b, epsabs=small, epsrel=1e-11)[0] for a, b in pairwise([0.0, *corners]))


@pytest.mark.parametrize("name", SECANT)
def test_softening_follows_its_traction_and_unloads_to_the_origin(name: str) -> None:
    component, k, traction, corners, _ = SECANT[name]
    law = LAWS[name]
    for share in (0.05, 0.15, 0.2, 0.3, 0.45, 0.6, 0.75, 0.9, 0.99, 1.2):
        x = share * 6e-5
        back = [x, 0.6 * x, 0.1 * x, 0.0, 0.5 * x, x]
        D = np.array(damages(law, [deformation(**{component: u}) for u in back]))
        secant = [traction(x) * u / x for u in back]
        np.testing.assert_allclose((1.0 - D) * k * back, secant, rtol=1e-12, atol=1e-12 * k * corners[0])


@pytest.mark.parametrize("name", PURE)
def test_softening_spends_its_toughness(name: str) -> None:
    component, k, traction, corners, toughness = PURE[name]
    law = LAWS[name]

    def answered(x: float) -> float:
        return (1.0 - damages(law, [deformation(**{component: x})])[0]) * k * x

    assert area_below(traction, corners) == pytest.approx(toughness, rel=1e-9)
    assert area_below(answered, corners) == pytest.approx(toughness, rel=1e-9)
    assert law.declared.toughness[component](law.parameters, k) == pytest.approx(toughness, rel=1e-12)


@pytest.mark.parametrize("name", SECANT)
def test_softening_minds_its_own_component(name: str) -> None:
    other = {"slip": "opening", "opening": "slip"}[SECANT[name][0]]
    assert damages(LAWS[name], [deformation(**{other: 1.0})]) == [0.0]


def test_residual_stress_stays_for_ever_and_is_a_share_of_the_peak() -> None:
    """0.4 of a peak of 0.5 MPa far out, whatever was before; of a bond twice as stiff, of 1 MPa."""
    law = library.bilinear_residual(slip_peak=1e-5, slip_end=5e-5, residual=0.4)
    for far in (5e-5, 6e-5, 1e-3, 10.0):
        for k in (KS, 2.0 * KS):
            D = damages(law, [deformation(slip=3e-5, ks=k), deformation(slip=far, ks=k)])[-1]
            assert (1.0 - D) * k * far == pytest.approx(0.4 * k * 1e-5, rel=1e-9 * max(1.0, far / 1e-3))
    assert law.declared.toughness == {}


@pytest.mark.parametrize(("residual", "half"), [(0.0, 0.5), (1.0, 1.0)])
def test_residual_of_nothing_is_bilinear_and_of_all_a_plateau(residual: float, half: float) -> None:
    law = library.bilinear_residual(slip_peak=1e-5, slip_end=5e-5, residual=residual)
    D = damages(law, [deformation(slip=x) for x in (1e-5, 3e-5, 5e-5, 1e-4)])
    left = [1.0, half / 3.0, residual / 5.0, residual / 10.0]
    np.testing.assert_allclose(1.0 - np.array(D), left, rtol=1e-12, atol=1e-15)
    if residual == 0.0:
        assert damages(LAWS["bilinear"], [deformation(slip=3e-5)]) == pytest.approx(D[1:2], rel=1e-15)


# Mixed mode -----------------------------------------------------------------------------------------------------

TENSION, SHEAR, G_I, G_II, PLATEAU = 3e6, 5e6, 100.0, 300.0, 0.4
SHAPES = ("bilinear", "exponential", "trapezoidal")
# share of slip in the energy, G_c of Benzeggagh & Kenane (eta = 2), of the power law (alpha = 1) [J/m2]
TOUGHNESS = [(0.0, 100.0, 100.0), (0.25, 112.5, 120.0), (0.5, 150.0, 150.0), (1.0, 300.0, 300.0)]
STIFFNESSES = [(1e12, 1e12), (1e12, 3e11), (2e11, 8e11)]


def direction(share: float, kn: float, ks: float) -> tuple[float, float]:
    """Return the opening and the slip, of length 1 together, whose energies are as 1 - share to share."""
    size = sqrt((1.0 - share) / kn + share / ks)
    return sqrt((1.0 - share) / kn) / size, sqrt(share / ks) / size


def straight(shape: str, cn: float, cs: float, kn: float, ks: float, G: float) -> tuple[Traction, list[float]]:
    """Return the traction along a straight path, and its corners, from strengths and G [J/m2]."""
    k = kn * cn**2 + ks * cs**2
    peak = 1.0 / sqrt((kn * cn / TENSION) ** 2 + (ks * cs / SHEAR) ** 2)
    end = 2.0 * G / (k * peak)
    if shape == "bilinear":
        return falling(k, peak, end), [peak, end]
    if shape == "exponential":
        decay = G / (k * peak) - 0.5 * peak
        return decaying(k, peak, decay), [peak, *(peak + n * decay for n in (4, 15, 40))]
    rest = G / (k * peak) - 0.5 * peak  # the plateau spends PLATEAU of it, a triangle the rest
    plateau = peak + PLATEAU * rest
    end = plateau + 2.0 * (1.0 - PLATEAU) * rest
    return flat(k, peak, plateau, end), [peak, plateau, end]


@pytest.mark.parametrize("criterion", ["bk", "power"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("kn", "ks"), STIFFNESSES)
def test_mixed_mode_spends_its_toughness(shape: str, criterion: str, kn: float, ks: float) -> None:
    """D23: the work of the tractions on straight paths is G_c of the share of slip, whatever the two stiffnesses."""
    law = LAWS[f"{shape}_{criterion}"]
    for share, bk, power in TOUGHNESS:
        G = bk if criterion == "bk" else power
        cn, cs = direction(share, kn, ks)
        traction, corners = straight(shape, cn, cs, kn, ks, G)

        def answered(x: float, cn: float = cn, cs: float = cs) -> float:
            D = damages(law, [deformation(cn * x, cs * x, kn=kn, ks=ks)])[0]
            return (1.0 - D) * (kn * cn * x * cn + ks * cs * x * cs)  # traction times direction

        for x in np.linspace(0.0, 1.1 * corners[-1], 10)[1:]:
            assert answered(x) == pytest.approx(traction(x), rel=1e-9, abs=1e-12 * traction(corners[0]))
        assert area_below(answered, corners) == pytest.approx(G, rel=1e-9)
    promised = law.declared.toughness
    assert (promised["opening"](law.parameters, kn), promised["slip"](law.parameters, ks)) == (100.0, 300.0)


def test_power_law_of_another_exponent() -> None:
    """alpha = 2 at equal shares: G_c = 1 / sqrt((0.5/100)^2 + (0.5/300)^2) = 189.7367 J/m2."""
    law = library.bilinear_power(tension=TENSION, shear=SHEAR, G_I=G_I, G_II=G_II, alpha=2.0)
    cn, cs = direction(0.5, KN, KS)
    _, (peak, end) = straight("bilinear", cn, cs, KN, KS, 189.73665961)
    states = [deformation(cn * x, cs * x) for x in (0.5 * (peak + end), 0.999999 * end, 1.000001 * end)]
    half = 1.0 - peak / (peak + end)  # half of the peak's stress is left at the middle
    assert damages(law, states) == pytest.approx([half, 1.0, 1.0], abs=1e-5)
    assert damages(law, states)[1] < damages(law, states)[2] == 1.0


@pytest.mark.parametrize("name", [f"{shape}_{criterion}" for shape in SHAPES for criterion in ("bk", "power")])
def test_mixed_mode_begins_at_the_quadratic_criterion_and_never_in_pressure(name: str) -> None:
    for angle in np.linspace(0.0, 0.5 * pi, 7):
        onset = deformation(TENSION * cos(angle) / KN, SHEAR * sin(angle) / KS)
        below, above = (onset._replace(opening=s * onset.opening, slip=s * onset.slip) for s in (0.9999, 1.0001))
        assert damages(LAWS[name], [below]) == [0.0]
        assert 0.0 < damages(LAWS[name], [above])[0] < 5e-3
    assert damages(LAWS[name], [deformation(-1.0)]) == [0.0]
    in_slip, pressed = (damages(LAWS[name], [deformation(opening, 2.0 * SHEAR / KS)]) for opening in (0.0, -1.0))
    assert in_slip == pressed


def test_mixed_mode_remembers_damage_when_the_mode_changes() -> None:
    law, far = LAWS["bilinear_bk"], 3.0 * SHEAR / KS
    slipped, less, opened, again = damages(
        law,
        [deformation(0.0, far), deformation(0.0, 0.1 * far), deformation(0.9 * TENSION / KN), deformation(0.0, far)],
    )
    assert slipped > 0.5
    assert less == opened == again == slipped


def test_mixed_mode_breaks_at_once_where_the_toughness_is_too_small() -> None:
    """G_c below what a bond holds at its strength, 22.5 J/m2 in tension: it breaks there."""
    for shape in SHAPES:
        more = {"plateau_share": 0.4} if shape == "trapezoidal" else {}
        law = getattr(library, f"{shape}_bk")(tension=TENSION, shear=SHEAR, G_I=20.0, G_II=20.0, eta=2.0, **more)
        assert damages(law, [deformation(0.999999 * TENSION / KN)]) == [0.0]
        assert damages(law, [deformation(1.000001 * TENSION / KN)]) == pytest.approx([1.0], abs=2e-6)
        assert law.declared.toughness["opening"](law.parameters, KN) == pytest.approx(22.5, rel=1e-12)


# Strengths ------------------------------------------------------------------------------------------------------

RB = 4e-3  # radius of a bond whose strengths are 5 and 3 MPa: it bears these loads [N, N m], each alone
TENSION_LOAD, SHEAR_LOAD, MOMENT, TWIST = 251.3274, 150.7964, 0.2513274, 0.3015929


def loaded(tension: float = 0.0, shear: float = 0.0, moment: float = 0.0, twist: float = 0.0) -> Deformation:
    area, inertia = pi * RB**2, pi * RB**4 / 4.0
    return deformation()._replace(
        normal_stress=tension / area, shear_stress=shear / area,
        bending_stress=moment * RB / inertia, twist_stress=twist * RB / (2.0 * inertia),
    )  # fmt: skip


@pytest.mark.parametrize(
    "load",
    [
        {"tension": TENSION_LOAD},
        {"shear": SHEAR_LOAD},
        {"moment": MOMENT},
        {"twist": TWIST},
        {"tension": 0.4 * TENSION_LOAD, "moment": 0.6 * MOMENT},
        {"shear": 0.7 * SHEAR_LOAD, "twist": 0.3 * TWIST},
    ],
)
def test_d21_strength(load: dict[str, float]) -> None:
    below, above = (loaded(**{name: s * value for name, value in load.items()}) for s in (0.9999, 1.0001))
    assert damages(LAWS["strength"], [below, above, below, loaded()]) == [0.0, 1.0, 1.0, 1.0]


def test_strength_bears_all_pressure_and_takes_its_share_of_the_moments() -> None:
    assert damages(LAWS["strength"], [loaded(tension=-1e6 * TENSION_LOAD)]) == [0.0]
    half = library.strength(tension=5e6, shear=3e6, moment_share=0.5)
    for name, value in (("moment", MOMENT), ("twist", TWIST)):
        assert damages(half, [loaded(**{name: 1.9999 * value}), loaded(**{name: 2.0001 * value})]) == [0.0, 1.0]


@pytest.mark.parametrize(("pressure", "shear"), [(0.0, 10e6), (20e6, 20e6), (100e6, 60e6), (-2e6, 9e6)])
def test_mohr_coulomb_line(pressure: float, shear: float) -> None:
    """Cohesion 10 MPa, coefficient 0.5: what it bears under each pressure; twist adds to the shear stress."""
    state = deformation()._replace(normal_stress=-pressure, twist_stress=1e6)
    below, above = (state._replace(shear_stress=s * shear - 1e6) for s in (0.9999, 1.0001))
    assert damages(LAWS["mohr_coulomb"], [below, above, below]) == [0.0, 1.0, 1.0]


def test_mohr_coulomb_cut_off() -> None:
    below, above = (deformation()._replace(normal_stress=s * 4e6 - 1e6, bending_stress=1e6) for s in (0.9999, 1.0001))
    assert damages(LAWS["mohr_coulomb"], [below, above]) == [0.0, 1.0]


@pytest.mark.parametrize(
    ("opening_rate", "slip_rate", "growth"),
    [(0.0, 0.0, 1.0), (0.5e-3, 0.5e-3, 1.0), (1e-3 * exp(2.0), 0.0, 1.2), (-1e-3 * exp(2.0), 0.0, 1.2),
     (3e-3 * exp(4.0), 4e-3 * exp(4.0), 1.0 + 0.1 * (4.0 + 1.6094379124341003))],
)  # fmt: skip
def test_rate_strength(opening_rate: float, slip_rate: float, growth: float) -> None:
    """Strengths 4 and 8 MPa, 10 % more for each factor e of the strain rate (1/s) above 1e-3; ln 5 = 1.609."""
    rate = [Rate(opening_rate * LENGTH, slip_rate * LENGTH, 0.0, 0.0)] * 2
    for name, strength in (("normal_stress", 4e6), ("shear_stress", 8e6)):
        states = [deformation()._replace(**{name: s * growth * strength}) for s in (0.9999, 1.0001)]
        assert damages(LAWS["rate_strength"], states, rate) == [0.0, 1.0]
        moment = {"normal_stress": "bending_stress", "shear_stress": "twist_stress"}[name]
        both = [s._replace(**{name: 0.3 * getattr(s, name), moment: 0.7 * getattr(s, name)}) for s in states]
        assert damages(LAWS["rate_strength"], both, rate) == [0.0, 1.0]


# Concrete -------------------------------------------------------------------------------------------------------


def test_concrete_in_tension() -> None:
    """Stress over modulus: strain up to the threshold, then threshold (1 - alpha + alpha exp(-beta (strain - ...)))."""
    strains = np.array([0.5e-4, 0.999e-4, 1.5e-4, 3e-4, 1e-3, 5e-3, 2e-2])
    D = damages(LAWS["concrete"], [deformation(e * LENGTH) for e in strains])
    wanted = np.where(strains < 1e-4, strains, 1e-4 * (0.04 + 0.96 * np.exp(-350.0 * (strains - 1e-4))))
    np.testing.assert_allclose((1.0 - np.array(D)) * strains, wanted, rtol=1e-12)


@pytest.mark.parametrize(("e", "g"), [(3e-4, 0.0), (0.0, 6e-4), (2e-4, 5e-4), (-2e-4, 9e-4), (-3e-4, 0.0)])
def test_concrete_strain_is_that_of_mazars(e: float, g: float) -> None:
    """The same damage as in plain tension at the norm of the positive principal strains."""
    principal = np.linalg.eigvalsh([[e, 0.5 * g], [0.5 * g, 0.0]])
    equivalent = np.linalg.norm(np.maximum(principal, 0.0))
    found, alone = (
        damages(LAWS["concrete"], [deformation(a * LENGTH, b * LENGTH)]) for a, b in ((e, g), (equivalent, 0.0))
    )
    assert found == pytest.approx(alone, rel=1e-12)
    assert (found[0] > 0.0) == (equivalent > 1e-4)


# All of them ----------------------------------------------------------------------------------------------------

sizes = st.one_of(st.just(0.0), st.floats(-2e-4, 2e-4, allow_subnormal=False))
stresses = st.floats(0.0, 8e6, allow_subnormal=False)
speeds = st.floats(-1.0, 1.0, allow_subnormal=False)
histories = st.lists(st.tuples(sizes, sizes, stresses, stresses, speeds, speeds), min_size=2, max_size=12)


@pytest.mark.parametrize("name", DAMAGE_LAWS)
@given(history=histories)
@quick
def test_damage_only_grows(name: str, history: list[tuple[float, ...]]) -> None:
    states = [deformation(opening, abs(slip), bending, twist) for opening, slip, bending, twist, _, _ in history]
    rates = [Rate(a, abs(b), 0.0, 0.0) for *_, a, b in history]
    found = [0.0, *damages(LAWS[name], states, rates)]
    assert all(0.0 <= D <= 1.0 for D in found)
    assert all(a <= b for a, b in pairwise(found))


@pytest.mark.parametrize("name", DAMAGE_LAWS)
def test_no_damage_at_rest_nor_in_pressure(name: str) -> None:
    """With plain numbers, where 0/0 would raise; also where the bond has no stiffness one way."""
    for kn, ks in ((KN, KS), (0.0, KS), (KN, 0.0)):
        states = [deformation(opening, 0.0, kn=kn, ks=ks) for opening in (0.0, -1e-6, -1.0)]
        assert damages(LAWS[name], states) == [0.0, 0.0, 0.0]


def on_many(law: ValuedLaw, d: Deformation, rate: Rate, memory: tuple[np.ndarray, ...]) -> tuple:
    with np.errstate(all="raise", under="ignore"):
        return on_arrays(law.function)(d, None, law.memory(*memory), law.parameters, rate, 0.0)


@pytest.mark.parametrize("name", DAMAGE_LAWS)
def test_arrays_as_numbers(name: str) -> None:
    """On whole arrays the same as bond by bond: no branches, nothing left to warn of."""
    random, law, count = np.random.default_rng(7), LAWS[name], 40
    memory = tuple(np.zeros(count) for _ in law.memory._fields)
    history, rates = [], []
    for _ in range(3):
        opening, slip = random.uniform(-5e-5, 9e-5, count), random.uniform(0.0, 9e-5, count)
        slip[:5], opening[:3] = 0.0, 0.0
        d = deformation(opening, slip, *random.uniform(0.0, 3e6, (2, count)))
        rate = Rate(*random.uniform(0.0, 1.0, (2, count)), 0.0, 0.0)
        damage, memory = on_many(law, d, rate, memory)
        history.append(d)
        rates.append(rate)
    for b in range(count):
        states = [Deformation(*(float(v[b]) if np.ndim(v) else v for v in d)) for d in history]
        alone = damages(law, states, [Rate(float(r.opening[b]), float(r.slip[b]), 0.0, 0.0) for r in rates])
        assert damage[b] == pytest.approx(alone[-1], rel=1e-13, abs=1e-13)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("bilinear", {"slip_peak": 2e-5, "slip_end": 2e-5}),
        ("bilinear_tension", {"opening_peak": 2e-5, "opening_end": 1e-5}),
        ("trapezoidal", {"slip_peak": 2e-5, "slip_plateau": 1e-5, "slip_end": 5e-5}),
        ("trapezoidal_tension", {"opening_peak": 1e-5, "opening_plateau": 5e-5, "opening_end": 5e-5}),
        ("exponential", {"slip_peak": 1e-5, "slip_decay": 0.0}),
        ("bilinear_residual", {"slip_peak": 2e-5, "slip_end": 2e-5, "residual": 0.3}),
        ("bilinear_residual", {"slip_peak": 1e-5, "slip_end": 5e-5, "residual": 1.1}),
        ("bilinear_residual", {"slip_peak": 1e-5, "slip_end": 5e-5, "residual": -0.1}),
        ("bilinear_friction", {"slip_peak": 2e-5, "slip_end": 1e-5, "residual": 0.3}),
        ("bilinear_friction", {"slip_peak": 1e-5, "slip_end": 5e-5, "residual": 1.1}),
        ("strength", {"tension": 1e6, "shear": 1e6, "moment_share": 1.5}),
        ("mohr_coulomb", {"cohesion": 1e6, "friction": -0.1, "tension": 1e6}),
        ("concrete", {"threshold": 1e-4, "alpha": 1.1, "beta": 350.0}),
    ],
)
def test_values_out_of_range(name: str, values: dict[str, float]) -> None:
    with pytest.raises(InputError):
        getattr(library, name)(**values)


@pytest.mark.parametrize("name", library.__all__)
def test_every_parameter_says_what_it_is(name: str) -> None:
    """Unit, meaning, and a typical value with which the law can be made."""
    law = getattr(library, name)
    assert name in LAWS
    assert all(p.unit and p.meaning and p.typical is not None for p in law.parameters.values())
    typical = law(**{word: p.typical for word, p in law.parameters.items()})
    assert typical.branches is False
    assert len(typical.parameters) == len(law.parameters)


USED = {"typing", "pybondem.ops", "pybondem.physics.types", "pybondem.laws.law", "pybondem.laws.parameters"}


@pytest.mark.parametrize(
    "path", sorted((Path(library.__file__).parent / "library").glob("[a-z]*.py")), ids=lambda p: p.stem
)
def test_every_law_is_written_as_a_user_would(path: Path) -> None:
    """A few imports, short functions, no branches."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    imported = {n.module for n in nodes if isinstance(n, ast.ImportFrom)}
    assert {m for m in imported if m and not m.startswith("pybondem.laws.library.")} <= USED
    assert not [n for n in nodes if isinstance(n, ast.Import | ast.If | ast.IfExp | ast.For | ast.While)]
    functions = [n for n in nodes if isinstance(n, ast.FunctionDef)]
    assert functions
    assert all(n.end_lineno is not None and n.end_lineno - n.lineno < 15 for n in functions)
