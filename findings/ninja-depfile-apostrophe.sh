#!/usr/bin/env bash
# A depfile that names a file with an apostrophe, as GCC and make escape it: a space after a backslash, the rest as it is.
#
# One would guess: ninja reads the name, since make does and none of its characters is special to ninja.
# What happens: up to 1.11 ninja ends the name at the apostrophe and takes what follows for other names, without a word. These
#   files are not there, so the output is made anew with every build. 1.13 reads the name.
# Why it matters: textures and slices are called "Tom's bark.png", and Debian 12 and Ubuntu 22.04 have ninja 1.11 or older. A
#   build that never comes to rest looks like a fault of the program that wrote the depfile; no escape helps.
# Versions: ninja 1.11.1.4 and 1.13.0 (PyPI). Written on 2026-11-29.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cat > build.ninja <<'NINJA'
rule copy
  command = cp kept.d out.d && echo made >> log && touch out
  depfile = out.d
  deps = gcc
build out: copy
NINJA
for version in 1.11.1.4 1.13.0; do
    python3 -m venv "env-$version"
    "env-$version/bin/pip" install --quiet --disable-pip-version-check "ninja==$version"
done
: > seen
for name in "Toms bark.png" "Tom's bark.png"; do
    touch "$name"
    printf 'out: %s\n' "${name// /\\ }" > kept.d
    for version in 1.11.1.4 1.13.0; do
        rm -f .ninja_log .ninja_deps log out
        for _ in 1 2 3; do
            "env-$version/bin/ninja" > /dev/null
        done
        found=$("env-$version/bin/ninja" -t deps out | sed -n 's/^out: #deps \([0-9]*\),.*/\1/p')
        echo "$version, $name: $found names, made $(wc -l < log) times in 3 builds" >> seen
    done
done

cat > expected <<'EXPECTED'
1.11.1.4, Toms bark.png: 1 names, made 1 times in 3 builds
1.13.0, Toms bark.png: 1 names, made 1 times in 3 builds
1.11.1.4, Tom's bark.png: 2 names, made 3 times in 3 builds
1.13.0, Tom's bark.png: 1 names, made 1 times in 3 builds
EXPECTED

echo "ninja 1.11.1.4 and 1.13.0, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
