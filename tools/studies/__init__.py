"""Studies with mjfish: the paper's Table IV, measured fish, roll of the free fish, published numbers, engines, battery."""
