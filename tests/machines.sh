#!/bin/sh
# The same bytes on every machine: bakes, maps and renders on this processor, and on older ones that qemu-user emulates.
#
#     tests/machines.sh target/release/vtex
#
# Needs qemu-user (Debian: qemu-user). `qemu64,-sse3,-cx16` is x86-64-v1, the least that Rust's programs for x86-64 ask for; Nehalem
# has SSE4.2 and no AVX; Haswell has AVX2 and FMA, the other way through kernels that exist twice (src/simd.rs).
set -eu
vtex=$(realpath "$1")
samples=$(realpath "$(dirname "$0")/../samples")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
command -v qemu-x86_64 > /dev/null || { echo "qemu-user is not installed: not compared"; exit 0; }

# All that is made, in the folder $1, by the program in the words that follow.
make() {
    mkdir "$1" && cd "$1" && shift
    "$@" bake "$samples/fern.glb" -r 16 --refine 1 -q -o fern.vtex
    "$@" bake "$samples/hypertextures/fur.toml" -r 16 -q -o fur.vtex
    "$@" bake "$samples/stacks/shell" -r 16 --window 60,200 -q -o shell.vtex
    "$@" bake "$samples/recipes/ring.toml" -r 16 -q -o ring.vtex
    "$@" bake "$samples/lsystems/plant-b.lsys" -r 16 -q -o plant.vtex
    "$@" resample ring.vtex --rotate 0,30,0 -r 16 -q -o turned.vtex
    "$@" map "$samples/terrain.glb" --texel fern.vtex --density 20/ha --jitter wild -q -o copies.glb
    "$@" map "$samples/hill.obj" --texel fur.vtex --bend --wind 0.3 --repeat 8 -q -o shells.glb
    "$@" render copies.glb --camera far --size 32x18 -q -o copies.exr
    "$@" render shells.glb --frame --size 32x18 --time 0.7 -q -o shells.exr
    sha256sum ./*
}

make "$work/here" "$vtex" > "$work/wanted"
failed=0
for cpu in qemu64,-sse3,-cx16 Nehalem Haswell; do
    make "$work/$cpu" qemu-x86_64 -cpu "$cpu" "$vtex" > "$work/found" 2> "$work/said" || { cat "$work/said"; failed=1; }
    if cmp -s "$work/wanted" "$work/found"; then
        echo "$cpu: the same bytes in $(wc -l < "$work/found") files"
    else
        echo "$cpu: DIFFERS:"
        diff "$work/wanted" "$work/found" || true
        failed=1
    fi
done
exit $failed
