//! The channels of a voxel as streams of small integers, and how many steps each is given.
//!
//! The *canonical* codes are those of [`Voxel`] in memory. A stream stores codes q from 0 to its own maximum, `q_max`, each of which
//! stands for one canonical code. `widen` gives that code and is prescribed by the format; `narrow` finds the best q and is this
//! writer's own choice.

use super::layout::StreamEntry;
use super::material;
use crate::par;
use crate::volume::{Channels, Depth, Sggx, Volume, Voxel};

/// Fineness of the channels in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quality {
    /// Fewer steps per channel, which takes about two thirds of the bytes.
    Lean,
    /// As many steps as make a visible difference in pictures.
    #[default]
    Full,
}

/// Content of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Channel {
    /// Rate: hits per voxel edge inside the support, log2.
    Rate,
    /// Square roots of the diagonal of the SGGX matrix: the axis of the largest, which is 1, then those of the two axes that follow it
    /// cyclically.
    NdfDiagonal,
    /// Correlations of the SGGX matrix.
    NdfCorrelation,
    /// Block correlation c.
    BlockCorrelation,
    /// Support box: one code per axis, with the distance from the lower face in the low bits and that from the upper face in the high
    /// bits.
    Support,
    /// One-sidedness: |mean area vector| / area.
    OneSidedness,
    /// Direction of the mean area vector, octahedral.
    MeanNormal,
    /// Square root of linear albedo.
    Albedo,
    /// Mix of materials, which is no field of a [`Voxel`].
    Material,
}

/// Largest number of codes that a channel of a [`Voxel`] has.
pub(super) const MAX_COMPONENTS: usize = 3;

impl Channel {
    /// Every channel, in the order of the file.
    pub const ALL: [Channel; 9] = [
        Channel::Rate,
        Channel::NdfDiagonal,
        Channel::NdfCorrelation,
        Channel::BlockCorrelation,
        Channel::Support,
        Channel::OneSidedness,
        Channel::MeanNormal,
        Channel::Albedo,
        Channel::Material,
    ];

    /// The four characters of the stream table.
    pub fn semantic(self) -> [u8; 4] {
        *match self {
            Channel::Rate => b"RATE",
            Channel::NdfDiagonal => b"NDFD",
            Channel::NdfCorrelation => b"NDFC",
            Channel::BlockCorrelation => b"CORR",
            Channel::Support => b"SUPP",
            Channel::OneSidedness => b"SIDE",
            Channel::MeanNormal => b"MEAN",
            Channel::Albedo => b"ALBD",
            Channel::Material => b"MATL",
        }
    }

    /// Channel of the four characters `semantic`; `None` where this version knows none.
    pub fn from_semantic(semantic: [u8; 4]) -> Option<Channel> {
        Channel::ALL.into_iter().find(|c| c.semantic() == semantic)
    }

    /// The name that reports use.
    pub fn name(self) -> &'static str {
        match self {
            Channel::Rate => "rate",
            Channel::NdfDiagonal => "ndf diagonal",
            Channel::NdfCorrelation => "ndf correlation",
            Channel::BlockCorrelation => "block correlation",
            Channel::Support => "support",
            Channel::OneSidedness => "one-sidedness",
            Channel::MeanNormal => "mean normal",
            Channel::Albedo => "albedo",
            Channel::Material => "material",
        }
    }

    /// Number of codes per voxel in a stream with the largest code `q_max`, which in a stream of mixes is one less than the number of
    /// materials.
    pub fn components(self, q_max: u16) -> usize {
        match self {
            Channel::Material => material::components(usize::from(q_max) + 1),
            Channel::Rate | Channel::BlockCorrelation | Channel::OneSidedness => 1,
            Channel::MeanNormal => 2,
            Channel::NdfDiagonal | Channel::NdfCorrelation | Channel::Support | Channel::Albedo => 3,
        }
    }

    /// Largest code of the streams that this writer makes.
    pub(super) fn quant_max(self, quality: Quality) -> u8 {
        let (full, lean) = match self {
            Channel::Rate => (128, 64),
            Channel::NdfDiagonal => (47, 19),
            Channel::NdfCorrelation => (22, 10),
            Channel::BlockCorrelation => (15, 15),
            Channel::Support => (63, 15),
            Channel::OneSidedness => (15, 7),
            // 64 steps would be visible on smooth solids.
            Channel::MeanNormal => (255, 31),
            Channel::Albedo => (63, 31),
            // Not used: the largest code follows from the number of materials.
            Channel::Material => (1, 1),
        };
        if quality == Quality::Full { full } else { lean }
    }

    /// Whether Q may be the largest code of this channel's streams.
    pub(super) fn allows(self, q_max: u16) -> bool {
        match self {
            Channel::Rate | Channel::NdfDiagonal => (2..=255).contains(&q_max),
            Channel::NdfCorrelation => (2..=254).contains(&q_max) && q_max.is_multiple_of(2),
            Channel::Support => [3, 15, 63, 255].contains(&q_max),
            Channel::BlockCorrelation | Channel::OneSidedness => (1..=15).contains(&q_max),
            Channel::MeanNormal | Channel::Albedo => (1..=255).contains(&q_max),
            Channel::Material => (1..=254).contains(&q_max),
        }
    }

    /// Largest code of component `k`.
    pub(super) fn component_max(self, k: usize, q_max: u8) -> u8 {
        match self {
            Channel::NdfDiagonal if k == 0 => 2,
            Channel::Material => material::component_max(usize::from(q_max) + 1, k),
            _ => q_max,
        }
    }

    /// Canonical code that `q`, 0 to `q_max`, stands for in component `k`.
    pub(super) fn widen(self, k: usize, q: u8, q_max: u8) -> u8 {
        let (q, m) = (u32::from(q.min(q_max)), u32::from(q_max));
        // round(a · q / b), halves up.
        let scale = |a: u32, q: u32, b: u32| (2 * a * q + b) / (2 * b);
        let code = match self {
            Channel::Rate if q == 0 => 0,
            Channel::Rate => 1 + scale(254, q - 1, m - 1),
            Channel::NdfCorrelation if 2 * q < m => 128 - scale(127, m / 2 - q, m / 2),
            Channel::NdfCorrelation => 128 + scale(127, q - m / 2, m / 2),
            Channel::Support => {
                let steps = (m + 1).isqrt();
                let (lo, hi) = (q % steps * (16 / steps), q / steps * (16 / steps));
                lo | hi << 4
            }
            Channel::BlockCorrelation | Channel::OneSidedness => scale(15, q, m),
            Channel::NdfDiagonal if k == 0 => q.min(2),
            Channel::NdfDiagonal | Channel::MeanNormal | Channel::Albedo => scale(255, q, m),
            Channel::Material => q,
        };
        code as u8
    }

    /// Code `q` that stands best for a canonical code of component `k`: the nearest one, and the even one of two equally near ones, so
    /// that rounding has no bias. Supports are rounded outward, and a rate becomes 0 only if it was 0.
    pub(super) fn narrow(self, k: usize, code: u8, q_max: u8) -> u8 {
        let distance = |q: u8| {
            let wide = self.widen(k, q, q_max);
            match self {
                Channel::Support if wide & 15 > code & 15 || wide >> 4 > code >> 4 => u16::MAX,
                Channel::Support => u16::from((code & 15) - (wide & 15)) + u16::from((code >> 4) - (wide >> 4)),
                Channel::Rate if (q == 0) != (code == 0) => u16::MAX,
                _ => wide.abs_diff(code).into(),
            }
        };
        (0..=self.component_max(k, q_max)).min_by_key(|&q| (distance(q), q & 1)).unwrap_or(0)
    }

    /// Largest difference between a value that is encoded and the one that is decoded, canonical rounding included. The unit
    /// is that of the decode equation: log2 of the rate, voxel edges of the support, linear albedo, else the number itself.
    pub(super) fn max_abs_error(self, q_max: u8) -> f32 {
        if self == Channel::Material {
            return 1.0 / f32::from(crate::volume::material::SHARE_SUM);
        }
        let value = |code: u8| match self {
            Channel::Rate => f64::from(code) / 16.0,
            Channel::NdfDiagonal => f64::from(code) / 255.0,
            Channel::NdfCorrelation => (f64::from(code) - 128.0) / 127.0,
            Channel::BlockCorrelation | Channel::OneSidedness => f64::from(code) / 15.0,
            Channel::Support => f64::from(code & 15) / 16.0,
            Channel::MeanNormal => f64::from(code) / 127.5,
            Channel::Albedo => f64::from(code) / 255.0 * f64::from(code) / 255.0,
            Channel::Material => f64::from(code),
        };
        let (first, last) = match self {
            Channel::Rate | Channel::NdfCorrelation => (1, 255),
            Channel::Support | Channel::BlockCorrelation | Channel::OneSidedness => (0, 15),
            _ => (0, 255),
        };
        // The outward rounding of the canonical support loses up to a whole step, the others half of one.
        let step = (value(last) - value(last - 1)) * if self == Channel::Support { 1.0 } else { 0.5 };
        let narrowed = |code| (value(code) - value(self.widen(1, self.narrow(1, code, q_max), q_max))).abs();
        (step + (first..=last).map(narrowed).fold(0.0, f64::max)) as f32
    }

    /// Copy this channel's canonical codes out of a voxel.
    pub(super) fn get(self, v: &Voxel, out: &mut [u8; MAX_COMPONENTS]) {
        match self {
            Channel::Rate => out[0] = v.rate,
            Channel::NdfDiagonal => {
                let k = largest_diagonal(v);
                *out = [k as u8, v.ndf[(k + 1) % 3], v.ndf[(k + 2) % 3]];
            }
            Channel::NdfCorrelation => out[..3].copy_from_slice(&v.ndf[3..]),
            Channel::BlockCorrelation => out[0] = v.correlation & 15,
            Channel::Support => *out = v.support,
            Channel::OneSidedness => out[0] = v.correlation >> 4,
            Channel::MeanNormal => out[..2].copy_from_slice(&v.mean_normal),
            Channel::Albedo => out[..3].copy_from_slice(&v.albedo),
            Channel::Material => {}
        }
    }

    fn canonical_codes(self, v: &Voxel) -> [u8; MAX_COMPONENTS] {
        let mut out = [0; MAX_COMPONENTS];
        self.get(v, &mut out);
        out
    }

    /// Put canonical codes into a voxel.
    #[inline]
    pub(super) fn set(self, v: &mut Voxel, codes: &[u8; MAX_COMPONENTS]) {
        match self {
            Channel::Rate => v.rate = codes[0],
            Channel::NdfDiagonal => {
                let k = usize::from(codes[0]);
                (v.ndf[k % 3], v.ndf[(k + 1) % 3], v.ndf[(k + 2) % 3]) = (255, codes[1], codes[2]);
            }
            Channel::NdfCorrelation => v.ndf[3..].copy_from_slice(&codes[..3]),
            Channel::BlockCorrelation => v.correlation = v.correlation & 0xf0 | codes[0] & 15,
            Channel::Support => v.support = *codes,
            Channel::OneSidedness => v.correlation = v.correlation & 15 | codes[0] << 4,
            Channel::MeanNormal => v.mean_normal.copy_from_slice(&codes[..2]),
            Channel::Albedo => v.albedo.copy_from_slice(&codes[..3]),
            Channel::Material => {}
        }
    }
}

/// Axis with the largest diagonal element of the SGGX matrix; the first of equal ones.
fn largest_diagonal(v: &Voxel) -> usize {
    (1..3).fold(0, |best, k| if v.ndf[k] > v.ndf[best] { k } else { best })
}

/// The voxel in its canonical form, of all that decode to the same: without matter it is the default, correlations with an axis of no
/// projected area are 0, the support box is not inside out, and without one-sidedness the mean normal is the default.
pub(super) fn canonical(v: &Voxel) -> Voxel {
    if v.rate == 0 {
        return Voxel::default();
    }
    let mut v = *v;
    for (slot, axes) in [(3, [0, 1]), (4, [0, 2]), (5, [1, 2])] {
        v.ndf[slot] = v.ndf[slot].max(1);
        if axes.iter().any(|&a| v.ndf[a] == 0) {
            v.ndf[slot] = 128;
        }
    }
    for side in &mut v.support {
        let lo = *side & 15;
        *side = lo | (*side >> 4).min(15 - lo) << 4;
    }
    if v.correlation >> 4 == 0 {
        v.mean_normal = Voxel::default().mean_normal;
    }
    v
}

/// [`canonical`] form of a voxel whose largest diagonal element is scaled to 1, as in every file; the rate is divided by the scale.
fn normalize_ndf(v: &Voxel) -> Voxel {
    let mut v = canonical(v);
    let most = v.ndf[largest_diagonal(&v)];
    if most == 0 {
        v.ndf = Sggx::ISOTROPIC.encode();
    } else if most < 255 {
        let scale = |d: u8| ((510 * u32::from(d) + u32::from(most)) / (2 * u32::from(most))) as u8;
        (v.ndf[0], v.ndf[1], v.ndf[2]) = (scale(v.ndf[0]), scale(v.ndf[1]), scale(v.ndf[2]));
        v.rate = scaled_rate(v.rate, f64::from(most) / 255.0);
    }
    v
}

/// Code of the rate with the code `rate` times `factor`; never below 1.
fn scaled_rate(rate: u8, factor: f64) -> u8 {
    (f64::from(rate) + 16.0 * libm::log2(factor)).round().clamp(1.0, 255.0) as u8
}

/// Voxel streams of a file, and the tables that map between their codes and canonical ones.
pub(super) struct Quantiser {
    streams: Vec<(Channel, u8, Box<[Tables; MAX_COMPONENTS]>)>,
}

/// Tables of one component: from canonical codes to a stream's, and back.
struct Tables {
    narrow: [u8; 256],
    widen: [u8; 256],
}

/// Whether at least 15 of 16 voxels have the same colour as the voxel before them.
fn flat_colours(depths: &[Depth]) -> bool {
    let (mut pairs, mut alike) = (0u64, 0u64);
    for depth in depths {
        for pair in depth.voxels.windows(2) {
            pairs += 1;
            alike += u64::from(pair[0].albedo == pair[1].albedo);
        }
    }
    16 * alike >= 15 * pairs
}

fn tables(c: Channel, q_max: u8) -> Box<[Tables; MAX_COMPONENTS]> {
    Box::new(std::array::from_fn(|k| Tables {
        narrow: std::array::from_fn(|code| c.narrow(k, code as u8, q_max)),
        widen: std::array::from_fn(|q| c.widen(k, q as u8, q_max)),
    }))
}

impl Quantiser {
    pub fn new(channels: &Channels, quality: Quality) -> Quantiser {
        let has = |c: Channel| match c {
            Channel::Rate | Channel::NdfDiagonal | Channel::NdfCorrelation => true,
            Channel::BlockCorrelation => channels.correlation,
            Channel::Support => channels.support,
            Channel::OneSidedness | Channel::MeanNormal => channels.mean_normal,
            Channel::Albedo => channels.albedo,
            Channel::Material => false,
        };
        Quantiser::of(Channel::ALL.into_iter().filter(|&c| has(c)).map(|c| (c, c.quant_max(quality))))
    }

    /// Quantiser for the voxels of `volume`. Where colours repeat from voxel to voxel they are stored with all 256 steps: repeated codes
    /// compress to next to nothing, and on evenly coloured surfaces the error of 64 steps would be visible (1.6 % too bright, FLIP
    /// .04 on a ball).
    pub fn fitting(volume: &Volume, quality: Quality) -> Quantiser {
        let mut quantiser = Quantiser::new(&volume.info.channels, quality);
        let flat = quality == Quality::Full && flat_colours(&volume.depths);
        let albedo = quantiser.streams.iter_mut().find(|s| s.0 == Channel::Albedo);
        if let Some(stream) = albedo.filter(|_| flat) {
            *stream = (Channel::Albedo, 255, tables(Channel::Albedo, 255));
        }
        quantiser
    }

    /// Quantiser for streams of these channels and largest codes.
    pub fn of(streams: impl Iterator<Item = (Channel, u8)>) -> Quantiser {
        Quantiser { streams: streams.map(|(c, q_max)| (c, q_max, tables(c, q_max))).collect() }
    }

    pub fn channels(&self) -> impl Iterator<Item = Channel> {
        self.streams.iter().map(|(c, ..)| *c)
    }

    pub fn q_max(&self, channel: Channel) -> u8 {
        self.streams.iter().find(|(c, ..)| *c == channel).map_or(0, |(_, q_max, _)| *q_max)
    }

    /// Voxel that a reader will decode in place of `v`.
    pub fn quantise(&self, v: &Voxel) -> Voxel {
        let v = normalize_ndf(v);
        let mut out = Voxel::default();
        let mut codes = [0; MAX_COMPONENTS];
        for (channel, _, tables) in &self.streams {
            channel.get(&v, &mut codes);
            coarsen(tables, &mut codes);
            channel.set(&mut out, &codes);
        }
        if out.support != v.support && self.q_max(Channel::Support) > 0 {
            // The support box grew, so its rate falls: the same matter fills a larger box.
            codes[0] = scaled_rate(v.rate, volume(&v) / volume(&out));
            if let Some((.., tables)) = self.streams.iter().find(|(c, ..)| *c == Channel::Rate) {
                coarsen(tables, &mut codes);
            }
            out.rate = codes[0];
        }
        canonical(&out)
    }

    /// Entries of the stream table, with the `constants` that [`Quantiser::constants`] gave.
    pub fn entries(&self, constants: &[Option<[u8; MAX_COMPONENTS]>]) -> Vec<StreamEntry> {
        let entry = |(channel, constant): (Channel, &Option<[u8; MAX_COMPONENTS]>)| {
            let mut entry = StreamEntry::of(channel, self.q_max(channel), constant.as_ref().map(|c| &c[..]));
            entry.flags |= StreamEntry::CRITICAL;
            entry
        };
        self.channels().zip(constants).map(entry).collect()
    }

    /// Albedo codes that a reader will decode in place of those of `v`.
    pub fn albedo(&self, v: &Voxel) -> [u8; 3] {
        match self.streams.iter().find(|(c, ..)| *c == Channel::Albedo) {
            Some((.., tables)) if v.rate > 0 => {
                let mut codes = v.albedo;
                coarsen(tables, &mut codes);
                codes
            }
            _ => Voxel::default().albedo,
        }
    }

    /// Codes of the stream `s` for voxels that [`Quantiser::quantise`] gave.
    pub fn codes(&self, s: usize, voxels: &[Voxel]) -> Vec<u8> {
        let Some((channel, q_max, tables)) = self.streams.get(s) else { return Vec::new() };
        let n = channel.components((*q_max).into());
        let mut out = vec![0; voxels.len() * n];
        let mut codes = [0; MAX_COMPONENTS];
        for (v, slot) in voxels.iter().zip(out.chunks_exact_mut(n)) {
            channel.get(v, &mut codes);
            for ((q, c), table) in slot.iter_mut().zip(codes).zip(tables.iter()) {
                *q = table.narrow[usize::from(c)];
            }
        }
        out
    }

    /// For each stream, its codes if they are the same in every voxel of every depth.
    pub fn constants(&self, volume: &Volume) -> Vec<Option<[u8; MAX_COMPONENTS]>> {
        const RUN: usize = 1 << 14;
        let first = volume.depths.iter().flat_map(|d| d.voxels.first()).next().copied().unwrap_or_default();
        let first = self.quantise(&first);
        let mut constant = vec![true; self.streams.len()];
        for depth in &volume.depths {
            let runs: Vec<&[Voxel]> = depth.voxels.chunks(RUN).collect();
            let same = par::map(runs.len(), |i| {
                let mut same = constant.clone();
                for v in runs[i] {
                    let v = self.quantise(v);
                    for (same, (channel, ..)) in same.iter_mut().zip(&self.streams) {
                        *same &= channel.canonical_codes(&v) == channel.canonical_codes(&first);
                    }
                    if !same.contains(&true) {
                        break;
                    }
                }
                same
            });
            same.into_iter().for_each(|same| constant.iter_mut().zip(same).for_each(|(all, same)| *all &= same));
        }
        let codes = |(s, constant): (usize, bool)| {
            constant.then(|| {
                let mut out = [0; MAX_COMPONENTS];
                self.codes(s, &[first]).iter().zip(&mut out).for_each(|(&q, slot)| *slot = q);
                out
            })
        };
        constant.into_iter().enumerate().map(codes).collect()
    }

    /// Set the fields of the voxel `v` that the stream `s` holds, from its `codes` of that voxel.
    #[inline]
    pub fn put(&self, s: usize, v: &mut Voxel, codes: &[u8]) {
        let Some((channel, _, tables)) = self.streams.get(s) else { return };
        let mut wide = [0; MAX_COMPONENTS];
        for ((w, &q), table) in wide.iter_mut().zip(codes).zip(tables.iter()) {
            *w = table.widen[usize::from(q)];
        }
        channel.set(v, &wide);
    }
}

/// Replace canonical codes by those that a reader will decode.
fn coarsen(tables: &[Tables; MAX_COMPONENTS], codes: &mut [u8; MAX_COMPONENTS]) {
    for (c, table) in codes.iter_mut().zip(tables) {
        *c = table.widen[usize::from(table.narrow[usize::from(*c)])];
    }
}

/// Volume of the support box in sixteenths cubed.
fn volume(v: &Voxel) -> f64 {
    v.support.iter().map(|b| 16.0 - f64::from(b & 15) - f64::from(b >> 4)).product::<f64>().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_widened_narrows_back() {
        for channel in Channel::ALL.into_iter().filter(|c| *c != Channel::Material) {
            for q_max in (1..=255u8).filter(|&q| channel.allows(q.into())) {
                for k in 0..channel.components(q_max.into()) {
                    for q in 0..=channel.component_max(k, q_max) {
                        assert_eq!(channel.narrow(k, channel.widen(k, q, q_max), q_max), q, "{channel:?} {k} {q_max}");
                    }
                }
            }
        }
    }

    #[test]
    fn full_scale_and_zero_are_exact() {
        for quality in [Quality::Full, Quality::Lean] {
            let ends = |c: Channel| {
                (c.widen(1, 0, c.quant_max(quality)), c.widen(1, c.quant_max(quality), c.quant_max(quality)))
            };
            assert_eq!(ends(Channel::Rate), (0, 255));
            assert_eq!(ends(Channel::NdfDiagonal), (0, 255));
            assert_eq!(ends(Channel::NdfCorrelation), (1, 255));
            assert_eq!(ends(Channel::BlockCorrelation), (0, 15));
            assert_eq!(ends(Channel::Albedo), (0, 255));
            let middle = Channel::NdfCorrelation.quant_max(quality) / 2;
            assert_eq!(Channel::NdfCorrelation.widen(0, middle, 2 * middle), 128);
        }
    }

    #[test]
    fn colours_are_flat_where_they_repeat() {
        let coloured = |colour: &dyn Fn(u8) -> u8| {
            let voxels = (0..64).map(|i| Voxel { albedo: [colour(i); 3], ..Voxel::default() }).collect();
            flat_colours(&[Depth { masks: Vec::new(), voxels, mixes: Vec::new() }])
        };
        assert!(coloured(&|i| if i < 40 { 213 } else { 7 }));
        assert!(!coloured(&|i| i / 2));
        assert!((0..=255).all(|code| Channel::Albedo.widen(0, Channel::Albedo.narrow(0, code, 255), 255) == code));
    }

    #[test]
    fn rates_are_rounded_without_bias() {
        let q_max = Channel::Rate.quant_max(Quality::Full);
        let shift =
            |code: u8| i32::from(Channel::Rate.widen(0, Channel::Rate.narrow(0, code, q_max), q_max)) - i32::from(code);
        let sum: i32 = (1..=255).map(shift).sum();
        assert!(sum.abs() <= 2, "{sum}");
    }

    #[test]
    fn support_grows_and_takes_its_matter_along() {
        let quantiser = Quantiser::new(&Channels { support: true, ..Channels::default() }, Quality::Full);
        let mut v = Voxel { rate: 161, ..Voxel::default() };
        v.set_support([0.0625, 0.0, 0.0], [0.5, 1.0, 1.0]);
        let wide = quantiser.quantise(&v);
        assert_eq!(wide.support_box().0.x, 0.0);
        assert_eq!(wide.support_box().1.x, 0.5);
        // 7/8 of the rate: 16 log2(7/8) = -3.08 of 161 is 158, which rounds to an odd code.
        assert!((157..=159).contains(&wide.rate), "{}", wide.rate);
    }

    #[test]
    fn stated_errors_hold() {
        // Half a canonical step and half a step of the code, for the finest and a coarse code.
        assert!((Channel::NdfDiagonal.max_abs_error(255) - 0.5 / 255.0).abs() < 1e-6);
        assert!((Channel::NdfDiagonal.max_abs_error(47) - (0.5 / 255.0 + 0.5 / 47.0)).abs() < 0.5 / 255.0);
        assert!((Channel::Support.max_abs_error(63) - 2.0 / 16.0).abs() < 1e-6);
    }
}
