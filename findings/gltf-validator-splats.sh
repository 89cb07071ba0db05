#!/usr/bin/env bash
# A file of KHR_gaussian_splatting before the Khronos validator.
#
# One would guess: an extension that the validator does not know is a notice (UNSUPPORTED_EXTENSION), and a file that follows the
#   extension has no errors.
# What happens: names of attributes with a prefix and a colon, which the extension demands, are errors of their own
#   (MESH_PRIMITIVE_INVALID_ATTRIBUTE), one for each of them, though the extension is named in extensionsUsed and on the primitive.
# Why it matters: a check that asks for no errors refuses all splats; one that ignores this code misses attributes that are
#   misspelt. Only errors of this code, at names with the prefix of an extension in use, may be passed over.
# Versions: gltf-validator 2.0.0-dev.3.10. Written on 2026-11-30.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . gltf-validator@2.0.0-dev.3.10

cat > run.mjs <<'JAVASCRIPT'
import validator from "gltf-validator";

// One splat at the origin.
const name = "KHR_gaussian_splatting", parts = { POSITION: [0, 0, 0], ROTATION: [0, 0, 0, 1], SCALE: [1, 1, 1], OPACITY: [0.5], SH_DEGREE_0_COEF_0: [0, 0, 0] };
const attributes = {}, accessors = [], bufferViews = [], numbers = [];
for (const [part, values] of Object.entries(parts)) {
  attributes[part === "POSITION" ? part : `${name}:${part}`] = accessors.length;
  accessors.push({ bufferView: bufferViews.length, componentType: 5126, count: 1, type: ["SCALAR", "", "VEC3", "VEC4"][values.length - 1],
    ...(part === "POSITION" ? { min: values, max: values } : {}) });
  bufferViews.push({ buffer: 0, byteOffset: 4 * numbers.length, byteLength: 4 * values.length, target: 34962 });
  numbers.push(...values);
}
const data = Buffer.from(new Float32Array(numbers).buffer);
const gltf = { asset: { version: "2.0" }, extensionsUsed: [name], buffers: [{ byteLength: data.length, uri: `data:application/octet-stream;base64,${data.toString("base64")}` }],
  bufferViews, accessors, meshes: [{ primitives: [{ mode: 0, attributes, extensions: { [name]: { kernel: "ellipse", colorSpace: "srgb_rec709_display" } } }] }],
  nodes: [{ mesh: 0 }], scenes: [{ nodes: [0] }], scene: 0 };
const { issues } = await validator.validateString(JSON.stringify(gltf));
console.log("errors", issues.numErrors, "warnings", issues.numWarnings, "notices", issues.numInfos);
for (const { severity, code, pointer } of issues.messages) console.log(severity, code, pointer);
JAVASCRIPT
node run.mjs > seen

cat > expected <<'EXPECTED'
errors 4 warnings 0 notices 1
2 UNSUPPORTED_EXTENSION /extensionsUsed/0
0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:ROTATION
0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:SCALE
0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:OPACITY
0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:SH_DEGREE_0_COEF_0
EXPECTED

echo "gltf-validator 2.0.0-dev.3.10, node $(node --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
