#!/usr/bin/env python3
"""Makes the conformance vectors beside it from the text of vtex-1.md; needs Python 3.9 and zstandard.

    make.py [FOLDER]

It is a writer of its own, and shares no code with any reader. `ok-NAME.vtex` comes with `ok-NAME.txt`, what it holds
(section 11 of the text), and `bad-CODE-N.vtex` breaks the rule CODE and no rule that is checked before. The content is the
same whichever version of zstd compresses it.
"""
import hashlib, json, math, random, struct, sys, zlib
from pathlib import Path

import zstandard

MAGIC = bytes.fromhex("AB56544558203 1BB0D0A1A0A".replace(" ", ""))
# Components and their largest codes, by semantic and Q.
MOST = {
    "RATE": lambda q: [q], "NDFD": lambda q: [2, q, q], "NDFC": lambda q: [q] * 3, "CORR": lambda q: [q],
    "SUPP": lambda q: [q] * 3, "SIDE": lambda q: [q], "MEAN": lambda q: [q] * 2, "ALBD": lambda q: [q] * 3,
    "MATL": lambda q: [63] * q if q < 4 else [q] * 4 + [63] * 3,
}
FULL = dict(RATE=128, NDFD=47, NDFC=22, CORR=15, SUPP=63, SIDE=15, MEAN=255, ALBD=63)
LEAN = dict(RATE=64, NDFD=19, NDFC=10, CORR=15, SUPP=15, SIDE=7, MEAN=31, ALBD=31)


def align8(n):
    return (n + 7) // 8 * 8


def morton(p):
    return sum((p[a] >> i & 1) << (3 * i + a) for i in range(17) for a in range(3))


class Texel:
    """What a file is to hold: `voxels[d]` maps (x, y, z) to the codes of each stream; parents must be there."""

    def __init__(self, streams, voxels, **rest):
        self.streams, self.voxels = streams, voxels
        self.constant, self.cyclic, self.up, self.bounds, self.metres = {}, 0, 1, (-1, 0, -1, 1, 2, 1), 1.0
        self.page, self.topo, self.codec, self.filter, self.minor, self.compat = 12, 14, 1, 2, 0, 0
        self.meta = {"content": {"max": [1, 1, 1], "min": [0, 0, 0]}, "facet_size": 0.25, "model": "coverage"}
        self.tail, self.extra = [], []
        for key, value in rest.items():
            assert hasattr(self, key), key
            setattr(self, key, value)

    def order(self, d):
        return sorted(self.voxels[d], key=morton)

    def mask(self, d, p):
        children = self.voxels[d + 1] if d + 1 < len(self.voxels) else {}
        cells = ((x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1))
        return sum(1 << i for i, c in enumerate(cells) if tuple(2 * a + b for a, b in zip(p, c)) in children)


def pack(texel, codes, most, filter_):
    """A page by one of the filters of section 5.2."""
    k = len(most)
    if filter_ == 0:
        return bytes(c for row in codes for c in row)
    out = bytearray()
    for i in range(k):
        before, m = 0, most[i] + 1
        for row in codes:
            d = (row[i] - before) % m
            out.append(row[i] if filter_ == 1 else 2 * d if 2 * d < m else 2 * (m - d) - 1)
            before = row[i]
    return bytes(out)


def section(texel, pages, children=None):
    """Index and pages; `children`: the first child of each page of topology."""
    entry = 16 if children is None else 24
    index, body, at = b"", b"", entry * len(pages)
    for i, raw in enumerate(pages):
        stored = raw
        if texel.codec == 1:
            frame = zstandard.ZstdCompressor(level=9, write_content_size=True).compress(raw)
            stored = frame if len(frame) < len(raw) else raw
        index += struct.pack("<QII", at, len(stored), zlib.crc32(stored))
        index += b"" if children is None else struct.pack("<Q", children[i])
        body, at = body + stored, at + len(stored)
    return index, body


def split(items, log2):
    return [items[i:i + (1 << log2)] for i in range(0, len(items), 1 << log2)]


class File:
    """The parts of a file; `bytes()` joins them and sets lengths, checksums and the content id unless told not to."""

    def __init__(self, texel):
        self.minor, self.compat, self.incompat, self.major, self.magic = texel.minor, texel.compat, 0, 1, MAGIC
        self.texel = texel
        self.meta = json.dumps(texel.meta, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
        self.streams = [[n.encode(), len(MOST[n](q)), 1, q, 4 if n in texel.constant else 0, 0, 0.0,
                         bytes(texel.constant.get(n, ())).ljust(8, b"\0"), bytes(8)] for n, q in texel.streams.items()]
        self.streams += [list(s) for s in texel.extra]
        self.sections = [[b"META", 2, 255, 255, b"", self.meta, len(self.meta), 0, 0, 0, bytes(6)]]
        self.depths = []
        for d in range(len(texel.voxels)):
            order, digest = texel.order(d), hashlib.sha256()
            if d:
                masks = bytes(texel.mask(d - 1, p) for p in texel.order(d - 1))
                digest.update(masks)
                pages = split(masks, texel.topo)
                first = [sum(bin(m).count("1") for m in masks[:i << texel.topo]) for i in range(len(pages))]
                self.add(b"TOPO", d, 255, *section(texel, pages, first), len(masks), len(pages), 0)
            for s, (name, q) in enumerate(texel.streams.items()):
                if name in texel.constant:
                    continue
                codes = [texel.voxels[d][p][name] for p in order]
                digest.update(bytes(c for row in codes for c in row))
                self.page(d, s, codes, MOST[name](q))
            for s, extra in enumerate(texel.extra, len(texel.streams)):
                codes = [[7] * extra[1] for _ in order]
                digest.update(bytes(c for row in codes for c in row))
                self.page(d, s, codes, [extra[3]] * extra[1])
            internal = sum(texel.mask(d, p) != 0 for p in order)
            self.depths.append([len(order), internal, digest.digest()])
        self.sections += [list(s) for s in texel.tail]
        self.set = {}

    def page(self, d, s, codes, most):
        pages = [pack(self.texel, rows, most, self.texel.filter) for rows in split(codes, self.texel.page)]
        self.add(b"PAGE", d, s, *section(self.texel, pages), len(codes) * len(most), len(pages), self.texel.filter)

    def add(self, kind, depth, stream, index, body, decoded, pages, filter_):
        codec = 1 if self.texel.codec == 1 else 0
        self.sections.append([kind, 0, depth, stream, index, body, decoded, pages, codec, filter_, bytes(6)])

    def bytes(self, change=lambda name, value: value):
        """The file; `change(name, value)` may replace a field before the checksums that cover it are made."""
        t, put = self.texel, lambda name, value: change(name, value)
        head = align8(128 + 64 * len(self.depths) + 32 * len(self.streams) + 48 * len(self.sections) + len(self.meta))
        at, body, table = head, b"", b""
        spans = {d: [head, head] for d in range(len(self.depths))}
        for i, (kind, flags, depth, stream, index, raw, decoded, pages, codec, filter_, spare) in enumerate(self.sections):
            whole = index + raw
            offset = head - align8(len(raw)) if kind == b"META" else align8(at)
            if kind == b"META":
                offset = 128 + 64 * len(self.depths) + 32 * len(self.streams) + 48 * len(self.sections)
            crc = zlib.crc32(index if kind in (b"TOPO", b"PAGE") else whole)
            values = [kind, flags, depth, stream, offset, len(whole), decoded, pages, crc, codec, filter_, spare]
            table += struct.pack("<4sHBBQQQIIBB6s", *[put(("section", i, k), v) for k, v in enumerate(values)])
            if kind != b"META":
                body += bytes(offset - at) + whole
                at = offset + len(whole)
            if depth in spans:
                spans[depth][1] = at
        start, depths, identity = head, b"", b""
        for d, (n, internal, digest) in enumerate(self.depths):
            end = max(start, spans[d][1])
            values = [put(("depth", d, k), v) for k, v in enumerate([n, internal, start, end, digest])]
            depths += struct.pack("<QQQQ32s", *values)
            identity += struct.pack("<Q", values[0]) + values[4]
            start = align8(end)
        streams = b"".join(struct.pack("<4sBBHHHf8s8s", *[put(("stream", s, k), v) for k, v in enumerate(row)])
                           for s, row in enumerate(self.streams))
        names = "depths streams page topo cyclic up sections".split()
        counts = [len(self.depths), len(self.streams), t.page, t.topo, t.cyclic, t.up, len(self.sections)]
        counts = [put(n, v) for n, v in zip(names, counts)]
        place = struct.pack("<7d", *put("bounds", t.bounds), put("metres", t.metres))
        content = bytes([counts[0], counts[4], counts[5]]) + place + streams + identity
        out = put("magic", MAGIC) + struct.pack("<HHIIQII", put("major", 1), self.minor, put("head", head), 0,
                                               put("length", at), put("incompat", 0), self.compat)
        out += struct.pack("<6BH", *counts) + place + struct.pack("<Q", put("nodes", sum(d[0] for d in self.depths)))
        out += put("content-id", hashlib.sha256(content).digest()[:16])
        out += depths + streams + table + self.meta
        out = bytearray(out.ljust(head, b"\0"))
        out = put("padding", out)
        struct.pack_into("<I", out, 20, put("head-crc", zlib.crc32(out)))
        return bytes(out) + put("body", body)


# What a voxel's codes mean: section 4.1, as integers.

def half_up(x):
    return math.floor(x + 0.5)


def decode(codes, qs):
    """rate, √S_ii, correlations, c, low and high side of the support, one-sidedness, mean normal, albedo."""
    wide = lambda q, most: half_up(255 * q / most)
    q = codes["RATE"][0]
    if q == 0:
        return dict(rate=0, root=[255] * 3, corr=[0] * 3, block=0, low=[0] * 3, high=[0] * 3, side=0, mean=[0, 0], albedo=[255] * 3)
    out = dict(rate=1 + half_up(254 * (q - 1) / (qs["RATE"] - 1)), root=[255] * 3, corr=[0] * 3, block=0,
               low=[0] * 3, high=[0] * 3, side=0, mean=[0, 0], albedo=[255] * 3)
    if "NDFD" in codes:
        k, a, b = codes["NDFD"]
        out["root"][(k + 1) % 3], out["root"][(k + 2) % 3] = wide(a, qs["NDFD"]), wide(b, qs["NDFD"])
    if "NDFC" in codes:
        h = qs["NDFC"] // 2
        for pair, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            c = codes["NDFC"][pair] - h
            if out["root"][i] and out["root"][j]:
                out["corr"][pair] = int(math.copysign(half_up(127 * abs(c) / h), c)) if c else 0
    for name, semantic in (("block", "CORR"), ("side", "SIDE")):
        if semantic in codes:
            out[name] = half_up(15 * codes[semantic][0] / qs[semantic])
    if "SUPP" in codes:
        s = math.isqrt(qs["SUPP"] + 1)
        for a in range(3):
            low, high = 16 // s * (codes["SUPP"][a] % s), 16 // s * (codes["SUPP"][a] // s)
            out["low"][a], out["high"][a] = low, min(high, 15 - low)
    if "MEAN" in codes and out["side"]:
        out["mean"] = [wide(c, qs["MEAN"]) for c in codes["MEAN"]]
    if "ALBD" in codes:
        out["albedo"] = [wide(c, qs["ALBD"]) for c in codes["ALBD"]]
    return out


def shares(codes, q, materials, albedo):
    """Shares of the materials, of 63: section 4.2."""
    out = [0] * (q + 1)
    if q < 4:
        out = [63 - sum(codes)] + list(codes)
    else:
        for material, share in zip(codes[:4], [63 - sum(codes[4:])] + list(codes[4:])):
            out[material] += share
    far = [sum((half_up(255 * math.sqrt(m)) - a) ** 2 for m, a in zip(row["albedo"], albedo)) for row in materials]
    likely = far.index(min(far))
    out[0], out[likely] = out[likely], out[0]
    return out


# What a ray loses: section 10.

def positive(a, b, c):
    """Correlations of a matrix that is positive."""
    if 1 + 2 * a * b * c - a * a - b * b - c * c < 0:
        low, high = 0.0, 1.0
        for _ in range(200):
            f = (low + high) / 2
            inside = 1 + 2 * a * b * c * f ** 3 - (a * a + b * b + c * c) * f * f >= 0
            low, high = (f, high) if inside else (low, f)
        a, b, c = a * low, b * low, c * low
    return a, b, c


def sigma(v, w):
    a, b, c = positive(*(m / 127 for m in v["corr"]))
    x, y, z = (r / 255 * u for r, u in zip(v["root"], w))
    return math.sqrt(max(0.0, x * x + y * y + z * z + 2 * (a * x * y + b * x * z + c * y * z)))


def mean_sigma(v, points=4000):
    """The mean of σ over all directions, by points of a spiral."""
    total = 0.0
    for i in range(points):
        z, turn = 1 - (2 * i + 1) / points, i * math.pi * (3 - math.sqrt(5))
        r = math.sqrt(1 - z * z)
        total += sigma(v, (r * math.cos(turn), r * math.sin(turn), z))
    return total / points


def faced(v, w):
    """The share of a voxel's facets that an eye sees along w: section 6.1."""
    if v["one_sided"] == 0 or (v["rate"] == 255 and v["side"] == 0):
        return 1.0
    across = sum(n * d for n, d in zip(octahedral(v["mean"]), w))
    fronts = -2 * mean_sigma(v) * v["side"] / 15 * across / sigma(v, w)
    return 1 - v["one_sided"] * (1 - (0.5 + 0.5 * min(1.0, max(-1.0, fronts))))


def slab(origin, direction, low, high):
    near, far = -math.inf, math.inf
    for o, d, a, b in zip(origin, direction, low, high):
        if d == 0:
            if not a <= o < b:
                return None
            continue
        s, e = sorted(((a - o) / d, (b - o) / d))
        near, far = max(near, s), min(far, e)
    return (near, far) if near < far else None


def transmittance(texel, values, origin, direction, depth, eye=False):
    """Of the straight line through the whole cube, by voxels of `depth` and terminal nodes above it; of a light's ray, or an eye's."""
    size = math.sqrt(sum(d * d for d in direction))
    w = [d / size for d in direction]
    pieces = []
    for d in range(depth + 1):
        for p, v in values[d].items():
            if (d < depth and texel.mask(d, p)) or v["rate"] == 0:
                continue
            edge = 2.0 ** -d
            low, high = [c * edge for c in p], [(c + 1) * edge for c in p]
            if d == depth:
                low = [a + edge * s / 16 for a, s in zip(low, v["low"])]
                high = [a - edge * s / 16 for a, s in zip(high, v["high"])]
            span = slab(origin, w, low, high)
            if span is None or span[1] <= 0:
                continue
            block = ("node", d, p) if d <= depth - 2 else tuple((c << (depth - d)) >> 2 for c in p)
            area = 1.0 if texel.meta["model"] == "neyret" else sigma(v, w)
            area *= faced(v, w) if eye else 1.0
            tau = 2 ** ((v["rate"] - 144) / 16) * area * (span[1] - span[0]) / edge
            pieces.append((span[0], block, tau, v["block"] / 15))
    total, inside, current = 1.0, 1.0, None
    for _, block, tau, c in sorted(pieces, key=lambda p: p[0]):
        if block != current:
            total, inside, current = total * inside, 1.0, block
        k = (1 - c) * tau
        phi = 1.0 if k == 0 else -math.expm1(-k) / k
        inside = max(0.0, inside * math.exp(-k) - c * tau * phi)
    return total * inside


def factor(v):
    """A with S = A transposed A, and the correlations made positive."""
    a, b, c = positive(*(m / 127 for m in v["corr"]))
    root = [r / 255 for r in v["root"]]
    s = [[root[i] * root[j] * r for j, r in enumerate(row)] for i, row in enumerate(((1, a, b), (a, 1, c), (b, c, 1)))]
    out = [[0.0] * 3 for _ in range(3)]
    for i in range(3):
        for j in range(i + 1):
            rest = s[i][j] - sum(out[i][k] * out[j][k] for k in range(j))
            if i == j:
                out[i][i] = math.sqrt(max(rest, 0.0))
            elif out[j][j] > 1e-7:
                out[i][j] = rest / out[j][j]
    return out


def times(matrix, vector):
    return [sum(m * x for m, x in zip(row, vector)) for row in matrix]


def unit(vector):
    size = math.sqrt(sum(x * x for x in vector))
    return [x / size for x in vector]


def cofactors(j):
    pairs = ((1, 2), (2, 0), (0, 1))
    return [[j[a][c] * j[b][d] - j[a][d] * j[b][c] for c, d in pairs] for a, b in pairs]


def octahedral(codes):
    x, y = (c / 127.5 - 1 for c in codes)
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = x - math.copysign(-z, x), y - math.copysign(-z, y)
    return unit((x, y, z))


def seen(v, jacobian, view, light):
    """Of what is seen along `view`: E[max(0, m.l)] and E[max(0, -m.l)], by R6 and R8. Facets are those of an ellipsoid, which is seen
    as a disk: equal areas of the disk are equal shares of what is seen."""
    cof = cofactors(jacobian)
    half = factor(v)
    half = [[sum(cof[i][k] * half[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    axis = unit(times([list(c) for c in zip(*half)], view))
    side = unit(min(([axis[1], -axis[0], 0.0], [0.0, axis[2], -axis[1]]), key=lambda s: -sum(x * x for x in s)))
    up = [axis[(k + 1) % 3] * side[(k + 2) % 3] - axis[(k + 2) % 3] * side[(k + 1) % 3] for k in range(3)]
    mean = unit(times(cof, octahedral(v["mean"])))
    normals, n = [], 80
    for i in range(n):
        r = math.sqrt((i + 0.5) / n)
        h = math.sqrt(1 - r * r)
        for j in range(2 * n):
            x, y = r * math.cos(math.pi * (j + 0.5) / n), r * math.sin(math.pi * (j + 0.5) / n)
            normals.append(unit(times(half, [h * a + x * s + y * u for a, s, u in zip(axis, side, up)])))
    dot = lambda a, b: sum(p * q for p, q in zip(a, b))
    share = v["side"] / 15
    weights = [1.0] * len(normals)
    if share > 0:
        k = share / max(0.05, sum(dot(m, mean) ** 2 for m in normals) / len(normals))
        weights = [max(0.0, 1 + k * dot(m, mean)) for m in normals]
        if sum(weights) < 1e-3 * len(normals) / 8:
            weights = [1.0] * len(normals)
    result = []
    for sign in (1, -1):
        mean_of = sum(w * max(0.0, sign * dot(m, light)) for w, m in zip(weights, normals)) / sum(weights)
        result.append(mean_of + share ** 4 * (max(0.0, sign * dot(mean, light)) - mean_of))
    return result


def shading(dice):
    """The text of shading-1.txt: section 11.1."""
    lines = []
    plain = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    for n in range(48):
        root = [255, *(dice.randrange(90, 256) for _ in range(2))]
        k = dice.randrange(3)
        v = dict(root=root[-k:] + root[:-k], corr=[dice.randrange(-70, 71) for _ in range(3)], side=0, mean=[128, 128])
        if n % 3 == 1:
            v.update(side=dice.randrange(1, 16), mean=[dice.randrange(256) for _ in range(2)])
        if n % 8 == 7:
            # A sheet: one normal.
            v.update(root=[0, 0, 255], corr=[0, 0, 0], side=dice.choice((0, 15)), mean=[128, 128])
        jacobian = plain
        if n % 4 == 2:
            jacobian = [[round(plain[i][j] + dice.uniform(-0.6, 0.6), 3) for j in range(3)] for i in range(3)]
        view, light = ([round(x, 4) for x in unit([dice.gauss(0, 1) for _ in range(3)])] for _ in range(2))
        front, back = seen(v, jacobian, unit(view), unit(light))
        numbers = [*v["root"], *v["corr"], v["side"], *v["mean"], *(x for row in jacobian for x in row), *view, *light]
        lines.append(f"seen {' '.join(map(str, numbers))} → {front:.4f} {back:.4f}")
    for _ in range(12):
        b, s, f = (round(dice.uniform(0.25, 4), 3) for _ in range(3))
        x = round(dice.uniform(-1, 1), 3)
        lines.append(f"lamp {b} {s} {f} {x} → {s + (f - s) * x if x > 0 else s + (b - s) * -x:.6f}")
    return "\n".join(lines) + "\n"


def text(texel, rays=()):
    names = list(texel.streams)
    values = []
    lines = [f"depths {len(texel.voxels)} up {texel.up} cyclic {texel.cyclic} model {texel.meta['model']}"]
    surfaces = texel.meta.get("surfaces", [])
    for i, s in enumerate(surfaces):
        numbers = [*s.get("transmission", [0, 0, 0]), s.get("unlit", 0), s.get("oneSided", 0)]
        lines.append(" ".join(map(str, ["surface", i, *(half_up(1e4 * x) for x in numbers)])))
    for d in range(len(texel.voxels)):
        lines.append(f"depth {d} voxels {len(texel.voxels[d])}")
        values.append({})
        for p in texel.order(d):
            codes = {n: texel.constant.get(n) or texel.voxels[d][p][n] for n in names}
            v = values[d][p] = decode(codes, texel.streams)
            row = [*p, v["rate"], *v["root"], *v["corr"], v["block"], *v["low"], *v["high"], v["side"], *v["mean"], *v["albedo"]]
            if "MATL" in codes:
                mix = shares(codes["MATL"], texel.streams["MATL"], texel.meta["materials"], v["albedo"])
                v["one_sided"] = sum(m / 63 * s.get("oneSided", 0) for m, s in zip(mix, surfaces))
                row += mix
            end = " t" if d + 1 < len(texel.voxels) and not texel.mask(d, p) else ""
            lines.append(" ".join(map(str, row)) + end)
    for origin, direction in rays:
        for d in range(len(texel.voxels)):
            t = transmittance(texel, values, origin, direction, d)
            lines.append(" ".join(["ray", *map(repr, origin), *map(repr, direction), str(d), f"{t:.7f}"]))
            if surfaces:
                t = transmittance(texel, values, origin, direction, d, eye=True)
                lines.append(" ".join(["eye", *map(repr, origin), *map(repr, direction), str(d), f"{t:.7f}"]))
    return "\n".join(lines) + "\n"


def grown(dice, streams, depths, fill, **rest):
    """Random matter: a node has children with the probability `fill` each; codes by chance."""
    voxels = [{(0, 0, 0): None}]
    for _ in range(1, depths):
        below = {}
        for x, y, z in voxels[-1]:
            if len(voxels) > 1 and dice.random() < 0.15:
                continue
            for i in range(8):
                if dice.random() < fill:
                    below[2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)] = None
        voxels.append(below)
    for depth in voxels:
        for p in depth:
            depth[p] = {n: random_codes(dice, n, q) for n, q in streams.items()}
    return Texel(streams, voxels, **rest)


def random_codes(dice, name, q):
    most = MOST[name](q)
    if name == "MATL":
        room, parts = 63, []
        for _ in range(q if q < 4 else 3):
            parts.append(dice.randrange(room + 1) if dice.random() < 0.7 else 0)
            room -= parts[-1]
        return parts if q < 4 else [dice.randrange(q + 1) for _ in range(4)] + parts
    if name == "RATE":
        return [dice.randrange(q // 3, q + 1) if dice.random() < 0.95 else 0]
    return [dice.randrange(m + 1) for m in most]


def colours(dice, n):
    names = ["bark", "leaf", "flower", "fruit", "moss", "snow, new"][:n]
    return [{"albedo": [round(dice.random(), 3) for _ in range(3)], "name": m, "share": round(1 / n, 3)} for m in names]


def good(dice):
    """Names, texels and rays of the files that keep every rule."""
    one = {n: [q // 2] * len(MOST[n](q)) for n, q in FULL.items()}
    one["NDFD"] = [1, 30, 20]
    rays = [((-0.1, 0.21, 0.33), (1.0, 0.31, 0.22)), ((0.4, 1.2, 0.45), (0.13, -1.0, 0.07)), ((0.3, 0.6, -0.5), (0.0, 0.0, 1.0)),
            ((1.1, 1.1, 1.05), (-1.0, -0.93, -0.97)), ((0.52, 0.47, 1.4), (-0.02, 0.05, -1.0))]
    yield "empty", Texel({"RATE": 128}, [{}], meta={"content": {"max": [0, 0, 0], "min": [0, 0, 0]}, "facet_size": 0, "model": "coverage"}), ()
    yield "one-voxel", Texel(FULL, [{(0, 0, 0): one}]), rays
    solid = {"RATE": [128]}
    cube = [{(0, 0, 0): solid}, {(x, y, 0): solid for x in (0, 1) for y in (0, 1)}, {}]
    yield "terminal-cube", Texel({"RATE": 128}, cube), rays
    for codec in (0, 1):
        for filter_ in (0, 1, 2):
            yield f"filter-{filter_}-codec-{codec}", grown(dice, FULL, 4, 0.45, codec=codec, filter=filter_), rays
    yield "lean", grown(dice, LEAN, 4, 0.45), rays
    deep = [{(0, 0, 0): {"RATE": [60]}}]
    for d in range(1, 5):
        side = 1 << d
        keep = (lambda x, y, z: True) if d < 4 else (lambda x, y, z: morton((x, y, z)) < 1025)
        cells = ((x, y, z) for x in range(side) for y in range(side) for z in range(side))
        deep.append({p: {"RATE": [1 + morton(p) % 128]} for p in cells if keep(*p)})
    yield "two-pages", Texel({"RATE": 128}, deep, page=10, topo=10), ()
    three = colours(dice, 3)
    yield "materials-3", grown(dice, dict(FULL, MATL=2), 3, 0.5, meta=dict(Texel({}, []).meta, materials=three)), ()
    six = colours(dice, 6)
    yield "materials-6", grown(dice, dict(FULL, MATL=5), 3, 0.5, meta=dict(Texel({}, []).meta, materials=six)), ()
    yield "cyclic", grown(dice, {"RATE": 128, "ALBD": 255}, 3, 0.6, cyclic=5, up=2, metres=0.01, bounds=(0, 0, 0, 3.5, 3.5, 7)), rays
    yield "constant", grown(dice, FULL, 3, 0.5, constant={"CORR": [9], "ALBD": [10, 40, 5], "SIDE": [0], "MEAN": [128, 128]}), rays
    yield "neyret", grown(dice, FULL, 3, 0.5, meta=dict(Texel({}, []).meta, model="neyret")), rays
    twisted = grown(dice, FULL, 3, 0.6)
    for depth in twisted.voxels:
        for p in depth:
            depth[p]["NDFC"] = [dice.choice((0, 1, 21, 22)) for _ in range(3)]
    yield "not-positive", twisted, rays
    news = [b"NEWS", 2, 1, 9, 0, 0, 0.5, bytes(8), bytes(8)]
    tail = [b"MORE", 2, 255, 255, b"", b"anything at all", 15, 0, 0, 0, bytes(6)]
    yield "newer", grown(dice, {"RATE": 128}, 3, 0.5, extra=[news], tail=[tail], minor=3, compat=5, topo=10), rays
    for q in (3, 255):
        yield f"supp-{q}", grown(dice, {"RATE": 40, "SUPP": q}, 3, 0.4), rays
    four = colours(dice, 4)
    yield "materials-4", grown(dice, dict(RATE=128, ALBD=63, MATL=3), 3, 0.4, meta=dict(Texel({}, []).meta, materials=four)), ()
    many = [{"albedo": [(n + 0.5) / 255, 0.5, (n + 0.25) / 255], "name": f"m{n}", "share": 0.004} for n in range(255)]
    yield "materials-255", grown(dice, dict(RATE=128, ALBD=63, MATL=254), 2, 0.5, meta=dict(Texel({}, []).meta, materials=many)), ()
    chain = [{(0, 0, 0): {"RATE": [9]}}]
    for d in range(1, 17):
        chain.append({tuple(2 * c + dice.randrange(2) for c in p): {"RATE": [9 + d]} for p in chain[-1]})
    yield "deepest", Texel({"RATE": 128}, chain), ()
    top = {n: [1] * len(MOST[n](1 if n not in ("RATE", "NDFD", "NDFC", "SUPP") else 2)) for n in ("CORR", "SIDE", "MEAN", "ALBD")}
    top.update(RATE=[2], NDFD=[0, 1, 2], NDFC=[0, 1, 2], SUPP=[1, 2, 3])
    least = dict(RATE=2, NDFD=2, NDFC=2, CORR=1, SUPP=3, SIDE=1, MEAN=1, ALBD=1)
    yield "least-codes", Texel(least, [{(0, 0, 0): top}, {(0, 0, 0): top, (1, 1, 1): dict(top, RATE=[1])}]), rays
    sheets = [{"oneSided": 1}, {"oneSided": 0.25, "transmission": [0.1, 0.3, 0.05], "unlit": 0.5}, {}]
    meta = dict(Texel({}, []).meta, materials=three, surfaces=sheets)
    facing = grown(dice, {n: q for n, q in dict(FULL, MATL=2).items() if n != "SUPP"}, 3, 0.75, meta=meta)
    for depth in range(3):
        for n, p in enumerate(facing.order(depth)):
            # Thin enough for sides to tell, of facets that have one; some are the inside of a solid.
            inside = n % 23 == 7
            facing.voxels[depth][p].update(RATE=[128] if inside else [60 + n % 9], SIDE=[0 if inside else 9 + n % 7])
    ends = [[[round(dice.uniform(low, low + 0.6), 3) for low in (side, 0.2, 0.2)] for side in (-0.7, 1.1)] for _ in range(6)]
    lines = [(a, [round(y - x, 3) for x, y in zip(a, b)]) for a, b in ends + [e[::-1] for e in ends]]
    yield "one-sided", facing, lines


def bad(dice):
    """Codes and files that break their rule."""
    base = grown(dice, FULL, 4, 0.5)
    sections = File(base).sections
    kinds = [s[0] for s in sections]
    topo, page = kinds.index(b"TOPO"), kinds.index(b"PAGE")
    big = max((i for i, s in enumerate(sections) if s[0] == b"PAGE"), key=lambda i: s_saved(sections[i]))

    def with_(key, value):
        value = value if callable(value) else (lambda v, to=value: to)
        return File(base).bytes(lambda name, old: value(old) if name == key else old)

    def after(change):
        data = bytearray(File(base).bytes())
        change(data)
        return bytes(data)

    def paged(i, change):
        """Change the index and the pages of a section; the checksum of the index is made after."""
        file = File(base)
        index, body = bytearray(file.sections[i][4]), bytearray(file.sections[i][5])
        change(index, body)
        file.sections[i][4], file.sections[i][5] = bytes(index), bytes(body)
        return file.bytes()

    def byte(at, f=lambda b: b ^ 1):
        return lambda data: data.__setitem__(at, f(data[at]))

    def number(at, value, form="<I"):
        return lambda data, *_: struct.pack_into(form, data, at, value)

    def mended(change):
        def both(index, body):
            change(body)
            struct.pack_into("<I", index, 12, zlib.crc32(body[:struct.unpack_from("<I", index, 8)[0]]))
        return both

    yield "magic", after(byte(0))
    yield "magic", File(base).bytes()[:100]
    yield "version", with_("major", 2)
    yield "head-length", after(number(16, 0xFFFFFFF8))
    yield "head-length", after(number(16, 64))
    yield "head-length", after(byte(16))
    yield "head-crc", after(byte(200))
    yield "flags", with_("incompat", 4)
    for key, value in (("page", 9), ("page", 17), ("topo", 17), ("cyclic", 8), ("up", 3)):
        yield "range", with_(key, value)
    yield "reserved", with_(("stream", 0, 5), 1)
    yield "reserved", with_(("stream", 1, 4), 8)
    yield "reserved", with_(("section", 2, 11), b"\0\0\0\0\0\1")
    yield "float", with_("bounds", (-1, 0, -1, 1, math.nan, 1))
    yield "float", with_("bounds", (2, 0, -1, 1, 2, 1))
    yield "float", with_("metres", -math.inf)
    yield "counts", with_(("depth", 0, 0), 2)
    yield "counts", with_(("depth", 2, 0), 2**63)
    yield "counts", with_(("depth", 3, 1), 1)
    yield "counts", with_("nodes", lambda n: n + 1)
    yield "stream", with_(("stream", 0, 3), 0)
    yield "stream", with_(("stream", 1, 1), 4)
    yield "stream", with_(("stream", 1, 2), 2)
    yield "stream", with_(("stream", 1, 0), b"RATE")
    yield "stream", with_(("stream", 2, 3), 21)
    yield "stream", with_(("stream", 1, 6), math.nan)
    yield "stream", with_(("stream", 1, 7), b"\0\0\0\0\0\0\0\1")
    yield "stream-critical", File(grown(dice, {"RATE": 128}, 2, 0.5, extra=[[b"NEWS", 1, 1, 9, 1, 0, 0.0, bytes(8), bytes(8)]])).bytes()
    yield "content-id", with_("content-id", bytes(16))
    yield "section-critical", File(grown(dice, {"RATE": 128}, 2, 0.5, tail=[[b"MORE", 1, 255, 255, b"", b"new", 3, 0, 0, 0, bytes(6)]])).bytes()
    yield "section-order", with_(("section", page, 3), 1)
    yield "section-order", with_(("section", topo, 0), b"PAGE")
    yield "section-order", File(grown(dice, {"RATE": 128}, 2, 0.5, tail=[[b"META", 0, 255, 255, b"", b"{}", 2, 0, 0, 0, bytes(6)]])).bytes()
    yield "section-place", with_(("section", 3, 4), lambda v: v + 8)
    yield "section-place", with_(("section", 3, 4), 2**64 - 8)
    yield "section-place", with_(("section", 3, 5), 2**63)
    yield "section-size", with_(("section", 3, 6), lambda v: v + 1)
    yield "section-size", with_(("section", 3, 7), 2**32 - 1)
    yield "section-size", with_(("section", 3, 5), 3)
    yield "section-codec", with_(("section", 3, 9), 2)
    yield "section-codec", with_(("section", page, 10), 3)
    yield "section-codec", with_(("section", topo, 10), 1)
    yield "block", with_(("depth", 2, 2), lambda v: v + 8)
    yield "block", with_(("depth", 2, 3), lambda v: v - 1)
    whole = File(base).bytes()
    yield "file-length", whole[:-1]
    yield "file-length", whole + b"\0"
    yield "file-length", with_("length", lambda v: v + 8)
    yield "meta-crc", with_(("section", 0, 8), 0)
    nested = dict(base.meta, x=json.loads("[" * 17 + "]" * 17))
    for meta in ({}, [], nested, dict(base.meta, model="other"), dict(base.meta, facet_size=2.5),
                 dict(base.meta, content={"max": [1, 1, 1.5], "min": [0, 0, 0]}), dict(base.meta, materials=colours(dice, 2))):
        yield "meta-json", File(grown(dice, {"RATE": 128}, 2, 0.5, meta=meta)).bytes()
    spaced = File(grown(dice, {"RATE": 128}, 2, 0.5))
    spaced.meta = spaced.meta.replace(b":", b": ", 1)
    spaced.sections[0][5], spaced.sections[0][6] = spaced.meta, len(spaced.meta)
    yield "meta-json", spaced.bytes()
    gap = gap_of(whole)
    yield "padding", after(byte(gap))
    head = struct.unpack_from("<I", whole, 16)[0]
    yield "index-crc", after(byte(head))
    yield "index-place", paged(page, lambda index, _: index.__setitem__(0, index[0] + 1))
    yield "index-place", paged(page, number(8, 2**32 - 1))
    yield "index-place", paged(page, lambda index, _: index.__setitem__(8, index[8] - 1))
    yield "page-crc", paged(page, lambda _, body: body.__setitem__(0, body[0] ^ 1))
    yield "page-frame", paged(big, mended(lambda body: body.__setitem__(0, body[0] ^ 1)))
    yield "page-frame", paged(big, mended(lambda body: body.__setitem__(slice(len(body) // 2, None), bytes(len(body) - len(body) // 2))))
    yield "page-value", paged(page, mended(lambda body: body.__setitem__(0, 255)))
    yield "topology", paged(topo, number(16, 1, "<Q"))
    yield "topology", paged(topo, mended(lambda body: body.__setitem__(0, body[0] & (body[0] - 1))))
    yield "digest", with_(("depth", 2, 4), lambda d: bytes([d[0] ^ 1]) + d[1:])


def worse(dice):
    """More of them, of a small texel: each other way in which a rule is broken."""
    small = grown(dice, FULL, 3, 0.4)
    kinds = [s[0] for s in File(small).sections]
    topo, last = kinds.index(b"TOPO"), len(kinds) - 1

    def with_(key, value, texel=small):
        value = value if callable(value) else (lambda v, to=value: to)
        return File(texel).bytes(lambda name, old: value(old) if name == key else old)

    def paged(i, stored, texel=small, decoded=None):
        """A section of one page, with these bytes for the page."""
        file = File(texel)
        head = struct.pack("<QII", len(file.sections[i][4]), len(stored), zlib.crc32(stored))
        file.sections[i][4], file.sections[i][5] = head + file.sections[i][4][16:], stored
        return file.bytes()

    for key, value in (("depths", 0), ("streams", 0), ("sections", 0), ("page", 0), ("topo", 9), ("cyclic", 128), ("up", 255)):
        yield "range", with_(key, value)
    yield "reserved", with_(("stream", 1, 8), b"\0\0\0\0\1\0\0\0")
    yield "reserved", with_(("section", 2, 1), 4)
    for bounds in ((-math.inf, 0, -1, 1, 2, 1), (-1, 0, -1, 1, 2, math.inf), (-1, 0, 2, 1, 2, 1)):
        yield "float", with_("bounds", bounds)
    yield "float", with_("metres", -1.0)
    yield "float", with_("metres", math.nan)
    yield "counts", with_(("depth", 1, 1), lambda v: small_count(small, 1) + 1)
    yield "counts", with_(("depth", 2, 0), lambda v: internal_count(small, 1) - 1)
    yield "counts", with_(("depth", 1, 0), lambda v: 9)
    for stream, change in ((0, (1, 0)), (0, (1, 9)), (0, (3, 1)), (0, (3, 256)), (3, (3, 16)), (4, (3, 16)), (5, (3, 16)), (2, (3, 22 + 233)),
                           (1, (6, -1.0)), (1, (6, math.inf))):
        yield "stream", with_(("stream", stream, change[0]), change[1])
    yield "stream", with_(("stream", 3, 7), bytes([16, 0, 0, 0, 0, 0, 0, 0]), grown(dice, FULL, 2, 0.5, constant={"CORR": [9]}))
    yield "stream", with_(("stream", 1, 7), bytes([3, 0, 0, 0, 0, 0, 0, 0]), grown(dice, FULL, 2, 0.5, constant={"NDFD": [1, 2, 3]}))
    gone = File(small)
    del gone.sections[last]
    yield "section-order", gone.bytes()
    twice = File(grown(dice, {"RATE": 128}, 2, 0.5))
    twice.sections.append([b"TOPO", 0, 1, 255, b"", b"", 0, 0, 0, 0, bytes(6)])
    yield "section-order", twice.bytes()
    yield "section-size", with_(("section", 0, 7), 1)
    yield "section-size", with_(("section", 0, 6), lambda v: v + 1)
    yield "section-size", with_(("section", topo, 6), lambda v: v + 1)
    yield "section-codec", with_(("section", 0, 9), 1)
    yield "section-codec", with_(("section", 0, 10), 1)
    yield "section-codec", with_(("section", topo, 9), 9)
    plain = Texel({}, []).meta
    two = [{"albedo": [0.1, 0.2, 0.3], "name": "a", "share": 0.5}, {"albedo": [0.3, 0.2, 0.1], "name": "b", "share": 0.5}]

    def materials(**changed):
        return dict(plain, materials=[two[0], dict(two[1], **changed)])

    mixed = dict(RATE=128, MATL=1)
    for meta in (materials(name="a"), materials(name=""), materials(share=1.5), materials(albedo=[0, 0, 2]), materials(albedo=[0, 0]),
                 dict(plain, materials=two[:1])):
        yield "meta-json", File(grown(dice, mixed, 2, 0.5, meta=meta)).bytes()
    for meta in (dict(plain, facet_size=-1), dict(plain, facet_size="1"), dict(plain, content={"max": [0, 1, 1], "min": [1, 0, 0]}),
                 dict(plain, content={"max": [1, 1], "min": [0, 0]}), {k: v for k, v in plain.items() if k != "model"}):
        yield "meta-json", File(grown(dice, {"RATE": 128}, 2, 0.5, meta=meta)).bytes()
    rate = grown(dice, {"RATE": 128}, 2, 0.5)
    for old, new in ((b'"model"', b'"mod\xff"'), (b"0.25", b"0.250"), (b"0.25", b"2.5e-1"), (b"}", b"} "), (b'"model":"coverage"', b'"model":"coverage","model":"coverage"'),
                     (b'"facet_size":0.25', b'"facet_size":0.25,"a":1'), (b'"coverage"', b'"\\u0063overage"')):
        file = File(rate)
        file.meta = file.meta[::-1].replace(old[::-1], new[::-1], 1)[::-1]
        file.sections[0][5], file.sections[0][6] = file.meta, len(file.meta)
        yield "meta-json", file.bytes()
    yield "padding", with_("padding", lambda out: out[:-1] + b"\1", padded_head(dice))
    wrong = File(grown(dice, {"RATE": 128}, 2, 0.5, tail=[[b"MORE", 2, 255, 255, b"", b"anything", 8, 0, 0, 0, bytes(6)]]))
    at = len(wrong.sections) - 1
    yield "page-crc", wrong.bytes(lambda name, old: old ^ 1 if name == ("section", at, 8) else old)
    file = File(small)
    file.sections[last][5] += b"\0"
    yield "index-place", file.bytes()
    # A page of many equal codes, which a frame makes shorter.
    even = Texel({"RATE": 128}, [{(0, 0, 0): {"RATE": [7]}}, {(x, y, z): {"RATE": [7]} for x in (0, 1) for y in (0, 1) for z in (0, 1)}, {
        (x, y, z): {"RATE": [7]} for x in range(4) for y in range(4) for z in range(4)}], filter=1)
    page = len(File(even).sections) - 1
    raw = bytes([7]) * 64
    frame = zstandard.ZstdCompressor(level=9, write_content_size=True).compress(raw)
    sizeless = zstandard.ZstdCompressor(level=9, write_content_size=False).compress(raw)
    other = zstandard.ZstdCompressor(level=9, write_content_size=True).compress(raw[:63])
    skip = struct.pack("<II", 0x184D2A50, 4) + b"skip"
    for stored in (frame + b"\0", frame[:-1], sizeless, other, raw + b"\7", skip + frame, b""):
        yield "page-frame", paged(page, stored, even)
    uncoded = File(even)
    uncoded.sections[page][8] = 0
    yield "page-frame", uncoded.bytes(lambda name, old: 0 if name == ("section", page, 9) else old)
    for codes in ({"NDFD": [3, 0, 0]}, {"ALBD": [0, 0, 64]}, {"SUPP": [64, 0, 0]}):
        texel = Texel(FULL, [{(0, 0, 0): dict({n: [1] * len(MOST[n](q)) for n, q in FULL.items()}, **codes)}], filter=0)
        yield "page-value", File(texel).bytes()
    wide = dict(plain, materials=[{"albedo": [(n + 1) / 9, 0, 0], "name": f"m{n}", "share": 0.1} for n in range(6)])
    for codes in ([6, 0, 0, 0, 0, 0, 0], [0, 1, 2, 3, 30, 30, 4], [0, 0, 0, 0, 64, 0, 0]):
        yield "page-value", File(Texel({"RATE": 9, "MATL": 5}, [{(0, 0, 0): {"RATE": [3], "MATL": codes}}], filter=0, meta=wide)).bytes()
    three = dict(plain, materials=wide["materials"][:3])
    yield "page-value", File(Texel({"RATE": 9, "MATL": 2}, [{(0, 0, 0): {"RATE": [3], "MATL": [32, 32]}}], filter=0, meta=three)).bytes()
    yield "topology", with_(("depth", 1, 1), lambda v: v - 1, crowd(dice))


def small_count(texel, d):
    return len(texel.voxels[d])


def internal_count(texel, d):
    return sum(texel.mask(d, p) != 0 for p in texel.voxels[d])


def padded_head(dice):
    """A texel whose META does not end at a multiple of 8."""
    texel = grown(dice, {"RATE": 128}, 2, 0.5)
    while len(json.dumps(texel.meta, sort_keys=True, separators=(",", ":"))) % 8 == 0:
        texel.meta = dict(texel.meta, x=texel.meta.get("x", "") + "x")
    return texel


def crowd(dice):
    """A texel of which one internal node less could have as many children."""
    while True:
        texel = grown(dice, {"RATE": 128}, 3, 0.4)
        if internal_count(texel, 1) > 1 and len(texel.voxels[2]) <= 8 * (internal_count(texel, 1) - 1):
            return texel


def s_saved(section):
    return section[6] - len(section[5])


def gap_of(data):
    """A byte of padding between two sections."""
    depths, streams = data[40], data[41]
    count = struct.unpack_from("<H", data, 46)[0]
    at = 128 + 64 * depths + 32 * streams
    spans = [struct.unpack_from("<QQ", data, at + 48 * i + 8) for i in range(count)]
    return next(a + n for (a, n), (b, _) in zip(spans[1:], spans[2:]) if a + n < b)


def main(folder):
    dice = random.Random(1996)
    for name, texel, rays in good(dice):
        (folder / f"ok-{name}.vtex").write_bytes(File(texel).bytes())
        (folder / f"ok-{name}.txt").write_text(text(texel, rays))
    (folder / "shading-1.txt").write_text(shading(random.Random(2015)))
    number = {}
    for code, data in [*bad(random.Random(1995)), *worse(random.Random(1994))]:
        number[code] = number.get(code, 0) + 1
        (folder / f"bad-{code}-{number[code]}.vtex").write_bytes(data)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent)
