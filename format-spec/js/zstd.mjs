// A decoder of one zstd frame (RFC 8878) without a dictionary, for pages of .vtex files. No dependencies.
// decompress(bytes, size): `size` is what the frame must give; anything else throws.

const fail = (what) => { throw new Error(`zstd: ${what}`); };

// Bits from the end of bytes backward, as FSE and Huffman streams are read.
class BackwardBits {
  constructor(bytes) {
    const last = bytes[bytes.length - 1];
    if (!last) fail("a bit stream without its end mark");
    this.bytes = bytes;
    this.at = bytes.length * 8 - Math.clz32(last) + 24 - 1; // bits that are left
  }

  // n ≤ 25 bits; those before the start are 0.
  peek(n) {
    const low = this.at - n;
    if (low < 0) return this.at > 0 ? this.grab(0, this.at) << -low : 0;
    return this.grab(low, n);
  }

  grab(low, n) {
    const b = this.bytes, i = low >> 3;
    return ((b[i] | (b[i + 1] << 8) | (b[i + 2] << 16) | (b[i + 3] << 24)) >>> (low & 7)) & ((1 << n) - 1);
  }

  // n ≤ 31 bits.
  read(n) {
    if (n > 24) return this.read(n - 16) * 65536 + this.read(16);
    const value = n ? this.peek(n) : 0;
    this.at -= n;
    return value;
  }
}

// Probabilities of an FSE table from forward bits: [counts, accuracy, bytes read].
function readCounts(bytes, most) {
  let at = 0;
  const read = (n) => {
    let value = 0;
    for (let i = 0; i < n; i++) value |= ((bytes[(at + i) >> 3] >> ((at + i) & 7)) & 1) << i;
    at += n;
    return value;
  };
  const accuracy = read(4) + 5;
  if (accuracy > most) fail("an FSE table that is too accurate");
  const counts = [];
  let left = 1 << accuracy;
  while (left > 0) {
    const bits = 32 - Math.clz32(left + 1);
    let value = read(bits);
    const lower = (1 << (bits - 1)) - 1;
    const threshold = (1 << bits) - 1 - (left + 1);
    if ((value & lower) < threshold) {
      at--;
      value &= lower;
    } else if (value > lower) {
      value -= threshold;
    }
    const count = value - 1;
    left -= Math.abs(count);
    counts.push(count);
    if (count === 0) {
      for (let more = 3; more === 3;) {
        more = read(2);
        for (let i = 0; i < more; i++) counts.push(0);
      }
    }
    if (at > bytes.length * 8 || counts.length > 256) fail("an FSE table that never ends");
  }
  if (left) fail("an FSE table with too many states");
  return [counts, accuracy, (at + 7) >> 3];
}

function fseTable(counts, accuracy) {
  const size = 1 << accuracy, symbols = new Uint8Array(size), next = Array.from(counts);
  let high = size - 1;
  counts.forEach((count, symbol) => {
    if (count !== -1) return;
    symbols[high--] = symbol;
    next[symbol] = 1;
  });
  const step = (size >> 1) + (size >> 3) + 3;
  let at = 0;
  counts.forEach((count, symbol) => {
    for (let i = 0; i < count; i++) {
      symbols[at] = symbol;
      do at = (at + step) & (size - 1); while (at > high);
    }
  });
  const bits = new Uint8Array(size), base = new Uint16Array(size);
  for (let state = 0; state < size; state++) {
    const n = next[symbols[state]]++;
    bits[state] = accuracy - (31 - Math.clz32(n));
    base[state] = (n << bits[state]) - size;
  }
  return { symbols, bits, base, accuracy };
}

const one = (symbol) => ({ symbols: [symbol], bits: [0], base: [0], accuracy: 0 });

// Weights of Huffman codes → table of [symbol, bits] by the next bits; [table, bytes read].
function huffman(bytes) {
  const header = bytes[0];
  let weights = [], used;
  if (header >= 128) {
    const n = header - 127;
    for (let i = 0; i < n; i++) weights.push(i & 1 ? bytes[1 + (i >> 1)] & 15 : bytes[1 + (i >> 1)] >> 4);
    used = 1 + ((n + 1) >> 1);
  } else {
    used = 1 + header;
    const [counts, accuracy, start] = readCounts(bytes.subarray(1, used), 6);
    const table = fseTable(counts, accuracy), bits = new BackwardBits(bytes.subarray(1 + start, used));
    const states = [bits.read(accuracy), bits.read(accuracy)];
    for (let turn = 0; ; turn ^= 1) {
      const state = states[turn];
      weights.push(table.symbols[state]);
      if (bits.at < table.bits[state] || weights.length > 254) {
        weights.push(table.symbols[states[turn ^ 1]]);
        break;
      }
      states[turn] = table.base[state] + bits.read(table.bits[state]);
    }
  }
  const sum = weights.reduce((total, w) => total + (w ? 1 << (w - 1) : 0), 0);
  if (!sum) fail("a Huffman tree without a code");
  const depth = 32 - Math.clz32(sum), rest = (1 << depth) - sum;
  if (rest & (rest - 1) || depth > 11) fail("Huffman weights that do not add up");
  weights.push(32 - Math.clz32(rest));
  const symbols = new Uint8Array(1 << depth), lengths = new Uint8Array(1 << depth);
  let at = 0;
  for (let w = 1; w <= depth; w++) {
    weights.forEach((weight, symbol) => {
      if (weight !== w) return;
      symbols.fill(symbol, at, at + (1 << (w - 1)));
      lengths.fill(depth + 1 - w, at, at + (1 << (w - 1)));
      at += 1 << (w - 1);
    });
  }
  return [{ symbols, lengths, depth }, used];
}

function huffmanStream(table, bytes, out, from, count) {
  const bits = new BackwardBits(bytes);
  for (let i = 0; i < count; i++) {
    const code = bits.peek(table.depth);
    out[from + i] = table.symbols[code];
    bits.at -= table.lengths[code];
  }
  if (bits.at !== 0) fail("a Huffman stream of another length");
}

// Base value and extra bits of each code.
const codes = (bits, start) => {
  let base = start;
  return bits.map((n) => {
    const entry = [base, n];
    base += 2 ** n;
    return entry;
  });
};
const zeros = (n) => new Array(n).fill(0);
const LITERALS = codes([...zeros(16), 1, 1, 1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 0);
const MATCHES = codes([...zeros(32), 1, 1, 1, 1, 2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16], 3);
const PREDEFINED = [
  fseTable([4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1], 6),
  fseTable([1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1], 5),
  fseTable([1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
    1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1], 6),
];
const ACCURACY = [9, 8, 9], LARGEST = [35, 31, 52];

class Frame {
  constructor(out) {
    this.out = out;
    this.size = 0;
    this.recent = [1, 4, 8];
    this.tables = [null, null, null];
    this.tree = null;
  }

  put(bytes) {
    if (this.size + bytes.length > this.out.length) fail("more content than the frame says");
    this.out.set(bytes, this.size);
    this.size += bytes.length;
  }

  compressed(block) {
    const [literals, start] = this.literals(block);
    let at = start, used = 0;
    const count = block[at] < 128 ? block[at++]
      : block[at] < 255 ? ((block[at++] - 128) << 8) + block[at++] : block[at + 1] + (block[(at += 3) - 1] << 8) + 0x7f00;
    if (count) {
      const modes = block[at++];
      const tables = [0, 1, 2].map((kind) => {
        const mode = (modes >> (6 - 2 * kind)) & 3;
        if (mode === 0) return (this.tables[kind] = PREDEFINED[kind]);
        if (mode === 1) return (this.tables[kind] = one(Math.min(block[at++], LARGEST[kind])));
        if (mode === 3) return this.tables[kind] ?? fail("a table is repeated that was not there");
        const [counts, accuracy, n] = readCounts(block.subarray(at), ACCURACY[kind]);
        if (counts.length > LARGEST[kind] + 1) fail("an FSE table of too many symbols");
        at += n;
        return (this.tables[kind] = fseTable(counts, accuracy));
      });
      used = this.sequences(block.subarray(at), tables, count, literals);
    }
    this.put(literals.subarray(used));
  }

  literals(block) {
    const type = block[0] & 3, format = (block[0] >> 2) & 3;
    if (type < 2) {
      const bytes = [1, 2, 1, 3][format];
      const size = (block[0] + (bytes > 1 ? block[1] << 8 : 0) + (bytes > 2 ? block[2] << 16 : 0)) >> (bytes === 1 ? 3 : 4);
      if (type === 0) return [block.subarray(bytes, bytes + size), bytes + size];
      if (size > 1 << 17) fail("too many literals");
      return [new Uint8Array(size).fill(block[bytes]), bytes + 1];
    }
    const bits = [10, 10, 14, 18][format], bytes = [3, 3, 4, 5][format];
    let header = 0;
    for (let i = 0; i < bytes; i++) header += block[i] * 2 ** (8 * i);
    const size = Math.floor(header / 16) % 2 ** bits, packed = Math.floor(header / 2 ** (4 + bits)) % 2 ** bits;
    let body = block.subarray(bytes, bytes + packed);
    if (body.length < packed || size > 1 << 17) fail("literals that are cut short");
    if (type === 2) {
      const [tree, n] = huffman(body);
      this.tree = tree;
      body = body.subarray(n);
    }
    if (!this.tree) fail("a Huffman tree is repeated that was not there");
    const out = new Uint8Array(size);
    if (format === 0) {
      huffmanStream(this.tree, body, out, 0, size);
    } else {
      const part = (size + 3) >> 2;
      let from = 6;
      for (let i = 0; i < 4; i++) {
        const end = i < 3 ? from + body[2 * i] + (body[2 * i + 1] << 8) : body.length;
        huffmanStream(this.tree, body.subarray(from, end), out, i * part, i < 3 ? part : size - 3 * part);
        from = end;
      }
    }
    return [out, bytes + packed];
  }

  sequences(bytes, tables, count, literals) {
    const bits = new BackwardBits(bytes);
    const state = tables.map((table) => bits.read(table.accuracy));
    let used = 0;
    for (let i = 0; i < count; i++) {
      const [literal, offset, match] = tables.map((table, kind) => table.symbols[state[kind]]);
      if (offset > 31 || literal > 35 || match > 52) fail("a code that does not exist");
      let distance = 2 ** offset + bits.read(offset);
      const length = MATCHES[match][0] + bits.read(MATCHES[match][1]);
      const copied = LITERALS[literal][0] + bits.read(LITERALS[literal][1]);
      distance = this.distance(distance, copied);
      if (used + copied > literals.length) fail("more literals than there are");
      this.put(literals.subarray(used, used + copied));
      used += copied;
      if (distance > this.size || this.size + length > this.out.length) fail("a match outside of the content");
      for (let k = 0; k < length; k++, this.size++) this.out[this.size] = this.out[this.size - distance];
      if (i + 1 < count) {
        for (const kind of [0, 2, 1]) state[kind] = tables[kind].base[state[kind]] + bits.read(tables[kind].bits[state[kind]]);
      }
    }
    if (bits.at !== 0) fail("sequences of another length");
    return used;
  }

  // The three most recent distances have codes of their own.
  distance(code, literals) {
    const recent = this.recent;
    if (code > 3) {
      this.recent = [code - 3, recent[0], recent[1]];
      return code - 3;
    }
    const which = code - 1 + (literals === 0 ? 1 : 0);
    const distance = which < 3 ? recent[which] : recent[0] - 1;
    if (distance < 1) fail("a distance of 0");
    if (which === 1) this.recent = [distance, recent[0], recent[2]];
    if (which > 1) this.recent = [distance, recent[0], recent[1]];
    return distance;
  }
}

export function decompress(bytes, size) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < 6 || view.getUint32(0, true) !== 0xfd2fb528) fail("not a frame");
  const descriptor = bytes[4], single = (descriptor >> 5) & 1, field = [single, 2, 4, 8][descriptor >> 6];
  if (descriptor & 8 || descriptor & 3) fail("a reserved bit, or a dictionary");
  let at = 5 + (single ? 0 : 1), content = 0;
  if (!field || at + field > bytes.length) fail("a frame without its size");
  for (let i = 0; i < field; i++) content += bytes[at + i] * 2 ** (8 * i);
  if (content + (field === 2 ? 256 : 0) !== size) fail("a frame of another size");
  at += field;
  const frame = new Frame(new Uint8Array(size));
  for (let last = 0; !last;) {
    if (at + 3 > bytes.length) fail("a block that is cut short");
    const header = bytes[at] + (bytes[at + 1] << 8) + (bytes[at + 2] << 16);
    at += 3;
    last = header & 1;
    const type = (header >> 1) & 3, length = header >> 3, stored = type === 1 ? 1 : length;
    if (type === 3 || at + stored > bytes.length || length > 1 << 17) fail("a block that cannot be");
    const body = bytes.subarray(at, at + stored);
    if (type === 0) frame.put(body);
    else if (type === 1) frame.put(new Uint8Array(length).fill(body[0]));
    else frame.compressed(body);
    at += stored;
  }
  if (at + (descriptor & 4 ? 4 : 0) !== bytes.length) fail("bytes behind the frame");
  if (frame.size !== size) fail("less content than the frame says");
  return frame.out;
}
