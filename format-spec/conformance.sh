#!/usr/bin/env bash
# Holds the Python, the JavaScript and the Kaitai reader to the vectors and to the corpus of ../tests/corpus, and landscapes to their
# schema. Needs python3 with venv, node and npm, and a network for packages in pinned versions, in a temporary folder: numpy,
# zstandard and jsonschema, and Kaitai's compiler. ./conformance.sh [FILE …] compares what Python and JavaScript read of further .vtex
# files, and checks further landscapes (.gltf, .glb).
set -euo pipefail
texels=() landscapes=()
for file in "$@"; do
    case $file in *.gltf | *.glb) landscapes+=("$(realpath "$file")") ;; *) texels+=("$(realpath "$file")") ;; esac
done
cd "$(dirname "$0")"
here=$PWD work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" -q install numpy==2.2.6 zstandard==0.23.0 jsonschema==4.26.0
(cd "$work" && npm install --silent --no-fund --no-audit kaitai-struct-compiler@0.11.0 kaitai-struct@0.11.0 js-yaml@4.1.0 > /dev/null)
cp js/kaitai.mjs "$work/"
python() { "$work/venv/bin/python" "$here/reader.py" "$@" 2>&1; }
javascript() { node "$here/js/read.mjs" "$@" 2>&1; }
failed=0 count=0
fault() { echo "WRONG: $*"; failed=1; }

# The generator still makes what is stored, compressed or not.
mkdir "$work/made"
"$work/venv/bin/python" vectors/make.py "$work/made"
for text in vectors/ok-*.txt vectors/shading-1.txt; do cmp -s "$text" "$work/made/$(basename "$text")" || fault "$text is not what make.py makes"; done

for folder in ../tests/corpus/*/; do
    landscapes+=("$folder"*.glb)
    # The digests are of what Python reads.
    while read -r digest name; do
        for reader in python javascript; do
            [ "$($reader "$folder$name" | sha256sum | cut -c 1-64)" = "$digest" ] || fault "$reader reads $folder$name otherwise"
        done
        count=$((count + 1))
    done < "${folder}digests"
done
# An exporter that knows the text alone.
"$work/venv/bin/python" exporter.py ../tests/corpus/1.0/alpha.vtex "$work/exported.gltf"
landscapes+=("$work/exported.gltf")
"$work/venv/bin/python" schema.py "${landscapes[@]}" || failed=1

for file in vectors/ok-*.vtex "${texels[@]}"; do
    python "$file" > "$work/python.txt" || fault "Python refuses $file"
    javascript "$file" > "$work/javascript.txt" || fault "JavaScript refuses $file"
    wanted="${file%.vtex}.txt"
    if [ -f "$wanted" ]; then grep -vE '^(ray|eye) ' "$wanted" > "$work/wanted.txt"; else cp "$work/python.txt" "$work/wanted.txt"; fi
    cmp -s "$work/wanted.txt" "$work/python.txt" || fault "Python reads $file otherwise"
    cmp -s "$work/wanted.txt" "$work/javascript.txt" || fault "JavaScript reads $file otherwise"
    count=$((count + 1))
done
for file in vectors/bad-*.vtex; do
    code=$(basename "$file" .vtex) && code=${code#bad-} && code=${code%-*}
    for reader in python javascript; do
        said=$($reader --check "$file" | head -1) || true
        [ "${said%% *}" = "$code" ] || fault "$reader says \"$said\" of $file"
    done
    count=$((count + 1))
done
# Kaitai: every good file, and of the bad ones those whose structure is wrong; the others are listed in rules.md.
(cd "$work" && node kaitai.mjs "$here") || failed=1
echo "$count files"
exit $failed
