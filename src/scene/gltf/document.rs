//! An open glTF file: its JSON, its buffers (GLB chunk, files, data URIs) and views of them, each read when first needed.

use std::cell::{Cell, OnceCell};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use gltf::json::{self, Root};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::animation_json::Animation;
use super::meshopt;
use crate::format::open_file;
use crate::scene::ReadOptions;
use crate::scene::files;
use crate::scene::shell::EXTENSION_NAME;
use crate::{Error, Result};

/// The file, and whatever of it has been read so far.
pub struct Document {
    pub path: PathBuf,
    pub root: Root,
    /// Transforms of the nodes at full precision, in the order of `root.nodes`.
    pub places: Vec<NodeTransform>,
    /// Morph targets of each primitive of each mesh.
    pub targets: Vec<Vec<Vec<MorphTarget>>>,
    /// The animations.
    pub animations: Vec<Animation>,
    /// Accessors of 64-bit floats, which the typed JSON does not know.
    pub doubles: Vec<usize>,
    /// The BIN chunk of a GLB.
    bin: Option<Vec<u8>>,
    buffers: Vec<OnceCell<Vec<u8>>>,
    /// Views that had to be decompressed.
    decoded: Vec<OnceCell<Vec<u8>>>,
    /// Bytes that may still be taken for what is read.
    left: Cell<u64>,
    limit: u64,
    contained: bool,
}

/// The transform of a node as the JSON has it.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct NodeTransform {
    /// Translation, in metres.
    pub translation: Option<[f64; 3]>,
    /// Unit quaternion (x, y, z, w).
    pub rotation: Option<[f64; 4]>,
    /// Factor along each axis.
    pub scale: Option<[f64; 3]>,
    /// Matrix of 4 columns, which replaces the other three.
    pub matrix: Option<[f64; 16]>,
}

/// Parts of the JSON that the types of the crate `gltf` leave out or round.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Precise {
    nodes: Vec<NodeTransform>,
    meshes: Vec<PreciseMesh>,
    animations: Vec<Animation>,
    scenes: Vec<PreciseScene>,
    accessors: Vec<PreciseAccessor>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct PreciseScene {
    nodes: Option<Value>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct PreciseAccessor {
    #[serde(rename = "componentType")]
    component_type: Value,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct PreciseMesh {
    primitives: Vec<PrecisePrimitive>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct PrecisePrimitive {
    targets: Vec<MorphTarget>,
}

/// The type of accessors of 64-bit floats.
const F64: u64 = 5130;

/// A morph target: the accessor of each attribute that it moves.
pub type MorphTarget = BTreeMap<String, usize>;

/// A piece of a buffer.
pub struct View<'a> {
    /// Bytes of the view.
    pub bytes: &'a [u8],
    /// Distance between elements, where the file gives one.
    pub stride: Option<usize>,
}

/// The typed JSON of a file, or what is wrong with it.
///
/// By the crate's own reader and never by `serde_json`: the types' deserializers would be compiled here once more, half a
/// megabyte of code.
fn root(json: &[u8]) -> Result<Root, String> {
    gltf::Gltf::from_slice_without_validation(json).map(|read| read.document.into_json()).map_err(|e| e.to_string())
}

impl Document {
    /// Read the JSON of a `.gltf` or `.glb`, told apart by their first bytes.
    pub fn open(path: &Path, options: &ReadOptions) -> Result<Self> {
        let bytes = files::read(path, options.max_bytes)?;
        if bytes.starts_with(&crate::format::MAGIC) {
            let what = "a texel in place of a glTF scene (`vtex inspect --preview` shows it, `vtex map` covers a mesh with it)";
            return Err(Error::unsupported(path, what));
        }
        let (json, bin) = if bytes.starts_with(b"glTF") || is_glb(path) {
            let (json, bin) = split_glb(&bytes).map_err(|what| Error::input(path, "GLB container", what))?;
            (json, bin.map(<[u8]>::to_vec))
        } else {
            (bytes.as_slice(), None)
        };
        let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
        let bad = |e: serde_json::Error| Error::input(path, "JSON", e.to_string());
        let precise: Precise = serde_json::from_slice(json).map_err(bad)?;
        let wrong = |what: String| Error::input(path, "JSON", what);
        let has_nodes = precise.scenes.iter().all(|s| s.nodes.is_some());
        let root = if has_nodes && precise.animations.iter().all(Animation::is_core) {
            root(json).map_err(wrong)?
        } else {
            // The typed JSON knows no animation without a node, and no scene without a list of them.
            let mut whole: Value = serde_json::from_slice(json).map_err(bad)?;
            whole.as_object_mut().map(|root| root.remove("animations"));
            for scene in whole.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
                if let Some(scene) = scene.as_object_mut() {
                    scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
                }
            }
            // Line numbers of the rewritten text are not those of the file, so they are removed from the message.
            let text = serde_json::to_vec(&whole).map_err(bad)?;
            root(&text).map_err(|what| wrong(what.split(" at line ").next().unwrap_or_default().to_owned()))?
        };
        let version = root.asset.min_version.as_ref().unwrap_or(&root.asset.version);
        if version.split('.').next() != Some("2") {
            return Err(Error::unsupported(path, format!("glTF version {version} (convert the file to glTF 2.0)")));
        }
        Ok(Document {
            path: path.to_path_buf(),
            buffers: root.buffers.iter().map(|_| OnceCell::new()).collect(),
            decoded: root.buffer_views.iter().map(|_| OnceCell::new()).collect(),
            root,
            places: precise.nodes,
            animations: precise.animations,
            doubles: (0..).zip(&precise.accessors).filter(|(_, a)| a.component_type == F64).map(|(i, _)| i).collect(),
            targets: precise
                .meshes
                .into_iter()
                .map(|m| m.primitives.into_iter().map(|p| p.targets).collect())
                .collect(),
            bin,
            left: Cell::new(options.max_bytes.saturating_sub(bytes.len() as u64)),
            limit: options.max_bytes,
            contained: options.contained,
        })
    }

    /// The folder that relative paths start from.
    pub fn dir(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// An error about the place `at`.
    pub fn error(&self, at: impl Into<String>, what: impl Into<String>) -> Error {
        Error::input(&self.path, at, what)
    }

    /// Bytes that may still be read or allocated.
    pub fn left(&self) -> u64 {
        self.left.get()
    }

    /// Check that `bytes` may be allocated temporarily, without charging them.
    pub fn has_room(&self, bytes: u64, what: &str) -> Result<()> {
        let left = self.left.get();
        self.charge(bytes, what)?;
        self.left.set(left);
        Ok(())
    }

    /// Charge `bytes` to the limit of what may be read and allocated; to be called before the allocation.
    pub fn charge(&self, bytes: u64, what: &str) -> Result<()> {
        match self.left.get().checked_sub(bytes) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => Err(Error::Limit {
                what: format!("{}: reading {what}", self.path.display()),
                needed: (self.limit - self.left.get()).saturating_add(bytes),
                allowed: self.limit,
            }),
        }
    }

    fn buffer(&self, index: usize) -> Result<&[u8]> {
        let at = format!("buffers[{index}]");
        let (Some(buffer), Some(cell)) = (self.root.buffers.get(index), self.buffers.get(index)) else {
            return Err(self.error(at, "does not exist"));
        };
        if buffer.uri.is_none() {
            // Only the first buffer of a GLB is its BIN chunk; other buffers without a URI are placeholders for decompressed data.
            return match &self.bin {
                Some(bin) if index == 0 => Ok(bin),
                _ => Err(self.error(at, "has no URI and no bytes in the file")),
            };
        }
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let bytes = self.fetch(buffer.uri.as_deref().unwrap_or_default(), &at, false).map_err(|e| match e {
            Error::Io { .. } => self.error(&*at, e.to_string()),
            other => other,
        })?;
        Ok(cell.get_or_init(|| bytes))
    }

    /// Read the bytes that a URI names. With `anywhere`, a file of the same name beside the glTF file is accepted, too.
    pub fn fetch(&self, uri: &str, at: &str, anywhere: bool) -> Result<Vec<u8>> {
        let bytes = match files::target(uri).map_err(|what| self.error(at, what))? {
            files::UriTarget::Data(bytes) => bytes,
            files::UriTarget::File(_) if self.contained && files::contained(uri).is_none() => {
                return Err(self.error(at, format!("{uri:?} {}", files::NOT_CONTAINED)));
            }
            files::UriTarget::File(name) => {
                files::read(&files::locate(self.dir(), uri, &name, anywhere), self.left.get())?
            }
        };
        self.charge(bytes.len() as u64, at)?;
        Ok(bytes)
    }

    /// A buffer view, decompressed where it is compressed.
    pub fn view(&self, index: usize) -> Result<View<'_>> {
        let at = || format!("bufferViews[{index}]");
        let (Some(view), Some(cell)) = (self.root.buffer_views.get(index), self.decoded.get(index)) else {
            return Err(self.error(at(), "does not exist"));
        };
        if let Some(compressed) = view.extensions.as_ref().and_then(|e| meshopt_extension(&e.others)) {
            let spec = meshopt::Spec::parse(compressed).map_err(|what| self.error(at(), what))?;
            let stride = Some(spec.stride);
            if let Some(bytes) = cell.get() {
                return Ok(View { bytes, stride });
            }
            let packed = self.range(spec.buffer, spec.byte_offset, spec.byte_length, &at)?;
            self.charge(spec.decoded_len(), &at())?;
            let bytes = meshopt::decode(&spec, packed)
                .map_err(|what| self.error(at(), format!("meshopt compression: {what}")))?;
            return Ok(View { bytes: cell.get_or_init(|| bytes), stride });
        }
        let bytes = self.range(view.buffer.value(), view.byte_offset.unwrap_or_default().0, view.byte_length.0, &at)?;
        Ok(View { bytes, stride: view.byte_stride.map(|s| s.0) })
    }

    fn range(&self, buffer: usize, offset: u64, length: u64, at: &dyn Fn() -> String) -> Result<&[u8]> {
        let bytes = self.buffer(buffer)?;
        let end = offset.checked_add(length).and_then(|end| usize::try_from(end).ok());
        end.and_then(|end| bytes.get(offset as usize..end)).ok_or_else(|| {
            let what = format!("bytes {offset} + {length} reach beyond buffers[{buffer}], which has {}", bytes.len());
            self.error(at(), what)
        })
    }
}

fn meshopt_extension(others: &Map<String, Value>) -> Option<&Value> {
    others.get("KHR_meshopt_compression").or_else(|| others.get("EXT_meshopt_compression"))
}

/// The JSON of a file, without the rest of a GLB.
fn json_of(path: &Path) -> Result<Vec<u8>> {
    let io = |e| Error::io(path, e);
    let mut file = open_file(path)?;
    let mut json = Vec::new();
    (&mut file).take(20).read_to_end(&mut json).map_err(io)?;
    if let (true, Some(length)) = (json.starts_with(b"glTF"), json.get(12..16)) {
        let length = length.try_into().map_or(0, u32::from_le_bytes);
        json.clear();
        file.take(length.into()).read_to_end(&mut json).map_err(io)?;
    } else {
        file.read_to_end(&mut json).map_err(io)?;
    }
    Ok(json)
}

/// Paths of the files that a `.gltf` or `.glb` refers to, resolved as reading would: buffers, images, and, in a landscape, texels with the
/// meshes that they were baked from and the picture of the sky.
pub fn named_files(path: &Path) -> Vec<PathBuf> {
    let json = overview(path);
    let dir = path.parent().unwrap_or(Path::new(""));
    let list = |value: Option<&Value>| value.and_then(Value::as_array).cloned().unwrap_or_default();
    let uri = |value: &Value| value.get("uri").and_then(Value::as_str).map(str::to_owned);
    let mut uris: Vec<(String, bool)> = Vec::new();
    for (key, anywhere) in [("buffers", false), ("images", true)] {
        uris.extend(list(json.get(key)).iter().filter_map(uri).map(|uri| (uri, anywhere)));
    }
    for texel in list(json.pointer(&format!("/extensions/{}/texels", EXTENSION_NAME))) {
        let named = list(texel.get("frames")).into_iter().chain(texel.get("geometry").cloned());
        uris.extend(named.filter_map(|value| uri(&value)).map(|uri| (uri, false)));
    }
    let sky = json.pointer(&format!("/extensions/{EXTENSION_NAME}/environment/image"));
    uris.extend(sky.and_then(uri).map(|uri| (uri, false)));
    uris.iter()
        .filter_map(|(uri, anywhere)| match files::target(uri) {
            Ok(files::UriTarget::File(name)) => Some(files::locate(dir, uri, &name, *anywhere)),
            _ => None,
        })
        .collect()
}

/// Whether a file is a landscape already: a mesh that is covered with texels.
pub fn is_landscape(path: &Path) -> bool {
    overview(path).pointer(&format!("/extensions/{}", EXTENSION_NAME)).is_some()
}

/// The JSON of a file; null if it cannot be read.
pub fn overview(path: &Path) -> Value {
    let json = json_of(path).unwrap_or_default();
    serde_json::from_slice(json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&json)).unwrap_or_default()
}

pub fn is_glb(path: &Path) -> bool {
    files::extension(path) == "glb"
}

/// The JSON and BIN chunks of a GLB container.
pub fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let word = |at: usize| {
        bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes).ok_or("the header is cut short")
    };
    if !bytes.starts_with(b"glTF") {
        return Err("does not begin with \"glTF\"".into());
    }
    if word(4)? != 2 {
        return Err(format!("version {} is not 2", word(4)?));
    }
    let length = word(8)? as usize;
    if length > bytes.len() {
        return Err(format!("says it has {length} bytes, the file has {}", bytes.len()));
    }
    let (mut json, mut bin, mut at) = (None, None, 12);
    while at + 8 <= length {
        let (size, kind) = (word(at)? as usize, word(at + 4)?);
        let chunk = bytes.get(at + 8..length).and_then(|rest| rest.get(..size));
        let chunk = chunk.ok_or_else(|| format!("the chunk at byte {at} says {size} bytes, more than are left"))?;
        match kind {
            0x4E4F_534A if json.is_none() => json = Some(chunk),
            0x004E_4942 if json.is_some() && bin.is_none() => bin = Some(chunk),
            _ if json.is_none() => return Err("the first chunk is not JSON".into()),
            _ => {}
        }
        at += 8 + size;
    }
    Ok((json.ok_or("holds no JSON chunk")?, bin))
}

/// The index that a typed JSON reference holds.
pub fn index<T>(reference: Option<json::Index<T>>) -> Option<usize> {
    reference.map(|r| r.value())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        for (kind, data) in chunks {
            bytes.extend((data.len() as u32).to_le_bytes());
            bytes.extend(*kind);
            bytes.extend(*data);
        }
        let length = (bytes.len() as u32).to_le_bytes();
        bytes[8..12].copy_from_slice(&length);
        bytes
    }

    #[test]
    fn chunks_are_split() {
        let file = glb(&[(b"JSON", b"{}  "), (b"BIN\0", &[1, 2, 3, 4]), (b"XTRA", &[9; 8])]);
        assert_eq!(split_glb(&file).unwrap(), (&b"{}  "[..], Some(&[1, 2, 3, 4][..])));
        assert_eq!(split_glb(&glb(&[(b"JSON", b"{}")])).unwrap().1, None);
        assert!(split_glb(&glb(&[(b"BIN\0", &[0; 4]), (b"JSON", b"{}")])).unwrap_err().contains("not JSON"));
        assert!(split_glb(&glb(&[])).is_err());
        for cut in 0..file.len() {
            assert!(split_glb(&file[..cut]).is_err());
        }
        let mut long = file.clone();
        long[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(split_glb(&long).unwrap_err().contains("more than are left"));
    }
}
