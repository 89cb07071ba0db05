//! Texels in other colours.

use serde_json::json;

use crate::scene::gltf::tests::shell;
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
