"""A scene of `vtex export`, rendered by Mitsuba 3, against vtex's picture by the same camera: what both cover of it.

mitsuba_scene.py VTEX TEXEL SCENE.xml FOLDER: SCENE.xml is TEXEL's; pictures go to FOLDER.
"""

import pathlib
import re
import subprocess
import sys

import mitsuba as mi
import numpy as np

import splats

SIDE, SAMPLES = 160, 32
# With 32 samples a pixel the share that 25 600 pixels cover has a standard error below 0.0006. What is left is that Mitsuba has
# neither boxes smaller than a voxel nor matter that hides itself in a block; 0.0006 was seen.
MOST_OFF = 0.003


def main(vtex, texel, scene, folder):
    vtex, texel, folder = pathlib.Path(vtex).resolve(), pathlib.Path(texel), pathlib.Path(folder)
    mi.set_variant("scalar_rgb")
    picture = np.array(mi.render(mi.load_file(scene, spp=str(SAMPLES), size=str(SIDE)), seed=1))
    assert picture.shape == (SIDE, SIDE, 4) and np.isfinite(picture).all()
    write = lambda name, rgb: splats.write_png(folder / f"mitsuba-{name}.png", np.clip(rgb, 0, 1) ** (1 / 2.2))
    write("theirs", picture[..., :3])

    look = re.search(r'lookat origin="([^"]+)" target="([^"]+)"', pathlib.Path(scene).read_text())
    eye, centre = (text.replace(" ", "") for text in look.groups())
    fov = re.search(r'name="fov" value="([^"]+)"', pathlib.Path(scene).read_text())[1]
    land, own = splats.scene(texel, folder), {}
    for name, shade in (("black", "0,0,0"), ("white", "1,1,1")):
        path = folder / f"mitsuba-own-{name}.png"
        words = ["render", land, "-o", path, f"--eye={eye}", f"--look-at={centre}", "--fov", fov, "--size", f"{SIDE}x{SIDE}", "--sky",
                 "1,1,1", "--background", shade, "--ambient", "constant", "--tonemap", "none", "--lanes", "16", "--near", "voxels", "-q"]
        subprocess.run([vtex, *map(str, words)], check=True)
        own[name] = splats.linear(splats.read_png(path))
    cover = 1 - (own["white"] - own["black"]).mean(2)
    theirs, ours = picture[..., 3].mean(), cover.mean()
    apart = abs(picture[..., 3] - cover)[cover > 0.004].mean()
    print(f"Mitsuba {mi.__version__}: covers {theirs:.4f} of the picture, vtex {ours:.4f} (|Δ| {apart:.3f} where matter is, at "
          f"{SIDE}², {SAMPLES} and 16 samples)", flush=True)
    assert ours > 0.05 and abs(theirs - ours) < MOST_OFF


if __name__ == "__main__":
    main(*sys.argv[1:])
