#!/usr/bin/env bash
# An OBJ file with one concave polygon of five corners, of area 10.
#
# One would guess: a loader cuts a polygon into triangles that cover it, so the area is 10 whatever corner comes first.
# What happens: three.js and trimesh cut it into a fan from the first corner, which is right for convex polygons only. The
#   triangles overlap and leave the outline: area 14, or 22 when another corner is first. obj2gltf gives 10 each time.
# Why it matters: landscape and building models are full of concave faces. Area, samples per area and coverage come out
#   larger than the surface, and a picture in the viewer cannot serve as the reference for what the file holds.
# Versions: three 0.187.0, obj2gltf 3.2.0, trimesh 5.2.0 (numpy 2.4.6). Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . three@0.187.0 obj2gltf@3.2.0
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

cat > run.mjs <<'JAVASCRIPT'
import { createRequire } from "node:module";
import { writeFileSync } from "node:fs";
import { OBJLoader } from "three/examples/jsm/loaders/OBJLoader.js";

const obj2gltf = createRequire(import.meta.url)("obj2gltf");

// Sum of the areas of triangles in the plane z = 0; nine numbers per triangle.
function area(p) {
  let sum = 0;
  for (let i = 0; i < p.length; i += 9) {
    sum += Math.abs((p[i + 3] - p[i]) * (p[i + 7] - p[i + 1]) - (p[i + 6] - p[i]) * (p[i + 4] - p[i + 1])) / 2;
  }
  return sum;
}

for (const corners of ["1 2 3 4 5", "5 1 2 3 4", "4 5 1 2 3"]) {
  const text = `v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf ${corners}\n`;
  writeFileSync("a.obj", text);
  const three = new OBJLoader().parse(text).children[0].geometry.attributes.position.array;
  console.log("f", corners, "three", area(three));

  const gltf = await obj2gltf("a.obj", {});
  const bytes = Buffer.from(gltf.buffers[0].uri.split(",")[1], "base64");
  const primitive = gltf.meshes[0].primitives[0];
  const start = (k) => {
    const accessor = gltf.accessors[k];
    return (gltf.bufferViews[accessor.bufferView].byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  };
  const triangles = [];
  for (let i = 0; i < gltf.accessors[primitive.indices].count; i++) {
    const vertex = bytes.readUInt16LE(start(primitive.indices) + 2 * i);
    for (let c = 0; c < 3; c++) {
      triangles.push(bytes.readFloatLE(start(primitive.attributes.POSITION) + 12 * vertex + 4 * c));
    }
  }
  console.log("f", corners, "obj2gltf", area(triangles));
}
JAVASCRIPT

cat > run.py <<'PYTHON'
import io

import trimesh

for corners in ("1 2 3 4 5", "5 1 2 3 4", "4 5 1 2 3"):
    text = f"v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf {corners}\n"
    mesh = trimesh.load(io.BytesIO(text.encode()), file_type="obj", process=False)
    print("f", corners, "trimesh", float(mesh.area))
PYTHON
{ node run.mjs; env/bin/python run.py; } > seen

cat > expected <<'EXPECTED'
f 1 2 3 4 5 three 14
f 1 2 3 4 5 obj2gltf 10
f 5 1 2 3 4 three 22
f 5 1 2 3 4 obj2gltf 10
f 4 5 1 2 3 three 10
f 4 5 1 2 3 obj2gltf 10
f 1 2 3 4 5 trimesh 14.0
f 5 1 2 3 4 trimesh 22.0
f 4 5 1 2 3 trimesh 10.0
EXPECTED

echo "three 0.187.0 obj2gltf 3.2.0 numpy 2.4.6 trimesh 5.2.0, node $(node --version), $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
