"""PyBONDEM: bonded-particle discrete elements in Python."""

__version__ = "0.1.0"
