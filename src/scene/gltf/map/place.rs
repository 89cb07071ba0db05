//! Placement of rigid copies: position, rotation, size and tint of each.

use std::f64::consts::TAU;

use glam::DQuat;
use serde_json::Value;

use super::super::document::Document;
use super::super::nodes::Graph;
use super::super::write::Editor;
use super::copies::{self, CopyGroup, CopyModel};
use super::density::DensityFilter;
use super::options::{Arrangement, Cells, Covered, MapOptions, MaskOver, PointsTable};
use super::plan::Plan;
use super::points::{self, PlacedPoint, PointsUp};
use super::scatter::{Border, GroundLookup, PoissonDiscs, SampledTriangles, SurfacePoint};
use super::surface::{Coordinates, Surface, WRITTEN};
use crate::geom::DVec3;
use crate::random::SplitMix64;
use crate::scene::shell::Orientations;
use crate::{Error, Result, Warnings};

/// Least distance between copies, in mean spacings. Dart throwing fills the plane at .83, and independent random points have no least
/// distance; at this value copies look naturally grown, neither planted in rows nor strewn.
const MIN_SPACING: f64 = 0.7;
/// Slope (tangent) from which on copies are not sunk any deeper.
const MAX_SINK_SLOPE: f64 = 2.0;
/// Most copies of one mapping.
const MAX_COPIES: f64 = (1u64 << 24) as f64;
/// Distance outside of the unit square at which texture coordinates still count as inside.
const SQUARE: f64 = 0.01;

/// The surfaces on which copies are placed, and the file that they are part of.
pub struct Ground<'a> {
    pub document: &'a Document,
    pub graph: &'a Graph,
    pub plan: &'a Plan,
    pub surfaces: &'a [&'a Surface],
    /// Size of a cell along u and v, metres, the same on all surfaces.
    pub cell: [f64; 2],
}

/// Place copies on the ground, and add their nodes to the file; `texels` index the root's list. Returns what was placed, by material and
/// texel.
///
/// # Errors
/// `Limit` where there would be too many; as [`points::read`] for a table of places.
pub fn place(
    ground: &Ground<'_>,
    options: &MapOptions,
    texels: &[usize],
    editor: &mut Editor,
    notes: &mut Vec<String>,
    warnings: &mut Warnings,
) -> Result<Vec<Covered>> {
    let Ground { plan, surfaces, cell, .. } = *ground;
    let mut target = SampledTriangles::default();
    for (i, surface) in surfaces.iter().enumerate() {
        for world in &surface.worlds {
            surface.faces(*world, Coordinates::Uv).for_each(|f| target.push(&f, i));
        }
    }
    let models = copies::models(options, cell, &target, notes, warnings);
    let mut placer = CopyPlacer::new(options, plan, (surfaces, &target), (&models, texels));
    match &options.points {
        Some(table) => placer.by_table(table, origin(editor), warnings)?,
        None => {
            let over = mask_over(options, surfaces, notes);
            let filter = DensityFilter::new(options, &target, over, plan.up);
            let per_area = density(options, cell, &models);
            let wanted = per_area * target.area() * options.presence;
            check_count(wanted)?;
            let existing = if options.add {
                copies::existing_positions(ground.document, ground.graph, surfaces)?
            } else {
                Vec::new()
            };
            match options.arrangement {
                Arrangement::Scattered => placer.scatter(&filter, (per_area, wanted), &existing, notes),
                Arrangement::Rows => placer.in_rows(&filter, per_area)?,
            }
        }
    }
    if placer.overhanging > 0 {
        let n = placer.overhanging;
        notes.push(format!("{n} copies that would overhang the border were left out (option `inset`)"));
    }
    let mut groups = placer.groups;
    groups.sort_by_key(|group| (group.material, group.model));
    let mut covered = Vec::new();
    for group in &groups {
        let model = &models[group.model];
        let name = material_name(ground.document, group.material);
        copies::write(options, model, group, &name, texels.get(group.model).copied().unwrap_or(0), editor)?;
        covered.push(report(options, model, group, name));
    }
    if covered.is_empty() {
        warnings.add("nothing was placed: no place was left for a copy (option `density`, option `sizes`, option `presence`, slope, altitude)");
    }
    Ok(covered)
}

/// Check that a number of copies is within the limit.
fn check_count(wanted: f64) -> Result<()> {
    if wanted.is_nan() || wanted > MAX_COPIES {
        let (needed, allowed) = (wanted as u64, MAX_COPIES as u64);
        return Err(Error::Limit { what: "placing copies (option `density`, option `sizes`)".into(), needed, allowed });
    }
    Ok(())
}

/// Name of a material for messages and nodes.
fn material_name(document: &Document, material: Option<usize>) -> String {
    let name = material.and_then(|m| document.root.materials.get(m)).and_then(|m| m.name.clone());
    name.or(material.map(|m| format!("material {m}"))).unwrap_or_else(|| "bare faces".into())
}

/// What was placed of one group.
fn report(options: &MapOptions, model: &CopyModel, group: &CopyGroup, material: String) -> Covered {
    let largest = match options.points {
        Some(_) => f64::from(group.scales.iter().copied().fold(0.0, f32::max)),
        None => model.size * options.scale[1],
    };
    let size = model.content.size() * largest;
    let texel = Some(model.name.clone());
    Covered { material, texel, cell: [size.x, size.z], height: size.y, copies: group.translations.len() as f64 }
}

/// The domain of the density map, with a note about the choice.
fn mask_over(options: &MapOptions, surfaces: &[&Surface], notes: &mut Vec<String>) -> MaskOver {
    let inside = |s: &&Surface| {
        let faces = s.faces(s.world(), Coordinates::Uv);
        s.geometry.has_uvs() && faces.flat_map(|f| f.chart).flatten().all(|x| (-SQUARE..=1.0 + SQUARE).contains(&x))
    };
    let over =
        options.map_over.unwrap_or_else(|| if surfaces.iter().all(inside) { MaskOver::Uv } else { MaskOver::Bounds });
    if options.density_map.is_some() {
        notes.push(match over {
            MaskOver::Uv => {
                "density map: over the texture coordinates (option `map_over` lays it on the ground)".into()
            }
            MaskOver::Bounds => {
                "density map: over the bounds of what is covered, seen from above, north (−z) up (option `map_over` lays it over texture coordinates)".into()
            }
        });
    }
    over
}

/// East and north of the scene's origin, metres, if the ground has a place in a map.
fn origin(editor: &Editor) -> Option<[f64; 2]> {
    let origin = editor.json.pointer(&format!("/extras/{WRITTEN}/origin"))?.as_array()?;
    let numbers: Vec<f64> = origin.iter().filter_map(Value::as_f64).collect();
    <[f64; 2]>::try_from(numbers).ok()
}

/// Copies per square metre.
fn density(options: &MapOptions, cell: [f64; 2], models: &[CopyModel]) -> f64 {
    if let Some(density) = options.density {
        return density;
    }
    if options.cells != Cells::Texel {
        return 1.0 / (cell[0] * cell[1]);
    }
    // By default the crowns of copies touch.
    let mean = mean_square_width(models);
    if mean > 0.0 { 1.0 / mean } else { 1.0 }
}

fn mean_square_width(models: &[CopyModel]) -> f64 {
    models.iter().map(|k| k.share * k.width() * k.width()).sum()
}

/// Half the least distance between two copies of one model, in metres. It is in proportion to the model's width.
fn radius(model: &CopyModel, models: &[CopyModel], density: f64) -> f64 {
    let mean = mean_square_width(models);
    let share = if mean > 0.0 { model.width() / mean.sqrt() } else { 1.0 };
    0.5 * MIN_SPACING * share / density.sqrt()
}

/// The site of one copy. A row of a table replaces random choices.
struct Site<'p> {
    point: SurfacePoint,
    row: Option<&'p PlacedPoint>,
}

/// Places copies one after the other.
struct CopyPlacer<'a> {
    options: &'a MapOptions,
    plan: &'a Plan,
    surfaces: &'a [&'a Surface],
    target: &'a SampledTriangles,
    models: &'a [CopyModel],
    texels: &'a [usize],
    border: Option<Border>,
    random: SplitMix64,
    groups: Vec<CopyGroup>,
    overhanging: u64,
}

impl<'a> CopyPlacer<'a> {
    fn new(
        options: &'a MapOptions,
        plan: &'a Plan,
        (surfaces, target): (&'a [&'a Surface], &'a SampledTriangles),
        (models, texels): (&'a [CopyModel], &'a [usize]),
    ) -> CopyPlacer<'a> {
        let border = options.inset.then(|| {
            let reach = models.iter().map(|k| k.reach() * options.scale[1]).fold(0.0, f64::max);
            Border::new(&target.border(), reach, plan.up)
        });
        let random = SplitMix64::new(u64::from(options.seed));
        let groups = Vec::new();
        CopyPlacer { options, plan, surfaces, target, models, texels, border, random, groups, overhanging: 0 }
    }

    /// Place copies irregularly, with a least distance from each other, and at least a quarter of their width from copies of earlier mappings:
    /// new copies may stand under the crowns of old ones.
    fn scatter(
        &mut self,
        filter: &DensityFilter,
        (per_area, wanted): (f64, f64),
        standing: &[DVec3],
        notes: &mut Vec<String>,
    ) {
        let models = self.models;
        let widest = models.iter().map(|k| radius(k, models, per_area).max(0.25 * k.width())).fold(0.0, f64::max);
        let mut discs = PoissonDiscs::new(widest);
        let room = models.iter().map(|k| 0.5 * k.width() - radius(k, models, per_area)).fold(f64::INFINITY, f64::min);
        standing.iter().for_each(|&p| discs.insert(p, room));
        // Wide models come first, since they find room less easily.
        let mut order: Vec<usize> = (0..models.len()).collect();
        order.sort_by(|&a, &b| models[b].width().total_cmp(&models[a].width()).then(a.cmp(&b)));
        let (mut before, mut missing, mut share) = (0.0, 0.0, 0.0);
        for model in order {
            // Rounded so that the counts of all models add up to the wanted number.
            share += models[model].share;
            let upto = wanted * share;
            let count = upto.round() - f64::round(before);
            before = upto;
            let radius = radius(&models[model], models, per_area);
            let points = discs.throw(self.target, count.max(0.0) as usize, radius, &mut self.random);
            missing += count - points.len() as f64;
            for point in points {
                // A copy that is thinned out keeps its disc, or the next model would fill the gap.
                if filter.is_open() || self.random.unit() < filter.share(&point) {
                    self.add_copy(model, &Site { point, row: None });
                }
            }
        }
        if missing >= 1.0 {
            notes.push(format!("{missing:.0} copies found no room at their least distance"));
        }
    }

    /// Place copies in rows along x and z, with random displacements, and with gaps by the presence and the density filter.
    fn in_rows(&mut self, filter: &DensityFilter, per_area: f64) -> Result<()> {
        let lookup = GroundLookup::new(self.target);
        let (bounds, step) = (self.target.bounds(), 1.0 / per_area.sqrt());
        let counts = [bounds.size().x / step, bounds.size().z / step].map(|n| n.floor().max(1.0));
        check_count(counts[0] * counts[1])?;
        let middle = bounds.centre();
        for row in 0..counts[1] as u64 {
            for column in 0..counts[0] as u64 {
                let [i, j] = [(column, counts[0]), (row, counts[1])].map(|(k, n)| k as f64 + 0.5 - 0.5 * n);
                let [du, dv] = [0, 1].map(|k| self.options.displace[k] * self.random.signed());
                let (present, model) = (self.random.unit() < self.options.presence, self.random.unit());
                let thinned = self.random.unit();
                let Some(point) = lookup.at(middle.x + (i + du) * step, middle.z + (j + dv) * step) else { continue };
                if present && thinned < filter.share(&point) {
                    self.add_copy(self.model_at(model), &Site { point, row: None });
                }
            }
        }
        Ok(())
    }

    /// Place copies where a table says.
    fn by_table(&mut self, table: &PointsTable, ground: Option<[f64; 2]>, warnings: &mut Warnings) -> Result<()> {
        let names: Vec<String> = self.models.iter().map(|k| k.name.clone()).collect();
        let rows = points::read(&table.path, table.up, &names, warnings)?;
        let ground = ground.filter(|_| table.up == PointsUp::Z);
        let [x, y] = table.origin.or(ground).unwrap_or_default();
        let origin = if table.up == PointsUp::Z { DVec3::new(x, 0.0, -y) } else { DVec3::new(x, 0.0, y) };
        let lookup = GroundLookup::new(self.target);
        let mut beside = 0;
        for row in &rows {
            let at = row.at - origin;
            let below = lookup.at(at.x, at.z);
            let point = match (row.has_height, below) {
                (true, below) => {
                    let surface = below.map_or(0, |b| b.surface);
                    SurfacePoint { at, normal: below.map_or(DVec3::Y, |b| b.normal), surface, uv: [0.0; 2] }
                }
                (false, Some(point)) => point,
                (false, None) => {
                    beside += 1;
                    continue;
                }
            };
            let model = self.random.unit();
            let model = row.texel.unwrap_or_else(|| self.model_at(model));
            self.add_copy(model, &Site { point, row: Some(row) });
        }
        if beside == rows.len() as u64 {
            let bounds = self.target.bounds();
            let (min, max) = (bounds.min, bounds.max);
            let what = format!(
                "no point lies on the ground, which is x {:.1} to {:.1}, north {:.1} to {:.1} (option `points_origin` moves them)",
                min.x + origin.x,
                max.x + origin.x,
                -max.z - origin.z,
                -min.z - origin.z
            );
            return Err(Error::input(&table.path, "", what));
        }
        warnings.add_many(format!("{}: points beside the ground are left out", table.path.display()), beside);
        Ok(())
    }

    /// The model that a random number `unit` in [0, 1) selects by the models' shares.
    fn model_at(&self, unit: f64) -> usize {
        let mut below = 0.0;
        let found = self.models.iter().position(|k| {
            below += k.share;
            unit < below
        });
        found.unwrap_or(self.models.len().saturating_sub(1))
    }

    /// Place one copy, unless it would overhang the border and option `inset` forbids that.
    fn add_copy(&mut self, model: usize, site: &Site) {
        let (own, point, row) = (&self.models[model], &site.point, site.row);
        let up = self.plan.up.unwrap_or(point.normal);
        let [least, most] = self.options.scale;
        let chance = least + self.random.unit() * (most - least);
        let high = own.content.size().y;
        let scale = match row.map(|s| (s.size, s.scale)) {
            Some((Some(metres), factor)) if high > 0.0 => metres / high * factor.unwrap_or(1.0),
            Some((_, Some(factor))) => own.size * factor,
            _ => own.size * chance,
        };
        let turn = self.random.unit() * TAU;
        let turn = if self.options.orientations == Orientations::Identity { 0.0 } else { turn };
        let turn = row.and_then(|s| s.turn).unwrap_or(turn);
        let ramp = self.options.tint_by_copy().map(|[a, b]| {
            let t = self.random.unit();
            std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
        });
        let tint = row.and_then(|s| s.tint).or(ramp);
        if self.border.as_ref().is_some_and(|b| b.is_within(point.at, own.reach() * scale / own.size, up)) {
            self.overhanging += 1;
            return;
        }
        let rotation = DQuat::from_rotation_arc(DVec3::Y, up) * DQuat::from_rotation_y(turn);
        let cosine = point.normal.dot(up).abs().clamp(1e-6, 1.0);
        let slope = ((1.0 - cosine * cosine).sqrt() / cosine).min(MAX_SINK_SLOPE);
        let at = point.at - up * (self.options.sink * slope) - rotation * (own.pivot * scale);
        let material = self.surfaces.get(point.surface).and_then(|s| s.material);
        let group = self.group(material, model);
        // Copies before the first tinted one get the tint 1.
        if tint.is_some() || !group.tints.is_empty() {
            group.tints.resize(group.translations.len(), [1.0; 3]);
            group.tints.push(tint.unwrap_or([1.0; 3]).map(|v| v as f32));
        }
        group.translations.push(at);
        group.rotations.push(rotation.to_array().map(|v| v as f32));
        group.scales.push(scale as f32);
    }

    /// The group of copies of a model on a material. A texel that is given twice comes twice as often, in one group.
    fn group(&mut self, material: Option<usize>, model: usize) -> &mut CopyGroup {
        let same = |k: &usize| {
            self.texels.get(*k) == self.texels.get(model) && self.models[*k].size == self.models[model].size
        };
        let shown = (0..self.models.len()).find(same).unwrap_or(model);
        let own = self.groups.iter().position(|s| (s.material, s.model) == (material, shown));
        let own = own.unwrap_or_else(|| {
            let (translations, rotations, scales, tints) = (vec![], vec![], vec![], vec![]);
            self.groups.push(CopyGroup { material, model: shown, translations, rotations, scales, tints });
            self.groups.len() - 1
        });
        &mut self.groups[own]
    }
}
