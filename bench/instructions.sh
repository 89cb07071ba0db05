#!/usr/bin/env bash
# Instructions instead of seconds, counted by valgrind on one thread, so that a busy machine does not matter: two runs differ by
# less than a thousandth.
#
# bench/instructions.sh VTEX [FOLDER]: instructions of a picture per cone, and those of its preparation, of the bench's scenes in
#   which every tree is a shell of its own; and which files of the sources they are in, where VTEX knows its lines (build it with
#   `--config profile.release.debug='"line-tables-only"' --config profile.release.strip=false`). Scenes are made in FOLDER
#   (vtex-bench by default) where they are not there yet.
# bench/instructions.sh --check VTEX: five kernels against the counts of bench/instructions.txt; fails where one has grown by more
#   than 3 %. VTEX is a release build. Counts are of one compiler and one kind of processor: of another, and where there is no
#   valgrind, it is said that nothing is checked.
# bench/instructions.sh --renew VTEX: write those counts anew, for this compiler and this kind of processor.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
known="$root/bench/instructions.txt"
usage="usage: bench/instructions.sh [--check|--renew] VTEX [FOLDER]"
mode=""
case "${1:-}" in --check | --renew) mode=$1 && shift ;; esac
vtex=$(realpath "${1:?$usage}")

if ! command -v valgrind > /dev/null; then
    echo "valgrind is not installed: instructions are not counted" >&2
    [ "$mode" = --check ] && exit 0 || exit 2
fi

# --- Five kernels ---------------------------------------------------------------------------------------------------------------

# What decides on the counts besides the sources: the compiler, its target, and what valgrind lets programs see of the processor.
machine() {
    local level=plain
    ! grep -qw avx2 /proc/cpuinfo 2> /dev/null || level=avx2
    rustc -vV | awk -v level="$level" '/^release/ { version = $2 } /^host/ { host = $2 } END { print host, "rustc-" version, level }'
}

count() { # NAME WORD…
    local name=$1 total
    shift
    total=$(valgrind --tool=cachegrind --cache-sim=no --cachegrind-out-file=/dev/null "$vtex" "$@" --quiet 2>&1 |
        sed -n 's/.*I *refs: *//p' | tr -d ,)
    [ -n "$total" ] || { echo "valgrind counted nothing of vtex $*" >&2; exit 1; }
    echo "$name $total"
}

kernels() {
    local folder
    folder=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "rm -r '$folder'" EXIT
    cp "$root/samples/tree.glb" "$root/samples/terrain.glb" "$folder"
    cd "$folder"
    # One thread for all; texel and landscapes are made without being counted.
    "$vtex" bake tree.glb -r 64 -o tree.vtex --quiet
    "$vtex" map terrain.glb --texel tree.vtex --geometry tree.glb --bend --repeat 40 -o land.gltf --quiet
    "$vtex" map terrain.glb --texel tree.vtex --bend --repeat 400 -o many.gltf --quiet
    "$vtex" map terrain.glb --texel tree.vtex --density 400 -o copies.gltf --quiet
    local plain=(--threads 1 --ambient constant --sun-angle 0 --sky 0.3,0.35,0.4)
    count bake bake tree.glb -r 64 -o again.vtex --threads 1
    count far render land.gltf -o far.png --size 96x54 --frame "${plain[@]}"
    count near render land.gltf -o near.png --size 96x54 --eye 0,60,0 --look-at 40,40,-60 "${plain[@]}"
    count set-up render copies.gltf -o set-up.png --size 1x1 --frame "${plain[@]}"
    count read verify tree.vtex
}

if [ -n "$mode" ]; then
    machine=$(machine)
    found=$(kernels)
    if [ "$mode" = --renew ]; then
        others=$(grep -v "^$machine " "$known" 2> /dev/null || true)
        { [ -z "$others" ] || echo "$others"; sed "s/^/$machine /" <<< "$found"; } | LC_ALL=C sort > "$known.part"
        mv "$known.part" "$known"
        cat "$known"
        exit 0
    fi
    if ! grep -q "^$machine " "$known"; then
        echo "instructions: bench/instructions.txt has no counts of $machine, so nothing is compared (--renew adds them)" >&2
        echo "$found"
        exit 0
    fi
    { grep "^$machine " "$known" | sed "s/^$machine /known /"; sed 's/^/found /' <<< "$found"; } | awk '
        $1 == "known" { known[$2] = $3; next }
        { grown = $3 / known[$2] - 1
          printf "instructions: %-7s %13.0f, %+.2f %% of what is known\n", $2, $3, 100 * grown
          if (!($2 in known) || grown > 0.03) failed = 1 }
        END { if (failed) { print "more than 3 % more instructions: mend it, or say why and run bench/instructions.sh --renew"; exit 1 } }'
    exit 0
fi

# --- The bench's scenes ---------------------------------------------------------------------------------------------------------

folder=${2:-vtex-bench}
mkdir -p "$folder"

scene() { # NAME RESOLUTION EYE TARGET
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
    by_file "$folder/callgrind.160x90.out"
}

# Instructions by file of the sources: a line of the file names the file of what follows (fl, fi, fe), a number or `+` begins a
# cost, and the line after `calls=` is the cost of what is called, which is counted where it is.
by_file() {
    awk '
        /^f[lie]=/ { name = $0; sub(/^f[lie]=/, "", name); id = name; sub(/ .*/, "", id)
                     if (name ~ / /) { sub(/^[^ ]* /, "", name); names[id] = name }
                     file = names[id]; next }
        /^calls=/ { skip = 1; next }
        /^[0-9+*-]/ { if (!skip) { cost[file] += $2; all += $2 } skip = 0 }
        END { for (file in cost) if (file ~ /src\/(render|march|volume|format|scene|geom|par)/) {
                  short = file; sub(/.*src\//, "", short); printf "    %5.1f %%  %s\n", 100 * cost[file] / all, short } }
    ' "$1" | sort -rn | head -n 16
}

scene own-far 256 0,200,760 0,0,-60
scene own-near 512 0,9,-5 0,3,-40
