# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports the scene and renders it with vtex into Blender's image editor."""

import os
import shutil
import tempfile

import bpy
from bpy.props import IntProperty, StringProperty

from . import program
from .bake import known


def export(path, selected=False):
    """The scene as a landscape: copies as instances, the camera and lights with it."""
    kind = "GLB" if path.lower().endswith(".glb") else "GLTF_SEPARATE"
    return bpy.ops.export_scene.gltf(**known(
        bpy.ops.export_scene.gltf, filepath=path, export_format=kind, use_selection=selected, export_apply=True,
        export_gn_mesh=True, export_gpu_instances=True, export_cameras=True, export_lights=True, export_attributes=True,
        export_yup=True, export_animations=False))


class VTEX_OT_export(bpy.types.Operator):
    """Write the scene as a landscape that vtex renders (.glb or .gltf); the texels that it names go beside it"""

    bl_idname = "vtex.export"
    bl_label = "Export Landscape"

    filepath: StringProperty(subtype="FILE_PATH", default="landscape.glb")
    filter_glob: StringProperty(default="*.glb;*.gltf", options={"HIDDEN"})

    def invoke(self, context, event):
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        try:
            return export(bpy.path.abspath(self.filepath))
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}


class VTEX_OT_render(bpy.types.Operator, program.Waiting):
    """Render the scene from its camera with vtex, into the image "vtex render" """

    bl_idname = "vtex.render"
    bl_label = "Render with vtex"

    lanes: IntProperty(name="Cones a pixel", default=1, min=1, max=16)

    def execute(self, context):
        scene = context.scene
        self.folder = tempfile.mkdtemp(prefix="vtex-")
        landscape, self.picture = (os.path.join(self.folder, n) for n in ("landscape.glb", "picture.exr"))
        share = scene.render.resolution_percentage / 100.0
        width, height = (max(1, round(v * share)) for v in (scene.render.resolution_x, scene.render.resolution_y))
        try:
            if scene.camera is None:
                raise RuntimeError("the scene has no camera: add one")
            program.path()
            export(landscape)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            shutil.rmtree(self.folder, ignore_errors=True)
            return {"CANCELLED"}
        arguments = ["render", landscape, "-o", self.picture, "--size", f"{width}x{height}", "--lanes", str(self.lanes),
                     "--camera", scene.camera.name]
        return self.begin(context, arguments)

    def end(self, context):
        try:
            return super().end(context)
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)

    def done(self, context):
        image = bpy.data.images.load(self.picture)
        image.pack()
        old = bpy.data.images.get("vtex render")
        if old is not None:
            old.user_remap(image)
            bpy.data.images.remove(old)
        image.name = "vtex render"
        for area in context.screen.areas if context.screen else []:
            if area.type == "IMAGE_EDITOR":
                area.spaces.active.image = image
        return {"FINISHED"}


CLASSES = (VTEX_OT_export, VTEX_OT_render)
