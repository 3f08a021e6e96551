"""The stress in a particle, from the forces in its bonds."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import finite_array, positive, positive_array
from pybondem.errors import InputError

Floats = NDArray[np.float64]


def particle_stress(x: ArrayLike, pairs: ArrayLike, force: ArrayLike, volume: ArrayLike) -> Floats:
    """Return the mean stress in each particle (n, 3, 3) [Pa], tension positive.

    x (n, 3) [m]: centres; pairs (m, 2): ends of the bonds; force (m, 3) [N]: on the first end of each; volume (n,), or
    one for all [m3]: that each particle stands for, so that the volumes fill the body. A bond of force f and branch l,
    from its first end to its second, gives f l / 2 to both its ends, over their volumes (Love 1927; Weber 1966).
    The sum of stress times volume over a body at rest is exactly that of force times place over what loads it.
    Rows are the direction of the force. Raises InputError for arrays that do not match, or pairs of no particle.
    """
    centres = finite_array("x of particle_stress", x, (None, 3))
    forces = finite_array("force of particle_stress", force, (None, 3))
    count, ends = len(centres), np.asarray(pairs)
    if ends.dtype.kind not in "iu" or ends.shape != (len(forces), 2):
        raise InputError(
            f"pairs of particle_stress is {ends.dtype} of shape {ends.shape}; it must be whole numbers "
            f"({len(forces)}, 2)."
        )
    if ends.size and not 0 <= int(ends.min()) <= int(ends.max()) < count:
        raise InputError(f"pairs of particle_stress name particles {ends.min()} to {ends.max()}; there are {count}.")
    if np.ndim(volume) == 0:
        volumes = np.full(count, positive("volume of particle_stress", volume, "m3"))
    else:
        volumes = positive_array("volume of particle_stress", volume, (count,), "m3")
    half = 0.5 * forces[:, :, None] * (centres[ends[:, 1]] - centres[ends[:, 0]])[:, None, :]
    total = np.zeros((count, 3, 3))
    for end in ends.T:
        np.add.at(total, end, half)
    return total / volumes[:, None, None]
