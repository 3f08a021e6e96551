"""The cpu engine's cache of compiled programs: warm in the next process, never stale; the code that is in it."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import llvmlite.binding as llvm
import pytest

import pybondem as bd
from pybondem import ops
from pybondem.assembly import assemble, step_program
from pybondem.engines.cpu import cache_folder, fingerprint
from pybondem.engines.loops import Loops

RUN = """
import time
began = time.perf_counter()
import pybondem as bd
model = bd.Model(bd.packing.line(3, spacing=1e-2, diameter=1e-2), density=2500.0)
model.bond(model.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0)))
model.drive(model.select([2]), vx=0.5)
imported = time.perf_counter()
sim = bd.Simulation(model, engine="cpu").run(200, quiet=True)
print(time.perf_counter() - imported, sim.particles.x.tobytes().hex(), sim.energies.strain.hex())
"""


def run(cache: Path) -> tuple[float, list[str], dict[str, tuple[int, int]]]:
    """Return the seconds of one process, what it computed, and size and time of each file in its cache."""
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=os.environ | {"PYBONDEM_CACHE": str(cache)}, text=True, capture_output=True
    )
    assert done.returncode == 0, done.stderr
    seconds, *result = done.stdout.split()
    stats = {str(f.relative_to(cache)): f.stat() for f in cache.rglob("*") if f.is_file()}
    return float(seconds), result, {name: (s.st_size, s.st_mtime_ns) for name, s in stats.items()}


def test_the_next_process_starts_warm(tmp_path):
    """Same bits, no file of the cache written, and well below the time of the first."""
    cold, result, files = run(tmp_path)
    warm, again, files_after = run(tmp_path)
    assert again == result
    compiled = {name for name in files if name.endswith(".nbc")}
    assert len(compiled) == 3  # step, stiffness, energy
    assert files_after == files
    assert warm < 0.3 * cold


def test_an_unusable_folder_is_replaced_by_a_temporary_one(tmp_path, monkeypatch):
    taken = tmp_path / "file"
    taken.write_text("")
    monkeypatch.setenv("PYBONDEM_CACHE", str(taken))
    folder = cache_folder()
    assert folder != taken
    (folder / "probe").write_text("")
    assert taken.read_text() == ""


# Never stale ----------------------------------------------------------------------------------------------------

LAW = """
LIMIT = 1.0

def share(a):
    return 0.5 * a

def least(a, b):
    return minimum(a, b) + 1.5

def make(slope):
    def law(d, m):
        def inner(a, power=2.0, *, scale=1.0):
            return a + power * scale * 7.0 * SHIFT
        return minimum(1.0, slope * share(max(0.0, d.slip)) / LIMIT) * inner(2.5), words.least(m.largest, 0.0)
    return law

SHIFT = 0.25
law = make(3.0)
"""


def key_of(text: str) -> str:
    """Return the fingerprint of a step program with a damage law of this text."""
    names = {"minimum": ops.minimum, "maximum": ops.maximum, "words": ModuleType("words")}
    exec(compile(text, "<law>", "exec"), names)
    vars(names["words"]).update(least=names["least"])
    law = bd.damage_law(names["law"], memory={"largest": "m"})()
    model = bd.Model(bd.packing.line(2, spacing=1e-2, diameter=1e-2), density=2500.0)
    model.bond(model.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), law))
    return fingerprint(Loops(step_program(assemble(model), (0.0, 0.0, 0.0), None)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("slope * share", "slope + share"),
        ("minimum(", "maximum("),
        ("max(0.0", "min(0.0"),
        ("0.5 * a", "0.6 * a"),
        ("0.5 * a", "-0.5 * a"),
        ("LIMIT = 1.0", "LIMIT = 2.0"),
        ("make(3.0)", "make(4.0)"),
        ("* 7.0", "* 8.0"),
        ("b) + 1.5", "b) + 2.5"),
        ("SHIFT = 0.25", "SHIFT = 0.5"),
        ("power=2.0", "power=3.0"),
        ("scale=1.0", "scale=2.0"),
    ],
)
def test_an_edit_of_a_law_is_another_program(old, new):
    assert old in LAW
    assert key_of(LAW.replace(old, new)) != key_of(LAW)


def test_what_changes_nothing_is_the_same_program():
    assert key_of("# a remark\n\n" + LAW.replace("\n    return 0.5", "\n\n    # another\n    return 0.5")) == key_of(
        LAW
    )


def test_a_file_of_the_package_edited_is_another_program(tmp_path, monkeypatch):
    """The sources of engine and physics are part of the key, what they call at a distance included."""
    from shutil import copytree

    import pybondem.engines.cpu as cpu

    before = key_of(LAW)
    package = copytree(Path(bd.__file__).parent, tmp_path / "pybondem")
    monkeypatch.setattr(cpu, "__file__", str(package / "engines" / "cpu.py"))
    assert key_of(LAW) == before
    for name in (
        "ops.py",
        "program.py",
        "bond_answers.py",
        "bond_bodies.py",
        "particle_bodies.py",
        "engines/loops.py",
        "physics/elastic/beam.py",
    ):
        text = (package / name).read_text()
        (package / name).write_text(text + "\n")
        assert key_of(LAW) != before, name
        (package / name).write_text(text)
    assert key_of(LAW) == before


WIDE = """
import numba, numpy as np
import pybondem.engines.cpu

@numba.njit
def double(a):
    for k in range(a.size):
        a[k] *= 2.0

double(np.ones(100))
print("zmm" in "".join(double.inspect_asm().values()))
"""


@pytest.mark.skipif(not llvm.get_host_cpu_features().get("avx512f"), reason="this processor has no 512-bit vectors")
def test_loops_are_compiled_for_the_widest_vectors():
    """LLVM takes half of them where it is not told before Numba is given its first function: a fifth of the speed."""
    done = subprocess.run([sys.executable, "-c", WIDE], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
