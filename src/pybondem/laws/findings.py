"""What the trials of a law found: one finding for each rule, and the report of all of them."""

import inspect
from dataclasses import dataclass
from traceback import extract_tb
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pybondem.bonds import ValuedLaw
from pybondem.engines.compile_errors import Place, located
from pybondem.errors import BondemError, InputError

Verdict = Literal["passed", "failed", "skipped"]
WIDTH = 100  # columns of a printed sentence before it goes on in the next line


class Finding(NamedTuple):
    """One rule and whether the law keeps it.

    sentence: in words of physics; deformation: where it failed, "" where it did not; measured and tolerance: the number
    that was looked at (dimensionless unless the sentence says otherwise) and what it may be at most, if there is one.
    """

    name: str
    verdict: Verdict
    sentence: str
    deformation: str = ""
    measured: float | None = None
    tolerance: float | None = None


@dataclass(frozen=True)
class Report:
    """The findings on one law: `passed`, `failed`, `report["momentum"]`; printed as a table.

    bond: the bond that it was tried on, in words: fracture energies are those of its stiffness.
    """

    law: str
    findings: tuple[Finding, ...]
    bond: str = ""

    @property
    def passed(self) -> bool:
        """Whether no rule is broken."""
        return not self.failed

    @property
    def failed(self) -> list[Finding]:
        """The findings on rules that are broken."""
        return [f for f in self.findings if f.verdict == "failed"]

    def __getitem__(self, name: str) -> Finding:
        for finding in self.findings:
            if finding.name == name:
                return finding
        names = ", ".join(f.name for f in self.findings)
        raise InputError(f"the report on {self.law} has no finding {name!r}; it has {names}.")

    def __str__(self) -> str:
        name = max(len(f.name) for f in self.findings)
        lines = []
        for f in self.findings:
            first, *more = _wrapped(_full(f))
            lines.append(f"{f.name:<{name}}  {f.verdict:<7}  {first}")
            lines += [" " * (name + 11) + line for line in more]
        counts = {v: sum(f.verdict == v for f in self.findings) for v in ("passed", "failed", "skipped")}
        said = ", ".join(f"{count} {v}" for v, count in counts.items() if count)
        return "\n".join([*lines, f"{self.law}: {said}", *([self.bond] if self.bond else [])])


def passed(name: str, sentence: str, measured: float | None = None, tolerance: float | None = None) -> Finding:
    """Return the finding that a rule is kept."""
    return Finding(name, "passed", sentence, "", measured, tolerance)


def skipped(name: str, sentence: str) -> Finding:
    """Return the finding that a rule was not looked at, and why."""
    return Finding(name, "skipped", sentence)


def failed(name: str, sentence: str, deformation: str = "", measured: float | None = None,
           tolerance: float | None = None) -> Finding:  # fmt: skip
    """Return the finding that a rule is broken."""
    return Finding(name, "failed", sentence, deformation, measured, tolerance)


def stopped(error: Exception, law: ValuedLaw) -> str:
    """Return the sentence on what stopped a law, with the user's own line where the error arose in the user's file."""
    if isinstance(error, BondemError):
        return f"{str(error)[:1].upper()}{str(error)[1:]}"
    declared: Any = law.declared
    users = (declared.user, law.potential, getattr(declared, "potential", None), *declared.toughness.values())
    files = {f.__code__.co_filename for f in users if inspect.isfunction(f)}
    lines = [place for place in extract_tb(error.__traceback__) if place.filename in files and place.lineno]
    said = (str(error).strip().splitlines() or [""])[0].rstrip(".")
    at = f" ({located(Place(lines[-1].filename, lines[-1].lineno or 0))})" if lines else ""
    return f"The law stops with {type(error).__name__}: {said}{at}."


def in_words(local: ArrayLike, element: str) -> str:
    """Return the six components (6,) of a deformation in words: "joint: opening 1e-05 m, slip 2e-06 m"."""
    n, s, t, twist, bend_s, bend_t = (float(c) for c in np.asarray(local))
    slip, bending = np.hypot(s, t), np.hypot(bend_s, bend_t)
    said = [f"{'opening' if n > 0.0 else 'closure'} {abs(n):.3g} m"] if n else []
    said += [f"slip {slip:.3g} m"] if slip else []
    said += [f"twist {twist:.3g} rad"] if twist else []
    said += [f"bending {bending:.3g} rad"] if bending else []
    return f"{element}: {', '.join(said) or 'no deformation'}"


def _full(f: Finding) -> str:
    """Return the sentence of a finding with the place and the number, where it failed."""
    at = f" At {f.deformation}." if f.deformation else ""
    number = "" if f.verdict != "failed" or f.measured is None else f" Measured {f.measured:.3g}"
    limit = f", at most {f.tolerance:.3g} allowed" if number and f.tolerance is not None else ""
    return f"{f.sentence}{at}{number}{limit}{'.' if number else ''}"


def _wrapped(text: str) -> list[str]:
    """Return text in lines of at most WIDTH columns."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > WIDTH:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines
