# SPDX-License-Identifier: GPL-3.0-or-later
"""Hooks of Blender's glTF importer: the extension comes back as properties, height vectors with Z up."""

import os
from urllib.parse import unquote

import bpy
import numpy as np

from . import extension
from .gltf_export import COMBING


def placed(table, folder):
    """A table of the file whose `uri` became `file`, an absolute path."""
    if isinstance(table, list):
        return [placed(v, folder) for v in table]
    if not isinstance(table, dict):
        return table
    out = {k: placed(v, folder) for k, v in table.items() if k != "uri"}
    if "uri" in table:
        out["file"] = os.path.abspath(os.path.join(folder, unquote(table["uri"])))
    return out


def unpacked(gltf, index, path):
    """The .vtex file that stands in a buffer view, as a file of its own: `path`, or one like it if something else is there."""
    from io_scene_gltf2.io.imp.gltf2_io_binary import BinaryData
    data = bytes(BinaryData.get_buffer_view(gltf, index))
    stem, count = path, 1
    while os.path.exists(path + ".vtex"):
        with open(path + ".vtex", "rb") as f:
            if f.read() == data:
                return path + ".vtex"
        count += 1
        path = f"{stem}-{count}"
    with open(path + ".vtex", "wb") as f:
        f.write(data)
    return path + ".vtex"


class glTF2ImportUserExtension:
    """Called by the importer; one object an import."""

    def __init__(self):
        from io_scene_gltf2.io.com.gltf2_io_extensions import Extension
        self.extensions = [Extension(name=extension.NAME, extension={}, required=False)]
        self.tables = None

    def root(self, gltf):
        return (gltf.data.extensions or {}).get(extension.NAME, {})

    def folder(self, gltf):
        return os.path.dirname(gltf.import_settings.get("filepath") or gltf.filename)

    def texels(self, gltf):
        """The file's texels with absolute paths; those that stand in the file itself become files beside it."""
        if self.tables is None:
            folder = self.folder(gltf)
            self.tables = placed(self.root(gltf).get("texels", []), folder)
            for number, texel in enumerate(self.tables):
                for k, frame in enumerate(texel["frames"]):
                    view = frame.pop("bufferView", None)
                    if view is not None:
                        name = bpy.path.clean_name(texel.get("name", f"texel-{number}")) + (f"-{k}" if k else "")
                        frame["file"] = unpacked(gltf, view, os.path.join(os.path.abspath(folder), name))
        return self.tables

    def gather_import_material_after_hook(self, gltf_material, vertex_color, blender_material, gltf):
        table = (gltf_material.extensions or {}).get(extension.NAME)
        if table is None:
            return
        p = blender_material.vtex
        texel = extension.from_json(p, table, self.texels(gltf))
        if texel is None:
            return
        p.texel = texel["frames"][0].get("file", "")
        p.geometry = texel.get("geometry", {}).get("file", "")

    def gather_import_mesh_after_hook(self, gltf_mesh, blender_mesh, gltf):
        attribute = blender_mesh.attributes.get(COMBING)
        if attribute is None or attribute.data_type != "FLOAT_VECTOR":
            return
        values = np.empty(len(attribute.data) * 3, dtype=np.float32)
        attribute.data.foreach_get("vector", values)
        v = values.reshape(-1, 3)
        attribute.data.foreach_set("vector", np.stack([v[:, 0], -v[:, 2], v[:, 1]], axis=1).ravel())

    def gather_import_scene_after_nodes_hook(self, gltf_scene, blender_scene, gltf):
        rest = placed(extension.without(self.root(gltf), "texels"), self.folder(gltf))
        if "environment" in rest:
            blender_scene["vtex_environment"] = rest.pop("environment")
        if rest:
            blender_scene["vtex_root"] = rest
