#!/bin/sh
# A meadow in the wind, with two trees on its crest: gusts travel over it (an animated picture).
# `vtex demo wind`, or in a folder of its own: sh .../samples/landscapes/wind.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v --translucency 0.3 -o meadow.vtex
vtex bake $S/tree.glb -r 256 --translucency leaf=0.4 -o tree.vtex
vtex map $S/landscapes/wind.glb --texel meadow.vtex --tint '0.8,0.95,0.9..1.25,1.05,0.7' --tint-patches 9 --wind 0.45 --wind-direction 1,0,0.2 -o landscape.glb
vtex map landscape.glb --add --texel tree.vtex --geometry $S/tree.glb --density 45/ha --altitude 2.6.. --wind 0.06 --seed 4 --size 7 -o landscape.glb
vtex render landscape.glb --camera meadow --sun 27,235 --exposure 1.7 --haze 6000 --frames 24 --fps 12 --size 432x243 -o wind.apng
