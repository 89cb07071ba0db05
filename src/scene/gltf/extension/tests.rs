//! Texels in other colours.

use serde_json::json;

use crate::scene::gltf::tests::shell;
use crate::scene::shell::{Continuous, Orientations};
use crate::volume::Style;

#[test]
fn layers_in_other_colours_share_what_is_alike() {
    let leaf = json!({"leaf": {"diffuseFactor": [0.9, 0.3, 0.1], "useTexelAlbedo": false}});
    let example = json!({"layers": [
        {"texel": 0, "palette": leaf}, {"texel": 0, "palette": leaf}, {"texel": 1, "palette": leaf}, {"texel": 0},
        {"texel": 0, "palette": {"leaf": {}}, "phong": {"diffuseFactor": [0.5, 0.5, 0.5]}},
        {"texel": 0, "phong": {"diffuseFactor": [0.2, 0.1, 0.0], "useTexelAlbedo": false}, "jitter": {"discrete": {"variants":
            [{"texel": 0, "phong": {"diffuseFactor": [2, 1, 1]}},
             {"texel": 0, "phong": {"useTexelAlbedo": false}}]}}}]});
    let s = shell().set("/materials/0/extensions/VTEX_volumetric_texture", example).scene();
    let layers = &s.model.materials[0].shell.as_ref().unwrap().layers;
    assert_eq!(layers.iter().map(|l| l.texel).collect::<Vec<_>>(), [2, 2, 3, 0, 0, 4]);
    assert_eq!((layers[4].diffuse, layers[5].diffuse), ([0.5; 3], [0.2, 0.1, 0.0]));
    assert_eq!(s.texels[4].palette.style("any"), Style::BLANK);
    let variants = &layers[5].discrete.as_ref().unwrap().variants;
    assert_eq!(variants.iter().map(|v| (v.texel, v.diffuse[0])).collect::<Vec<_>>(), [(4, 2.0), (4, 1.0)]);
    for (palette, what) in [
        (json!([]), "layers[0].palette: is not an object"),
        (json!({"leaf": 1}), "layers[0].palette.leaf: is not an object"),
        (json!({"leaf": {"diffuseFactor": [1, 1]}}), "palette.leaf.diffuseFactor: is not a list of 3"),
        (json!({"leaf": {"diffuseFactor": [1, -1, 0]}}), "palette.leaf.diffuseFactor: is not a number of at least 0"),
        (json!({"leaf": {"useTexelAlbedo": 0}}), "palette.leaf.useTexelAlbedo: is neither"),
    ] {
        let example = json!({"layers": [{"texel": 0, "palette": palette}]});
        let error = shell().set("/materials/0/extensions/VTEX_volumetric_texture", example).error();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn jitter_is_read_and_its_ranges_checked() {
    let with = |jitter: serde_json::Value| {
        let example = json!({"layers": [{"texel": 0, "jitter": jitter}]});
        shell().set("/materials/0/extensions/VTEX_volumetric_texture", example)
    };
    let s = with(json!({
        "discrete": {"orientations": "cube48", "mirror": [true, false, true], "tint": [[1, 0, 0], [0, 2, 0]], "displace": [2, 0, 0]},
        "continuous": {"seed": 7, "space": "texel", "frequency": [1, 2, 3], "octaves": 2, "uvwAmplitude": [0.5, 0, 0],
            "heightTilt": 0.3, "heightScale": 0.2},
    }))
    .scene();
    let layer = &s.model.materials[0].shell.as_ref().unwrap().layers[0];
    let discrete = layer.discrete.as_ref().unwrap();
    assert_eq!((discrete.orientations, discrete.mirror), (Orientations::Cube48, [true, false, true]));
    assert_eq!((&discrete.tint[..], discrete.displace), (&[[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]][..], [2.0, 0.0, 0.0]));
    let wanted = Continuous {
        seed: 7,
        frequency: [1.0, 2.0, 3.0],
        octaves: 2,
        uvw_amplitude: [0.5, 0.0, 0.0],
        height_tilt: 0.3,
        height_scale: 0.2,
    };
    assert_eq!(layer.continuous, Some(wanted));
    for (jitter, what) in [
        (json!({"discrete": {"mirror": [1, 0, 0]}}), "discrete.mirror: is not three times true or false"),
        (json!({"discrete": {"tint": [[1, 1, 1]]}}), "discrete.tint: is not a list of 2 to 16 colours"),
        (json!({"discrete": {"tint": [[1, 1, 1], [1, -1, 1]]}}), "discrete.tint: is not a list of 2 to 16 colours"),
        (json!({"discrete": {"displace": [5, 0, 0]}}), "discrete.displace: is not a number in [0, 4]"),
        (json!({"continuous": {"octaves": 0}}), "continuous.octaves: must be at least 1"),
        (json!({"continuous": {"octaves": 9}}), "continuous.octaves: is not a whole number in [0, 8]"),
        (json!({"continuous": {"frequency": [1, 0, 1]}}), "continuous.frequency: must be above 0"),
        (json!({"continuous": {"space": "world"}}), "continuous.space: is not texel"),
        (json!({"continuous": {"heightScale": 1}}), "continuous.heightScale: is not a number in [0, 0.9]"),
    ] {
        let error = with(jitter).error();
        assert!(error.contains(what), "{error}");
    }
}
