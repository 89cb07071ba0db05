//! Covers a plain glTF mesh with texels: the extension on its materials, and the attributes where they are asked for.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use gltf::json::mesh::Mode;
use gltf::json::validation::Checked;
use serde_json::{Map, Value, json};

use super::chart::{Ground, Sheet};
use super::document::Document;
use super::write::{Editor, Saved, reference};
use super::{ReadOptions, extension, nodes, support};
use crate::geom::DVec3;
use crate::scene::select::Selection;
use crate::scene::shell::Orientations;
use crate::volume::{Info, Style};
use crate::{Error, Result, Warnings};

/// How a mesh is to be covered.
#[derive(Debug, Clone)]
pub struct MapOptions {
    /// The texels, each with what its file says; a copy takes one of them by a hash. At least one.
    pub texels: Vec<(PathBuf, Info)>,
    /// The source mesh of each texel, a `.glb`, for the reference render; as many as `texels`, or none.
    pub geometries: Vec<PathBuf>,
    /// Names or indices of the materials; none: all of them.
    pub materials: Vec<String>,
    pub cells: Cells,
    /// Shift of the copies along u and v, in cells.
    pub offset: [f64; 2],
    /// Add a layer to the shell that the materials already have, instead of making a new one.
    pub add: bool,
    /// Height of the texel's content, metres; by default in proportion to the cell.
    pub thickness: Option<f64>,
    pub heights: Heights,
    pub chart: Chart,
    /// Write `_VTEX_UVW` and `_VTEX_HEIGHT` even where the material alone would do.
    pub attributes: bool,
    pub orientations: Orientations,
    /// Uniform scale of a copy, [min, max] within (0, 1].
    pub scale: [f64; 2],
    /// Largest displacement along u, v, w, in cells.
    pub displace: [f64; 3],
    /// Share of the cells that hold a copy.
    pub presence: f64,
    pub seed: u32,
    /// What becomes of the texels' materials, by name.
    pub palette: BTreeMap<String, Style>,
    /// Whether the base face itself is drawn.
    pub surface_visible: bool,
}

/// How wide a copy is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cells {
    /// As wide as the texel says it is in metres.
    Texel,
    /// Copies along u and v of the unit square of texture coordinates, or of the mesh's extent where it is planar.
    Repeat([f64; 2]),
    /// Metres.
    Wide(f64),
}

/// Where the copies grow to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heights {
    /// Straight up where the mesh mostly faces up, else along the normals.
    Auto,
    Normals,
    Along(DVec3),
}

/// Where u and v come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chart {
    /// Texture coordinates, or planar from above where there are none.
    Auto,
    /// A set of texture coordinates.
    Uv(usize),
    /// World coordinates seen along axis 0 x, 1 y or 2 z.
    Planar(usize),
}

/// What was done.
#[derive(Debug, Default)]
pub struct Mapped {
    /// One line each about choices that were made.
    pub notes: Vec<String>,
    /// Names of the materials that were covered.
    pub materials: Vec<String>,
    /// Width of a copy along u and v and height of its content, metres.
    pub cell: [f64; 2],
    pub thickness: f64,
    /// Copies that the covered area has room for.
    pub copies: f64,
    pub saved: Saved,
}

impl Default for MapOptions {
    fn default() -> Self {
        MapOptions {
            texels: Vec::new(),
            geometries: Vec::new(),
            materials: Vec::new(),
            cells: Cells::Texel,
            offset: [0.0; 2],
            add: false,
            thickness: None,
            heights: Heights::Auto,
            chart: Chart::Auto,
            attributes: false,
            orientations: Orientations::W8,
            scale: [0.8, 1.0],
            displace: [0.1, 0.1, 0.0],
            presence: 1.0,
            seed: 0,
            palette: BTreeMap::new(),
            surface_visible: true,
        }
    }
}

/// Below this share of facing up, heights follow the normals by default.
const FACES_UP: f64 = 0.7;
/// A mesh must have room for so many copies along its shorter side, else they are made smaller to fit `FEW_FIT`.
const FEW: f64 = 3.0;
const FEW_FIT: f64 = 16.0;

/// Cover `input` and write the landscape to `output` (`.gltf`, or `.glb` by its name). Everything else in the file stays.
///
/// # Errors
/// Where a file cannot be read or written, where a material is not there, where nothing can be covered, and where
/// options are out of range.
pub fn map(input: &Path, options: &MapOptions, output: &Path) -> Result<Mapped> {
    check(options)?;
    let read = ReadOptions { contained: true, ..ReadOptions::default() };
    let document = Document::open(input, &read)?;
    support::check(&document)?;
    let mut mapped = Mapped::default();
    let mut warnings = Warnings::default();
    let sheets = sheets(&document, options, &read, &mut warnings)?;
    let ground = Ground::measure(&sheets);
    if ground.area <= 0.0 {
        return Err(Error::input(input, "", "the chosen materials have no triangles in the scene to cover"));
    }
    let plan = Plan::new(options, &sheets, &ground, &mut mapped)?;

    let mut editor = Editor::open(input, read.max_bytes)?;
    let mut saved = Saved::default();
    editor.settle(output, &mut saved)?;
    let first = texels(&mut editor, input, options, output, &mut saved)?;
    let shell = plan.shell(options, &first);
    let mut materials: BTreeSet<usize> = BTreeSet::new();
    let mut new_material = None;
    for sheet in &sheets {
        let material = match (sheet.material, new_material) {
            (Some(m), _) | (None, Some(m)) => m,
            (None, None) => *new_material.insert(editor.push("materials", json!({"name": "shell"}))?),
        };
        materials.insert(material);
        if !options.add {
            plan.attributes(sheet, material, &mut editor)?;
        }
    }
    for &index in &materials {
        let material = editor.json.pointer_mut(&format!("/materials/{index}"));
        let material = material.ok_or_else(|| document.error(format!("materials[{index}]"), "does not exist"))?;
        let name = material.get("name").and_then(Value::as_str).map_or(format!("material {index}"), str::to_owned);
        let extensions = Editor::object(input, material, "extensions")?;
        if options.add {
            plan.add(&shell, &mut extensions[extension::NAME], &name, &mut mapped.notes)?;
        } else {
            extensions[extension::NAME] = shell.clone();
        }
        mapped.materials.push(name);
    }
    editor.use_extension(extension::NAME)?;
    editor.save(output)?;
    saved.warnings.merge(warnings);
    mapped.saved = saved;
    Ok(mapped)
}

fn check(options: &MapOptions) -> Result<()> {
    let wrong = |what: &str| Err(Error::Options(what.into()));
    let [least, most] = options.scale;
    if options.texels.is_empty() {
        return wrong("at least one --texel is needed");
    }
    if !options.geometries.is_empty() && options.geometries.len() != options.texels.len() {
        return wrong("--geometry is given once for each --texel, in the same order, or not at all");
    }
    if let Some(path) = options.geometries.iter().find(|p| p.extension().is_none_or(|e| !e.eq_ignore_ascii_case("glb")))
    {
        return wrong(&format!("--geometry {}: it must be one .glb file", path.display()));
    }
    if !(least > 0.0 && least <= most && most <= 1.0) {
        return wrong("--scale must be MIN,MAX with 0 < MIN ≤ MAX ≤ 1");
    }
    if !(0.0..=1.0).contains(&options.presence) {
        return wrong("--presence must lie in [0, 1]");
    }
    if options.displace.iter().any(|d| !(0.0..=1.0).contains(d)) {
        return wrong("--displace must lie in [0, 1], in cells");
    }
    let known = |name: &String| options.texels.iter().any(|(_, info)| info.materials.iter().any(|m| m.name == *name));
    if let Some(name) = options.palette.keys().find(|name| !known(name)) {
        let all = options.texels.iter().flat_map(|(_, info)| &info.materials).map(|m| m.name.as_str());
        let names: Vec<&str> = all.collect::<BTreeSet<_>>().into_iter().collect();
        let names = if names.is_empty() { "none".into() } else { names.join(", ") };
        return wrong(&format!("--palette {name}: no texel has a material of this name; there are: {names}"));
    }
    let positive = |x: f64| x > 0.0 && x.is_finite();
    let cells = match options.cells {
        Cells::Texel => true,
        Cells::Repeat([u, v]) => positive(u) && positive(v),
        Cells::Wide(metres) => positive(metres),
    };
    if !cells || options.thickness.is_some_and(|t| !positive(t)) {
        return wrong("--repeat, --cell and --thickness must be above 0");
    }
    if let Heights::Along(d) = options.heights
        && !(d.is_finite() && d.length() > 0.0)
    {
        return wrong("--height-along must not be 0,0,0");
    }
    Ok(())
}

/// The primitives to be covered, each where the scene shows it first.
fn sheets(
    document: &Document,
    options: &MapOptions,
    read: &ReadOptions,
    warnings: &mut Warnings,
) -> Result<Vec<Sheet>> {
    let root = &document.root;
    let name = |i: usize| root.materials.get(i).and_then(|m| m.name.as_deref());
    let mut chosen = BTreeSet::new();
    for wanted in &options.materials {
        let before = chosen.len();
        chosen.extend((0..root.materials.len()).filter(|&i| name(i) == Some(wanted)));
        if chosen.len() == before {
            let index = wanted.parse().ok().filter(|&i: &usize| i < root.materials.len());
            chosen.insert(index.ok_or_else(|| {
                let names: Vec<_> = (0..root.materials.len()).map(|i| name(i).unwrap_or("(unnamed)")).collect();
                Error::Options(format!("no material is named {wanted}; the file has: {}", names.join(", ")))
            })?);
        }
    }
    let mut selection = Selection::new(&[], &[]);
    let graph = nodes::walk(document, read, &mut selection, &mut Warnings::default())?;
    let (mut sheets, mut seen) = (Vec::new(), BTreeSet::new());
    for placed in &graph.meshes {
        if !seen.insert(placed.mesh) {
            continue;
        }
        let primitives = root.meshes.get(placed.mesh).map_or(&[][..], |m| &m.primitives);
        for (i, primitive) in primitives.iter().enumerate() {
            let material = primitive.material.map(|m| m.value());
            if !options.materials.is_empty() && !material.is_some_and(|m| chosen.contains(&m)) {
                continue;
            }
            let solid = [Mode::Triangles, Mode::TriangleStrip, Mode::TriangleFan].map(Checked::Valid);
            if !solid.contains(&primitive.mode) {
                warnings.add("points and lines cannot be covered and stay as they are");
                continue;
            }
            let set = if let Chart::Uv(set) = options.chart { set } else { 0 };
            sheets.extend(Sheet::read(document, placed, i, set)?);
        }
    }
    Ok(sheets)
}

/// Name the texels in the root's extension; their indices there.
fn texels(
    editor: &mut Editor,
    input: &Path,
    options: &MapOptions,
    output: &Path,
    saved: &mut Saved,
) -> Result<Vec<usize>> {
    let extensions = Editor::object(input, &mut editor.json, "extensions")?;
    let root = Editor::object(input, extensions, extension::NAME)?;
    let list = root.as_object_mut().map(|root| root.entry("texels").or_insert_with(|| json!([])));
    let list = list.and_then(Value::as_array_mut);
    let list = list.ok_or_else(|| Error::input(input, format!("{}.texels", extension::NAME), "is not an array"))?;
    let mut indices = Vec::new();
    for (k, (path, _)) in options.texels.iter().enumerate() {
        let frames = json!([{"uri": reference(path, output, saved)?}]);
        let known = list.iter().position(|t| t.get("frames") == Some(&frames));
        let index = known.unwrap_or_else(|| {
            let name = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            list.push(json!({"name": name.unwrap_or_default(), "frames": frames}));
            list.len() - 1
        });
        if let (Some(geometry), Some(texel)) = (options.geometries.get(k), list[index].as_object_mut()) {
            texel.insert("geometry".into(), json!({"uri": reference(geometry, output, saved)?}));
        }
        indices.push(index);
    }
    Ok(indices)
}

/// Every number of the mapping, decided.
struct Plan {
    chart: Chart,
    /// Texel coordinate a unit of the chart, and where the planar chart starts.
    scale: [f64; 2],
    origin: [f64; 2],
    heights: Heights,
    thickness: f64,
    /// How much of the texel's cube the shell holds.
    dw: f64,
    write_uvw: bool,
    write_heights: bool,
}

impl Plan {
    fn new(options: &MapOptions, sheets: &[Sheet], ground: &Ground, mapped: &mut Mapped) -> Result<Plan> {
        let up = ground.facing / ground.area;
        let heights = match options.heights {
            Heights::Auto if up.y > FACES_UP => {
                mapped.notes.push("heights: straight up, because the mesh mostly faces up".into());
                Heights::Along(DVec3::Y)
            }
            Heights::Auto => Heights::Normals,
            Heights::Along(d) => Heights::Along(d.normalize()),
            Heights::Normals => Heights::Normals,
        };
        let along = if let Heights::Along(d) = heights { Some(d) } else { None };
        let chart = match options.chart {
            Chart::Auto if ground.has_uvs => Chart::Uv(0),
            Chart::Auto => {
                mapped.notes.push("no texture coordinates: planar coordinates seen from above are written".into());
                Chart::Planar(1)
            }
            Chart::Uv(set) if !ground.has_uvs => {
                return Err(Error::Options(format!("the mesh has no usable TEXCOORD_{set}; use --planar y")));
            }
            chart => chart,
        };
        // Metres that one unit of the chart covers along u and v, how many units the mesh spans, and where it starts.
        let (metres, span, origin) = match chart {
            Chart::Planar(axis) => {
                let (min, max) = ground.extent(axis);
                ([1.0; 2], [max[0] - min[0], max[1] - min[1]], min)
            }
            _ => (ground.uv_metres(sheets, along), ground.uv_span, [0.0; 2]),
        };
        let size = [metres[0] * span[0], metres[1] * span[1]];
        let shorter = size[0].min(size[1]);
        if !(shorter > 0.0 && shorter.is_finite()) {
            return Err(Error::Options(
                "the mesh is flat along u or v of this chart; use another --planar axis".into(),
            ));
        }
        let whole = |width: f64| {
            // Whole copies fit the mesh, or the unit square of texture coordinates where the mesh spans just that.
            [0, 1].map(|k| {
                let n = size[k] / width;
                let square = matches!(chart, Chart::Planar(_)) || (span[k] - 1.0).abs() < 0.1;
                if square { n.round().max(1.0) / span[k] } else { n / span[k] }
            })
        };
        let mut scale = match options.cells {
            Cells::Repeat(n) if matches!(chart, Chart::Planar(_)) => [n[0] / span[0], n[1] / span[1]],
            Cells::Repeat(n) => n,
            Cells::Wide(width) => whole(width),
            Cells::Texel => {
                let width = widest(options, mapped);
                if shorter < FEW * width {
                    let fit = shorter / FEW_FIT;
                    mapped.notes.push(format!(
                        "the mesh is {shorter:.3} m across and the texel {width:.3} m: copies are made {fit:.3} m wide (--cell sets it)"
                    ));
                    whole(fit)
                } else {
                    whole(width)
                }
            }
        };
        let cell = [metres[0] / scale[0], metres[1] / scale[1]];
        if matches!(chart, Chart::Uv(_)) && ground.mirrored {
            scale[1] = -scale[1];
        }
        let top = options.texels.iter().map(|(_, info)| info.content.max.z).fold(0.0, f64::max);
        let dw = if options.displace[2] > 0.0 || top <= 0.0 { 1.0 } else { (top * 1.001).min(1.0) };
        let thickness = options.thickness.unwrap_or_else(|| (cell[0] * cell[1]).sqrt() * dw);
        let scaled = sheets.iter().any(|s| (s.world.matrix3.determinant().abs() - 1.0).abs() > 1e-3);
        let bare = sheets.iter().any(|s| s.normals.is_none());
        mapped.cell = cell;
        mapped.thickness = thickness;
        mapped.copies = ground.area / (cell[0] * cell[1]) * options.presence;
        Ok(Plan {
            chart,
            scale,
            origin,
            heights,
            thickness,
            dw,
            write_uvw: options.attributes || matches!(chart, Chart::Planar(_)),
            write_heights: options.attributes || along.is_some() || scaled || bare,
        })
    }

    /// The extension object of a covered material; `texels` index the root's list.
    fn shell(&self, options: &MapOptions, texels: &[usize]) -> Value {
        let mut layer = Map::new();
        layer.insert("texel".into(), json!(texels.first()));
        if !self.write_uvw {
            layer.insert("scale".into(), json!([self.scale[0], self.scale[1], 1.0]));
        }
        if options.offset != [0.0; 2] {
            layer.insert("offset".into(), json!([options.offset[0], options.offset[1], 0.0]));
        }
        let mut discrete = Map::new();
        discrete.insert("seed".into(), json!(options.seed));
        let orientations = match options.orientations {
            Orientations::Identity => "identity",
            Orientations::W4 => "w4",
            Orientations::W8 => "w8",
        };
        discrete.insert("orientations".into(), json!(orientations));
        discrete.insert("scale".into(), json!(options.scale));
        discrete.insert("displace".into(), json!(options.displace));
        discrete.insert("presence".into(), json!(options.presence));
        if texels.len() > 1 {
            discrete.insert("variants".into(), texels.iter().map(|t| json!({"texel": t})).collect());
        }
        layer.insert("jitter".into(), json!({"discrete": discrete}));
        if !options.palette.is_empty() {
            let phong = |s: &Style| match s.keep {
                true => json!({"diffuseFactor": s.factor}),
                false => json!({"diffuseFactor": s.factor, "useTexelAlbedo": false}),
            };
            let palette: Map<_, _> = options.palette.iter().map(|(name, s)| (name.clone(), phong(s))).collect();
            layer.insert("palette".into(), palette.into());
        }
        let mut shell = Map::new();
        if let Chart::Uv(set @ 1..) = self.chart
            && !self.write_uvw
        {
            shell.insert("texCoord".into(), json!(set));
        }
        shell.insert("dw".into(), json!(self.dw));
        shell.insert("thickness".into(), json!(self.thickness));
        shell.insert("surface".into(), json!(if options.surface_visible { "visible" } else { "hidden" }));
        shell.insert("layers".into(), json!([layer]));
        Value::Object(shell)
    }

    /// Append the layer of `shell` to a shell that is there; its heights stay.
    fn add(&self, shell: &Value, to: &mut Value, name: &str, notes: &mut Vec<String>) -> Result<()> {
        let number = |key: &str| to.get(key).and_then(Value::as_f64).unwrap_or(1.0);
        // Metres that a unit of w is high: of the shell, and of this layer.
        let (height, unit) = (number("thickness"), number("thickness") / number("dw"));
        let own = self.thickness / self.dw;
        let layers = to.get_mut("layers").and_then(Value::as_array_mut).filter(|_| unit > 0.0 && own > 0.0);
        let none = || Error::Options(format!("material {name} has no shell yet: map it without --add first"));
        let layers = layers.ok_or_else(none)?;
        if self.write_uvw {
            let what = "--add takes u and v from texture coordinates: give neither --planar nor --attributes";
            return Err(Error::Options(what.into()));
        }
        if self.thickness > height * 1.001 {
            notes.push(format!("{name}: the shell is {height:.3} m high and cuts the layer's {:.3} m", self.thickness));
        }
        for layer in shell.get("layers").and_then(Value::as_array).into_iter().flatten() {
            let mut layer = layer.clone();
            layer["scale"] = json!([self.scale[0], self.scale[1], unit / own]);
            layers.push(layer);
        }
        Ok(())
    }

    /// Give a primitive its attributes and its material; those of an earlier mapping are taken away.
    fn attributes(&self, sheet: &Sheet, material: usize, editor: &mut Editor) -> Result<()> {
        let uvw = self.write_uvw.then(|| sheet.uvw(self.chart, self.scale, self.origin));
        let heights = self.write_heights.then(|| match self.heights {
            Heights::Along(d) => sheet.heights_along(d * self.thickness),
            _ => sheet.heights_normal(self.thickness),
        });
        let uvw = uvw.map(|v| editor.add_vec3(&v)).transpose()?;
        let heights = heights.map(|v| editor.add_vec3(&v)).transpose()?;
        let at = format!("/meshes/{}/primitives/{}", sheet.mesh, sheet.primitive);
        let Some(primitive) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { return Ok(()) };
        primitive.insert("material".into(), json!(material));
        let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) else { return Ok(()) };
        attributes.shift_remove("_VTEX_DW");
        for (name, accessor) in [("_VTEX_UVW", uvw), ("_VTEX_HEIGHT", heights)] {
            match accessor {
                Some(accessor) => attributes.insert(name.into(), json!(accessor)),
                None => attributes.shift_remove(name),
            };
        }
        Ok(())
    }
}

/// The width of the widest texel, metres.
fn widest(options: &MapOptions, mapped: &mut Mapped) -> f64 {
    let (mut widest, mut narrowest) = (0.0_f64, f64::INFINITY);
    for (path, info) in &options.texels {
        let unit = if info.metres_per_unit > 0.0 {
            info.metres_per_unit
        } else {
            mapped.notes.push(format!("{}: the source's unit is unknown and taken as a metre", path.display()));
            1.0
        };
        let width = info.bounds.size().max_element() * unit;
        (widest, narrowest) = (widest.max(width), narrowest.min(width));
    }
    if narrowest < 0.5 * widest {
        mapped.notes.push(format!(
            "the texels are {narrowest:.3} to {widest:.3} m wide, and all are drawn as wide as the widest; map them one by one"
        ));
    }
    if widest > 0.0 && widest.is_finite() { widest } else { 1.0 }
}
