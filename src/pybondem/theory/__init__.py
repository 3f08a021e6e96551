"""Closed forms that simulations are held against: fibre pull-out and the elastic constants of sphere lattices."""

from pybondem.theory.lattice import ElasticConstants, Stiffnesses, calibrate, elastic_constants, volume_per_sphere
from pybondem.theory.pullout import PullOut
from pybondem.theory.specimen import shear_lag_compliance
from pybondem.theory.states import LoadPoint, PullOutPath, PullOutState

__all__ = [
    "PullOut", "PullOutState", "PullOutPath", "LoadPoint", "shear_lag_compliance",
    "ElasticConstants", "Stiffnesses", "calibrate", "elastic_constants", "volume_per_sphere",
]  # fmt: skip
