#!/bin/sh
# The lawn of 1996: 1 400 quads, 22 000 blades in Vs, some 700 flowers, leaning and uneven by noise.
# `vtex demo lawn`, or in a folder of its own: sh .../samples/landscapes/lawn.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/lawn.toml -r 128 --cyclic u,v -o lawn.vtex
vtex bake $S/recipes/lawn-grass.toml -r 128 --cyclic u,v -o lawn-grass.vtex
vtex map $S/landscapes/lawn.glb --texel lawn.vtex --texel lawn-grass.vtex --cell 0.1 -o landscape.glb
vtex render landscape.glb --camera lawn --exposure 1.6 --size 1280x720 -o lawn.png
