"""The example through snap-back, run as a user runs it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "snap_back.py"


@pytest.mark.slow
def test_the_example_agrees_with_the_theory_beside_it(tmp_path: Path) -> None:
    said = subprocess.run([sys.executable, EXAMPLE], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    pairs = re.findall(r"([\d.e+-]+) (?:N|m|J), theory ([\d.e+-]+)", said)
    assert len(pairs) == 3
    for found, theory in pairs:
        assert float(found) == pytest.approx(float(theory), rel=0.01)
    assert (tmp_path / "snap-back.png").stat().st_size > 10_000
