"""Bilinear softening on the slip: linear up to slip_peak, then down to nothing at slip_end, unloading to the origin.

    D = 0                                                                  kappa <= slip_peak
    D = slip_end (kappa - slip_peak) / (kappa (slip_end - slip_peak))      in between
    D = 1                                                                  kappa >= slip_end

with kappa the largest slip so far. The energy per area is G_f = tau_max slip_end / 2. Hillerborg, Modeer & Petersson
(1976) in tension; on the slip of an interface as in Ren et al., Int. J. Rock Mech. Min. Sci. 47 (2010).
"""

from typing import NamedTuple

from pybondem.ops import Number, maximum, minimum
from pybondem.physics.types import Deformation


class BilinearParameters(NamedTuple):
    """slip_peak [m], where softening begins; slip_end [m], where nothing is left."""

    slip_peak: Number
    slip_end: Number


class BilinearMemory(NamedTuple):
    """largest: the largest slip so far [m], kappa."""

    largest: Number


def bilinear_damage(d: Deformation, m: BilinearMemory, p: BilinearParameters) -> tuple[Number, BilinearMemory]:
    """Return damage D [-] and memory of a softening bond."""
    kappa = maximum(maximum(m.largest, d.slip), p.slip_peak)
    softened = p.slip_end * (kappa - p.slip_peak) / (kappa * (p.slip_end - p.slip_peak))
    return minimum(1.0, softened), BilinearMemory(maximum(m.largest, d.slip))
