#!/bin/sh
# 512 spaced trees over 1 024 quads, each turned, mirrored, moved, of its own size and green; grass between them.
# `vtex demo trees`, or in a folder of its own: sh .../samples/landscapes/trees.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/tree.glb -r 256 -o tree.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v -o meadow.vtex
vtex map $S/landscapes/trees.glb --texel tree.vtex --geometry $S/tree.glb --bend --cell 9 --presence 0.5 --displace 0.3 --orientations w8 --scale 0.7,1 --tint '#b8c890..#fff0b0' --seed 3 -o landscape.glb
vtex map landscape.glb --add --texel meadow.vtex --cell 1.2 -o landscape.glb
vtex render landscape.glb --camera close --exposure 1.2 --haze 1500 --size 1280x720 -o trees.png
