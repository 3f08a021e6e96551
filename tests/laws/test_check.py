"""The battery that tells whether a bond law is one: every planted mistake is found by name, no right law is accused."""

from pathlib import Path
from typing import Any

import pytest
from laws.planted import (
    END,
    PEAK,
    PLANTED,
    SEEN_FROM_I,
    STAYING_AXES,
    WEAK_WHEN_CLOSED,
    heals,
    promises_more,
    short_of_force,
    short_of_torque,
    sums_increments,
)
from laws.right import RIGHT, arrhenius, by_cases, expands, fatigue, own_modulus

from pybondem import laws
from pybondem.engines.cpu import Cpu
from pybondem.engines.reference import ReferenceRunner
from pybondem.errors import EngineError, InputError
from pybondem.laws.check import BATTERY, check_law
from pybondem.laws.findings import Finding
from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.laws.portability import engines
from pybondem.laws.subject import subject
from pybondem.output.readable import quantity

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
    assert [f.name for f in report.failed] == ["runs"]
    line = next(n for n, text in enumerate(Path(__file__).read_text().splitlines(), 1) if "too short" in text)
    said = f'stops with ValueError: too short (test_check.py, line {line}: raise ValueError("too short")).'
    assert report["runs"].sentence.endswith(said)


def test_says_what_a_compiler_could_not_do(monkeypatch):
    def refuse(self: Any, program: Any) -> Any:
        raise TypeError(
            "Failed in nopython mode pipeline (step: nopython frontend)\nUnknown attribute 'b' of type float"
        )

    monkeypatch.setattr(Cpu, "prepare", refuse)
    found = engines(subject(laws.bilinear(PEAK, END)), ("cpu",))
    assert found.verdict == "failed"
    assert "'cpu': bilinear cannot be compiled: float has no b (bilinear.py, line" in found.sentence
    assert "nopython" not in found.sentence


def test_a_toughness_in_a_mode_that_there_is_not(monkeypatch):
    law = promises_more(PEAK, END)
    monkeypatch.setattr(promises_more, "toughness", {"shear": lambda p, k: 1.0})
    found = finding(law, "toughness")
    assert found.verdict == "failed"
    assert "declared in 'shear'; it can be in opening or slip" in found.sentence


def test_without_a_potential_only_closed_paths_are_looked_at():
    found = finding(own_modulus(1e9), "dissipation")
    assert found.verdict == "skipped"
    assert found.sentence == "No closed path yields work. Declare a potential to have each step looked at."


def test_fatigue_is_told_from_a_mistake_in_unloading():
    found = finding(fatigue(50.0, PEAK), "unloading")
    assert found.verdict == "skipped"
    assert "as fatigue does" in found.sentence


def test_temperatures_that_a_law_divides_by_are_kept():
    tried = subject(arrhenius(300.0, 300.0, PEAK))
    assert tried.calm.parameters[:2] == (0.0, 300.0)
    assert tried.heated == ""


@pytest.mark.parametrize("name", ["rest", "dissipation", "toughness"])
def test_a_temperature_that_cannot_be_zero_leaves_energy_aside(name):
    found = finding(expands(300.0, 100.0, 1e-5), name)
    assert found.verdict == "skipped"
    assert "T = 300 cannot be set to 0" in found.sentence


def test_momenta_balance_by_construction():
    assert "by construction" in finding(laws.bilinear(PEAK, END), "momentum").sentence


# Right laws ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RIGHT)
def test_right_laws_pass(name):
    report = check_law(RIGHT[name], QUICK, quiet=True)
    assert report.passed, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("name", laws.__all__)
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
    assert lines[-2] == f"heals: {said}"
    tried = subject(heals(PEAK, END))
    kn, ks, _, _, area = tried.trial("joint", 1).stiffness
    assert tried.length == 0.01
    assert lines[-1].startswith(f"Tried on a bond and a joint of 10 mm, cross-section {area:.3g} m2, stiffness per ")
    assert lines[-1].endswith(f"{quantity(kn / area, 'Pa/m')} in opening and {quantity(ks / area, 'Pa/m')} in slip.")


def test_report_is_quiet_when_asked(capsys):
    check_law(laws.bilinear(PEAK, END), QUICK, quiet=True)
    assert capsys.readouterr().out == ""


def test_report_names_what_it_has():
    report = check_law(laws.bilinear(PEAK, END), QUICK, quiet=True)
    with pytest.raises(InputError, match=r"no finding 'momenta'; it has finite, rest"):
        report["momenta"]
