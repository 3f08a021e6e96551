"""The architecture: each rule is held against the package, where it must find nothing, and against small bad sources,
where it must complain.
"""

import types
from collections.abc import Callable
from pathlib import Path

import pytest
from architecture.rules import (
    PLACES,
    ROOT,
    RULES,
    TEXTS,
    Package,
    arrows_point_downwards,
    compilers_stay_in_their_engines,
    exports_are_real,
    heavy_imports,
    layers_are_known,
    library_laws_are_a_users,
    names_are_plain,
    no_import_cycle,
    physics_is_pure,
    public_names_are_annotated,
    public_names_are_documented,
    read,
    read_package,
    sources_are_short,
    texts_are_for_strangers,
)


def complain(found: list[str]) -> None:
    if found:
        pytest.fail("\n".join(["", *found]), pytrace=False)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_package_keeps_the_rule(rule: Callable[[Package], list[str]]) -> None:
    package = read_package()
    assert "pybondem.errors" in package
    complain(rule(package))


def test_the_texts_are_for_strangers() -> None:
    paths = [p for p in ROOT.iterdir() if p.is_file()]
    paths += [p for place in PLACES for p in (ROOT / place).rglob("*") if p.is_file() and "_build" not in p.parts]
    texts = {
        str(p.relative_to(ROOT)): p.read_text(encoding="utf-8")
        for p in paths
        if p.suffix in TEXTS or p.parent.name == ".ci"
    }
    assert {"go.py", "pyproject.toml", str(Path(".ci/run"))} <= texts.keys()
    complain(texts_are_for_strangers(texts))


def test_what_pybondem_exports_is_real() -> None:
    import pybondem

    complain(exports_are_real(pybondem))


def test_import_pybondem_is_light() -> None:
    complain(
        [
            f"import pybondem loads {name}: import it where it is used"
            for name in heavy_imports("import pybondem", ROOT / "src")
        ]
    )


# ------------------------------------------------------------------------------------------ and each of them can fail
DOC = '"""What it is for."""\n'
GOOD = {
    "__init__.py": DOC + "from pybondem.simulation import run",
    "errors.py": DOC
    + "class Wrong(ValueError):\n    'What went wrong.'\n    def __init__(self, why: str): self.why = why",
    "ops.py": DOC + "from math import sqrt\ndef root(a: float) -> float:\n    'The root.'\n    return sqrt(a)",
    "physics/__init__.py": DOC + "from .spring import force",
    "physics/spring.py": DOC
    + "from ..ops import root\ndef force(u: float) -> float:\n    'A law.'\n    return -root(u)",
    "engines/cpu_threads.py": DOC + "import numba\nfrom pybondem import physics",
    "simulation.py": DOC
    + "def run(*, steps: int = 1) -> None:\n    'Go.'\n    from pybondem.engines import cpu_threads",
}
BAD = [
    (layers_are_known, {"gadgets/knob.py": DOC}, "gadgets is new here"),
    (
        arrows_point_downwards,
        {"program.py": DOC + "def f():\n    from .engines import cpu_threads"},
        "program:3 imports",
    ),
    (arrows_point_downwards, {"model.py": "", "packing.py": "import pybondem.model"}, "not in a layer below packing"),
    (arrows_point_downwards, {"output/a.py": "from pybondem.ops import root"}, "output imports only"),
    (arrows_point_downwards, {"physics/a.py": "from pybondem import errors"}, "physics imports only"),
    (arrows_point_downwards, {"theory/a.py": "from pybondem.physics.spring import force"}, "theory imports only"),
    (no_import_cycle, {"physics/a.py": "from . import b", "physics/b.py": "import pybondem.physics.a"}, "import cycle"),
    (physics_is_pure, {"physics/a.py": "import numpy as np"}, "imports numpy"),
    (physics_is_pure, {"ops.py": "def f():\n    import numba"}, "imports numba"),
    (physics_is_pure, {"physics/a.py": "def f(a): a[0] = 1"}, "writes into a"),
    (physics_is_pure, {"physics/a.py": "def f(a): a.x += 1"}, "writes into a"),
    (physics_is_pure, {"physics/a.py": "def f():\n    global g"}, "not its own"),
    (physics_is_pure, {"physics/a.py": "print(1)"}, "calls print"),
    (library_laws_are_a_users, {"laws/library/a.py": "import numpy as np"}, "a:1 imports numpy"),
    (compilers_stay_in_their_engines, {"engines/reference.py": "from numba import njit"}, "reference:1 imports numba"),
    (
        compilers_stay_in_their_engines,
        {"engines/cpux.py": "import importlib\nimportlib.import_module('numba.cuda')"},
        "cpux:2",
    ),
    (sources_are_short, {"model.py": "\n" * 401}, "401 lines"),
    (sources_are_short, {"model.py": "def f():\n" + "    1\n" * 60}, "f has 61 lines"),
    (public_names_are_documented, {"model.py": "x = 1"}, "model has no docstring"),
    (public_names_are_documented, {"model.py": DOC + "class A:\n    'An A.'\n    def go(self): ..."}, "model.A.go"),
    (public_names_are_annotated, {"model.py": "def f(a: int, *b, c=1) -> int: ..."}, "no annotation for c, b"),
    (public_names_are_annotated, {"model.py": "class A:\n    @staticmethod\n    def go(a): ..."}, "for a, return"),
    (names_are_plain, {"bond_utils.py": ""}, "vague module name"),
    (names_are_plain, {"model.py": "class GPUHandler: ..."}, "GPUHandler: say what"),
    (names_are_plain, {"model.py": "for helper in []: ..."}, "helper: say what"),
    (names_are_plain, {"model.py": "def __getattr__(name): ..."}, "defines __getattr__"),
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_a_rule_accepts_a_good_package(rule: Callable[[Package], list[str]]) -> None:
    assert rule(read(GOOD)) == []


@pytest.mark.parametrize(("rule", "sources", "complaint"), BAD, ids=[f"{r.__name__}-{c}" for r, _, c in BAD])
def test_a_rule_catches_a_bad_source(rule: Callable[[Package], list[str]], sources: dict, complaint: str) -> None:
    assert complaint in "\n".join(rule(read(GOOD | sources)))


def test_every_rule_has_a_bad_source() -> None:
    assert {rule for rule, _, _ in BAD} == set(RULES)


@pytest.mark.parametrize(
    "line", ["# TO" + "DO later", "see iss" + "ue 2", "/".join(["open('", "home", "me", "a.txt')"])]
)
def test_a_text_for_ourselves_is_caught(line: str) -> None:
    assert texts_are_for_strangers({"a.md": "fine\n" + line})[0].startswith("a.md:2 holds")
    assert (
        texts_are_for_strangers({"a.md": "an issue of 2 to do, src/work/a, https://a.org/home/b, #!/usr/bin/env"}) == []
    )


def test_an_empty_export_is_caught() -> None:
    module = types.ModuleType("m", "A module.")
    assert exports_are_real(module) == ["m has no __all__"]
    module.f, module.__all__ = lambda: None, ["f", "f", "g"]
    assert exports_are_real(module) == [
        "m.__all__ repeats f",
        "m.__all__ names g, which is not there",
        "m.f has no docstring",
    ]


def test_a_heavy_import_is_caught(tmp_path: Path) -> None:
    (tmp_path / "heavy.py").write_text("import rich\n")
    assert heavy_imports("import heavy", tmp_path) == ["rich"]
