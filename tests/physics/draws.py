"""What the tests of the plain functions draw: numbers, vectors, rotations, poses of the two ends of a bond."""

from math import pi

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pybondem.physics.types import Motion, Pose, Reference, Stiffness

quick = settings(max_examples=60, deadline=None, derandomize=True)


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


def vectors(size=1.0):
    return st.tuples(*[numbers(-size, size)] * 3)


units = vectors().filter(lambda a: np.linalg.norm(a) > 0.1).map(lambda a: tuple(np.array(a) / np.linalg.norm(a)))


def turns(largest):
    """Rotations by up to `largest` [rad] about any axis."""
    return st.tuples(units, numbers(0.0, largest)).map(lambda t: Rotation.from_rotvec(t[1] * np.array(t[0])))


def quaternion(rotation):
    x, y, z, w = rotation.as_quat().tolist()
    return w, x, y, z


@st.composite
def bonds(draw, turn=0.5, strain=0.1):
    """Draw poses of two ends, relative rotation up to `turn`, and the reference: a skew chord and normal."""
    length = draw(numbers(0.5, 2.0))
    r0 = length * np.array(draw(units))
    common = draw(turns(pi))
    first = draw(turns(pi))
    second = draw(turns(turn)) * first
    middle = Rotation.from_rotvec(0.5 * (second * first.inv()).as_rotvec()) * first
    r = middle.apply(r0) + strain * length * np.array(draw(vectors()))
    x = np.array(draw(vectors(3.0)))
    i = Pose(tuple(common.apply(x)), quaternion(common * first))
    j = Pose(tuple(common.apply(x + r)), quaternion(common * second))
    return i, j, Reference(tuple(r0), draw(units))


stiffnesses = st.builds(Stiffness, *[numbers(0.1, 3.0)] * 4)
motions = st.builds(Motion, vectors(), vectors())
