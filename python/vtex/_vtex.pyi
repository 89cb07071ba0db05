"""The native half of the package."""

import os
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Channel = Literal[
    "albedo", "correlation", "edge", "materials", "normal", "one_sidedness", "opacity", "rate", "sggx"
]
CHANNELS: list[str]

class Error(Exception):
    """A source, a texel or a landscape is not as it must be."""

class Depth:
    """The cells of one depth that hold matter, in Morton order.

    Where a node has no children, it stands for all cells below it: its ``edge`` is 2, 4, … instead of 1.

    Channels, ``depth["albedo"]``, all float32:

    ================  ==============  ==================================================================
    albedo            (n, 3)          linear Rec. 709, 0 … 1
    correlation       (n,)            how far the matter of a cell is one block, 0 … 1
    edge              (n,)            of the cell, in voxels of this depth
    materials         (n, materials)  share of each of the texel's materials, 0 … 1
    normal            (n, 3)          direction of the mean area vector along (u, v, w); 0 where there is none
    one_sidedness     (n,)            length of the mean area vector by area: 0 leaves, 1 the face of a solid
    opacity           (n,)            share of the light that the cell takes, mean over the three axes
    rate              (n,)            hits per edge of the cell, along the axis of the largest projected area
    sggx              (n, 6)          the distribution of normals: xx, yy, zz, xy, xz, yz along (u, v, w)
    ================  ==============  ==================================================================
    """

    @property
    def depth(self) -> int: ...
    @property
    def resolution(self) -> int:
        """Voxels along the cube's edge, 2**depth."""
    @property
    def positions(self) -> NDArray[np.uint32]:
        """(n, 3): each cell's low corner along (u, v, w), in voxels of this depth."""
    def __len__(self) -> int: ...
    def __getitem__(self, channel: Channel) -> NDArray[np.float32]: ...
    def grid(self, channel: Channel) -> NDArray[np.float32]:
        """A channel as a dense grid [u, v, w] or [u, v, w, component]: 0 where there is no matter; at most 4 GiB."""

class Texel:
    def __init__(self, path: str | os.PathLike[str], *, memory: int | None = None) -> None: ...
    @property
    def path(self) -> os.PathLike[str]: ...
    @property
    def depths(self) -> int: ...
    @property
    def counts(self) -> list[int]: ...
    def head_json(self) -> str: ...
    def depth(self, depth: int = -1, *, most: int = 1 << 28) -> Depth: ...

def run(words: list[str]) -> str: ...
def read_picture(path: str | os.PathLike[str]) -> NDArray[np.float32]: ...
