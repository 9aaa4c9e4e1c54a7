"""Studies made with mjfish.

The paper's Table IV, the measured fish, roll of the free fish, published numbers, the engines, the battery.
"""
