#!/bin/sh
# A meadow with daisies in a wooded valley, snow on the mountains that close it; and the valley from above.
# `vtex demo`, or in a folder of its own: sh .../samples/landscapes/valley.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/tree.glb -r 256 --translucency leaf=0.4 -o tree.vtex
vtex bake $S/spruce.glb -r 256 -o spruce.vtex
vtex bake $S/fern.glb -r 128 -o fern.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v --translucency 0.3 -o meadow.vtex

vtex map $S/landscapes/valley.glb --material forest --material meadow --texel meadow.vtex --scale 1,1 --displace 0 --tint '0.8,0.95,0.9..1.15,1,0.75' --tint-patches 25 -o landscape.glb
vtex map landscape.glb --material forest --add --texel spruce.vtex --geometry $S/spruce.glb --texel tree.vtex --geometry $S/tree.glb --scale 0.6,1.15 --tint '0.85,0.95,0.85..1.6,1.2,0.8' --tint-patches 70 -o landscape.glb
vtex map landscape.glb --material meadow --texel fern.vtex --geometry $S/fern.glb --presence 0.06 --scale 0.5,1 --add -o landscape.glb

vtex render landscape.glb --camera near --sun 20,245 --haze 30000 --exposure 1.7 --size 1280x720 -o near.png
vtex render landscape.glb --camera far --sun 25,230 --haze 30000 --exposure 1.8 --size 1280x720 -o far.png
