"""Splats of a texel, drawn by a rasteriser of their own (NumPy alone), against pictures by vtex from eight views.

splats.py VTEX TEXEL FOLDER [DEPTH]: exports TEXEL as .ply and as .glb, checks that both say the same, and writes pictures to FOLDER.
"""

import json
import pathlib
import struct
import subprocess
import sys
import zlib

import numpy as np

SIDE, FOV = 384, 40.0
SH_0 = 0.28209479177387814
# Added to the variance of a splat in the picture, pixels², by the first renderer of splats and most that followed: no splat
# is thinner than a pixel.
DILATION = 0.3


def read_ply(path):
    """The columns of a binary .ply of floats, by name."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode().splitlines()
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    rows = np.frombuffer(data, "<f4", count * len(names), end).reshape(count, len(names)).astype(float)
    return {name: rows[:, i] for i, name in enumerate(names)}


def of_ply(path):
    """Centres, quaternions (x, y, z, w), deviations, opacities, and the colours that a screen shows, turned to +Y up."""
    c = read_ply(path)
    stack = lambda *names: np.stack([c[name] for name in names], 1)
    # Half a turn about z, back: (0, 0, -1, 0) times the quaternion.
    turn = stack("rot_2", "rot_1", "rot_0", "rot_3") * [1, -1, -1, 1]
    return (
        stack("x", "y", "z") * [-1, -1, 1],
        turn / np.linalg.norm(turn, axis=1, keepdims=True),
        np.exp(stack("scale_0", "scale_1", "scale_2")),
        1 / (1 + np.exp(-c["opacity"])),
        0.5 + SH_0 * stack("f_dc_0", "f_dc_1", "f_dc_2"),
    )


def of_glb(path):
    """The same of a .glb with KHR_gaussian_splatting."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    doc, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    assert "KHR_gaussian_splatting" in doc["extensionsUsed"]
    primitive = doc["meshes"][0]["primitives"][0]
    said = primitive["extensions"]["KHR_gaussian_splatting"]
    assert primitive["mode"] == 0 and said == {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}, said

    def values(name):
        accessor = doc["accessors"][primitive["attributes"][name]]
        view = doc["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        flat = np.frombuffer(binary, "<f4", accessor["count"] * width, view.get("byteOffset", 0))
        return flat.reshape(-1, width).astype(float)

    own = "KHR_gaussian_splatting:"
    harmonic = 0.5 + SH_0 * values(own + "SH_DEGREE_0_COEF_0")
    return values("POSITION"), values(own + "ROTATION"), values(own + "SCALE"), values(own + "OPACITY")[:, 0], harmonic


def matrices(q):
    x, y, z, w = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def rasterise(splats, eye, target, dilation):
    """Colour over black as a screen shows it, and opacity: front to back, as Kerbl et al. 2023."""
    centre, turn, deviations, opacity, colour = splats
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    camera = np.stack([right, np.cross(ahead, right), ahead])  # right, down, ahead
    p = (centre - eye) @ camera.T
    focal = SIDE / 2 / np.tan(np.radians(FOV / 2))
    x, y, z = p.T
    axes = camera @ (matrices(turn) * deviations[:, None, :])
    covariance = axes @ axes.transpose(0, 2, 1)
    zero = np.zeros_like(z)
    j = np.array([[focal / z, zero, -focal * x / z**2], [zero, focal / z, -focal * y / z**2]]).transpose(2, 0, 1)
    flat = j @ covariance @ j.transpose(0, 2, 1)
    a, b, c = flat[:, 0, 0] + dilation, flat[:, 0, 1], flat[:, 1, 1] + dilation
    det = np.maximum(a * c - b * b, 1e-12)
    u, v = SIDE / 2 + focal * x / z, SIDE / 2 + focal * y / z
    reach = 3 * np.sqrt(np.maximum(a, c))
    picture, through = np.zeros((SIDE, SIDE, 3)), np.ones((SIDE, SIDE))
    for i in np.argsort(z):
        x0, x1 = max(0, int(u[i] - reach[i])), min(SIDE, int(u[i] + reach[i]) + 2)
        y0, y1 = max(0, int(v[i] - reach[i])), min(SIDE, int(v[i] + reach[i]) + 2)
        if z[i] <= 0.1 or x0 >= x1 or y0 >= y1:
            continue
        dx = np.arange(x0, x1) + 0.5 - u[i]
        dy = (np.arange(y0, y1) + 0.5 - v[i])[:, None]
        far = (c[i] * dx * dx - 2 * b[i] * dx * dy + a[i] * dy * dy) / det[i]
        alpha = np.minimum(0.99, opacity[i] * np.exp(-0.5 * far)) * (far < 9)
        block = through[y0:y1, x0:x1]
        picture[y0:y1, x0:x1] += (block * alpha)[..., None] * colour[i]
        block *= 1 - alpha
    return picture, 1 - through


def write_png(path, picture):
    rows = np.round(np.clip(picture, 0, 1) * 255).astype(np.uint8)
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    head = struct.pack(">IIBBBBB", rows.shape[1], rows.shape[0], 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


def read_png(path):
    """8-bit RGB without interlacing, as vtex writes it."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height = struct.unpack_from(">II", body)
        if kind == b"IDAT":
            packed += body
        at += 12 + length
    raw = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    out = np.zeros((height, 3 * width), np.uint8)
    for y in range(height):
        kind, row = raw[y, 0], raw[y, 1:].astype(int)
        above = out[y - 1].astype(int) if y else np.zeros(3 * width, int)
        for k in range(0, 3 * width, 3) if kind in (1, 3, 4) else [None]:
            if k is None:
                out[y] = (row + (above if kind == 2 else 0)) & 255
                continue
            left = out[y, k - 3 : k].astype(int) if k else np.zeros(3, int)
            corner = above[k - 3 : k] if k else np.zeros(3, int)
            up = above[k : k + 3]
            guess = left + up - corner
            off = [abs(guess - left), abs(guess - up), abs(guess - corner)]
            paeth = np.where((off[0] <= off[1]) & (off[0] <= off[2]), left, np.where(off[1] <= off[2], up, corner))
            out[y, k : k + 3] = (row[k : k + 3] + {1: left, 3: (left + up) // 2, 4: paeth}[int(kind)]) & 255
    return out.reshape(height, width, 3) / 255


def linear(c):
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def scene(texel, folder):
    """A landscape of one copy without light but the sky's."""
    corners = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    (folder / "corners.bin").write_bytes(corners)
    name = "VTEX_volumetric_texture"
    (folder / texel.name).write_bytes(texel.read_bytes())
    doc = {
        "asset": {"version": "2.0"},
        "extensionsUsed": [name, "KHR_lights_punctual"],
        "extensions": {
            name: {"texels": [{"name": "t", "frames": [{"uri": texel.name}]}]},
            "KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 0}]},
        },
        "buffers": [{"uri": "corners.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "materials": [{"extensions": {name: {"copies": {"texel": 0}}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "nodes": [{"mesh": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
    }
    path = folder / "one.gltf"
    path.write_text(json.dumps(doc))
    return path


def main(vtex, texel, folder, depth="7"):
    vtex, texel, folder = pathlib.Path(vtex).resolve(), pathlib.Path(texel), pathlib.Path(folder)
    run = lambda *words: subprocess.run([vtex, *map(str, words)], check=True, capture_output=True, text=True).stdout
    run("export", texel, "-o", folder / "s.ply", "--depth", depth, "-q")
    run("export", texel, "-o", folder / "s.glb", "--form", "splats", "--depth", depth, "-q")
    splats, other = of_ply(folder / "s.ply"), of_glb(folder / "s.glb")
    for a, b, what in zip(splats, other, ["centres", "turns", "deviations", "opacities", "colours"]):
        # Logarithms and logits of 32 bits lose a little.
        assert np.allclose(a, b, rtol=2e-5, atol=2e-6), f"{what} of .ply and .glb differ by {abs(a - b).max()}"
    centre = (splats[0].min(0) + splats[0].max(0)) / 2
    size = np.linalg.norm(splats[0].max(0) - splats[0].min(0))
    land, rows, eyes = scene(texel, folder), [], []
    for view in range(8):
        turn, up = np.radians(45 * view), np.radians([5, 25, 50][view % 3])
        eye = centre + 1.25 * size * np.array([np.cos(turn) * np.cos(up), np.sin(up), np.sin(turn) * np.cos(up)])
        eyes.append(eye.tolist())
        point = lambda p: ",".join(f"{x:.6f}" for x in p)
        own = {}
        for name, shade in (("black", "0,0,0"), ("white", "1,1,1")):
            path = folder / f"own-{view}-{name}.png"
            run("render", land, "-o", path, f"--eye={point(eye)}", f"--look-at={point(centre)}", "--fov", FOV, "--size", f"{SIDE}x{SIDE}",
                "--sky", "1,1,1", "--background", shade, "--ambient", "constant", "--tonemap", "none", "--lanes", 4, "--near", "voxels", "-q")
            own[name] = linear(read_png(path))
        cover = 1 - (own["white"] - own["black"]).mean(2)
        row = [cover.mean()]
        for dilation in (0, DILATION):
            picture, alpha = rasterise(splats, eye, centre, dilation)
            path = folder / f"splats-{view}-{dilation}.png"
            write_png(path, picture)
            found = json.loads(run("compare", path, folder / f"own-{view}-black.png", "--json", "-q"))
            row += [alpha.mean() / cover.mean(), abs(alpha - cover)[cover > 0.004].mean(), found["all"]["flip"], found["all"]["psnr_srgb"]]
        rows.append(row)
        print(f"view {view}: cover {row[0]:.4f}; of the splats {row[1]:.3f} of it, FLIP {row[3]:.4f}, PSNR {row[4]:.1f} dB; "
              f"at least a pixel wide {row[5]:.3f}, FLIP {row[7]:.4f}, PSNR {row[8]:.1f} dB", flush=True)
    (folder / "views.json").write_text(json.dumps({"side": SIDE, "fov": FOV, "centre": centre.tolist(), "eyes": eyes}))
    mean = np.mean(rows, 0)
    print(f"{len(splats[0])} splats, mean of 8 views at {SIDE}²: cover {mean[1]:.3f} of ours (|Δ| {mean[2]:.3f} where matter is), "
          f"FLIP {mean[3]:.4f}, PSNR {mean[4]:.1f} dB; at least a pixel wide {mean[5]:.3f} (|Δ| {mean[6]:.3f}), FLIP {mean[7]:.4f}, "
          f"PSNR {mean[8]:.1f} dB")
    return mean


if __name__ == "__main__":
    main(*sys.argv[1:])
