#!/usr/bin/env python3
"""Make head.nrrd beside this file: a head as computed tomography sees it, from ellipsoids; no person's data.

64 x 64 x 64 samples of 8 bits: air 0, soft tissue 60, bone 230. x goes to the left of the head, y to the front, z down."""
import gzip
import math
import struct
from pathlib import Path

SIZE = 64


def ball(p, middle, radii):
    """About the distance to an ellipsoid, negative inside."""
    d = [(a - m) / r for a, m, r in zip(p, middle, radii)]
    return (math.sqrt(sum(v * v for v in d)) - 1) * min(radii)


def union(*parts):
    return min(parts)


def smooth(a, b, k):
    h = max(k - abs(a - b), 0) / k
    return min(a, b) - h * h * k / 4


def without(a, b):
    return max(a, -b)


def bone(p):
    x, y, z = p
    p = (abs(x), y, z)
    braincase = ball(p, (0, 0.12, 0.28), (0.62, 0.74, 0.6))
    brow = ball(p, (0.24, -0.5, 0.16), (0.3, 0.16, 0.11))
    cheek = ball(p, (0.4, -0.38, -0.22), (0.2, 0.22, 0.11))
    arch = ball(p, (0.56, -0.1, -0.2), (0.07, 0.34, 0.06))
    face = ball(p, (0, -0.36, -0.2), (0.36, 0.3, 0.42))
    upper_jaw = ball(p, (0, -0.42, -0.5), (0.27, 0.25, 0.16))
    solid = smooth(smooth(smooth(braincase, brow, 0.12), smooth(face, cheek, 0.1), 0.12), smooth(upper_jaw, arch, 0.08), 0.1)
    solid = without(solid, ball(p, (0, 0.13, 0.29), (0.54, 0.66, 0.52)))
    solid = without(solid, ball(p, (0.25, -0.62, 0.0), (0.165, 0.26, 0.135)))
    nose = union(ball(p, (0.06, -0.66, -0.26), (0.075, 0.2, 0.12)), ball(p, (0, -0.66, -0.18), (0.06, 0.18, 0.12)))
    solid = without(solid, nose)
    solid = without(solid, ball(p, (0, -0.3, -0.62), (0.17, 0.22, 0.12)))
    # The lower jaw: an arch, its branches, and the teeth of both.
    ring = lambda height, wide, deep: math.hypot(x / wide, (y + 0.12) / deep) - 1
    jaw = max(abs(ring(0, 0.36, 0.5)) * 0.36 - 0.07, abs(z + 0.86) - 0.1, y - 0.05)
    chin = ball(p, (0.07, -0.58, -0.9), (0.14, 0.09, 0.1))
    branch = ball(p, (0.43, 0.06, -0.55), (0.07, 0.16, 0.38))
    solid = union(solid, smooth(smooth(jaw, chin, 0.06), branch, 0.1))
    angle = math.atan2(x, -(y + 0.12))
    gap = 0.035 if abs(math.sin(angle * 9)) < 0.22 else 0.0
    teeth = max(abs(ring(0, 0.33, 0.5)) * 0.33 - 0.05 + gap, abs(abs(z + 0.685) - 0.05) - 0.042, abs(angle) - 1.25)
    return union(solid, teeth)


def skin(p):
    p = (abs(p[0]), p[1], p[2])
    head = smooth(ball(p, (0, 0.12, 0.28), (0.68, 0.8, 0.66)), ball(p, (0, -0.3, -0.45), (0.5, 0.45, 0.62)), 0.2)
    nose = ball(p, (0, -0.76, -0.2), (0.11, 0.16, 0.16))
    neck = max(math.hypot(p[0], p[1] - 0.15) - 0.42, p[2] + 0.3)
    return union(smooth(head, nose, 0.1), neck)


def sample(p):
    step = 2 / SIZE
    share = lambda d: min(max(0.5 - d / step, 0), 1)
    return round(max(60 * share(skin(p)), 230 * share(bone(p))))


def main():
    at = [(i + 0.5) * 2 / SIZE - 1 for i in range(SIZE)]
    data = bytes(sample((x, -y, -z)) for z in at for y in at for x in at)
    header = (
        "NRRD0004\n"
        "# A head as computed tomography sees it, of ellipsoids: made by head.py.\n"
        f"type: uint8\ndimension: 3\nsizes: {SIZE} {SIZE} {SIZE}\nspacings: 3.4 3.4 3.4\nencoding: gzip\n\n"
    )
    Path(__file__).with_name("head.nrrd").write_bytes(header.encode() + gzip.compress(data, 9, mtime=0))


main()
