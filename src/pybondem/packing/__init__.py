"""Where particles come from: regular packings, lines, tables; and the shapes to cut them with.

>>> from pybondem import packing
>>> rod = packing.hcp(diameter=1e-3, inside=packing.Cylinder(radius=5e-3, height=20e-3), axis="z")
"""

from pybondem.packing.lattices import fcc, hcp, line, sc
from pybondem.packing.particles import Particles
from pybondem.packing.shapes import Box, Cylinder, Shape, Sphere
from pybondem.packing.table import read_table, write_table

__all__ = ["Particles", "hcp", "fcc", "sc", "line", "read_table", "write_table", "Shape", "Box", "Cylinder", "Sphere"]
