# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties of a material as JSON of VTEX_volumetric_texture, and back. Texels are named by a reference of the caller's."""

import json

NAME = "VTEX_volumetric_texture"


def number(value):
    """A float as short as Blender's 32 bits allow: 0.1 and not 0.10000000149."""
    return float(f"{value:.7g}")


def numbers(values):
    return [number(v) for v in values]


def unless(out, key, value, default):
    """Keys at their default stay out of the file."""
    if value != default:
        out[key] = value


def merged(base, over):
    """`over` on `base`, object by object."""
    out = dict(base)
    for key, value in over.items():
        old = out.get(key)
        out[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return out


def each_texel(value, f):
    """`value`, with f of each member that is called `texel` in its place."""
    if isinstance(value, dict):
        return {k: f(v) if k == "texel" else each_texel(v, f) for k, v in value.items()}
    return [each_texel(v, f) for v in value] if isinstance(value, list) else value


def discrete(p):
    out = {}
    unless(out, "seed", p.seed, 0)
    unless(out, "orientations", p.orientations, "identity")
    unless(out, "mirror", list(p.mirror), [False] * 3)
    unless(out, "scale", numbers((p.size_least, p.size_most)), [1.0, 1.0])
    unless(out, "displace", numbers(p.displace), [0.0] * 3)
    unless(out, "presence", number(p.presence), 1.0)
    return out


def continuous(p):
    out = {}
    unless(out, "seed", p.seed, 0)
    unless(out, "frequency", numbers(p.frequency), [0.5] * 3)
    unless(out, "octaves", p.octaves, 1)
    unless(out, "uvwAmplitude", numbers(p.amplitude), [0.0] * 3)
    unless(out, "heightTilt", number(p.tilt), 0.0)
    unless(out, "heightScale", number(p.lengthen), 0.0)
    return out


def kept(p):
    """What an imported file said and the properties cannot: `material`, `copies`, `layer`, `layers`, and `texel`, the table of
    the file that `p` names. Other texels are tables in place of indices."""
    return json.loads(p.rest) if p.rest else {}


def to_json(p, texel, index):
    """The material's extension. `texel` is the index of its texel among the file's, or None where it has none but in variants;
    `index(table)` that of another texel."""
    rest = each_texel({k: v for k, v in kept(p).items() if k != "texel"}, index)
    named = {} if texel is None else {"texel": texel}
    if p.role == "copies":
        return merged(rest.get("material", {}), {"copies": merged(rest.get("copies", {}), named)})
    layer = named
    unless(layer, "wrap", [p.wrap_u, p.wrap_v, p.wrap_w], ["repeat", "repeat", "empty"])
    unless(layer, "scale", numbers(p.scale), [1.0] * 3)
    unless(layer, "offset", numbers(p.offset), [0.0] * 3)
    jitter = {}
    if p.discrete:
        jitter["discrete"] = discrete(p)
    if p.continuous:
        jitter["continuous"] = continuous(p)
    if jitter:
        layer["jitter"] = jitter
    out = {"layers": [merged(rest.get("layer", {}), layer)] + rest.get("layers", [])}
    unless(out, "thickness", number(p.thickness), 1.0)
    unless(out, "texCoord", p.tex_coord, 0)
    if p.hidden:
        out["surface"] = "hidden"
    return merged(rest.get("material", {}), out)


def without(table, *keys):
    return {k: v for k, v in table.items() if k not in keys}


def from_json(p, extension, tables):
    """Set the properties from a material's extension; `tables` are the file's texels. Gives the table of its own, or None; what
    has no property is kept in `rest`."""
    rest = {}
    table_of = lambda index: tables[index] if isinstance(index, int) and 0 <= index < len(tables) else None
    if "copies" in extension:
        p.role = "copies"
        rest = {"material": without(extension, "copies"), "copies": without(extension["copies"], "texel")}
        texel = table_of(extension["copies"].get("texel"))
    else:
        p.role = "shell"
        layers = extension.get("layers") or [{}]
        layer = layers[0]
        p.thickness = extension.get("thickness", 1.0)
        p.tex_coord = extension.get("texCoord", 0)
        p.hidden = extension.get("surface") == "hidden"
        p.wrap_u, p.wrap_v, p.wrap_w = layer.get("wrap", ["repeat", "repeat", "empty"])
        p.scale = layer.get("scale", [1.0] * 3)
        p.offset = layer.get("offset", [0.0] * 3)
        jitter = layer.get("jitter", {})
        p.discrete, p.continuous = "discrete" in jitter, "continuous" in jitter
        d, c = jitter.get("discrete", {}), jitter.get("continuous", {})
        p.seed = d.get("seed", c.get("seed", 0)) % 2**31
        p.orientations = d.get("orientations", "identity")
        p.mirror = d.get("mirror", [False] * 3)
        p.size_least, p.size_most = d.get("scale", [1.0, 1.0])
        p.displace = d.get("displace", [0.0] * 3)
        p.presence = d.get("presence", 1.0)
        p.frequency = c.get("frequency", [0.5] * 3)
        p.octaves = c.get("octaves", 1)
        p.amplitude = c.get("uvwAmplitude", [0.0] * 3)
        p.tilt = c.get("heightTilt", 0.0)
        p.lengthen = c.get("heightScale", 0.0)
        own = {"discrete": ("seed", "orientations", "mirror", "scale", "displace", "presence"),
               "continuous": ("seed", "frequency", "octaves", "uvwAmplitude", "heightTilt", "heightScale")}
        more = {kind: without(jitter[kind], *keys) for kind, keys in own.items() if without(jitter.get(kind, {}), *keys)}
        # Seeds that Blender's signed integers cannot hold, or that differ, stay as they were.
        for kind, table in (("discrete", d), ("continuous", c)):
            if table.get("seed", p.seed) != p.seed:
                more.setdefault(kind, {})["seed"] = table["seed"]
        rest = {"material": without(extension, "layers", "thickness", "texCoord", "surface"),
                "layer": without(layer, "texel", "wrap", "scale", "offset", "jitter") | ({"jitter": more} if more else {}),
                "layers": layers[1:]}
        texel = table_of(layer.get("texel"))
    rest = each_texel({k: v for k, v in rest.items() if v}, table_of)
    if texel is not None:
        rest["texel"] = texel
    p.rest = json.dumps(rest, sort_keys=True) if rest else ""
    return texel
