"""Findings on where a law runs: the same on all engines, on a GPU, on whole arrays."""

from collections.abc import Sequence

from pybondem.assembly import called
from pybondem.engines import cuda_compile
from pybondem.engines.choose import usable_engines
from pybondem.engines.compile_errors import explain
from pybondem.errors import BondemError
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped, stopped
from pybondem.laws.invariance import difference, first_place
from pybondem.laws.subject import Subject

PAIRS = 6
INTERPRETED = ("reference", "interpreted")  # engines that compile nothing


def engines(s: Subject, names: Sequence[str] | None = None) -> Finding:
    """All engines give the same answer along one random path."""
    name, tolerance, worst = "engines", 1e-12, 0.0
    tried = [e for e in (names or usable_engines()) if e != "reference"]
    path = s.wander("bond", PAIRS, legs=6, steps=5, seed=61)
    reference = s.trial("bond", PAIRS).follow(path, s.time_step(path))
    for engine in tried:
        try:
            history = s.trial("bond", PAIRS, engine=engine).follow(path, s.time_step(path))
        except Exception as error:  # compilers raise anything at a user's function
            return failed(name, f"The law does not run on the engine {engine!r}: {_refused(error, engine, s)}")
        differs = difference(reference, history, s.length)
        worst = max(worst, float(differs.max()))
        if not worst <= tolerance:
            k, pair = first_place(differs > tolerance)
            sentence = f"The engine {engine!r} answers another load than the reference engine."
            return failed(name, sentence, in_words(path[k, :, pair], "bond"), float(differs[k, pair]), tolerance)
    return passed(name, f"The engines {', '.join(['reference', *tried])} give the same answer.", worst, tolerance)


def _refused(error: Exception, engine: str, s: Subject) -> str:
    """Return in words why an engine does not run a law."""
    if isinstance(error, BondemError):
        return str(error)
    return stopped(error, s.law) if engine in INTERPRETED else explain(error, s.law.declared.user)


def gpu(s: Subject) -> Finding:
    """The law compiles for a GPU."""
    why = cuda_compile.missing()
    if why is not None:
        return skipped("gpu", f"Whether it compiles for a GPU was not looked at: {why}.")
    try:
        made = cuda_compile.compile_for_gpu(s.law.function, called(s.law).types)
    except BondemError as error:
        return failed("gpu", str(error))
    needs = "" if made.registers is None else f", with {made.registers} registers and {made.spills} bytes spilled"
    return passed("gpu", f"It compiles for a GPU{needs}.")


def branches(s: Subject) -> Finding:
    """Whether the law takes whole arrays, or goes one bond at a time in the reference engine."""
    if s.law.branches:
        return passed("branches", "It branches with `if`: the reference engine takes it one bond at a time.")
    return passed("branches", "It takes whole arrays: no `if` to go through bond by bond.")
