"""Scenes for the invariants: a small cluster that holds every kind of bond at once, in a random loaded state."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import pybondem as bd

LENGTH = 1e-2  # distance of neighbours [m]
DENSITY = 2500.0  # [kg/m3]
E = 1e9  # [Pa]
DT = 2e-7  # [s], a tenth of the critical step of these scenes or less

Families = Mapping[str, bd.Bond | bd.Joint]


def families(toughness: float = 1.0) -> Families:
    """Return every elastic form and damage law, and joints, with and without dashpots.

    At toughness 1 some bonds of each kind are whole, some softening and some broken in the state of `Scene.loaded`.
    """

    def soft(peak: float, end: float, stiffness: float | None = None) -> Any:
        return bd.bilinear(slip_peak=toughness * peak, slip_end=toughness * end, stiffness=stiffness)

    def brittle(tension: float, shear: float, share: float) -> Any:
        return bd.strength(tension=toughness * tension, shear=toughness * shear, moment_share=share)

    return {
        "elastic": bd.Bond(bd.parallel(E=E, stiffness_ratio=2.0, radius_ratio=0.8)),
        "viscous": bd.Bond(bd.timoshenko(E=E, nu=0.2, radius_ratio=0.7), damping=0.05),
        "brittle viscous": bd.Bond(
            bd.euler_bernoulli(E=E, nu=0.3, radius_ratio=0.6), brittle(5e7, 7e7, 0.5), damping=0.02
        ),
        "softening": bd.Bond(bd.springs(kn=4e6, ks=1e6), soft(3e-4, 9e-4)),
        "joint": bd.Joint(soft(3e-4, 9e-4, stiffness=1e11), normal_stiffness=3e11),
        "joint viscous": bd.Joint(soft(2e-4, 9e-4, stiffness=5e10), damping=0.05),
    }


def beams() -> Families:
    """Return plain elastic beams."""
    return {"beam": bd.Bond(bd.timoshenko(E=E, nu=0.2, radius_ratio=0.8))}


def unbreakable() -> Families:
    """Return beams, and joints that never soften: a conservative system."""
    return {
        **beams(),
        "joint": bd.Joint(bd.bilinear(slip_peak=1.0, slip_end=2.0, stiffness=1e11), normal_stiffness=3e11),
    }


def fragile() -> Families:
    """Return brittle bonds with weak dashpots, of which many but not all break in fast motion, some of them late."""
    glue = bd.parallel(E=E, stiffness_ratio=2.0, radius_ratio=0.8)
    return {"fragile": bd.Bond(glue, bd.strength(tension=4e6, shear=2.2e6), damping=1e-4)}


def quaternions(rotation: Rotation) -> np.ndarray:
    """Return unit quaternions, scalar first, of a random one of the two signs that mean the same rotation."""
    q = np.roll(rotation.as_quat(), 1, axis=-1)
    return np.where(np.random.default_rng(1).random(len(q)) < 0.5, -1.0, 1.0)[:, None] * q


def rotations(q: np.ndarray) -> Rotation:
    """Return the rotations that quaternions, scalar first, mean."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


@dataclass(frozen=True)
class Scene:
    """Particles as bonded (x0, radius), pairs and normals of each family of bonds, and the state to look at."""

    families: Families
    x0: np.ndarray
    radius: np.ndarray
    pairs: dict[str, np.ndarray]
    normals: dict[str, np.ndarray]
    x: np.ndarray
    q: np.ndarray
    v: np.ndarray
    w: np.ndarray

    def build(self, engine: str, prepare: Callable[[bd.Model], None] | None = None, **options: Any) -> bd.Simulation:
        """Return a simulation of the scene in its state; its model has one bond set per family, in their order."""
        model = bd.Model(bd.packing.Particles(self.x0, self.radius), density=DENSITY)
        for name, bond in self.families.items():
            if isinstance(bond, bd.Joint):
                model.join(self.pairs[name], bond, normal=self.normals[name], area=5e-5)
            else:
                model.bond(self.pairs[name], bond)
        if prepare:
            prepare(model)
        sim = bd.Simulation(model, engine=engine, **({"dt": DT} | options))
        self.put(sim)
        return sim

    def put(self, sim: bd.Simulation) -> None:
        """Bring a simulation into the state of the scene."""
        with sim.edit("x", "q", "v", "w") as (x, q, v, w):
            x[:], q[:], v[:], w[:] = self.x, self.q, self.v, self.w


def cluster(seed: int, kinds: Families, sites: float = 1.2, gap: float = 0.25) -> Scene:
    """Return a whole, resting cluster of spheres of unequal size within `sites` diameters of the centre.

    1.2 gives 13 spheres and about 36 bonds, dealt out at random to the families.
    """
    rng = np.random.default_rng(seed)
    grid = bd.packing.fcc(diameter=LENGTH, inside=bd.Sphere(radius=sites * LENGTH)).x
    n = len(grid)
    x = grid + rng.normal(scale=0.02 * LENGTH, size=grid.shape)
    radius = 0.5 * LENGTH * rng.uniform(0.85, 1.05, n)
    pairs = rng.permutation(bd.Model(bd.packing.Particles(x, radius), density=DENSITY).touching(gap=gap))
    dealt = {name: pairs[k :: len(kinds)] for k, name in enumerate(kinds)}
    normals = {name: rng.normal(size=(len(p), 3)) for name, p in dealt.items()}
    q = np.zeros((n, 4))
    q[:, 0] = 1.0
    return Scene(kinds, x, radius, dealt, normals, x, q, np.zeros((n, 3)), np.zeros((n, 3)))


def loaded(
    scene: Scene, seed: int, strain: float = 0.03, turn: float = 0.03, speed: float = 3.0, shift: float = 3.0
) -> Scene:
    """Return a scene in a random state, all turned as one by any angle and moved as one by `shift` LENGTH.

    strain: displacements [LENGTH]; turn: rotations [rad]; speed: velocities [m/s], and twice that over LENGTH of spin.
    """
    rng = np.random.default_rng(seed)
    n = len(scene.x0)
    moved = scene.x0 + rng.normal(scale=strain * LENGTH, size=(n, 3))
    turned = Rotation.from_rotvec(rng.normal(scale=turn, size=(n, 3)))
    v, w = speed * rng.normal(size=(n, 3)), 2.0 * speed / LENGTH * rng.normal(size=(n, 3))
    state = replace(scene, x=moved, q=quaternions(turned), v=v, w=w)
    return moved_as_one(state, Rotation.random(random_state=seed), shift * LENGTH * rng.normal(size=3))


def moved_as_one(scene: Scene, by: Rotation, shift: np.ndarray) -> Scene:
    """Return the scene with its state turned and shifted as one rigid body."""
    return replace(
        scene,
        x=by.apply(scene.x) + shift,
        q=quaternions(by * rotations(scene.q)),
        v=by.apply(scene.v),
        w=by.apply(scene.w),
    )


def built_elsewhere(scene: Scene, by: Rotation, shift: np.ndarray) -> Scene:
    """Return the scene seen from another frame: places at bonding, normals and state turned and shifted together."""
    other = moved_as_one(scene, by, shift)
    return replace(
        other,
        x0=by.apply(scene.x0) + shift,
        normals={name: by.apply(normal) for name, normal in scene.normals.items()},
        q=quaternions(by * rotations(scene.q) * by.inv()),
    )


def relabelled(scene: Scene, seed: int) -> tuple[Scene, np.ndarray]:
    """Return the scene with its particles and bonds in another order and some bonds given from their other end, and
    the old number of each particle."""
    rng = np.random.default_rng(seed)
    old = rng.permutation(len(scene.x0))
    new = np.argsort(old)
    pairs, normals = {}, {}
    for name, given in scene.pairs.items():
        order, swap = rng.permutation(len(given)), rng.random(len(given))[:, None] < 0.5
        pairs[name] = np.where(swap, new[given][:, ::-1], new[given])[order]
        normals[name] = np.where(swap, -scene.normals[name], scene.normals[name])[order]
    particles = {name: getattr(scene, name)[old] for name in ("x0", "radius", "x", "q", "v", "w")}
    return replace(scene, pairs=pairs, normals=normals, **particles), old


def assert_near(found: Any, expected: Any, tolerance: float, what: str = "") -> None:
    """Hold two arrays equal within `tolerance` times the largest magnitude of what is expected."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, what
    scale = float(np.max(np.abs(expected), initial=0.0))
    error = float(np.max(np.abs(found - expected), initial=0.0))
    assert error <= tolerance * scale, (
        f"{what}: off by {error:.3g} of {scale:.3g}, {error / (scale or 1.0):.2g} relative"
    )
