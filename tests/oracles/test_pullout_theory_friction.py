"""The pull-out solution with friction against integration, a discrete model, energy and closed forms of its own."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from numpy import acos, arccosh, arctan2, pi, sqrt
from oracles.two_chains import TwoChains
from scipy.integrate import quad, solve_ivp

from pybondem.errors import InputError
from pybondem.theory import PullOut

CLEAN = PullOut(1e10, 1e10, 1.0, 6.0, 30.0, stiffness=6e7, slip_peak=1e-4, slip_end=4e-4, residual_stress=1.5e3)
TIP_FIRST = replace(CLEAN.with_axial_stiffness(4e10, 1.5e10), residual_stress=3e3)
PUSHED = PullOut(2e10, 4e9, 0.5, 3.0, 12.0, 4e8, 2e-4, 7e-4, support="pull-push", residual_stress=1e4)
LONG = replace(PUSHED, length=30.0, slip_end=3e-4, residual_stress=2.4e4)  # the load grows long after first debonding
SHORT = replace(CLEAN, length=20.0, residual_stress=4.5e3)
CASES = {"clean": CLEAN, "tip first": TIP_FIRST, "pushed": PUSHED, "long": LONG, "short": SHORT}


def bond_stress(test, slip):
    """The bond law, written once more."""
    top, left = test.stiffness * test.slip_peak, test.residual_stress
    return np.interp(slip, [0.0, test.slip_peak, test.slip_end], [0.0, top, left])


def random_tests(n, seed):
    """Tests over a wide range: lam L 0.4 to 25, sf/s0 1.1 to 30, a_f/a_m 0.1 to 10, tau_r 0 to 0.9 tau_max."""
    rng = np.random.default_rng(seed)
    for case in range(n):
        lam_length, ratio, rho = 10 ** rng.uniform((-0.4, -1, -1), (1.4, 1.5, 1))
        test = CLEAN.with_axial_stiffness(3e10, 3e10 / rho)
        stiffness = (lam_length / test.length) ** 2 / test.c
        yield replace(
            test,
            stiffness=stiffness,
            slip_end=test.slip_peak * (1 + ratio),
            support=("pull-pull", "pull-push")[rng.integers(2)],
            extra_compliance=rng.integers(2) * 10 ** rng.uniform(-1, 1) * test.length / test.a_fibre,
            residual_stress=(0.0, 0.9, *rng.uniform(0.01, 0.9, 4))[case % 6] * stiffness * test.slip_peak,
        )


def ends(test):
    """g0, gL."""
    return (1 / test.a_matrix, 1 / test.a_fibre) if test.support == "pull-pull" else (0.0, test.c / test.p)


def some_slips(test, rng, n=5):
    """Least slips from every stage: logarithmic before s0, then linear, and one of the sliding fibre."""
    onset = test.state_at_load(test.onset_load()).least_slip
    before = np.exp(rng.uniform(np.log(0.3 * onset), np.log(test.slip_peak), n))
    after = rng.uniform(test.slip_peak, test.slip_end, n // 2)
    return np.concatenate([before, after, [1.7 * test.slip_end]])


# ---- the differential equation ---------------------------------------------------------------------------------------


def integrated(test, S, x_from, x_to):
    """Positions, slips and slopes from a section of least slip outward by Runge-Kutta, a new start at every kink."""
    x, y, found = x_from, np.array([S, 0.0]), []
    kinks = [kink for kink in (test.slip_peak, test.slip_end) if kink > S]
    scale = np.array([1.0, test.lam])
    for kink in [*kinks, np.inf]:
        reached = lambda x, s, kink=kink: s[0] - kink if np.isfinite(kink) else 1.0  # noqa: E731
        reached.terminal = True
        out = solve_ivp(
            lambda x, s: (s[1], test.c * bond_stress(test, s[0])),
            (x, x_to), y, "DOP853", events=reached, rtol=1e-11, atol=1e-13 * S * scale, dense_output=True,
        )  # fmt: skip
        at = np.linspace(x, out.t[-1], 5)
        found.append(np.vstack([at, out.sol(at)]))
        x, y = out.t[-1], out.y[:, -1]
        if out.status == 0:
            break
    return np.hstack(found)


@pytest.mark.parametrize("seed", range(4))
def test_every_state_solves_the_equation_and_meets_both_ends(seed):
    rng = np.random.default_rng(100 + seed)
    for test in random_tests(6, seed):
        g_tip, g_end = ends(test)
        for S in some_slips(test, rng):
            state, slopes = test.state(S), [0.0, 0.0]
            largest = max(test.slip_end, float(state.slip([0.0, test.length]).max()))
            for which, end in enumerate((0.0, test.length)):
                if end != state.section:
                    x, slip, slope = integrated(test, S, state.section, end)
                    np.testing.assert_allclose(state.slip(x), slip, rtol=0, atol=1e-8 * largest)
                    np.testing.assert_allclose(
                        state.shear(x), bond_stress(test, slip), rtol=0,
                        atol=1e-7 * test.tau_max * max(1.0, largest / (test.slip_end - test.slip_peak)),
                    )  # fmt: skip
                    slopes[which] = slope[-1]
            steepest = max(map(abs, slopes))
            assert slopes[0] == pytest.approx(-g_tip * state.load, abs=1e-7 * steepest)
            assert slopes[1] == pytest.approx(g_end * state.load, abs=1e-7 * steepest)


@pytest.mark.parametrize("name", CASES)
def test_forces_and_displacements_along_both_bars(name):
    test = replace(CASES[name], extra_compliance=1e-10)
    x = np.linspace(0.0, test.length, 8001)
    for S in some_slips(test, np.random.default_rng(5)):
        state = test.state(S)
        N_f, tau = state.fibre_force(x), bond_stress(test, state.slip(x))
        N_m = (state.load if test.support == "pull-pull" else 0.0) - N_f
        assert N_f[[0, -1]] == pytest.approx([0.0, state.load], abs=1e-12 * state.load)

        def summed(rate):
            return np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(x)))

        u_f, u_m = state.fibre_displacement(x), state.matrix_displacement(x)
        np.testing.assert_allclose(N_f, test.p * summed(tau), rtol=0, atol=1e-5 * state.load)
        np.testing.assert_allclose(u_f - u_f[0], summed(N_f) / test.a_fibre, rtol=0, atol=1e-5 * u_f[-1])
        np.testing.assert_allclose(u_m - u_m[0], summed(N_m) / test.a_matrix, rtol=0, atol=1e-5 * u_f[-1])
        assert u_f[-1] + 1e-10 * state.load == pytest.approx(state.displacement, rel=1e-12)


# ---- a discrete model ------------------------------------------------------------------------------------------------


FAR = {"stub": replace(PUSHED, length=6.0, residual_stress=2.4e4), "plug": replace(SHORT, length=24.0)}


@pytest.mark.parametrize("name", CASES | FAR)
def test_path_profile_and_dissipation_agree_with_two_chains_of_springs(name):
    """Cohesion that damages beside friction that slides, each with its memory, by pseudo-arc-length; as far as no
    debonded section slips back."""
    test = (CASES | FAR)[name]
    chains, peak = TwoChains(test, n=1000 if name == "long" else 400), test.peak()
    x, seen, loads, farthest = np.linspace(0.0, test.length, chains.n + 1), [], [], 0.0
    s0, sf, farthest_of_path = test.slip_peak, test.slip_end, test.path(20).displacement.max()
    for P, slip, v, kappa in chains.states(step=0.01):
        state = test.state(float(slip.min()))
        if state.slips_back:
            break
        seen.append(state.zones)
        loads.append(P)
        farthest = max(farthest, v[-2])
        assert state.load == pytest.approx(P, abs=3e-4 * peak.load)
        assert state.displacement == pytest.approx(v[-2], abs=3e-4 * farthest_of_path)
        np.testing.assert_allclose(state.shear(x), chains.bond(slip, kappa)[0], rtol=0, atol=1.5e-3 * test.tau_max)
        broken = test.fracture_energy * np.clip((kappa - s0) / (sf - s0), 0.0, 1.0)
        rubbed = test.residual_stress * np.maximum(kappa - s0, 0.0)
        spent = chains.area @ (broken + rubbed)
        assert state.dissipated == pytest.approx(spent, abs=3e-4 * max(test.work_of_debonding, spent))
    assert len(seen) > 40
    assert max(loads) == pytest.approx(peak.load, rel=1e-3)
    assert state.slips_back == test.snaps_back
    if test.snaps_back:
        assert farthest == pytest.approx(test.turning_point().displacement, rel=1e-3)
    expected = {
        "clean": ["E", "ES", "ESD"],
        "tip first": ["E", "SE", "DSE"],
        "pushed": ["E", "ES", "ESD"],
        "long": ["E", "ES", "ESD"],
        "short": ["E", "ES", "S", "SD"],
        "stub": ["E", "ES", "S", "SD"],
        "plug": ["E", "ES", "ESD", "SD"],
    }
    words = [word for word, _ in groupby(seen)]
    assert [word for word in words if word in expected[name]] == expected[name]


# ---- energy ----------------------------------------------------------------------------------------------------------


def bond_energy(test, slip):
    """Stored per area by cohesion that has damaged and by friction that slides."""
    s0, friction = test.slip_peak, test.residual_stress
    cohesive = np.where(slip < s0, (test.tau_max - friction) * slip / s0, bond_stress(test, slip) - friction)
    return 0.5 * cohesive * slip + 0.5 * friction * np.minimum(slip, s0) ** 2 / s0


def stored(test, state):
    """Strain energy of both bars, of what lies in series and of the bond, by quadrature between the kinks of slip."""
    x = np.linspace(0.0, test.length, 6001)
    x = np.union1d(x, state.section)
    x = 0.5 * (x[1:] + x[:-1]), np.diff(x)
    N_f = state.fibre_force(x[0])
    N_m = (state.load if test.support == "pull-pull" else 0.0) - N_f
    bars = 0.5 * x[1] @ (N_f**2 / test.a_fibre + N_m**2 / test.a_matrix)
    return bars + 0.5 * test.extra_compliance * state.load**2 + test.p * x[1] @ bond_energy(test, state.slip(x[0]))


@pytest.mark.parametrize("seed", range(3))
def test_work_of_the_load_is_dissipated_or_stored_at_every_state(seed):
    for test in random_tests(8, 50 + seed):
        path = test.path(20_000)
        P, u = path.load, path.displacement
        work = np.append(0.0, np.cumsum(0.5 * (P[1:] + P[:-1]) * np.diff(u)))
        for k in np.linspace(0, len(u) - 1, 12, dtype=int):
            state = test.state(path.least_slip[k])
            assert work[k] == pytest.approx(state.dissipated + stored(test, state), abs=3e-6 * work.max())
            assert state.dissipated == pytest.approx(path.dissipated[k], abs=1e-9 * work.max())
        assert P[-1] == pytest.approx(test.p * test.length * test.residual_stress, abs=1e-7 * P.max())
        assert path.least_slip[-1] == pytest.approx(test.slip_end, rel=1e-12)
        assert path.zones[-1] == "D"


@pytest.mark.parametrize("name", CASES)
def test_least_slip_and_dissipation_only_grow_and_no_slip_beyond_the_peak_falls(name):
    test = CASES[name]
    path, x = test.path(300), np.linspace(0.0, test.length, 201)
    assert np.all(np.diff(path.least_slip) > 0.0)
    assert np.all((np.diff(path.dissipated) >= 0.0) | path.slips_back[1:] | path.slips_back[:-1])
    slips = np.array([test.state(S).slip(x) for S in path.least_slip])
    falling = np.diff(slips, axis=0) < -1e-11 * slips[:-1]
    back = (falling & (slips[:-1] > test.slip_peak)).any(axis=1)
    np.testing.assert_array_equal(back[path.slips_back[:-1] & path.slips_back[1:]], True)
    np.testing.assert_array_equal(back[~path.slips_back[:-1] & ~path.slips_back[1:]], False)
    assert test.snaps_back == path.slips_back.any() == (name != "short")
    assert [test.state(S).slips_back for S in path.least_slip] == path.slips_back.tolist()


@pytest.mark.parametrize("seed", range(2))
def test_under_rising_displacement_no_debonded_section_ever_slips_back(seed):
    """So that friction has only slid forwards in all the states that a test meets, and up to the peak load."""
    fell = 0
    for test in random_tests(6, 902 + seed):
        path, x = test.path(60), np.linspace(0.0, test.length, 101)
        turn = test.turning_point()
        u = np.union1d(path.displacement, [0.9999 * turn.displacement, 1.0001 * turn.displacement] if turn else [])
        states = [test.state_at_displacement(v) for v in u]
        slips = np.array([state.slip(x) for state in states])
        debonded = slips[:-1] > test.slip_end
        assert not ((np.diff(slips, axis=0) < -1e-9 * slips[:-1]) & debonded).any()
        assert not any(state.slips_back for state in states)
        assert not path.slips_back[: path.load.argmax() + 1].any()
        assert not path.slips_back.any() or turn
        fell += path.slips_back.any()
    assert fell > 1


# ---- peak and turning points -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_peak_and_turning_points_are_the_extremes_of_a_sweep(seed):
    for test in random_tests(12, 300 + seed):
        path = test.path(6000)
        P, u, peak, turn = path.load, path.displacement, test.peak(), test.turning_point()
        assert P.max() == pytest.approx(peak.load, rel=1e-12)
        assert u[P.argmax()] == pytest.approx(peak.displacement, rel=1e-6)
        assert np.count_nonzero(np.diff(np.sign(np.diff(P)[np.abs(np.diff(P)) > 1e-12 * P.max()]))) == 1
        back = np.diff(u) < -1e-10 * u.max()
        assert (turn is not None) == test.snaps_back == back.any()
        if turn:
            first, last = np.flatnonzero(back)[[0, -1]]
            assert back[first : last + 1].all()
            assert u[first] == pytest.approx(turn.displacement, rel=1e-9)
            assert P[first] == pytest.approx(turn.load, abs=1e-4 * peak.load)


def test_pull_push_peak_after_debonding_has_a_closed_form():
    """d(load)/dS = 0 where (S/s0)^2 / sqrt(1 + (1 - S^2/s0^2) lam^2/omega^2) = tau_r/tau_max: a quadratic in S^2."""
    late = 0
    for test in random_tests(60, 21):
        test = replace(test, support="pull-push", length=4.0 * test.length)
        r, k, s0, sf, L = (
            test.residual_stress / test.tau_max,
            test.stiffness,
            test.slip_peak,
            test.slip_end,
            test.length,
        )
        lam = sqrt(test.c * k)
        w2 = s0 * (1 - r) / (sf - s0)  # (omega/lam)^2
        share = sqrt(0.5 * (sqrt(r**4 / w2**2 + 4 * r**2 * (1 + 1 / w2)) - r**2 / w2)) if r else 0.0
        if share == 0.0:
            continue
        elastic = arccosh(1 / share) / lam
        zero = s0 + (sf - s0) / (1 - r)  # where the falling line would end
        v_e = lam * s0 * sqrt(1 - share**2)
        size, ahead = np.hypot(zero - s0, v_e / (lam * sqrt(w2))), arctan2(v_e / (lam * sqrt(w2)), zero - s0)
        soft = (acos((zero - sf) / size) - ahead) / (lam * sqrt(w2))
        slides = L - elastic - soft
        if slides <= 0.0:  # it peaks before it debonds
            assert "D" not in test.state_at_load(test.peak().load).zones
            continue
        late += 1
        area = 0.5 * (k * s0 * sf + r * k * s0 * (sf - s0)) - 0.5 * k * (share * s0) ** 2  # from S to sf
        v_d = sqrt(2 * test.c * area)
        P = (v_d + test.c * r * k * s0 * slides) / (test.c / test.p)
        u = sf + v_d * slides + 0.5 * test.c * r * k * s0 * slides**2 + test.extra_compliance * P
        assert test.peak() == pytest.approx((P, u), rel=1e-8)
        assert test.state_at_load(test.peak().load).zones == "ESD"
    assert late > 15


def test_every_debonded_metre_of_a_long_bond_adds_its_friction():
    """Fracture mechanics with the area under the law up to sf, and p tau_r for each metre that slides."""
    for support, weaker in (("pull-push", PUSHED.a_series), ("pull-pull", min(PUSHED.a_fibre, PUSHED.a_matrix))):
        test = replace(PUSHED, length=80.0 / PUSHED.lam, support=support)
        up_to_end = quad(lambda s, test=test: bond_stress(test, s), 0.0, test.slip_end, points=[test.slip_peak])[0]
        start = sqrt(2 * test.p * up_to_end / test.a_series) * weaker
        assert test.long_bond_load() == pytest.approx(start, rel=1e-9)
        x = np.linspace(0.0, test.length, 200_001)
        for depth in (15.0, 20.0, 30.0):
            state = test.state(test.slip_peak * np.exp(-depth))
            slides = test.length - x[state.slip(x) >= test.slip_end][0]
            assert "E" in state.zones
            assert slides > 0.5
            wanted = start + test.p * test.residual_stress * slides * weaker / test.a_series
            assert state.load == pytest.approx(wanted, rel=1e-4)


def test_critical_length_of_pull_push_with_friction():
    """du/dS at S = s0: cos(phi) - sin(phi) (omega L - phi) with cos(phi) = tau_r/tau_max, zero at that length."""
    for r in (0.05, 0.3, 0.7):
        test = replace(PUSHED, residual_stress=r * PUSHED.tau_max)
        omega = sqrt(test.c * test.stiffness * test.slip_peak * (1 - r) / (test.slip_end - test.slip_peak))
        critical = (acos(r) + r / sqrt(1 - r**2)) / omega
        assert not replace(test, length=0.999 * critical).snaps_back
        assert replace(test, length=1.001 * critical).snaps_back


# ---- the ends of the range -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("support", ["pull-pull", "pull-push"])
def test_little_friction_is_none(support):
    none = replace(CLEAN, support=support, residual_stress=0.0)
    little = replace(none, residual_stress=1e-9 * none.tau_max)
    assert little.peak() == pytest.approx(none.peak(), rel=1e-7)
    assert little.turning_point() == pytest.approx(none.turning_point(), rel=1e-5)
    for S in some_slips(none, np.random.default_rng(2)):
        a, b = little.state(S), none.state(S)
        assert (a.load, a.displacement) == pytest.approx((b.load, b.displacement), rel=1e-6, abs=1e-8 * b.displacement
                                                         + 1e-8 * none.peak().load * (b.load == 0.0))  # fmt: skip


def test_friction_of_nearly_the_strength_is_a_plateau():
    """Slip beyond s0 grows as a parabola."""
    test = replace(PUSHED, residual_stress=PUSHED.tau_max * (1 - 1e-7))
    S = 0.5 * test.slip_peak
    state, elastic = test.state(S), arccosh(2.0) / test.lam
    y = np.linspace(0.0, test.length - elastic, 9)
    slope = test.lam * test.slip_peak * sqrt(1 - 0.5**2)
    parabola = test.slip_peak + slope * y + 0.5 * test.c * test.tau_max * y**2
    np.testing.assert_allclose(state.slip(elastic + y), parabola, rtol=1e-6)


@pytest.mark.parametrize("support", ["pull-pull", "pull-push"])
@pytest.mark.parametrize("rho", [0.3, 1.0, 4.0])
def test_very_long_bond_where_cosh_overflows(support, rho):
    test = replace(CLEAN.with_axial_stiffness(3e10, 3e10 / rho), support=support)
    test = replace(test, length=3000.0 / test.lam)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        path = test.path(500)
        state = test.state_at_displacement(0.8 * test.turning_point().displacement)
        after = test.state_at_displacement(1.001 * test.turning_point().displacement)
    assert np.isfinite([path.load, path.displacement, path.dissipated]).all()
    assert path.load.max() > 5 * test.long_bond_load()
    assert state.fibre_force(test.length) == pytest.approx(state.load, rel=1e-9)
    assert after.load < test.turning_point().load
    x = np.linspace(0.0, test.length, 200_001)
    assert np.trapezoid(bond_stress(test, state.slip(x)), x) * test.p == pytest.approx(state.load, rel=1e-3)


@pytest.mark.parametrize("support", ["pull-pull", "pull-push"])
@pytest.mark.parametrize("lam_length", [40.0, 300.0, 3000.0])
def test_long_bond_without_friction_peaks_before_it_debonds(support, lam_length):
    """From there on the load stays but for less than round-off, while the displacement grows a hundredfold."""
    test = replace(CLEAN, residual_stress=0.0, support=support, length=lam_length / CLEAN.lam)
    per_load = test.length / (test.a_fibre + test.a_matrix) if support == "pull-pull" else 0.0
    alpha = test.alpha if support == "pull-pull" else 0.0
    P = test.long_bond_load()
    at_tip = ends(test)[0] * P / test.lam  # elastic there: s' = -g0 P
    debonds = (1 - alpha) * test.slip_end + alpha * at_tip + per_load * P
    assert test.turning_point().displacement > 1.2 * debonds
    assert test.peak() == pytest.approx((P, debonds), rel=1e-6)


# ---- sliding ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_after_full_debonding_the_load_stays(name):
    test = replace(CASES[name], extra_compliance=2e-10)
    g_tip, g_end = ends(test)
    P, last = test.p * test.length * test.residual_stress, test.state(test.slip_end)
    assert test.residual_load == pytest.approx(P, rel=1e-12)
    bend = 0.5 * test.c * test.residual_stress
    x_m, x = test.length * g_tip / (g_tip + g_end), np.linspace(0.0, test.length, 9)
    for S in np.array([1.0, 1.3, 20.0]) * test.slip_end:
        state = test.state(S)
        assert state.zones == "D"
        assert state.load == pytest.approx(P, abs=1e-7 * P)
        assert state.section == pytest.approx(x_m, rel=1e-9)
        np.testing.assert_allclose(state.slip(x), S + bend * (x - x_m) ** 2, rtol=1e-7)
        assert state.displacement - last.displacement == pytest.approx(S - test.slip_end, abs=1e-7 * S)
        rubbed = P * (state.displacement - last.displacement)
        assert state.dissipated - last.dissipated == pytest.approx(rubbed, abs=1e-6 * state.dissipated)
    far = test.state_at_displacement(30.0 * last.displacement)
    assert far.displacement == pytest.approx(30.0 * last.displacement, rel=1e-12)
    assert (far.load, far.zones) == (pytest.approx(P, rel=1e-12), "D")


def test_states_found_by_load_and_by_displacement_are_the_wanted_ones():
    jumped = 0
    for test in (*random_tests(18, 500), *CASES.values()):
        peak, turn, least = test.peak(), test.turning_point(), test.residual_load
        for share in (0.0, 0.1, 0.6, 0.99, 1.0):
            P = share * peak.load
            assert test.state_at_load(P).load == pytest.approx(P, abs=1e-10 * peak.load)
            P = least + share * (peak.load - least)
            falling = test.state_at_load(P, rising=False)
            assert falling.load == pytest.approx(P, abs=1e-8 * peak.load)
            assert falling.least_slip >= test.state_at_load(peak.load).least_slip * (1 - 1e-9)
        end = test.state(test.slip_end).displacement
        reach, before = turn.displacement if turn else end, -1.0
        for u in sorted({*(np.array([0.0, 0.3, 0.999, 1.0001, 1.2]) * reach), 0.999 * end, 1.001 * end}):
            state = test.state_at_displacement(u)
            assert state.displacement == pytest.approx(u, abs=1e-9 * max(reach, end))
            assert state.least_slip > before
            before = state.least_slip
            if turn and reach < u < end:
                jumped += 1
                higher = test.state(state.least_slip * (1 + 1e-6))
                assert higher.displacement > u  # where the path has come back to larger displacements
                assert state.least_slip > test.slip_peak
        if least:
            with pytest.raises(InputError, match="friction"):
                test.state_at_load(0.999 * least, rising=False)
    assert jumped > 1


# ---- constructions and refusals --------------------------------------------------------------------------------------


def test_series_compliance_adds_elastic_slip_on_all_three_lines():
    c_sl = 0.6 * (CLEAN.slip_end - CLEAN.slip_peak) / (CLEAN.tau_max - CLEAN.residual_stress)
    softer, slip = CLEAN.with_shear_compliance(c_sl), np.linspace(0.0, 2.0 * CLEAN.slip_end, 80)
    tau = bond_stress(CLEAN, slip)
    np.testing.assert_allclose(softer.bond_stress(slip + c_sl * tau), tau, rtol=0, atol=1e-12 * CLEAN.tau_max)
    assert softer.tau_max == pytest.approx(CLEAN.tau_max, rel=1e-12)
    assert softer.residual_stress == CLEAN.residual_stress
    assert softer.slip_peak == pytest.approx(CLEAN.slip_peak * (1 + CLEAN.stiffness * c_sl), rel=1e-12)
    assert softer.slip_end == pytest.approx(CLEAN.slip_end + c_sl * CLEAN.residual_stress, rel=1e-12)
    with pytest.raises(InputError, match="tau_max - tau_r"):
        CLEAN.with_shear_compliance(c_sl / 0.6 * 1.001)


def test_measured_axial_stiffness_keeps_the_friction():
    test = CLEAN.with_axial_stiffness(2e10, 6e11)
    assert (test.a_fibre, test.a_matrix, test.residual_stress) == pytest.approx((2e10, 6e11, 1.5e3), rel=1e-14)


def test_cohesion_and_friction_share_the_energy():
    assert CLEAN.fracture_energy == pytest.approx(0.5 * (6e3 - 1.5e3) * 4e-4, rel=1e-12)
    assert CLEAN.work_of_debonding == pytest.approx(2 * pi * 30.0 * 0.9, rel=1e-12)


@pytest.mark.parametrize("value", [-1.0, 6e3, 6.1e3, float("nan"), float("inf"), "3", None, True, np.ones(2)])
def test_friction_is_neither_negative_nor_as_large_as_the_strength(value):
    with pytest.raises(InputError, match="residual_stress"):
        replace(CLEAN, residual_stress=value)
