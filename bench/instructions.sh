#!/usr/bin/env bash
# bench/instructions.sh VTEX [FOLDER]: instructions of a picture per cone, and those of its preparation, of the bench's scenes in
# which every tree is a shell of its own. Counted by callgrind on one thread, so that a busy machine does not matter: two runs
# differ by less than a thousandth. Scenes are made in FOLDER (vtex-bench by default) where they are not there yet.
set -euo pipefail
vtex=$(realpath "${1:?usage: bench/instructions.sh VTEX [FOLDER]}")
folder=${2:-vtex-bench}
command -v valgrind > /dev/null || { echo "valgrind is not installed" >&2; exit 2; }
mkdir -p "$folder"

count() { # NAME RESOLUTION EYE TARGET
    local scene="$folder/$1-$2-coverage-10.gltf" total first
    [ -e "$scene" ] || "$vtex" bench -o "$folder" --scene "$1" --quick --samples 2 --size 16x9 --quiet > /dev/null
    run() { # SIZE NAME RESOLUTION EYE TARGET
        valgrind --tool=callgrind --callgrind-out-file="$folder/callgrind.$1.out" "$vtex" render "$scene" --quiet \
            -o "$folder/callgrind.png" --size "$1" --threads 1 --ambient constant --sun-angle 0 \
            --sky 0.3,0.35,0.4 --background 0.3,0.35,0.4 --eye "$4" --look-at "$5" --fov 50 2>&1 |
            sed -n 's/.*Collected : //p'
    }
    # All that does not depend on the number of pixels is in both.
    first=$(run 16x9 "$@") total=$(run 160x90 "$@")
    awk -v name="$1" -v a="$first" -v b="$total" 'BEGIN {
        cone = (b - a) / (160 * 90 - 16 * 9)
        printf "%-12s %8.0f instructions a cone, %8.1f million before the first\n", name, cone, (a - 16 * 9 * cone) / 1e6
    }'
}

count own-far 256 0,200,760 0,0,-60
count own-near 512 0,9,-5 0,3,-40
