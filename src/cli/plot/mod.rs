//! Plots of measurements: lines and marks over two axes, as .svg or .png.

mod raster;

use std::io::Write as _;
use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::format::PartFile;
use crate::render::image_io;
use crate::scene::files::extension;
use crate::{Error, Result};
use raster::{Picture, Raster};

/// A series of points.
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
    /// Joined, besides being marked.
    pub line: bool,
}

/// Where values lie along an axis.
#[derive(Clone, Copy, PartialEq)]
pub enum Scale {
    /// From 0.
    Linear,
    /// From the least value that is above 0.
    Log,
}

impl Scale {
    /// Whether a value has a place along the axis.
    fn shows(self, value: f64) -> bool {
        self == Scale::Linear || value > 0.0
    }
}

pub struct Axis {
    pub label: String,
    pub scale: Scale,
}

pub struct Chart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// Values of y that are aimed at: thin lines across.
    pub aims: Vec<f64>,
}

/// Colours that are told apart by the colour-blind too (B. Wong, *Points of View: Color Blindness*, Nature Methods 2011).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(0, 0, 0),
];
/// Pixels of one chart.
const SIZE: (u32, u32) = (760, 460);
/// A .png is drawn so much larger, then averaged.
const FINER: u32 = 2;

/// Where a plot can be written to.
///
/// # Errors
/// `Options` for a name that ends in neither .svg nor .png.
pub fn check_name(path: &Path) -> Result<()> {
    match extension(path).as_str() {
        "svg" | "png" => Ok(()),
        _ => Err(Error::Options(format!("{}: a plot is written to a name that ends in .svg or .png", path.display()))),
    }
}

/// Write charts, `columns` side by side.
///
/// # Errors
/// As [`check_name`], and `Io` where the file cannot be written.
pub fn write(path: &Path, charts: &[Chart], columns: usize) -> Result<()> {
    check_name(path)?;
    let columns = columns.clamp(1, charts.len().max(1));
    let rows = charts.len().div_ceil(columns).max(1);
    let size = (SIZE.0 * columns as u32, SIZE.1 * rows as u32);
    let failed = |e: String| Error::Options(format!("{}: the plot cannot be drawn: {e}", path.display()));
    if extension(path) == "svg" {
        let mut text = String::new();
        draw(SVGBackend::with_string(&mut text, size).into_drawing_area(), charts, (rows, columns), 1)
            .map_err(failed)?;
        let mut part = PartFile::create(path)?;
        part.write_all(text.as_bytes()).map_err(|e| Error::io(path, e))?;
        return part.finish();
    }
    let mut picture = Picture::new(size.0 * FINER, size.1 * FINER);
    draw(Raster(&mut picture).into_drawing_area(), charts, (rows, columns), FINER).map_err(failed)?;
    image_io::write_png(path, size.0 as usize, size.1 as usize, &picture.averaged(FINER as usize))
}

fn draw<B: DrawingBackend>(
    area: DrawingArea<B, Shift>,
    charts: &[Chart],
    shape: (usize, usize),
    scale: u32,
) -> std::result::Result<(), String> {
    area.fill(&WHITE).map_err(|e| e.to_string())?;
    for (chart, area) in charts.iter().zip(area.split_evenly(shape)) {
        chart.draw(&area, scale).map_err(|e| e.to_string())?;
    }
    area.present().map_err(|e| e.to_string())
}

/// What a chart is drawn on, and what comes of drawing.
type Plane<'a, B> = ChartContext<'a, B, Cartesian2d<Along, Along>>;
type Drawn<B> = std::result::Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl Chart {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, scale: u32) -> Drawn<B> {
        let values =
            |of: fn(&(f64, f64)) -> f64| self.series.iter().flat_map(|s| &s.points).map(of).collect::<Vec<_>>();
        let aims: Vec<f64> = self.aims.clone();
        let (x, y) = (range(self.x.scale, &values(|p| p.0)), range(self.y.scale, &[values(|p| p.1), aims].concat()));
        let legend = self.emptiest(x, y);
        let font = |size: u32| ("sans-serif", size * scale);
        let mut builder = ChartBuilder::on(area);
        let mut chart = builder
            .caption(&self.title, font(18))
            .margin(12 * scale)
            .x_label_area_size(46 * scale)
            .y_label_area_size(64 * scale)
            .build_cartesian_2d(Along::new(self.x.scale, x), Along::new(self.y.scale, y))?;
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .label_style(font(14))
            .axis_desc_style(font(14))
            .bold_line_style(BLACK.mix(0.15))
            .light_line_style(BLACK.mix(0.05))
            .x_label_formatter(&|v| short(*v))
            .y_label_formatter(&|v| short(*v))
            .draw()?;
        self.draw_aims(&mut chart, scale)?;
        self.draw_series(&mut chart, scale)?;
        chart
            .configure_series_labels()
            .position(legend)
            .legend_area_size(18 * scale)
            .margin(8 * scale)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .label_font(font(14))
            .draw()
    }

    /// Lines across, from the first point to the last.
    fn draw_aims<B: DrawingBackend>(&self, chart: &mut Plane<B>, scale: u32) -> Drawn<B> {
        let xs = self.series.iter().flat_map(|s| &s.points).map(|p| p.0).filter(|x| self.x.scale.shows(*x));
        let (left, right) = xs.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
        for &aim in &self.aims {
            chart.draw_series(LineSeries::new([(left, aim), (right, aim)], BLACK.mix(0.4).stroke_width(scale)))?;
        }
        Ok(())
    }

    fn draw_series<B: DrawingBackend>(&self, chart: &mut Plane<B>, scale: u32) -> Drawn<B> {
        for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
            let shown = |p: &&(f64, f64)| self.x.scale.shows(p.0) && self.y.scale.shows(p.1);
            let points: Vec<(f64, f64)> = series.points.iter().filter(shown).copied().collect();
            if series.line {
                chart.draw_series(LineSeries::new(points.clone(), colour.stroke_width(2 * scale)))?;
            }
            chart
                .draw_series(points.iter().map(|p| Circle::new(*p, 3 * scale as i32, colour.filled())))?
                .label(&series.name)
                .legend(move |(x, y)| Circle::new((x + 8 * scale as i32, y), 4 * scale as i32, colour.filled()));
        }
        Ok(())
    }

    /// The corner with the fewest points, where axes go over `x` and `y`.
    fn emptiest(&self, x: (f64, f64), y: (f64, f64)) -> SeriesLabelPosition {
        let corners = [
            ([1.0, 1.0], SeriesLabelPosition::UpperRight),
            ([0.0, 1.0], SeriesLabelPosition::UpperLeft),
            ([1.0, 0.0], SeriesLabelPosition::LowerRight),
            ([0.0, 0.0], SeriesLabelPosition::LowerLeft),
        ];
        let points = || self.series.iter().flat_map(|series| &series.points);
        // Some two fifths of the chart, as shares of its width and height.
        let near = |[right, top]: [f64; 2]| {
            let within = |p: &&(f64, f64)| {
                let (across, up) = (share(self.x.scale, p.0, x), share(self.y.scale, p.1, y));
                (across - right).abs() < 0.35 && (up - top).abs() < 0.4
            };
            points().filter(within).count()
        };
        corners.into_iter().min_by_key(|corner| near(corner.0)).map_or(SeriesLabelPosition::UpperRight, |c| c.1)
    }
}

/// Where a value is between the ends of an axis, from 0 to 1.
fn share(scale: Scale, value: f64, (from, to): (f64, f64)) -> f64 {
    match scale {
        Scale::Linear => (value - from) / (to - from),
        Scale::Log => libm::log(value / from) / libm::log(to / from),
    }
}

/// Coordinate along an axis of either scale. One type for both, as plotters' code is compiled for each pair of types.
enum Along {
    Linear(RangedCoordf64),
    Log(LogCoord<f64>),
}

impl Along {
    fn new(scale: Scale, (from, to): (f64, f64)) -> Along {
        match scale {
            Scale::Linear => Along::Linear((from..to).into()),
            Scale::Log => Along::Log((from..to).log_scale().into()),
        }
    }
}

impl Ranged for Along {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        match self {
            Along::Linear(c) => c.map(value, limit),
            Along::Log(c) => c.map(value, limit),
        }
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match self {
            Along::Linear(c) => c.key_points(hint),
            Along::Log(c) => c.key_points(hint),
        }
    }

    fn range(&self) -> std::ops::Range<f64> {
        match self {
            Along::Linear(c) => c.range(),
            Along::Log(c) => c.range(),
        }
    }
}

/// From where to where an axis goes.
fn range(scale: Scale, values: &[f64]) -> (f64, f64) {
    let usable = values.iter().copied().filter(|v| v.is_finite() && scale.shows(*v));
    let (lo, hi) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    match scale {
        _ if lo > hi => (0.1, 1.0),
        Scale::Linear => (lo.min(0.0), if hi > lo.min(0.0) { hi * 1.25 } else { 1.0 }),
        Scale::Log => (lo / 1.3, hi * 1.3),
    }
}

/// Three significant digits.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    let digits = (2 - libm::floor(libm::log10(v.abs())) as i32).clamp(0, 9);
    let text = format!("{v:.*}", digits as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_legend_is_where_no_points_are() {
        let corner = |points: &[(f64, f64)]| {
            let series = vec![Series { name: "one".into(), points: points.to_vec(), line: true }];
            let axis = |scale| Axis { label: String::new(), scale };
            let (x, y) = (axis(Scale::Log), axis(Scale::Linear));
            Chart { title: String::new(), x, y, series, aims: Vec::new() }.emptiest((1.0, 1e6), (0.0, 10.0))
        };
        assert!(matches!(corner(&[]), SeriesLabelPosition::UpperRight));
        assert!(matches!(corner(&[(1.0, 1.0), (9e5, 9.0)]), SeriesLabelPosition::UpperLeft));
        assert!(matches!(corner(&[(1.0, 9.0), (9e5, 9.0)]), SeriesLabelPosition::LowerRight));
    }

    fn chart(x: Scale, y: Scale) -> Chart {
        let series =
            |name: &str, points: &[(f64, f64)]| Series { name: name.into(), points: points.to_vec(), line: true };
        Chart {
            title: "a plot".into(),
            x: Axis { label: "across".into(), scale: x },
            y: Axis { label: "up".into(), scale: y },
            series: vec![series("one", &[(1.0, 0.1), (4.0, 0.02)]), series("none", &[]), series("zero", &[(0.0, 0.0)])],
            aims: vec![0.06],
        }
    }

    #[test]
    fn charts_of_every_scale_are_written() {
        let dir = tempfile::tempdir().unwrap();
        let charts = [Scale::Linear, Scale::Log].map(|x| [Scale::Linear, Scale::Log].map(|y| chart(x, y)));
        let charts: Vec<Chart> = charts.into_iter().flatten().collect();
        let (svg, png) = (dir.path().join("a.svg"), dir.path().join("a.png"));
        write(&svg, &charts, 2).unwrap();
        let text = std::fs::read_to_string(&svg).unwrap();
        assert!(text.contains("across") && text.contains("</svg>"));
        write(&png, &charts, 2).unwrap();
        let picture = image::open(&png).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (2 * SIZE.0, 2 * SIZE.1));
        assert!(picture.pixels().filter(|p| p.0 == [0, 114, 178]).count() > 50);
        assert!(check_name(Path::new("a.pdf")).is_err());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.0, 0.05, 12345.0, 1.5].map(short), ["0", "0.05", "12345", "1.5"]);
    }
}
