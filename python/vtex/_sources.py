"""Sources that are in memory, written as files for the bake."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def save_array(values: NDArray[Any], spacing: tuple[float, float, float], folder: Path) -> Path:
    """An array [x, y, z] as NRRD, whose first axis runs fastest. Whole numbers keep their type, others become float32."""
    if values.ndim != 3 or 0 in values.shape:
        raise ValueError(f"the array has the shape {values.shape}: three axes are wanted, none of them empty")
    kinds = {"i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32", "u4": "uint32"}
    kind = values.dtype.str[1:]
    if values.dtype == bool:
        values, kind = values.astype(np.uint8), "u1"
    if kind not in kinds:
        if not np.issubdtype(values.dtype, np.number) or np.issubdtype(values.dtype, np.complexfloating):
            raise ValueError(f"an array of {values.dtype} is no image stack")
        values = values.astype(np.float32)
    header = (
        "NRRD0004\n"
        f"type: {kinds.get(kind, 'float')}\n"
        "dimension: 3\n"
        "sizes: {} {} {}\n".format(*values.shape)
        + "spacings: {!r} {!r} {!r}\n".format(*map(float, spacing))
        + 'units: "mm" "mm" "mm"\nendian: little\nencoding: raw\n\n'
    )
    path = folder / "array.nrrd"
    little = values.astype(values.dtype.newbyteorder("<"))
    path.write_bytes(header.encode() + little.tobytes(order="F"))
    return path


@dataclass
class Mesh:
    """Triangles in memory, +Y up, in metres."""

    #: (n, 3) positions.
    positions: ArrayLike
    #: (m, 3) indices of positions.
    triangles: ArrayLike
    #: (n, 3) linear colours 0 … 1 of the vertices, or three numbers for all.
    color: ArrayLike = (0.5, 0.5, 0.5)

    def save(self, folder: Path) -> Path:
        """As a binary glTF."""
        positions = _rows(self.positions, np.float32, "positions")
        triangles = _rows(self.triangles, np.int64, "triangles")
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(positions):
            raise ValueError(f"a triangle names a vertex beyond the {len(positions)} that there are")
        color = np.asarray(self.color, np.float32)
        attributes = [positions] if color.ndim == 1 else [positions, _rows(color, np.float32, "color")]
        if len(attributes[-1]) != len(positions):
            raise ValueError(f"{len(attributes[-1])} colours for {len(positions)} vertices")
        parts = [*attributes, triangles.astype(np.uint32)]
        views, offset = [], 0
        for part in parts:
            views.append({"buffer": 0, "byteOffset": offset, "byteLength": part.nbytes})
            offset += part.nbytes
        accessors: list[dict[str, Any]] = [
            {"bufferView": i, "componentType": 5126, "count": len(part), "type": "VEC3"}
            for i, part in enumerate(attributes)
        ]
        low, high = positions.min(axis=0), positions.max(axis=0)
        accessors[0] |= {"min": low.tolist(), "max": high.tolist()}
        accessors.append({"bufferView": len(attributes), "componentType": 5125, "count": triangles.size, "type": "SCALAR"})
        factor = color.tolist() if color.ndim == 1 else [1.0, 1.0, 1.0]
        if len(factor) != 3:
            raise ValueError("a colour has three numbers")
        names = {"POSITION": 0} | ({"COLOR_0": 1} if len(attributes) > 1 else {})
        document = {
            "asset": {"version": "2.0", "generator": "vtex (Python)"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": names, "indices": len(attributes), "material": 0}]}],
            "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0]}}],
            "buffers": [{"byteLength": offset}],
            "bufferViews": views,
            "accessors": accessors,
        }
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        data = b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in parts)
        path = folder / "mesh.glb"
        head = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(data))
        path.write_bytes(
            head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        )
        return path


def _rows(values: ArrayLike, kind: type, what: str) -> NDArray[Any]:
    rows: NDArray[Any] = np.ascontiguousarray(values, kind)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
        raise ValueError(f"{what} have the shape {rows.shape}: rows of three are wanted")
    return rows
