#!/usr/bin/env python3
"""Writes a landscape from the text of landscape-1.md alone: what an exporter of another program has to do.

    exporter.py TEXEL.vtex OUTPUT.gltf

A strip of ground whose heights rise, covered twice by shells, with bilinear patches, jitter, colours and wind; and a few rigid copies.
Needs Python alone. The texel is copied beside the output.
"""
import base64, json, math, shutil, struct, sys
from pathlib import Path

X = "VTEX_volumetric_texture"


class Buffer:
    """The binary part of a glTF file, and the accessors to it."""

    def __init__(self):
        self.data, self.views, self.accessors = b"", [], []

    def add(self, kind, code, rows):
        rows = [row if isinstance(row, (tuple, list)) else (row,) for row in rows]
        body = b"".join(struct.pack(f"<{len(row)}{code}", *row) for row in rows)
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(body)})
        self.data += body.ljust((len(body) + 3) // 4 * 4, b"\0")
        self.accessors.append({"bufferView": len(self.views) - 1, "componentType": 5126 if code == "f" else 5125, "count": len(rows), "type": kind})
        if kind == "VEC3":
            self.accessors[-1].update(min=[min(r[k] for r in rows) for k in range(3)], max=[max(r[k] for r in rows) for k in range(3)])
        return len(self.accessors) - 1


def f32(value):
    """As it is stored: bounds of an accessor are those of its numbers."""
    return struct.unpack("<f", struct.pack("<f", value))[0]


def landscape(texel):
    buffer, side = Buffer(), 5
    grid = [(i, j) for j in range(side) for i in range(side)]
    positions = [(float(i), f32(0.2 * math.sin(i)), float(-j)) for i, j in grid]
    heights = [(0.0, f32(0.3 + 0.05 * i), 0.0) for i, _ in grid]
    patches = [[j * side + i, j * side + i + 1, (j + 1) * side + i + 1, (j + 1) * side + i] for j in range(side - 1) for i in range(side - 1)]
    triangles = [v for a, b, c, d in patches for v in (a, b, c, a, c, d)]
    ground = {
        "attributes": {
            "POSITION": buffer.add("VEC3", "f", positions), "TEXCOORD_0": buffer.add("VEC2", "f", [(f32(i / 2), f32(j / 2)) for i, j in grid]),
            "_VTEX_HEIGHT": buffer.add("VEC3", "f", heights), "_VTEX_JITTER": buffer.add("SCALAR", "f", [f32(i / side) for i, _ in grid]),
        },
        "indices": buffer.add("SCALAR", "I", triangles), "material": 0,
        "extensions": {X: {"patches": buffer.add("SCALAR", "I", [v for patch in patches for v in patch])}},
    }
    corner = buffer.add("VEC3", "f", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    stand_in = {"attributes": {"POSITION": corner}, "material": 1}
    copies = {
        "TRANSLATION": buffer.add("VEC3", "f", [(1.0, 0.2, -1.0), (2.5, 0.1, -2.0), (3.5, 0.0, -3.0)]),
        "SCALE": buffer.add("VEC3", "f", [(1.0, 1.0, 1.0), (0.5, 0.75, 0.5), (1.5, 1.5, 1.5)]),
        "_VTEX_TINT": buffer.add("VEC3", "f", [(1.0, 1.0, 1.0), (1.0, 0.5, 0.5), (0.5, 0.5, 1.0)]),
    }
    discrete = {"seed": 7, "presence": 0.8, "orientations": "w8", "mirror": [True, False, False], "scale": [0.7, 1], "displace": [0.2, 0.2, 0], "tint": [[1, 1, 1], [0.6, 1, 0.6]]}
    layers = [
        {"texel": 0, "jitter": {"discrete": discrete}, "phong": {"specularFactor": [0.1, 0.1, 0.1], "shininess": 40}},
        {"texel": 0, "scale": [2, 2, 1], "skinRange": [0, 0.5], "combine": "over", "opacityScale": 0.5, "jitter": {"continuous": {"uvwAmplitude": [0.2, 0.2, 0], "heightTilt": 0.2}}},
    ]
    return {
        "asset": {"version": "2.0", "generator": "exporter.py"}, "extensionsUsed": [X, "EXT_mesh_gpu_instancing", "KHR_lights_punctual"],
        "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}],
        "nodes": [
            {"mesh": 0}, {"mesh": 1, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": copies}}},
            {"camera": 0, "translation": [2, 2, 4], "rotation": [-0.26, 0, 0, 0.9656]},
            {"rotation": [-0.5, 0.2, 0, 0.8426], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
        "meshes": [{"primitives": [ground]}, {"primitives": [stand_in]}],
        "materials": [
            {"name": "meadow", "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.15, 0.1, 1]}, "extensions": {X: {"dw": 1, "layers": layers, "wind": {"strength": 0.5}}}},
            {"name": "shrubs", "extensions": {X: {"copies": {"texel": 0}}}},
        ],
        "extensions": {
            X: {"texels": [{"frames": [{"uri": texel}]}], "environment": {"sky": [0.3, 0.4, 0.6], "sunAngle": 0.009}, "wind": {"direction": [1, 0, 0.5]}},
            "KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 3, "color": [1, 0.9, 0.8]}]},
        },
        "accessors": buffer.accessors, "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data), "uri": "data:application/octet-stream;base64," + base64.b64encode(buffer.data).decode()}],
    }


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    texel, output = Path(sys.argv[1]), Path(sys.argv[2])
    beside = output.parent / texel.name
    if not (beside.exists() and beside.samefile(texel)):
        shutil.copy(texel, beside)
    output.write_text(json.dumps(landscape(texel.name)))


main()
