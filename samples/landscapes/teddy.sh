#!/bin/sh
# A teddy bear in fur, as Kajiya and Kay had one in 1989: one patch of 70 hairs, combed downward all over it.
# `vtex demo teddy`, or in a folder of its own: sh .../samples/landscapes/teddy.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/fur.toml -r 128 --cyclic u,v --translucency 0.4 -o fur.vtex
vtex bake $S/recipes/fur.toml -r 128 --cyclic u,v --albedo '#e9d3b0' --translucency 0.4 -o pale.vtex
vtex map $S/landscapes/teddy.glb --material fur --texel fur.vtex --cell 0.012 --gloss .12:14 --tint '1.5,1.4,1.3..2.1,1.9,1.7' --tint-patches 0.05 -o landscape.glb
vtex map landscape.glb --material muzzle --texel pale.vtex --cell 0.01 -o landscape.glb
vtex render landscape.glb --camera bear --sun 44,222 --sky 0.5,0.55,0.65 --exposure 1 --lanes 2 --size 960x720 -o teddy.png
