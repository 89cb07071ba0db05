# SPDX-License-Identifier: GPL-3.0-or-later
"""What a material says of texels, and where the program is. Names and defaults are those of VTEX_volumetric_texture."""

import bpy
from bpy.props import (BoolProperty, BoolVectorProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty,
                       PointerProperty, StringProperty)

WRAP = [(name.lower(), name, "") for name in ("Repeat", "Mirror", "Empty")]


class Texels(bpy.types.PropertyGroup):
    """Texels of one material"""

    role: EnumProperty(name="Texel", default="none", items=[
        ("none", "None", "An ordinary material"),
        ("shell", "Shell", "Faces grow a thick skin that the texel fills, as a texture fills a face: grass, fur, stone"),
        ("copies", "Copies", "Every object of this material is a stand-in for one rigid, whole copy: trees, bushes"),
    ])
    texel: StringProperty(name="File", subtype="FILE_PATH", description="The .vtex file")
    geometry: StringProperty(name="Near", subtype="FILE_PATH",
                             description="The .glb that the texel was baked from, seen where a pixel is finer than a voxel")
    thickness: FloatProperty(name="Thickness", default=1.0, min=0.0, unit="LENGTH", soft_max=100.0,
                             description="How high the skin is, where the mesh has no _VTEX_HEIGHT")
    tex_coord: IntProperty(name="UV map", default=0, min=0, max=7, description="Number of the UV map")
    scale: FloatVectorProperty(name="Copies", size=3, default=(1, 1, 1), description="Copies in the unit square of the UV map")
    offset: FloatVectorProperty(name="Offset", size=3, default=(0, 0, 0), description="Shift, in cells")
    wrap_u: EnumProperty(name="Wrap u", items=WRAP, default="repeat")
    wrap_v: EnumProperty(name="Wrap v", items=WRAP, default="repeat")
    wrap_w: EnumProperty(name="Wrap w", items=WRAP, default="empty")
    hidden: BoolProperty(name="Hide the surface", default=False, description="Draw the texels and not the faces under them")
    seed: IntProperty(name="Seed", default=0, min=0)
    # Isolated objects: each cell's copy by itself.
    discrete: BoolProperty(name="Vary copies", default=False, description="Turn, scale and move each copy by itself")
    orientations: EnumProperty(name="Turns", default="identity",
                               items=[(n, n, "") for n in ("identity", "w4", "w8", "cube24", "cube48")])
    mirror: BoolVectorProperty(name="Mirror", size=3, default=(False, False, False))
    size_least: FloatProperty(name="Smallest", default=1.0, min=0.01, max=1.0)
    size_most: FloatProperty(name="Largest", default=1.0, min=0.01, max=1.0)
    displace: FloatVectorProperty(name="Move", size=3, default=(0, 0, 0), min=0.0, max=4.0, description="In cells")
    presence: FloatProperty(name="Presence", default=1.0, min=0.0, max=1.0, description="Share of the cells that hold a copy")
    # Cyclic texels: noise that bends them.
    continuous: BoolProperty(name="Bend by noise", default=False, description="Noise moves, leans and lengthens what is continuous")
    frequency: FloatVectorProperty(name="Frequency", size=3, default=(0.5, 0.5, 0.5), min=0.001, max=64.0)
    octaves: IntProperty(name="Octaves", default=1, min=1, max=8)
    amplitude: FloatVectorProperty(name="Amplitude", size=3, default=(0, 0, 0), min=0.0, max=16.0, description="In cells")
    tilt: FloatProperty(name="Lean", default=0.0, min=0.0, max=1.2, subtype="ANGLE")
    lengthen: FloatProperty(name="Uneven height", default=0.0, min=0.0, max=0.9)
    rest: StringProperty(name="Rest", default="", options={"HIDDEN"},
                         description="JSON of what an imported file says and these properties cannot")


class Preferences(bpy.types.AddonPreferences):
    """Where the program is"""

    bl_idname = __package__
    program: StringProperty(name="vtex", subtype="FILE_PATH", default="", description="The vtex program; by default that of PATH")

    def draw(self, context):
        self.layout.prop(self, "program")


CLASSES = (Texels, Preferences)


def attach():
    bpy.types.Material.vtex = PointerProperty(type=Texels)


def detach():
    del bpy.types.Material.vtex
