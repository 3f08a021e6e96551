"""The closed pull-out solution against integration, a discrete model with damage, energy and known formulas."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from numpy import cos, pi, sin, sqrt, tan, tanh
from oracles.two_chains import TwoChains
from scipy.integrate import dblquad, solve_ivp
from scipy.optimize import brentq

from pybondem.errors import InputError
from pybondem.theory import PullOut, shear_lag_compliance

# Snaps back; one-dimensional theory is close to the solid here. All units SI.
CLEAN = PullOut(1e10, 1e10, 1.0, 6.0, 30.0, stiffness=6e7, slip_peak=1e-4, slip_end=4e-4)
# Of the paper's public code: both ends soften, no snap-back.
SHIPPED = PullOut(5e10, 5e9, 1.0, 6.0, 30.0, stiffness=1e9, slip_peak=1e-4, slip_end=3e-3)
PUSHED = PullOut(2e10, 4e9, 0.5, 3.0, 12.0, stiffness=4e8, slip_peak=2e-4, slip_end=7e-4, support="pull-push")
# The matrix is the softer bar: the tip goes first.
TIP_FIRST = CLEAN.with_axial_stiffness(4e10, 1.5e10)
CASES = {"clean": CLEAN, "shipped": SHIPPED, "pushed": PUSHED, "tip first": TIP_FIRST}


def bond_stress(test, slip):
    """The bond law, written once more."""
    k, s0, sf = test.stiffness, test.slip_peak, test.slip_end
    return np.where(slip <= s0, k * slip, np.where(slip < sf, k * s0 * (sf - slip) / (sf - s0), 0.0))


def random_tests(n, seed, extra=True):
    """Tests over a wide range of shapes: lam L 0.4 to 25, sf/s0 1.1 to 30, a_f/a_m 0.1 to 10."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        lam_length, ratio, rho = 10 ** rng.uniform((-0.4, -1, -1), (1.4, 1.5, 1))
        test = CLEAN.with_axial_stiffness(3e10, 3e10 / rho)
        yield replace(
            test,
            stiffness=(lam_length / test.length) ** 2 / test.c,
            slip_end=test.slip_peak * (1 + ratio),
            support=("pull-pull", "pull-push")[rng.integers(2)],
            extra_compliance=extra * rng.integers(2) * 10 ** rng.uniform(-1, 1) * test.length / test.a_fibre,
        )


def some_slips(test, rng, n=6):
    """Least slips from every stage: between onset and s0 they are spread logarithmically."""
    onset = test.state_at_load(test.onset_load()).least_slip
    logarithmic = np.exp(rng.uniform(np.log(0.3 * onset), np.log(test.slip_peak), n))
    return np.append(logarithmic, rng.uniform(test.slip_peak, test.slip_end, n // 2))


# ---- the differential equation ---------------------------------------------------------------------------------------


def integrated(test, S, x_from, x_to):
    """Slip and its slope at points from a section of least slip outward, by Runge-Kutta."""
    scale = np.array([test.slip_end, test.slip_end * test.lam])
    out = solve_ivp(
        lambda x, s: (s[1], test.c * bond_stress(test, s[0])),
        (x_from, x_to),
        (S, 0.0),
        "DOP853",
        t_eval=np.linspace(x_from, x_to, 9),
        rtol=1e-10,
        atol=1e-12 * S * np.array([1.0, test.lam]),
        max_step=test.length / 20,
    )
    return out.t, out.y / scale[:, None]


@pytest.mark.parametrize("seed", range(4))
def test_every_state_solves_the_equation_and_meets_both_ends(seed):
    rng = np.random.default_rng(100 + seed)
    for test in random_tests(5, seed):
        for S in some_slips(test, rng):
            state = test.state(S)
            scale = test.slip_end * test.lam
            tip_slope, end_slope = 0.0, 0.0
            for end in (0.0, test.length):
                if end != state.section:
                    x, (slip, slope) = integrated(test, S, state.section, end)
                    np.testing.assert_allclose(state.slip(x) / test.slip_end, slip, rtol=0, atol=1e-7)
                    tip_slope, end_slope = (slope[-1], end_slope) if end == 0.0 else (tip_slope, slope[-1])
            g_tip, g_end = (
                (1 / test.a_matrix, 1 / test.a_fibre) if test.support == "pull-pull" else (0.0, test.c / test.p)
            )
            assert tip_slope == pytest.approx(-g_tip * state.load / scale, abs=1e-7)
            assert end_slope == pytest.approx(g_end * state.load / scale, abs=1e-7)


@pytest.mark.parametrize("name", CASES)
def test_forces_and_displacements_along_both_bars(name):
    test = replace(CASES[name], extra_compliance=1e-10)
    for S in some_slips(test, np.random.default_rng(5)):
        state, x = test.state(S), np.linspace(0.0, test.length, 4001)
        N_f, tau = state.fibre_force(x), bond_stress(test, state.slip(x))
        N_m = (state.load if test.support == "pull-pull" else 0.0) - N_f
        np.testing.assert_array_equal(tau, state.shear(x))
        assert N_f[[0, -1]] == pytest.approx([0.0, state.load], abs=1e-12 * state.load)

        def summed(rate, x=x):
            return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(x)))

        u_f, u_m = state.fibre_displacement(x), state.matrix_displacement(x)
        np.testing.assert_allclose(N_f, test.p * summed(tau), rtol=0, atol=1e-5 * state.load)
        np.testing.assert_allclose(u_f - u_f[0], summed(N_f) / test.a_fibre, rtol=0, atol=1e-5 * u_f[-1])
        np.testing.assert_allclose(u_m - u_m[0], summed(N_m) / test.a_matrix, rtol=0, atol=1e-5 * u_f[-1])
        assert u_m[0 if test.support == "pull-pull" else -1] == pytest.approx(0.0, abs=1e-12 * u_f[-1])
        assert u_f[-1] + 1e-10 * state.load == pytest.approx(state.displacement, rel=1e-12)


# ---- a discrete model: two chains of springs joined by bonds that damage ---------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_path_profile_and_dissipation_agree_with_two_chains_of_springs(name):
    test = CASES[name]
    chains, peak, farthest = TwoChains(test), test.peak(), 0.0
    x, seen, loads = np.linspace(0.0, test.length, chains.n + 1), [], []
    for P, slip, v, kappa in chains.states(step=0.01):
        state = test.state(float(slip.min()))
        seen.append(state.zones)
        loads.append(P)
        farthest = max(farthest, v[-2])
        assert state.load == pytest.approx(P, abs=5e-5 * peak.load)
        assert state.displacement == pytest.approx(v[-2], abs=5e-5 * test.slip_end)
        np.testing.assert_allclose(state.shear(x), chains.bond(slip, kappa)[0], rtol=0, atol=1.5e-4 * test.tau_max)
        broken = np.clip((kappa - test.slip_peak) / (test.slip_end - test.slip_peak), 0.0, 1.0)
        assert state.dissipated == pytest.approx(
            test.fracture_energy * chains.area @ broken, abs=2e-5 * test.work_of_debonding
        )
    assert len(seen) > 60
    assert max(loads) == pytest.approx(peak.load, rel=1e-3)
    if test.snaps_back:
        assert farthest == pytest.approx(test.turning_point().displacement, rel=1e-3)
    words = [word for word, _ in groupby(seen)]
    expected = {
        "clean": ["E", "ES", "ESD", "SD"],
        "shipped": ["E", "ES", "SES", "S"],
        "pushed": ["E", "ES", "ESD", "SD"],
        "tip first": ["E", "SE", "DSE", "DSES", "DS"],
    }
    assert [word for word in words if word in expected[name]] == expected[name]


# ---- energy ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_work_of_the_load_is_dissipated_or_stored_at_every_state(seed):
    for test in random_tests(6, 50 + seed):
        path = test.path(20_000)
        P, u = path.load, path.displacement
        work = np.append(0.0, np.cumsum(0.5 * (P[1:] + P[:-1]) * np.diff(u)))
        total = 2 * pi * test.r_fibre * test.length * 0.5 * test.stiffness * test.slip_peak * test.slip_end
        np.testing.assert_allclose(work, path.dissipated + 0.5 * P * u, rtol=0, atol=2e-6 * total)
        assert work[-1] == pytest.approx(total, rel=2e-6)
        assert path.dissipated[-1] == pytest.approx(total, rel=1e-12)
        assert test.work_of_debonding == pytest.approx(total, rel=1e-12)
        assert path.load[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12 * P.max())
        assert u[-1] == pytest.approx(test.slip_end, rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_least_slip_and_dissipation_only_grow_and_no_softening_section_unloads(name):
    test = CASES[name]
    path, x = test.path(300), np.linspace(0.0, test.length, 201)
    assert np.all(np.diff(path.least_slip) > 0.0)
    assert np.all(np.diff(path.dissipated) >= 0.0)
    slips = np.array([test.state(S).slip(x) for S in path.least_slip])
    falling = np.diff(slips, axis=0) < -1e-12 * test.slip_end
    softening = (slips[:-1] > test.slip_peak) & (slips[:-1] < test.slip_end)
    assert falling.any() == (name != "shipped")  # elastic sections unload behind the peak, where any are left
    assert not (falling & softening).any()


# ---- known formulas --------------------------------------------------------------------------------------------------


def test_elastic_stage_is_the_hyperbolic_solution():
    for test in random_tests(20, 9):
        g_tip, g_end = (1 / test.a_matrix, 1 / test.a_fibre) if test.support == "pull-pull" else (0.0, test.c / test.p)
        P, x, z = 0.8 * test.onset_load(), np.linspace(0, test.length, 7), test.lam * test.length
        exact = P * (g_end * np.cosh(test.lam * x) + g_tip * np.cosh(z - test.lam * x)) / (test.lam * np.sinh(z))
        state = test.state_at_load(P)
        np.testing.assert_allclose(state.slip(x), exact, rtol=1e-9)
        assert state.zones == "E"
        assert state.dissipated == 0.0
        assert exact.max() / P * test.onset_load() == pytest.approx(test.slip_peak, rel=1e-12)


def test_pull_push_peak_is_the_ultimate_load_of_yuan_et_al():
    for test in random_tests(30, 21):
        test = replace(test, support="pull-push")
        lam, om, L = test.lam, test.omega, test.length
        highest = min(L, pi / 2 / om)

        def excess(b, lam=lam, om=om, L=L):
            return om * sin(om * b) - lam * tanh(lam * (L - b)) * cos(om * b)

        b = brentq(excess, 0.0, highest, xtol=1e-14)
        peak, state = test.peak(), test.state_at_load(test.peak().load)
        assert peak.load == pytest.approx(om * test.slip_end * sin(om * b) * test.p / test.c, rel=1e-10)
        bare = peak.displacement - test.extra_compliance * peak.load
        slope = lam * test.slip_peak * tanh(lam * (L - b))
        softened = test.slip_end - (test.slip_end - test.slip_peak) * cos(om * b) + slope / om * sin(om * b)
        assert bare == pytest.approx(softened, rel=1e-8)
        assert state.zones == "ES"


def test_long_bond_reaches_the_load_of_fracture_mechanics():
    for test in random_tests(20, 33, extra=False):
        test = replace(test, length=test.length * 60.0 / (min(test.lam, test.omega) * test.length))
        assert test.peak().load == pytest.approx(test.long_bond_load(), rel=1e-9)
        weaker = min(test.a_fibre, test.a_matrix) if test.support == "pull-pull" else test.p / test.c
        energy_release = 0.5 * test.peak().load ** 2 * (test.c / test.p) / test.p  # dU/da/p if the bars separate
        share = (weaker * test.c / test.p) ** 2  # of the squared load that the far side cannot give back
        assert energy_release / share == pytest.approx(test.fracture_energy, rel=1e-9)


def last_branch(test):
    """Slope of u and of P with C = sf - S once no section is elastic, from the explicit formulas (rho <= 1)."""
    om, L, r = test.omega, test.length, test.rho
    if om * L >= pi / 2 + np.arcsin(r):
        x_m, far = np.arcsin(r) / om, om * L - np.arcsin(r) - pi / 2
        slope = om
    else:
        x_m = np.arctan2(r * sin(om * L), 1 + r * cos(om * L)) / om
        far, slope = -cos(om * (L - x_m)), om * sin(om * (L - x_m))
    per_load = test.extra_compliance + (L / (test.a_fibre + test.a_matrix) if test.support == "pull-pull" else 0.0)
    alpha = test.alpha if test.support == "pull-pull" else 0.0
    P = slope / (1 / test.a_fibre if test.support == "pull-pull" else test.c / test.p)
    return (1 - alpha) * far - alpha * cos(om * x_m) + P * per_load, P


def test_snap_back_criterion_and_straight_last_branch():
    counted = {True: 0, False: 0}
    for test in random_tests(150, 77):
        if test.rho > 1.0:
            continue
        du, dP = last_branch(test)
        for S in np.linspace(test.slip_peak, test.slip_end, 5):
            state = test.state(S)
            assert state.load == pytest.approx(dP * (test.slip_end - S), abs=1e-9 * test.peak().load)
            assert state.displacement == pytest.approx(test.slip_end + du * (test.slip_end - S), rel=1e-9)
        path = test.path(400)
        assert test.snaps_back == (du > 0.0)
        assert (test.turning_point() is not None) == (du > 0.0)
        assert (np.diff(path.displacement).min() < -1e-9 * test.slip_end) == (du > 0.0)
        counted[test.snaps_back] += 1
    assert min(counted.values()) > 20


def test_critical_length_of_pull_push_is_a_quarter_wave():
    quarter = pi / 2 / PUSHED.omega
    assert not replace(PUSHED, length=0.999 * quarter).snaps_back
    assert replace(PUSHED, length=1.001 * quarter).snaps_back


@pytest.mark.parametrize("seed", range(2))
def test_peak_and_turning_point_are_the_extremes_of_a_sweep(seed):
    for test in random_tests(8, 300 + seed):
        onset = test.state_at_load(test.onset_load()).least_slip
        sweep = [test.state(S) for S in np.geomspace(onset, test.slip_peak, 300)]
        peak, turn = test.peak(), test.turning_point()
        highest = max(sweep, key=lambda s: s.load)
        assert 0.0 <= peak.load - highest.load < 1e-3 * peak.load
        assert test.state_at_load(peak.load).displacement == pytest.approx(peak.displacement, rel=1e-9)
        if turn:
            farthest = max(sweep, key=lambda s: s.displacement)
            assert -1e-12 * turn.displacement <= turn.displacement - farthest.displacement < 1e-3 * turn.displacement


# ---- numbers computed beforehand, apart from this package ------------------------------------------------------------


def test_numbers_of_the_clean_case():
    assert CLEAN.lam * CLEAN.length == pytest.approx(3.333, abs=5e-4)
    assert CLEAN.omega * CLEAN.length == pytest.approx(1.924, abs=5e-4)
    assert CLEAN.peak() == pytest.approx((6.785e5, 0.3809e-3), rel=2e-4)
    assert CLEAN.turning_point() == pytest.approx((6.056e5, 0.5025e-3), rel=2e-4)
    words = [word for word, _ in groupby(CLEAN.path(20_000).zones)]
    assert words == ["E", "ES", "ESD", "SESD", "SD", "D"]
    c_sl = shear_lag_compliance(1.0, 6.0, 5e9, 5e9)  # nu = 0
    assert CLEAN.stiffness * c_sl == pytest.approx(0.0166, abs=1e-4)
    softer = CLEAN.with_shear_compliance(0.020 / CLEAN.stiffness)
    assert softer.peak().load == pytest.approx(6.782e5, rel=2e-4)
    assert softer.turning_point().displacement == pytest.approx(0.5038e-3, rel=2e-4)


def test_numbers_of_the_shipped_parameters():
    assert (SHIPPED.a_fibre, SHIPPED.a_matrix) == pytest.approx((1.571e11, 5.498e11), rel=1e-3)
    assert (SHIPPED.rho, SHIPPED.alpha) == pytest.approx((0.286, 0.222), abs=5e-4)
    assert (SHIPPED.lam * 30, SHIPPED.omega * 30) == pytest.approx((6.80, 1.263), rel=1e-3)
    assert SHIPPED.onset_load() == pytest.approx(3.56e6, rel=1e-3)
    peak = SHIPPED.peak()
    assert peak == pytest.approx((1.633e7, 1.88e-3), rel=1e-3)
    assert peak.load / pi == pytest.approx(5.20e6, rel=1e-3)
    assert peak.load / SHIPPED.long_bond_load() == pytest.approx(0.837, abs=5e-4)
    assert SHIPPED.state_at_load(peak.load).slip(30.0) == pytest.approx(1.48e-3, abs=6e-6)
    series = 5.4 / SHIPPED.a_fibre + 5.0 / (5e9 * pi * 36)  # free fibre, and the matrix in front of the tip
    assert replace(SHIPPED, extra_compliance=series).peak().displacement == pytest.approx(2.59e-3, rel=2e-3)
    lengths = {"pull-pull": 39.5, "pull-push": 37.3}
    for support, length in lengths.items():
        assert not replace(SHIPPED, support=support, length=length - 0.1).snaps_back
        assert replace(SHIPPED, support=support, length=length + 0.1).snaps_back
    assert not replace(SHIPPED, slip_end=1.79e-3).snaps_back
    assert replace(SHIPPED, slip_end=1.77e-3).snaps_back
    assert replace(SHIPPED, extra_compliance=13.2 / SHIPPED.a_fibre).snaps_back
    c_sl = shear_lag_compliance(1.0, 6.0, 5e10 / 2.4, 5e9 / 2.4)
    assert SHIPPED.stiffness * c_sl == pytest.approx(0.555, abs=1e-3)
    assert SHIPPED.with_shear_compliance(c_sl).onset_load() / SHIPPED.onset_load() == pytest.approx(1.24, abs=0.01)
    assert SHIPPED.with_shear_compliance(c_sl).peak().load / peak.load == pytest.approx(0.997, abs=1e-3)


# ---- shear compliance, other constructions ---------------------------------------------------------------------------


def test_shear_lag_compliance_is_the_difference_of_mean_displacements():
    r, R, G_f, G_m = 0.7, 2.9, 3e9, 1.1e9
    area_f, area_m = pi * r**2, pi * (R**2 - r**2)

    def shear(
        at,
    ):  # what the even stretch inside (fibre) or outside (matrix) of a radius leaves to be carried, for tau = 1
        return at / r if at < r else (R**2 - at**2) / (R**2 - r**2) * r / at

    in_fibre, _ = dblquad(lambda z, y: 2 * pi * y / area_f * shear(z) / G_f, 0, r, lambda y: y, lambda y: r)
    in_matrix, _ = dblquad(lambda z, y: 2 * pi * y / area_m * shear(z) / G_m, r, R, lambda y: r, lambda y: y)
    assert shear_lag_compliance(r, R, G_f, G_m) == pytest.approx(in_fibre + in_matrix, rel=1e-9)


def test_series_compliance_adds_elastic_slip_and_keeps_strength_and_energy():
    c_sl = 0.6 * (CLEAN.slip_end - CLEAN.slip_peak) / CLEAN.tau_max
    softer, slip = CLEAN.with_shear_compliance(c_sl), np.linspace(0.0, 1.3 * CLEAN.slip_end, 50)
    tau = bond_stress(CLEAN, slip)
    np.testing.assert_allclose(softer.bond_stress(slip + c_sl * tau), tau, rtol=0, atol=1e-12 * CLEAN.tau_max)
    assert softer.tau_max == pytest.approx(CLEAN.tau_max, rel=1e-12)
    assert softer.fracture_energy == pytest.approx(CLEAN.fracture_energy, rel=1e-12)


def test_bond_stress_has_the_sign_of_the_slip():
    slip = np.array([5e-5, 2e-4, 5e-4])
    np.testing.assert_array_equal(CLEAN.bond_stress(-slip), -bond_stress(CLEAN, slip))


def test_measured_axial_stiffness_replaces_the_nominal_one():
    test = SHIPPED.with_axial_stiffness(1.4e11, 6e11)
    assert (test.a_fibre, test.a_matrix) == pytest.approx((1.4e11, 6e11), rel=1e-14)
    assert (test.E_fibre, test.E_matrix) == pytest.approx((1.4e11 / pi, 6e11 / (35 * pi)), rel=1e-14)
    assert replace(test, E_fibre=SHIPPED.E_fibre, E_matrix=SHIPPED.E_matrix) == SHIPPED


# ---- choosing a state ------------------------------------------------------------------------------------------------


def test_states_found_by_load_and_by_displacement_are_the_wanted_ones():
    for test in random_tests(15, 500):
        peak, last = test.peak(), test.turning_point()
        top, before = test.state_at_load(peak.load).least_slip, -1.0
        for P in np.array([0.0, 0.1, 0.6, 0.99, 1.0]) * peak.load:
            rising, falling = test.state_at_load(P), test.state_at_load(P, rising=False)
            assert (rising.load, falling.load) == pytest.approx((P, P), abs=1e-10 * peak.load)
            assert before < rising.least_slip <= top * (1 + 1e-9)
            assert falling.least_slip >= top * (1 - 1e-9)
            before = rising.least_slip
        reach = last.displacement if last else test.slip_end
        before = -1.0
        for u in np.array([0.0, 0.01, 0.3, 0.9, 0.999]) * reach:
            state = test.state_at_displacement(u)
            assert state.displacement == pytest.approx(u, abs=1e-10 * reach)
            assert state.least_slip > before
            before = state.least_slip
        out = test.state_at_displacement(1.001 * reach)
        assert (out.load, out.zones, out.displacement) == (0.0, "D", pytest.approx(1.001 * reach, rel=1e-12))
        np.testing.assert_allclose(out.slip([0.0, test.length]), 1.001 * reach, rtol=1e-12)
        assert out.dissipated == pytest.approx(test.work_of_debonding, rel=1e-12)


def test_unloaded_state_is_nothing():
    state = CLEAN.state(0.0)
    assert (state.load, state.displacement, state.dissipated, state.zones) == (0.0, 0.0, 0.0, "E")
    np.testing.assert_array_equal(state.shear(np.linspace(0, 30, 5)), np.zeros(5))


@pytest.mark.parametrize("support", ["pull-pull", "pull-push"])
@pytest.mark.parametrize("rho", [0.3, 1.0, 4.0])
def test_very_long_bond_where_cosh_overflows(support, rho):
    test = replace(CLEAN.with_axial_stiffness(3e10, 3e10 / rho), support=support)
    test = replace(test, length=3000.0 / test.lam)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        path = test.path(500)
        state = test.state_at_displacement(0.8 * test.turning_point().displacement)
    assert np.isfinite([path.load, path.displacement, path.dissipated]).all()
    assert path.load.max() == pytest.approx(test.long_bond_load(), rel=1e-9)
    assert state.load == pytest.approx(test.long_bond_load(), rel=1e-9)
    assert state.fibre_force(test.length) == pytest.approx(state.load, rel=1e-9)
    front = np.linspace(0.0, test.length, 200_001)
    assert np.trapezoid(state.shear(front), front) * test.p == pytest.approx(state.load, rel=1e-3)


def test_very_short_bond_slips_as_one():
    test = replace(CLEAN, length=1e-4 / CLEAN.lam)
    for slip in (0.3e-4, 1.5e-4, 3.9e-4):
        state = test.state(slip)
        assert state.load == pytest.approx(test.p * test.length * bond_stress(test, slip), rel=1e-6)
        assert state.displacement == pytest.approx(slip, rel=1e-6)
    assert test.peak() == pytest.approx((test.p * test.length * test.tau_max, test.slip_peak), rel=1e-6)


# ---- refusals --------------------------------------------------------------------------------------------------------

GOOD = {"E_fibre": 1e10, "E_matrix": 1e10, "r_fibre": 1.0, "r_matrix": 6.0, "length": 30.0}
GOOD |= {"stiffness": 6e7, "slip_peak": 1e-4, "slip_end": 4e-4}


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "3", None, True, np.ones(2), 1j])
def test_parameters_that_are_not_positive_numbers_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        PullOut(**GOOD | {name: value})


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"r_matrix": 1.0}, "r_matrix"),
        ({"slip_end": 1e-4}, "slip_end"),
        ({"support": "push-push"}, "support"),
        ({"extra_compliance": -1e-12}, "extra_compliance"),
    ],
)
def test_contradictory_parameters_are_refused(wrong, says):
    with pytest.raises(InputError, match=says):
        PullOut(**GOOD | wrong)


@pytest.mark.parametrize(
    "call",
    [
        lambda: CLEAN.state(-1e-9),
        lambda: CLEAN.state(float("nan")),
        lambda: CLEAN.state_at_load(1.001 * CLEAN.peak().load),
        lambda: CLEAN.state_at_load(-1.0),
        lambda: CLEAN.state_at_displacement(-1e-9),
        lambda: CLEAN.path(19),
        lambda: CLEAN.path(100.0),
        lambda: CLEAN.with_shear_compliance(-1e-12),
        lambda: CLEAN.with_shear_compliance(1.001 * 3e-4 / 6e3),
        lambda: CLEAN.with_axial_stiffness(0.0, 1.0),
        lambda: CLEAN.state(2e-4).slip([1.0, 30.1]),
        lambda: CLEAN.state(2e-4).slip([-0.1, 1.0]),
        lambda: CLEAN.state(2e-4).fibre_force(np.array([1.0, np.nan])),
        lambda: CLEAN.state(2e-4).shear(np.array([1.0, None])),
        lambda: CLEAN.state(2e-4).shear(np.ma.masked_array([1.0, 2.0], [False, True])),
        lambda: CLEAN.bond_stress([np.inf]),
        lambda: shear_lag_compliance(1.0, 1.0, 1e9, 1e9),
        lambda: shear_lag_compliance(1.0, 6.0, 0.0, 1e9),
    ],
)
def test_questions_without_an_answer_are_refused(call):
    with pytest.raises(InputError):
        call()


def test_positions_that_miss_the_ends_by_round_off_are_accepted():
    state = CLEAN.state(2e-4)
    np.testing.assert_array_equal(state.slip([-1e-12, 30.0 + 1e-12]), state.slip([0.0, 30.0]))


def test_path_holds_as_many_states_as_asked_for():
    for n in (20, 37, 400):
        assert {len(a) for a in vars(CLEAN.path(n)).values()} == {n}
    assert CLEAN.peak().load == pytest.approx(CLEAN.path(20).load.max(), rel=1e-12)
    assert CLEAN.turning_point().displacement == pytest.approx(CLEAN.path(20).displacement.max(), rel=1e-12)


def test_softening_zone_of_a_long_bond_has_its_known_length():
    test = replace(PUSHED, length=40.0 / PUSHED.lam)
    state, x = test.state_at_displacement(3 * test.slip_end), np.linspace(0.0, test.length, 100_001)
    slip = state.slip(x)
    zone = np.ptp(x[(slip > test.slip_peak) & (slip < test.slip_end)])
    assert tan(test.omega * zone) == pytest.approx(sqrt((test.slip_end - test.slip_peak) / test.slip_peak), rel=1e-2)
