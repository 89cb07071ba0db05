# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: a material's texel, and the commands in the 3D view's sidebar."""

import bpy


class VTEX_PT_material(bpy.types.Panel):
    bl_label = "Texel"
    bl_idname = "VTEX_PT_material"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "material"

    @classmethod
    def poll(cls, context):
        return context.material is not None

    def draw(self, context):
        layout, p = self.layout, context.material.vtex
        layout.use_property_split = True
        layout.prop(p, "role")
        if p.role == "none":
            return
        layout.prop(p, "texel")
        layout.prop(p, "geometry")
        if p.role == "copies":
            return
        for name in ("thickness", "tex_coord", "scale", "offset", "wrap_u", "wrap_v", "wrap_w", "hidden", "seed", "discrete"):
            layout.prop(p, name)
        if p.discrete:
            for name in ("orientations", "mirror", "size_least", "size_most", "displace", "presence"):
                layout.prop(p, name)
        layout.prop(p, "continuous")
        if p.continuous:
            for name in ("frequency", "octaves", "amplitude", "tilt", "lengthen"):
                layout.prop(p, name)


class VTEX_PT_view(bpy.types.Panel):
    bl_label = "Texels"
    bl_idname = "VTEX_PT_view"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "vtex"

    def draw(self, context):
        layout = self.layout
        for name in ("vtex.bake", "vtex.scatter", "vtex.comb", "vtex.export", "vtex.render"):
            layout.operator(name)


CLASSES = (VTEX_PT_material, VTEX_PT_view)
