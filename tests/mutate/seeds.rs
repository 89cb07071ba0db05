//! Inputs that mutation starts from: small files of every format, made here, and those of the samples and of the assets.

use std::path::{Path, PathBuf};

use vtex::progress::Quiet;
use vtex::source::field::{FieldSource, Sphere};

use super::mutators::{Kind, gzip};
use super::run::Command;
use crate::small;

/// One input: the file that is opened, and those beside it.
#[derive(Clone)]
pub struct Seed {
    pub main: String,
    /// Paths relative to the input's folder, and contents.
    pub files: Vec<(String, Vec<u8>)>,
}

/// A kind of input.
pub struct Format {
    pub name: &'static str,
    pub command: Command,
    pub seeds: Vec<Seed>,
}

/// Larger inputs are left out: their mutants would take too long.
const MAX_BYTES: usize = 96 << 10;
/// The same of kinds that are packed well: what they are unpacked to is filtered and contoured, for a second each.
const MAX_PACKED: usize = 1 << 10;

/// How a file is mutated, by its name.
pub fn kind(name: &str) -> Kind {
    match name.rsplit('.').next().unwrap_or_default() {
        "gltf" | "json" => Kind::Json,
        "glb" => Kind::Glb,
        "vtex" => Kind::Texel,
        "obj" | "mtl" | "lsys" | "ls" | "l" | "lpy" | "toml" | "csv" | "swc" | "nhdr" | "mhd" => Kind::Text,
        "png" => Kind::Png,
        // Their headers are text.
        "nrrd" | "mha" | "tck" => Kind::Text,
        "gz" if name.contains(".csv") || name.contains(".swc") => Kind::PackedText,
        _ => Kind::Binary,
    }
}

/// Every format with its seeds; `folder` is for files that are written on the way.
pub fn formats(folder: &Path) -> Vec<Format> {
    let landscapes = landscapes(folder);
    let own = |name: &str, bytes: Vec<u8>| Seed { main: name.into(), files: vec![(name.into(), bytes)] };
    let packed = |name: &str, bytes: Vec<u8>| vec![own(name, bytes.clone()), own(&format!("{name}.gz"), gzip(&bytes))];
    let lines = small::LINES;
    let ball = ("ball.nrrd".to_owned(), small::nrrd());
    let quad = ("quad.obj".to_owned(), small::OBJ.as_bytes().to_vec());
    let beside = |name: &str, text: &str, more: &(String, Vec<u8>)| Seed {
        main: name.into(),
        files: vec![(name.into(), text.into()), more.clone()],
    };
    let texel = |file: &str| own("a.vtex", std::fs::read(folder.join(file)).unwrap());
    let pictures = vec![own("a.png", small::png(5, 4)), own("a.exr", small::exr(folder))];
    let bake = Command::Bake;
    let mut all = vec![
        Format { name: "vtex", command: Command::Texel, seeds: vec![texel("leaf.vtex"), texel("ball.vtex")] },
        Format { name: "landscape", command: Command::Render, seeds: landscapes },
        Format { name: "map", command: Command::Map, seeds: grounds(folder) },
        Format { name: "glTF", command: bake, seeds: grounds(folder) },
        Format { name: "OBJ", command: bake, seeds: vec![small::obj()] },
        Format { name: "L-system", command: bake, seeds: vec![own("a.lsys", small::LSYSTEM.into())] },
        Format { name: "recipe", command: bake, seeds: vec![beside("a.toml", small::RECIPE, &quad)] },
        Format { name: "transfer", command: Command::Transfer, seeds: vec![beside("a.json", small::TRANSFER, &ball)] },
        Format { name: "albedo", command: Command::Albedo, seeds: vec![beside("a.toml", small::ALBEDO, &quad)] },
        Format { name: "csv", command: bake, seeds: packed("a.csv", lines.into()) },
        Format { name: "swc", command: bake, seeds: packed("a.swc", small::SWC.into()) },
        Format { name: "hair", command: bake, seeds: packed("a.hair", small::hair()) },
        Format { name: "trk", command: bake, seeds: packed("a.trk", small::trk()) },
        Format { name: "tck", command: bake, seeds: packed("a.tck", small::tck()) },
        Format { name: "trx", command: bake, seeds: packed("a.trx", small::trx()) },
        Format { name: "DICOM", command: bake, seeds: vec![small::dicom()] },
        Format { name: "NIfTI", command: bake, seeds: packed("a.nii", small::nifti()) },
        Format { name: "NRRD", command: bake, seeds: vec![own("a.nrrd", small::nrrd()), small::nhdr()] },
        Format { name: "MetaImage", command: bake, seeds: vec![own("a.mha", small::mha()), small::mhd()] },
        Format {
            name: "TIFF",
            command: bake,
            seeds: vec![own("a.tif", small::tiff()), own("a.tif", small::tiff_by_lzma())],
        },
        Format { name: "EXR", command: bake, seeds: vec![small::slices("exr", |_| small::exr(folder))] },
        Format { name: "PNG", command: bake, seeds: vec![small::slices("png", |_| small::png(5, 4))] },
        Format { name: "JPEG", command: bake, seeds: vec![small::slices("jpg", |_| small::jpeg())] },
        Format { name: "compare", command: Command::Compare, seeds: pictures },
    ];
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples");
    let assets = std::env::var_os("VTEX_ASSETS").map(PathBuf::from);
    for root in std::iter::once(samples).chain(assets) {
        let mut files = Vec::new();
        walk(&root, &mut files);
        files.sort();
        files.iter().for_each(|file| sort_in(file, &mut all));
    }
    all
}

/// Write a file, in folders that are made where they are not there.
pub fn put(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// All files below a folder.
fn walk(folder: &Path, out: &mut Vec<PathBuf>) {
    for path in std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if path.is_dir() { walk(&path, out) } else { out.push(path) }
    }
}

/// Add a file, with what it names, to the formats that it is of.
fn sort_in(file: &Path, all: &mut [Format]) {
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let bare = name.strip_suffix(".gz").unwrap_or(&name).to_ascii_lowercase();
    let names: &[&str] = match bare.rsplit('.').next().unwrap_or_default() {
        "gltf" | "glb" => &["glTF", "map", "landscape"],
        "obj" => &["OBJ"],
        "lsys" | "ls" | "l" | "lpy" => &["L-system"],
        "toml" => &["recipe"],
        "csv" => &["csv"],
        "swc" => &["swc"],
        "hair" => &["hair"],
        "trk" => &["trk"],
        "tck" => &["tck"],
        "trx" => &["trx"],
        "dcm" => &["DICOM"],
        "nii" | "hdr" => &["NIfTI"],
        "nrrd" | "nhdr" => &["NRRD"],
        "mha" | "mhd" => &["MetaImage"],
        "tif" | "tiff" => &["TIFF"],
        "exr" => &["EXR", "compare"],
        "png" => &["PNG", "compare"],
        "jpg" => &["JPEG"],
        "vtex" => &["vtex"],
        _ => return,
    };
    if std::fs::metadata(file).is_ok_and(|m| m.len() as usize > MAX_BYTES) {
        return;
    }
    let Some(seed) = with_dependencies(file, &name) else { return };
    let packs = names.iter().any(|n| ["NRRD", "JPEG"].contains(n));
    if packs && seed.files.iter().map(|f| f.1.len()).sum::<usize>() > MAX_PACKED {
        return;
    }
    for format in all.iter_mut().filter(|f| names.contains(&f.name)) {
        let mut seed = seed.clone();
        if format.command == Command::Map {
            let leaf = format.seeds[0].files.iter().find(|f| f.0 == "leaf.vtex").cloned();
            seed.files.extend(leaf);
        }
        format.seeds.push(seed);
    }
}

/// The file and those below its folder that it names.
fn with_dependencies(file: &Path, name: &str) -> Option<Seed> {
    let folder = file.parent()?;
    let mut files = vec![(name.to_owned(), std::fs::read(file).ok()?)];
    for path in vtex::source::dependencies(file) {
        let relative = path.strip_prefix(folder).ok()?.to_string_lossy().into_owned();
        if path != file && !relative.contains("..") {
            files.push((relative, std::fs::read(&path).ok()?));
        }
    }
    let bytes: usize = files.iter().map(|f| f.1.len()).sum();
    (bytes <= 2 * MAX_BYTES).then_some(Seed { main: name.into(), files })
}

/// A leaf of two materials and a ball, baked.
pub fn texels(folder: &Path) {
    std::fs::write(folder.join("leaf.obj"), small::OBJ).unwrap();
    std::fs::write(folder.join("a.mtl"), small::MTL).unwrap();
    let leaf = vtex::source::open(&folder.join("leaf.obj"), &Default::default()).unwrap();
    let ball = FieldSource::new(Box::new(Sphere { centre: [0.0; 3].into(), radius: 1.0 }), None).unwrap();
    for (name, source, cyclic) in
        [("leaf.vtex", &*leaf, [false; 3]), ("ball.vtex", &ball as &dyn vtex::source::Source, [true, true, false])]
    {
        let options = vtex::bake::Options { resolution: 16, cyclic, calibrate: false, ..Default::default() };
        let (volume, _) = vtex::bake::bake(source, &options, &Quiet, &mut |_| ()).unwrap();
        vtex::format::write(&volume, folder.join(name), &Default::default()).unwrap();
    }
}

/// A square of ground with a texture, as glTF and as GLB, beside the texel that it is to be covered with.
fn grounds(folder: &Path) -> Vec<Seed> {
    let leaf = ("leaf.vtex".to_owned(), std::fs::read(folder.join("leaf.vtex")).unwrap());
    let [gltf, glb] = small::grounds();
    let picture = ("grass.png".to_owned(), small::png(5, 4));
    let bin = ("ground.bin".to_owned(), small::corners());
    vec![
        Seed { main: "ground.gltf".into(), files: vec![("ground.gltf".into(), gltf), leaf.clone(), bin, picture] },
        Seed { main: "ground.glb".into(), files: vec![("ground.glb".into(), glb), leaf] },
    ]
}

/// The ground covered with shells and with rigid copies.
fn landscapes(folder: &Path) -> Vec<Seed> {
    texels(folder);
    let mut seeds = Vec::new();
    for (texel, bend) in [("leaf.vtex", false), ("leaf.vtex", true), ("ball.vtex", false)] {
        let own = folder.join(format!("{texel}-{bend}"));
        std::fs::create_dir_all(&own).unwrap();
        for (name, bytes) in &grounds(folder)[0].files {
            std::fs::write(own.join(name), bytes).unwrap();
        }
        std::fs::copy(folder.join(texel), own.join(texel)).unwrap();
        let info = vtex::format::Reader::open(own.join(texel), &Default::default()).unwrap().head().info.clone();
        let options = vtex::scene::gltf::map::MapOptions {
            texels: vec![(own.join(texel), info)],
            bend,
            attributes: bend,
            ..Default::default()
        };
        vtex::scene::gltf::map::map(&own.join("ground.gltf"), &options, &own.join("land.gltf")).unwrap();
        let mut files = Vec::new();
        walk(&own, &mut files);
        files.retain(|f| !f.ends_with("ground.gltf"));
        files.sort_by_key(|f| !f.ends_with("land.gltf"));
        let file =
            |f: &PathBuf| (f.strip_prefix(&own).unwrap().to_string_lossy().into_owned(), std::fs::read(f).unwrap());
        seeds.push(Seed { main: "land.gltf".into(), files: files.iter().map(file).collect() });
    }
    seeds
}
