#!/usr/bin/env python3
"""Make the grounds of the landscapes beside this file: meshes of some thousand triangles with cameras and a sun.

The same bytes on every machine with IEEE doubles, but for the last digits of sin and cos."""
import json
import math
import struct
import sys
import zlib
from pathlib import Path


def lattice(seed, i, j):
    h = (i * 0x8DA6B343 ^ j * 0xD8163841 ^ seed * 0x9E3779B9) & 0xFFFFFFFF
    h = ((h ^ h >> 16) * 0x7FEB352D) & 0xFFFFFFFF
    h = ((h ^ h >> 15) * 0x846CA68B) & 0xFFFFFFFF
    return ((h ^ h >> 16) & 0xFFFF) / 65535


def noise(seed, x, y):
    """Value noise in [0, 1]."""
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * u * (u * (6 * u - 15) + 10), v * v * v * (v * (6 * v - 15) + 10)
    top = lattice(seed, i, j) * (1 - u) + lattice(seed, i + 1, j) * u
    low = lattice(seed, i, j + 1) * (1 - u) + lattice(seed, i + 1, j + 1) * u
    return top * (1 - v) + low * v


def fractal(seed, x, y, octaves, ridged=False):
    """Sum of octaves in [0, 1]; ridged: sharp crests."""
    total, weight, share = 0.0, 0.0, 1.0
    for k in range(octaves):
        n = noise(seed + k, x * 2 ** k, y * 2 ** k)
        total += share * ((1 - abs(2 * n - 1)) ** 2 if ridged else n)
        weight += share
        share *= 0.5
    return total / weight


def crests(seed, x, y, octaves):
    """Ridges upon ridges, in about [0, 1]: each octave is turned against the one before it, and fine ones are on high ground."""
    total, weight, share = 0.0, 1.0, 0.5
    for k in range(octaves):
        n = (1 - abs(2 * noise(seed + k, x, y) - 1)) ** 2
        total += share * n * weight
        weight, share = min(1, 1.7 * n), share * 0.5
        x, y = 1.6 * x + 1.2 * y, 1.6 * y - 1.2 * x
    return total


def sub(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    n = math.sqrt(sum(x * x for x in a)) or 1.0
    return [x / n for x in a]


def turn(back, up=(0, 1, 0)):
    """The quaternion of what looks along -back."""
    z = unit(back)
    x = unit(cross(up, z))
    y = cross(z, x)
    m = [x, y, z]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0:
        s = 2 * math.sqrt(trace + 1)
        q = [(m[1][2] - m[2][1]) / s, (m[2][0] - m[0][2]) / s, (m[0][1] - m[1][0]) / s, s / 4]
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2 * math.sqrt(1 + m[i][i] - m[j][j] - m[k][k])
        q = [0, 0, 0, (m[j][k] - m[k][j]) / s]
        q[i], q[j], q[k] = s / 4, (m[j][i] + m[i][j]) / s, (m[k][i] + m[i][k]) / s
    return [round(v, 9) for v in q]


class File:
    """A .glb under construction."""

    def __init__(self, polygons=True):
        self.bin = bytearray()
        # Two triangles with one first vertex are a quad, which a shell takes as a bilinear patch.
        self.json = {"asset": {"version": "2.0", "generator": "grounds.py"}, "extensionsUsed": ["FB_ngon_encoding"] * polygons,
                     "scene": 0, "scenes": [{"nodes": []}],
                     "nodes": [], "meshes": [], "materials": [], "accessors": [], "bufferViews": []}

    def push(self, key, value):
        self.json.setdefault(key, []).append(value)
        return len(self.json[key]) - 1

    def array(self, rows, kind, code, target, bounds=False):
        data = b"".join(struct.pack("<%d%s" % (len(r), code), *r) for r in rows)
        view = {"buffer": 0, "byteOffset": len(self.bin), "byteLength": len(data)}
        view = self.push("bufferViews", view | {"target": target} if target else view)
        self.bin += data + b"\0" * (-len(data) % 4)
        said = {"bufferView": view, "componentType": {"f": 5126, "H": 5123, "B": 5121}[code], "count": len(rows), "type": kind}
        if code == "B":
            said["normalized"] = True
        if bounds:
            single = [struct.unpack("<%df" % len(r), struct.pack("<%df" % len(r), *r)) for r in rows]
            said["min"] = [min(c) for c in zip(*single)]
            said["max"] = [max(c) for c in zip(*single)]
        return self.push("accessors", said)

    def show(self, node):
        index = self.push("nodes", node)
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def material(self, name, color):
        return self.push("materials", {"name": name, "doubleSided": True, "pbrMetallicRoughness": {
            "baseColorFactor": [*color, 1], "metallicFactor": 0, "roughnessFactor": 1}})

    def mesh(self, name, parts, colours=None, whole=None):
        """parts: (positions, normals, uvs or None, triangles, material, and height vectors if there are some); colours: of each
        part's vertices, red, green, blue and alpha, linear, from 0 to 255; whole: round normals to this share of 1, which packs better."""
        primitives = []
        shorter = lambda n: [round(v * whole) / whole for v in n] if whole else n
        for part, (positions, normals, uvs, triangles, material, *heights) in enumerate(parts):
            attributes = {"POSITION": self.array(positions, "VEC3", "f", 34962, True),
                          "NORMAL": self.array([shorter(unit(n)) for n in normals], "VEC3", "f", 34962)}
            if uvs:
                attributes["TEXCOORD_0"] = self.array(uvs, "VEC2", "f", 34962)
            if colours:
                attributes["COLOR_0"] = self.array(colours[part], "VEC4", "B", 34962)
            if heights:
                attributes["_VTEX_HEIGHT"] = self.array(heights[0], "VEC3", "f", 34962)
            indices = self.array([[i] for t in triangles for i in t], "SCALAR", "H", 34963)
            primitives.append({"attributes": attributes, "indices": indices, "material": material})
        self.show({"name": name, "mesh": self.push("meshes", {"name": name, "primitives": primitives})})

    def camera(self, name, eye, target, yfov, aspect=16 / 9, path=()):
        """path: (seconds, eye, target) of an animation."""
        index = self.push("cameras", {"type": "perspective", "perspective": {
            "yfov": math.radians(yfov), "znear": 0.01, "aspectRatio": aspect}})
        node = self.show({"name": name, "camera": index, "translation": list(eye), "rotation": turn(sub(eye, target))})
        if path:
            times = self.array([[t] for t, _, _ in path], "SCALAR", "f", None, True)
            eyes = self.array([e for _, e, _ in path], "VEC3", "f", None)
            turns = self.array([turn(sub(e, aim)) for _, e, aim in path], "VEC4", "f", None)
            self.push("animations", {"name": name, "samplers": [{"input": times, "output": o} for o in (eyes, turns)], "channels": [
                {"sampler": k, "target": {"node": node, "path": what}} for k, what in enumerate(("translation", "rotation"))]})

    def sun(self, towards, color=(1, 0.95, 0.88), intensity=3.0):
        self.json["extensionsUsed"].append("KHR_lights_punctual")
        self.json["extensions"] = {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "name": "sun", "color": list(color), "intensity": intensity}]}}
        self.show({"name": "sun", "rotation": turn(towards), "extensions": {"KHR_lights_punctual": {"light": 0}}})

    def save(self, path):
        self.json["buffers"] = [{"byteLength": len(self.bin)}]
        text = json.dumps(self.json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(self.bin), 0x004E4942) + self.bin
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
        print(path.name, 12 + len(body), "bytes")


def grid(columns, rows, size, height, material, keep=lambda x, z: True):
    """columns × rows quads over size metres around the origin, each with a texture tile of its own."""
    width, depth = size
    at = lambda i, j: ((i / columns - 0.5) * width, (j / rows - 0.5) * depth)
    positions, normals, uvs, triangles = [], [], [], []
    ex, ez = width / columns / 4, depth / rows / 4
    for j in range(rows + 1):
        for i in range(columns + 1):
            x, z = at(i, j)
            positions.append([x, height(x, z), z])
            normals.append([height(x - ex, z) - height(x + ex, z), 2 * ex, (height(x, z - ez) - height(x, z + ez)) * ex / ez])
            uvs.append([i, rows - j])
            if i < columns and j < rows and keep(*at(i + 0.5, j + 0.5)):
                k = j * (columns + 1) + i
                triangles += [[k, k + columns + 1, k + columns + 2], [k, k + columns + 2, k + 1]]
    used = sorted({k for t in triangles for k in t})
    new = {k: n for n, k in enumerate(used)}
    pick = lambda rows: [rows[k] for k in used]
    return pick(positions), pick(normals), pick(uvs), [[new[k] for k in t] for t in triangles], material


def lawn(folder):
    """1 406 quads of 10 cm: a knoll, so that its own crest is the horizon."""
    f = File()
    soil = f.material("lawn", [0.035, 0.05, 0.015])
    top = lambda x, z: 0.75 * math.exp(-((x - 0.4) ** 2 + (z + 0.55) ** 2) / 1.6) + 0.12 * math.sin(1.7 * x + 0.6) * math.cos(1.3 * z)
    f.mesh("lawn", [grid(38, 37, (3.8, 3.7), top, soil)])
    f.camera("lawn", [-0.32, 0.48, 1.55], [0.38, 0.6, -0.4], 35)
    f.sun([-0.62, 0.34, -0.55])
    f.save(folder / "lawn.glb")


def orchard(folder):
    """1 024 quads of 9 m, rolling."""
    f = File()
    grass = f.material("grass", [0.13, 0.17, 0.05])
    top = lambda x, z: 9 * fractal(5, x / 120 + 7, z / 120 + 3, 3) + 0.00025 * max(0, -z) ** 2
    f.mesh("ground", [grid(32, 32, (288, 288), top, grass)])
    eye = [4, top(4, 128) + 2.2, 128]
    f.camera("close", eye, [-18, eye[1] + 3.2, 60], 46)
    f.camera("above", [-120, 75, 190], [0, 10, 0], 40)
    f.sun([-0.7, 0.42, 0.1])
    f.save(folder / "trees.glb")


def meadow(folder):
    """A hillside of 48 m for wind to blow over: 1 600 quads."""
    f = File()
    soil = f.material("meadow", [0.09, 0.1, 0.035])
    top = lambda x, z: 2.2 * fractal(71, x / 16 + 1.5, z / 16 + 9.5, 2) + 0.012 * max(0, 8 - z) ** 1.5
    f.mesh("meadow", [grid(40, 40, (48, 48), top, soil)])
    eye = [1.5, top(1.5, 17) + 1.15, 17]
    f.camera("meadow", eye, [-2, eye[1] + 0.35, 0], 40)
    f.sun([-0.8, 0.3, -0.25])
    f.save(folder / "wind.glb")


def sphere(cells, place):
    """The six sides of a cube blown up, each with texture coordinates of its own that count cells."""
    for axis in range(3):
        for sign in (1, -1):
            positions, normals, uvs, triangles = [], [], [], []
            for j in range(cells + 1):
                for i in range(cells + 1):
                    a, b = (math.tan(math.pi / 4 * (2 * k / cells - 1)) for k in (i, j))
                    d = [0.0] * 3
                    d[axis], d[(axis + 1) % 3], d[(axis + 2) % 3] = sign, a, b * sign
                    p, n = place(unit(d))
                    positions.append(p)
                    normals.append(n)
                    uvs.append([i + 40 * axis, j + 20 * sign])
                    if i < cells and j < cells:
                        k = j * (cells + 1) + i
                        triangles += [[k, k + 1, k + cells + 2], [k, k + cells + 2, k + cells + 1]]
            yield positions, normals, uvs, triangles


def ellipsoid(centre, radii, cells, tilt=0.0):
    c, s = math.cos(tilt), math.sin(tilt)
    def place(d):
        p = [d[k] * radii[k] for k in range(3)]
        n = [d[k] / radii[k] for k in range(3)]
        spin = lambda v: [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
        return [a + b for a, b in zip(spin(p), centre)], unit(spin(n))
    return sphere(cells, place)


def teddy(folder):
    """A bear of ellipsoids, 40 cm high: fur, and bare eyes and nose, on a floor."""
    f = File()
    fur, pale = f.material("fur", [0.16, 0.075, 0.025]), f.material("muzzle", [0.3, 0.18, 0.09])
    dark, floor = f.material("eyes", [0.012, 0.01, 0.01]), f.material("floor", [0.42, 0.36, 0.3])
    limbs = [((0, 0.135, 0), (0.105, 0.125, 0.09), 8, 0), ((0, 0.315, 0.01), (0.085, 0.078, 0.075), 6, 0),
             ((-0.075, 0.385, 0), (0.034, 0.034, 0.018), 3, 0.4), ((0.075, 0.385, 0), (0.034, 0.034, 0.018), 3, -0.4),
             ((-0.125, 0.175, 0.035), (0.038, 0.078, 0.038), 4, -0.55), ((0.125, 0.175, 0.035), (0.038, 0.078, 0.038), 4, 0.55),
             ((-0.085, 0.045, 0.105), (0.043, 0.043, 0.09), 4, 0), ((0.085, 0.045, 0.105), (0.043, 0.043, 0.09), 4, 0)]
    parts = [(*side, fur) for limb in limbs for side in ellipsoid(*limb)]
    parts += [(*side, pale) for side in ellipsoid((0, 0.292, 0.075), (0.04, 0.033, 0.03), 3)]
    for centre, radius in [((-0.034, 0.335, 0.082), 0.0105), ((0.034, 0.335, 0.082), 0.0105), ((0, 0.308, 0.113), 0.013)]:
        parts += [(*side, dark) for side in ellipsoid(centre, (radius, 0.8 * radius, radius), 4)]
    joined = {}
    for positions, normals, uvs, triangles, material in parts:
        p, n, t, k, _ = joined.setdefault(material, ([], [], [], [], material))
        first = len(p)
        p += positions
        n += normals
        t += uvs
        k += [[i + first for i in face] for face in triangles]
    # Fur is 15 mm long and lies downward; eyes and nose have none.
    combed = lambda n: [0.015 * v for v in unit([n[0], n[1] - 0.55, n[2]])]
    f.mesh("bear", [(*part, [combed(unit(n)) for n in part[1]]) if part[4] in (fur, pale) else part
                    for part in joined.values()])
    sweep = lambda x, z: 0.55 * max(0, -0.35 - z) ** 2
    f.mesh("floor", [grid(24, 24, (8, 8), sweep, floor)])
    f.camera("bear", [0.5, 0.36, 0.95], [0, 0.195, 0.02], 27, 4 / 3)
    f.sun([-0.6, 0.62, 0.5], (1, 0.9, 0.78), 3.4)
    f.save(folder / "teddy.glb")


def eroded(columns, rows, cell, uplift, steps, seed):
    """Heights in metres of columns × rows points, `cell` metres apart: a land that rises while rivers cut into it (stream power law:
    J. Braun, S. Willett, *A very efficient O(n), implicit and parallel method to solve the stream power equation*, 2013; G. Cordonnier
    et al., *Large Scale Terrain Generation from Tectonic Uplift and Fluvial Erosion*, 2016). uplift(i, j): its rate in [0, 1]; the
    border stays at 0. Square roots and sums alone, so the same everywhere."""
    count = columns * rows
    border = [k for k in range(count) if k % columns in (0, columns - 1) or k // columns in (0, rows - 1)]
    rise = [85 * uplift(k % columns, k // columns) for k in range(count)]
    h = [40 * fractal(seed, k % columns / 5, k // columns / 5, 3) for k in range(count)]
    for k in border:
        rise[k] = h[k] = 0.0
    inside = [k for k in range(count) if columns <= k < count - columns and 0 < k % columns < columns - 1]
    near = [(d, cell * (1 if abs(d) in (1, columns) else math.sqrt(2)))
            for d in (-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1)]
    for step in range(steps):
        lower, far = list(range(count)), [cell] * count
        for k in inside:
            steepest, own = 0.0, h[k]
            for d, length in near:
                slope = (own - h[k + d]) / length
                if slope > steepest:
                    steepest, lower[k], far[k] = slope, k + d, length
        order = sorted(inside, key=lambda k: h[k])
        area = [cell * cell] * count
        for k in reversed(order):
            if lower[k] != k:
                area[lower[k]] += area[k]
        for k in order:
            risen, to = h[k] + rise[k], lower[k]
            if to != k:
                cut = 0.2 * math.sqrt(area[k]) / far[k]
                # Scree: no slope is steeper than 1.15.
                risen = min((risen + cut * h[to]) / (1 + cut), h[to] + 1.15 * far[k])
            h[k] = risen
    return h


ALPS = (232, 96, 30)


def alps():
    """A chain of mountains of 7 by 2.9 km, its middle at the origin, foot at 0: (positions, normals, triangles, colours). Bare rock
    and snow above, woods below."""
    columns, rows, cell = ALPS
    def uplift(i, j):
        u, v = 2 * i / (columns - 1) - 1, 2 * j / (rows - 1) - 1
        massif = 0.35 + 1.5 * fractal(23, 3.6 * u + 4.2, 1.7 * v + 8.4, 2) ** 2
        return massif * max(0, 1 - u ** 8) * min(1, 1.15 * max(0, 1 - abs(v + 0.12 + 0.25 * math.sin(4 * u))) ** 0.8)
    h = eroded(columns, rows, cell, uplift, 90, 9)
    at = lambda i, j: h[min(rows - 1, max(0, j)) * columns + min(columns - 1, max(0, i))]
    positions, normals, colours, triangles = [], [], [], []
    for j in range(rows):
        for i in range(columns):
            k = j * columns + i
            p = [(i - (columns - 1) / 2) * cell, at(i, j), (j - (rows - 1) / 2) * cell]
            n = [at(i - 1, j) - at(i + 1, j), 2 * cell, at(i, j - 1) - at(i, j + 1)]
            steep = 1 - unit(n)[1]
            patchy = fractal(3, p[0] / 170, p[2] / 170, 3) - 0.5
            snow = min(1, max(0, (p[1] - 520 - 1500 * max(0, steep - 0.2) + 520 * patchy) / 60))
            wood = min(1, max(0, (430 - p[1] + 260 * patchy) / 110))
            strata = 0.45 + 0.6 * noise(6, 0.7, p[1] / 55 + 2 * patchy) + 0.7 * noise(8, p[0] / 47, p[2] / 47)
            bare = [(0.07 - 0.058 * wood) * strata, (0.068 - 0.042 * wood) * strata, (0.069 - 0.058 * wood) * strata]
            colours.append([round(255 * (b + snow * (w - b))) for b, w in zip(bare, [0.86, 0.88, 0.92])] + [255])
            positions.append([p[0], round(8 * p[1]) / 8, p[2]])
            normals.append(n)
            if i + 1 < columns and j + 1 < rows:
                triangles += [[k, k + columns, k + columns + 1], [k, k + columns + 1, k + 1]]
    return positions, normals, triangles, colours


def show_alps(f, chain, scale, shift):
    """Place the chain in a file: `scale` times as large, moved by `shift`."""
    positions, normals, triangles, colours = chain
    f.mesh("alps", [(positions, normals, None, triangles, f.material("rock", [1, 1, 1]))], [colours], 256)
    f.json["nodes"][-1].update({"translation": list(shift), "scale": [scale] * 3})


def mountains(folder, chain):
    """1 404 quads of 36 m, forest, on both sides of a valley; bare mountains with snow behind them."""
    f = File()
    forest = f.material("forest", [0.03, 0.035, 0.012])
    def top(x, z):
        valley = math.exp(-((z - 270 + 130 * math.sin(x / 330 + 0.8)) / 240) ** 2)
        return (70 + 520 * crests(13, x / 1100 + 0.35, z / 1100 + 5.2, 5) + 0.2 * max(0, 100 - z)) * (1 - 0.72 * valley)
    f.mesh("forest", [grid(39, 36, (1404, 1296), top, forest)])
    show_alps(f, chain, 1.25, [-200, -80, -3200])
    eye = [120, top(120, 610) + 55, 610]
    f.camera("ridge", eye, [-60, eye[1] - 14, -200], 36)
    f.sun([-0.8, 0.34, 0.05])
    f.save(folder / "mountains.glb")


def valley(folder, chain):
    """A valley of meadows between wooded slopes, 1.1 km long, and the mountains that close it."""
    f = File(polygons=False)
    forest, meadow = f.material("forest", [0.045, 0.05, 0.02]), f.material("meadow", [0.07, 0.09, 0.025])
    centre = lambda z: 26 * math.sin(z / 95 + 0.9) + 22 * math.sin(z / 260 + 2.2)
    def top(x, z):
        across = x - centre(z)
        side = max(0, abs(across) - 14)
        slope = 0.0048 * side * side / (1 + side / 90) * (0.75 + 0.5 * fractal(61, x / 140 + 9, z / 140 + 3, 3))
        return slope + 0.02 * max(0, -z) + 3.2 * (fractal(67, x / 45 + 2, z / 45 + 8, 2) - 0.5)
    def open(x, z):
        edge = 10 * (noise(69, x / 21, z / 21) - 0.5)
        glade = fractal(73, x / 110 + 5.7, z / 110 + 4.4, 3)
        return abs(x - centre(z)) < 17 + edge or glade > 0.66
    size = (640, 1120)
    shifted = lambda part: ([[x, y, z - 440] for x, y, z in part[0]], *part[1:])
    height = lambda x, z: top(x, z - 440)
    f.mesh("valley", [shifted(grid(80, 140, size, height, forest, lambda x, z: not open(x, z - 440))),
                      shifted(grid(80, 140, size, height, meadow, lambda x, z: open(x, z - 440)))])
    show_alps(f, chain, 1, [150, -50, -2650])
    x = centre(84) + 7
    eye = [x, top(x, 84) + 1.9, 84]
    f.camera("near", eye, [centre(-60) + 2, eye[1] + 12, -60], 48)
    eye = [centre(112) + 30, 62, 112]
    f.camera("far", eye, [centre(-300) + 8, 66, -300], 42)
    f.sun([-0.8, 0.34, 0.05], (1, 0.93, 0.82), 3.4)
    f.save(folder / "valley.glb")


def picture(path, size, share):
    """Write a grey .png: share(u, v) in [0, 1], the top row first."""
    rows = b"".join(b"\0" + bytes(round(255 * min(1, max(0, share((i + 0.5) / size, (j + 0.5) / size)))) for i in range(size)) for j in range(size))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 0, 0, 0, 0))
                     + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))
    print(path.name, path.stat().st_size, "bytes")


def wedge(rows, columns, angle, height, material):
    """Quads in rings around the origin, towards -z: near ones small, far ones large. rows: the rings' radii."""
    positions, normals, triangles = [], [], []
    for j, r in enumerate(rows):
        for i in range(columns + 1):
            a = math.radians(angle) * (2 * i / columns - 1)
            x, z, e = r * math.sin(a), -r * math.cos(a), max(0.5, 0.012 * r)
            positions.append([x, height(x, z), z])
            normals.append([height(x - e, z) - height(x + e, z), 2 * e, height(x, z - e) - height(x, z + e)])
            if i < columns and j + 1 < len(rows):
                k = j * (columns + 1) + i
                triangles += [[k, k + 1, k + columns + 2], [k, k + columns + 2, k + columns + 1]]
    return positions, normals, None, triangles, material


def million(folder, chain):
    """What is seen from a hill, up to 7 km: for 1 000 000 trees, and where they stand."""
    # As triangles: small and nearly flat, they look the same, and take a quarter of the time.
    f = File(polygons=False)
    land = f.material("land", [0.07, 0.08, 0.03])
    def top(x, z):
        r = math.hypot(x, z)
        hills = 2 * fractal(41, x / 1100 + 3.3, z / 1100 + 6.1, 5) - 1
        ridges = crests(47, x / 3000 + 1.2, z / 3000 + 2.9, 5)
        near = 1 - math.exp(-(r / 160) ** 2)
        return 125 * math.exp(-(r / 180) ** 2) + (24 + 0.02 * r) * hills * near + 0.09 * max(0, r - 1500) * ridges + 0.8 * noise(7, x / 9, z / 9)
    rows = [2.5]
    while rows[-1] < 7000:
        rows.append(rows[-1] + max(1.3, 0.045 * rows[-1]))
    angle = 34
    f.mesh("land", [wedge(rows, 48, angle, top, land)])
    eye = [0, top(0, 0) + 5, 0]
    f.camera("view", eye, [3, eye[1] - 8.5, -100], 34)
    # An oak and two birches on the hill, at the picture's sides.
    (folder / "million.csv").write_text("texel,x,y,scale,turn\noak,-21,42,1,70\nbirch,16.5,33,0.8,0\nbirch,20.5,39,1,140\n")
    show_alps(f, chain, 1.75, [-500, -60, -9300])
    # From 2 km to the leaf of a tree that stands on a corner of the ground.
    r = next(r for r in rows if r > 1900)
    leaf = [0.871, top(0, -r) + 6.736, 3.532 - r]
    def fly(t):
        d, side, up = 2000 * (0.42 / 2000) ** (t * t * (3 - 2 * t)), math.radians(-7 * (1 - t) ** 2 + 16 * t ** 6), math.radians(21 + 5 * t)
        return [leaf[0] + d * math.cos(up) * math.sin(side), leaf[1] + d * math.sin(up), leaf[2] + d * math.cos(up) * math.cos(side)]
    f.camera("zoom", fly(0), leaf, 34, path=[(k / 8, fly(k / 29), leaf) for k in range(30)])
    (folder / "zoom.csv").write_text("x,y,scale,turn\n0,%r,1,0\n" % r)
    f.sun([-0.8, 0.33, -0.25])
    f.save(folder / "million.glb")
    # Woods with clearings; none on the hill.
    width = 2 * rows[-1] * math.sin(math.radians(angle))
    def share(u, v):
        x, z = width * (u - 0.5), -rows[-1] * (1 - v)
        open = fractal(53, x / 420 + 5.5, z / 420 + 1.5, 4)
        return min(1, max(0, (0.62 - open) / 0.07)) * (math.hypot(x, z) > 190) * (math.hypot(x, z + r) > 60)
    picture(folder / "million.png", 256, share)


def lathe(columns, rows, place, turn=1.0, inward=False, seam=0.5):
    """A surface of revolution about y: place(t) is (radius, height) for t in [0, 1]. A share of a turn, open towards +z at `seam` = 0.5, with texture
    coordinates in metres where the radius is place(0)'s."""
    positions, normals, uvs, triangles = [], [], [], []
    length = 0.0
    for j in range(rows + 1):
        (r, y), (ra, ya), (rb, yb) = place(j / rows), place(j / rows - 1e-4), place(j / rows + 1e-4)
        if j:
            before = place((j - 1) / rows)
            length += math.hypot(r - before[0], y - before[1])
        for i in range(columns + 1):
            a = math.pi * (seam + turn * (1 - 2 * i / columns))
            c, s = math.cos(a), -math.sin(a)
            positions.append([r * c, y, r * s])
            out = [(yb - ya) * c, ra - rb, (yb - ya) * s]
            normals.append([-v for v in out] if inward else out)
            uvs.append([2 * math.pi * turn * place(0)[0] * i / columns, length])
            if i < columns and j < rows:
                k = j * (columns + 1) + i
                quad = [k, k + 1, k + columns + 2, k + columns + 1]
                a, b, c, d = quad if inward else quad[::-1]
                triangles += [[a, b, c], [a, c, d]]
    return positions, normals, uvs, triangles


def crypt(folder):
    """A round wall and half a dome, for heads, and an urn before it, for a hypertexture."""
    f = File()
    wall, urn = f.material("wall", [0.05, 0.04, 0.03]), f.material("urn", [0.2, 0.16, 0.12])
    floor = f.material("floor", [0.16, 0.13, 0.11])
    niche = lambda t: (2, 2.2 * t) if t < 0.55 else (2 * math.cos((t - 0.55) * 3.2), 1.21 + 2 * math.sin((t - 0.55) * 3.2))
    f.mesh("wall", [(*lathe(26, 16, niche, 0.5, True), wall)])
    knots = [(0, 0.14), (0.07, 0.12), (0.52, 0.27), (0.82, 0.105), (0.91, 0.105), (1, 0.135)]
    def shape(t):
        k = max(0, next((k for k, (at, _) in enumerate(knots) if at >= t), len(knots) - 1) - 1)
        (t0, r0), (t1, r1) = knots[k:k + 2]
        return r0 + (r1 - r0) * (0.5 - 0.5 * math.cos(math.pi * min(1, max(0, (t - t0) / (t1 - t0))))), 1.05 * t
    f.mesh("urn", [(*lathe(32, 32, shape, seam=-0.5), urn)])
    f.mesh("floor", [grid(12, 12, (12, 12), lambda x, z: 0, floor)])
    f.camera("crypt", [0.45, 0.95, 2.9], [0.05, 0.78, -0.5], 36, 4 / 3)
    f.sun([-0.5, 0.5, 1.1], (1, 0.84, 0.66), 3.4)
    f.save(folder / "crypt.glb")


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for make in (lawn, orchard, meadow, teddy, crypt):
        make(folder)
    chain = alps()
    for make in (mountains, valley, million):
        make(folder, chain)
