"""The same run again has the same bits, while bonds break: on every engine, and on a GPU where there is one."""

from engines.scenes import cluster, fragile, loaded

REPEATS = 5
STEPS = {"reference": 200, "interpreted": 25}  # where 10 000 take minutes
PARTICLES = ("x", "q", "v", "w", "force", "torque", "work")
BONDS = ("damage", "energy", "force", "lost", "damped")


def test_s1_five_runs_with_breaking_bonds_have_the_same_bits(engine):
    scene = loaded(cluster(5, fragile(), sites=2.0), 5, strain=2e-4, turn=2e-4, speed=1.0)
    states = []
    for _ in range(REPEATS):
        sim = scene.build(engine)
        before = sim.broken
        sim.run(STEPS.get(engine, 10_000), quiet=True)
        assert before <= sim.broken < sim.bond_count
        assert engine not in ("cpu", "cuda") or before < sim.broken  # the others run too few steps for it
        particles, bonds = sim.particles, sim.bonds(sim.model.bonds[0])
        state = {name: getattr(particles, name).tobytes() for name in PARTICLES}
        states.append(state | {name: getattr(bonds, name).tobytes() for name in BONDS})
    for state in states[1:]:
        assert [name for name in state if state[name] != states[0][name]] == []
