#!/usr/bin/env bash
# bench/peers/run.sh VTEX [FOLDER [WORD…]]: pictures by vtex beside those of a tracer on Embree, of the bench's scenes whose trees
# stand close, from afar, from near and to the horizon; the words are for `vtex bench`, such as `--scene own-near --size 640x360`.
#
# Wants Debian's libembree-dev and a C++ compiler. Embree 4, which is newer than Debian's, is taken from the wheel of `embreex` in
# the Python package index where pip can fetch it; PEER=3 keeps to Debian's. Which of the tracer's ways is fastest differs from
# scene to scene and from machine to machine: all are tried on each scene, and the fastest is measured.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
vtex=$(realpath "${1:?usage: bench/peers/run.sh VTEX [FOLDER [WORD…]]}")
folder=${2:-vtex-bench}
shift $(($# < 2 ? $# : 2))
mkdir -p "$folder"
folder=$(realpath "$folder")

build() { # FLAG…
    g++ -std=c++17 -O3 -march=native -Wall -Wextra "$here/embree.cpp" -o "$folder/embree" "$@" -lpthread
}
[ -e /usr/include/embree3/rtcore.h ] || { echo "Embree's headers are missing: apt-get install libembree-dev" >&2; exit 2; }
wheel="$folder/embree-4"
if [ "${PEER:-4}" = 4 ] && { [ -d "$wheel" ] || python3 -m pip download --quiet --no-deps --dest "$wheel" embreex==4.4.0.post1; }; then
    [ -d "$wheel/embreex.libs" ] || python3 -m zipfile -e "$wheel"/*.whl "$wheel"
    build -DEMBREE4 "$wheel"/embreex.libs/libembree4* "-Wl,-rpath,$wheel/embreex.libs"
else
    build -lembree3
fi

# One scene at a time, so that each is traced in the way that is fastest for it.
scenes=(own-far own-near own-million copies-far copies-near copies-million)
words=()
while [ $# -gt 0 ]; do
    if [ "$1" = --scene ]; then
        [ -n "${chosen:-}" ] || { chosen=yes; scenes=(); }
        scenes+=("$2")
        shift 2
    else
        words+=("$1")
        shift
    fi
done
for scene in "${scenes[@]}"; do
    "$vtex" bench -o "$folder" --scene "$scene" --peer "$here/fastest.sh" "${words[@]}" --quiet > "$folder/$scene.txt"
    for result in csv md svg png; do mv "$folder/bench.$result" "$folder/$scene.$result"; done
    tail -n +1 "$folder/$scene.md"
done
