"""The package against closed forms and against the command line's own results."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import vtex

SAMPLES = Path(__file__).parents[2] / "samples"


def sphere(n: int = 48, radius: float = 0.8) -> np.ndarray:
    """Signed distance, inside positive."""
    axis = (np.arange(n) + 0.5) / n * 2 - 1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return (radius - np.sqrt(x * x + y * y + z * z)).astype(np.float32)


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> vtex.Texel:
    return vtex.bake(sphere(), tmp_path_factory.mktemp("ball") / "ball.vtex", resolution=32, iso=0.0)


@pytest.fixture(scope="session")
def square(tmp_path_factory: pytest.TempPathFactory) -> vtex.Texel:
    mesh = vtex.Mesh([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 2, 1], [0, 3, 2]], color=(0.25, 0.5, 0.0))
    return vtex.bake(mesh, tmp_path_factory.mktemp("square") / "square.vtex", resolution=16)


def test_ball_is_as_wide_as_it_is(ball: vtex.Texel) -> None:
    shadow = ball.depth().grid("opacity").max(axis=2) > 0.5
    # The bounds hold the ball alone: its shadow is a disc that fills π/4 of the square, to a row of voxels at the rim.
    assert shadow.mean() == pytest.approx(math.pi / 4, abs=4 / ball.resolution)


def test_array_keeps_its_spacing_and_axes(tmp_path: Path) -> None:
    box = np.zeros((8, 10, 12), np.uint8)
    box[2:6, 3:7, 4:8] = 255
    texel = vtex.bake(box, tmp_path / "box.vtex", spacing=(1.0, 2.0, 4.0), resolution=16, iso=127.5)
    taken = np.argwhere(texel.depth().grid("opacity") > 0.5)
    cells = taken.max(axis=0) + 1 - taken.min(axis=0)
    size = cells / texel.resolution * (texel.bounds[1][0] - texel.bounds[0][0]) * texel.metres_per_unit * 1000
    # Four samples along each axis, 1, 2 and 4 mm apart. The box's side is halfway to the samples around it, and is seen to a
    # voxel of 1.5 mm (24 mm, which twelve samples span, in 16) at both ends.
    assert size == pytest.approx([4, 8, 16], abs=3)


def test_square_has_its_colour_and_normals(square: vtex.Texel) -> None:
    cells = square.depth()
    # Albedo is stored as the root in 8 bits.
    assert np.allclose(cells["albedo"], [0.25, 0.5, 0.0], atol=1 / 127)
    xx, yy, zz = cells["sggx"][:, :3].T
    assert (zz > 0.99).all() and (xx < 0.01).all() and (yy < 0.01).all(), "w is up"
    assert set(vtex.CHANNELS) >= {"albedo", "sggx", "rate"}


def test_grid_is_the_cells(square: vtex.Texel) -> None:
    for depth in range(square.depths):
        cells = square.depth(depth)
        grid = cells.grid("albedo")
        assert grid.shape == (2**depth,) * 3 + (3,) and grid.dtype == np.float32
        if (cells["edge"] == 1).all():
            u, v, w = cells.positions.T
            assert (grid[u, v, w] == cells["albedo"]).all()
            assert np.count_nonzero(grid.any(axis=3)) == len(cells)


def test_materials_sum_up_to_one(tmp_path: Path) -> None:
    texel = vtex.bake(SAMPLES / "tree.glb", tmp_path / "tree.vtex", resolution=32)
    shares = texel.depth(4)["materials"]
    assert shares.shape[1] == len(texel.materials) >= 2
    assert np.allclose(shares.sum(axis=1), 1, atol=1e-6)


def test_picture_is_the_one_of_the_command_line(tmp_path: Path) -> None:
    options = {"size": (48, 27), "ambient": "constant", "threads": 1}
    picture = vtex.render(SAMPLES / "terrain.glb", **options)
    assert picture.shape == (27, 48, 4) and picture.dtype == np.float32
    assert np.isfinite(picture).all() and picture[..., 3].max() == pytest.approx(1, abs=1e-3)
    report = vtex.command("render", SAMPLES / "terrain.glb", output=tmp_path / "p.exr", **options | {"size": "48x27"})
    assert (report["width"], report["height"]) == (48, 27)
    assert (vtex.read_picture(tmp_path / "p.exr") == picture).all()


def test_command_gives_what_the_terminal_shows(ball: vtex.Texel, capfd: pytest.CaptureFixture[str]) -> None:
    report = vtex.command("inspect", ball.path)
    assert report["resolution"] == ball.resolution and report["model"] == "coverage"
    baked = vtex.command("bake", SAMPLES / "tree.glb", output=ball.path.with_name("tree.vtex"), resolution=8)
    assert baked["resolution"] == 8, "also what a pool of threads of its own prints"
    assert capfd.readouterr() == ("", ""), "nothing is printed"


def test_faults_are_exceptions(tmp_path: Path, ball: vtex.Texel) -> None:
    with pytest.raises(FileNotFoundError, match="missing.vtex"):
        vtex.open(tmp_path / "missing.vtex")
    (tmp_path / "text.vtex").write_text("no texel at all" * 20)
    with pytest.raises(vtex.Error, match="not a valid vtex file"):
        vtex.open(tmp_path / "text.vtex")
    with pytest.raises(ValueError, match="resolution"):
        vtex.bake(sphere(8), tmp_path / "x.vtex", resolution=-3)
    with pytest.raises(ValueError, match="three axes"):
        vtex.bake(np.zeros((3, 3)), tmp_path / "x.vtex")
    with pytest.raises(ValueError, match="complex"):
        vtex.bake(np.zeros((3, 3, 3), complex), tmp_path / "x.vtex")
    with pytest.raises(ValueError, match="beyond the 3"):
        vtex.bake(vtex.Mesh(np.eye(3), [[0, 1, 3]]), tmp_path / "x.vtex")
    with pytest.raises(KeyError, match="albedo"):
        ball.depth(2)["colour"]  # type: ignore[index]
    with pytest.raises(IndexError, match="no depth 40"):
        ball.depth(40)
    with pytest.raises(vtex.Error, match="number of voxels"):
        ball.depth(most=3)
    assert not (tmp_path / "x.vtex").exists()


def test_a_name_is_no_flag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError):
        vtex.bake("-r.glb", "x.vtex")


def test_warnings_are_python_s(tmp_path: Path) -> None:
    mesh = vtex.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 2, 2]], [[0, 1, 2], [3, 3, 3]])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        vtex.bake(mesh, tmp_path / "x.vtex", resolution=8)
        vtex.render(SAMPLES / "terrain.glb", size=(8, 8), camera=None)
    assert all(issubclass(w.category, UserWarning) for w in caught)


def test_same_input_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        vtex.bake(sphere(16), tmp_path / name, resolution=16, iso=0.0)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
