# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that the glTF exporter loses silently, said in its own words while it runs: alpha by a Mix with Transparent, light
through leaves by a Mix or an Add with Translucent."""


def output_of(tree):
    return next((n for n in tree.nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output), None)


def shaders(node):
    """The shader sockets of a Mix or Add node with what feeds them: (socket, node or None)."""
    return [(s, s.links[0].from_node if s.is_linked else None) for s in node.inputs if s.type == "SHADER"]


class Rewired:
    """Node trees as the exporter understands them, until `restore` is called."""

    def __init__(self, materials):
        self.undo = []
        self.translucent = {}
        for material in materials:
            if material.node_tree is not None and material.library is None:
                self.mend(material)

    def restore(self):
        for step in reversed(self.undo):
            step()
        self.undo = []

    def link(self, tree, source, target):
        before = target.links[0].from_socket if target.is_linked else None
        tree.links.new(source, target)

        def back():
            for link in list(target.links):
                tree.links.remove(link)
            if before is not None:
                tree.links.new(before, target)
        self.undo.append(back)

    def value(self, socket, value):
        before = socket.default_value
        socket.default_value = value
        self.undo.append(lambda: setattr(socket, "default_value", before))

    def mend(self, material):
        tree = material.node_tree
        output = output_of(tree)
        if output is None or not output.inputs["Surface"].is_linked:
            return
        surface = output.inputs["Surface"]
        node = surface.links[0].from_node
        alpha = None
        if node.type == "MIX_SHADER":
            (first, a), (second, b) = shaders(node)
            if a is not None and b is not None and "BSDF_TRANSPARENT" in (a.type, b.type):
                # The factor is the share of the second shader.
                alpha = (node.inputs["Fac" if "Fac" in node.inputs else 0], b.type == "BSDF_TRANSPARENT")
                surface = first if b.type == "BSDF_TRANSPARENT" else second
                node = surface.links[0].from_node
        if node.type in {"MIX_SHADER", "ADD_SHADER"}:
            parts = [n for _, n in shaders(node) if n is not None]
            leaf = next((n for n in parts if n.type == "BSDF_TRANSLUCENT"), None)
            main = next((n for n in parts if n.type == "BSDF_PRINCIPLED"), None)
            if leaf is not None and main is not None:
                factor = 0.5
                if node.type == "MIX_SHADER":
                    factor = node.inputs[0].default_value
                    first = shaders(node)[0][1]
                    factor = factor if first == main else 1.0 - factor
                colour = list(leaf.inputs["Color"].default_value)[:3]
                self.translucent[material.name] = {
                    "diffuseTransmissionFactor": float(f"{factor:.7g}"),
                    "diffuseTransmissionColorFactor": [float(f"{c:.7g}") for c in colour],
                }
                node = main
        if node.type != "BSDF_PRINCIPLED" or node.outputs[0].links and node.outputs[0].links[0].to_node == output and alpha is None:
            return
        if alpha is not None:
            self.give_alpha(tree, node, *alpha)
        if output.inputs["Surface"].links[0].from_node != node:
            self.link(tree, node.outputs[0], output.inputs["Surface"])

    def give_alpha(self, tree, main, factor, turned):
        """The factor of a Mix with Transparent as the principled shader's alpha."""
        if not factor.is_linked:
            self.value(main.inputs["Alpha"], 1.0 - factor.default_value if turned else factor.default_value)
            return
        source = factor.links[0].from_socket
        if turned:
            node = source.node
            inverts = node.type == "INVERT" or node.type == "MATH" and node.operation == "SUBTRACT"
            inner = next((s for s in node.inputs if s.is_linked), None) if inverts else None
            if inner is None:
                # An alpha that says where nothing is: the exporter has no words for it.
                return
            source = inner.links[0].from_socket
        self.link(tree, source, main.inputs["Alpha"])
