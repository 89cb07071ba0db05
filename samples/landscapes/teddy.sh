#!/bin/sh
# A teddy bear in fur, as Kajiya and Kay had one in 1989: one patch of 70 hairs, combed downward all over it.
# `vtex demo teddy`, or in a folder of its own: sh .../samples/landscapes/teddy.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/fur.toml -r 128 --cyclic u,v -o fur.vtex
vtex bake $S/recipes/fur.toml -r 128 --cyclic u,v --albedo '#f2e6d2' --tint -o pale.vtex
vtex map $S/landscapes/teddy.glb --material fur --texel fur.vtex --cell 0.012 -o landscape.glb
vtex map landscape.glb --material muzzle --texel pale.vtex --cell 0.01 -o landscape.glb
vtex render landscape.glb --camera bear --exposure 0.9 --lanes 2 --size 960x720 -o teddy.png
