"""Laws of bonds: the published ones by name, and what declares one's own."""

from pybondem.laws.library import *  # noqa: F403
from pybondem.laws.library import __all__ as __all__
