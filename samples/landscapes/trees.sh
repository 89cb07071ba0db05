#!/bin/sh
# 512 spaced trees over 1 024 quads, each turned, mirrored, moved, of its own size and green; grass between them.
# `vtex demo trees`, or in a folder of its own: sh .../samples/landscapes/trees.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/tree.glb -r 256 --translucency leaf=0.4 -o tree.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v --translucency 0.3 -o meadow.vtex
vtex map $S/landscapes/trees.glb --texel tree.vtex --geometry $S/tree.glb --bend --cell 9 --presence 0.5 --displace 0.3 --orientations w8 --scale 0.7,1 --tint '#b8c890..#fff0b0' --seed 3 -o landscape.glb
vtex map landscape.glb --add --texel meadow.vtex --cell 1.2 --tint '0.8,0.95,0.9..1.25,1.05,0.7' --tint-patches 30 -o landscape.glb
vtex render landscape.glb --camera close --sun 26,238 --exposure 1.8 --haze 9000 --size 1280x720 -o trees.png
