//! Shells in a mapping: the extension object of a covered material, and the attributes of its primitives.

use serde_json::{Map, Value, json};

use super::super::write::Editor;
use super::options::{Chart, MapOptions};
use super::plan::{Plan, SurfacePlan};
use super::surface::{Coordinates, Surface, WRITTEN};
use crate::error::length;
use crate::scene::shell::{Continuous, Orientations};
use crate::volume::Style;
use crate::{Error, Result, Warnings};

/// Octaves of the noise by which tints vary over the land; with several, patches have uneven borders.
const TINT_OCTAVES: u32 = 3;

/// How the surfaces of one material are laid out.
pub struct MaterialPlan<'a> {
    options: &'a MapOptions,
    plan: &'a Plan,
    /// Layer's scale and offset: texel coordinate = uvw · scale + offset.
    scale: [f64; 2],
    offset: [f64; 2],
    pub thickness: f64,
    write_uvw: bool,
    write_heights: bool,
}

impl<'a> MaterialPlan<'a> {
    /// `members`: the material's surfaces with what is planned for them; at least one.
    pub fn new(
        options: &'a MapOptions,
        plan: &'a Plan,
        members: &[(&Surface, &SurfacePlan)],
    ) -> Option<MaterialPlan<'a>> {
        let (_, first) = members.first()?;
        let raw: Vec<_> = members.iter().map(|(surface, planned)| in_raw_coordinates(surface, planned)).collect();
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0);
        let same = |a: &LayerTransform, b: &LayerTransform| {
            (0..2).all(|k| near(a.scale[k], b.scale[k]) && near(a.offset[k], b.offset[k]))
        };
        // If all members agree, the layer's scale and offset suffice, and no attribute is written.
        let one = raw[0].as_ref().filter(|first| raw.iter().all(|r| r.as_ref().is_some_and(|r| same(r, first))));
        let planar = matches!(plan.chart, Chart::Planar(_));
        let write_uvw = options.attributes || planar || one.is_none();
        let LayerTransform { scale, offset } =
            one.filter(|_| !write_uvw).copied().unwrap_or(LayerTransform { scale: [1.0; 2], offset: [0.0; 2] });
        let thickness = first.thickness;
        let uneven = members.iter().any(|(_, p)| (p.thickness - thickness).abs() > 1e-6 * thickness || p.keeps_heights);
        let scaled = members.iter().any(|(s, _)| (s.world().matrix3.determinant().abs() - 1.0).abs() > 1e-3);
        let bare = members.iter().any(|(s, _)| s.geometry.normals.is_none());
        Some(MaterialPlan {
            options,
            plan,
            scale,
            offset,
            thickness,
            write_uvw,
            write_heights: options.attributes || plan.up.is_some() || scaled || bare || uneven,
        })
    }

    /// The extension object of a covered material; `texels` index the root's list.
    pub fn material(&self, texels: &[usize]) -> Value {
        let mut shell = Map::new();
        if let Chart::Uv(set @ 1..) = self.plan.chart
            && !self.write_uvw
        {
            shell.insert("texCoord".into(), json!(set));
        }
        shell.insert("dw".into(), json!(self.plan.dw));
        shell.insert("thickness".into(), json!(self.thickness));
        shell.insert("surface".into(), json!(if self.options.surface_visible { "visible" } else { "hidden" }));
        shell.insert("layers".into(), json!([self.layer(texels)]));
        Value::Object(shell)
    }

    fn layer(&self, texels: &[usize]) -> Map<String, Value> {
        let mut layer = Map::new();
        layer.insert("texel".into(), json!(texels.first()));
        if self.scale != [1.0; 2] {
            layer.insert("scale".into(), json!([self.scale[0], self.scale[1], 1.0]));
        }
        let offset = [self.offset[0] + self.options.offset[0], self.offset[1] + self.options.offset[1]];
        if offset != [0.0; 2] {
            layer.insert("offset".into(), json!([offset[0], offset[1], 0.0]));
        }
        let mut jitter = Map::new();
        if let Some(c) = &self.options.continuous {
            jitter.insert("continuous".into(), continuous(c));
        }
        if let Some(discrete) = discrete(self.options, texels) {
            jitter.insert("discrete".into(), discrete);
        }
        if !jitter.is_empty() {
            layer.insert("jitter".into(), jitter.into());
        }
        restyle(self.options, &mut layer);
        layer
    }

    /// Append the layer of `shell` to the existing shell `to`, whose height vectors stay.
    ///
    /// # Errors
    /// [`Error::Options`] where there is no shell, or where scale and offset of one layer cannot express the mapping.
    pub fn add(&self, shell: &Value, to: &mut Value, name: &str, warnings: &mut Warnings) -> Result<()> {
        let number = |key: &str| to.get(key).and_then(Value::as_f64).unwrap_or(1.0);
        // Height of the shell, and metres per unit of w: of the shell, and of this layer.
        let (height, unit) = (number("thickness"), number("thickness") / number("dw"));
        let natural = self.thickness / self.plan.dw;
        let layers = to.get_mut("layers").and_then(Value::as_array_mut).filter(|_| unit > 0.0 && natural > 0.0);
        let none = || Error::Options(format!("material {name} has no shell yet: map it without option `add` first"));
        let layers = layers.ok_or_else(none)?;
        if self.write_uvw {
            let what = "option `add` takes u and v from what is there, in one scale for the whole material: give neither \
                        option `chart` nor option `attributes`";
            return Err(Error::Options(what.into()));
        }
        if self.thickness > height * 1.001 {
            let high = self.thickness;
            warnings.add(format!(
                "{name}: the shell is {} m high and cuts the layer's {} m",
                length(height),
                length(high)
            ));
        }
        for layer in shell.get("layers").and_then(Value::as_array).into_iter().flatten() {
            let mut layer = layer.clone();
            layer["scale"] = json!([self.scale[0], self.scale[1], unit / natural]);
            layers.push(layer);
        }
        Ok(())
    }

    /// Write the attributes and the material of a primitive of `mesh`, and remove attributes of earlier mappings.
    pub fn attributes(
        &self,
        (surface, planned): (&Surface, &SurfacePlan),
        (mesh, material): (usize, usize),
        editor: &mut Editor,
    ) -> Result<()> {
        let write_uvw = self.write_uvw && !planned.keeps_uvw;
        let uvw = write_uvw.then(|| surface.uvw(planned.coordinates, planned.scale, self.plan.origin));
        let heights = match (planned.keeps_heights, self.options.z_up, self.plan.up) {
            (true, true, _) => surface.heights_turned(),
            (true, false, _) => None,
            (false, ..) if !self.write_heights => None,
            (false, _, Some(up)) => Some(surface.heights_along(up * planned.thickness)),
            (false, _, None) => Some(surface.heights_normal(planned.thickness)),
        };
        let keeps_dw = planned.keeps_uvw || planned.keeps_heights;
        let uvw = uvw.map(|v| editor.add_floats(&v, true)).transpose()?;
        let heights = heights.map(|v| editor.add_floats(&v, true)).transpose()?;
        let all = [
            ("_VTEX_UVW", uvw, planned.keeps_uvw),
            ("_VTEX_HEIGHT", heights, planned.keeps_heights),
            ("_VTEX_DW", None, keeps_dw),
        ];
        let at = format!("/meshes/{mesh}/primitives/{}", surface.primitive);
        let Some(primitive) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { return Ok(()) };
        primitive.insert("material".into(), json!(material));
        let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) else { return Ok(()) };
        let mut written = Vec::new();
        for (name, accessor, keeps) in all {
            if let Some(accessor) = accessor {
                attributes.insert(name.into(), json!(accessor));
            } else if !keeps {
                attributes.shift_remove(name);
            }
            // Recorded, so that the next mapping replaces these and keeps the file's own.
            if accessor.is_some() && !keeps {
                written.push(name);
            }
        }
        mark(primitive, &written);
        Ok(())
    }
}

/// Scale and offset of a layer for a primitive's own texture coordinates.
#[derive(Clone, Copy)]
struct LayerTransform {
    scale: [f64; 2],
    offset: [f64; 2],
}

/// The plan's scale for the primitive's own texture coordinates, before KHR_texture_transform; `None` where that rotates them.
fn in_raw_coordinates(surface: &Surface, planned: &SurfacePlan) -> Option<LayerTransform> {
    if planned.coordinates != Coordinates::Uv {
        return Some(LayerTransform { scale: planned.scale, offset: [0.0; 2] });
    }
    let [[a, b, x], [c, d, y]] = surface.geometry.uv_rows.map(|r| r.map(f64::from));
    let [u, v] = planned.scale;
    (b == 0.0 && c == 0.0).then_some(LayerTransform { scale: [a * u, d * v], offset: [x * u, y * v] })
}

/// The `discrete` object; `None` without any variation, so that all cells of the layer are recognised as alike.
fn discrete(options: &MapOptions, texels: &[usize]) -> Option<Value> {
    let varies = options.orientations != Orientations::Identity
        || options.mirror != [false; 3]
        || options.scale != [1.0; 2]
        || options.displace != [0.0; 3]
        || options.presence < 1.0
        || options.tint_by_copy().is_some()
        || texels.len() > 1;
    if !varies {
        return None;
    }
    let orientations = match options.orientations {
        Orientations::Identity => "identity",
        Orientations::W4 => "w4",
        Orientations::W8 => "w8",
        Orientations::Cube24 => "cube24",
        Orientations::Cube48 => "cube48",
    };
    let mut discrete = json!({
        "seed": options.seed, "orientations": orientations, "scale": options.scale, "displace": options.displace,
        "presence": options.presence,
    });
    if texels.len() > 1 {
        discrete["variants"] = texels.iter().map(|t| json!({"texel": t})).collect();
    }
    if options.mirror != [false; 3] {
        discrete["mirror"] = json!(options.mirror);
    }
    if let Some(ramp) = options.tint_by_copy() {
        discrete["tint"] = json!(ramp);
    }
    Some(discrete)
}

/// The `continuous` object.
fn continuous(c: &Continuous) -> Value {
    json!({
        "seed": c.seed, "frequency": c.frequency, "octaves": c.octaves, "uvwAmplitude": c.uvw_amplitude,
        "heightTilt": c.height_tilt, "heightScale": c.height_scale,
    })
}

/// Write the `phong` and `palette` objects of a layer or of copies, if the options restyle anything.
pub fn restyle(options: &MapOptions, layer: &mut Map<String, Value>) {
    let mut all = phong(&Style { finish: options.finish, ..Style::UNCHANGED });
    if let (Some(ramp), Some(metres)) = (options.tint, options.tint_patches) {
        all.insert(
            "noise".into(),
            json!({"seed": options.seed, "space": "world", "octaves": TINT_OCTAVES,
            "frequency": [1.0 / metres, 0, 1.0 / metres], "diffuse": ramp}),
        );
    }
    if !all.is_empty() {
        layer.insert("phong".into(), all.into());
    }
    if !options.palette.is_empty() {
        let palette: Map<_, _> =
            options.palette.iter().map(|(name, style)| (name.clone(), Value::from(phong(style)))).collect();
        layer.insert("palette".into(), palette.into());
    }
}

/// A `phong` object.
fn phong(style: &Style) -> Map<String, Value> {
    let mut phong = Map::new();
    let Style { factor, keeps_albedo: keep, finish } = style;
    if *factor != [1.0; 3] || !keep {
        phong.insert("diffuseFactor".into(), json!(factor));
    }
    if !keep {
        phong.insert("useTexelAlbedo".into(), json!(false));
    }
    if let Some(specular) = finish.specular {
        phong.insert("specularFactor".into(), json!(specular));
    }
    if let Some(shininess) = finish.shininess {
        phong.insert("shininess".into(), json!(shininess));
    }
    phong
}

/// Remove the attributes that an earlier mapping wrote.
pub fn strip(surface: &Surface, editor: &mut Editor) {
    let at = format!("/meshes/{}/primitives/{}", surface.mesh, surface.primitive);
    let Some(primitive) = editor.json.pointer_mut(&at).and_then(Value::as_object_mut) else { return };
    if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
        attributes.retain(|name, _| !name.starts_with("_VTEX_") || surface.geometry.is_authored(name));
    }
    mark(primitive, &[]);
}

/// Record under `extras` which attributes a mapping wrote.
fn mark(primitive: &mut Map<String, Value>, written: &[&str]) {
    if !written.is_empty() {
        if let Some(extras) = primitive.entry("extras").or_insert_with(|| json!({})).as_object_mut() {
            extras.insert(WRITTEN.into(), json!(written));
        }
    } else if let Some(extras) = primitive.get_mut("extras").and_then(Value::as_object_mut)
        && extras.shift_remove(WRITTEN).is_some()
        && extras.is_empty()
    {
        primitive.shift_remove("extras");
    }
}
