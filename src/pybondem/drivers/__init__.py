"""Drivers: ways of loading a model that follow what it does, through snap-back."""

from pybondem.drivers.dissipation import EquilibriumPath, PathPoint, dissipation_control
from pybondem.drivers.load_unload import Cycle, Envelope, load_unload

__all__ = ["Cycle", "Envelope", "EquilibriumPath", "PathPoint", "dissipation_control", "load_unload"]
