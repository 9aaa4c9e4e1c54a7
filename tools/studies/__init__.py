"""Studies made with mjfish: the paper's Table IV, the measured fish, the roll of the free fish, the battery."""
