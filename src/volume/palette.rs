//! Restyling: the colours that a landscape gives to a texel's materials, applied to voxels as they are read.
//!
//! A voxel stores the mean colour of its visible matter and the share of each material, but not each material's own colour. The
//! latter is estimated as the material's mean over the texel, times the ratio of the voxel's colour to the mix of those means.
//! That is exact where each material has one colour, and where the colours of all materials vary together.

use std::collections::BTreeMap;

use super::surface::{SurfaceParams, SurfaceTable, VoxelSurface, mean_transmission};
use super::{Finish, Gloss, Info, Mix, Pages, Voxel};
use crate::Result;
use crate::geom::Vec3;

/// Colour and finish that a landscape gives to a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// Linear factor of the texel's own albedo, or the new albedo: see `keeps_albedo`.
    pub factor: [f64; 3],
    /// Whether `factor` multiplies the texel's own albedo; else it replaces it.
    pub keeps_albedo: bool,
    /// Phong parameters besides the colour.
    pub finish: Finish,
}

impl Style {
    /// No change.
    pub const UNCHANGED: Style = Style { factor: [1.0; 3], keeps_albedo: true, finish: Finish::PLAIN };
    /// White in place of the texel's own albedo; a factor on it gives any colour.
    pub const WHITE: Style = Style { factor: [1.0; 3], keeps_albedo: false, finish: Finish::PLAIN };

    /// The restyled albedo.
    pub fn apply(&self, albedo: Vec3) -> Vec3 {
        let factor = Vec3::from_array(self.factor.map(|v| v as f32));
        if self.keeps_albedo { albedo * factor } else { factor }
    }
}

/// Styles by the names of materials.
#[derive(Debug, Clone, PartialEq)]
pub struct Palette {
    /// Style of each named material.
    pub styles: BTreeMap<String, Style>,
    /// Style of the materials that are not named.
    pub rest: Style,
}

impl Default for Palette {
    fn default() -> Self {
        Palette { styles: BTreeMap::new(), rest: Style::UNCHANGED }
    }
}

impl Palette {
    /// Whether nothing changes.
    pub fn is_plain(&self) -> bool {
        self.rest == Style::UNCHANGED && self.styles.values().all(|s| *s == Style::UNCHANGED)
    }

    /// The style of a material.
    pub fn style(&self, name: &str) -> Style {
        self.styles.get(name).copied().unwrap_or(self.rest)
    }

    /// Names that none of the texel's materials has.
    pub fn unknown<'a>(&'a self, info: &'a Info) -> impl Iterator<Item = &'a str> {
        let known = |name: &str| info.materials.iter().any(|m| m.name == name);
        self.styles.keys().map(String::as_str).filter(move |name| !known(name))
    }
}

/// Pages of a texel with its materials restyled.
pub struct Restyled<P> {
    inner: P,
    /// By id: mean albedo and style.
    materials: Vec<(Vec3, Style)>,
    /// Properties of the materials besides their albedo; `None` where all are plain.
    surfaces: Option<SurfaceTable>,
}

/// Reflected part of what a material reflects and transmits, in [0, 1], by channel.
fn reflected_share(mean: Vec3, params: &SurfaceParams) -> Vec3 {
    let (through, whole) = (mean_transmission(params), mean + mean_transmission(params));
    let share = |k: usize| if through[k] > 0.0 { mean[k] / whole[k] } else { 1.0 };
    Vec3::new(share(0), share(1), share(2))
}

impl<P: Pages> Restyled<P> {
    /// Pages of `inner` with the materials in the styles of `palette`.
    pub fn new(inner: P, palette: &Palette) -> Restyled<P> {
        let of = |m: &super::Material| (Vec3::from_array(m.albedo.map(|v| v as f32)), palette.style(&m.name));
        let mut materials: Vec<(Vec3, Style)> = inner.info().materials.iter().map(of).collect();
        if materials.is_empty() {
            materials.push((Vec3::ONE, palette.rest));
        }
        let surfaces = SurfaceTable::new(inner.info());
        Restyled { inner, materials, surfaces }
    }

    /// Linear transmission of the material `id` in its style, and whether it varies from voxel to voxel as the albedo does.
    fn shown(&self, id: u8, mean: Vec3, params: &SurfaceParams) -> (Vec3, bool) {
        let style = self.materials.get(usize::from(id)).map_or(Style::UNCHANGED, |m| m.1);
        if style.keeps_albedo {
            return (style.apply(mean_transmission(params)), true);
        }
        (style.apply(Vec3::ONE) * (1.0 - reflected_share(mean, params)), false)
    }

    /// Whether a material has a finish of its own.
    fn has_finishes(&self) -> bool {
        self.materials.iter().any(|m| m.1.finish != Finish::PLAIN)
    }

    /// `surface` with the finishes of the materials in `mix`: ambient factors are averaged by what the materials reflect, highlights
    /// by the materials' shares, and the widths of the lobes by the strengths of the highlights.
    fn finished(&self, surface: VoxelSurface, mix: &Mix) -> VoxelSurface {
        let (mut ambient, mut all) = (Vec3::ZERO, Vec3::ZERO);
        let (mut specular, mut without_gloss) = (Vec3::ZERO, 0.0);
        let (mut width, mut strength) = (0.0, 0.0);
        for (id, share) in mix.weights() {
            let Some((mean, style)) = self.materials.get(usize::from(id)) else { continue };
            let share = share as f32;
            let reflected = share * style.apply(*mean);
            all += reflected;
            ambient += reflected * Vec3::from_array(style.finish.ambient.map(|v| v as f32));
            if !style.finish.has_gloss() {
                without_gloss += share;
                continue;
            }
            let gloss = style.finish.gloss();
            let bright = share * gloss.specular.element_sum();
            specular += share * gloss.specular;
            // Variances of lobes, about 1 / s, add up.
            width += bright / (gloss.shininess + 1.0);
            strength += bright;
        }
        let part = |k: usize| if all[k] > 0.0 { ambient[k] / all[k] } else { 1.0 };
        let shininess = if width > 0.0 { strength / width - 1.0 } else { 0.0 };
        let ambient = Vec3::new(part(0), part(1), part(2));
        surface.with_finish(ambient, &Gloss { specular, shininess }, without_gloss)
    }

    fn restyle(&self, voxel: &mut Voxel, mix: &Mix) {
        let (mut all, mut kept, mut fresh, mut stays) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for (id, share) in mix.weights() {
            let Some((mean, style)) = self.materials.get(usize::from(id)) else { continue };
            let (share, factor) = (share as f32, style.apply(Vec3::ONE));
            all += share * *mean;
            if style.keeps_albedo {
                kept += share * *mean * factor;
                stays += share * factor;
            } else {
                let reflected = self.surfaces.as_ref().map_or(Vec3::ONE, |s| reflected_share(*mean, &s.entry(id).1));
                fresh += share * factor * reflected;
            }
        }
        let own = voxel.albedo();
        // Where the means are black nothing tells materials apart but their shares.
        let part = |k: usize| if all[k] > 0.0 { kept[k] / all[k] } else { stays[k] };
        let albedo = Vec3::new(own.x * part(0), own.y * part(1), own.z * part(2)) + fresh;
        voxel.set_albedo(albedo.to_array().map(f64::from));
    }
}

impl<P: Pages> Pages for Restyled<P> {
    fn info(&self) -> &Info {
        self.inner.info()
    }

    fn counts(&self) -> Vec<usize> {
        self.inner.counts()
    }

    fn masks(&self, depth: usize) -> Result<Vec<u8>> {
        self.inner.masks(depth)
    }

    fn voxels(&self, depth: usize, page: usize) -> Result<Vec<Voxel>> {
        let mut voxels = self.inner.voxels(depth, page)?;
        let one = self.materials.iter().all(|m| m.1 == self.materials[0].1);
        // Materials that all become the same are not read.
        let mixes = if one { Vec::new() } else { self.inner.mixes(depth, page)? };
        for (i, voxel) in voxels.iter_mut().enumerate().filter(|(_, v)| v.rate > 0) {
            self.restyle(voxel, &mixes.get(i).copied().unwrap_or_default());
        }
        Ok(voxels)
    }

    fn mixes(&self, depth: usize, page: usize) -> Result<Vec<Mix>> {
        self.inner.mixes(depth, page)
    }

    fn surface_table(&self) -> Option<SurfaceTable> {
        SurfaceTable::new(self.info()).or_else(|| self.has_finishes().then(|| SurfaceTable::always(self.info())))
    }

    fn surfaces(&self, depth: usize, page: usize, voxels: &[Voxel], table: &SurfaceTable) -> Result<Vec<VoxelSurface>> {
        let own = self.inner.voxels(depth, page)?;
        let has_finishes = self.has_finishes();
        let mixes = if table.needs_mixes() { self.inner.mixes(depth, page)? } else { Vec::new() };
        let of = |(i, (own, now)): (usize, (&Voxel, &Voxel))| {
            let mix = mixes.get(i).copied().unwrap_or_default();
            let surface =
                table.voxel_surface(own.albedo(), &mix, now.albedo(), |id, mean, params| self.shown(id, mean, params));
            if has_finishes { self.finished(surface, &mix) } else { surface }
        };
        Ok(own.iter().zip(voxels).enumerate().map(of).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::material::FINE_STEP;
    use crate::volume::{Depth, Material, Volume};

    fn texel(materials: &[(&str, [f64; 3])], voxels: &[([f64; 3], Mix)]) -> Volume {
        let mut info = crate::volume::Info::default();
        let of = |(name, albedo): &(&str, [f64; 3])| Material { name: (*name).into(), albedo: *albedo, share: 0.5 };
        info.materials = materials.iter().map(of).collect();
        let voxel = |(albedo, _): &([f64; 3], Mix)| {
            let mut v = Voxel { rate: 9, ..Voxel::default() };
            v.set_albedo(*albedo);
            v
        };
        let depth = Depth {
            masks: vec![0; voxels.len()],
            voxels: voxels.iter().map(voxel).collect(),
            mixes: voxels.iter().map(|v| v.1).collect(),
        };
        Volume { info, depths: vec![depth] }
    }

    fn seen(texel: &Volume, palette: &Palette) -> Vec<Vec3> {
        Restyled::new(texel.clone(), palette).voxels(0, 0).unwrap().iter().map(Voxel::albedo).collect()
    }

    fn near(a: Vec3, b: [f32; 3]) -> bool {
        // Half a step of the square root's code, at 1: 1/255; and of a share: half of 1/63.
        (a - Vec3::from_array(b)).abs().max_element() < 1.0 / 255.0 + 0.5 / 63.0
    }

    #[test]
    fn what_is_known_of_materials_is_restyled_exactly() {
        let (bark, leaf) = ([0.2, 0.1, 0.05], [0.1, 0.4, 0.1]);
        let mixed = |s: f64| std::array::from_fn(|k| (1.0 - s) * bark[k] + s * leaf[k]);
        let mix = |s: f64| Mix::new([(0, 1.0 - s), (1, s)], FINE_STEP);
        let shares = [0.0, 0.25, 0.5, 1.0];
        let texel = texel(&[("bark", bark), ("leaf", leaf)], &shares.map(|s| (mixed(s), mix(s))));
        let styled = |name: &str, style| Palette { styles: [(name.into(), style)].into(), ..Palette::default() };
        let tinted = styled("leaf", Style { factor: [4.0, 0.5, 0.0], keeps_albedo: true, ..Style::UNCHANGED });
        for (s, found) in shares.iter().zip(seen(&texel, &tinted)) {
            let s = *s as f32;
            let want = [0.2 * (1.0 - s) + 0.4 * s, 0.1 * (1.0 - s) + 0.2 * s, 0.05 * (1.0 - s)];
            assert!(near(found, want), "{s}: {found} {want:?}");
        }
        let replaced = styled("leaf", Style { factor: [0.8, 0.3, 0.0], keeps_albedo: false, ..Style::UNCHANGED });
        for (s, found) in shares.iter().zip(seen(&texel, &replaced)) {
            let s = *s as f32;
            let want = [0.2 * (1.0 - s) + 0.8 * s, 0.1 * (1.0 - s) + 0.3 * s, 0.05 * (1.0 - s)];
            assert!(near(found, want), "{s}: {found} {want:?}");
        }
        assert!(styled("moss", Style::WHITE).unknown(&texel.info).eq(["moss"]));
        assert!(Palette::default().is_plain() && !replaced.is_plain());
        // All of it white, and nothing changed.
        let blank = Palette { rest: Style::WHITE, ..Palette::default() };
        assert!(seen(&texel, &blank).iter().all(|c| *c == Vec3::ONE));
        assert_eq!(Restyled::new(texel.clone(), &Palette::default()).voxels(0, 0).unwrap(), texel.depths[0].voxels);
    }

    #[test]
    fn leaves_in_other_colours_let_other_light_through() {
        let texel = texel(&[("bark", [0.2; 3]), ("leaf", [0.1, 0.4, 0.1])], &[([0.1, 0.4, 0.1], Mix::one(1))]);
        let mut texel = texel;
        let leaf = SurfaceParams { transmission: [0.1, 0.4, 0.05], ..SurfaceParams::default() };
        super::super::surface::store(&[SurfaceParams::default(), leaf], &mut texel.info.meta);
        let seen = |style: Style| {
            let palette = Palette { styles: [("leaf".into(), style)].into(), ..Palette::default() };
            let restyled = Restyled::new(texel.clone(), &palette);
            let voxels = restyled.voxels(0, 0).unwrap();
            let table = SurfaceTable::new(&texel.info).unwrap();
            let surfaces = restyled.surfaces(0, 0, &voxels, &table).unwrap();
            (voxels[0].albedo(), surfaces[0].transmission())
        };
        let (reflected, through) = seen(Style { factor: [2.0, 0.5, 1.0], keeps_albedo: true, ..Style::UNCHANGED });
        assert!(near(reflected, [0.2, 0.2, 0.1]) && near(through, [0.2, 0.2, 0.05]), "{reflected} {through}");
        // A new colour is that of both, in the shares that the leaf has: half, half and two thirds reflected.
        let (reflected, through) = seen(Style { factor: [0.8, 0.3, 0.6], keeps_albedo: false, ..Style::UNCHANGED });
        assert!(near(reflected, [0.4, 0.15, 0.4]) && near(through, [0.4, 0.15, 0.2]), "{reflected} {through}");
    }

    #[test]
    fn materials_have_finishes_of_their_own() {
        let mix = Mix::new([(0, 0.5), (1, 0.5)], FINE_STEP);
        let texel = texel(&[("bark", [0.2; 3]), ("leaf", [0.4; 3])], &[([0.3; 3], mix), ([0.2; 3], Mix::one(0))]);
        let finish = Finish { ambient: [0.0; 3], specular: Some([0.5; 3]), shininess: Some(30.0) };
        let palette =
            Palette { styles: [("leaf".into(), Style { finish, ..Style::UNCHANGED })].into(), ..Palette::default() };
        assert!(!palette.is_plain());
        let restyled = Restyled::new(texel, &palette);
        let voxels = restyled.voxels(0, 0).unwrap();
        let table = restyled.surface_table().unwrap();
        let [mixed, bark] = restyled.surfaces(0, 0, &voxels, &table).unwrap()[..] else { panic!() };
        // Half of the matter is leaf, and two thirds of what is reflected. Steps of shares (1/63) and of codes.
        let near = |a: f32, b: f32| (a - b).abs() < 0.015;
        assert!(near(mixed.ambient().x, 1.0 / 3.0) && near(mixed.gloss().specular.x, 0.25), "{mixed:?}");
        assert!(near(mixed.without_gloss(), 0.5) && (mixed.gloss().shininess / 30.0 - 1.0).abs() < 0.02, "{mixed:?}");
        assert_eq!(bark, VoxelSurface::default());
    }

    #[test]
    fn black_materials_and_no_materials() {
        let texel_of_none = texel(&[], &[([0.25, 1.0, 0.0], Mix::default())]);
        let half =
            Palette { rest: Style { factor: [0.5; 3], keeps_albedo: true, ..Style::UNCHANGED }, ..Palette::default() };
        assert!(near(seen(&texel_of_none, &half)[0], [0.125, 0.5, 0.0]));
        let black =
            texel(&[("a", [0.0; 3]), ("b", [0.0; 3])], &[([0.5; 3], Mix::new([(0, 1.0), (1, 3.0)], FINE_STEP))]);
        let half = Palette {
            styles: [("b".into(), Style { factor: [0.0; 3], keeps_albedo: true, ..Style::UNCHANGED })].into(),
            ..Palette::default()
        };
        assert!(near(seen(&black, &half)[0], [0.125; 3]));
    }
}
