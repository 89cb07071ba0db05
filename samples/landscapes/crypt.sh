#!/bin/sh
# Two curved surfaces: a vault of heads, as computed tomography sees them, and an urn in a hypertexture.
# `vtex demo crypt`, or in a folder of its own: sh .../samples/landscapes/crypt.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/skull.toml -r 128 -o skull.vtex
vtex bake $S/hypertextures/eroded.toml -r 256 --cyclic u,v --albedo '#86b8a6' --tint -o eroded.vtex
vtex map $S/landscapes/crypt.glb --material wall --texel skull.vtex --cell 0.242 --bend --orientations identity --displace 0.03 --scale 0.92,1 -o landscape.glb
vtex map landscape.glb --material urn --texel eroded.vtex --cell 0.15 --jitter none -o landscape.glb
vtex render landscape.glb --camera crypt --sky 0.3,0.33,0.4 --exposure 1.1 --size 960x720 -o crypt.png
