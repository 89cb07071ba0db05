#!/bin/sh
# 1 000 000 trees of nine species over grass and undergrowth, to the horizon.
# `vtex demo million`, or in a folder of its own: sh .../samples/landscapes/million.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/lsystems/oak.lsys -r 256 --translucency leaf=0.4 -o oak.vtex
vtex bake $S/lsystems/tree.lsys -r 128 --translucency leaf=0.4 -o tree.vtex
vtex bake $S/lsystems/birch.lsys -r 256 --translucency leaf=0.4 -o birch.vtex
vtex bake $S/lsystems/maple.lsys -r 128 --translucency leaf=0.4 -o maple.vtex
vtex bake $S/lsystems/poplar.lsys -r 128 --translucency leaf=0.4 -o poplar.vtex
vtex bake $S/lsystems/willow.lsys -r 128 --translucency leaf=0.4 -o willow.vtex
vtex bake $S/lsystems/spruce.lsys -r 128 -o spruce.vtex
vtex bake $S/lsystems/pine.lsys -r 128 -o pine.vtex
vtex bake $S/lsystems/larch.lsys -r 128 -o larch.vtex
vtex bake $S/recipes/undergrowth.toml -r 128 --translucency leaf=0.4 -o undergrowth.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v --translucency 0.3 -o meadow.vtex
vtex export $S/lsystems/oak.lsys -o oak.glb
vtex export $S/lsystems/birch.lsys -o birch.glb

vtex map $S/landscapes/million.glb --material land --texel meadow.vtex --cell 1.4 --tint '0.8,0.95,0.9..1.3,1.05,0.65' --tint-patches 40 -o landscape.glb
vtex map landscape.glb --material land --add --texel oak.vtex --geometry oak.glb --texel birch.vtex --geometry birch.glb --points $S/landscapes/million.csv -o landscape.glb
vtex map landscape.glb --material land --add --texel oak.vtex --weight 2 --texel tree.vtex --weight 3 --texel birch.vtex --weight 2 --texel maple.vtex --weight 1 --texel poplar.vtex --weight 0.6 --texel willow.vtex --weight 0.6 --texel spruce.vtex --weight 3 --texel pine.vtex --weight 2 --texel larch.vtex --weight 1 --texel undergrowth.vtex --weight 2 --tint '0.8,0.95,0.9..1.7,1.2,0.7' --tint-patches 350 --density 540/ha --density-map $S/landscapes/million.png -o landscape.glb
vtex render landscape.glb --camera view --sun 27,238 --haze 60000 --exposure 1.8 --size 1280x720 -o million.png
