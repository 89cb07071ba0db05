//! Rigid copies of texels in a glTF file: nodes whose mesh is a stand-in for a texel, with their placements.

use super::document::Document;
use super::extension::{self, TexelTable};
use super::nodes::{Instancing, Placed};
use crate::scene::copies::CopySet;
use crate::{Result, Warnings};

/// For each material, whether meshes with it are stand-ins for copies.
pub fn stand_ins(document: &Document) -> Vec<bool> {
    let stands = |m: &gltf::json::Material| {
        let json = m.extensions.as_ref().and_then(|e| e.others.get(extension::NAME));
        json.is_some_and(extension::places_copies)
    };
    document.root.materials.iter().map(stands).collect()
}

/// The copies that a node places, for each of the materials of its mesh that stand for some; `material` indexes the file's.
pub fn read(
    document: &Document,
    placed: &Placed,
    material: usize,
    texels: &mut TexelTable,
    warnings: &mut Warnings,
) -> Result<CopySet> {
    let json = document.root.materials.get(material).and_then(|m| m.extensions.as_ref()?.others.get(extension::NAME));
    let at = format!("materials[{material}]");
    let json = json.ok_or_else(|| document.error(&*at, "places no copies"))?;
    let variants = extension::copies(document, json, &at, texels, warnings)?;
    let mut set = CopySet {
        node: placed.name.clone(),
        to_world: placed.world,
        variants,
        translations: vec![[0.0; 3]],
        rotations: Vec::new(),
        scales: Vec::new(),
        choices: Vec::new(),
        tints: Vec::new(),
        phases: Vec::new(),
        wind: extension::wind_of_copies(document, json, &at, texels, warnings)?,
    };
    let Some(instancing) = Instancing::of(document, placed) else { return Ok(set) };
    let (translations, rotations, scales) =
        (instancing.floats::<3>("TRANSLATION")?, instancing.floats::<4>("ROTATION")?, instancing.floats::<3>("SCALE")?);
    let choices = instancing.floats::<1>("_VTEX_VARIANT")?;
    let tints = instancing.floats::<4>("_VTEX_TINT")?;
    let phases = instancing.floats::<1>("_VTEX_PHASE")?;
    let lengths = [
        translations.as_ref().map(Vec::len),
        rotations.as_ref().map(Vec::len),
        scales.as_ref().map(Vec::len),
        choices.as_ref().map(Vec::len),
        tints.as_ref().map(Vec::len),
        phases.as_ref().map(Vec::len),
    ];
    let Some(count) = instancing.count(&lengths)? else { return Ok(set) };
    set.translations = translations.unwrap_or_else(|| vec![[0.0; 3]; count]);
    set.rotations = rotations.unwrap_or_default();
    set.scales = scales.unwrap_or_default();
    set.choices = sound_choices(choices.unwrap_or_default(), set.variants.len(), warnings);
    set.tints = sound_tints(tints.unwrap_or_default(), warnings);
    set.phases = sound_phases(phases.unwrap_or_default(), warnings);
    drop_broken(&mut set, warnings);
    Ok(set)
}

fn sound_choices(choices: Vec<[f32; 1]>, variants: usize, warnings: &mut Warnings) -> Vec<u8> {
    let mut beyond = 0;
    let choice = |[v]: [f32; 1]| {
        let inside = v >= 0.0 && v.fract() == 0.0 && (v as usize) < variants;
        beyond += u64::from(!inside);
        if inside { v as u8 } else { 0 }
    };
    let out = choices.into_iter().map(choice).collect();
    warnings.add_many("a copy's _VTEX_VARIANT is none of its variants; it is shown as the first", beyond);
    out
}

fn sound_tints(tints: Vec<[f32; 4]>, warnings: &mut Warnings) -> Vec<[f32; 3]> {
    let mut mended = 0;
    let tint = |[r, g, b, _]: [f32; 4]| {
        [r, g, b].map(|v| {
            let valid = v.is_finite() && v >= 0.0;
            mended += u64::from(!valid);
            if valid { v } else { 1.0 }
        })
    };
    let out = tints.into_iter().map(tint).collect();
    warnings.add_many("a copy's _VTEX_TINT is not at least 0; it is read as 1", mended);
    out
}

fn sound_phases(phases: Vec<[f32; 1]>, warnings: &mut Warnings) -> Vec<f32> {
    let broken = phases.iter().filter(|[p]| !p.is_finite()).count();
    warnings.add_many("a copy's _VTEX_PHASE is not a number; it is read as 0", broken as u64);
    phases.into_iter().map(|[p]| if p.is_finite() { p } else { 0.0 }).collect()
}

/// Remove copies whose transform is not finite or has no volume.
fn drop_broken(set: &mut CopySet, warnings: &mut Warnings) {
    let sound = |i: usize| {
        let map = set.local(i);
        let volume = map.matrix3.determinant();
        map.is_finite() && volume != 0.0 && volume.is_finite()
    };
    let keep: Vec<bool> = (0..set.len()).map(sound).collect();
    let broken = keep.iter().filter(|k| !**k).count();
    if broken == 0 {
        return;
    }
    fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
        let mut each = keep.iter();
        values.retain(|_| each.next().copied().unwrap_or(false));
    }
    retain(&mut set.translations, &keep);
    retain(&mut set.rotations, &keep);
    retain(&mut set.scales, &keep);
    retain(&mut set.choices, &keep);
    retain(&mut set.tints, &keep);
    retain(&mut set.phases, &keep);
    warnings.add_many("a copy of a texel with a broken transform, or of no size, is left out", broken as u64);
}
