"""Pull-out of a fibre through a bilinear interface, with or without friction: its equilibrium path in closed form.

The equations are at the head of `specimen.py`: s'' = c tau(s) with s'(0) = -g0 P and s'(L) = gL P. Every equilibrium
state has one section x_m of least slip S, from which the slip grows to both sides as v(y) = ds/dy, so that

    gL v(x_m) = g0 v(L - x_m)  gives x_m,      P = a_s [v(x_m) + v(L - x_m)],
    pull-pull  u = (1 - alpha) s(L) + alpha s(0) + P L/(a_f + a_m)      pull-push  u = s(L)

and S only grows along the path. Sweeping it from 0 to sf therefore passes load maxima and snap-back like any other
state: no arc-length is needed, and no list of stages. Without friction no slip on the way falls inside a softening
zone, so a bond that unloads to the origin (damage) gives the same states as a reversible one, and the work of the load
is p L G_f however the curve turns.

With friction the load ends at p L tau_r, under which the fibre slides out. The same holds but for a part of the path:
while the displacement snaps back, debonded sections slip back too, and there friction would hold them. Such states
(`slips_back`) are those of a reversible bond. A test under rising displacement never meets them: from the turning point
it falls to states where every section has slipped further.

Extreme points are roots of dP/dS and du/dS, from w = ds/d(ln S) at a fixed y (see `zones.py`) and x_m' = dx_m/d(ln S):

    c (gL tau(x_m) + g0 tau(L - x_m)) x_m' = g0 w'(L - x_m) - gL w'(x_m)
    (gL tau(x_m) + g0 tau(L - x_m)) dP/d(ln S) = w'(x_m) tau(L - x_m) + w'(L - x_m) tau(x_m)

Once no section is elastic, w' <= 0: the load only falls. While one is, friction lets it grow beyond first debonding.

The equation and its piecewise solutions are those of Gopalaratnam & Cheng 1987 (Mat. Res. Soc. Proc. 114, 225:
softening pull-out) and Yuan, Teng, Seracino, Wu & Yao 2004 (Eng. Struct. 26, 553: bonded joints, full range); the
common form by least slip, for both supports, was derived for this package.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from pybondem.check import nonnegative, whole_number
from pybondem.errors import InputError
from pybondem.theory.specimen import Floats, Specimen
from pybondem.theory.states import LoadPoint, PullOutPath, PullOutState
from pybondem.theory.zones import Side, side

_ROUND_OFF = 8.0 * float(np.finfo(np.float64).eps)
_AT_A_KINK = 1e-12  # relative: slips this close to s0 or sf count as there


class _Response(NamedTuple):
    """Equilibrium states, one per least slip."""

    section: Floats  # x_m [m]
    load: Floats  # P [N]
    displacement: Floats  # u [m]
    dissipated: Floats  # [J]
    load_growth: Floats  # dP/d(ln S) [N]
    displacement_growth: Floats  # du/d(ln S) [m]
    slips_back: NDArray[np.bool_]
    tip: Side
    end: Side


@dataclass(frozen=True)
class PullOut(Specimen):
    """A pull-out test in SI units, solved exactly: its whole path, its extreme points and any single state.

    Parameters
    ----------
    E_fibre, E_matrix : Young's moduli [Pa].
    r_fibre, r_matrix : radius of the fibre and outer radius of the matrix around it [m].
    length : bonded length L [m].
    stiffness : bond stiffness k [Pa/m] before the peak.
    slip_peak, slip_end : slip s0 at the peak stress and sf where softening ends, at tau_r [m]; s0 < sf.
    support : "pull-pull" holds the matrix at the fibre's tip (x = 0), "pull-push" at the loaded face (x = L).
    extra_compliance : of whatever lies in series, such as l_free/a_f of a free fibre end [m/N].
    residual_stress : friction tau_r [Pa] that stays from sf on, 0 <= tau_r < k s0; 0 is a bond that comes to nothing.

    Raises
    ------
    InputError : a number is not finite or out of range, or the support is unknown.
    """

    # ---- points of the load-displacement curve -----------------------------------------------------------------------

    def onset_load(self) -> float:
        """Return P_1 [N], where a first section reaches tau_max: lam s0 sinh(lam L)/(gL cosh(lam L) + g0).

        That section is the loaded end; for rho > 1 it is the tip, and g0 and gL change places.
        """
        decay = math.exp(-self.lam * self.length)
        one_over_cosh = 2.0 * decay / (1.0 + decay**2)
        large, small = max(self.g_end, self.g_tip), min(self.g_end, self.g_tip)
        return self.lam * self.slip_peak * math.tanh(self.lam * self.length) / (large + small * one_over_cosh)

    def long_bond_load(self) -> float:
        """Return P_inf = sqrt(2 p G/a_s)/max(gL, g0) [N], at which a long bond begins to debond: fracture mechanics.

        G is the area under the bond law up to sf. Without friction it is G_f, and P_inf the peak load of a long bond;
        with friction every debonded metre adds p tau_r/(a_s max(gL, g0)).
        """
        up_to_end = 0.5 * (self.tau_max * self.slip_end + self.residual_stress * (self.slip_end - self.slip_peak))
        return math.sqrt(2.0 * self.p * up_to_end / self.a_series) / max(self.g_end, self.g_tip)

    def peak(self) -> LoadPoint:
        """Return the largest load [N] and the displacement there [m]."""
        return self._point(self._peak)

    @cached_property
    def snaps_back(self) -> bool:
        """Whether the displacement turns back along the path: whether du/dS < 0 at S = s0, as it is there if anywhere.

        Without an elastic zone (S >= s0) and without friction every slip is sf - (sf - S) f(x): the path ends as a
        straight line to (u, P) = (sf, 0), which comes from larger displacements. With friction this line bends forward
        again and passes S = sf under the constant load p L tau_r.
        """
        growth = self._respond(self._log_slip([self._softened])).displacement_growth[0]
        return bool(growth < -_AT_A_KINK * self.slip_peak)

    def turning_point(self) -> LoadPoint | None:
        """Return load and displacement where snap-back begins; None without snap-back.

        Without friction this is the largest displacement of the path.
        """
        return self._point(self._turn) if self.snaps_back else None

    @property
    def residual_load(self) -> float:
        """p L tau_r: load of the fibre that slides out, all debonded [N]."""
        return self.p * self.length * self.residual_stress

    @property
    def work_of_debonding(self) -> float:
        """p L G_f: work that the cohesion takes; without friction the work of the load over the whole test [J]."""
        return self.p * self.length * self.fracture_energy

    # ---- states ------------------------------------------------------------------------------------------------------

    def state(self, least_slip: float) -> PullOutState:
        """Return the equilibrium state of least slip S [m]; from sf on, all is debonded and slides.

        Raises
        ------
        InputError : S is negative or not finite.
        """
        S = nonnegative("least_slip", least_slip, "m")
        return self._state(math.log(S / self.slip_peak) if S > 0.0 else -math.inf)

    def state_at_load(self, load: float, rising: bool = True) -> PullOutState:
        """Return the state at a load P [N] before (`rising`) or after the peak.

        Raises
        ------
        InputError : the load is negative, not finite, above the peak load, or after the peak below the residual load.
        """
        P, peak, least = nonnegative("load", load, "N"), self.peak().load, 0.0 if rising else self.residual_load
        if not least * (1.0 - _AT_A_KINK) <= P <= peak:
            rest = f", and friction keeps {least!r} N after it; give a load between" if least else ", give 0 to that"
            raise InputError(f"load is {P!r} N; the peak load of this pull-out is {peak!r} N{rest}.")
        ends = (-1.0, self._peak) if rising else (self._peak, self._end)
        return self._state_where(lambda at: self._point(at).load - P, *ends)

    def state_at_displacement(self, displacement: float) -> PullOutState:
        """Return the state that a slowly raised end displacement u [m] reaches.

        Up to the turning point it lies on the path. There the load falls at once to the rest of the path that comes
        back to larger displacements, or to nothing where there is no friction and the fibre comes out.

        Raises
        ------
        InputError : the displacement is negative or not finite.
        """
        u = nonnegative("displacement", displacement, "m")

        def miss(at: float) -> float:
            return self._point(at).displacement - u

        if miss(self._turn) >= 0.0:
            return self._state_where(miss, -1.0, self._turn)
        beyond = -miss(self._end)
        if beyond >= 0.0:
            return self.state(self.slip_end + beyond)
        return self._state_where(miss, self._return, self._end)

    def path(self, n: int = 400) -> PullOutPath:
        """Return n >= 20 states of the whole path, evenly spaced along the load-displacement curve.

        It ends at S = sf, where the last section has debonded. Onset, peak, turning point and the one where snap-back
        ends, loss of the last elastic section and the end are among them exactly.

        Raises
        ------
        InputError : n is not a whole number >= 20.
        """
        n = whole_number("n", n, least=20)
        marks = np.unique([-1.0, 0.0, self._peak, self._turn, self._softened, self._return, self._end])
        within = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n))  # dense at the marks, where stages change fast
        trial = (marks[:-1, None] + np.diff(marks)[:, None] * within).ravel()
        curve = self._respond(self._log_slip(trial))
        steps = np.hypot(np.diff(curve.load) / curve.load.max(), np.diff(curve.displacement) / curve.displacement.max())
        arc = np.append(0.0, np.cumsum(steps))
        between = np.interp(np.linspace(0.0, arc[-1], n - marks.size + 2)[1:-1], arc, trial)
        log_slip = self._log_slip(np.sort(np.append(marks, between)))
        r = self._respond(log_slip)
        spent = r.dissipated if self.residual_stress else np.maximum.accumulate(r.dissipated)  # evens out round-off
        zones = self._zones(log_slip, r)
        return PullOutPath(self.least_slip(log_slip), r.section, r.load, r.displacement, spent, zones, r.slips_back)

    # ---- equilibrium -------------------------------------------------------------------------------------------------

    def _section(self, log_slip: Floats) -> Floats:
        """Solve gL v(x) = g0 v(L - x) for x = x_m by Newton steps within a shrinking bracket.

        The left side grows with x and the right side falls, so the root is unique. (Two equal plateaus, where rho = 1
        and both ends have debonded, keep the middle by symmetry.)
        """
        x = np.full_like(log_slip, self._elastic_section)
        if self.g_tip == 0.0:
            return x
        low, high = np.zeros_like(x), np.full_like(x, self.length)
        for _ in range(100):
            tip, end = side(self, log_slip, x), side(self, log_slip, self.length - x)
            miss = self.g_end * tip.slope - self.g_tip * end.slope
            rate = self.c * (self.g_end * self._tau(tip.slip) + self.g_tip * self._tau(end.slip))
            found = np.abs(miss) <= _ROUND_OFF * self.length * rate
            if found.all():
                break
            low, high = np.where(miss <= 0.0, x, low), np.where(miss >= 0.0, x, high)
            newton = x - np.divide(miss, rate, out=np.full_like(x, np.inf), where=np.abs(miss) < rate * self.length)
            better = np.where((low < newton) & (newton < high), newton, 0.5 * (low + high))
            x = np.where(found, x, better)
        return x

    def _respond(self, log_slip: Floats) -> _Response:
        """Return the equilibrium states of the given least slips (n)."""
        x = self._section(log_slip)
        tip, end = side(self, log_slip, x), side(self, log_slip, self.length - x)
        load = self.a_series * (tip.slope + end.slope)
        displacement = end.slip + load * self.extra_compliance
        if self.support == "pull-pull":
            displacement += self.alpha * (tip.slip - end.slip) + load * self.length / (self.a_fibre + self.a_matrix)
        dissipated = self.p * self.fracture_energy * (tip.parted + end.parted)
        dissipated += self.p * self.residual_stress * (tip.slid + end.slid)
        return _Response(x, load, displacement, dissipated, *self._growth(tip, end), tip, end)

    def _growth(self, tip: Side, end: Side) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Return dP/d(ln S), du/d(ln S), and whether a debonded section slips back against friction.

        In a debonded zone the growth of slip is linear, so that an end of the bond is the first to slip back.
        """
        tau_tip, tau_end = self._tau(tip.slip), self._tau(end.slip)
        resists = self.g_end * tau_tip + self.g_tip * tau_end
        fixed = (resists == 0.0) | (self.g_tip == 0.0)  # x_m, also by symmetry where both ends debonded, tau_r = 0
        over = 1.0 / np.where(fixed, 1.0, resists)
        shift = np.where(fixed, 0.0, over / self.c * (self.g_tip * end.slope_growth - self.g_end * tip.slope_growth))
        load = over * (tip.slope_growth * tau_end + end.slope_growth * tau_tip)
        load = np.where(fixed, self.a_series * (tip.slope_growth + end.slope_growth), load)
        at_tip, at_end = tip.slip_growth + tip.slope * shift, end.slip_growth - end.slope * shift
        back = [(s.slip > self.slip_end) & (at < -_AT_A_KINK * s.slip) for s, at in ((tip, at_tip), (end, at_end))]
        displacement = at_end + load * self.extra_compliance
        if self.support == "pull-pull":
            displacement += self.alpha * (at_tip - at_end) + load * self.length / (self.a_fibre + self.a_matrix)
        return load, displacement, (back[0] | back[1]) & (self.residual_stress > 0.0)

    def _zones(self, log_slip: Floats, r: _Response) -> tuple[str, ...]:
        """Return the zones from tip to loaded end."""

        def rank(slip: Floats, tolerance: float) -> NDArray[np.intp]:
            return np.sum([slip >= kink * (1.0 + tolerance) for kink in (self.slip_peak, self.slip_end)], axis=0)

        core = rank(self.least_slip(log_slip), -_AT_A_KINK)
        tip, end = (np.maximum(rank(side.slip, _AT_A_KINK), core) for side in (r.tip, r.end))
        return tuple("ESD"[c : t + 1][::-1] + "ESD"[c + 1 : e + 1] for c, t, e in zip(core, tip, end, strict=True))

    def _state(self, log_slip: float) -> PullOutState:
        at = np.array([log_slip])
        r = self._respond(at)
        slip, x, load, displacement, dissipated = (
            float(v[0]) for v in (self.least_slip(at), r.section, r.load, r.displacement, r.dissipated)
        )
        zones, back = self._zones(at, r)[0], bool(r.slips_back[0])
        return PullOutState(self, log_slip, slip, x, load, displacement, dissipated, zones, back)

    # ---- progress along the path -------------------------------------------------------------------------------------
    # One number orders all states: -1 is P = 0, up to 0 the interface is elastic and S proportional to 1 + progress,
    # from there on ln S grows with progress.

    def _log_slip(self, progress: ArrayLike) -> Floats:
        """Return ln(S/s0)."""
        at = np.asarray(progress, dtype=np.float64)
        with np.errstate(divide="ignore"):
            return self._log_slip_at_onset + np.where(at < 0.0, np.log1p(np.minimum(at, 0.0)), at)

    def _point(self, progress: float) -> LoadPoint:
        r = self._respond(self._log_slip([progress]))
        return LoadPoint(float(r.load[0]), float(r.displacement[0]))

    def _state_where(self, miss: Callable[[float], float], low: float, high: float) -> PullOutState:
        """Return the state between two progresses where `miss` changes sign."""
        at_low, at_high = miss(low), miss(high)
        if at_low * at_high < 0.0:
            at = brentq(miss, low, high, xtol=1e-15, rtol=_ROUND_OFF, maxiter=1000)
        else:  # an end itself is wanted, up to round-off
            at = low if abs(at_low) <= abs(at_high) else high
        return self._state(float(self._log_slip(at)))

    @cached_property
    def _elastic_section(self) -> float:
        """x_m while all is elastic: gL sinh(lam x) = g0 sinh(lam (L - x))."""
        if self.g_tip == 0.0:
            return 0.0
        decay = math.exp(-self.lam * self.length)
        ends = math.log((self.g_tip + self.g_end * decay) / (self.g_end + self.g_tip * decay))
        return min(max(0.5 * (self.length + ends / self.lam), 0.0), self.length)

    @cached_property
    def _log_slip_at_onset(self) -> float:
        """ln(S/s0) = -ln cosh(lam y) with y the distance of the farther end."""
        z = self.lam * max(self._elastic_section, self.length - self._elastic_section)
        return math.log(2.0) - z - math.log1p(math.exp(-2.0 * z))

    @cached_property
    def _softened(self) -> float:
        """Progress where the last elastic section is lost, S = s0."""
        return -self._log_slip_at_onset

    @cached_property
    def _end(self) -> float:
        """Progress where the last section has debonded, S = sf."""
        return math.log(self.slip_end / self.slip_peak) - self._log_slip_at_onset

    @cached_property
    def _peak(self) -> float:
        """Progress at the largest load, dP/dS = 0: growing at onset, falling once no section is elastic.

        In pull-push before any section debonds this is tan(phi) = (lam/omega) tanh(lam a), a the elastic length (Yuan
        et al. 2004, eq. for the ultimate load). In a long bond without friction the growth then underflows: it counts
        as negative.
        """

        def growth(progress: float) -> float:
            found = float(self._respond(self._log_slip([progress])).load_growth[0])
            return found if found > 0.0 else min(found, -1e-300)

        return self._root(growth, 0.0, self._softened)

    @cached_property
    def _turn(self) -> float:
        """Progress at the turning point, or else the end: up to there the displacement only grows."""
        return self._root(self._displacement_growth, 0.0, self._softened) if self.snaps_back else self._end

    @cached_property
    def _return(self) -> float:
        """Progress where snap-back ends; without friction, and without snap-back, the end."""
        if self.residual_stress == 0.0 or not self.snaps_back:
            return self._end
        return self._root(self._displacement_growth, self._softened, self._end)

    def _displacement_growth(self, progress: float) -> float:
        return float(self._respond(self._log_slip([progress])).displacement_growth[0])

    def _root(self, growth: Callable[[float], float], low: float, high: float) -> float:
        return float(brentq(growth, low, high, xtol=1e-15, rtol=_ROUND_OFF, maxiter=1000))
