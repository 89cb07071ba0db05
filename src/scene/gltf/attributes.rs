//! Reading of one mesh primitive: its attributes, with morph targets applied, and its topology.

use gltf::json::mesh::{self, Mode, Semantic};
use gltf::json::validation::Checked;

use super::document::{Document, MorphTarget, index};
use super::patches::{self, Primitive};
use super::support;
use crate::scene::model::Part;
use crate::scene::topology;
use crate::{Result, Warnings};

/// Most sets of texture coordinates that are read.
const MAX_UV_SETS: u32 = 8;
/// Bytes of memory per triangle while its neighbours are looked for (`source::mesh::patch`).
const CONNECTIVITY_MEMORY: u64 = 128;

/// One primitive being read.
pub struct Reader<'a> {
    /// File that holds the primitive.
    pub document: &'a Document,
    /// The primitive as the JSON has it.
    pub primitive: &'a mesh::Primitive,
    /// Morph targets.
    pub targets: &'a [MorphTarget],
    /// Weights of the morph targets.
    pub weights: &'a [f32],
    /// Place in the file, for messages.
    pub at: String,
}

impl Reader<'_> {
    /// All attributes, morphed; none where there are no positions.
    pub fn attributes(&self, warnings: &mut Warnings) -> Result<Option<Part>> {
        if self.accessor(&Semantic::Positions).is_none() {
            warnings.add("a primitive without POSITION is left out");
            return Ok(None);
        }
        let positions = self.floats::<3>(&Semantic::Positions, 3, [0.0; 3], None)?.unwrap_or_default();
        let n = Some(positions.len());
        let mut part = Part { positions, ..Part::default() };
        self.morph("POSITION", &mut part.positions)?;

        part.normals = self.floats(&Semantic::Normals, 3, [0.0; 3], n)?;
        if let Some(normals) = &mut part.normals {
            self.morph("NORMAL", normals)?;
        }
        let sets = self.primitive.attributes.keys().filter_map(|k| match k {
            Checked::Valid(Semantic::TexCoords(set)) if *set < MAX_UV_SETS => Some(*set),
            _ => None,
        });
        for set in 0..sets.max().map_or(0, |m| m + 1) {
            let mut uvs = self.floats::<2>(&Semantic::TexCoords(set), 2, [0.0; 2], n)?;
            if let Some(uvs) = &mut uvs {
                finite(uvs, warnings);
            }
            part.uvs.push(uvs.unwrap_or_else(|| vec![[0.0; 2]; part.positions.len()]));
        }
        part.colors = self.floats(&Semantic::Colors(0), 3, [1.0; 4], n)?;
        if let Some(colors) = &mut part.colors {
            finite(colors, warnings);
            // A thousandth is what exporters that compute with colours are off by.
            let outside = colors.iter().flatten().filter(|c| !(-1e-3..=1.001).contains(*c)).count();
            warnings.add_many("a vertex colour outside [0, 1] is clamped", outside as u64);
            colors.iter_mut().flatten().for_each(|c| *c = c.clamp(0.0, 1.0));
        }
        part.uvw = self.custom::<3>("VTEX_UVW", n, warnings)?;
        part.heights = self.custom::<3>("VTEX_HEIGHT", n, warnings)?;
        let scalar = |v: Option<Vec<[f32; 1]>>| v.map(|v| v.into_iter().map(|[x]| x).collect::<Vec<f32>>());
        part.dw = scalar(self.custom::<1>("VTEX_DW", n, warnings)?);
        part.jitter = scalar(self.custom::<1>("VTEX_JITTER", n, warnings)?);
        Ok(Some(part))
    }

    /// Convert indices and mode of the primitive to triangles, lines and points of `part`, and clean it.
    pub fn topology(&self, part: &mut Part, warnings: &mut Warnings) -> Result<()> {
        let n = part.positions.len();
        let indices: Vec<u32> = match index(self.primitive.indices) {
            Some(accessor) => {
                let at = format!("{}.indices", self.at);
                self.document.read_uints::<1>(accessor, &at)?.into_iter().map(|[i]| i).collect()
            }
            None => {
                self.document.charge(4 * n as u64, &self.at)?;
                (0..u32::try_from(n).unwrap_or(u32::MAX)).collect()
            }
        };
        self.document.charge(12 * indices.len() as u64, &self.at)?;
        let extension = self.primitive.extensions.as_ref().and_then(|e| e.others.get(super::extension::NAME));
        if extension.is_some_and(|e| e.get("patches").is_some())
            && self.primitive.mode != Checked::Valid(Mode::Triangles)
        {
            return Err(self.document.error(&*self.at, "has patches, and is no list of triangles (mode 4)"));
        }
        // Indices are split at the restart index, if there is one.
        let restart = match index(self.primitive.indices).filter(|_| support::uses(self.document, support::RESTART)) {
            Some(accessor) => Some(self.document.restart(accessor, &self.at)?),
            None => None,
        };
        let runs = || indices.split(|i| Some(*i) == restart);
        match &self.primitive.mode {
            Checked::Valid(Mode::Points) => part.points.clone_from(&indices),
            Checked::Valid(Mode::Lines) => part.lines = topology::lines(&indices),
            Checked::Valid(Mode::LineStrip) => {
                part.lines = runs().flat_map(|r| topology::line_strip(r, false)).collect()
            }
            Checked::Valid(Mode::LineLoop) => part.lines = runs().flat_map(|r| topology::line_strip(r, true)).collect(),
            Checked::Valid(Mode::Triangles) => {
                part.triangles = topology::triangles(&indices);
                let material = index(self.primitive.material);
                let (document, at) = (self.document, &*self.at);
                let primitive = Primitive { document, extension, material, at, vertices: n };
                part.patches = patches::read(&primitive, &mut part.triangles)?;
                warnings.add_many("indices left over after the last whole triangle", (indices.len() % 3) as u64);
            }
            Checked::Valid(Mode::TriangleStrip) => part.triangles = runs().flat_map(topology::triangle_strip).collect(),
            Checked::Valid(Mode::TriangleFan) => part.triangles = runs().flat_map(topology::triangle_fan).collect(),
            Checked::Invalid => return Err(self.document.error(&*self.at, "has an unknown mode")),
        }
        let strip = matches!(self.primitive.mode, Checked::Valid(Mode::TriangleStrip));
        topology::clean(part, strip, warnings);
        // Connectivity is computed for one primitive at a time, so its memory is only checked and not charged.
        self.document.has_room(CONNECTIVITY_MEMORY * part.triangles.len() as u64, &self.at)
    }

    pub fn accessor(&self, semantic: &Semantic) -> Option<usize> {
        self.primitive.attributes.get(&Checked::Valid(semantic.clone())).map(|i| i.value())
    }

    /// An attribute of as many elements as `n`, where that is known.
    pub fn floats<const N: usize>(
        &self,
        semantic: &Semantic,
        least: usize,
        fill: [f32; N],
        n: Option<usize>,
    ) -> Result<Option<Vec<[f32; N]>>> {
        let Some(accessor) = self.accessor(semantic) else { return Ok(None) };
        let at = format!("{}.{}", self.at, semantic.to_string());
        self.same_count(accessor, n, &at)?;
        self.document.read_floats(accessor, least, fill, &at).map(Some)
    }

    fn custom<const N: usize>(
        &self,
        name: &str,
        n: Option<usize>,
        warnings: &mut Warnings,
    ) -> Result<Option<Vec<[f32; N]>>> {
        let mut values = self.floats::<N>(&Semantic::Extras(name.into()), N, [0.0; N], n)?;
        if let Some(values) = &mut values {
            self.morph(&format!("_{name}"), values)?;
            finite(values, warnings);
        }
        Ok(values)
    }

    pub fn same_count(&self, accessor: usize, n: Option<usize>, at: &str) -> Result<()> {
        let count = self.document.count(accessor, at)?;
        match n {
            Some(n) if count != n as u64 => {
                Err(self.document.error(at, format!("has {count} elements for {n} positions")))
            }
            _ => Ok(()),
        }
    }

    /// Add the morph targets of an attribute by their weights.
    fn morph<const N: usize>(&self, name: &str, values: &mut [[f32; N]]) -> Result<()> {
        for (i, (target, &weight)) in self.targets.iter().zip(self.weights).enumerate() {
            let Some(&accessor) = target.get(name).filter(|_| weight != 0.0) else { continue };
            let at = format!("{}.targets[{i}].{name}", self.at);
            self.same_count(accessor, Some(values.len()), &at)?;
            let deltas = self.document.read_floats::<N>(accessor, N, [0.0; N], &at)?;
            for (value, delta) in values.iter_mut().zip(deltas) {
                for k in 0..N {
                    value[k] += weight * delta[k];
                }
            }
        }
        Ok(())
    }
}

/// Replace NaN and infinite values by 0.
fn finite<const N: usize>(values: &mut [[f32; N]], warnings: &mut Warnings) {
    let mut mended = 0;
    for v in values.iter_mut().flatten().filter(|v| !v.is_finite()) {
        *v = 0.0;
        mended += 1;
    }
    warnings.add_many("a NaN or infinite vertex attribute is read as 0", mended);
}
