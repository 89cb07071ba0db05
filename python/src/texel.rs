//! A `.vtex` file, and one of its depths as arrays.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::ndarray::{Array2, ArrayD, IxDyn};
use numpy::{IntoPyArray, PyArray2, PyArrayDyn};
use pyo3::exceptions::{PyIndexError, PyMemoryError, PyValueError};
use pyo3::prelude::*;
use vtex::format::{Limits, Reader};
use vtex::volume::cells::{Cell, cells};
use vtex::volume::voxel::decode_rate;
use vtex::volume::{Info, Pages, Sggx};

use crate::{no_channel, raised};

/// What a cell has; see the module's documentation in `_vtex.pyi`.
pub const CHANNELS: [&str; 9] =
    ["albedo", "correlation", "edge", "materials", "normal", "one_sidedness", "opacity", "rate", "sggx"];

/// Most bytes of a dense grid.
const MAX_GRID: usize = 4 << 30;

/// An open `.vtex` file.
#[pyclass(frozen, module = "vtex")]
pub struct Texel {
    reader: Reader,
}

#[pymethods]
impl Texel {
    /// Open a file; of its depths those that fit into `memory` bytes once decoded.
    #[new]
    #[pyo3(signature = (path, *, memory = None))]
    fn new(py: Python<'_>, path: PathBuf, memory: Option<u64>) -> PyResult<Texel> {
        let limits = memory.map_or_else(Limits::default, |decoded_bytes| Limits { decoded_bytes });
        let reader = py.detach(|| Reader::open(&path, &limits)).map_err(raised)?;
        Ok(Texel { reader })
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.reader.path().to_path_buf()
    }

    /// Depths that are open, 0 … depths − 1.
    #[getter]
    fn depths(&self) -> usize {
        self.reader.counts().len()
    }

    /// Nodes of each depth.
    #[getter]
    fn counts(&self) -> Vec<usize> {
        self.reader.counts()
    }

    /// Everything else that the head says, as JSON.
    fn head_json(&self) -> PyResult<String> {
        let info: &Info = &self.reader.head().info;
        serde_json::to_string(info).map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// Cells of a depth; negative ones count from the finest.
    #[pyo3(signature = (depth = -1, *, most = 1 << 28))]
    fn depth(&self, py: Python<'_>, depth: i64, most: usize) -> PyResult<Depth> {
        let depths = self.depths() as i64;
        let wanted = if depth < 0 { depths + depth } else { depth };
        if !(0..depths).contains(&wanted) {
            return Err(PyIndexError::new_err(format!("no depth {depth}: there are {depths}")));
        }
        let found = py.detach(|| cells(&self.reader, wanted as usize, most)).map_err(raised)?;
        let materials = self.reader.head().info.materials.len();
        Ok(Depth { depth: wanted as u32, cells: Arc::new(found), materials })
    }

    fn __repr__(&self) -> String {
        let (path, finest) = (self.reader.path().display(), self.depths().saturating_sub(1));
        format!("<vtex.Texel {path}: {}³, {} voxels>", 1u64 << finest, self.counts().last().copied().unwrap_or(0))
    }
}

/// The cells of one depth that hold matter, in Morton order.
#[pyclass(frozen, module = "vtex")]
pub struct Depth {
    depth: u32,
    cells: Arc<Vec<Cell>>,
    materials: usize,
}

#[pymethods]
impl Depth {
    #[getter]
    fn depth(&self) -> u32 {
        self.depth
    }

    /// Voxels along the cube's edge.
    #[getter]
    fn resolution(&self) -> u32 {
        1 << self.depth
    }

    fn __len__(&self) -> usize {
        self.cells.len()
    }

    fn __repr__(&self) -> String {
        format!("<vtex.Depth {}: {} cells of {}³>", self.depth, self.cells.len(), self.resolution())
    }

    /// (n, 3) uint32: each cell's low corner along (u, v, w), in voxels of this depth.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u32>> {
        Array2::from_shape_fn((self.cells.len(), 3), |(i, k)| self.cells[i].corner[k]).into_pyarray(py)
    }

    /// A channel of all cells: float32, (n,) or (n, components).
    fn __getitem__<'py>(&self, py: Python<'py>, channel: &str) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let parts = components(channel, self.materials).ok_or_else(|| no_channel(channel))?;
        let mut values = vec![0.0; self.cells.len() * parts];
        py.detach(|| values.chunks_mut(parts).zip(self.cells.iter()).for_each(|(out, cell)| put(channel, cell, out)));
        let shape = if is_scalar(channel) { vec![self.cells.len()] } else { vec![self.cells.len(), parts] };
        shaped(py, &shape, values)
    }

    /// A channel as a dense grid [u, v, w] or [u, v, w, component], 0 where there is no matter.
    fn grid<'py>(&self, py: Python<'py>, channel: &str) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let parts = components(channel, self.materials).ok_or_else(|| no_channel(channel))?;
        let edge = self.resolution() as usize;
        let bytes = edge.checked_pow(3).and_then(|n| n.checked_mul(4 * parts)).filter(|bytes| *bytes <= MAX_GRID);
        let Some(bytes) = bytes else {
            return Err(PyMemoryError::new_err(format!(
                "a grid of {edge}³ takes more than {} GiB: take a coarser depth, or the cells themselves",
                MAX_GRID >> 30
            )));
        };
        let mut grid = vec![0.0; bytes / 4];
        py.detach(|| {
            let mut value = vec![0.0; parts];
            for cell in self.cells.iter() {
                put(channel, cell, &mut value);
                let [u, v, w] = cell.corner.map(|c| c as usize);
                let size = cell.edge as usize;
                for x in u..u + size {
                    for y in v..v + size {
                        let row = (x * edge + y) * edge + w;
                        grid[row * parts..(row + size) * parts]
                            .chunks_mut(parts)
                            .for_each(|p| p.copy_from_slice(&value));
                    }
                }
            }
        });
        let mut shape = vec![edge; 3];
        if !is_scalar(channel) {
            shape.push(parts);
        }
        shaped(py, &shape, grid)
    }
}

fn shaped<'py>(py: Python<'py>, shape: &[usize], values: Vec<f32>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let array = ArrayD::from_shape_vec(IxDyn(shape), values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}

fn is_scalar(channel: &str) -> bool {
    matches!(channel, "correlation" | "edge" | "one_sidedness" | "opacity" | "rate")
}

/// Values of a channel per cell; `None`: there is no such channel.
fn components(channel: &str, materials: usize) -> Option<usize> {
    match channel {
        "albedo" | "normal" => Some(3),
        "sggx" => Some(6),
        "materials" => Some(materials.max(1)),
        _ => is_scalar(channel).then_some(1),
    }
}

fn put(channel: &str, cell: &Cell, out: &mut [f32]) {
    let voxel = &cell.voxel;
    match channel {
        "albedo" => out.copy_from_slice(&voxel.albedo().to_array()),
        "correlation" => out[0] = voxel.c(),
        "edge" => out[0] = cell.edge as f32,
        "normal" => {
            let known = voxel.one_sidedness() > 0.0;
            out.copy_from_slice(&if known { voxel.mean_normal().to_array() } else { [0.0; 3] });
        }
        "one_sidedness" => out[0] = voxel.one_sidedness(),
        "opacity" => out[0] = cell.opacity() as f32,
        "rate" => out[0] = decode_rate(voxel.rate),
        "sggx" => {
            let Sggx { xx, yy, zz, xy, xz, yz } = Sggx::decode(voxel.ndf);
            out.copy_from_slice(&[xx, yy, zz, xy, xz, yz]);
        }
        _ => {
            out.fill(0.0);
            cell.mix.weights().for_each(|(id, share)| {
                if let Some(out) = out.get_mut(usize::from(id)) {
                    *out = share as f32;
                }
            });
        }
    }
}
