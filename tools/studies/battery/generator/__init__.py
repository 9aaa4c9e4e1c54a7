"""The sealed generator: makes swimming whose hidden truth is known, with nothing of the solver's own physics.

Another formulation (momentum about the moving nose, in world axes), another integrator and step, other quadrature,
slightly other forms of the effects. `case.make_case` and `case.scaled_case` are the way in.
"""
