"""A law on trial: many separate pairs of spheres, bonded with it, moved by hand on a real engine.

    trial = Trial(bilinear(slip_peak=1e-5, slip_end=4e-5), element="joint", count=2)
    for local in paths.cyclic(paths.deformation(s=[1e-5, 2e-5])):
        answer = trial.evaluate(trial.pose(local))

The program consists of the stages of the bonds and the gather of the time step, and of nothing else: what the pairs
answer is what bonds answer in a simulation.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pybondem.assembly import assemble, bond_stage, called
from pybondem.bonds import Bond, Elastic, Joint, ValuedLaw, springs
from pybondem.check import Floats, choice
from pybondem.engines.choose import make_engine
from pybondem.laws.poses import (
    Geometry,
    Motions,
    Poses,
    Rigid,
    dot,
    geometry,
    motions,
    moved,
    poses,
    random_axes,
    rotation_vector,
    turned,
)
from pybondem.model import Model
from pybondem.neighbours import own_bonds
from pybondem.packing import Particles
from pybondem.program import Program, Stage
from pybondem.scatter import Scatter

ELEMENTS = ("bond", "joint")
LENGTH = 1e-2  # of the pairs [m], radius half of it
RADIUS_RATIO = 0.8
NORMAL = 1e11  # normal stiffness per area [Pa/m]: a modulus of 1 GPa over LENGTH
SHEAR = 0.4  # shear stiffness as a share of the normal one, where the law brings none of its own
TWIST, BENDING = 0.2, 0.25  # twist and bending stiffness as shares of normal stiffness times bond radius squared
TILT = 0.4  # angle between the chord of a joint and its normal [rad]
DENSITY = 2500.0  # [kg/m3]


class Answer(NamedTuple):
    """What all pairs answer: forces and torques on both ends (3, count), and (count,) of everything else.

    damage [-]: the least of its modes where each has its own, of a bond law its word of that name, 0 without one;
    damages (modes, count); memory: words by name; lost [J]: energy dissipated so far; own (6, count): the six loads of
    a bond law as it gave them [N, N m], None under a damage law.
    """

    force_i: Floats
    torque_i: Floats
    force_j: Floats
    torque_j: Floats
    damage: Floats
    damages: Floats
    memory: dict[str, Floats]
    lost: Floats
    own: Floats | None


class History(NamedTuple):
    """The answers along a path: one entry for each point, `count` columns.

    local (points, 6, count): where the pairs were; load (points, 6, count): what holds them there, along the axes of
    each pair: force n, s, t on j [N], positive n in tension, and half the torque on j less that on i [N m]; damage and
    damages as in `Answer`; lost [J]: booked by the bond; work [J]: done on it through its ends (trapezoid rule); memory
    (points, words, count).
    """

    local: Floats
    load: Floats
    damage: Floats
    damages: Floats
    lost: Floats
    work: Floats
    memory: Floats


class Trial:
    """Separate pairs of spheres bonded with one law.

    law: with one value for each parameter, or one per pair; element: "bond" or "joint"; engine: by name; count: of
    pairs; elastic: form of bonds (default: springs of different stiffness in every mode); length of the pairs [m];
    axes: triads (3, 3, count), random by default; tilt: of a joint's chord [rad]; exchanged: each pair is given to the
    bond the other way round. Raises InputError for an unknown element or engine.
    """

    def __init__(self, law: ValuedLaw, element: str = "bond", engine: str = "reference", count: int = 1,
                 elastic: Elastic | None = None, length: float = LENGTH, axes: Floats | None = None, tilt: float = TILT,
                 exchanged: bool = False, seed: int = 0) -> None:  # fmt: skip
        interface = choice("element of Trial", element, ELEMENTS) == "joint"
        triads = random_axes(count, seed) if axes is None else axes
        self.law, self.element, self.count = law, element, triads.shape[2]
        self.geometry: Geometry = geometry(triads, length, tilt if interface else 0.0, interface)
        self._model = _pairs_of(law, self.geometry, length, elastic)
        self._done = assemble(self._model)
        self._place = self._done.position.reshape(-1, 2).T  # of first and second ends, in memory
        self._arrays = self._done.bonds[self._done.blocks[0].name]
        self._bring_to_origin()
        if exchanged:
            self._exchange()
        self._order = np.argsort(self._done.bond_order(0))  # pair -> bond in memory
        self._fresh = {n: a.copy() for n, a in self._arrays.items() if isinstance(a, np.ndarray)}
        stages = (bond_stage(self._done, 0), Stage("gather"))
        done = self._done
        program = Program(stages, done.blocks, done.particles, done.bonds, done.shared, (called(law),))
        self._runner = make_engine(engine).prepare(program)

    def _bring_to_origin(self) -> None:
        """Place every pair with its middle at the origin, where its chord has all its digits."""
        start = self._done.particles["start"]
        for place, sign in zip(self._place, (-0.5, 0.5), strict=True):
            start[:, place] = sign * self.geometry.chord

    def _exchange(self) -> None:
        """Let each bond have its ends the other way round: chord and normal of the interface turn with them."""
        arrays = self._arrays
        arrays["i"], arrays["j"] = arrays["j"], arrays["i"]
        if "normal" in arrays:
            arrays["normal"] = -arrays["normal"]
        first, ends = own_bonds(arrays["i"], arrays["j"], len(self._model))
        self._done.shared.update(first=first, ends=ends)

    @property
    def stiffness(self) -> Floats:
        """Stiffness normal, shear [N/m], twist, bending [N m/rad] and cross-section [m2] of every pair, (5,)."""
        return np.array([float(np.ravel(self._arrays[name])[0]) for name in ("kn", "ks", "kt", "kb", "area")])

    def reset(self) -> None:
        """Make all bonds as new."""
        for name, fresh in self._fresh.items():
            self._arrays[name][...] = fresh

    def pose(self, local: Floats) -> Poses:
        """Return the poses that give the pairs a deformation, (6,) for all or (6, count) (see `paths`)."""
        each = np.asarray(local, float)
        return poses(self.geometry, np.repeat(each[:, None], self.count, axis=1) if each.ndim == 1 else each)

    def evaluate(self, at: Poses, moving: Motions | None = None, dt: float = 1.0) -> Answer:
        """Set poses and motions (at rest where there are none) and evaluate every bond once, dt [s] after the last."""
        fields = self._done.particles
        (i, j), still = self._place, np.zeros((3, self.count))
        given = moving or Motions(still, still, still, still)
        for place, x, q, v, w in ((i, at.x_i, at.q_i, given.v_i, given.w_i), (j, at.x_j, at.q_j, given.v_j, given.w_j)):
            for names, value in ((("x",), x), (("q",), q), (("v", "v_ahead"), v), (("w", "w_ahead"), w)):
                for name in names:
                    fields[name][:, place] = value
        self._runner.advance(1, dt, {"growing": np.ones(2)})
        force, torque = fields["force"], fields["torque"]
        words = {name: self._bond_values(f"m_{name}") for name in self.law.memory._fields}
        damage = self._damage(words)
        damages = self._bond_values("damages") if "damages" in self._arrays else damage[None, :]
        own = self._bond_values("answer") if "answer" in self._arrays else None
        return Answer(force[:, i], torque[:, i], force[:, j], torque[:, j], damage, damages, words,
                      self._bond_values("lost"), own)  # fmt: skip

    def _bond_values(self, name: str) -> Floats:
        """Return a field of the bonds (..., count), pair by pair."""
        values: Floats = self._arrays[name][..., self._order]
        return values

    def _damage(self, words: dict[str, Floats]) -> Floats:
        if "damage" in self._arrays:
            return self._bond_values("damage")
        return words.get("damage", np.zeros(self.count))

    def local(self, vectors: Floats, axial: bool = False) -> Floats:
        """Return vectors (3, count) along the axes n, s, t of each pair; axial: torques, which a mirror turns round."""
        along = np.stack([dot(axis, vectors) for axis in self.geometry.axes])
        return along * self.geometry.handed if axial else along

    def follow(self, path: Floats, dt: float = 1.0, rigid: list[Rigid] | None = None) -> History:
        """Drive all pairs along a path (points, 6) or (points, 6, count), dt [s] from point to point, and keep all.

        rigid: a rigid motion of the whole pair on top, one for each point; loads are then given turned back.
        """
        points, before, last = [], self.pose(path[0]), None
        work = np.zeros(self.count)
        for k, local in enumerate(path):
            unturned = self.pose(local)
            motion = rigid[k] if rigid is not None else None
            at = unturned if motion is None else moved(unturned, motion)
            answer = self.evaluate(at, motions(before, unturned, dt, motion), dt)
            if last is not None:
                work = work + _work(*last, at, answer)
            before, last = unturned, (at, answer)
            points.append((self._load(answer, motion), answer, work))
        answers = [answer for _, answer, _ in points]
        local_path = path if path.ndim == 3 else np.repeat(path[:, :, None], self.count, axis=2)
        return History(
            local_path, np.stack([load for load, _, _ in points]), np.stack([a.damage for a in answers]),
            np.stack([a.damages for a in answers]), np.stack([a.lost for a in answers]),
            np.stack([done for _, _, done in points]),
            np.stack([np.reshape(list(a.memory.values()), (len(a.memory), self.count)) for a in answers]),
        )  # fmt: skip

    def _load(self, answer: Answer, motion: Rigid | None) -> Floats:
        """Return what holds the pair deformed (6, count), turned back from a rigid motion, along its axes."""
        force, moment = -answer.force_j, -0.5 * (answer.torque_j - answer.torque_i)
        if motion is not None:
            back = (motion.rotation * np.array([1.0, -1.0, -1.0, -1.0]))[:, None]
            force, moment = turned(back, force), turned(back, moment)
        return np.concatenate([self.local(force), self.local(moment, axial=True)])


def _work(at: Poses, answer: Answer, then: Poses, next_answer: Answer) -> Floats:
    """Return the work done on each bond by moving its ends from one pose to the next (count,) [J], trapezoid rule."""
    moves = (
        (answer.force_i + next_answer.force_i, then.x_i - at.x_i),
        (answer.force_j + next_answer.force_j, then.x_j - at.x_j),
        (answer.torque_i + next_answer.torque_i, rotation_vector(at.q_i, then.q_i)),
        (answer.torque_j + next_answer.torque_j, rotation_vector(at.q_j, then.q_j)),
    )
    return -0.5 * np.sum([dot(load, move) for load, move in moves], axis=0)


def single(law: ValuedLaw) -> ValuedLaw:
    """Return the law with one number for each parameter: the median where there are many, or a scatter."""
    values = [
        float(v.distribution.quantile(np.array([0.5]))[0]) if isinstance(v, Scatter) else float(np.median(v))
        for v in law.parameters
    ]
    return replace(law, parameters=type(law.parameters)(*values))


def _pairs_of(law: ValuedLaw, g: Geometry, length: float, elastic: Elastic | None) -> Model:
    """Return a model of pairs far apart from one another."""
    count = g.chord.shape[1]
    side = int(np.ceil(count ** (1.0 / 3.0)))
    middles = 10.0 * length * np.stack(np.unravel_index(np.arange(count), (side, side, side)))
    x = np.stack([middles - 0.5 * g.chord, middles + 0.5 * g.chord]).transpose(2, 0, 1).reshape(-1, 3)
    model = Model(Particles(x, np.full(2 * count, 0.5 * length)), DENSITY)
    pairs = np.arange(2 * count).reshape(-1, 2)
    if g.interface:
        shear = law.stiffness or SHEAR * NORMAL
        joint = Joint(replace(law, stiffness=shear), normal_stiffness=shear / SHEAR)
        model.join(pairs, joint, normal=g.axes[0].T, area=_area(length))
    else:
        form = elastic or _springs(law.stiffness or SHEAR * NORMAL, length)
        model.bond(pairs, Bond(form, replace(law, stiffness=None)))
    return model


def _springs(shear: float, length: float) -> Elastic:
    """Return springs of different stiffness in every mode, shear [Pa/m] per area."""
    kn, radius = shear / SHEAR * _area(length), RADIUS_RATIO * 0.5 * length
    return springs(kn, SHEAR * kn, TWIST * kn * radius**2, BENDING * kn * radius**2, RADIUS_RATIO)


def _area(length: float) -> float:
    """Return the cross-section of a pair [m2]."""
    return float(np.pi * (RADIUS_RATIO * 0.5 * length) ** 2)
