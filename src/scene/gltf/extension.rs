//! The extension `VTEX_volumetric_texture`: texels and environment of the root, and shells and copies of materials. All ranges are checked;
//! properties that this version does not use give a counted warning.

mod object;
mod phong;

use serde_json::Value;

use super::document::Document;
use crate::scene::cycle::{Cycle, Mode, Phase};
pub use crate::scene::shell::EXTENSION_NAME as NAME;
use crate::scene::shell::{
    Continuous, Discrete, Environment, FrameFacts, Layer, Orientations, ShellMaterial, Sky, TexelRef, Variant,
};
use crate::scene::wind::{MAX_STRENGTH, Wind, WindField};
use crate::volume::{Palette, Style};
use crate::{Result, Warnings};
use object::{ANY, Object};
pub use phong::ReadTexture;
use phong::{ImageContext, phong, styles};

/// Extension object of the root.
#[derive(Debug, Default)]
pub struct Root {
    pub texels: Vec<TexelRef>,
    pub environment: Environment,
    /// The wind over the whole landscape.
    pub wind: Option<Wind>,
}

/// The root's extension object; empty where there is none.
pub fn root(document: &Document, warnings: &mut Warnings) -> Result<Root> {
    let json = document.root.extensions.as_ref().and_then(|e| e.others.get(NAME));
    let Some(json) = json else { return Ok(Root::default()) };
    let root = Object::new(document, json, NAME.into())?;
    root.known(&["texels", "environment", "wind"], &[], warnings);
    let texels = root.list("texels", 1, usize::MAX)?.unwrap_or_default();
    let texels = texels.iter().map(|t| texel(t, warnings)).collect::<Result<_>>()?;
    let mut environment = Environment::default();
    if let Some(e) = root.object("environment")? {
        e.known(&["sky", "background", "clear", "image", "sunAngle", "haze"], &[], warnings);
        environment.sky = e.vec3("sky", 0.0..=f64::MAX)?.map(Sky::Constant);
        if let Some(clear) = e.object("clear")? {
            clear.known(&["turbidity"], &[], warnings);
            environment.sky = Some(Sky::Clear(clear.number("turbidity", 1.0..=10.0)?.unwrap_or(2.5)));
        }
        if let Some(image) = e.object("image")? {
            image.known(&["uri"], &[], warnings);
            let path = image.path("uri")?.ok_or_else(|| image.error("uri", "is needed"))?;
            environment.sky = Some(Sky::Picture(path));
        }
        environment.sun_angle = e.number("sunAngle", 0.0..=1.0)?;
        environment.haze = e.number("haze", 0.0..=f64::MAX)?;
        if environment.haze == Some(0.0) {
            return Err(e.error("haze", "must be above 0"));
        }
        environment.background = e.vec3("background", 0.0..=f64::MAX)?;
    }
    Ok(Root { texels, environment, wind: wind(&root, None, warnings)? })
}

fn texel(json: &Object, warnings: &mut Warnings) -> Result<TexelRef> {
    json.known(&["name", "frames", "geometry", "maxDepth"], &[], warnings);
    let frames = json.list("frames", 1, 1024)?.ok_or_else(|| json.error("frames", "is needed"))?;
    let mut paths = Vec::with_capacity(frames.len());
    let mut facts = Vec::with_capacity(frames.len());
    for frame in &frames {
        frame.known(&["uri", "bufferView", "contentId", "pose"], &[], warnings);
        let (content_id, pose) = (frame.content_id()?, frame.pose(warnings)?);
        let (path, bytes) = match (frame.path("uri")?, frame.buffer_view()?) {
            (Some(path), None) => (path, None),
            (None, Some((path, bytes))) => (path, Some(bytes)),
            (None, None) => return Err(frame.error("uri", "or a bufferView is needed")),
            (Some(_), Some(_)) => return Err(frame.error("uri", "stands beside a bufferView: one of them is enough")),
        };
        paths.push(path);
        facts.push(FrameFacts { content_id, bytes, pose });
    }
    let geometry = match json.object("geometry")? {
        Some(g) => {
            g.known(&["uri"], &[], warnings);
            g.path("uri")?
        }
        None => None,
    };
    let bytes = facts.first().and_then(|f| f.bytes.clone());
    // The path of an embedded texel does not name it.
    let stem =
        paths.first().filter(|_| bytes.is_none()).and_then(|p| p.file_stem()).map(|s| s.to_string_lossy().into_owned());
    Ok(TexelRef {
        memory: None,
        name: json.text("name")?.map(str::to_string).or(stem).unwrap_or_default(),
        frames: paths,
        geometry,
        max_depth: json.integer("maxDepth", 16)?.map(|d| d as u8),
        content_id: facts.first().and_then(|f| f.content_id),
        pose: facts.first().and_then(|f| f.pose.clone()),
        bytes,
        facts,
        palette: Palette::default(),
        following: 0,
        cycle: None,
    })
}

/// The shell in a material's extension object `json` at a place of the file. Texels in other colours or frames are added to `texels`;
/// `textures` reads the images of its layers.
pub fn material<'a>(
    document: &Document,
    (json, at): (&Value, &str),
    texels: &mut TexelTable,
    textures: &'a mut ReadTexture<'a>,
    warnings: &mut Warnings,
) -> Result<ShellMaterial> {
    let json = Object::new(document, json, format!("{at}.{NAME}"))?;
    json.known(&["texCoord", "w", "dw", "thickness", "surface", "layers", "wind"], &[], warnings);
    let layers = json.list("layers", 1, 16)?.ok_or_else(|| json.error("layers", "is needed"))?;
    let thickness = json.number("thickness", 0.0..=f64::MAX)?.unwrap_or(1.0);
    if thickness <= 0.0 {
        return Err(json.error("thickness", "must be above 0"));
    }
    let tex_coord = json.integer("texCoord", 7)?.unwrap_or(0) as usize;
    let mut images = ImageContext { textures, tex_coord };
    Ok(ShellMaterial {
        tex_coord,
        w: json.number("w", ANY)?.unwrap_or(0.0),
        dw: json.number("dw", ANY)?.unwrap_or(1.0),
        thickness,
        surface_visible: json.choice("surface", &[("visible", true), ("hidden", false)])?.unwrap_or(true),
        layers: layers.iter().map(|l| layer(l, texels, &mut images, warnings)).collect::<Result<_>>()?,
    })
}

fn layer(
    json: &Object,
    texels: &mut TexelTable,
    images: &mut ImageContext<'_>,
    warnings: &mut Warnings,
) -> Result<Layer> {
    json.known(
        &[
            "texel",
            "wrap",
            "offset",
            "scale",
            "skinRange",
            "combine",
            "opacityScale",
            "phong",
            "palette",
            "jitter",
            "animation",
        ],
        &[],
        warnings,
    );
    let texel = json.texel(texels.own)?.ok_or_else(|| json.error("texel", "is needed"))?;
    let skin_range = json.numbers::<2>("skinRange", 0.0..=1.0)?.unwrap_or([0.0, 1.0]);
    if skin_range[0] >= skin_range[1] {
        return Err(json.error("skinRange", "must be from less to more"));
    }
    let (palette, phong) = styles(json, Some(images), warnings)?;
    let cycle = cycle(json, texels, warnings)?;
    let (mut discrete, mut continuous) = (None, None);
    if let Some(jitter) = json.object("jitter")? {
        jitter.known(&["discrete", "continuous"], &[], warnings);
        let read = |d: Object| self::discrete(&d, texels, (&palette, cycle), images, warnings);
        discrete = jitter.object("discrete")?.map(read).transpose()?;
        continuous = jitter.object("continuous")?.map(|c| self::continuous(&c, warnings)).transpose()?;
    }
    let scale = json.vec3("scale", ANY)?.unwrap_or([1.0; 3]);
    if scale.contains(&0.0) {
        return Err(json.error("scale", "must not be 0"));
    }
    Ok(Layer {
        texel: texels.index_of_variant(texel, &palette, cycle),
        wrap: json.wrap()?,
        offset: json.vec3("offset", ANY)?.unwrap_or([0.0; 3]),
        scale,
        skin_range,
        opacity_scale: json.number("opacityScale", 0.0..=f64::MAX)?.unwrap_or(1.0),
        over: json.choice("combine", &[("union", false), ("over", true)])?.unwrap_or(false),
        phong,
        discrete,
        continuous,
    })
}

/// Whether a material's extension object describes rigid copies, and not a shell.
pub fn places_copies(json: &Value) -> bool {
    json.get("copies").is_some()
}

/// The texels of rigid copies, by the object `copies` of a material's extension object.
pub fn copies(
    document: &Document,
    json: &Value,
    at: &str,
    texels: &mut TexelTable,
    warnings: &mut Warnings,
) -> Result<Vec<Variant>> {
    let outer = Object::new(document, json, format!("{at}.{NAME}"))?;
    outer.known(&["copies"], &[], warnings);
    let json = outer.object("copies")?.ok_or_else(|| outer.error("copies", "is needed"))?;
    json.known(&["texel", "variants", "palette", "phong", "animation", "wind"], &[], warnings);
    let (palette, phong) = styles(&json, None, warnings)?;
    let cycle = cycle(&json, texels, warnings)?;
    let mut variants = variants(&json, texels, (&palette, cycle), None, warnings)?;
    if variants.is_empty() {
        let what = "is needed where there are no variants";
        let texel = json.texel(texels.own)?.ok_or_else(|| json.error("texel", what))?;
        variants.push(Variant::alone(texels.index_of_variant(texel, &palette, cycle)));
    }
    for variant in &mut variants {
        variant.phong = variant.phong.within(&phong);
    }
    Ok(variants)
}

/// The `variants` of jittered or of rigid copies.
fn variants(
    json: &Object,
    texels: &mut TexelTable,
    (palette, cycle): (&Palette, Option<Cycle>),
    mut images: Option<&mut ImageContext<'_>>,
    warnings: &mut Warnings,
) -> Result<Vec<Variant>> {
    let mut variants = Vec::new();
    for variant in json.list("variants", 0, 256)?.unwrap_or_default() {
        variant.known(&["texel", "weight", "phong"], &[], warnings);
        let texel = variant.texel(texels.own)?.ok_or_else(|| variant.error("texel", "is needed"))?;
        let weight = variant.number("weight", 0.0..=f64::MAX)?.unwrap_or(1.0);
        if weight <= 0.0 {
            return Err(variant.error("weight", "must be above 0"));
        }
        let (phong, keep) = phong(&variant, images.as_deref_mut(), warnings)?;
        let palette = Palette { rest: if keep { palette.rest } else { Style::WHITE }, ..palette.clone() };
        variants.push(Variant { texel: texels.index_of_variant(texel, &palette, cycle), weight, phong });
    }
    Ok(variants)
}

/// The texels of a scene: those that the root lists, followed by the same in other colours and other frames.
pub struct TexelTable {
    own: usize,
    pub all: Vec<TexelRef>,
    /// Seconds.
    time: f64,
    /// The wind of the root.
    wind: Option<Wind>,
}

impl TexelTable {
    /// From the root's texels `all`, the time in seconds, and the root's wind.
    pub fn new(all: Vec<TexelRef>, time: f64, wind: Option<Wind>) -> TexelTable {
        TexelTable { own: all.len(), all, time, wind }
    }

    /// Index of the root's texel `index` in the colours of `palette`, which is added to the table if needed. Of an animated texel it is the frame of
    /// the current time or, where copies show different frames, the first of all frames, which follow one another.
    fn index_of_variant(&mut self, index: usize, palette: &Palette, cycle: Option<Cycle>) -> usize {
        let Some(own) = self.all.get(index) else { return index };
        let count = own.frames.len() as u32;
        let cycle = cycle.filter(|_| count > 1);
        if palette.is_plain() && cycle.is_none() {
            return index;
        }
        let of = |k: u32, following: u32| {
            let facts = own.facts.get(k as usize).cloned().unwrap_or_default();
            let frames = own.frames.get(k as usize).cloned().into_iter().collect();
            let FrameFacts { content_id, bytes, pose } = facts;
            TexelRef {
                frames,
                content_id,
                bytes,
                pose,
                following,
                cycle,
                palette: palette.clone(),
                facts: Vec::new(),
                ..own.clone()
            }
        };
        let row: Vec<TexelRef> = match cycle {
            None => vec![TexelRef { palette: palette.clone(), ..own.clone() }],
            Some(c) if c.phase == Phase::Global => {
                let frame = of(c.frame(count, 0.0, 0), 0);
                vec![TexelRef { cycle: None, ..frame }]
            }
            Some(_) => (0..count).map(|k| of(k, count - 1 - k)).collect(),
        };
        let known = self.all.get(self.own..).unwrap_or_default().windows(row.len()).position(|w| *w == row[..]);
        known.map_or_else(
            || {
                self.all.extend(row.iter().cloned());
                self.all.len() - row.len()
            },
            |i| self.own + i,
        )
    }
}

/// The `animation` of a layer or of copies at the current time.
fn cycle(json: &Object, texels: &TexelTable, warnings: &mut Warnings) -> Result<Option<Cycle>> {
    let Some(json) = json.object("animation")? else { return Ok(None) };
    json.known(&["mode", "framesPerSecond", "phase", "phaseScale", "frame", "seed"], &[], warnings);
    let mode = json.choice("mode", &[("loop", Mode::Loop), ("pingpong", Mode::PingPong), ("random", Mode::Random)])?;
    let scale = json.number("phaseScale", f64::MIN_POSITIVE..=f64::MAX)?.unwrap_or(8.0);
    let phases = [("global", Phase::Global), ("perCell", Phase::PerCell), ("noise", Phase::Noise(scale))];
    let speed = json.number("framesPerSecond", 0.0..=1e6)?.unwrap_or(24.0);
    let position = json.number("frame", ANY)?.unwrap_or(0.0) + speed * texels.time;
    Ok(Some(Cycle {
        mode: mode.unwrap_or_default(),
        phase: json.choice("phase", &phases)?.unwrap_or_default(),
        // The addend makes up for rounding where the time is meant to be the beginning of a frame.
        position: position + 1e-9,
        seed: json.integer("seed", u32::MAX.into())?.unwrap_or(0) as u32,
    }))
}

/// The `wind` of an object; absent properties are taken from `base`.
fn wind(json: &Object, base: Option<Wind>, warnings: &mut Warnings) -> Result<Option<Wind>> {
    let Some(json) = json.object("wind")? else { return Ok(base) };
    json.known(&["direction", "strength", "gustScale", "speed", "seed"], &[], warnings);
    let base = base.unwrap_or_default();
    let direction = match json.vec3("direction", -1e9..=1e9)? {
        None => base.direction,
        Some(d) => {
            crate::geom::DVec3::from_array(d).try_normalize().ok_or_else(|| json.error("direction", "must not be 0"))?
        }
    };
    Ok(Some(Wind {
        direction,
        strength: json.number("strength", 0.0..=MAX_STRENGTH)?.unwrap_or(base.strength),
        gust_scale: json.number("gustScale", 1e-6..=1e9)?.unwrap_or(base.gust_scale),
        speed: json.number("speed", 0.0..=1e6)?.unwrap_or(base.speed),
        seed: json.integer("seed", u32::MAX.into())?.map_or(base.seed, |s| s as u32),
    }))
}

/// The wind in which a material's shell bends.
pub fn wind_of_shell(
    document: &Document,
    json: &Value,
    at: &str,
    texels: &TexelTable,
    warnings: &mut Warnings,
) -> Result<Option<WindField>> {
    let json = Object::new(document, json, format!("{at}.{NAME}"))?;
    Ok(wind(&json, texels.wind, warnings)?.map(|w| w.at(texels.time)))
}

/// The wind in which the copies of a material lean.
pub fn wind_of_copies(
    document: &Document,
    json: &Value,
    at: &str,
    texels: &TexelTable,
    warnings: &mut Warnings,
) -> Result<Option<WindField>> {
    let outer = Object::new(document, json, format!("{at}.{NAME}"))?;
    let json = outer.object("copies")?.ok_or_else(|| outer.error("copies", "is needed"))?;
    Ok(wind(&json, texels.wind, warnings)?.map(|w| w.at(texels.time)))
}

fn discrete(
    json: &Object,
    texels: &mut TexelTable,
    shown: (&Palette, Option<Cycle>),
    images: &mut ImageContext<'_>,
    warnings: &mut Warnings,
) -> Result<Discrete> {
    const KEYS: [&str; 8] = ["seed", "orientations", "mirror", "scale", "displace", "presence", "variants", "tint"];
    json.known(&KEYS, &[], warnings);
    use Orientations::{Cube24, Cube48, Identity, W4, W8};
    let orientations = [("identity", Identity), ("w4", W4), ("w8", W8), ("cube24", Cube24), ("cube48", Cube48)];
    let orientations = json.choice("orientations", &orientations)?.unwrap_or(Identity);
    let scale = json.numbers::<2>("scale", 0.0..=1.0)?.unwrap_or([1.0; 2]);
    if !(0.0 < scale[0] && scale[0] <= scale[1]) {
        return Err(json.error("scale", "must be above 0, and from less to more"));
    }
    Ok(Discrete {
        seed: json.integer("seed", u32::MAX.into())?.unwrap_or(0) as u32,
        orientations,
        mirror: json.flags("mirror")?.unwrap_or([false; 3]),
        scale,
        displace: json.vec3("displace", 0.0..=MAX_DISPLACEMENT)?.unwrap_or([0.0; 3]),
        presence: json.number("presence", 0.0..=1.0)?.unwrap_or(1.0),
        variants: variants(json, texels, shown, Some(images), warnings)?,
        tint: json.colours("tint")?,
    })
}

/// Largest displacement of a copy, in cells. A ray has to visit as many cells around its own.
const MAX_DISPLACEMENT: f64 = 4.0;

fn continuous(json: &Object, warnings: &mut Warnings) -> Result<Continuous> {
    const KEYS: [&str; 8] =
        ["noise", "seed", "space", "frequency", "octaves", "uvwAmplitude", "heightTilt", "heightScale"];
    json.known(&KEYS, &[], warnings);
    json.choice("noise", &[("perlin2002", ())])?;
    json.choice("space", &[("texel", ())])?;
    let octaves = json.integer("octaves", 8)?.unwrap_or(1) as u32;
    if octaves == 0 {
        return Err(json.error("octaves", "must be at least 1"));
    }
    let frequency = json.vec3("frequency", 0.0..=64.0)?.unwrap_or([0.5; 3]);
    if frequency.contains(&0.0) {
        return Err(json.error("frequency", "must be above 0"));
    }
    Ok(Continuous {
        seed: json.integer("seed", u32::MAX.into())?.unwrap_or(0) as u32,
        frequency,
        octaves,
        uvw_amplitude: json.vec3("uvwAmplitude", 0.0..=16.0)?.unwrap_or([0.0; 3]),
        height_tilt: json.number("heightTilt", 0.0..=1.2)?.unwrap_or(0.0),
        height_scale: json.number("heightScale", 0.0..=0.9)?.unwrap_or(0.0),
    })
}

#[cfg(test)]
mod tests;
