"""mjfish: what a swimming-fish simulation gets wrong, why, and what knowing it gains.

A fish swims (drive -> body -> water -> camera), a measured fish swims too, and the package explains the difference:

- `mjfish.fish`, `mjfish.drive`, `mjfish.hydro`: the fish, its joint motion, the force of the water;
- `mjfish.ode`, `mjfish.sim`, `mjfish.crosscheck`: the head-frame equations, MuJoCo, one against the other;
- `mjfish.trial`, `mjfish.importers`, `mjfish.plant`: measured, imported and planted datasets;
- `mjfish.effects`, `mjfish.model`, `mjfish.identify`, `mjfish.diagnose`: causes, the extended model, its fit,
  the verdict;
- `mjfish.report`, `mjfish.viewlog`, `mjfish.cli`: how it is shown.
"""
