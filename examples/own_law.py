"""A bond law of one's own: defined, tried, drawn, and pulled until the specimen breaks."""

import pybondem as bd


@bd.damage_law(
    parameters={"onset": "m", "end": "m"},
    memory={"widest": "m"},
    needs={"end > onset": lambda p: p.end > p.onset},
    toughness={"opening": lambda p, k: k * (p.onset**2 + p.onset * p.end + p.end**2) / 6.0},
)
def fading(d, m, p):
    """Stiffness that fades in proportion to the widest opening so far: between onset and end stress is a parabola."""
    widest = bd.maximum(m.widest, d.opening)
    return bd.minimum(1.0, bd.maximum(0.0, widest - p.onset) / (p.end - p.onset)), widest


law = fading(onset=5e-6, end=20e-6)
law.check()  # prints whether it conserves momentum, creates no energy, has the toughness declared above ...
law.plot(path="own_law.png")

grains = bd.packing.hcp(diameter=1e-3, inside=bd.Cylinder(radius=5e-3, height=20e-3), axis="z")
rod = bd.Model(grains, density=2500.0)
bonds = rod.bond(rod.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), law))
bottom, top = rod.where(z=(None, 1e-3)), rod.where(z=(19e-3, None))
rod.fix(bottom)
rod.drive(top, vz=bd.ramp(to=0.2, over=1e-4))
sim = bd.Simulation(rod, damping=bd.local(0.2))
pull = sim.record(every=20, force=bd.reaction(bottom, "z"), strain=bd.strain(bottom, top, "z"), broken=bd.broken())
sim.run(until=lambda: pull.force.last < 0.2 * pull.force.max and pull.broken.last > 0)
pull.plot("strain", "force", path="own_law_tension.png")

G_f = fading.toughness["opening"](law.parameters, 1e9 / 1e-3)  # here the stiffness per area of a bond is E / length
parted = G_f * sim.bonds(bonds).area[sim.bonds(bonds).damage == 1.0].sum()
print(f"G_f = {G_f:.1f} J/m2: opening the {sim.broken} broken bonds took {1e3 * parted:.2f} mJ,")
print(f"all damage {1e3 * sim.energies.damage:.2f} mJ, with the shear in them and the bonds that did not break.")
