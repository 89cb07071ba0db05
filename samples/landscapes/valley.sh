#!/bin/sh
# A meadow with daisies before a mixed forest, the low sun in the haze; and the valley from afar.
# `vtex demo`, or in a folder of its own: sh .../samples/landscapes/valley.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/tree.glb -r 512 -o tree.vtex
vtex bake $S/spruce.glb -r 256 -o spruce.vtex
vtex bake $S/fern.glb -r 128 -o fern.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v -o meadow.vtex

vtex map $S/terrain.glb --texel meadow.vtex --scale 1,1 --displace 0 -o landscape.glb
vtex map landscape.glb --material forest --add --texel spruce.vtex --texel tree.vtex --texel tree.vtex -o landscape.glb
vtex map landscape.glb --material meadow --texel fern.vtex --presence 0.2 --add -o landscape.glb

vtex render landscape.glb --camera near --sun 14,303 --haze 7000 --exposure 1.5 --size 1280x720 -o near.png
vtex render landscape.glb --camera far --sun 24,262 --haze 14000 --exposure 1.3 --size 1280x720 -o far.png
