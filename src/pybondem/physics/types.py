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
    area of the undeformed bond [m, m2], the stresses that the undamaged bond would carry [Pa]: normal_stress
    F_n/A (positive in tension), shear_stress |F_s|/A, bending_stress |M_b| Rb/I, twist_stress |M_t| Rb/J, and its
    stiffness per area [Pa/m]: normal_stiffness kn/A, shear_stiffness ks/A.
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
    normal_stiffness: Number
    shear_stiffness: Number


class Rate(NamedTuple):
    """How fast a bond deforms, for a damage law: opening (signed), slip [m/s], twist, bending [rad/s] (magnitudes)."""

    opening: Number
    slip: Number
    twist: Number
    bending: Number


class Damage(NamedTuple):
    """Damage of each mode, 0 whole to 1 gone: D_n (in tension), D_s, D_t, D_b [-]."""

    normal: Number
    shear: Number
    twist: Number
    bending: Number


class Components(NamedTuple):
    """What a bond law sees: the six components of deformation in the bond's own frame, and its size.

    n [m]: elongation or opening, positive in tension; s, t [m]: slip of j relative to i along two axes normal to n,
    which turn with the material and point in no special direction; twist, bend_s, bend_t [rad]: relative rotation of
    the ends about n, s, t; length [m] and area [m2] of the undeformed bond.
    """

    n: Number
    s: Number
    t: Number
    twist: Number
    bend_s: Number
    bend_t: Number
    length: Number
    area: Number


class ComponentRates(NamedTuple):
    """How fast a bond deforms, for a bond law: n, s, t [m/s], twist, bend_s, bend_t [rad/s]."""

    n: Number
    s: Number
    t: Number
    twist: Number
    bend_s: Number
    bend_t: Number


class Loads(NamedTuple):
    """What a bond law answers: forces n, s, t [N] and moments twist, bend_s, bend_t [N m], conjugate to
    `Components`."""

    n: Number
    s: Number
    t: Number
    twist: Number
    bend_s: Number
    bend_t: Number


class Frame(NamedTuple):
    """Axes of a bond, unit vectors in global axes.

    n: the direction of opening; s, t: the axes of slip, which turn with the material; e: the chord of the material;
    bend_s, bend_t: the axes of bending, normal to the chord as it is now.
    """

    n: Vector
    s: Vector
    t: Vector
    e: Vector
    bend_s: Vector
    bend_t: Vector


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


# law(deformation, stiffness, memory, parameters, rate, dt) -> (damage or Damage, memory) of a damage law, or
# (Loads, memory) of a bond law, which sees Components and rates of these; memory and parameters are named tuples of the
# law's own, the memory that comes back a plain tuple
LawFunction = Callable[[Any, Stiffness, Any, Any, Any, Number], tuple[Any, Any]]
# potential(components, stiffness, memory, parameters) -> stored energy [J] of a bond law
PotentialFunction = Callable[[Components, Stiffness, Any, Any], Number]
# drag_law(coefficient, force, velocity, mass, dt) -> force; with torque, spin and inertia for the rotation
DragFunction = Callable[[Number, Vector, Vector, Number, Number], Vector]
