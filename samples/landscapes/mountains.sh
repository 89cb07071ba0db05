#!/bin/sh
# Forest-covered mountains: 1 404 quads, 25 000 trees as one cyclic texel of two, turned and bent by noise; snow behind them.
# `vtex demo mountains`, or in a folder of its own: sh .../samples/landscapes/mountains.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/forest.toml --voxel-size 0.046875 -r 256 --translucency leaf=0.4 --cyclic u,v -o forest.vtex
vtex map $S/landscapes/mountains.glb --material forest --texel forest.vtex --repeat 3 --jitter wild --orientations w8 --tint '0.7,0.95,0.7..3,1.3,0.45' --tint-patches 90 -o landscape.glb
vtex render landscape.glb --camera ridge --sun 22,246 --haze 60000 --exposure 1.8 --size 1280x720 -o mountains.png
