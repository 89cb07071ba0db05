# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels in Blender: bake objects, cover surfaces, export landscapes, render them with vtex."""

import bpy

from . import bake, panels, properties, render, scatter
from .gltf_export import (  # noqa: F401: the glTF exporter looks for them here
    glTF2_post_export_callback,
    glTF2_pre_export_callback,
    glTF2ExportUserExtension,
)
from .gltf_import import glTF2ImportUserExtension  # noqa: F401: so does the importer

MODULES = (properties, bake, scatter, render, panels)


def draw_import(context, layout):
    """The glTF importer shows the settings of each extension; there are none."""


def draw_export(context, layout):
    """The glTF exporter does the same."""


def register():
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
    properties.attach()


def unregister():
    properties.detach()
    for module in reversed(MODULES):
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)
