#!/usr/bin/env bash
# Gaussian splats as a .ply, and the same splats as glTF.
#
# One would guess: the positions of a .ply are those of the scene, in the axes of whoever wrote it, and a converter to glTF keeps
#   them: neither format's positions come with a sign, and the .ply's header says nothing of axes.
# What happens: splat-transform takes +Y of a .ply to point down, as in the camera frames of the photographs that the first splats
#   were made from, and turns all splats by half a turn about z on the way to KHR_gaussian_splatting, where +Y is up.
# Why it matters: a .ply written with +Y up looks right in any viewer that shows its numbers as they are, and stands on its head
#   wherever this convention is kept.
# Versions: @playcanvas/splat-transform 3.7.0. Written on 2026-11-30.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . @playcanvas/splat-transform@3.7.0

cat > run.mjs <<'JAVASCRIPT'
import { execFileSync } from "node:child_process";
import { readFileSync, writeFileSync } from "node:fs";

// One splat at (1, 2, 3), not turned, of deviations 0.1, 0.2, 0.3.
const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
const values = [1, 2, 3, 0, 0, 0, 2, Math.log(0.1), Math.log(0.2), Math.log(0.3), 1, 0, 0, 0];
const head = `ply\nformat binary_little_endian 1.0\nelement vertex 1\n${names.map((n) => `property float ${n}\n`).join("")}end_header\n`;
writeFileSync("in.ply", Buffer.concat([Buffer.from(head), Buffer.from(new Float32Array(values).buffer)]));
execFileSync("node_modules/.bin/splat-transform", ["-q", "-w", "in.ply", "out.glb"]);
const file = readFileSync("out.glb"), length = file.readUInt32LE(12), gltf = JSON.parse(file.subarray(20, 20 + length));
const { attributes } = gltf.meshes[0].primitives[0];
for (const [name, count] of [["POSITION", 3], ["KHR_gaussian_splatting:ROTATION", 4], ["KHR_gaussian_splatting:SCALE", 3]]) {
  const accessor = gltf.accessors[attributes[name]], view = gltf.bufferViews[accessor.bufferView];
  const at = 28 + length + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  console.log(name, Array.from({ length: count }, (_, k) => (file.readFloatLE(at + 4 * k) + 0).toFixed(3).replace("-0.000", "0.000")).join(" "));
}
console.log("nodes", JSON.stringify(gltf.nodes));
JAVASCRIPT
node run.mjs > seen

cat > expected <<'EXPECTED'
POSITION -1.000 -2.000 3.000
KHR_gaussian_splatting:ROTATION 0.000 0.000 1.000 0.000
KHR_gaussian_splatting:SCALE 0.100 0.200 0.300
nodes [{"mesh":0}]
EXPECTED

echo "@playcanvas/splat-transform 3.7.0, node $(node --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
