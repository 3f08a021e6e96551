"""Looking at the bonds of a running model: their fields, deformation, and which of them have failed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem.assembly import Assembly
from pybondem.bond_answers import felt, least
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError, LawError, UnstableError
from pybondem.model import BondSet
from pybondem.physics.frame import components, relative_pose
from pybondem.physics.types import Damage, Pose, Reference, Section, Stiffness
from pybondem.state import Fields

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
BLOWN_UP = 10.0  # elongation over length: what a law says there means nothing


def number_of(state: Assembly, bonds: BondSet) -> int:
    """Return the number of a bond set in its model; raises InputError where it is of another."""
    for number, known in enumerate(state.model.bonds):
        if known is bonds:
            return number
    raise InputError("these bonds are not of this model; use what Model.bond or Model.join returned.")


def bond_fields(state: Assembly, number: int, energy: Floats) -> SimpleNamespace:
    """Return copies of the fields of a bond set, in the order of its pairs; energy (bonds,) [J]: of all bonds."""
    bonds, block, order = state.model.bonds[number], state.blocks[number], state.bond_order(number)
    back = np.empty(len(order), np.int64)
    back[order] = np.arange(len(order))
    arrays = state.bonds[block.name]
    part = slice(block.first, block.first + block.count)
    kept_order = state.order[arrays["i"]] == bonds.pairs[order, 0]
    force = np.where(kept_order, 1.0, -1.0) * state.shared["load"][:3, part]
    fields = {name: np.broadcast_to(a, len(back)) for name, a in arrays.items() if np.ndim(a) < 2}
    fields.setdefault("damage", np.zeros(len(back)))
    fields |= {"energy": energy[part], "force": force.T}
    fields |= {name: arrays[name].T for name in ("damages", "answer") if name in arrays}
    fields |= {"i": state.order[arrays["i"]], "j": state.order[arrays["j"]]}
    return SimpleNamespace(**{name: np.array(value[back]) for name, value in fields.items()})


def interface(state: Assembly, number: int) -> tuple[Floats, Floats]:
    """Return slip (m,) [m] and shear stress (m,) [Pa] of a set of joints, in the order of its pairs."""
    if state.model.bonds[number].area is None:
        raise InputError("interface needs joints (Model.join), these are bonds.")
    arrays, order = state.bonds[state.blocks[number].name], state.bond_order(number)
    slip, tau = np.empty(len(order)), np.empty(len(order))
    slip[order] = _seen(state, number)["slip"]
    if "answer" in arrays:
        tau[order] = np.hypot(arrays["answer"][1], arrays["answer"][2]) / arrays["area"]
    else:
        damage = arrays["damages"][1] if "damages" in arrays else arrays["damage"]
        tau[order] = (1.0 - damage) * arrays["ks"] / arrays["area"] * slip[order]
    return slip, tau


def failed_pairs(state: Assembly) -> Ints:
    """Return the pairs of particles (k, 2) whose bonds have failed, lower index first, sorted.

    Such a pair is one for a contact law; until then its bond answers for it.
    """
    found = [np.empty((0, 2), np.int64)]
    for block in state.blocks:
        arrays = state.bonds[block.name]
        failed = np.broadcast_to(_least_damage(arrays) >= 1.0, block.count)
        found.append(np.sort(np.stack([state.order[arrays[end][failed]] for end in "ij"], axis=1), axis=1))
    return np.unique(np.concatenate(found), axis=0)


def _least_damage(arrays: Fields) -> Any:
    """Return the least damage of the modes that each bond of a block has: 1 once nothing is left of it."""
    if "damages" not in arrays:
        return np.asarray(arrays.get("damage", 0.0))
    k = Stiffness(*(arrays[name] for name in ("kn", "ks", "kt", "kb")))
    return on_arrays(least)(k, Damage(*arrays["damages"]))


def refuse_values(state: Assembly, steps: tuple[int, int]) -> None:
    """Raise LawError where a law has returned a value that is not finite, UnstableError where its bond has blown up.

    steps: first and last it may have been in.
    """
    for number, block in enumerate(state.blocks):
        arrays = state.bonds[block.name]
        if "lost" not in arrays or np.isfinite(arrays.total("lost")):
            continue
        lost = arrays["lost"]
        k, count = int(np.argmin(np.isfinite(lost))), int(np.count_nonzero(~np.isfinite(lost)))
        when = f"at step {steps[1]}" if steps[0] >= steps[1] else f"between steps {steps[0]} and {steps[1]}"
        opening = _opening(_seen(state, number), k)
        if not abs(opening) < BLOWN_UP:
            i, j = (int(state.order[arrays[end][k]]) for end in "ij")
            raise UnstableError(
                f"the motion has blown up {when}: the bond between particles {i} and {j} is {1.0 + opening:.3g} times "
                f"as long as at first, the first of {count} such bonds; lower dt."
            )
        raise LawError(
            f"{_which(state, number, k)} gave a damage outside 0 to 1, or a value that is "
            f"not finite, {when} ({count} bonds in all)."
        )


def _opening(seen: dict[str, Any], k: int) -> float:
    """Return the opening of a bond over its length."""
    opening, length = np.broadcast_arrays(seen["n"] if "n" in seen else seen["opening"], seen["length"])
    return float(opening[k]) / float(length[k])


def _which(state: Assembly, number: int, k: int) -> str:
    """Return a law and one of its bonds in words: ends, deformation, memory, parameters."""
    arrays, law = state.bonds[state.blocks[number].name], state.model.bonds[number].bond.law
    assert law is not None  # what has lost energy has a law
    i, j = (int(state.order[arrays[end][k]]) for end in "ij")
    own = {name[2:]: value for name, value in arrays.items() if name[:2] in ("p_", "m_")}
    values = {name: np.broadcast_to(value, len(arrays["i"])) for name, value in (_seen(state, number) | own).items()}
    said = ", ".join(f"{name} = {value[k]:.4g}" for name, value in values.items())
    return f"the law {law.name} of the bond between particles {i} and {j}, now at {said},"


def _seen(state: Assembly, number: int) -> dict[str, Any]:
    """Return what the law of a bond set sees of its bonds now, by name (m,), in memory order."""
    bonds, element, p = state.model.bonds[number], state.element(number), state.particles
    arrays = state.bonds[state.blocks[number].name]
    i, j = (Pose(tuple(p["x"][:, arrays[end]]), tuple(p["q"][:, arrays[end]])) for end in "ij")
    chord = tuple(state.chord(arrays))
    ref = Reference(chord, tuple(arrays["normal"]) if "normal" in arrays else chord)
    rel = on_arrays(relative_pose)(i, j)
    stretch = on_arrays(element.stretch)(rel, ref)
    if bonds.bond.law is not None and bonds.bond.law.kind == "bond":
        axes = on_arrays(element.axes)(rel, ref)
        seen = on_arrays(components)(rel, ref, axes, arrays["area"], stretch)._asdict()
        return {**seen, "slip": np.hypot(seen["s"], seen["t"])}
    k = Stiffness(*(arrays[name] for name in ("kn", "ks", "kt", "kb")))
    found: dict[str, Any] = on_arrays(felt)(stretch, k, Section(arrays["area"], arrays["modulus"]), ref)._asdict()
    return found
