//! Texels in other colours.

use serde_json::json;

use crate::scene::gltf::tests::shell;
use crate::scene::phong::NoiseSpace;
use crate::scene::shell::{Continuous, Orientations};
use crate::volume::{Finish, Style};

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
    assert_eq!((layers[4].phong.diffuse, layers[5].phong.diffuse), ([0.5; 3], [0.2, 0.1, 0.0]));
    assert_eq!(s.texels[4].palette.style("any"), Style::WHITE);
    let variants = &layers[5].discrete.as_ref().unwrap().variants;
    assert_eq!(variants.iter().map(|v| (v.texel, v.phong.diffuse[0])).collect::<Vec<_>>(), [(4, 2.0), (4, 1.0)]);
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
fn a_texel_may_stand_in_a_buffer_view() {
    let frame = "/extensions/VTEX_volumetric_texture/texels/0/frames/0";
    let s = shell().set(frame, json!({"bufferView": 0})).scene();
    let texel = &s.texels[0];
    assert_eq!(texel.bytes.as_deref().map(<[u8]>::len), Some(36));
    assert!(texel.frames[0].ends_with("bufferViews[0]") && texel.name.is_empty());
    for (bad, what) in [
        (json!({"bufferView": 99}), "bufferViews[99]: does not exist"),
        (json!({"bufferView": -1}), "frames[0].bufferView: is not a whole number"),
        (json!({"bufferView": 0, "uri": "a.vtex"}), "frames[0].uri: stands beside a bufferView"),
        (json!({}), "frames[0].uri: or a bufferView is needed"),
    ] {
        let error = shell().set(frame, bad).error();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn phong_is_read_and_its_ranges_checked() {
    let layer = |phong: serde_json::Value, palette: serde_json::Value| {
        let variants = json!([{"texel": 0, "phong": {"shininess": 9, "noise": {"space": "world"}}}]);
        let layers =
            json!([{"texel": 0, "phong": phong, "palette": palette, "jitter": {"discrete": {"variants": variants}}}]);
        shell().set("/materials/0/extensions/VTEX_volumetric_texture", json!({"layers": layers, "texCoord": 1}))
    };
    let image = json!({"uri": "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="});
    let with_image =
        |phong| layer(phong, json!({})).set("/images", json!([image])).set("/textures", json!([{"source": 0}]));
    let s = layer(
        json!({"ambientFactor": [0.5, 1, 0], "specularFactor": [0.1, 0.2, 0.3], "shininess": 40,
            "noise": {"seed": 4, "frequency": [1, 0, 2], "octaves": 3, "diffuse": [[0, 1, 2], [1, 1, 1]], "shininess": [0.5, 2]}}),
        json!({"leaf": {"shininess": 200}, "bark": {"specularFactor": [0, 0, 0]}, "moss": {"ambientFactor": [0, 0, 0]}}),
    )
    .scene();
    let layer_read = &s.model.materials[0].shell.as_ref().unwrap().layers[0];
    let finish = Finish { ambient: [0.5, 1.0, 0.0], specular: Some([0.1, 0.2, 0.3]), shininess: Some(40.0) };
    assert_eq!(layer_read.phong.finish, finish);
    let noise = layer_read.phong.variations[0].noise.unwrap();
    assert_eq!((noise.noise.seed, noise.noise.octaves, noise.space), (4, 3, NoiseSpace::Texel));
    assert_eq!(
        (noise.diffuse, noise.ambient, noise.shininess),
        ([[0.0, 1.0, 2.0], [1.0; 3]], [[1.0; 3]; 2], [0.5, 2.0])
    );
    let palette = &s.texels[layer_read.texel].palette;
    let said = |name: &str| (palette.style(name).finish.specular, palette.style(name).finish.shininess);
    assert_eq!(said("leaf"), (Some([0.1, 0.2, 0.3]), Some(200.0)));
    assert_eq!(said("bark"), (Some([0.0; 3]), Some(40.0)));
    assert_eq!((said("moss"), palette.style("moss").finish.ambient), ((None, None), [0.0; 3]));
    let variant = &layer_read.discrete.as_ref().unwrap().variants[0];
    assert_eq!(variant.phong.finish, Finish { shininess: Some(9.0), ..Finish::PLAIN });
    assert_eq!(variant.phong.variations[0].noise.unwrap().space, NoiseSpace::World);
    let s = with_image(json!({"diffuseTexture": {"index": 0}, "specularTexture": {"index": 0, "texCoord": 1}})).scene();
    let variation = &s.model.materials[0].shell.as_ref().unwrap().layers[0].phong.variations[0];
    assert!(variation.diffuse.is_some() && variation.specular.is_some() && variation.ambient.is_none());
    for (phong, what) in [
        (json!({"ambientFactor": [2, 0, 0]}), "phong.ambientFactor: is not a number in [0, 1]"),
        (json!({"specularFactor": [0, 0, -1]}), "phong.specularFactor: is not a number in [0, 1]"),
        (json!({"shininess": 20000}), "phong.shininess: is not a number in [0, 10000]"),
        (json!({"noise": {"octaves": 0}}), "phong.noise.octaves: must be at least 1"),
        (json!({"noise": {"frequency": [0, 0, 0]}}), "noise.frequency: must be above 0"),
        (json!({"noise": {"diffuse": [[0, 0, 0], [1, 1, 1], [2, 2, 2]]}}), "noise.diffuse: is not two colours"),
        (json!({"diffuseTexture": {"index": 7}}), "textures[7] does not exist"),
        (json!({"diffuseTexture": 1}), "phong.diffuseTexture: "),
    ] {
        let error = layer(phong, json!({})).error();
        assert!(error.contains(what) && error.lines().count() == 1, "{error}");
    }
    let error = with_image(json!({"diffuseTexture": {"index": 0, "texCoord": 2}})).error();
    assert!(
        error.contains("diffuseTexture: has texCoord 2: such an image lies on the shell's own coordinates, 1"),
        "{error}"
    );
    let error = layer(json!({}), json!({"leaf": {"noise": {}}})).error();
    assert!(error.contains("palette.leaf.noise: stands in a palette"), "{error}");
    let copies = json!({"copies": {"texel": 0, "phong": {"diffuseTexture": {"index": 0}}}});
    let error = shell().set("/materials/0/extensions/VTEX_volumetric_texture", copies).error();
    assert!(error.contains("copies.phong.diffuseTexture: lies on the images below a shell"), "{error}");
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
