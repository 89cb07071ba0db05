#!/bin/sh
# Makes a corpus: small texels of every kind that this version writes, and landscapes of them, each by its own features.
#
#     tests/corpus/make.sh target/release/vtex tests/corpus/VERSION
#
# Needs python3 with numpy and zstandard: the digests are of the text that `format-spec/reader.py` gives, which shares no code
# with vtex.
#
# What a version has written stays as it is: every later one has to read it (`tests/corpus.rs`). So a folder is made once, when a
# version is released, and the files of earlier ones are never made again. The files of 1.0 are those of its draft until then.
set -eu
vtex=$(realpath "$1") out=$2
samples=$(realpath "$(dirname "$0")/../../samples")
mkdir -p "$out" && cd "$out"
export SOURCE_DATE_EPOCH=0
bake() { "$vtex" bake -q --compress 19 "$@"; }

bake "$samples/fern.glb" -r 32 -o alpha.vtex
bake "$samples/fern.glb" -r 32 --quality lean -o lean.vtex
bake "$samples/fern.glb" -r 16 --translucency 0.5 --refine 2 -o leaves.vtex
bake "$samples/fern.glb" -r 16 --model neyret -o neyret.vtex
bake "$samples/recipes/meadow.toml" -r 32 --cyclic u,v -o cyclic.vtex
bake "$samples/recipes/nut.toml" -r 16 -o solid.vtex
bake "$samples/stacks/shell" -r 16 --window 60,200 -o soft.vtex
bake "$samples/lsystems/flower.lsys" -r 32 --up z -o up-z.vtex
bake "$samples/hypertextures/marble.toml" -r 16 -o colours.vtex
bake "$samples/recipes/wall.toml" -r 16 -o wall.vtex
"$vtex" merge -q lean.vtex wall.vtex --translate 0,0,0 --translate 0.5,0,0 -r 16 -o merged.vtex
"$vtex" resample -q solid.vtex --rotate 0,30,0 -r 16 -o resampled.vtex
"$vtex" truncate cyclic.vtex --depth 3 -o truncated.vtex
printf '#define t 0\n#angle 40\naxiom: F(1)[+(40+60*t)F(0.7)]F(1)\n' > frame.lsys
bake frame.lsys --frames 2 --frame-define t=0..1 -r 16 -o frame.####.vtex

# A square of ground: the same for both landscapes, whose buffer is in the file itself.
ground=ground.gltf
python3 - > $ground <<'PYTHON'
import base64, json, struct
corners = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
data = b"".join(struct.pack("<3f", *p) for p in corners) + b"".join(struct.pack("<2f", *p) for p in [(0, 0), (1, 0), (1, 1), (0, 1)])
data += struct.pack("<6H", 0, 1, 2, 0, 2, 3)
print(json.dumps({
    "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "extensionsUsed": ["FB_ngon_encoding"],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
    "materials": [{"name": "ground"}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-2, 0, -2], "max": [2, 0, 2]},
        {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 32}, {"buffer": 0, "byteOffset": 80, "byteLength": 12}],
    "buffers": [{"byteLength": 92, "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}))
PYTHON
"$vtex" map -q $ground --texel cyclic.vtex --repeat 4 --wind 0.3 --attributes -o bent.glb
"$vtex" map -q bent.glb --add --texel lean.vtex --bend --jitter wild --tint '#808080..#ffffff' \
    --palette 'frond=*1,0.8,0.6' --seed 3 -o shells.glb
"$vtex" map -q $ground --texel alpha.vtex --texel solid.vtex --density 2/m2 --tint '#ff8080..#ffffff' --wind 0.1 -o still.glb
"$vtex" map -q still.glb --add --texel frame.####.vtex --fps 4 --frame-mode pingpong --density 1/m2 -o copies.glb
rm -f frame.lsys $ground bent.glb still.glb
for texel in *.vtex; do
    printf '%s  %s\n' "$(python3 "$samples/../format-spec/reader.py" "$texel" | sha256sum | cut -c 1-64)" "$texel"
done > digests
