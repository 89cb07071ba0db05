#!/bin/sh
# The lawn of 1996: 1 400 quads, 22 000 blades in Vs, some 700 flowers, leaning and uneven by noise.
# `vtex demo lawn`, or in a folder of its own: sh .../samples/landscapes/lawn.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/lawn.toml -r 128 --cyclic u,v --translucency 0.35 -o lawn.vtex
vtex bake $S/recipes/lawn-grass.toml -r 128 --cyclic u,v --translucency 0.35 -o lawn-grass.vtex
vtex export $S/recipes/lawn.toml -o blades.glb
vtex export $S/recipes/lawn-grass.toml -o grass-blades.glb
vtex map $S/landscapes/lawn.glb --texel lawn.vtex --geometry blades.glb --texel lawn-grass.vtex --geometry grass-blades.glb --cell 0.1 -o landscape.glb
vtex render landscape.glb --camera lawn --sun 35,250 --exposure 1.9 --size 1280x720 -o lawn.png
