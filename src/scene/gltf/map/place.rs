//! Rigid copies: where each stands, how it is turned, how large it is and in which tint.

use std::f64::consts::TAU;

use glam::DQuat;
use serde_json::Value;

use super::super::document::Document;
use super::super::nodes::Graph;
use super::super::write::Editor;
use super::copies::{self, Kind, Stand};
use super::options::{Arrangement, Cells, Covered, MapOptions, MaskOver, PointsTable};
use super::plan::Plan;
use super::points::{self, PlacedPoint, PointsUp};
use super::scatter::{Border, Discs, Lookup, Point, Target};
use super::sieve::Sieve;
use super::surface::{Coordinates, Surface, WRITTEN};
use crate::geom::DVec3;
use crate::random::SplitMix64;
use crate::scene::shell::Orientations;
use crate::{Error, Result, Warnings};

/// The least distance between copies, in mean spacings. Random darts fill the plane at .83, and independent points have none:
/// at this, stands look grown, neither planted in rows nor thrown.
const APART: f64 = 0.7;
/// Steeper slopes sink copies no more than this one does (tangent).
const STEEPEST: f64 = 2.0;
/// More copies than this are not placed in one mapping.
const MOST_COPIES: f64 = (1u64 << 24) as f64;
/// Texture coordinates that leave the unit square by no more are taken to lie in it.
const SQUARE: f64 = 0.01;

/// Place copies on `surfaces`, whose cells are `cell` wide, and add their nodes to the file; what to say of them.
///
/// # Errors
/// `Limit` where there would be too many; as [`points::read`] for a table of places.
pub fn place(
    (document, graph): (&Document, &Graph),
    options: &MapOptions,
    (plan, surfaces, cell): (&Plan, &[&Surface], [f64; 2]),
    texels: &[usize],
    editor: &mut Editor,
    (notes, warnings): (&mut Vec<String>, &mut Warnings),
) -> Result<Vec<Covered>> {
    let mut target = Target::default();
    for (i, surface) in surfaces.iter().enumerate() {
        for world in &surface.worlds {
            surface.faces(*world, Coordinates::Uv).for_each(|f| target.push(&f, i));
        }
    }
    let kinds = copies::kinds(options, cell, &target, notes, warnings);
    let mut planter = Planter::new(options, plan, (surfaces, &target), (&kinds, texels));
    match &options.points {
        Some(table) => planter.by_table(table, origin(editor), warnings)?,
        None => {
            let over = mask_over(options, surfaces, notes);
            let sieve = Sieve::new(options, &target, over, plan.up);
            let per_area = density(options, cell, &kinds);
            let wanted = per_area * target.area() * options.presence;
            if wanted.is_nan() || wanted > MOST_COPIES {
                let (needed, allowed) = (wanted as u64, MOST_COPIES as u64);
                return Err(Error::Limit {
                    what: "placing copies (option `density`, option `sizes`)".into(),
                    needed,
                    allowed,
                });
            }
            let standing = if options.add { copies::standing(document, graph, surfaces)? } else { Vec::new() };
            match options.arrangement {
                Arrangement::Scattered => planter.scatter(&sieve, (per_area, wanted), &standing, notes),
                Arrangement::Rows => planter.in_rows(&sieve, per_area)?,
            }
        }
    }
    if planter.overhanging > 0 {
        let n = planter.overhanging;
        notes.push(format!("{n} copies that would overhang the border were left out (option `inset`)"));
    }
    let mut stands = planter.stands;
    stands.sort_by_key(|s| (s.material, s.kind));
    let mut covered = Vec::new();
    for stand in &stands {
        let kind = &kinds[stand.kind];
        let material = stand.material.and_then(|m| document.root.materials.get(m));
        let name = material.and_then(|m| m.name.clone());
        let name = name.or(stand.material.map(|m| format!("material {m}"))).unwrap_or_else(|| "bare faces".into());
        copies::write(options, kind, stand, &name, texels.get(stand.kind).copied().unwrap_or(0), editor)?;
        let largest = match options.points {
            Some(_) => f64::from(stand.scales.iter().copied().fold(0.0, f32::max)),
            None => kind.size * options.scale[1],
        };
        let size = kind.content.size() * largest;
        covered.push(Covered {
            material: name,
            texel: Some(kind.name.clone()),
            cell: [size.x, size.z],
            height: size.y,
            copies: stand.translations.len() as f64,
        });
    }
    if covered.is_empty() {
        warnings.add("nothing was placed: no place was left for a copy (option `density`, option `sizes`, option `presence`, slope, altitude)");
    }
    Ok(covered)
}

/// What a picture of densities lies on, and a word about it.
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

/// East and north of the scene's origin, where the ground has them.
fn origin(editor: &Editor) -> Option<[f64; 2]> {
    let origin = editor.json.pointer(&format!("/extras/{WRITTEN}/origin"))?.as_array()?;
    let numbers: Vec<f64> = origin.iter().filter_map(Value::as_f64).collect();
    <[f64; 2]>::try_from(numbers).ok()
}

/// Copies per square metre.
fn density(options: &MapOptions, cell: [f64; 2], kinds: &[Kind]) -> f64 {
    if let Some(density) = options.density {
        return density;
    }
    if options.cells != Cells::Texel {
        return 1.0 / (cell[0] * cell[1]);
    }
    // Crowns touch.
    let mean = mean_square_width(kinds);
    if mean > 0.0 { 1.0 / mean } else { 1.0 }
}

fn mean_square_width(kinds: &[Kind]) -> f64 {
    kinds.iter().map(|k| k.share * k.width() * k.width()).sum()
}

/// Half the least distance between two copies of one kind: kinds share the ground by their widths.
fn radius(kind: &Kind, kinds: &[Kind], density: f64) -> f64 {
    let mean = mean_square_width(kinds);
    let share = if mean > 0.0 { kind.width() / mean.sqrt() } else { 1.0 };
    0.5 * APART * share / density.sqrt()
}

/// Where one copy stands; what a table says of it, which replaces chance.
struct Spot<'p> {
    point: Point,
    said: Option<&'p PlacedPoint>,
}

/// Puts copies into the ground, one after the other.
struct Planter<'a> {
    options: &'a MapOptions,
    plan: &'a Plan,
    surfaces: &'a [&'a Surface],
    target: &'a Target,
    kinds: &'a [Kind],
    texels: &'a [usize],
    border: Option<Border>,
    random: SplitMix64,
    stands: Vec<Stand>,
    overhanging: u64,
}

impl<'a> Planter<'a> {
    fn new(
        options: &'a MapOptions,
        plan: &'a Plan,
        (surfaces, target): (&'a [&'a Surface], &'a Target),
        (kinds, texels): (&'a [Kind], &'a [usize]),
    ) -> Planter<'a> {
        let border = options.inset.then(|| {
            let reach = kinds.iter().map(|k| k.reach() * options.scale[1]).fold(0.0, f64::max);
            Border::new(&target.border(), reach, plan.up)
        });
        let random = SplitMix64::new(u64::from(options.seed));
        let stands = Vec::new();
        Planter { options, plan, surfaces, target, kinds, texels, border, random, stands, overhanging: 0 }
    }

    /// Irregularly, with a least distance from each other, and a quarter of a width from what stands already: the new may grow
    /// under the crowns of the old.
    fn scatter(&mut self, sieve: &Sieve, (per_area, wanted): (f64, f64), standing: &[DVec3], notes: &mut Vec<String>) {
        let kinds = self.kinds;
        let widest = kinds.iter().map(|k| radius(k, kinds, per_area).max(0.25 * k.width())).fold(0.0, f64::max);
        let mut discs = Discs::new(widest);
        let room = kinds.iter().map(|k| 0.5 * k.width() - radius(k, kinds, per_area)).fold(f64::INFINITY, f64::min);
        standing.iter().for_each(|&p| discs.insert(p, room));
        // The widest first: they find room less easily.
        let mut order: Vec<usize> = (0..kinds.len()).collect();
        order.sort_by(|&a, &b| kinds[b].width().total_cmp(&kinds[a].width()).then(a.cmp(&b)));
        let (mut before, mut missing, mut share) = (0.0, 0.0, 0.0);
        for kind in order {
            // Shares that add up to the whole number of copies.
            share += kinds[kind].share;
            let upto = wanted * share;
            let count = upto.round() - f64::round(before);
            before = upto;
            let radius = radius(&kinds[kind], kinds, per_area);
            let points = discs.throw(self.target, count.max(0.0) as usize, radius, &mut self.random);
            missing += count - points.len() as f64;
            for point in points {
                // What is thinned keeps its room, or the next kind would crowd into it.
                if sieve.is_open() || self.random.unit() < sieve.share(&point) {
                    self.plant(kind, &Spot { point, said: None });
                }
            }
        }
        if missing >= 1.0 {
            notes.push(format!("{missing:.0} copies found no room at their least distance"));
        }
    }

    /// In rows along x and z, moved by the displacement, with gaps by the presence and the sieve.
    fn in_rows(&mut self, sieve: &Sieve, per_area: f64) -> Result<()> {
        let lookup = Lookup::new(self.target);
        let (bounds, step) = (self.target.bounds(), 1.0 / per_area.sqrt());
        let counts = [bounds.size().x / step, bounds.size().z / step].map(|n| n.floor().max(1.0));
        let needed = counts[0] * counts[1];
        if needed.is_nan() || needed > MOST_COPIES {
            let (needed, allowed) = (needed as u64, MOST_COPIES as u64);
            return Err(Error::Limit {
                what: "placing copies (option `density`, option `sizes`)".into(),
                needed,
                allowed,
            });
        }
        let middle = bounds.centre();
        for row in 0..counts[1] as u64 {
            for column in 0..counts[0] as u64 {
                let [i, j] = [(column, counts[0]), (row, counts[1])].map(|(k, n)| k as f64 + 0.5 - 0.5 * n);
                let [du, dv] = [0, 1].map(|k| self.options.displace[k] * self.random.signed());
                let (present, kind) = (self.random.unit() < self.options.presence, self.random.unit());
                let thinned = self.random.unit();
                let Some(point) = lookup.at(middle.x + (i + du) * step, middle.z + (j + dv) * step) else { continue };
                if present && thinned < sieve.share(&point) {
                    self.plant(self.kind_of(kind), &Spot { point, said: None });
                }
            }
        }
        Ok(())
    }

    /// Where a table says.
    fn by_table(&mut self, table: &PointsTable, ground: Option<[f64; 2]>, warnings: &mut Warnings) -> Result<()> {
        let names: Vec<String> = self.kinds.iter().map(|k| k.name.clone()).collect();
        let rows = points::read(&table.path, table.up, &names, warnings)?;
        let ground = ground.filter(|_| table.up == PointsUp::Z);
        let [x, y] = table.origin.or(ground).unwrap_or_default();
        let origin = if table.up == PointsUp::Z { DVec3::new(x, 0.0, -y) } else { DVec3::new(x, 0.0, y) };
        let lookup = Lookup::new(self.target);
        let mut beside = 0;
        for row in &rows {
            let at = row.at - origin;
            let below = lookup.at(at.x, at.z);
            let point = match (row.has_height, below) {
                (true, below) => {
                    let surface = below.map_or(0, |b| b.surface);
                    Point { at, normal: below.map_or(DVec3::Y, |b| b.normal), surface, uv: [0.0; 2] }
                }
                (false, Some(point)) => point,
                (false, None) => {
                    beside += 1;
                    continue;
                }
            };
            let kind = self.random.unit();
            let kind = row.texel.unwrap_or_else(|| self.kind_of(kind));
            self.plant(kind, &Spot { point, said: Some(row) });
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

    /// The kind at `unit` in [0, 1) of all shares.
    fn kind_of(&self, unit: f64) -> usize {
        let mut below = 0.0;
        let found = self.kinds.iter().position(|k| {
            below += k.share;
            unit < below
        });
        found.unwrap_or(self.kinds.len().saturating_sub(1))
    }

    /// Place one copy, unless it would overhang where it must not.
    fn plant(&mut self, kind: usize, spot: &Spot) {
        let (own, point, said) = (&self.kinds[kind], &spot.point, spot.said);
        let up = self.plan.up.unwrap_or(point.normal);
        let [least, most] = self.options.scale;
        let chance = least + self.random.unit() * (most - least);
        let high = own.content.size().y;
        let scale = match said.map(|s| (s.size, s.scale)) {
            Some((Some(metres), factor)) if high > 0.0 => metres / high * factor.unwrap_or(1.0),
            Some((_, Some(factor))) => own.size * factor,
            _ => own.size * chance,
        };
        let turn = self.random.unit() * TAU;
        let turn = if self.options.orientations == Orientations::Identity { 0.0 } else { turn };
        let turn = said.and_then(|s| s.turn).unwrap_or(turn);
        let ramp = self.options.tint_by_copy().map(|[a, b]| {
            let t = self.random.unit();
            std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
        });
        let tint = said.and_then(|s| s.tint).or(ramp);
        if self.border.as_ref().is_some_and(|b| b.is_within(point.at, own.reach() * scale / own.size, up)) {
            self.overhanging += 1;
            return;
        }
        let rotation = DQuat::from_rotation_arc(DVec3::Y, up) * DQuat::from_rotation_y(turn);
        let cosine = point.normal.dot(up).abs().clamp(1e-6, 1.0);
        let slope = ((1.0 - cosine * cosine).sqrt() / cosine).min(STEEPEST);
        let at = point.at - up * (self.options.sink * slope) - rotation * (own.pivot * scale);
        let material = self.surfaces.get(point.surface).and_then(|s| s.material);
        let stand = self.stand(material, kind);
        // The tints of those before it that have none.
        if tint.is_some() || !stand.tints.is_empty() {
            stand.tints.resize(stand.translations.len(), [1.0; 3]);
            stand.tints.push(tint.unwrap_or([1.0; 3]).map(|v| v as f32));
        }
        stand.translations.push(at);
        stand.rotations.push(rotation.to_array().map(|v| v as f32));
        stand.scales.push(scale as f32);
    }

    /// The stand of a kind on a material; a texel that is given twice comes twice as often, in one stand.
    fn stand(&mut self, material: Option<usize>, kind: usize) -> &mut Stand {
        let same =
            |k: &usize| self.texels.get(*k) == self.texels.get(kind) && self.kinds[*k].size == self.kinds[kind].size;
        let shown = (0..self.kinds.len()).find(same).unwrap_or(kind);
        let own = self.stands.iter().position(|s| (s.material, s.kind) == (material, shown));
        let own = own.unwrap_or_else(|| {
            let (translations, rotations, scales, tints) = (vec![], vec![], vec![], vec![]);
            self.stands.push(Stand { material, kind: shown, translations, rotations, scales, tints });
            self.stands.len() - 1
        });
        &mut self.stands[own]
    }
}
