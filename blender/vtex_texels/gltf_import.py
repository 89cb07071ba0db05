# SPDX-License-Identifier: GPL-3.0-or-later
"""Hooks of Blender's glTF importer: the extension comes back as properties, height vectors with Z up."""

import os
from urllib.parse import unquote

import bpy
import numpy as np

from . import extension
from .gltf_export import COMBING


class glTF2ImportUserExtension:
    """Called by the importer; one object an import."""

    def __init__(self):
        from io_scene_gltf2.io.com.gltf2_io_extensions import Extension
        self.extensions = [Extension(name=extension.NAME, extension={}, required=False)]

    def root(self, gltf):
        return (gltf.data.extensions or {}).get(extension.NAME, {})

    def gather_import_material_after_hook(self, gltf_material, vertex_color, blender_material, gltf):
        table = (gltf_material.extensions or {}).get(extension.NAME)
        if table is None:
            return
        p = blender_material.vtex
        texels = self.root(gltf).get("texels", [])
        index = extension.from_json(p, table)
        if not 0 <= index < len(texels):
            return
        folder = os.path.dirname(gltf.import_settings.get("filepath") or gltf.filename)
        texel = texels[index]
        p.texel = os.path.join(folder, unquote(texel["frames"][0].get("uri", "")))
        if "geometry" in texel:
            p.geometry = os.path.join(folder, unquote(texel["geometry"]["uri"]))

    def gather_import_mesh_after_hook(self, gltf_mesh, blender_mesh, gltf):
        attribute = blender_mesh.attributes.get(COMBING)
        if attribute is None or attribute.data_type != "FLOAT_VECTOR":
            return
        values = np.empty(len(attribute.data) * 3, dtype=np.float32)
        attribute.data.foreach_get("vector", values)
        v = values.reshape(-1, 3)
        attribute.data.foreach_set("vector", np.stack([v[:, 0], -v[:, 2], v[:, 1]], axis=1).ravel())

    def gather_import_scene_after_nodes_hook(self, gltf_scene, blender_scene, gltf):
        environment = self.root(gltf).get("environment")
        if environment:
            blender_scene["vtex_environment"] = environment
