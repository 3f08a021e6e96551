"""Is it a law? The trials that every bond law has to stand, on real engines, in seconds.

report = tiring.check(rate=50.0)        # prints a table
report.passed, report.failed, report["momentum"]
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from pybondem.bonds import ValuedLaw
from pybondem.laws import energy, invariance, loss, portability, scaling, steps
from pybondem.laws.findings import Finding, Report, failed, stopped
from pybondem.laws.subject import Subject, subject
from pybondem.output.readable import quantity

# name -> trial; each returns one finding
BATTERY: dict[str, Callable[[Subject], Finding]] = {
    "finite": loss.finite,
    "rest": invariance.rest,
    "rigid motion": invariance.rigid_motion,
    "swap": invariance.swap,
    "frame": invariance.frame,
    "momentum": invariance.momentum,
    "time step": steps.time_step,
    "damage": loss.damage,
    "dissipation": loss.dissipation,
    "unloading": loss.unloading,
    "closure": loss.closure,
    "toughness": energy.toughness,
    "potential": energy.potential,
    "units": scaling.units,
    "engines": portability.engines,
    "gpu": portability.gpu,
    "branches": portability.branches,
}


def check_law(law: ValuedLaw, engines: Sequence[str] | None = None, quiet: bool = False) -> Report:
    """Try a law and return a finding for each rule; prints them unless quiet.

    law: with values; of arrays and scatters their median is tried. engines: names of those to compare, all by default.
    Works in pairs of spheres in bonds and in joints, for both a length of 1 cm, or one at which the deformations that
    matter to the law are about 1 % of it; the last line of the report says which bond that was. Temperatures
    (parameters in K) are set to 0 where energy is looked at, if the law can do with that.
    """
    battery = BATTERY | {"engines": partial(portability.engines, names=engines)}
    try:
        with np.errstate(all="ignore"):
            tried = subject(law)
    except Exception as error:  # the law is a user's function: it may raise anything
        report = Report(law.name, (_stopped("runs", error, law),))
    else:
        findings = [_found(name, trial, tried) for name, trial in battery.items()]
        report = Report(law.name, tuple(findings), _bond(tried))
    if not quiet:
        print(report)
    return report


def _found(name: str, trial: Callable[[Subject], Finding], tried: Subject) -> Finding:
    """Return the finding of one trial; a law that stops with an error has failed it."""
    try:
        with np.errstate(all="ignore"):
            return trial(tried)
    except Exception as error:
        return _stopped(name, error, tried.law)


def _stopped(name: str, error: Exception, law: ValuedLaw) -> Finding:
    return failed(name, stopped(error, law))


def _bond(tried: Subject) -> str:
    """Return the bond that a law was tried on, in words."""
    kn, ks, _, _, area = tried.trial("bond", 1).stiffness
    return (
        f"Tried on a bond and a joint of {quantity(tried.length, 'm')}, cross-section {area:.3g} m2, stiffness per "
        f"area {quantity(kn / area, 'Pa/m')} in opening and {quantity(ks / area, 'Pa/m')} in slip."
    )
