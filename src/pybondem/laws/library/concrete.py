"""Concrete: exponential damage with a residual stress, driven by the strain of Mazars.

    D = 1 - (threshold / kappa) (1 - alpha + alpha exp(-beta (kappa - threshold)))         kappa > threshold

kappa is the largest equivalent strain so far, that of Mazars: the norm of the positive principal strains. Those of a
bond with the strain e = opening / length and the shear g = slip / length are (e +- sqrt(e^2 + g^2)) / 2, of which the
first is never negative and the second never positive, so that

    equivalent strain = (e + sqrt(e^2 + g^2)) / 2                 e in tension, |g|/2 in shear, 0 in compression

A law of strain: at a given modulus the energy per area grows with the length of the bond, without end for alpha < 1;
for alpha = 1 it is G_f = k length^2 threshold (threshold/2 + 1/beta), k the normal stiffness per area [Pa/m].

The damage: Peerlings, de Borst, Brekelmans & Geers, Gradient-enhanced damage modelling of concrete fracture, Mech.
Cohes.-Frict. Mater. 3, 323-342 (1998). The strain: Mazars, Application de la mecanique de l'endommagement au
comportement non lineaire et a la rupture du beton de structure, these d'Etat, Universite Paris 6 (1984).
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, exp, maximum, sqrt
from pybondem.physics.types import Deformation


@damage_law(
    parameters={
        "threshold": Parameter("1", "equivalent strain where damage begins", above=0.0, typical=1e-4),
        "alpha": Parameter("1", "share of the stress that is lost in the end", least=0.0, most=1.0, typical=0.96),
        "beta": Parameter("1", "how fast, per strain", above=0.0, typical=350.0),
    },
    memory={"largest": "1"},
)
def concrete(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Exponential damage of concrete on the equivalent strain of Mazars."""
    strain, shear = d.opening / d.length, d.slip / d.length
    equivalent = 0.5 * (strain + sqrt(strain * strain + shear * shear))
    largest = maximum(m.largest, equivalent)
    kappa = maximum(largest, p.threshold)
    kept = 1.0 - p.alpha + p.alpha * exp(p.beta * (p.threshold - kappa))
    return 1.0 - p.threshold / kappa * kept, largest
