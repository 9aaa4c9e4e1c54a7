"""What is claimed of the water in MuJoCo, measured: used by the tests of the claims, and by `tools/proof.py`."""
