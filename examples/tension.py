"""Tension of a hexagonally packed cylinder until it breaks."""

import pybondem as bd

grains = bd.packing.hcp(diameter=1e-3, inside=bd.Cylinder(radius=5e-3, height=20e-3), axis="z")
rod = bd.Model(grains, density=2500.0)
rod.bond(rod.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), bd.strength(tension=5e6, shear=10e6)))
bottom, top = rod.where(z=(None, 1e-3)), rod.where(z=(19e-3, None))
rod.fix(bottom)
rod.drive(top, vz=bd.ramp(to=0.1, over=1e-4))
sim = bd.Simulation(rod, damping=bd.local(0.2))
pull = sim.record(every=20, force=bd.reaction(bottom, "z"), strain=bd.strain(bottom, top, "z"), broken=bd.broken())
sim.run(until=lambda: pull.force.last < 0.2 * pull.force.max and pull.broken.last > 0)
pull.plot("strain", "force", path="tension.png")
