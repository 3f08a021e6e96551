"""The pull-out test as a model: geometry, stiffness, interface, supports.

Fibre and matrix are cut from one hexagonal close packing, its c axis along the pull. Bonds follow in closed form from
(E, nu); then each part is scaled by one static solve so that its axial stiffness EA is the nominal one. The interface
is made of joints with radial normals, whose areas sum to 2 pi r_f L. The matrix is held at its far face, the fibre is
pulled at its end.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem.bonds import Bond, Joint, ValuedLaw, springs
from pybondem.check import choice, fraction, nonnegative, positive
from pybondem.errors import InputError
from pybondem.interface import Interface, cylindrical
from pybondem.laws import bilinear
from pybondem.model import BondSet, Model, Selection
from pybondem.neighbours import pieces
from pybondem.packing import hcp
from pybondem.packing.shapes import Cylinder as CylinderShape
from pybondem.schedules import smooth
from pybondem.statics import axial_stiffness
from pybondem.theory import PullOut, shear_lag_compliance
from pybondem.theory.lattice import calibrate, elastic_constants

Floats = NDArray[np.float64]
LAYER = np.sqrt(2.0 / 3.0)  # distance of close-packed layers over the diameter
AXES = ("x", "y", "z")
LARGEST_NU = 0.2  # of hexagonal close packing, where ks = 0


@dataclass(frozen=True)
class PullOutSetup:
    """The values of the test; SI units.

    diameter: of the particles, fitted so that the embedded length is a whole number of layers; fibre_radius,
    matrix_radius, length (embedded), free_length (of fibre beyond the matrix): geometry; E_fibre, E_matrix, nu:
    elasticity, nu within the reach of the lattice (0 to 1/5); bond_radius: over that of the particles, with which bonds
    resist bending and twist (0: they resist neither); density; interface: a law with a stiffness per area;
    axis: of the pull; transits: duration of the test, in transits of the slower sound wave through the embedded
    length; damping: local damping; pull: final displacement of the end, by default 1.1 times the largest on the
    analytic path.
    """

    diameter: float = 0.7
    interface: ValuedLaw = field(default_factory=lambda: bilinear(stiffness=6e7, slip_peak=1e-4, slip_end=4e-4))
    fibre_radius: float = 1.0
    matrix_radius: float = 6.0
    length: float = 30.0
    free_length: float = 2.0
    E_fibre: float = 1e10
    E_matrix: float = 1e10
    nu: float = 0.1
    bond_radius: float = 0.0
    density: float = 2500.0
    axis: str = "x"
    transits: float = 60.0
    damping: float = 0.3
    pull: float | None = None

    def __post_init__(self) -> None:
        lengths = ("diameter", "fibre_radius", "matrix_radius", "length")
        for name in (*lengths, "E_fibre", "E_matrix", "density", "transits"):
            positive(f"{name} of pullout", getattr(self, name))
        nonnegative("free_length of pullout", self.free_length, "m")
        fraction("nu of pullout", self.nu, 0.0, LARGEST_NU)
        nonnegative("bond_radius of pullout", self.bond_radius, "1")
        if self.nu == LARGEST_NU and self.bond_radius == 0.0:
            raise InputError(
                f"nu of pullout is {self.nu}: its bonds have no shear stiffness, and nothing keeps the particles from "
                f"rolling along the interface; give a bond_radius, such as 1."
            )
        choice("axis of pullout", self.axis, AXES)
        if not isinstance(self.interface, ValuedLaw) or self.interface.stiffness is None:
            raise InputError("interface of pullout needs a stiffness per area: bilinear(stiffness=6e7, ...).")
        if self.matrix_radius <= self.fibre_radius + self.fitted_diameter:
            raise InputError(
                f"matrix_radius of pullout is {self.matrix_radius} m; it must leave room for a particle around the "
                f"fibre (radius {self.fibre_radius} m)."
            )

    # What it is -------------------------------------------------------------------------------------------------

    @property
    def layers(self) -> int:
        """Number of lattice layers along the embedded length."""
        return max(2, round(self.length / (LAYER * self.diameter)))

    @property
    def fitted_diameter(self) -> float:
        """Particle diameter with which the embedded length is a whole number of layers [m]."""
        return float(self.length / (LAYER * self.layers))

    @property
    def fitted_free_length(self) -> float:
        """Free length of fibre: the whole number of layers nearest to `free_length` [m]."""
        layer = float(LAYER * self.fitted_diameter)
        return round(self.free_length / layer) * layer

    def theory(self, shear_lag: bool = False) -> PullOut:
        """Return the analytic solution; shear_lag: with the shear compliance of fibre and matrix in series."""
        law, free_part = self.interface, self.fitted_free_length / (self.E_fibre * np.pi * self.fibre_radius**2)
        k, values = law.stiffness or 0.0, law.parameters
        plain = PullOut(
            self.E_fibre, self.E_matrix, self.fibre_radius, self.matrix_radius, self.length, k, values.slip_peak,
            values.slip_end, extra_compliance=free_part,
            residual_stress=k * values.slip_peak * getattr(values, "residual", 0.0),
        )  # fmt: skip
        if not shear_lag:
            return plain
        G = [self._shear_modulus(E) for E in (self.E_fibre, self.E_matrix)]
        return plain.with_shear_compliance(shear_lag_compliance(self.fibre_radius, self.matrix_radius, *G))

    def _shear_modulus(self, E: float) -> float:
        """Return the axial shear modulus C44 of the lattice that is calibrated to (E, nu) [Pa]."""
        kn, ks = calibrate("hcp", E, self.nu, self.fitted_diameter)
        return elastic_constants("hcp", kn, ks, self.fitted_diameter).C44

    @property
    def end(self) -> float:
        """Final displacement of the pulled end [m]."""
        if self.pull is not None:
            return positive("pull of pullout", self.pull, "m")
        theory = self.theory()
        turn = theory.turning_point() or theory.peak()
        return 1.1 * max(turn.displacement, theory.peak().displacement, theory.slip_end)

    @property
    def duration(self) -> float:
        """Duration of the test [s]."""
        return self.transits * self.length / float(np.sqrt(min(self.E_fibre, self.E_matrix) / self.density))

    # Building it ------------------------------------------------------------------------------------------------

    def build(self, engine: str = "cpu", threads: int | None = None) -> "PullOutModel":
        """Return the model, its parts scaled to their nominal EA by one static solve each."""
        d, r, L, along = self.fitted_diameter, self.fibre_radius, self.length, self.axis
        fibre_shape = CylinderShape(r, L + self.fitted_free_length, axis=along)
        matrix_shape = CylinderShape(self.matrix_radius, L, axis=along) - CylinderShape(r, L, axis=along)
        model = Model()
        parts = {"fibre": (fibre_shape, self.E_fibre, np.pi * r**2),
                 "matrix": (matrix_shape, self.E_matrix, np.pi * (self.matrix_radius**2 - r**2))}  # fmt: skip
        scales = {}
        for name, (shape, E, area) in parts.items():
            grains = hcp(d, inside=shape, axis=along)
            scales[name] = E * area / self._lattice_stiffness(Model(grains, self.density, name), E, engine, threads)
            model.add(grains, name=name, density=self.density)
        for name, (_, E, _) in parts.items():
            model.bond(model.touching(part=name), self._bond(E, scales[name]))
        surface = cylindrical(model, "fibre", "matrix", radius=r, length=L, axis=along)
        joints = model.join(surface.pairs, Joint(self.interface), normal=surface.normal, area=surface.area)
        return self._held(model, joints, surface, scales)

    def _bond(self, E: float, scale: float = 1.0) -> Bond:
        """Return the bond of a part; its bending and twist do not enter the elastic constants of the lattice."""
        kn, ks = (scale * k for k in calibrate("hcp", E, self.nu, self.fitted_diameter))
        radius = 0.5 * self.bond_radius * self.fitted_diameter
        return Bond(springs(kn, ks, kt=0.5 * ks * radius**2, kb=0.25 * kn * radius**2))

    def _lattice_stiffness(self, part: Model, E: float, engine: str, threads: int | None) -> float:
        """Return EA [N] of a part whose bonds have the closed-form values."""
        pairs = part.touching()
        part.bond(pairs, self._bond(E))
        count, _ = pieces(len(part), pairs[:, 0], pairs[:, 1])
        if count > 1:
            raise InputError(
                f"the {part.parts[0]} falls into {count} pieces with particles of {self.fitted_diameter:.3g} m; "
                f"take smaller particles."
            )
        at = part.x[:, AXES.index(self.axis)]
        half = 0.25 * LAYER * self.fitted_diameter
        low, high = (part.select(np.abs(at - end) < half) for end in (at.min(), at.max()))
        return axial_stiffness(part, low, high, self.axis, engine=engine, threads=threads)

    def _held(self, model: Model, joints: BondSet, surface: Interface, scales: dict[str, float]) -> "PullOutModel":
        """Hold the matrix at its far face and drive the end of the fibre."""
        half = 0.25 * LAYER * self.fitted_diameter
        tip = self.length + self.fitted_free_length
        lowest: dict[str, Any] = {self.axis: (None, half)}
        highest: dict[str, Any] = {self.axis: (tip - half, None)}
        face, pulled = model.where(**lowest, part="matrix"), model.where(**highest, part="fibre")
        model.fix(face, "x y z")
        across = " ".join(a for a in AXES if a != self.axis)
        model.fix(pulled, across)
        rise = 0.1 * self.duration
        speed = self.end / (self.duration - 0.5 * rise)
        model.drive(pulled, **{f"v{self.axis}": smooth(speed, over=rise)})
        return PullOutModel(self, model, joints, surface, face, pulled, scales)


@dataclass(frozen=True)
class PullOutModel:
    """The test as a model: joints of the interface and its geometry, held face, pulled end, scale of each part."""

    test: PullOutSetup
    model: Model
    joints: BondSet
    surface: Interface
    face: Selection
    pulled: Selection
    scales: dict[str, float]
