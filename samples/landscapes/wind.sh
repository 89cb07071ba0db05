#!/bin/sh
# A meadow in the wind, with two trees on its crest: gusts travel over it (an animated picture).
# `vtex demo wind`, or in a folder of its own: sh .../samples/landscapes/wind.sh
set -e
S=${S:-$(dirname "$0")/..}

vtex bake $S/recipes/meadow.toml -r 128 --cyclic u,v -o meadow.vtex
vtex bake $S/tree.glb -r 256 -o tree.vtex
vtex map $S/landscapes/wind.glb --texel meadow.vtex --wind 0.45 --wind-direction 1,0,0.2 -o landscape.glb
vtex map landscape.glb --add --texel tree.vtex --geometry $S/tree.glb --density 45/ha --altitude 2.6.. --wind 0.06 --seed 4 --size 7 -o landscape.glb
vtex render landscape.glb --camera meadow --exposure 1.3 --haze 1500 --frames 24 --fps 12 --size 480x270 -o wind.apng
