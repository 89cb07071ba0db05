// A reader of .vtex 1, written from vtex-1.md alone. Runs in browsers and in Node; no dependencies but zstd.mjs beside it.
//
//   const texel = new Texel(bytes);          // checks the head; throws Broken
//   texel.masks(d), texel.codes(d, stream)   // decode one depth, and check it
//   texel.depth(d)                           // {positions, terminal, fields}
//   texel.verify()                           // everything else
import { decompress } from "./zstd.mjs";

export class Broken extends Error {
  constructor(code, what = "") {
    super(`${code} ${what}`);
    this.code = code;
  }
}

const need = (ok, code, what) => {
  if (!ok) throw new Broken(code, what);
};
const align8 = (n) => Math.ceil(n / 8) * 8;
const zero = (bytes) => bytes.every((b) => b === 0);
const halfUp = (x) => Math.floor(x + 0.5);
const same = (a, b) => a.length === b.length && a.every((v, i) => v === b[i]);
const latin = (bytes) => String.fromCharCode(...bytes);
const popcount = (b) => {
  let n = 0;
  for (; b; b &= b - 1) n++;
  return n;
};

const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

export function crc32(...parts) {
  let crc = -1;
  for (const part of parts) for (const byte of part) crc = CRC[(crc ^ byte) & 255] ^ (crc >>> 8);
  return ~crc >>> 0;
}

const primes = (n) => {
  const out = [];
  for (let k = 2; out.length < n; k++) if (out.every((p) => k % p)) out.push(k);
  return out;
};
const fraction = (x) => Math.floor((x - Math.floor(x)) * 2 ** 32);
const ROUNDS = primes(64).map((p) => fraction(Math.cbrt(p)));
const START = primes(8).map((p) => fraction(Math.sqrt(p)));

// SHA-256 (FIPS 180-4): pages that are shown without a secure connection have none of their own.
export function sha256(bytes) {
  const padded = new Uint8Array((bytes.length + 72) & ~63), view = new DataView(padded.buffer);
  padded.set(bytes);
  padded[bytes.length] = 0x80;
  view.setUint32(padded.length - 8, Math.floor(bytes.length / 2 ** 29));
  view.setUint32(padded.length - 4, bytes.length * 8);
  const state = Uint32Array.from(START), w = new Uint32Array(64);
  const turn = (x, n) => (x >>> n) | (x << (32 - n));
  for (let at = 0; at < padded.length; at += 64) {
    for (let i = 0; i < 64; i++) {
      const a = w[(i + 49) & 63], b = w[(i + 62) & 63];
      w[i] = i < 16 ? view.getUint32(at + 4 * i)
        : w[i - 16] + (turn(a, 7) ^ turn(a, 18) ^ (a >>> 3)) + w[i - 7] + (turn(b, 17) ^ turn(b, 19) ^ (b >>> 10));
    }
    let [a, b, c, d, e, f, g, h] = state;
    for (let i = 0; i < 64; i++) {
      const t = h + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + ((e & f) ^ (~e & g)) + ROUNDS[i] + w[i];
      const u = (turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
      [h, g, f, e, d, c, b, a] = [g, f, e, (d + t) | 0, c, b, a, (t + u) | 0];
    }
    [a, b, c, d, e, f, g, h].forEach((v, i) => (state[i] += v));
  }
  const out = new Uint8Array(32);
  state.forEach((v, i) => new DataView(out.buffer).setUint32(4 * i, v));
  return out;
}

// Fields one after the other.
class Fields {
  constructor(bytes, at = 0) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.bytes = bytes;
    this.at = at;
  }
  raw(n) {
    this.at += n;
    return this.bytes.subarray(this.at - n, this.at);
  }
  get(n, read) {
    this.at += n;
    return read.call(this.view, this.at - n, true);
  }
  u8() { return this.get(1, DataView.prototype.getUint8); }
  u16() { return this.get(2, DataView.prototype.getUint16); }
  u32() { return this.get(4, DataView.prototype.getUint32); }
  f32() { return this.get(4, DataView.prototype.getFloat32); }
  f64() { return this.get(8, DataView.prototype.getFloat64); }
  // Beyond 2^53 a number is not exact; no count or offset that a rule allows is.
  u64() { return this.u32() + this.u32() * 2 ** 32; }
}

const COMPONENTS = { RATE: 1, NDFD: 3, NDFC: 3, CORR: 1, SUPP: 3, SIDE: 1, MEAN: 2, ALBD: 3 };
const ALLOWED = {
  RATE: (q) => q >= 2, NDFD: (q) => q >= 2, NDFC: (q) => q >= 2 && q % 2 === 0, CORR: (q) => q <= 15, SIDE: (q) => q <= 15,
  SUPP: (q) => [3, 15, 63, 255].includes(q), MATL: (q) => q <= 254, MEAN: () => true, ALBD: () => true,
};

function streamOf(f, earlier) {
  const s = { number: earlier.length, semantic: latin(f.raw(4)), k: f.u8(), size: f.u8(), q: f.u16(), flags: f.u16() };
  const reserved = f.u16(), error = f.f32(), constant = f.raw(8), tail = f.raw(8), name = s.semantic;
  need(reserved === 0 && zero(tail) && (s.flags & ~7) === 0, "reserved", "bits of a stream");
  const known = Object.hasOwn(ALLOWED, name);
  need(known || !(s.flags & 1), "stream-critical", name);
  const shape = s.k >= 1 && s.k <= 8 && s.size === 1 && s.q >= 1 && s.q <= 255 && Number.isFinite(error) && error >= 0;
  need(shape && earlier.every((e) => e.semantic !== name), "stream", name);
  const components = name === "MATL" ? (s.q < 4 ? s.q : 7) : COMPONENTS[name];
  need(!known || (components === s.k && ALLOWED[name](s.q)), "stream", name);
  s.most = Array.from({ length: s.k }, (_, i) => (name === "NDFD" && i === 0 ? 2 : name === "MATL" && (s.k < 7 || i > 3) ? 63 : s.q));
  s.constant = s.flags & 4 ? constant.slice(0, s.k) : null;
  const used = s.constant ? s.k : 0;
  need(s.most.every((m, i) => i >= used || constant[i] <= m) && zero(constant.subarray(used)), "stream", name);
  return s;
}

// JSON as RFC 8785 writes it.
function canonical(v) {
  if (Array.isArray(v)) return `[${v.map(canonical).join(",")}]`;
  if (v === null || typeof v !== "object") return JSON.stringify(v);
  return `{${Object.keys(v).sort().map((k) => `${JSON.stringify(k)}:${canonical(v[k])}`).join(",")}}`;
}
const nesting = (v) => (v === null || typeof v !== "object" ? 0 : 1 + Math.max(0, ...Object.values(v).map(nesting)));
const within = (v, low, high) => typeof v === "number" && v >= low && v <= high;

export class Texel {
  // `whole`: false where only the beginning of a file is there.
  constructor(bytes, whole = true) {
    this.bytes = bytes;
    need(bytes.length >= 128 && same(bytes.subarray(0, 12), [0xab, 0x56, 0x54, 0x45, 0x58, 0x20, 0x31, 0xbb, 13, 10, 26, 10]), "magic");
    const f = new Fields(bytes, 12);
    need(f.u16() === 1, "version");
    f.u16();
    const head = f.u32(), crc = f.u32();
    this.length = f.u64();
    const incompatible = f.u32();
    f.u32();
    const depths = f.u8(), streams = f.u8();
    this.page = f.u8();
    this.topo = f.u8();
    this.cyclic = f.u8();
    this.up = f.u8();
    const sections = f.u16(), tables = 128 + 64 * depths + 32 * streams + 48 * sections;
    this.bounds = Array.from({ length: 6 }, () => f.f64());
    this.metres = f.f64();
    const nodes = f.u64(), id = f.raw(16);
    need(head >= tables && head <= 1 << 20 && head % 8 === 0 && head <= bytes.length, "head-length");
    need(crc32(bytes.subarray(0, 20), new Uint8Array(4), bytes.subarray(24, head)) === crc, "head-crc");
    need(incompatible === 0, "flags");
    const between = (v, low, high) => need(v >= low && v <= high, "range");
    between(depths, 1, 17);
    between(streams, 1, 32);
    between(sections, 1, 4096);
    between(this.page, 10, 16);
    between(this.topo, 10, 16);
    between(this.cyclic, 0, 7);
    between(this.up, 0, 2);
    need([0, 1, 2].every((k) => this.bounds[k] <= this.bounds[k + 3]) && this.bounds.every(Number.isFinite), "float", "bounds");
    need(Number.isFinite(this.metres) && this.metres >= 0, "float", "metres");
    this.readDepths(f, depths, nodes);
    const at = f.at;
    this.streams = [];
    for (let i = 0; i < streams; i++) this.streams.push(streamOf(f, this.streams));
    const digests = this.depths.flatMap((_, d) => [bytes.subarray(128 + 64 * d, 136 + 64 * d), bytes.subarray(160 + 64 * d, 192 + 64 * d)]);
    const told = [[depths, this.cyclic, this.up], bytes.subarray(48, 104), bytes.subarray(at, at + 32 * streams), ...digests];
    need(same(sha256(Uint8Array.from(told.flatMap((part) => [...part]))).subarray(0, 16), id), "content-id");
    this.readSections(f, sections, head);
    this.readMeta(head);
    need(!whole || bytes.length === this.length, "file-length");
  }

  readDepths(f, count, nodes) {
    this.depths = [];
    let least = 0, most = 1, total = 0;
    for (let d = 0; d < count; d++) {
      const [n, internal, start, end] = [f.u64(), f.u64(), f.u64(), f.u64()];
      need(n >= least && n <= most && n < 2 ** 32 - 1 && internal <= n && (d + 1 < count || internal === 0), "counts", `depth ${d}`);
      this.depths.push({ n, internal, start, end, digest: f.raw(32) });
      [least, most, total] = [internal, 8 * internal, total + n];
    }
    need(total === nodes, "counts", "sum");
  }

  readSections(f, count, head) {
    const paged = this.streams.filter((s) => !s.constant);
    const wanted = this.depths.flatMap((_, d) => [...(d ? [`TOPO ${d} 255`] : []), ...paged.map((s) => `PAGE ${d} ${s.number}`)]);
    wanted.unshift("META 255 255");
    this.sections = [];
    let end = f.at + 48 * count;
    for (let i = 0; i < count; i++) {
      const s = { kind: latin(f.raw(4)), flags: f.u16(), depth: f.u8(), stream: f.u8(), offset: f.u64(), length: f.u64(), decoded: f.u64(),
        pages: f.u32(), crc: f.u32(), codec: f.u8(), filter: f.u8(), reserved: f.raw(6) };
      need(zero(s.reserved) && (s.flags & ~3) === 0, "reserved", `section ${i}`);
      s.key = `${s.kind} ${s.depth} ${s.stream}`;
      if (i < wanted.length) {
        need(s.key === wanted[i], "section-order", s.key);
        this.checkSize(s);
      } else {
        need(!["META", "TOPO", "PAGE"].includes(s.kind), "section-order", s.key);
        need(!(s.flags & 1), "section-critical", s.key);
      }
      need(s.offset === align8(end) && s.offset + s.length <= this.length, "section-place", s.key);
      end = s.offset + s.length;
      if (i === 0) need(align8(end) === head, "head-length", "does not end behind META");
      if (i === 0) end = head;
      this.sections.push(s);
    }
    need(count >= wanted.length, "section-order", "sections are missing");
    need(end === this.length, "file-length", "by its sections");
    let start = head;
    this.depths.forEach((depth, d) => {
      const own = this.sections.filter((s) => ["TOPO", "PAGE"].includes(s.kind) && s.depth === d);
      need(depth.start === start && depth.end === Math.max(start, ...own.map((s) => s.offset + s.length)), "block", `depth ${d}`);
      start = align8(depth.end);
    });
  }

  checkSize(s) {
    s.counts = [];
    s.entry = { META: 0, TOPO: 24, PAGE: 16 }[s.kind];
    s.k = s.kind === "PAGE" ? this.streams[s.stream].k : 1;
    let decoded = s.length;
    if (s.kind === "META") {
      need(s.length <= 256 << 10, "section-size", "META");
    } else {
      const n = this.depths[s.kind === "TOPO" ? s.depth - 1 : s.depth].n, size = 2 ** (s.kind === "TOPO" ? this.topo : this.page);
      for (let at = 0; at < n; at += size) s.counts.push(Math.min(size, n - at));
      decoded = n * s.k;
    }
    need(s.decoded === decoded && s.pages === s.counts.length && s.pages * s.entry <= s.length, "section-size", s.key);
    need(s.codec <= (s.entry ? 1 : 0) && s.filter <= (s.kind === "PAGE" ? 2 : 0), "section-codec", s.key);
  }

  readMeta(head) {
    const { offset, length, crc } = this.sections[0], body = this.bytes.subarray(offset, offset + length);
    need(crc32(body) === crc, "meta-crc");
    need(zero(this.bytes.subarray(offset + length, head)), "padding", "of the head");
    let meta;
    try {
      const text = new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(body);
      meta = JSON.parse(text);
      need(canonical(meta) === text, "meta-json", "not canonical");
    } catch (e) {
      throw e instanceof Broken ? e : new Broken("meta-json", e.message);
    }
    need(meta && typeof meta === "object" && !Array.isArray(meta) && nesting(meta) <= 16, "meta-json", "not an object, or nested too deep");
    const { min, max } = meta.content ?? {};
    const corners = [min, max].every((c) => Array.isArray(c) && c.length === 3 && c.every((v) => within(v, 0, 1)));
    need(corners && min.every((v, k) => v <= max[k]), "meta-json", "content");
    need(within(meta.facet_size, 0, 2), "meta-json", "facet_size");
    need(["coverage", "neyret"].includes(meta.model), "meta-json", "model");
    const mixed = this.streams.find((s) => s.semantic === "MATL"), materials = meta.materials ?? [];
    need(Array.isArray(materials) && (mixed ? materials.length === mixed.q + 1 : materials.length <= 1), "meta-json", "materials");
    const fine = (m) => typeof m?.name === "string" && m.name && Array.isArray(m.albedo) && m.albedo.length === 3 && [...m.albedo, m.share].every((v) => within(v, 0, 1));
    need(materials.every(fine) && new Set(materials.map((m) => m.name)).size === materials.length, "meta-json", "materials");
    this.meta = meta;
  }

  // The decoded pages of a section, checked.
  * pages(key) {
    const s = this.sections.find((t) => t.key === key), body = this.bytes.subarray(s.offset, s.offset + s.length);
    const f = new Fields(body);
    let at = s.pages * s.entry;
    need(crc32(body.subarray(0, at)) === s.crc, "index-crc", key);
    const refs = s.counts.map(() => ({ start: f.u64(), size: f.u32(), crc: f.u32(), first: s.entry === 24 ? f.u64() : 0 }));
    for (const { start, size } of refs) {
      need(start === at && start + size <= s.length, "index-place", key);
      at += size;
    }
    need(at === s.length, "index-place", key);
    for (const [i, { start, size, crc, first }] of refs.entries()) {
      let raw = body.subarray(start, start + size);
      const wanted = s.counts[i] * s.k;
      need(crc32(raw) === crc, "page-crc", key);
      if (size !== wanted) {
        need(s.codec === 1 && size < wanted, "page-frame", key);
        try {
          raw = decompress(raw, wanted);
        } catch (e) {
          throw new Broken("page-frame", `${key}: ${e.message}`);
        }
      }
      yield { raw, first, count: s.counts[i], filter: s.filter };
    }
  }

  // Child masks of the nodes of depth d − 1.
  masks(d) {
    const out = new Uint8Array(this.depths[d - 1].n);
    let at = 0, children = 0, internal = 0;
    for (const { raw, first } of this.pages(`TOPO ${d} 255`)) {
      need(first === children, "topology", `depth ${d}`);
      out.set(raw, at);
      at += raw.length;
      for (const mask of raw) {
        children += popcount(mask);
        internal += mask ? 1 : 0;
      }
    }
    need(children === this.depths[d].n && internal === this.depths[d - 1].internal, "topology", `depth ${d}`);
    return out;
  }

  // Codes of the voxels of depth d, a voxel's components together.
  codes(d, stream) {
    const { k, most } = stream, n = this.depths[d].n, out = new Uint8Array(n * k);
    if (stream.constant) {
      for (let i = 0; i < n; i++) out.set(stream.constant, i * k);
      return out;
    }
    let from = 0;
    for (const { raw, count, filter } of this.pages(`PAGE ${d} ${stream.number}`)) {
      for (let c = 0; c < k; c++) {
        const m = most[c] + 1;
        for (let i = 0, before = 0; i < count; i++) {
          const b = raw[filter ? c * count + i : i * k + c];
          if (b >= m) throw new Broken("page-value", `depth ${d} ${stream.semantic}`);
          before = filter < 2 ? b : (before + (b % 2 ? m - (b + 1) / 2 : b / 2)) % m;
          out[(from + i) * k + c] = before;
        }
      }
      from += count;
    }
    const shares = stream.semantic === "MATL" ? (k < 7 ? 0 : 4) : k;
    for (let i = 0; shares < k && i < n; i++) {
      need(out.subarray(i * k + shares, (i + 1) * k).reduce((a, b) => a + b, 0) <= 63, "page-value", "shares");
    }
    return out;
  }

  verify() {
    let end = 0;
    this.sections.forEach((s, i) => {
      need(i === 0 || zero(this.bytes.subarray(end, s.offset)), "padding", s.key);
      end = i ? s.offset + s.length : align8(s.offset + s.length);
      need(s.entry !== undefined || crc32(this.bytes.subarray(s.offset, end)) === s.crc, "page-crc", s.key);
    });
    this.depths.forEach((depth, d) => {
      const parts = [d ? this.masks(d) : [], ...this.streams.map((s) => (s.constant ? [] : this.codes(d, s)))];
      const all = new Uint8Array(parts.reduce((n, p) => n + p.length, 0));
      parts.reduce((at, p) => (all.set(p, at), at + p.length), 0);
      need(same(sha256(all), depth.digest), "digest", `depth ${d}`);
    });
  }

  // Positions of the voxels of every depth in Morton order, and which are terminal.
  positions() {
    let at = this.depths[0].n ? [[0, 0, 0]] : [];
    return this.depths.map((_, d) => {
      const masks = d + 1 < this.depths.length ? this.masks(d + 1) : new Uint8Array(at.length);
      const own = at, next = [];
      at.forEach(([x, y, z], i) => {
        for (let c = 0; c < 8; c++) if (masks[i] >> c & 1) next.push([2 * x + (c & 1), 2 * y + (c >> 1 & 1), 2 * z + (c >> 2)]);
      });
      at = next;
      return { at: own, terminal: masks.map((m) => (m ? 0 : 1)) };
    });
  }

  // The widened integers of a depth's voxels, by section 4.1.
  voxels(d) {
    const stream = (name) => this.streams.find((s) => s.semantic === name);
    const read = Object.fromEntries(Object.keys(ALLOWED).map((name) => {
      const s = stream(name);
      return [name, s && { q: s.q, k: s.k, codes: this.codes(d, s) }];
    }));
    const wide = (code, q) => halfUp(255 * code / q);
    const of = (name, i) => read[name] && Array.from(read[name].codes.subarray(i * read[name].k, (i + 1) * read[name].k));
    return Array.from({ length: this.depths[d].n }, (_, i) => {
      const v = { rate: 0, root: [255, 255, 255], corr: [0, 0, 0], block: 0, low: [0, 0, 0], high: [0, 0, 0], side: 0, mean: [0, 0], albedo: [255, 255, 255] };
      const [rate] = of("RATE", i);
      const fifteenths = (name) => (read[name] ? halfUp(15 * of(name, i)[0] / read[name].q) : 0);
      if (rate) {
        v.rate = 1 + halfUp(254 * (rate - 1) / (read.RATE.q - 1));
        v.block = fifteenths("CORR");
        v.side = fifteenths("SIDE");
        if (read.NDFD) {
          const [k, a, b] = of("NDFD", i);
          v.root[(k + 1) % 3] = wide(a, read.NDFD.q);
          v.root[(k + 2) % 3] = wide(b, read.NDFD.q);
        }
        const h = read.NDFC?.q / 2;
        if (read.NDFC) [[0, 1], [0, 2], [1, 2]].forEach(([a, b], pair) => {
          const c = of("NDFC", i)[pair] - h;
          if (c && v.root[a] && v.root[b]) v.corr[pair] = Math.sign(c) * halfUp(127 * Math.abs(c) / h);
        });
        if (read.SUPP) of("SUPP", i).forEach((c, axis) => {
          const s = Math.round(Math.sqrt(read.SUPP.q + 1)), g = 16 / s;
          v.low[axis] = g * (c % s);
          v.high[axis] = Math.min(g * Math.floor(c / s), 15 - v.low[axis]);
        });
        if (read.MEAN && v.side) v.mean = of("MEAN", i).map((c) => wide(c, read.MEAN.q));
        if (read.ALBD) v.albedo = of("ALBD", i).map((c) => wide(c, read.ALBD.q));
      }
      if (read.MATL) v.shares = this.shares(of("MATL", i), read.MATL.q, v.albedo);
      return v;
    });
  }

  // Shares of the materials, of 63: section 4.2.
  shares(codes, q, albedo) {
    const out = new Array(q + 1).fill(0), ids = q < 4 ? [] : codes.slice(0, 4), parts = q < 4 ? codes : codes.slice(4);
    const rest = 63 - parts.reduce((a, b) => a + b, 0);
    if (q < 4) [rest, ...parts].forEach((share, i) => (out[i] = share));
    else [rest, ...parts].forEach((share, i) => (out[ids[i]] += share));
    const far = this.meta.materials.map((m) => m.albedo.reduce((sum, a, k) => sum + (halfUp(255 * Math.sqrt(a)) - albedo[k]) ** 2, 0));
    const likely = far.indexOf(Math.min(...far));
    [out[0], out[likely]] = [out[likely], out[0]];
    return out;
  }

  // The plain text of section 11.
  text() {
    const lines = [`depths ${this.depths.length} up ${this.up} cyclic ${this.cyclic} model ${this.meta.model}`];
    const surfaces = (this.meta.surfaces ?? []).map((s) => [...(s.transmission ?? [0, 0, 0]), s.unlit ?? 0, s.oneSided ?? 0]);
    if (surfaces.flat().some((v) => v > 0)) surfaces.forEach((row, i) => lines.push(["surface", i, ...row.map((v) => halfUp(1e4 * v))].join(" ")));
    this.positions().forEach(({ at, terminal }, d) => {
      lines.push(`depth ${d} voxels ${at.length}`);
      this.voxels(d).forEach((v, i) => {
        const row = [...at[i], v.rate, ...v.root, ...v.corr, v.block, ...v.low, ...v.high, v.side, ...v.mean, ...v.albedo, ...(v.shares ?? [])];
        lines.push(row.join(" ") + (terminal[i] && d + 1 < this.depths.length ? " t" : ""));
      });
    });
    return lines.join("\n") + "\n";
  }
}
