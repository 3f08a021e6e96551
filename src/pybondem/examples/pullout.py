"""A stiff fibre pulled out of a matrix through a softening interface (Dressler & Wilke 2021, section 3.2).

The fibre is pulled slowly enough to be quasi-static, which the energy book shows. Load, displacement and the shear
stress along the interface are compared with the one-dimensional analytic solution (`theory.pullout`).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pybondem.examples.pullout_result import PullOutResult, run_pullout
from pybondem.examples.pullout_setup import PullOutSetup


@dataclass(frozen=True)
class PullOutTest(PullOutSetup):
    """The pull-out test, ready to run; its values are those of `PullOutSetup`."""

    def run(self, *, engine: str = "cpu", threads: int | None = None, folder: str | Path | None = None,
            quiet: bool = False) -> PullOutResult:  # fmt: skip
        """Build the model, run the test, write the result folder, and return the comparison with the theory."""
        return run_pullout(self.build(engine, threads), engine, threads, folder, quiet)


def pullout(**values: Any) -> PullOutTest:
    """Return the pull-out test with some of its values changed: pullout(diameter=0.5, axis="z").run()."""
    return PullOutTest(**values)
