#!/usr/bin/env bash
# A textured glTF file packed by gltfpack with its default options.
#
# One would guess: packing makes the file smaller and leaves TEXCOORD_0 meaning what it meant, up to rounding.
# What happens: gltfpack stores 12 bits of the coordinates in 16-bit normalized integers and puts the missing factor into
#   KHR_texture_transform of every texture (48 and 32 here). The extension is in extensionsUsed but not in
#   extensionsRequired, so a reader that does not know it may go on, and reads coordinates 48 times too small.
#   With the option -vtf the coordinates stay floats and no transform is written.
# Why it matters: a reader without the extension shows one smeared texel per triangle; texels per metre, mip levels and
#   the choice of sample spacing are wrong by that factor. KHR_mesh_quantization, which is required, does not tell.
# Versions: gltfpack 1.3.0, @gltf-transform/core 4.5.1. Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . gltfpack@1.3.0 @gltf-transform/core@4.5.1

cat > run.mjs <<'JAVASCRIPT'
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { Document, NodeIO } from "@gltf-transform/core";

// A rectangle whose texture repeats three times along x and twice along y.
const document = new Document();
const buffer = document.createBuffer();
const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
const pixel =
  "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
const texture = document.createTexture().setImage(Buffer.from(pixel, "base64")).setMimeType("image/png");
const primitive = document
  .createPrimitive()
  .setAttribute("POSITION", accessor("VEC3", new Float32Array([0, 0, 0, 3, 0, 0, 3, 2, 0, 0, 2, 0])))
  .setAttribute("TEXCOORD_0", accessor("VEC2", new Float32Array([0, 0, 3, 0, 3, 2, 0, 2])))
  .setIndices(accessor("SCALAR", new Uint16Array([0, 1, 2, 0, 2, 3])))
  .setMaterial(document.createMaterial().setBaseColorTexture(texture));
document.createScene().addChild(document.createNode().setMesh(document.createMesh().addPrimitive(primitive)));
await new NodeIO().write("in.glb", document);

for (const options of [[], ["-vtf"]]) {
  execFileSync("node_modules/.bin/gltfpack", ["-i", "in.glb", "-o", "out.glb", ...options]);
  const file = readFileSync("out.glb");
  const length = file.readUInt32LE(12);
  const gltf = JSON.parse(file.subarray(20, 20 + length));
  const uv = gltf.accessors[gltf.meshes[0].primitives[0].attributes.TEXCOORD_0];
  const view = gltf.bufferViews[uv.bufferView];
  const start = 20 + length + 8 + (view.byteOffset ?? 0) + (uv.byteOffset ?? 0);
  const size = uv.componentType === 5126 ? 4 : 2;
  let [u, v] = [0, 0];
  for (let i = 0; i < uv.count; i++) {
    const at = start + i * (view.byteStride ?? 2 * size);
    const number = (k) => (size === 4 ? file.readFloatLE(at + 4 * k) : file.readUInt16LE(at + 2 * k) / 65535);
    [u, v] = [Math.max(u, number(0)), Math.max(v, number(1))];
  }
  const transform = gltf.materials[0].pbrMetallicRoughness.baseColorTexture.extensions?.KHR_texture_transform;
  const scale = transform?.scale ?? [1, 1];
  console.log("options", options.join(" ") || "none");
  console.log("  used", (gltf.extensionsUsed ?? []).join(" "), "| required", (gltf.extensionsRequired ?? []).join(" "));
  console.log("  largest UV as stored", u.toFixed(4), v.toFixed(4));
  console.log("  scale", scale.map((s) => s.toFixed(2)).join(" "));
  console.log("  largest UV with the scale", (u * scale[0]).toFixed(3), (v * scale[1]).toFixed(3));
}
JAVASCRIPT
node run.mjs > seen

cat > expected <<'EXPECTED'
options none
  used KHR_mesh_quantization KHR_texture_transform | required KHR_mesh_quantization
  largest UV as stored 0.0625 0.0625
  scale 48.01 32.01
  largest UV with the scale 3.000 2.000
options -vtf
  used KHR_mesh_quantization | required KHR_mesh_quantization
  largest UV as stored 3.0000 2.0000
  scale 1.00 1.00
  largest UV with the scale 3.000 2.000
EXPECTED

echo "gltfpack 1.3.0 @gltf-transform/core 4.5.1, node $(node --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
