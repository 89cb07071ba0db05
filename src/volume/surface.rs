//! How the matter of a texel's materials reflects and lets light through, beyond its albedo.
//!
//! Based on: the glTF extension `KHR_materials_diffuse_transmission` (a thin sheet that reflects diffusely on the side of the
//! light and shines diffusely on the other).
//!
//! META stores it by material, so older files and readers are not affected. A voxel has the mean of its materials' properties:
//! the ratio of its transmission to the materials' mean transmission is that of its albedo to their mean albedo.

use serde_json::{Map, Value, json};

use super::finish::MAX_SHININESS;
use super::{Gloss, Info, Mix};
use crate::geom::{Vec3, each3};

/// Key in META of an array of objects, one per material, or a single one where the texel names no materials.
pub const META_KEY: &str = "surfaces";

/// Properties of a material besides its albedo. The default is a matt, opaque and lit sheet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SurfaceParams {
    /// Mean linear albedo of diffuse transmission, each in [0, 1]. In a texel without materials it is the ratio to the albedo of
    /// reflection instead.
    pub transmission: [f64; 3],
    /// Share that shows its albedo whatever the light (`KHR_materials_unlit`), in [0, 1].
    pub unlit: f64,
    /// Share of its area that is single-sided sheets, which the camera sees from the front only, in [0, 1].
    pub one_sided: f64,
}

impl SurfaceParams {
    /// Whether it is matt and opaque, lit, and seen from all sides.
    pub fn is_plain(&self) -> bool {
        *self == SurfaceParams::default()
    }
}

/// Mean reflection and transmission of a material as its source has them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SurfaceMeans {
    /// Mean linear albedo of reflection.
    pub reflected: [f64; 3],
    /// Its other properties; `transmission` is on the same scale as `reflected`.
    pub params: SurfaceParams,
}

impl SurfaceMeans {
    /// Transmission over reflection, by channel; 0 where nothing is reflected.
    pub fn ratio(&self) -> [f64; 3] {
        let part =
            |k: usize| if self.reflected[k] > 0.0 { self.params.transmission[k] / self.reflected[k] } else { 0.0 };
        [0, 1, 2].map(part)
    }

    /// Parameters of the material in a texel, where the mean albedo of its visible matter is `albedo`; `None` for a texel without
    /// materials.
    pub fn params(&self, albedo: Option<[f64; 3]>) -> SurfaceParams {
        let ratio = self.ratio();
        let transmission = match albedo {
            None => ratio,
            // Where nothing is reflected there is no ratio: transmission is taken as the source has it.
            Some(m) => [0, 1, 2].map(|k| {
                let own = self.params.transmission[k];
                if self.reflected[k] > 0.0 { m[k] * ratio[k] } else { own }
            }),
        };
        SurfaceParams { transmission, ..self.params }
    }

    /// Mean of several; the default where there are none.
    pub fn mean(of: &[SurfaceMeans]) -> SurfaceMeans {
        let n = of.len().max(1) as f64;
        let mean = |get: &dyn Fn(&SurfaceMeans) -> f64| of.iter().map(get).sum::<f64>() / n;
        SurfaceMeans {
            reflected: [0, 1, 2].map(|k| mean(&|m| m.reflected[k])),
            params: SurfaceParams {
                transmission: [0, 1, 2].map(|k| mean(&|m| m.params.transmission[k])),
                unlit: mean(&|m| m.params.unlit),
                one_sided: mean(&|m| m.params.one_sided),
            },
        }
    }
}

/// Store the parameters of all materials in META, where any is not plain; numbers are rounded to four places.
pub fn store(surfaces: &[SurfaceParams], meta: &mut Map<String, Value>) {
    if surfaces.iter().all(SurfaceParams::is_plain) {
        return;
    }
    let round = |v: f64| (v * 1e4).round() / 1e4;
    let entry = |s: &SurfaceParams| {
        let mut entry = Map::new();
        if s.transmission != [0.0; 3] {
            entry.insert("transmission".into(), json!(s.transmission.map(round)));
        }
        if s.unlit > 0.0 {
            entry.insert("unlit".into(), round(s.unlit).into());
        }
        if s.one_sided > 0.0 {
            entry.insert("oneSided".into(), round(s.one_sided).into());
        }
        Value::Object(entry)
    };
    meta.insert(META_KEY.into(), surfaces.iter().map(entry).collect());
}

/// The parameters that META has, as many as there are; empty where all are plain. Whatever META holds is brought into range.
pub fn read(info: &Info) -> Vec<SurfaceParams> {
    /// Of a texel without materials: a ratio.
    const MAX_RATIO: f64 = 1e3;
    let most = if info.materials.is_empty() { MAX_RATIO } else { 1.0 };
    let number = |v: Option<&Value>, most: f64| {
        v.and_then(Value::as_f64).filter(|v| v.is_finite()).map_or(0.0, |v| v.clamp(0.0, most))
    };
    let entry = |v: &Value| SurfaceParams {
        transmission: [0, 1, 2].map(|k| number(v.get("transmission").and_then(|t| t.get(k)), most)),
        unlit: number(v.get("unlit"), 1.0),
        one_sided: number(v.get("oneSided"), 1.0),
    };
    let stored = info.meta.get(META_KEY).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let all: Vec<SurfaceParams> = stored.iter().take(info.materials.len().max(1)).map(entry).collect();
    if all.iter().all(SurfaceParams::is_plain) { Vec::new() } else { all }
}

/// Properties of a voxel besides its albedo, as codes. The default is matt, opaque, lit, and seen from all sides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelSurface {
    /// Linear albedo of diffuse transmission = (code / 255)^2.
    transmission: [u8; 3],
    /// Share that is unlit = code / 255.
    unlit: u8,
    /// Factor of the ambient light that is reflected = code / 255.
    ambient: [u8; 3],
    /// Strength of highlights, times the share of the materials that give their own = (code / 255)^2.
    specular: [u8; 3],
    /// Shininess + 1 = ([`MAX_SHININESS`] + 1)^(code / 255).
    shininess: u8,
    /// Share of the materials that give no highlights of their own, and take those of their layer = code / 255.
    without_gloss: u8,
    /// Share that is single-sided sheets = code / 255.
    one_sided: u8,
}

impl Default for VoxelSurface {
    fn default() -> Self {
        VoxelSurface {
            transmission: [0; 3],
            unlit: 0,
            ambient: [255; 3],
            specular: [0; 3],
            shininess: 0,
            without_gloss: 255,
            one_sided: 0,
        }
    }
}

/// The code of a share, clamped to [0, 1].
fn share_code(v: f32) -> u8 {
    (v.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// The code of a colour's channel, clamped to [0, 1].
fn root_code(v: f32) -> u8 {
    share_code(v.clamp(0.0, 1.0).sqrt())
}

fn share(code: u8) -> f32 {
    f32::from(code) / 255.0
}

fn colour(codes: [u8; 3]) -> Vec3 {
    Vec3::from_array(each3(codes, |c| share(c) * share(c)))
}

/// Logarithm of the largest shininess + 1.
fn shininess_span() -> f32 {
    (1.0 + MAX_SHININESS as f32).ln()
}

impl VoxelSurface {
    /// Surface of this linear transmission and unlit share, clamped to [0, 1].
    pub fn new(transmission: Vec3, unlit: f32) -> VoxelSurface {
        VoxelSurface {
            transmission: transmission.to_array().map(root_code),
            unlit: share_code(unlit),
            ..VoxelSurface::default()
        }
    }

    /// The surface with an ambient factor, with highlights, and with the share of the materials that give none of their own.
    pub fn with_finish(self, ambient: Vec3, gloss: &Gloss, without_gloss: f32) -> VoxelSurface {
        VoxelSurface {
            ambient: ambient.to_array().map(share_code),
            specular: gloss.specular.to_array().map(root_code),
            shininess: share_code((1.0 + gloss.shininess).ln() / shininess_span()),
            without_gloss: share_code(without_gloss),
            ..self
        }
    }

    /// The same surface, of which the share `one_sided` is single-sided sheets.
    pub fn with_front(self, one_sided: f32) -> VoxelSurface {
        VoxelSurface { one_sided: share_code(one_sided), ..self }
    }

    /// Share that is single-sided sheets, in [0, 1].
    pub fn one_sided(&self) -> f32 {
        share(self.one_sided)
    }

    /// Linear albedo of diffuse transmission, each channel in [0, 1].
    pub fn transmission(&self) -> Vec3 {
        colour(self.transmission)
    }

    /// Share that shows its albedo whatever the light, in [0, 1].
    pub fn unlit(&self) -> f32 {
        share(self.unlit)
    }

    /// Factor of the ambient light that is reflected, each channel in [0, 1].
    pub fn ambient(&self) -> Vec3 {
        Vec3::from_array(self.ambient.map(share))
    }

    /// Highlights of the materials that give their own, with their strength times these materials' share.
    pub fn gloss(&self) -> Gloss {
        let specular = colour(self.specular);
        // Most voxels have none.
        let shininess =
            if specular == Vec3::ZERO { 0.0 } else { (share(self.shininess) * shininess_span()).exp() - 1.0 };
        Gloss { specular, shininess }
    }

    /// Share of the materials that give no highlights of their own, in [0, 1].
    pub fn without_gloss(&self) -> f32 {
        share(self.without_gloss)
    }
}

/// Properties of all materials of a texel, by which the surfaces of its voxels are found.
pub struct SurfaceTable {
    /// Mean albedo and other properties, by id.
    entries: Vec<(Vec3, SurfaceParams)>,
}

impl SurfaceTable {
    /// Table of a texel's materials; `None` where all are plain.
    pub fn new(info: &Info) -> Option<SurfaceTable> {
        let surfaces = read(info);
        (!surfaces.is_empty()).then(|| SurfaceTable::with(info, &surfaces))
    }

    /// Table of a texel's materials, even if all of them are plain.
    pub fn always(info: &Info) -> SurfaceTable {
        SurfaceTable::with(info, &read(info))
    }

    fn with(info: &Info, surfaces: &[SurfaceParams]) -> SurfaceTable {
        let mean = |i: usize| info.materials.get(i).map_or(Vec3::ONE, |m| Vec3::from_array(m.albedo.map(|v| v as f32)));
        let at = |i: usize| (mean(i), surfaces.get(i).copied().unwrap_or_default());
        SurfaceTable { entries: (0..info.materials.len().max(1)).map(at).collect() }
    }

    /// Whether some material has single-sided sheets.
    pub fn has_one_sided(&self) -> bool {
        self.entries.iter().any(|(_, params)| params.one_sided > 0.0)
    }

    /// Mean albedo and parameters of the material `id`.
    pub fn entry(&self, id: u8) -> (Vec3, SurfaceParams) {
        self.entries.get(usize::from(id)).copied().unwrap_or_default()
    }

    /// Whether a voxel's surface depends on its mix of materials.
    pub fn needs_mixes(&self) -> bool {
        self.entries.len() > 1
    }

    /// Surface of a voxel with the linear albedo `albedo` and the materials `mix`, whose albedo after restyling is `restyled`.
    /// `shown` gives, for a material's id, mean albedo and properties, the transmission that it is shown with, and whether that
    /// varies as the voxel's albedo does.
    pub fn voxel_surface(
        &self,
        albedo: Vec3,
        mix: &Mix,
        restyled: Vec3,
        shown: impl Fn(u8, Vec3, &SurfaceParams) -> (Vec3, bool),
    ) -> VoxelSurface {
        let (mut all, mut own, mut fresh) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        let (mut unlit, mut bright, mut one_sided) = (0.0, 0.0, 0.0);
        for (id, share) in mix.weights() {
            let ((mean, params), share) = (self.entry(id), share as f32);
            let (transmission, follows) = shown(id, mean, &params);
            all += share * mean;
            if follows {
                own += share * transmission;
            } else {
                fresh += share * transmission;
            }
            let weight = share * mean.element_sum().max(1e-6);
            unlit += weight * params.unlit as f32;
            bright += weight;
            one_sided += share * params.one_sided as f32;
        }
        let scale = |k: usize| if all[k] > 0.0 { albedo[k] / all[k] } else { 1.0 };
        let transmission = own * Vec3::new(scale(0), scale(1), scale(2)) + fresh;
        // No more light leaves than arrives.
        let unlit = if bright > 0.0 { unlit / bright } else { 0.0 };
        VoxelSurface::new(transmission.min(Vec3::ONE - restyled), unlit).with_front(one_sided)
    }

    /// [`SurfaceTable::voxel_surface`] in the materials' own colours.
    pub fn own_surface(&self, albedo: Vec3, mix: &Mix) -> VoxelSurface {
        self.voxel_surface(albedo, mix, albedo, |_, _, params| (mean_transmission(params), true))
    }
}

/// Transmission of a material, linear, in 32-bit numbers.
pub fn mean_transmission(params: &SurfaceParams) -> Vec3 {
    Vec3::from_array(each3(params.transmission, |v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Material;
    use crate::volume::material::FINE_STEP;

    fn info(materials: &[[f64; 3]], surfaces: &[SurfaceParams]) -> Info {
        let of = |(i, albedo): (usize, &[f64; 3])| Material { name: i.to_string(), albedo: *albedo, share: 0.5 };
        let mut info = Info { materials: materials.iter().enumerate().map(of).collect(), ..Info::default() };
        store(surfaces, &mut info.meta);
        info
    }

    #[test]
    fn a_mix_transmits_what_its_materials_do() {
        let leaf = SurfaceParams { transmission: [0.1, 0.3, 0.05], ..SurfaceParams::default() };
        let info = info(&[[0.2, 0.1, 0.05], [0.1, 0.4, 0.1]], &[SurfaceParams::default(), leaf]);
        assert_eq!(read(&info), [SurfaceParams::default(), leaf]);
        let table = SurfaceTable::new(&info).unwrap();
        let mixed = |s: f32| Vec3::new(0.2, 0.1, 0.05).lerp(Vec3::new(0.1, 0.4, 0.1), s);
        for s in [0.0f32, 0.5, 1.0] {
            let mix = Mix::new([(0, f64::from(1.0 - s)), (1, f64::from(s))], FINE_STEP);
            let found = table.own_surface(mixed(s), &mix).transmission();
            // Half a step of the code's root at .3: 2 · sqrt(.3) / 510, and of a share: half of 1/63, twice.
            let want = s * Vec3::new(0.1, 0.3, 0.05);
            assert!((found - want).abs().max_element() < 0.003 + 0.3 / 63.0, "{s}: {found} {want}");
            // Half as bright, half the light comes through.
            let dark = table.own_surface(0.5 * mixed(s), &mix).transmission();
            assert!((dark - 0.5 * want).abs().max_element() < 0.003 + 0.3 / 63.0, "{s}: {dark}");
        }
    }

    #[test]
    fn highlights_survive_their_code() {
        let gloss = Gloss { specular: Vec3::new(0.04, 0.5, 1.0), shininess: 40.0 };
        let found = VoxelSurface::default().with_finish(Vec3::new(0.0, 0.5, 1.0), &gloss, 0.25);
        // Half a step of each code: 1/510 of a share, 2 √v / 510 of a square, and half of ln(10001) / 255 of the logarithm.
        assert!((found.ambient() - Vec3::new(0.0, 0.5, 1.0)).abs().max_element() <= 1.0 / 509.0);
        assert!((found.gloss().specular - gloss.specular).abs().max_element() <= 2.0 / 509.0);
        assert!((found.gloss().shininess / 40.0 - 1.0).abs() < 0.02);
        assert!((found.without_gloss() - 0.25).abs() <= 1.0 / 509.0);
        let plain = VoxelSurface::default();
        assert!(plain.gloss().is_none() && plain.ambient() == Vec3::ONE && plain.without_gloss() == 1.0);
    }

    #[test]
    fn no_more_light_leaves_than_arrives() {
        let bright = SurfaceParams { transmission: [0.5; 3], ..SurfaceParams::default() };
        let table = SurfaceTable::new(&info(&[[0.5; 3]], &[bright])).unwrap();
        for albedo in [0.0, 0.3, 0.5, 0.8, 1.0] {
            let through = table.own_surface(Vec3::splat(albedo), &Mix::one(0)).transmission().x;
            // A step of the code at most.
            assert!(albedo + through <= 1.0 + 1.0 / 255.0, "{albedo} {through}");
        }
    }

    #[test]
    fn whatever_meta_holds_is_bounded() {
        let mut info = info(&[[0.5; 3]], &[]);
        assert!(!info.meta.contains_key(META_KEY) && SurfaceTable::new(&info).is_none());
        for hostile in [
            "7",
            "[]",
            "[null]",
            r#"[{"transmission":[-1,"x",1e300],"unlit":-3}]"#,
            r#"[{"unlit":[]}]"#,
            r#"[{"oneSided":7}]"#,
        ] {
            info.meta.insert(META_KEY.into(), serde_json::from_str(hostile).unwrap());
            for s in read(&info) {
                assert!(
                    s.transmission.iter().chain([&s.unlit, &s.one_sided]).all(|v| (0.0..=1.0).contains(v)),
                    "{hostile}: {s:?}"
                );
            }
        }
    }

    #[test]
    fn means_are_taken_to_what_is_seen() {
        let means = SurfaceMeans {
            reflected: [0.2, 0.0, 0.4],
            params: SurfaceParams { transmission: [0.1, 0.3, 0.4], ..SurfaceParams::default() },
        };
        assert_eq!(means.params(None).transmission, [0.5, 0.0, 1.0]);
        assert_eq!(means.params(Some([0.1, 0.0, 0.2])).transmission, [0.05, 0.3, 0.2]);
        assert_eq!(SurfaceMeans::mean(&[means, SurfaceMeans::default()]).reflected, [0.1, 0.0, 0.2]);
    }
}
