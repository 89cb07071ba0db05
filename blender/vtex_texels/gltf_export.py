# SPDX-License-Identifier: GPL-3.0-or-later
"""Hooks of Blender's glTF exporter: texels of materials, vectors with Y up, the world as a sky, lights in watts."""

import os
import shutil

import bpy
import numpy as np

from . import extension
from .shading import Rewired

COMBING = "_VTEX_HEIGHT"


def filled(path):
    """An absolute path, or an error that names the property."""
    full = bpy.path.abspath(path)
    if not os.path.isfile(full):
        raise RuntimeError(f"{path!r} is not there: set the file in the material's Texel panel")
    return os.path.realpath(full)


def same(a, b):
    if os.path.getsize(a) != os.path.getsize(b):
        return False
    with open(a, "rb") as x, open(b, "rb") as y:
        while chunk := x.read(1 << 20):
            if chunk != y.read(1 << 20):
                return False
    return True


def beside(path, folder):
    """The URI of a file as seen from `folder`; a file from elsewhere is copied there. Never writes over another file."""
    folder = os.path.realpath(folder)
    inside = os.path.relpath(path, folder)
    if inside.startswith(os.pardir) or os.path.isabs(inside):
        stem, end = os.path.splitext(os.path.basename(path))
        inside, count = stem + end, 1
        while os.path.exists(os.path.join(folder, inside)) and not same(path, os.path.join(folder, inside)):
            count += 1
            inside = f"{stem}-{count}{end}"
        if not os.path.exists(os.path.join(folder, inside)):
            shutil.copyfile(path, os.path.join(folder, inside))
    from urllib.parse import quote
    return quote(inside.replace(os.sep, "/"))


def content_id(path):
    """Content id of a .vtex file: 16 bytes at 112 of its header."""
    with open(path, "rb") as f:
        head = f.read(128)
    if len(head) < 128 or head[:12] != bytes.fromhex("ab565445582031bb0d0a1a0a"):
        raise RuntimeError(f"{path!r} is no .vtex file")
    return head[112:128].hex()


def moved(table, folder):
    """A table whose `file` became `uri`, as seen from `folder`; the content ids of texels are those that their files have now."""
    if isinstance(table, list):
        return [moved(v, folder) for v in table]
    if not isinstance(table, dict):
        return table
    out = {k: moved(v, folder) for k, v in table.items() if k != "file"}
    if "file" in table:
        out["uri"] = beside(filled(table["file"]), folder)
    if "contentId" in table:
        out["contentId"] = content_id(table["file"])
    return out


def world_sky(scene):
    """The world as the extension's environment, or None where it is black or absent."""
    world = scene.world
    if world is None:
        return None
    colour, strength = tuple(world.color), 1.0
    if world.node_tree is not None:
        node = next((n for n in world.node_tree.nodes if n.type == "BACKGROUND"), None)
        if node is None:
            return None
        if node.inputs["Color"].is_linked:
            source = node.inputs["Color"].links[0].from_node
            turbidity = getattr(source, "turbidity", None)
            return {"clear": {"turbidity": min(max(turbidity or 2.5, 1.0), 10.0)}} if source.type == "TEX_SKY" else None
        colour, strength = tuple(node.inputs["Color"].default_value)[:3], node.inputs["Strength"].default_value
    sky = extension.numbers(c * strength for c in colour)
    return {"sky": sky}


def own(export_settings):
    return [one for one in export_settings["gltf_user_extensions"] if isinstance(one, glTF2ExportUserExtension)]


# Blender 4.2 knows these two, and not the hooks `pre_export_hook` and `post_export_hook` of later versions.
def glTF2_pre_export_callback(export_settings):
    for one in own(export_settings):
        one.begin(export_settings)


def glTF2_post_export_callback(export_settings):
    for one in own(export_settings):
        one.end()


class glTF2ExportUserExtension:
    """Called by the exporter; one object an export."""

    def __init__(self):
        from io_scene_gltf2.io.com.gltf2_io_extensions import Extension
        self.make = Extension
        self.texels = []
        self.active = False
        self.rewired = None

    def begin(self, export_settings):
        self.rewired = Rewired(bpy.data.materials)
        self.active = any(m.vtex.role != "none" for m in bpy.data.materials if m.users)
        if self.active:
            # The exporter leaves out attributes of people's own unless it is told to, and turns lights to lux and candela.
            export_settings["gltf_attributes"] = True
            export_settings["gltf_lighting_mode"] = "COMPAT"

    def end(self):
        if self.rewired:
            self.rewired.restore()

    def texel(self, properties, folder):
        """Index of a material's texel among those of the file; None where it has none but in variants."""
        rest = extension.kept(properties)
        if not properties.texel and "variants" in rest.get("copies", {}):
            return None
        path = filled(properties.texel)
        table = rest.get("texel")
        if table is None or os.path.realpath(table["frames"][0].get("file", "")) != path:
            # A new texel, or another one than the file had that this was imported from.
            table = {"name": os.path.splitext(os.path.basename(path))[0], "frames": [{"file": path, "contentId": ""}]}
        table = extension.without(table, "geometry")
        if properties.geometry:
            table["geometry"] = {"file": filled(properties.geometry)}
        return self.index(table, folder)

    def index(self, table, folder):
        """Index of a texel among those of the file."""
        found = moved(table, folder)
        if found not in self.texels:
            self.texels.append(found)
        return self.texels.index(found)

    def gather_material_hook(self, material, blender_material, export_settings):
        lets_through = self.rewired.translucent.get(blender_material.name) if self.rewired else None
        if lets_through:
            self.add(material, "KHR_materials_diffuse_transmission", lets_through)
        properties = blender_material.vtex
        if properties.role == "none":
            return
        folder = os.path.dirname(export_settings["gltf_filepath"]) or "."
        self.add(material, extension.NAME, 
                 extension.to_json(properties, self.texel(properties, folder), lambda table: self.index(table, folder)))

    def add(self, to, name, table):
        if to.extensions is None:
            to.extensions = {}
        to.extensions[name] = self.make(name=name, extension=table, required=False)

    def gather_attribute_change(self, attribute, data, normalized, export_settings):
        # The exporter turns positions and normals to Y up, and never vectors of people's own.
        if attribute == COMBING and export_settings["gltf_yup"]:
            vectors = np.asarray(data["data"]).reshape(-1, 3)
            data["data"] = np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1).astype(np.float32)

    def gather_gltf_extensions_hook(self, gltf, export_settings):
        if not self.texels:
            return
        scene = bpy.context.scene
        folder = os.path.dirname(export_settings["gltf_filepath"]) or "."
        own = lambda name: moved(scene[name].to_dict(), folder) if name in scene else None
        table = {**(own("vtex_root") or {}), "texels": self.texels}
        environment = own("vtex_environment") or world_sky(scene)
        if environment:
            table["environment"] = environment
        self.add(gltf, extension.NAME, table)
