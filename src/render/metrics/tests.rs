//! Metrics against closed forms and published values.

use super::*;
use crate::render::image_io::srgb_decode;

type Painter = fn(u32, u32) -> [u32; 3];

/// An 8-bit sRGB picture given by a formula.
fn paint(width: usize, height: usize, f: Painter) -> Image {
    Image::from_fn(width, height, |x, y| {
        let [r, g, b] = f(x as u32, y as u32).map(|c| srgb_decode(c as f32 / 255.0));
        [r, g, b, 1.0]
    })
}

fn noise(x: u32, y: u32, seed: u32) -> u32 {
    let h = x
        .wrapping_mul(374_761_393)
        .wrapping_add(y.wrapping_mul(668_265_263))
        .wrapping_add(seed.wrapping_mul(2_246_822_519));
    let h = (h ^ (h >> 13)).wrapping_mul(1_274_126_177);
    h ^ (h >> 16)
}

fn grain(x: u32, y: u32, seed: u32) -> [u32; 3] {
    let n = noise(x, y, seed);
    [n & 255, (n >> 8) & 255, (n >> 16) & 255]
}

/// A speckled crown before a sky, a ground and thin stems.
fn tree(x: u32, y: u32) -> [u32; 3] {
    let n = noise(x, y, 1);
    if x.abs_diff(30).pow(2) + y.abs_diff(30).pow(2) < 225 {
        [40 + n % 40, 90 + (n >> 8) % 60, 30]
    } else if y > 20 && x.is_multiple_of(17) {
        [90, 70, 50]
    } else if y < 28 {
        [120 + 2 * y, 160 + y, 230 - y]
    } else {
        [60 + (3 * x + 5 * y) % 40, 110 + n % 50, 40 + (n >> 8) % 30]
    }
}

/// [`tree`], a pixel to the left and noisy.
fn shaken(x: u32, y: u32) -> [u32; 3] {
    let n = noise(x, y, 2);
    let c = tree(x + 1, y);
    std::array::from_fn(|k| (c[k] + ((n >> (8 * k)) & 15)).saturating_sub(8).min(255))
}

fn ramp(x: u32, y: u32) -> [u32; 3] {
    [(2 * x).min(255), (3 * y).min(255), 128]
}

/// Means, and the first, the middle and the last pixel, as flip-evaluator 1.7 gives them (`evaluate(…, "LDR")`).
#[test]
fn flip_agrees_with_flip_evaluator() {
    let near: Painter = |x, _| if x >= 32 { [101, 100, 100] } else { [100; 3] };
    type Case = (&'static str, [usize; 2], Painter, Painter, f64, f64, [f32; 3]);
    let default = flip::DEFAULT_PPD;
    let cases: [Case; 12] = [
        ("tree", [96, 64], tree, shaken, default, 0.117_175_63, [0.116_898, 0.084_623, 0.258_725]),
        ("tree, 30 ppd", [96, 64], tree, shaken, 30.0, 0.247_797_10, [0.134_151, 0.203_486, 0.460_910]),
        ("tree, 120 ppd", [96, 64], tree, shaken, 120.0, 0.084_824_60, [0.085_935, 0.081_045, 0.269_072]),
        ("same", [20, 20], tree, tree, default, 0.0, [0.0; 3]),
        ("ramp", [128, 80], ramp, tree, default, 0.844_135_08, [0.960_195, 0.633_223, 0.961_559]),
        (
            "grain",
            [40, 33],
            |x, y| grain(x, y, 3),
            |x, y| grain(x, y, 4),
            default,
            0.431_725_63,
            [0.297_995, 0.363_676, 0.754_425],
        ),
        ("wide", [301, 7], |x, y| grain(x, y, 7), tree, default, 0.707_715_64, [0.766_056, 0.686_259, 0.530_147]),
        (
            "3×5",
            [3, 5],
            |x, y| grain(x, y, 5),
            |x, y| grain(x, y, 6),
            default,
            0.694_764_35,
            [0.486_388, 0.852_507, 0.562_943],
        ),
        ("1×1", [1, 1], |_, _| [200, 30, 90], |_, _| [10, 180, 60], default, 0.965_290_25, [0.965_290; 3]),
        ("black, white", [16, 16], |_, _| [0; 3], |_, _| [255; 3], default, 0.967_388_33, [0.967_388; 3]),
        ("primaries", [8, 8], |_, _| [0, 255, 0], |_, _| [0, 0, 255], default, 1.0, [1.0; 3]),
        ("one step", [64, 64], |_, _| [100; 3], near, default, 0.011_709_46, [0.0, 0.018_713, 0.022_640]),
    ];
    for (name, [w, h], a, b, ppd, mean, points) in cases {
        let (a, b) = (paint(w, h, a), paint(w, h, b));
        let map = flip::flip(&a, &b, ppd);
        let found = map.iter().map(|&e| f64::from(e)).sum::<f64>() / map.len() as f64;
        assert!((found - mean).abs() < 2e-5, "{name}: mean {found}, wanted {mean}");
        // Feature differences of rounding size (1e-7) go through a square root: pixels agree to some 1e-4.
        for (at, wanted) in [0, (h / 2) * w + w / 2, w * h - 1].into_iter().zip(points) {
            assert!((map[at] - wanted).abs() < 3e-4, "{name}, pixel {at}: {}, wanted {wanted}", map[at]);
        }
        assert_eq!(map, flip::flip(&b, &a, ppd), "{name}: FLIP is symmetric");
    }
}

#[test]
fn flip_does_not_depend_on_the_number_of_threads_or_on_bands() {
    let (a, b) = (paint(40, 200, tree), paint(40, 200, shaken));
    let whole = flip::flip(&a, &b, flip::DEFAULT_PPD);
    let one = par::with_threads(1, || flip::flip(&a, &b, flip::DEFAULT_PPD)).unwrap();
    assert_eq!(whole, one);
    // Rows 70 … 169 of the same picture, more than a filter's reach from the cut, over other bands.
    let cut = |image: &Image| Image { width: 40, height: 100, rgba: image.rgba[70 * 40..170 * 40].to_vec() };
    let part = flip::flip(&cut(&a), &cut(&b), flip::DEFAULT_PPD);
    assert_eq!(part[10 * 40..90 * 40], whole[80 * 40..160 * 40]);
}

fn plain(width: usize, height: usize, value: f32) -> Image {
    Image::from_fn(width, height, |_, _| [value, value, value, 1.0])
}

#[test]
fn constants_give_closed_forms() {
    let c = compare(&plain(7, 5, 0.75), &plain(7, 5, 0.5), &Options::default()).unwrap();
    assert_eq!((c.all.pixels, c.covered, c.area), (35, None, None));
    // 0.75, 0.5 and their difference are exact in f32, so only f64 rounding remains.
    assert!((c.all.rmse - 0.25).abs() < 1e-12);
    assert!((c.all.rel_mse - 0.0625 / 0.26).abs() < 1e-12);
    assert!((c.all.psnr - 12.041_199_826_559_248).abs() < 1e-9);
    assert!((c.all.bias - 0.25).abs() < 1e-12);
    assert!((c.all.relative_bias.unwrap() - 0.5).abs() < 1e-12);
    let encoded = f64::from(srgb_encode(0.75) - srgb_encode(0.5));
    assert!((c.all.psnr_srgb + 20.0 * encoded.log10()).abs() < 1e-9);
}

#[test]
fn equal_pictures_differ_by_nothing() {
    let a = paint(9, 4, tree);
    let c = compare(&a, &a, &Options::default()).unwrap();
    assert_eq!((c.all.rmse, c.all.rel_mse, c.all.flip, c.all.bias), (0.0, 0.0, 0.0, 0.0));
    assert_eq!(c.all.psnr, f64::INFINITY);
    assert!(serde_json::json!(c)["all"]["psnr"].is_null());
    let black = compare(&plain(2, 2, 0.0), &plain(2, 2, 0.0), &Options::default()).unwrap();
    assert_eq!(black.all.relative_bias, None);
}

#[test]
fn cover_comes_from_alpha_or_from_the_background() {
    // a covers the left half, half of it by half; b covers the left quarter.
    let alpha = |x: usize| if x < 4 { if x < 2 { 1.0 } else { 0.5 } } else { 0.0 };
    let a = Image::from_fn(8, 2, |x, _| [0.2 * alpha(x), 0.0, 0.0, alpha(x)]);
    let b = Image::from_fn(8, 2, |x, _| if x < 2 { [0.2, 0.0, 0.0, 1.0] } else { [0.0; 4] });
    let c = compare(&a, &b, &Options::default()).unwrap();
    assert_eq!(c.area, Some(Area { a: 0.375, b: 0.25, ratio: Some(1.5) }));
    assert_eq!(c.covered.unwrap().pixels, 8);
    // Twice the pixels, the same sum of squares.
    assert!((c.covered.unwrap().rmse / c.all.rmse - 2f64.sqrt()).abs() < 1e-12);

    let opaque = |image: &Image| {
        Image::from_fn(8, 2, |x, y| {
            let p = image.rgba[y * 8 + x];
            [p[0], p[1], p[2], 1.0]
        })
    };
    let (a, b) = (opaque(&a), opaque(&b));
    assert_eq!(compare(&a, &b, &Options::default()).unwrap().area, None);
    let options = Options { background: Some([0.0; 3]), ..Options::default() };
    assert_eq!(compare(&a, &b, &options).unwrap().area, Some(Area { a: 0.5, b: 0.25, ratio: Some(2.0) }));
    let nothing = compare(&plain(3, 3, 0.0), &plain(3, 3, 0.0), &options).unwrap();
    assert_eq!((nothing.covered, nothing.area.unwrap().ratio), (None, None));
}

#[test]
fn hostile_values_and_sizes() {
    let mut a = plain(5, 5, 0.5);
    a.rgba[7] = [f32::NAN, 0.5, 0.5, 1.0];
    a.rgba[8] = [f32::INFINITY, 0.5, 0.5, f32::NAN];
    a.rgba[9] = [1e30, -1e30, 0.0, 1.0];
    let c = compare(&a, &plain(5, 5, 0.5), &Options::default()).unwrap();
    assert_eq!(c.not_finite, [2, 0]);
    assert!(c.all.rmse.is_finite() && c.flip_map.iter().all(|e| (0.0..=1.0).contains(e)));
    assert!(compare(&a, &plain(5, 4, 0.5), &Options::default()).is_err());
    for ppd in [0.0, -1.0, f64::NAN, 1e9] {
        assert!(compare(&a, &a, &Options { ppd, ..Options::default() }).is_err());
    }
    for ppd in [1.0, 1000.0] {
        let c = compare(&a, &plain(5, 5, 0.25), &Options { ppd, ..Options::default() }).unwrap();
        assert!(c.flip_map.iter().all(|e| (0.0..=1.0).contains(e)), "{ppd}");
    }
}
