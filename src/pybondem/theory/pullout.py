"""Pull-out of a fibre through a bilinear cohesive interface: the complete equilibrium path in closed form.

The equations are at the head of `specimen.py`: s'' = c tau(s) with s'(0) = -g0 P and s'(L) = gL P. Every equilibrium
state has one section x_m of least slip S, from which the slip grows to both sides as v(y) = ds/dy, so that

    gL v(x_m) = g0 v(L - x_m)  gives x_m,      P = a_s [v(x_m) + v(L - x_m)],
    pull-pull  u = (1 - alpha) s(L) + alpha s(0) + P L/(a_f + a_m)      pull-push  u = s(L)

and S only grows along the path. Sweeping it from 0 to sf therefore passes load maxima and snap-back like any other
state: no arc-length is needed, and no list of stages. On the way no slip falls inside a softening zone, so a bond that
unloads to the origin (damage) gives the same states as a reversible one, and the work of the load is p L G_f however
the curve turns.

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
from scipy.optimize import brentq, minimize_scalar

from pybondem.check import nonnegative, whole_number
from pybondem.errors import InputError
from pybondem.theory.specimen import Floats, Side, Specimen
from pybondem.theory.states import LoadPoint, PullOutPath, PullOutState

_ROUND_OFF = 8.0 * float(np.finfo(np.float64).eps)
_AT_A_KINK = 1e-12  # relative: slips this close to s0 or sf count as there


class _Response(NamedTuple):
    """Equilibrium states, one per least slip."""

    section: Floats  # x_m [m]
    load: Floats  # P [N]
    displacement: Floats  # u [m]
    dissipated: Floats  # [J]
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
    slip_peak, slip_end : slip s0 at the peak stress and sf where the bond is gone [m]; s0 < sf.
    support : "pull-pull" holds the matrix at the fibre's tip (x = 0), "pull-push" at the loaded face (x = L).
    extra_compliance : of whatever lies in series, such as l_free/a_f of a free fibre end [m/N].

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
        """Return P_inf = sqrt(2 p G_f/a_s)/max(gL, g0) [N]: peak load of a long bond, fracture mechanics."""
        return math.sqrt(2.0 * self.p * self.fracture_energy / self.a_series) / max(self.g_end, self.g_tip)

    def peak(self) -> LoadPoint:
        """Return the largest load [N] and the displacement there [m]."""
        return self._point(self._peak)

    @cached_property
    def snaps_back(self) -> bool:
        """Whether the displacement turns back along the path.

        Without an elastic zone (S >= s0) every slip is sf - (sf - S) f(x): the path ends as a straight line to
        (u, P) = (sf, 0). It snaps back if and only if this line comes from larger displacements.
        """
        return self._point(self._softened).displacement > self.slip_end * (1.0 + _AT_A_KINK)

    def turning_point(self) -> LoadPoint | None:
        """Return load and displacement at the largest displacement, where snap-back begins; None without snap-back."""
        return self._point(self._turn) if self.snaps_back else None

    @property
    def work_of_debonding(self) -> float:
        """p L G_f: work of the load over the whole test [J]."""
        return self.p * self.length * self.fracture_energy

    # ---- states ------------------------------------------------------------------------------------------------------

    def state(self, least_slip: float) -> PullOutState:
        """Return the equilibrium state of least slip S [m]; from sf on, the debonded fibre at u = S.

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
        InputError : the load is negative, not finite, or above the peak load.
        """
        P, peak = nonnegative("load", load, "N"), self.peak().load
        if peak < P:
            raise InputError(f"load is {P!r} N; the peak load of this pull-out is {peak!r} N, give 0 to that.")
        ends = (-1.0, self._peak) if rising else (self._peak, self._end)
        return self._state_where(lambda at: self._point(at).load - P, *ends)

    def state_at_displacement(self, displacement: float) -> PullOutState:
        """Return the state that a slowly raised end displacement u [m] reaches.

        Up to the turning point (up to sf without snap-back) it lies on the path; beyond, the fibre has come out.

        Raises
        ------
        InputError : the displacement is negative or not finite.
        """
        u = nonnegative("displacement", displacement, "m")
        if u > self._point(self._turn).displacement:
            return self.state(u)
        return self._state_where(lambda at: self._point(at).displacement - u, -1.0, self._turn)

    def path(self, n: int = 400) -> PullOutPath:
        """Return n >= 20 states of the whole path, evenly spaced along the load-displacement curve.

        Onset, peak, turning point, loss of the last elastic section and the end are among them exactly.

        Raises
        ------
        InputError : n is not a whole number >= 20.
        """
        n = whole_number("n", n, least=20)
        marks = np.unique([-1.0, 0.0, self._peak, self._turn, self._softened, self._end])
        within = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n))  # dense at the marks, where stages change fast
        trial = (marks[:-1, None] + np.diff(marks)[:, None] * within).ravel()
        curve = self._respond(self._log_slip(trial))
        steps = np.hypot(np.diff(curve.load) / curve.load.max(), np.diff(curve.displacement) / curve.displacement.max())
        arc = np.append(0.0, np.cumsum(steps))
        between = np.interp(np.linspace(0.0, arc[-1], n - marks.size + 2)[1:-1], arc, trial)
        log_slip = self._log_slip(np.sort(np.append(marks, between)))
        r = self._respond(log_slip)
        spent = np.maximum.accumulate(r.dissipated)  # evens out round-off
        return PullOutPath(
            self.least_slip(log_slip), r.section, r.load, r.displacement, spent, self._zones(log_slip, r)
        )

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
            tip, end = self.side(log_slip, x), self.side(log_slip, self.length - x)
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
        tip, end = self.side(log_slip, x), self.side(log_slip, self.length - x)
        load = self.a_series * (tip.slope + end.slope)
        displacement = end.slip + load * self.extra_compliance
        if self.support == "pull-pull":
            displacement += self.alpha * (tip.slip - end.slip) + load * self.length / (self.a_fibre + self.a_matrix)
        dissipated = self.p * self.fracture_energy * (tip.spent + end.spent)
        return _Response(x, load, displacement, dissipated, tip, end)

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
        return PullOutState(self, log_slip, slip, x, load, displacement, dissipated, self._zones(at, r)[0])

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
        """Progress where the bond is gone, S = sf."""
        return math.log(self.slip_end / self.slip_peak) - self._log_slip_at_onset

    @cached_property
    def _peak(self) -> float:
        """Progress at the largest load: the linearised problem ds'' = c tau'(s) ds has a solution with dP = 0.

        In softening zones of angles phi it is a cosine from the ends, in between, over a length a, a cosh, which gives
        tanh(lam a) = (t_tip + t_end)/(1 + t_tip t_end), t = (omega/lam) tan(phi); in pull-push t_tip = 0 (Yuan et al.
        2004, eq. for the ultimate load). It comes before any section debonds.
        """

        def margin(progress: float) -> float:
            r = self._respond(self._log_slip([progress]))
            if r.tip.debonded[0] > 0.0 or r.end.debonded[0] > 0.0:
                return -1.0
            phi_tip, phi_end = float(r.tip.angle[0]), float(r.end.angle[0])
            t_tip, t_end = (self.omega / self.lam * math.tan(phi) for phi in (phi_tip, phi_end))
            elastic = math.tanh(self.lam * self.length - self.lam / self.omega * (phi_tip + phi_end))
            return (1.0 + t_tip * t_end) * elastic - t_tip - t_end

        return float(brentq(margin, 0.0, self._softened, xtol=1e-15, rtol=_ROUND_OFF, maxiter=1000))

    @cached_property
    def _turn(self) -> float:
        """Progress at the largest displacement, up to which it only grows: the turning point, or else the end."""
        if not self.snaps_back:
            return self._end
        best = minimize_scalar(
            lambda at: -self._point(at).displacement, bounds=(0.0, self._softened), options={"xatol": 1e-9}
        )
        return float(best.x)
