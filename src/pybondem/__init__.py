"""PyBONDEM: bonded-particle discrete elements in Python."""

from pybondem import examples, interface, laws, packing, scatter, statics, theory
from pybondem.bonds import Bond, Joint, euler_bernoulli, parallel, springs, timoshenko
from pybondem.damping import kinetic, local, viscous
from pybondem.drivers import dissipation_control, load_unload
from pybondem.errors import BondemError, EngineError, InputError, LawError, SelectionError, UnstableError
from pybondem.laws import bilinear, strength
from pybondem.laws.law import bond_law, damage_law
from pybondem.laws.parameters import Parameter
from pybondem.measure import applied, broken, displacement, energy, reaction, slip, strain, stress, unbalanced
from pybondem.model import Model, Selection
from pybondem.ops import absolute, exp, log, maximum, minimum, power, sqrt, where
from pybondem.packing.shapes import Box, Cylinder, Sphere
from pybondem.physics.types import Components, Damage, Deformation, Loads
from pybondem.results import Results
from pybondem.schedules import hold, ramp, smooth, table
from pybondem.simulation import Interrupted, Simulation

__version__ = "0.1.0"

__all__ = [
    "Bond", "BondemError", "Box", "Components", "Cylinder", "Damage", "Deformation", "EngineError", "InputError",
    "Interrupted", "Joint", "LawError", "Loads", "Model", "Parameter", "Results", "Selection", "SelectionError",
    "Simulation", "Sphere", "UnstableError", "absolute", "applied", "bilinear", "bond_law", "broken", "damage_law",
    "displacement", "dissipation_control", "energy", "euler_bernoulli", "examples", "exp", "hold", "interface",
    "kinetic", "laws", "load_unload", "local", "log", "maximum", "minimum", "packing", "parallel", "power", "ramp",
    "reaction", "scatter", "slip", "smooth", "springs", "sqrt", "statics", "strain", "strength", "stress", "table",
    "theory", "timoshenko", "unbalanced", "viscous", "where",
]  # fmt: skip
