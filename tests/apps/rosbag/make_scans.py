# SPDX-License-Identifier: BSD-3-Clause
"""Prints six equal scans of three cylinders of 10 cm in a round room of 4 m, one beam each half degree."""
import math

axes = [(1.0, 0.3), (-0.8, 1.1), (0.2, -1.6)]
radius, step = 0.1, math.pi / 360
ranges = []
for i in range(720):
    angle = -math.pi + i * step
    best = 4.0
    for x, y in axes:
        along = x * math.cos(angle) + y * math.sin(angle)
        aside = y * math.cos(angle) - x * math.sin(angle)
        if along > 0 and abs(aside) < radius:
            best = min(best, along - math.sqrt(radius * radius - aside * aside))
    ranges.append(f"{best:.6f}")
print("stamp,angle_min,angle_increment,ranges")
for k in range(6):
    print(f"{0.1 * k:.1f},{-math.pi!r},{step!r}," + ",".join(ranges))
