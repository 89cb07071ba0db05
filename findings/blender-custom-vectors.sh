#!/usr/bin/env bash
# Vectors of people's own on a Blender mesh (wind, combing, flow: a FLOAT_VECTOR attribute) in its glTF files.
#
# One would guess: the exporter turns the scene from Z up to Y up, so it turns vectors that stand on the mesh with it, and the
#   importer turns them back; or at least both say that they do not.
# What happens: positions and normals are turned, attributes of people's own are copied as they are, in both directions. By
#   default they are not written at all, and nothing says so.
# Why it matters: what stood up lies along +Z of a file whose up is +Y. A round trip through Blender alone hides it, since the
#   two omissions cancel each other; any other program sees grass that lies down.
# Versions: bpy 5.0.1, numpy 1.26.4. bpy has wheels for Python 3.11 alone. Written on 2026-11-29.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON311:-python3.11}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==1.26.4 bpy==5.0.1

cat > run.py <<'PYTHON'
import json
import os
import struct

os.environ["BLENDER_USER_RESOURCES"] = os.path.abspath("user")
import bpy


def attributes(path):
    data = open(path, "rb").read()
    length = struct.unpack_from("<I", data, 12)[0]
    doc, binary = json.loads(data[20:20 + length]), data[28 + length:]
    out = {}
    for name, index in doc["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = doc["accessors"][index]
        if accessor["type"] != "VEC3":
            continue
        start = doc["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
        rows = [struct.unpack_from("<3f", binary, start + 12 * k) for k in range(accessor["count"])]
        out[name] = max(rows, key=lambda v: sum(x * x for x in v))
    return out


bpy.ops.wm.read_factory_settings(use_empty=True)
mesh = bpy.data.meshes.new("up")
mesh.from_pydata([(0, 0, 0), (0.1, 0, 0), (0, 0, 1)], [], [(0, 1, 2)])
own = mesh.attributes.new("_UP", "FLOAT_VECTOR", "POINT")
for item in own.data:
    item.vector = (0, 0, 1)
bpy.context.collection.objects.link(bpy.data.objects.new("up", mesh))
rounded = lambda v: [round(x, 3) + 0.0 for x in v]
for name, options in (("default", {}), ("export_attributes", {"export_attributes": True})):
    bpy.ops.export_scene.gltf(filepath="a.glb", export_format="GLB", **options)
    found = attributes("a.glb")
    print(name, "the top's POSITION", rounded(found["POSITION"]), "_UP", rounded(found["_UP"]) if "_UP" in found else "is not there")
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath="a.glb")
back = next(m for m in bpy.data.meshes if "_UP" in m.attributes)
top = max((v.co for v in back.vertices), key=lambda v: v.length)
print("imported the top", rounded(top), "_UP", rounded(back.attributes["_UP"].data[0].vector))
PYTHON
env/bin/python run.py | grep -E '^(default|export_attributes|imported)' > seen

cat > expected <<'EXPECTED'
default the top's POSITION [0.0, 1.0, 0.0] _UP is not there
export_attributes the top's POSITION [0.0, 1.0, 0.0] _UP [0.0, 0.0, 1.0]
imported the top [0.0, 0.0, 1.0] _UP [0.0, 0.0, 1.0]
EXPECTED

echo "bpy 5.0.1 numpy 1.26.4, $(env/bin/python --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
