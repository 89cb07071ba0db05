// One depth of a texel as 8³ bricks in a 3D atlas, 16 bytes a voxel, for the shader to read.
//
// Based on: C. Crassin et al., GigaVoxels, I3D 2009 (bricks that a coarse grid points to).

export const BRICK = 8;

const halfUp = (x) => Math.floor(x + 0.5);

// Tables from the codes of a depth's streams to the widened integers of section 4.1, as bytes of the record:
// rate | c + 16 side | mean normal (2) | √S (3) | correlations + 128 (3) | support, low + 16 high (3) | albedo (3).
export function records(texel, d) {
  const n = texel.depths[d].n, bytes = new Uint8Array(16 * n);
  const read = Object.fromEntries(texel.streams.map((s) => [s.semantic, { q: s.q, k: s.k, codes: texel.codes(d, s) }]));
  const table = (name, f) => Uint8Array.from({ length: 256 }, (_, code) => f(code, read[name].q));
  const fill = (at, count, value) => {
    for (let i = 0; i < n; i++) for (let k = 0; k < count; k++) bytes[16 * i + at + k] = value;
  };
  const put = (name, at, f) => {
    const { codes, k } = read[name], wide = table(name, f);
    for (let i = 0; i < n; i++) for (let c = 0; c < k; c++) bytes[16 * i + at + c] = wide[codes[i * k + c]];
  };
  const wide = (code, q) => Math.min(255, halfUp(255 * code / q));
  put("RATE", 0, (code, q) => (code ? Math.min(255, 1 + halfUp(254 * (code - 1) / (q - 1))) : 0));
  fill(4, 3, 255);
  fill(7, 3, 128);
  fill(13, 3, 255);
  if (read.CORR) put("CORR", 1, (code, q) => halfUp(15 * code / q));
  if (read.SIDE) {
    const { codes, q } = read.SIDE;
    for (let i = 0; i < n; i++) bytes[16 * i + 1] |= halfUp(15 * codes[i] / q) << 4;
  }
  if (read.MEAN) put("MEAN", 2, wide);
  if (read.NDFD) {
    const { codes, q } = read.NDFD;
    for (let i = 0; i < n; i++) {
      const k = codes[3 * i];
      bytes[16 * i + 4 + (k + 1) % 3] = wide(codes[3 * i + 1], q);
      bytes[16 * i + 4 + (k + 2) % 3] = wide(codes[3 * i + 2], q);
    }
  }
  if (read.NDFC) put("NDFC", 7, (code, q) => 128 + Math.sign(code - q / 2) * halfUp(127 * Math.abs(code - q / 2) / (q / 2)));
  if (read.SUPP) {
    put("SUPP", 10, (code, q) => {
      const s = Math.round(Math.sqrt(q + 1)), low = 16 / s * (code % s);
      return low + 16 * Math.min(16 / s * Math.floor(code / s), 15 - low);
    });
  }
  if (read.ALBD) put("ALBD", 13, wide);
  return bytes;
}

// The material that is seen most, of every voxel; null where there are fewer than two.
export function mainMaterials(texel, d, bytes) {
  const stream = texel.streams.find((s) => s.semantic === "MATL");
  if (!stream) return null;
  const codes = texel.codes(d, stream), { k, q } = stream, out = new Uint8Array(bytes.length / 16);
  for (let i = 0; i < out.length; i++) {
    const shares = texel.shares(Array.from(codes.subarray(i * k, (i + 1) * k)), q, Array.from(bytes.subarray(16 * i + 13, 16 * i + 16)));
    out[i] = shares.indexOf(Math.max(...shares));
  }
  return out;
}

// Walks the topology once; keeps the positions of the depths that it has reached.
export class Positions {
  constructor(texel) {
    this.texel = texel;
    this.depths = [{ at: new Uint16Array(texel.depths[0].n ? 3 : 0), masks: null }];
  }

  // {at: x, y, z of each voxel, masks: child masks or null at the finest}.
  depth(d) {
    while (this.depths.length <= d) this.grow();
    const own = this.depths[d];
    if (!own.masks && d + 1 < this.texel.depths.length) own.masks = this.texel.masks(d + 1);
    return own;
  }

  grow() {
    const above = this.depth(this.depths.length - 1), next = new Uint16Array(3 * this.texel.depths[this.depths.length].n);
    let to = 0;
    for (let i = 0; i < above.masks.length; i++) {
      for (let c = 0, mask = above.masks[i]; mask; c++, mask >>= 1) {
        if (!(mask & 1)) continue;
        next[to++] = 2 * above.at[3 * i] + (c & 1);
        next[to++] = 2 * above.at[3 * i + 1] + (c >> 1 & 1);
        next[to++] = 2 * above.at[3 * i + 2] + (c >> 2);
      }
    }
    this.depths.push({ at: next, masks: null });
  }
}

// Mean luminance of the texel's albedo: that of the voxel that is all of it; 1 where it has no colours.
export function luminance(texel) {
  if (!texel.depths[0].n) return 1;
  const rgb = [13, 14, 15].map((k) => (records(texel, 0)[k] / 255) ** 2);
  return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

// {low, high, rings}: the box around all voxels as they are known at depth d, in cube edges, and of each level at which a voxel
// begins or ends how far the voxels there are from the upright line through the box's middle: [w, radius].
export function extent(positions, d) {
  const [low, high, boxes, rings] = [[1, 1, 1], [0, 0, 0], [], new Map()];
  for (let e = 0; e <= d; e++) {
    const { at, masks } = positions.depth(e), step = 2 ** -e;
    for (let i = 0; 3 * i < at.length; i++) {
      if (e < d && masks[i]) continue;
      const from = [0, 1, 2].map((k) => at[3 * i + k] * step);
      from.forEach((v, k) => [low[k], high[k]] = [Math.min(low[k], v), Math.max(high[k], v + step)]);
      boxes.push([...from, step]);
    }
  }
  const [x, y] = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
  for (const [u, v, w, step] of boxes) {
    const away = Math.hypot(Math.max(x - u, u + step - x), Math.max(y - v, v + step - y));
    for (const level of [w, w + step]) rings.set(level, Math.max(rings.get(level) ?? 0, away));
  }
  if (!boxes.length) return { low: [0, 0, 0], high: [1, 1, 1], rings: [[0, 1], [1, 1]] };
  return { low, high, rings: [...rings] };
}

// Steps of the rate's code by which a voxel's rate falls when it is cut in two along each axis.
const HALVED = 16;

// Bricks of depth d: {cells, index, across, atlas, bytes, materials}. `index`: for each of cells³ bricks its number in the atlas
// plus one, 0 where there is none. The atlas is a cube of `across` bricks a side. Throws where it would take more than `most` bytes.
export function bricks(texel, positions, d, most) {
  const side = 2 ** d, cells = Math.max(1, side / BRICK), index = new Uint32Array(cells ** 3);
  const solid = [], list = [];
  let count = 0;
  const brickOf = (x, y, z) => {
    const at = (x >> 3) + cells * ((y >> 3) + cells * (z >> 3));
    return index[at] || (index[at] = ++count);
  };
  for (let e = 0; e <= d; e++) {
    const { at, masks } = positions.depth(e), step = 2 ** (d - e);
    for (let i = 0; 3 * i < at.length; i++) {
      if (e < d && masks[i]) continue;
      const [x, y, z] = [at[3 * i] * step, at[3 * i + 1] * step, at[3 * i + 2] * step];
      if (step >= BRICK) {
        // The inside of a solid: all its bricks are one.
        solid.push([e, i, x, y, z, step]);
      } else {
        brickOf(x, y, z);
        list.push([e, i, x, y, z, step]);
      }
    }
  }
  const shared = solid.length ? count + 1 : 0, total = count + (shared ? 1 : 0);
  const across = Math.max(1, Math.ceil(Math.cbrt(total))), edge = across * BRICK, mixed = texel.streams.some((s) => s.semantic === "MATL");
  if (edge ** 3 * (mixed ? 17 : 16) > most) throw new RangeError("too large to be shown");
  const atlas = new Uint8Array(16 * edge ** 3), materials = mixed ? new Uint8Array(edge ** 3) : null;
  const kept = new Map();
  const recordsOf = (e) => {
    if (!kept.has(e)) {
      const bytes = records(texel, e);
      kept.set(e, { bytes, materials: mainMaterials(texel, e, bytes) });
    }
    return kept.get(e);
  };
  const write = (brick, x, y, z, e, i) => {
    const b = brick - 1, bx = b % across, by = Math.floor(b / across) % across, bz = Math.floor(b / across ** 2);
    const at = bx * BRICK + (x & 7) + edge * (by * BRICK + (y & 7) + edge * (bz * BRICK + (z & 7)));
    const own = recordsOf(e);
    atlas.set(own.bytes.subarray(16 * i, 16 * i + 16), 16 * at);
    if (materials && own.materials) materials[at] = own.materials[i];
    const rate = own.bytes[16 * i];
    if (e < d) {
      atlas[16 * at] = rate === 255 ? 255 : Math.max(rate ? 1 : 0, rate - HALVED * (d - e));
      atlas.fill(0, 16 * at + 10, 16 * at + 13);
    }
  };
  for (const [e, i, x, y, z, step] of list) {
    for (let k = 0; k < step ** 3; k++) {
      const [cx, cy, cz] = [x + k % step, y + Math.floor(k / step) % step, z + Math.floor(k / step ** 2)];
      write(brickOf(cx, cy, cz), cx, cy, cz, e, i);
    }
  }
  if (shared) {
    const [e, i] = solid[0];
    for (let k = 0; k < BRICK ** 3; k++) write(shared, k & 7, k >> 3 & 7, k >> 6, e, i);
    for (const [, , x, y, z, step] of solid) {
      for (let bz = z >> 3; bz < (z + step) >> 3; bz++) {
        for (let by = y >> 3; by < (y + step) >> 3; by++) {
          const row = cells * (by + cells * bz);
          index.fill(shared, row + (x >> 3), row + ((x + step) >> 3));
        }
      }
    }
  }
  return { depth: d, side, cells, index, across, atlas, materials };
}
