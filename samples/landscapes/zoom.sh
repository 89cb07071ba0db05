#!/bin/sh
# From 2 km to one leaf: woods, a tree in a clearing, its crown, a leaf of it (an animated picture).
# `vtex demo zoom`, or in a folder of its own: sh .../samples/landscapes/zoom.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/tree.glb -r 512 --translucency leaf=0.4 -o tree.vtex
vtex bake $S/lsystems/spruce.lsys -r 128 -o spruce.vtex
vtex bake $S/lsystems/birch.lsys -r 128 --translucency leaf=0.4 -o birch.vtex
vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v -o meadow.vtex
vtex map $S/landscapes/million.glb --material land --texel meadow.vtex --cell 1.4 --tint '1,1.05,1..1.5,1.1,0.6' --tint-patches 80 -o landscape.glb
vtex map landscape.glb --material land --add --texel tree.vtex --geometry $S/tree.glb --points $S/landscapes/zoom.csv -o landscape.glb
vtex map landscape.glb --material land --add --texel tree.vtex --weight 3 --texel spruce.vtex --weight 2 --texel birch.vtex --weight 2 --density 110/ha --density-map $S/landscapes/million.png --tint '0.8,0.8,0.7..1.3,1.1,0.8' -o landscape.glb
vtex render landscape.glb --camera zoom --haze 60000 --exposure 1.9 --frames 30 --fps 8 --size 240x135 -o zoom.apng
