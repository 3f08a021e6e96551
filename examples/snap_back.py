"""A fibre pulled out of a matrix, through snap-back: the end has to go back while the bond goes on failing.

Load and displacement both turn back, which no pulled end can follow. Here the load follows so that each step dissipates
the same energy (dissipation control). Beside it the analytic path.
"""

import pybondem as bd

test = bd.examples.pullout(diameter=1.0)
theory, built = test.theory(), test.build()
path = bd.dissipation_control(built.model, built.pulled, test.axis, energy=theory.work_of_debonding / 20)
turn, peak = theory.turning_point(), theory.peak()
print(f"peak load          {path.load.max():.0f} N, theory {peak.load:.0f} N")
print(f"end turned back at {path.displacement.max():.4g} m, theory {turn.displacement:.4g} m")
print(f"dissipated         {path.dissipated[-1]:.4g} J, theory {theory.work_of_debonding:.4g} J")
print(path.plot("snap-back.png"))
