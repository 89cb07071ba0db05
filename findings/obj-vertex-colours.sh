#!/usr/bin/env bash
# An OBJ file with colours after the coordinates: "v x y z r g b".
#
# One would guess: r, g, b in 0..1, and all tools take them in the same colour space.
# What happens: three.js takes them for sRGB and converts them to linear (0.5 becomes 0.214). trimesh stores 0.5 as 128 and
#   writes that into the COLOR_0 of a glTF file unchanged, where the glTF standard says linear: 0.502. Colours of 0..255,
#   which some scanners write, are clamped to 255 by trimesh and become 524946.8 in three.js.
# Why it matters: the same scan is more than twice as bright after a detour through glTF, and nobody is told. OBJ itself
#   defines neither the colours nor their space.
# Versions: three 0.187.0, trimesh 5.2.0 (numpy 2.4.6). Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . three@0.187.0
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

cat > run.mjs <<'JAVASCRIPT'
import { OBJLoader } from "three/examples/jsm/loaders/OBJLoader.js";

for (const colour of ["0.5 0.5 0.5", "255 0 0"]) {
  const text = ["0 0 0", "1 0 0", "0 1 0"].map((p) => `v ${p} ${colour}\n`).join("") + "f 1 2 3\n";
  const read = new OBJLoader().parse(text).children[0].geometry.attributes.color.array;
  console.log(colour, "three", Array.from(read).slice(0, 3).map((c) => c.toFixed(3)).join(" "));
}
JAVASCRIPT

cat > run.py <<'PYTHON'
import io
import json

import trimesh

for colour in ("0.5 0.5 0.5", "255 0 0"):
    text = "".join(f"v {p} {colour}\n" for p in ("0 0 0", "1 0 0", "0 1 0")) + "f 1 2 3\n"
    mesh = trimesh.load(io.BytesIO(text.encode()), file_type="obj", process=False)
    file = mesh.export(file_type="glb")
    length = int.from_bytes(file[12:16], "little")
    gltf = json.loads(file[20 : 20 + length])
    accessor = gltf["accessors"][gltf["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    view = gltf["bufferViews"][accessor["bufferView"]]
    start = 20 + length + 8 + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    assert accessor["componentType"] == 5121 and accessor["normalized"]
    stored = [round(c / 255, 3) for c in file[start : start + 4]]
    print(colour, "trimesh", mesh.visual.vertex_colors[0].tolist(), "COLOR_0 in glTF", stored)
PYTHON
{ node run.mjs; env/bin/python run.py; } > seen

cat > expected <<'EXPECTED'
0.5 0.5 0.5 three 0.214 0.214 0.214
255 0 0 three 524946.813 0.000 0.000
0.5 0.5 0.5 trimesh [128, 128, 128, 255] COLOR_0 in glTF [0.502, 0.502, 0.502, 1.0]
255 0 0 trimesh [255, 0, 0, 255] COLOR_0 in glTF [1.0, 0.0, 0.0, 1.0]
EXPECTED

echo "three 0.187.0 numpy 2.4.6 trimesh 5.2.0, node $(node --version), $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
