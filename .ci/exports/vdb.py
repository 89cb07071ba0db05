"""The grids of a .vdb as OpenVDB's own Python has them, against the grids that vtex writes for Mitsuba.

vdb.py VDB FOLDER: FOLDER has t-density.vol and t-albedo.vol of the same depth. Needs numpy, and pyopenvdb (Debian's python3-openvdb)
or openvdb (which bpy brings along).
"""

import pathlib
import struct
import sys

import numpy as np

try:
    import pyopenvdb as vdb
except ImportError:
    try:
        import openvdb as vdb
    except ImportError:
        # The one that bpy brings along.
        import importlib.util
        import sys

        found = next(pathlib.Path(importlib.util.find_spec("bpy").origin).parent.glob("*/python/lib/python3*/site-packages"))
        sys.path.append(str(found))
        import bpy  # noqa: F401: its libraries are those that openvdb wants

        import openvdb as vdb


def volume(path):
    """Values along x, y, z and channel."""
    data = pathlib.Path(path).read_bytes()
    x, y, z, channels = struct.unpack_from("<4i", data, 8)
    return np.frombuffer(data, "<f4", x * y * z * channels, 48).reshape(z, y, x, channels).transpose(2, 1, 0, 3)


def values(grid, n):
    """Dense, by its accessor, which every build of OpenVDB has."""
    out = np.zeros((n, n, n, 3 if grid.name == "color" else 1), np.float32)
    for item in grid.citerOnValues():
        low, high = item.min, item.max
        out[low[0] : high[0] + 1, low[1] : high[1] + 1, low[2] : high[2] + 1] = item.value
    return out


def main(path, folder):
    grids, metadata = vdb.readAll(str(path))
    grids = {grid.name: grid for grid in grids}
    assert set(grids) == {"density", "color"}, grids
    density, albedo = volume(f"{folder}/t-density.vol"), volume(f"{folder}/t-albedo.vol")
    n = density.shape[0]
    found, colour = values(grids["density"], n), values(grids["color"], n)
    filled = density[..., 0] > 0
    assert grids["density"].activeVoxelCount() == filled.sum(), (grids["density"].activeVoxelCount(), filled.sum())
    assert ((found[..., 0] > 0) == filled).all(), "matter lies where it is in the other grid"
    assert (colour == albedo).all(), "colours are the same"
    # Mitsuba's density is the one along the direction from which most facets are seen, in edges of the cube; the other is a mean.
    edge = grids["density"].transform.voxelSize()[0]
    share = found[filled, 0] * edge * n / density[filled, 0]
    assert 0.3 < share.min() and share.max() < 1.001, (share.min(), share.max())
    corner = grids["density"].transform.indexToWorld((-0.5, -0.5, -0.5))
    library = ".".join(map(str, vdb.LIBRARY_VERSION))
    print(f"OpenVDB {library}: {metadata}, {filled.sum()} voxels of {edge:.5f} m in each grid, the cube's corner at "
          f"{tuple(round(x, 4) for x in corner)}, mean density {share.mean():.3f} of the greatest")


if __name__ == "__main__":
    main(*sys.argv[1:])
