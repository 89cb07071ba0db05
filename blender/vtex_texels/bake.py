# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes the selected objects to a texel, strands of hair too, and puts a stand-in for it into the scene."""

import contextlib
import os
import shutil
import tempfile

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from . import program
from .shading import output_of


def known(operator, **wanted):
    """The arguments of an operator that this version of Blender has."""
    names = operator.get_rna_type().properties.keys()
    return {k: v for k, v in wanted.items() if k in names}


def base_colour(material):
    """Linear colour of a strand's material."""
    if material is None:
        return (0.5, 0.5, 0.5)
    if material.node_tree is not None:
        output = output_of(material.node_tree)
        links = output.inputs["Surface"].links if output else []
        node = links[0].from_node if links else None
        for name in ("Base Color", "Color"):
            if node is not None and name in node.inputs:
                return tuple(node.inputs[name].default_value)[:3]
    return tuple(material.diffuse_color)[:3]


def strands(context, objects):
    """Rows (strand, x, y, z, radius, r, g, b) of the hair curves of `objects`, and of what their modifiers make, +Y up."""
    depsgraph = context.evaluated_depsgraph_get()
    rows, count = [], 0
    for instance in depsgraph.object_instances:
        shown = instance.object
        owner = instance.parent.original if instance.is_instance else shown.original
        if owner not in objects or shown.type != "CURVES":
            continue
        data, place = shown.data, instance.matrix_world
        scale = place.median_scale
        colour = base_colour(data.materials[0] if data.materials else None)
        radius = data.attributes.get("radius")
        for curve in data.curves:
            for k in range(curve.first_point_index, curve.first_point_index + curve.points_length):
                x, y, z = place @ data.points[k].position
                r = (radius.data[k].value if radius else data.points[k].radius) * scale
                rows.append((count, x, z, -y, r, *colour))
            count += 1
    return rows


def write_strands(path, rows):
    with open(path, "w", encoding="ascii") as f:
        f.write("id,x,y,z,radius,r,g,b\n")
        for row in rows:
            f.write(f"{row[0]}," + ",".join(f"{v:.9g}" for v in row[1:]) + "\n")


def has_faces(context, objects):
    depsgraph = context.evaluated_depsgraph_get()
    for instance in depsgraph.object_instances:
        owner = instance.parent.original if instance.is_instance else instance.object.original
        if owner in objects and instance.object.type == "MESH" and len(instance.object.data.polygons):
            return True
    return False


def write_source(context, objects, folder, frames):
    """The objects as files in `folder`. Gives the file to bake and, where all of it is a mesh, its .glb."""
    mesh, rows = has_faces(context, objects), strands(context, objects)
    if not mesh and not rows:
        raise RuntimeError("nothing to bake: select meshes, instances or hair curves, or name a collection that has some")
    glb = os.path.join(folder, "source.glb")
    if mesh:
        bpy.ops.export_scene.gltf(**known(
            bpy.ops.export_scene.gltf, filepath=glb, export_format="GLB", use_selection=True, export_apply=not frames,
            export_gn_mesh=True, export_animations=frames, export_lights=False, export_cameras=False, export_yup=True))
    if not rows:
        return glb, glb
    table = os.path.join(folder, "strands.csv")
    write_strands(table, rows)
    if not mesh:
        return table, None
    recipe = os.path.join(folder, "both.toml")
    with open(recipe, "w", encoding="ascii") as f:
        f.write('metres_per_unit = 1.0\n[[draw]]\nsource = { file = "source.glb" }\n'
                '[[draw]]\nsource = { file = "strands.csv" }\n')
    return recipe, None


@contextlib.contextmanager
def chosen(context, name):
    """The selected objects, or those of a collection, which are selected meanwhile."""
    before = set(context.selected_objects)
    if not name:
        yield before
        return
    collection = bpy.data.collections.get(name)
    if collection is None:
        raise RuntimeError(f"there is no collection {name!r}")
    objects = {o for o in collection.all_objects if o.name in context.view_layer.objects}
    try:
        for thing in context.view_layer.objects:
            thing.select_set(thing in objects)
        yield objects
    finally:
        for thing in context.view_layer.objects:
            thing.select_set(thing in before)


class VTEX_OT_bake(bpy.types.Operator, program.Waiting):
    """Bake the selected objects, or a collection, to a .vtex file and put a stand-in for it into the scene"""

    bl_idname = "vtex.bake"
    bl_label = "Bake Texel"
    bl_options = {"REGISTER"}

    filepath: StringProperty(subtype="FILE_PATH")
    filter_glob: StringProperty(default="*.vtex", options={"HIDDEN"})
    resolution: EnumProperty(name="Resolution", default="256", items=[(str(2**k), str(2**k), "") for k in range(4, 12)])
    frames: IntProperty(name="Frames", default=0, min=0, description="Frames of the animation; 0: it stands still")
    cyclic: BoolProperty(name="Cyclic", default=False, description="Opposite sides match: grass, fur")
    collection: StringProperty(name="Collection", default="", description="Bake all objects of this one, in place of those selected")
    stand_in: BoolProperty(name="Stand-in", default=True, description="Add a coarse mesh that stands for one copy")

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT"

    def invoke(self, context, event):
        self.filepath = bpy.path.clean_name(next((o.name for o in context.selected_objects), "texel")) + ".vtex"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        self.output = os.path.abspath(bpy.path.ensure_ext(bpy.path.abspath(self.filepath), ".vtex"))
        self.folder = tempfile.mkdtemp(prefix="vtex-")
        try:
            program.path()
            with chosen(context, self.collection) as objects:
                source, self.glb = write_source(context, objects, self.folder, self.frames > 0)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            shutil.rmtree(self.folder, ignore_errors=True)
            return {"CANCELLED"}
        arguments = ["bake", source, "-r", self.resolution, "-o", self.output]
        if self.frames:
            stem = self.output.removesuffix(".vtex")
            self.output = f"{stem}.####.vtex"
            arguments[-1] = self.output
            arguments += ["--frames", str(self.frames)]
        if self.cyclic:
            arguments += ["--cyclic", "u,v"]
        return self.begin(context, arguments)

    def end(self, context):
        try:
            return super().end(context)
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)

    def done(self, context):
        first = self.output
        if self.frames:
            first = next((os.path.join(os.path.dirname(self.output), n) for n in sorted(os.listdir(os.path.dirname(self.output)))
                          if n.startswith(os.path.basename(self.output).split("####")[0]) and n.endswith(".vtex")), self.output)
        near = None
        if self.glb and not self.frames:
            near = self.output.removesuffix(".vtex") + ".glb"
            shutil.copyfile(self.glb, near)
        if self.stand_in:
            try:
                add_stand_in(context, first, near)
            except RuntimeError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        self.report({"INFO"}, f"{self.output} baked")
        return {"FINISHED"}


def add_stand_in(context, texel, near=None, depth=5):
    """A coarse mesh made of a texel, in a material that names it: each object that shows it is one copy. Gives the object."""
    name = os.path.splitext(os.path.basename(texel))[0]
    with tempfile.TemporaryDirectory(prefix="vtex-") as folder:
        blocks = os.path.join(folder, name + ".glb")
        program.run(["export", texel, "-o", blocks, "--depth", str(depth)])
        before = set(bpy.data.objects)
        bpy.ops.import_scene.gltf(filepath=blocks)
    new = [o for o in bpy.data.objects if o not in before]
    stand = next(o for o in new if o.type == "MESH")
    stand.name = stand.data.name = name
    material = stand.data.materials[0]
    material.name = name
    p = material.vtex
    p.role, p.texel, p.geometry = "copies", texel, near or ""
    show_colours(material, stand.data)
    return stand


def show_colours(material, mesh):
    """The blocks' own colours in the viewport."""
    if material.node_tree is None or not mesh.color_attributes:
        return
    tree = material.node_tree
    main = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    if main is None or main.inputs["Base Color"].is_linked:
        return
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = mesh.color_attributes[0].name
    tree.links.new(node.outputs["Color"], main.inputs["Base Color"])


CLASSES = (VTEX_OT_bake,)
