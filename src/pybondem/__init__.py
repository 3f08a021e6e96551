"""PyBONDEM: bonded-particle discrete elements in Python."""

from pybondem import examples, interface, packing, statics, theory
from pybondem.bonds import Bond, Joint, bilinear, euler_bernoulli, parallel, springs, strength, timoshenko
from pybondem.damping import kinetic, local, viscous
from pybondem.errors import BondemError, EngineError, InputError, SelectionError, UnstableError
from pybondem.measure import applied, broken, displacement, energy, reaction, slip, strain, stress, unbalanced
from pybondem.model import Model, Selection
from pybondem.packing.shapes import Box, Cylinder, Sphere
from pybondem.results import Results
from pybondem.schedules import hold, ramp, smooth, table
from pybondem.simulation import Interrupted, Simulation

__version__ = "0.1.0"

__all__ = [
    "Bond", "BondemError", "Box", "Cylinder", "EngineError", "InputError", "Interrupted", "Joint", "Model", "Results",
    "Selection", "SelectionError", "Simulation", "Sphere", "UnstableError", "applied", "bilinear", "broken",
    "displacement", "energy", "euler_bernoulli", "examples", "hold", "interface", "kinetic", "local", "packing",
    "parallel", "ramp", "reaction", "slip", "smooth", "springs", "statics", "strain", "strength", "stress", "table",
    "theory", "timoshenko", "unbalanced", "viscous",
]  # fmt: skip
