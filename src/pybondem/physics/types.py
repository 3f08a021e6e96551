"""What passes between physics functions: named tuples of numbers and vectors."""

from collections.abc import Callable
from typing import Any, NamedTuple

from pybondem.ops import Number, Quaternion, Vector


class Pose(NamedTuple):
    """Where a particle is: position x [m] and orientation q, a unit quaternion (scalar first), body to global."""

    x: Vector
    q: Quaternion


class Motion(NamedTuple):
    """How a particle moves: velocity v [m/s] and spin w [rad/s], global axes."""

    v: Vector
    w: Vector


class Relative(NamedTuple):
    """The pose of end j seen from end i.

    r: chord from i to j [m]; length |r| [m]; n = r / |r|;
    c, s: scalar and vector part of the relative rotation q_j q_i* (global axes); t = s / (1 + c);
    turn: scalar and vector part of q_i + q_j, the mean rotation of the material, and inverse = 2 / |q_i + q_j|^2.
    """

    r: Vector
    length: Number
    n: Vector
    c: Number
    s: Vector
    t: Vector
    turn_scalar: Number
    turn_vector: Vector
    inverse: Number


class Reference(NamedTuple):
    """The bond when it was made: chord r0 [m] and the unit normal of its interface (bonds: not used)."""

    r0: Vector
    normal: Vector


class Stretch(NamedTuple):
    """Deformation of a bond in vectors.

    opening [m]: elongation of a bond, or opening of a joint, positive in tension; slip [m]: shear displacement of j
    relative to i, a vector normal to the direction of opening; twist [rad] about the chord; bending [rad]: a vector
    normal to the chord.
    """

    opening: Number
    slip: Vector
    twist: Number
    bending: Vector


class Deformation(NamedTuple):
    """What a damage law sees: scalars.

    opening [m] (positive in tension), slip [m], twist [rad], bending [rad] (the last three are magnitudes), length and
    area of the undeformed bond [m, m2], and the stresses that the undamaged bond would carry [Pa]: normal_stress
    F_n/A (positive in tension), shear_stress |F_s|/A, bending_stress |M_b| Rb/I, twist_stress |M_t| Rb/J.
    """

    opening: Number
    slip: Number
    twist: Number
    bending: Number
    length: Number
    area: Number
    normal_stress: Number
    shear_stress: Number
    bending_stress: Number
    twist_stress: Number


class Stiffness(NamedTuple):
    """Stiffness of one bond: normal kn [N/m], shear ks [N/m], twist kt [N m/rad], bending kb [N m/rad]."""

    kn: Number
    ks: Number
    kt: Number
    kb: Number


class Viscosity(NamedTuple):
    """Dashpots of one bond: normal cn [N s/m], shear cs [N s/m], twist ct [N m s/rad], bending cb [N m s/rad]."""

    cn: Number
    cs: Number
    ct: Number
    cb: Number


class Section(NamedTuple):
    """Cross-section of one bond: area A [m2] and bending modulus I/Rb [m3] (a circle's twist modulus is twice that)."""

    area: Number
    modulus: Number


class Load(NamedTuple):
    """What a bond answers: force on i [N] (the opposite on j), and the couple [N m], both acting at mid-chord.

    End i receives the torque r x force / 2 + couple, end j the torque r x force / 2 - couple: both momenta are
    conserved whatever the law.
    """

    force: Vector
    couple: Vector


# damage_law(deformation, memory, parameters) -> (damage, memory); memory and parameters: named tuples of the law's own
DamageFunction = Callable[[Deformation, Any, Any], tuple[Number, Any]]
# drag_law(coefficient, force, velocity, mass, dt) -> force; with torque, spin and inertia for the rotation
DragFunction = Callable[[Number, Vector, Vector, Number, Number], Vector]
