"""How a tree takes light from its crown down: bake it, sum its opacity by height, and draw that as text.

Run: python profile.py [MODEL]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import vtex

model = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[2] / "samples" / "tree.glb"
with tempfile.TemporaryDirectory() as folder:
    texel = vtex.bake(model, Path(folder) / "tree.vtex", resolution=64)
    print(texel, "of", ", ".join(m["name"] for m in texel.materials))
    opacity = texel.depth(5).grid("opacity")

# What falls straight down meets layer after layer; each lets through what it does not take.
through = np.cumprod(1 - opacity[:, :, ::-1], axis=2)
light = through.mean(axis=(0, 1))[::-1]
low, high = texel.bounds[0][texel.up], texel.bounds[1][texel.up]
for level in reversed(range(0, len(light), 2)):
    height = low + (high - low) * level / len(light)
    print(f"{height:6.2f} m {light[level]:5.0%} {'#' * round(50 * light[level])}")
