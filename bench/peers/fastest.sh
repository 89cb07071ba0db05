#!/usr/bin/env bash
# bench/peers/fastest.sh LANDSCAPE WORD…: run the tracer beside the landscape in its fastest way, which is found once, by pictures of
# one sample a pixel, and kept beside the landscape.
set -euo pipefail
landscape=$1
embree="$(dirname "$landscape")/embree"
way="$landscape.way"
if [ ! -e "$way" ]; then
    for words in "--packet 1" "--packet 8" "--packet 8 --coherent" "--packet 16" "--packet 16 --coherent"; do
        # shellcheck disable=SC2086
        told=$("$embree" "$landscape" -o "$landscape.exr" --size 640x360 --samples 2 $words)
        echo "$(sed 's/.*"trace_cpu_seconds": \([0-9.]*\).*/\1/' <<< "$told") $words"
    done | sort -g > "$way.part"
    mv "$way.part" "$way"
    rm "$landscape.exr"
fi
# shellcheck disable=SC2046
exec "$embree" "$@" $(head -n 1 "$way" | cut -d ' ' -f 2-)
