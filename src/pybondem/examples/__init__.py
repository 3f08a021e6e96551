"""The worked examples: the two of the PyBONDEM-GPU paper, as models that can be changed and run."""

from pybondem.examples.cylinder import Cylinder, cylinder
from pybondem.examples.pullout import PullOutTest, pullout

__all__ = ["Cylinder", "PullOutTest", "cylinder", "pullout"]
