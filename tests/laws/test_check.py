"""The battery that tells whether a bond law is one: every planted mistake is found by name, no right law is accused."""

from typing import Any

import pytest
from laws.planted import (
    END,
    PEAK,
    PLANTED,
    SEEN_FROM_I,
    STAYING_AXES,
    WEAK_WHEN_CLOSED,
    elastic_energy,
    heals,
    promises_more,
    short_of_force,
    short_of_torque,
    softened,
    sums_increments,
    with_normal,
    with_shear,
)

from pybondem import laws, scatter
from pybondem.engines.reference import ReferenceRunner
from pybondem.errors import EngineError, InputError
from pybondem.laws.check import BATTERY, check_law
from pybondem.laws.findings import Finding
from pybondem.laws.law import bond_law, damage_law
from pybondem.laws.parameters import Parameter
from pybondem.laws.portability import engines
from pybondem.laws.subject import subject
from pybondem.ops import exp, maximum, sqrt
from pybondem.physics.types import Damage

QUICK = ("interpreted",)  # to hold against the reference engine without a compilation


def finding(law: Any, name: str) -> Finding:
    return BATTERY[name](subject(law))


def typical(name: str) -> Any:
    law = getattr(laws, name)
    return law(**{n: p.typical for n, p in law.parameters.items() if p.typical is not None})


# Mistakes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mistake", PLANTED)
def test_finds_mistake_by_name(mistake):
    law, name, said, at = PLANTED[mistake]
    found = finding(law, name)
    assert found.verdict == "failed"
    assert said in found.sentence
    assert at in found.deformation


@pytest.mark.parametrize(
    ("element", "law", "name", "said"),
    [
        (STAYING_AXES, sums_increments(), "rigid motion", "axes that turn with the bond"),
        (SEEN_FROM_I, laws.bilinear(PEAK, END), "swap", "prefers one end"),
        (WEAK_WHEN_CLOSED, laws.bilinear(PEAK, END), "closure", "full normal stiffness"),
    ],
)
def test_finds_broken_element(monkeypatch, element, law, name, said):
    assert finding(law, name).verdict == "passed"
    monkeypatch.setattr("pybondem.assembly.BOND", element)
    found = finding(law, name)
    assert found.verdict == "failed"
    assert said in found.sentence
    assert found.deformation.startswith("bond: ")
    assert "m" in found.deformation


@pytest.mark.parametrize(("losing", "said"), [(short_of_force, "not opposite"), (short_of_torque, "begin to spin")])
def test_finds_unbalanced_loads(monkeypatch, losing, said):
    monkeypatch.setattr(ReferenceRunner, "_gather", losing(ReferenceRunner._gather))
    found = finding(laws.bilinear(PEAK, END), "momentum")
    assert found.verdict == "failed"
    assert said in found.sentence
    assert "slip" in found.deformation


def test_finds_an_engine_that_answers_otherwise(monkeypatch):
    monkeypatch.setattr(ReferenceRunner, "_gather", short_of_force(ReferenceRunner._gather))
    found = engines(subject(laws.bilinear(PEAK, END)), QUICK)
    assert found.verdict == "failed"
    assert "'interpreted' answers another load" in found.sentence
    assert 1e-9 < found.measured < 2e-3  # a thousandth of some forces is missing


def test_says_why_a_law_is_not_for_a_gpu(monkeypatch):
    def refuse(function: Any, types: Any) -> None:
        raise EngineError(f"{function.__name__} takes {types[0].__name__} and {types[-1].__name__}")

    law = laws.bilinear(PEAK, END)
    monkeypatch.setattr("pybondem.engines.cuda_compile.missing", lambda: "there is no compiler")
    assert finding(law, "gpu").verdict == "skipped"
    assert "there is no compiler" in finding(law, "gpu").sentence
    monkeypatch.setattr("pybondem.engines.cuda_compile.missing", lambda: None)
    monkeypatch.setattr("pybondem.engines.cuda_compile.compile_for_gpu", refuse)
    assert finding(law, "gpu").verdict == "failed"
    assert finding(law, "gpu").sentence.endswith("takes Deformation and float")


def test_measures_how_wrong_the_fracture_energy_is():
    found = finding(promises_more(PEAK, END), "toughness")
    assert found.measured == pytest.approx(1.0 - 1.0 / 1.05, rel=1e-3)


def test_a_law_that_stops_has_failed():
    @damage_law(parameters={"end": Parameter("m", typical=1.0)})
    def stops(d, p):
        if p.end < 0.5:
            raise ValueError("too short")
        return 0.0 * d.slip

    report = check_law(stops(1e-3), QUICK, quiet=True)
    assert [(f.name, f.sentence) for f in report.failed] == [("runs", "The law stops with ValueError: too short")]


# Right laws ------------------------------------------------------------------------------------------------------


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


RIGHT = {
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


@pytest.mark.parametrize("name", RIGHT)
def test_right_laws_pass(name):
    report = check_law(RIGHT[name], QUICK, quiet=True)
    assert report.passed, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("name", laws.library.__all__)
def test_library_passes_on_all_engines(name):
    report = check_law(typical(name), quiet=True)
    assert report.passed, str(report)
    assert "reference, cpu, interpreted" in report["engines"].sentence


def test_same_on_all_engines():
    found = engines(subject(laws.bilinear(PEAK, END)))
    assert found.verdict == "passed", found
    assert "reference, cpu, interpreted" in found.sentence


@pytest.mark.parametrize(("law", "words"), [(by_cases, "branches with `if`"), (heals, "whole arrays")])
def test_says_whether_a_law_branches(law, words):
    assert words in finding(law(PEAK, END), "branches").sentence


def test_temperatures_are_zero_where_energy_is_looked_at():
    law = laws.thermal(expansion=1e-5, heating=50.0)
    assert finding(law, "rest").verdict == "passed"
    assert finding(law, "rest").sentence.endswith("(with heating = 0).")
    assert finding(law, "dissipation").verdict == "passed"


def test_toughness_in_words():
    found = finding(laws.bilinear(PEAK, END, stiffness=5e10), "toughness")
    assert f"{0.5 * 5e10 * PEAK * END:.5g} J/m2 in slip of a joint, as declared" in found.sentence


# Report ----------------------------------------------------------------------------------------------------------


def test_report_is_a_table_with_a_last_line(capsys):
    report = check_law(heals(PEAK, END), QUICK)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("finite        passed   ")
    damage = next(line for line in lines if line.startswith("damage "))
    assert damage.split()[:2] == ["damage", "failed"]
    counts = {v: sum(f.verdict == v for f in report.findings) for v in ("passed", "failed", "skipped")}
    said = ", ".join(f"{n} {verdict}" for verdict, n in counts.items() if n)
    assert lines[-1] == f"heals: {said}"
    assert not report.passed
    assert report["damage"] in report.failed


def test_report_is_quiet_when_asked(capsys):
    check_law(laws.bilinear(PEAK, END), QUICK, quiet=True)
    assert capsys.readouterr().out == ""


def test_report_names_what_it_has():
    report = check_law(laws.bilinear(PEAK, END), QUICK, quiet=True)
    with pytest.raises(InputError, match=r"no finding 'momenta'; it has finite, rest"):
        report["momenta"]
