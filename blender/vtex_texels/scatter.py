# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies on a surface by geometry nodes, thinned by painted weights; combing of height vectors."""

import bpy
from bpy.props import FloatProperty, FloatVectorProperty, IntProperty, StringProperty

from .gltf_export import COMBING


def group(name):
    """The node group that scatters one object over faces; made once a file."""
    found = bpy.data.node_groups.get(name)
    if found is not None:
        return found
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.is_modifier = True

    def socket(label, kind, way="INPUT", **values):
        s = tree.interface.new_socket(name=label, socket_type=kind, in_out=way)
        for key, value in values.items():
            setattr(s, key, value)
        return s

    socket("Geometry", "NodeSocketGeometry")
    socket("Geometry", "NodeSocketGeometry", "OUTPUT")
    socket("Copy", "NodeSocketObject")
    socket("Distance", "NodeSocketFloat", default_value=1.0, min_value=0.001)
    socket("Density", "NodeSocketFloat", default_value=1.0, min_value=0.0)
    socket("Weights", "NodeSocketFloat", default_value=1.0)
    socket("Smallest", "NodeSocketFloat", default_value=0.8, min_value=0.01)
    socket("Largest", "NodeSocketFloat", default_value=1.0, min_value=0.01)
    socket("Seed", "NodeSocketInt", default_value=0)

    def node(kind, **values):
        n = tree.nodes.new(kind)
        for key, value in values.items():
            setattr(n, key, value)
        return n

    link = tree.links.new
    inside, outside = node("NodeGroupInput"), node("NodeGroupOutput")
    points = node("GeometryNodeDistributePointsOnFaces", distribute_method="POISSON")
    link(inside.outputs["Geometry"], points.inputs["Mesh"])
    link(inside.outputs["Distance"], points.inputs["Distance Min"])
    link(inside.outputs["Density"], points.inputs["Density Max"])
    link(inside.outputs["Weights"], points.inputs["Density Factor"])
    link(inside.outputs["Seed"], points.inputs["Seed"])
    turn = node("FunctionNodeRandomValue", data_type="FLOAT_VECTOR")
    vectors = [s for s in turn.inputs if s.type == "VECTOR"]
    vectors[0].default_value, vectors[1].default_value = (0, 0, 0), (0, 0, 6.2831855)
    size = node("FunctionNodeRandomValue", data_type="FLOAT")
    floats = [s for s in size.inputs if s.type == "VALUE"]
    link(inside.outputs["Smallest"], floats[0])
    link(inside.outputs["Largest"], floats[1])
    link(inside.outputs["Seed"], size.inputs["Seed"])
    copy = node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
    copy.inputs["As Instance"].default_value = True
    link(inside.outputs["Copy"], copy.inputs["Object"])
    stand = node("GeometryNodeInstanceOnPoints")
    link(points.outputs["Points"], stand.inputs["Points"])
    link(copy.outputs["Geometry"], stand.inputs["Instance"])
    link(next(s for s in turn.outputs if s.type == "VECTOR"), stand.inputs["Rotation"])
    link(next(s for s in size.outputs if s.type == "VALUE"), stand.inputs["Scale"])
    both = node("GeometryNodeJoinGeometry")
    link(inside.outputs["Geometry"], both.inputs["Geometry"])
    link(stand.outputs["Instances"], both.inputs["Geometry"])
    link(both.outputs["Geometry"], outside.inputs["Geometry"])
    return tree


def set_input(modifier, label, value=None, attribute=None):
    """Set an input of the modifier's node group to a value, or to an attribute by its name."""
    tree = modifier.node_group.interface.items_tree
    key = next(i.identifier for i in tree if i.item_type == "SOCKET" and i.in_out == "INPUT" and i.name == label)
    properties = getattr(modifier, "properties", None)
    if properties is not None:
        # Blender 5.3 has properties where 4.2 has items of the modifier.
        socket = getattr(properties.inputs, key)
        if attribute is None:
            socket.value = value
        else:
            socket.type, socket.attribute_name = "ATTRIBUTE", attribute
    elif attribute is None:
        modifier[key] = value
    else:
        modifier[f"{key}_use_attribute"], modifier[f"{key}_attribute_name"] = True, attribute


class VTEX_OT_scatter(bpy.types.Operator):
    """Stand copies of a stand-in on the active object, at random, with a least distance, thinned by its active vertex group"""

    bl_idname = "vtex.scatter"
    bl_label = "Scatter Copies"
    bl_options = {"REGISTER", "UNDO"}

    stand_in: StringProperty(name="Stand-in", description="Object whose material names a texel")
    distance: FloatProperty(name="Distance", default=2.0, min=0.001, unit="LENGTH", description="Least distance of two copies")
    density: FloatProperty(name="Density", default=1.0, min=0.0, description="Copies per square metre, before distances")
    seed: IntProperty(name="Seed", default=0)

    def execute(self, context):
        ground, copy = context.active_object, bpy.data.objects.get(self.stand_in)
        if ground is None or ground.type != "MESH":
            self.report({"ERROR"}, "make the mesh active that the copies stand on")
            return {"CANCELLED"}
        if copy is None or not any(s.material and s.material.vtex.role == "copies" for s in copy.material_slots):
            self.report({"ERROR"}, f"{self.stand_in!r} is no stand-in: bake a texel first, or set its material's Texel to Copies")
            return {"CANCELLED"}
        modifier = ground.modifiers.new(f"Copies of {copy.name}", "NODES")
        modifier.node_group = group("vtex scatter")
        for label, value in (("Copy", copy), ("Distance", self.distance), ("Density", self.density), ("Seed", self.seed)):
            set_input(modifier, label, value)
        weights = ground.vertex_groups.active
        if weights is not None:
            set_input(modifier, "Weights", attribute=weights.name)
        ground.update_tag()
        return {"FINISHED"}


class VTEX_OT_comb(bpy.types.Operator):
    """Comb the height vectors of the active mesh: selected vertices, or all, lean along a direction (Z up, metres)"""

    bl_idname = "vtex.comb"
    bl_label = "Comb"
    bl_options = {"REGISTER", "UNDO"}

    vector: FloatVectorProperty(name="Height vector", size=3, default=(0.0, 0.0, 1.0), subtype="XYZ")

    def execute(self, context):
        thing = context.active_object
        if thing is None or thing.type != "MESH":
            self.report({"ERROR"}, "make the mesh active that is combed")
            return {"CANCELLED"}
        if not any(self.vector):
            self.report({"ERROR"}, "a height vector of zero has no skin: give it a length")
            return {"CANCELLED"}
        mode = thing.mode
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        mesh = thing.data
        attribute = mesh.attributes.get(COMBING)
        if attribute is None:
            height = next((s.material.vtex.thickness for s in thing.material_slots if s.material), 1.0)
            attribute = mesh.attributes.new(COMBING, "FLOAT_VECTOR", "POINT")
            for vertex, item in zip(mesh.vertices, attribute.data):
                item.vector = vertex.normal * height
        chosen = [v.index for v in mesh.vertices if v.select] if mode == "EDIT" else range(len(mesh.vertices))
        for index in chosen:
            attribute.data[index].vector = self.vector
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)
        return {"FINISHED"}


CLASSES = (VTEX_OT_scatter, VTEX_OT_comb)
