"""A shape: any program that prints points makes one. A ring of lights, two cells apart, standing upright.

python ring.py 60 > ring.xyz
"""

import sys
from math import cos, pi, sin

count = int(sys.argv[1])
radius = 2 * count / (2 * pi)  # cells
for i in range(count):
    turn = 2 * pi * i / count
    print(f"{radius * (1 + cos(turn)):.3f} {radius * (1 + sin(turn)):.3f} 0")  # length, height, depth
