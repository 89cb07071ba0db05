"""Texels in Python: bake any 3D source, read the octree as numpy arrays, render landscapes.

>>> import numpy as np, vtex
>>> ball = np.linalg.norm(np.mgrid[-1:1:32j, -1:1:32j, -1:1:32j], axis=0) < 0.8
>>> texel = vtex.bake(ball.astype(np.float32), "ball.vtex", resolution=32, iso=0.5)
>>> texel.depth(3)["albedo"].shape
(n, 3)

Options are those of the command line, with underscores: ``vtex bake --max-symbols 9`` is ``max_symbols=9`` here. A flag is
``True``, an option that may be given several times is a list, and one that takes several values in one word is a tuple.
"""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _sources
from ._sources import Mesh
from ._vtex import CHANNELS, Depth, Error
from ._vtex import Texel as _Texel
from ._vtex import read_picture, run as _run

__all__ = ["CHANNELS", "Depth", "Error", "Mesh", "Texel", "bake", "command", "open", "read_picture", "render"]

PathLike = str | os.PathLike[str]


class Texel:
    """An open ``.vtex`` file: a prefiltered octree. Depth 0 is the root, depth d is cut into (2**d)**3 voxels."""

    def __init__(self, path: PathLike, *, memory: int | None = None) -> None:
        self._file = _Texel(path, memory=memory)
        head = json.loads(self._file.head_json())
        self.path = Path(path)
        #: Lower and upper corner of the box in source space that the cube covers.
        self.bounds: tuple[list[float], list[float]] = (head["bounds"]["min"], head["bounds"]["max"])
        #: Lower and upper corner of a box around all matter, in the cube along (u, v, w).
        self.content: tuple[list[float], list[float]] = (head["content"]["min"], head["content"]["max"])
        #: Metres per source unit; 0 where unknown.
        self.metres_per_unit: float = head["metres_per_unit"]
        #: Source axis that became w: 0 x, 1 y, 2 z.
        self.up: int = head["up"]
        #: Whether opposite faces match, along u, v, w.
        self.cyclic: list[bool] = head["cyclic"]
        #: Name and colour of each material, by id.
        self.materials: list[dict[str, Any]] = head["materials"]
        #: What else the file says of itself: sources, options of the bake, measured errors.
        self.meta: dict[str, Any] = head["meta"]

    @property
    def depths(self) -> int:
        """Number of depths that are open."""
        return self._file.depths

    @property
    def resolution(self) -> int:
        """Voxels along the cube's edge at the finest depth."""
        return 1 << max(self.depths - 1, 0)

    @property
    def counts(self) -> list[int]:
        """Nodes of each depth."""
        return self._file.counts

    def depth(self, depth: int = -1, *, most: int = 1 << 28) -> Depth:
        """The cells of a depth that hold matter; -1 is the finest.

        Raises IndexError where there is no such depth, :class:`Error` where it has more than ``most`` cells.
        """
        return self._file.depth(depth, most=most)

    def __repr__(self) -> str:
        return repr(self._file)


def open(path: PathLike, *, memory: int | None = None) -> Texel:
    """Open a texel; of its depths those that fit into ``memory`` bytes once decoded (2 GiB).

    Raises FileNotFoundError and its like, or :class:`Error` where the file is no valid texel.
    """
    return Texel(path, memory=memory)


def bake(source: PathLike | list[PathLike] | NDArray[Any] | Mesh, output: PathLike, **options: Any) -> Texel:
    """Turn a source into a texel, write it to ``output`` and open it.

    ``source`` is a file of any kind that ``vtex bake`` reads or a list of files; a 3D array [x, y, z] of values (``spacing``:
    three lengths in millimetres, ``iso`` or the others of ``vtex bake`` for image stacks); or a :class:`Mesh`.

    What a run of ``vtex bake`` would warn of is warned of by :mod:`warnings`. Raises ValueError for wrong options,
    :class:`Error` for a source that is not as it must be.
    """
    with tempfile.TemporaryDirectory(prefix="vtex-") as folder:
        files: list[PathLike]
        if isinstance(source, np.ndarray):
            files = [_sources.save_array(source, options.pop("spacing", (1.0, 1.0, 1.0)), Path(folder))]
        elif isinstance(source, Mesh):
            files = [source.save(Path(folder))]
        else:
            files = source if isinstance(source, list) else [source]
        command("bake", *files, output=output, **options)
    return Texel(output)


def render(landscape: PathLike, **options: Any) -> NDArray[np.float32]:
    """A picture of a landscape: float32 (height, width, 4), linear Rec. 709 radiance premultiplied by coverage, and coverage.

    ``size=(640, 360)``, ``camera="near"``, ``lanes=4``, ``time=1.5`` … as ``vtex render`` has them. No tone curve is laid on.
    """
    size = options.get("size")
    if isinstance(size, (tuple, list)):
        options["size"] = "{}x{}".format(*size)
    with tempfile.TemporaryDirectory(prefix="vtex-") as folder:
        picture = Path(folder) / "picture.exr"
        command("render", landscape, output=picture, **options)
        return read_picture(picture)


def command(name: str, *arguments: Any, **options: Any) -> dict[str, Any]:
    """Run any command of ``vtex`` in this process and return its ``--json`` result; warnings go to :mod:`warnings`.

    ``command("map", "ground.glb", texel="tree.vtex", output="land.gltf")``
    """
    report: dict[str, Any] = json.loads(_run([name, "--json", *_flags(options), "--", *map(_word, arguments)]) or "{}")
    for warning in report.pop("warnings", []):
        times = f" ({warning['count']} times)" if warning["count"] > 1 else ""
        warnings.warn(warning["message"] + times, stacklevel=3)
    return report


def _flags(options: dict[str, Any]) -> list[str]:
    """Keyword arguments as flags of the command line."""
    words: list[str] = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(flag)
        else:
            words += [f"{flag}={_word(one)}" for one in (value if isinstance(value, list) else [value])]
    return words


def _word(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_word, value))
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)
