"""What the joints do: the CPG of [Yu2016] or measured angles, sampled as angle, rate and acceleration."""
