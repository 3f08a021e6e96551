"""The figures of the PyBONDEM-GPU paper (Dressler & Wilke 2021) from our own runs, each beside the exact answer.

A figure is a function (folder, effort) -> Sheet, in a module of its own.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from pybondem.output.sheet import Sheet
from pybondem.paper.effort import Effort

__all__ = ["Effort", "FIGURES", "make"]

# The module of each figure, and what it shows.
FIGURES = {
    "fig1": ("speed", "time of a step by number of particles, on every engine"),
    "fig2": ("pictures", "fibre and matrix, cut open, coloured by part, damage and stress; and to turn in a browser"),
    "fig3": ("interface_shear", "shear stress along the interface at five stages of debonding, against theory"),
    "fig4": ("failure_curve", "load against displacement through snap-back, by two drivers, against theory"),
}


def make(name: str, folder: Path, effort: Effort) -> Sheet:
    """Make a figure in a folder (an empty one), write its page and return its sheet."""
    folder.mkdir(parents=True, exist_ok=True)
    module, _ = FIGURES[name]
    figure: Callable[[Path, Effort], Sheet] = import_module(f"pybondem.paper.{module}").figure
    sheet = figure(folder, effort)
    sheet.write()
    return sheet
