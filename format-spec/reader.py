#!/usr/bin/env python3
"""An independent reader of .vtex 1, written from vtex-1.md alone; needs Python 3.9, numpy and zstandard.

    reader.py FILE [DEPTH]     the decoded content as the plain text of section 11 (decode.py)
    reader.py --check FILE     checks all of it; prints nothing

Where a rule is broken it prints the rule's code and what is wrong, and exits with 1.
"""
import hashlib, json, struct, sys, zlib
from decimal import Decimal
import numpy as np
import zstandard

MAGIC = bytes.fromhex("AB5654455820 31BB0D0A1A0A")
COMPONENTS = {"RATE": 1, "NDFD": 3, "NDFC": 3, "CORR": 1, "SUPP": 3, "SIDE": 1, "MEAN": 2, "ALBD": 3, "MATL": None}
LEAST_Q = {"RATE": 2, "NDFD": 2, "NDFC": 2}


class Broken(Exception):
    """A rule that a file breaks: its code, and what is wrong."""


def need(true, code, what=""):
    if not true:
        raise Broken(code, what)


def align8(n):
    return (n + 7) // 8 * 8


def split(n, log2):
    """How many of n items each page has."""
    return [min(1 << log2, n - start) for start in range(0, n, 1 << log2)]


def canonical(v):
    """JSON as RFC 8785 writes it."""
    if isinstance(v, dict):
        keys = sorted(v, key=lambda k: k.encode("utf-16-be"))
        return "{" + ",".join(f"{canonical(k)}:{canonical(v[k])}" for k in keys) + "}"
    if isinstance(v, list):
        return "[" + ",".join(map(canonical, v)) + "]"
    if isinstance(v, (str, bool)) or v is None:
        return json.dumps(v, ensure_ascii=False)
    _, digits, exponent = Decimal(repr(float(v))).normalize().as_tuple()
    digits, sign = "".join(map(str, digits)), "-" if v < 0 else ""
    n = len(digits) + exponent
    if v == 0:
        return "0"
    if 0 < n <= 21:
        return sign + (digits.ljust(n, "0") if exponent >= 0 else digits[:n] + "." + digits[n:])
    if -6 < n <= 0:
        return sign + "0." + "0" * -n + digits
    return f"{sign}{digits[0]}{'.' * (len(digits) > 1)}{digits[1:]}e{n - 1:+d}"


class Stream:
    """An entry of the stream table."""

    def __init__(self, raw, names, number):
        semantic, self.k, size, self.q, flags, reserved, error, constant, tail = struct.unpack("<4sBBHHHf8s8s", raw)
        self.semantic, self.number = semantic.decode("latin-1"), number
        need(reserved == 0 and tail == bytes(8) and flags & ~7 == 0, "reserved", "of a stream")
        known = self.semantic in COMPONENTS
        need(known or not flags & 1, "stream-critical", self.semantic)
        self.constant = constant if flags & 4 else None
        shape = 1 <= self.k <= 8 and size == 1 and 1 <= self.q <= 255 and np.isfinite(error) and error >= 0
        need(shape and self.semantic not in names, "stream", self.semantic)
        if known:
            wanted = COMPONENTS[self.semantic] or (self.q if self.q < 4 else 7)
            allowed = {"NDFC": self.q % 2 == 0, "SUPP": self.q in (3, 15, 63, 255), "MATL": self.q <= 254}
            allowed.update({s: self.q <= 15 for s in ("CORR", "SIDE")})
            least = LEAST_Q.get(self.semantic, 1)
            need(self.k == wanted and self.q >= least and allowed.get(self.semantic, True), "stream", self.semantic)
        used = constant[: self.k] if self.constant else b""
        need(all(c <= m for c, m in zip(used, self.most())) and not any(constant[len(used):]), "stream", self.semantic)

    def most(self):
        """The largest code of each component."""
        if self.semantic == "NDFD":
            return [2, self.q, self.q]
        if self.semantic == "MATL":
            return [63] * self.k if self.k < 7 else [self.q] * 4 + [63] * 3
        return [self.q] * self.k


class Texel:
    """A file whose head keeps every rule; `masks(d)` and `codes(d, stream)` decode, and check, one depth."""

    def __init__(self, data):
        self.data = data
        need(len(data) >= 128 and data[:12] == MAGIC, "magic")
        f = struct.unpack_from("<HHIIQIIBBBBBBH6ddQ16s", data, 12)
        major, _, head, crc, self.length, incompat, _, depths, streams, self.page, self.topo, cyclic, up, sections = f[:14]
        bounds, metres, nodes, content_id = f[14:20], f[20], f[21], f[22]
        need(major == 1, "version", f"{major}")
        tables = 128 + 64 * depths + 32 * streams + 48 * sections
        need(tables <= head <= 1 << 20 and head % 8 == 0 and head <= len(data), "head-length", f"{head}")
        need(zlib.crc32(data[:20] + bytes(4) + data[24:head]) == crc, "head-crc")
        need(incompat == 0, "flags", f"{incompat:#x}")
        need(1 <= depths <= 17 and 1 <= streams <= 32 and 1 <= sections <= 4096, "range", "counts")
        need(10 <= self.page <= 16 and 10 <= self.topo <= 16 and cyclic <= 7 and up <= 2, "range", "pages or axes")
        finite = all(map(np.isfinite, bounds + (metres,)))
        need(finite and all(bounds[k] <= bounds[k + 3] for k in range(3)) and metres >= 0, "float")
        self.cyclic, self.up, self.bounds, self.metres = cyclic, up, bounds, metres
        self.depths = [struct.unpack_from("<QQQQ32s", data, 128 + 64 * d) for d in range(depths)]
        least, most, total = 0, 1, 0
        for d, (n, internal, *_) in enumerate(self.depths):
            need(least <= n <= most and n < 2**32 - 1 and internal <= n, "counts", f"depth {d}")
            need(d + 1 < depths or internal == 0, "counts", "the finest depth has children")
            least, most, total = internal, 8 * internal, total + n
        need(total == nodes, "counts", "sum")
        self.streams = []
        at = 128 + 64 * depths
        for s in range(streams):
            names = [t.semantic for t in self.streams]
            self.streams.append(Stream(data[at + 32 * s:at + 32 * s + 32], names, s))
        said = bytes([depths, cyclic, up]) + data[48:104] + data[at:at + 32 * streams]
        said += b"".join(struct.pack("<Q", d[0]) + d[4] for d in self.depths)
        need(hashlib.sha256(said).digest()[:16] == content_id, "content-id")
        self.sections = [struct.unpack_from("<4sHBBQQQIIBB6s", data, at + 32 * streams + 48 * i) for i in range(sections)]
        self.check_sections(head, tables)
        self.check_meta(head)

    def check_sections(self, head, end):
        paged = [s for s in self.streams if s.constant is None]
        wanted = [(b"META", 255, 255)]
        for d in range(len(self.depths)):
            wanted += [(b"TOPO", d, 255)] * (d > 0) + [(b"PAGE", d, s.number) for s in paged]
        self.place = {}
        for i, section in enumerate(self.sections):
            kind, flags, depth, stream, offset, length, decoded, pages, _, codec, filter_, reserved = section
            need(reserved == bytes(6) and flags & ~3 == 0, "reserved", f"section {i}")
            if i < len(wanted):
                need((kind, depth, stream) == wanted[i], "section-order", f"section {i}")
                self.place[wanted[i]] = section
                if kind == b"META":
                    sizes, entry, codecs, filters = (length, 0), 0, 0, 0
                    need(length <= 256 << 10, "section-size", "META")
                elif kind == b"TOPO":
                    n = self.depths[depth - 1][0]
                    sizes, entry, codecs, filters = (n, len(split(n, self.topo))), 24, 1, 0
                else:
                    n = self.depths[depth][0]
                    sizes, entry, codecs, filters = (n * self.streams[stream].k, len(split(n, self.page))), 16, 1, 2
                need((decoded, pages) == sizes and pages * entry <= length, "section-size", f"section {i}")
                need(codec <= codecs and filter_ <= filters, "section-codec", f"section {i}")
            else:
                need(kind not in (b"META", b"TOPO", b"PAGE"), "section-order", f"section {i}")
                need(not flags & 1, "section-critical", f"section {i}")
            need(offset == align8(end) and offset + length <= self.length, "section-place", f"section {i}")
            end = offset + length
            if i == 0:
                need(align8(end) == head, "head-length", "does not end behind META")
                end = head
        need(len(self.sections) >= len(wanted), "section-order", "sections are missing")
        need(end == self.length, "file-length", "by its sections")
        start = head
        for d, (_, _, first, last, _) in enumerate(self.depths):
            own = [s[4] + s[5] for key, s in self.place.items() if key[0] != b"META" and key[1] == d]
            need(first == start and last == max([start] + own), "block", f"depth {d}")
            start = align8(last)

    def check_meta(self, head):
        _, _, _, _, offset, length, _, _, crc, *_ = self.sections[0]
        body = self.data[offset:offset + length]
        need(zlib.crc32(body) == crc, "meta-crc")
        need(not any(self.data[offset + length:head]), "padding", "of the head")
        try:
            meta = json.loads(body.decode("utf-8"))
        except (ValueError, RecursionError) as e:
            raise Broken("meta-json", str(e)) from e
        need(canonical(meta).encode() == body, "meta-json", "not canonical")
        inner = lambda v: v.values() if isinstance(v, dict) else v if isinstance(v, list) else None
        deep = lambda v: 0 if inner(v) is None else 1 + max(map(deep, inner(v)), default=0)
        need(isinstance(meta, dict) and deep(meta) <= 16, "meta-json", "not an object, or nested deeper than 16")
        number = lambda v: isinstance(v, (int, float)) and not isinstance(v, bool)
        content = meta.get("content")
        corners = [content.get(k) for k in ("min", "max")] if isinstance(content, dict) else [None]
        need(all(isinstance(c, list) and len(c) == 3 and all(map(number, c)) for c in corners), "meta-json", "content")
        need(all(0 <= a <= b <= 1 for a, b in zip(*corners)), "meta-json", "content")
        need(number(meta.get("facet_size")) and 0 <= meta["facet_size"] <= 2, "meta-json", "facet_size")
        need(meta.get("model") in ("coverage", "neyret"), "meta-json", "model")
        materials = meta.get("materials", [])
        mixed = [s for s in self.streams if s.semantic == "MATL"]
        need(len(materials) == mixed[0].q + 1 if mixed else len(materials) <= 1, "meta-json", "materials")
        names = [m["name"] for m in materials]
        need(all(names) and len(set(names)) == len(names), "meta-json", "names of materials")
        need(all(len(m["albedo"]) == 3 for m in materials), "meta-json", "materials")
        need(all(0 <= v <= 1 for m in materials for v in m["albedo"] + [m["share"]]), "meta-json", "materials")
        self.meta = meta

    def pages(self, key, counts, per_item):
        """The decoded pages of a section; `counts`: how many items each has, of `per_item` bytes."""
        _, _, _, _, offset, length, _, pages, crc, codec, _, _ = self.place[key]
        entry = struct.Struct("<QIIQ" if key[0] == b"TOPO" else "<QII")
        body, at = self.data[offset:offset + length], pages * entry.size
        need(zlib.crc32(body[:at]) == crc, "index-crc", f"{key}")
        refs = list(entry.iter_unpack(body[:at]))
        for start, size, *_ in refs:
            need(start == at and start + size <= length, "index-place", f"{key}")
            at += size
        need(at == length, "index-place", f"{key}")
        for count, (start, size, check, *child) in zip(counts, refs):
            raw, wanted = body[start:start + size], count * per_item
            need(zlib.crc32(raw) == check, "page-crc", f"{key}")
            if size != wanted:
                need(codec == 1 and size < wanted, "page-frame", f"{key}")
                try:
                    about = zstandard.get_frame_parameters(raw)
                    need(about.content_size == wanted and about.dict_id == 0, "page-frame", f"{key}")
                    decoder = zstandard.ZstdDecompressor().decompressobj()
                    raw = decoder.decompress(raw)
                    need(decoder.eof and not decoder.unused_data and len(raw) == wanted, "page-frame", f"{key}")
                except zstandard.ZstdError as e:
                    raise Broken("page-frame", str(e)) from e
            yield np.frombuffer(raw, np.uint8), child

    def masks(self, d):
        """Child masks of the nodes of depth d − 1."""
        n, internal = self.depths[d - 1][:2]
        out, children = [], 0
        for masks, first in self.pages((b"TOPO", d, 255), split(n, self.topo), 1):
            need(first == [children], "topology", f"depth {d}")
            children += int(np.unpackbits(masks).sum())
            out.append(masks)
        masks = np.concatenate(out) if out else np.zeros(0, np.uint8)
        need(children == self.depths[d][0] and np.count_nonzero(masks) == internal, "topology", f"depth {d}")
        return masks

    def codes(self, d, stream):
        """Codes of the voxels of depth d, an array of n × K."""
        n, most = self.depths[d][0], np.array(stream.most())
        if stream.constant is not None:
            return np.tile(np.frombuffer(stream.constant[:stream.k], np.uint8).astype(np.int64), (n, 1))
        key, out = (b"PAGE", d, stream.number), [np.zeros((0, stream.k), np.int64)]
        filter_ = self.place[key][10]
        for (b, _), count in zip(self.pages(key, split(n, self.page), stream.k), split(n, self.page)):
            c = b.astype(np.int64)
            c = c.reshape(count, stream.k) if filter_ == 0 else c.reshape(stream.k, count).T
            need((c <= most).all(), "page-value", f"{key}")
            if filter_ == 2:
                c = np.cumsum(np.where(c % 2 == 0, c // 2, most + 1 - (c + 1) // 2), axis=0) % (most + 1)
            if stream.semantic == "MATL":
                need((c[:, 4 if stream.k == 7 else 0:].sum(axis=1) <= 63).all(), "page-value", "shares")
            out.append(c)
        return np.concatenate(out)

    def positions(self):
        """Integer positions of each depth's voxels in Morton order, and whether they are terminal."""
        at = np.zeros((self.depths[0][0], 3), np.int64)
        for d in range(1, len(self.depths) + 1):
            masks = self.masks(d) if d < len(self.depths) else np.zeros(len(at), np.uint8)
            bits = np.unpackbits(masks[:, None], axis=1, bitorder="little")
            yield at, masks == 0
            node, octant = np.nonzero(bits)
            at = 2 * at[node] + np.stack([octant & 1, octant >> 1 & 1, octant >> 2], axis=1)

    def verify(self):
        """Everything that the head alone does not tell."""
        end = 0
        for i, (kind, _, _, _, offset, length, _, _, crc, *_) in enumerate(self.sections):
            need(i == 0 or not any(self.data[end:offset]), "padding", f"before section {i}")
            end = align8(offset + length) if i == 0 else offset + length
            if kind not in (b"META", b"TOPO", b"PAGE"):
                need(zlib.crc32(self.data[offset:end]) == crc, "page-crc", f"section {i}")
        for d, depth in enumerate(self.depths):
            digest = hashlib.sha256(self.masks(d).tobytes() if d else b"")
            for stream in self.streams:
                codes = self.codes(d, stream)
                digest.update(codes.astype(np.uint8).tobytes() if stream.constant is None else b"")
            need(digest.digest() == depth[4], "digest", f"depth {d}")


if __name__ == "__main__":
    check = sys.argv[1:2] == ["--check"]
    arguments = sys.argv[2 if check else 1:]
    if not 1 <= len(arguments) <= 2:
        sys.exit(__doc__)
    try:
        with open(arguments[0], "rb") as file:
            data = file.read()
        texel = Texel(data)
        need(len(data) == texel.length, "file-length", f"{len(data)} bytes of {texel.length}")
        texel.verify()
        if not check:
            from decode import dump
            print("\n".join(dump(texel, int(arguments[1]) if arguments[1:] else None)))
    except Broken as broken:
        print(*broken.args)
        sys.exit(1)
