"""What the codes that reader.py reads mean: sections 4.1, 4.2 and 11 of vtex-1.md."""
import numpy as np

SEMANTICS = ("RATE", "NDFD", "NDFC", "CORR", "SUPP", "SIDE", "MEAN", "ALBD", "MATL")


def half_up(x):
    return np.floor(np.asarray(x, float) + 0.5).astype(np.int64)


def fields(texel, d):
    """The widened integers of a depth's voxels, by the table of section 4.1."""
    n = texel.depths[d][0]
    c = {s.semantic: (texel.codes(d, s), s.q) for s in texel.streams if s.semantic in SEMANTICS}
    wide = lambda q, most: half_up(255 * q / most)
    rate, q = c.get("RATE", (np.ones((n, 1), int), 2))
    rate = np.where(rate == 0, 0, 1 + half_up(254 * (rate - 1) / (q - 1)))[:, 0]
    root = np.full((n, 3), 255)
    if "NDFD" in c:
        k, q = c["NDFD"]
        rows = np.arange(n)
        for step in (1, 2):
            root[rows, (k[:, 0] + step) % 3] = wide(k[:, step], q)
    corr = np.zeros((n, 3), int)
    if "NDFC" in c:
        k, q = c["NDFC"]
        corr = half_up(127 * abs(k - q // 2) / (q // 2)) * np.sign(k - q // 2)
        for pair, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            corr[(root[:, i] == 0) | (root[:, j] == 0), pair] = 0
    fifteenths = lambda name: half_up(15 * c[name][0] / c[name][1])[:, 0] if name in c else np.zeros(n, int)
    low, high = np.zeros((n, 3), int), np.zeros((n, 3), int)
    if "SUPP" in c:
        k, q = c["SUPP"]
        s = round((q + 1) ** 0.5)
        low, high = 16 // s * (k % s), 16 // s * (k // s)
        high = np.where(low + high > 15, 15 - low, high)
    mean = wide(*c["MEAN"]) if "MEAN" in c else np.full((n, 2), 128)
    side = fifteenths("SIDE")
    albedo = wide(*c["ALBD"]) if "ALBD" in c else np.full((n, 3), 255)
    out = dict(rate=rate, root=root, corr=corr, block=fifteenths("CORR"), low=low, high=high, side=side, mean=mean, albedo=albedo)
    out["mean"] = np.where((side > 0)[:, None], mean, 0)
    for name in set(out) - {"rate"}:
        out[name] = np.where((rate == 0).reshape((n,) + (1,) * (out[name].ndim - 1)), 255 if name in ("root", "albedo") else 0, out[name])
    return out


def shares(texel, d, albedo):
    """The shares of the materials of a depth's voxels, of 63: an array of n × M."""
    stream = next((s for s in texel.streams if s.semantic == "MATL"), None)
    if stream is None:
        return None
    c, m = texel.codes(d, stream), stream.q + 1
    out = np.zeros((len(c), m), int)
    rows = np.arange(len(c))
    if m <= 4:
        out[:, 1:] = c
        out[:, 0] = 63 - c.sum(axis=1)
    else:
        out[rows, c[:, 0]] += 63 - c[:, 4:].sum(axis=1)
        for k in (1, 2, 3):
            out[rows, c[:, k]] += c[:, 3 + k]
    colours = half_up(255 * np.sqrt(np.array([x["albedo"] for x in texel.meta["materials"]])))
    likely = ((colours[None] - albedo[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    first = out[:, 0].copy()
    out[:, 0] = out[rows, likely]
    out[rows, likely] = np.where(likely == 0, out[rows, likely], first)
    return out


def surfaces(texel):
    """The materials' properties besides their albedo, in ten-thousandths, where any has one: section 6.1."""
    rows = [[*s.get("transmission", [0] * 3), s.get("unlit", 0), s.get("oneSided", 0)] for s in texel.meta.get("surfaces", [])]
    if np.any(rows):
        yield from (" ".join(map(str, ["surface", i, *half_up(1e4 * np.array(row))])) for i, row in enumerate(rows))


def dump(texel, only=None):
    """The plain text of section 11."""
    yield f"depths {len(texel.depths)} up {texel.up} cyclic {texel.cyclic} model {texel.meta['model']}"
    yield from surfaces(texel)
    for d, (at, terminal) in enumerate(texel.positions()):
        if only is not None and d != only:
            continue
        yield f"depth {d} voxels {len(at)}"
        f = fields(texel, d)
        mix = shares(texel, d, f["albedo"])
        columns = [at, f["rate"], f["root"], f["corr"], f["block"], f["low"], f["high"], f["side"], f["mean"], f["albedo"]]
        rows = np.column_stack(columns + ([mix] if mix is not None else []))
        for row, end in zip(rows, terminal):
            yield " ".join(map(str, row)) + (" t" if end and d + 1 < len(texel.depths) else "")
