//! An editor of glTF files: it keeps the JSON as it was read, adds arrays of numbers, and keeps URIs valid at the place where the file is saved.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::document::{is_glb, overview, split_glb};
use crate::format::{PartFile, open_file};
use crate::scene::files;
use crate::scene::files::UriTarget;
use crate::{Error, Result, Warnings};

/// Characters that a path segment of a URI may hold besides letters and digits (RFC 3986, pchar, without `:`).
const SEGMENT: &AsciiSet =
    &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~').remove(b'@').remove(b'+');

/// A glTF file with the data that was added to it.
pub struct Editor {
    path: PathBuf,
    pub json: Value,
    bin: Option<Vec<u8>>,
    /// Bytes of the new buffer views, and which views those are.
    added: Vec<u8>,
    views: Vec<usize>,
    limit: u64,
}

/// Files that were written besides the glTF file.
#[derive(Debug, Default)]
pub struct Saved {
    /// Files that were copied beside the output because they lie outside its folder.
    pub copied: Vec<PathBuf>,
    pub warnings: Warnings,
    /// By name, the copied files of an earlier landscape of the same name, and those of this one.
    earlier: BTreeMap<String, Copied>,
    copies: BTreeMap<String, Copied>,
}

/// A file that was copied beside a landscape.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Copied {
    /// The original, as seen from the landscape's folder.
    from: String,
    sha256: String,
}

/// JSON pointer to the list of files that a landscape copied. Another version of the same original may replace a copy; other files are never
/// overwritten.
const COPIES: &str = "/asset/extras/vtexCopies";

/// The files that a landscape lists as copied.
fn copies_of(json: &Value) -> impl Iterator<Item = (String, Copied)> {
    let all = json.pointer(COPIES).and_then(Value::as_object).into_iter().flatten();
    all.filter_map(|(name, copied)| Some((name.clone(), Copied::deserialize(copied).ok()?)))
}

/// Relative path from a folder to a file, both canonical, with `/` as separator.
fn relative_path(folder: &Path, file: &Path) -> String {
    let same = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(same).map(|_| "..".into());
    let down = file.components().skip(same).map(|c| c.as_os_str().to_string_lossy());
    up.chain(down).collect::<Vec<_>>().join("/")
}

impl Editor {
    /// Read the JSON and the BIN chunk of a file of at most `limit` bytes.
    pub fn open(path: &Path, limit: u64) -> Result<Self> {
        let bytes = files::read(path, limit)?;
        let (text, bin) = if bytes.starts_with(b"glTF") || is_glb(path) {
            split_glb(&bytes).map_err(|what| Error::input(path, "GLB container", what))?
        } else {
            (bytes.as_slice(), None)
        };
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
        let json: Value = serde_json::from_slice(text).map_err(|e| Error::input(path, "JSON", e.to_string()))?;
        if !json.is_object() {
            return Err(Error::input(path, "JSON", "is not an object"));
        }
        let bin = bin.map(<[u8]>::to_vec);
        Ok(Editor { path: path.to_path_buf(), json, bin, added: Vec::new(), views: Vec::new(), limit })
    }

    /// An empty file that will be saved as `path`.
    pub fn new(path: &Path) -> Self {
        let json = json!({"asset": {"version": "2.0", "generator": concat!("vtex ", env!("CARGO_PKG_VERSION"))},
            "buffers": [{"byteLength": 0}]});
        let (bin, limit) = (Some(Vec::new()), u64::MAX);
        Editor { path: path.to_path_buf(), json, bin, added: Vec::new(), views: Vec::new(), limit }
    }

    /// The object under `key` of `parent`, which is created if absent; an error if the value is no object.
    pub fn object<'a>(path: &Path, parent: &'a mut Value, key: &str) -> Result<&'a mut Value> {
        let wrong = || Error::input(path, key, "is not an object");
        let slot = parent.as_object_mut().ok_or_else(wrong)?.entry(key).or_insert_with(|| json!({}));
        if slot.is_object() { Ok(slot) } else { Err(wrong()) }
    }

    /// Append to the array under `key` of the root. Returns the index.
    pub fn push(&mut self, key: &str, value: Value) -> Result<usize> {
        let wrong = || Error::input(&self.path, key, "is not an array");
        let slot = self.json.as_object_mut().ok_or_else(wrong)?.entry(key).or_insert_with(|| json!([]));
        let array = slot.as_array_mut().ok_or_else(wrong)?;
        array.push(value);
        Ok(array.len() - 1)
    }

    /// Add an extension to `extensionsUsed`.
    pub fn use_extension(&mut self, name: &str) -> Result<()> {
        let used = self.json.get("extensionsUsed").and_then(Value::as_array);
        if !used.is_some_and(|used| used.iter().any(|n| n == name)) {
            self.push("extensionsUsed", json!(name))?;
        }
        Ok(())
    }

    /// Add an accessor of `N` floats per element, with its bounds; its index. `vertices`: for a primitive's attribute.
    pub fn add_floats<const N: usize>(&mut self, values: &[[f32; N]], vertices: bool) -> Result<usize> {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.add_view(&bytes, vertices.then_some(34962))?;
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            values.iter().fold([start; N], |b, v| std::array::from_fn(|k| pick(b[k], v[k]))).to_vec()
        };
        let (min, max) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(N.wrapping_sub(1)).copied().unwrap_or("SCALAR");
        let accessor = json!({"bufferView": view, "componentType": 5126, "count": values.len(), "type": kind,
            "min": min, "max": max});
        self.push("accessors", accessor)
    }

    /// Add an accessor of indices; its index.
    pub fn add_indices(&mut self, values: &[u16]) -> Result<usize> {
        let mut bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        let view = self.add_view(&bytes, Some(34963))?;
        let accessor = json!({"bufferView": view, "componentType": 5123, "count": values.len(), "type": "SCALAR"});
        self.push("accessors", accessor)
    }

    /// Add an accessor of 32-bit indices, `N` for each element of a mesh; its index.
    pub fn add_long_indices<const N: usize>(&mut self, values: &[[u32; N]]) -> Result<usize> {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.add_view(&bytes, Some(34963))?;
        let count = N * values.len();
        self.push("accessors", json!({"bufferView": view, "componentType": 5125, "count": count, "type": "SCALAR"}))
    }

    /// Add an encoded image; its index.
    pub fn add_image(&mut self, bytes: &[u8], mime: &str, name: &str) -> Result<usize> {
        let view = self.add_view(bytes, None)?;
        self.added.resize(self.added.len().next_multiple_of(4), 0);
        let mut image = json!({"bufferView": view, "mimeType": mime});
        if !name.is_empty() {
            image["name"] = json!(name);
        }
        self.push("images", image)
    }

    fn add_view(&mut self, bytes: &[u8], target: Option<u32>) -> Result<usize> {
        let mut view = json!({"buffer": 0, "byteOffset": self.added.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.added.extend(bytes);
        let view = self.push("bufferViews", view)?;
        self.views.push(view);
        Ok(view)
    }

    /// Show node `node` in the scene that is read by default.
    pub fn add_to_scene(&mut self, node: usize) {
        let scene = self.json.get("scene").and_then(Value::as_u64).unwrap_or(0);
        let Some(scene) = self.json.pointer_mut(&format!("/scenes/{scene}")).and_then(Value::as_object_mut) else {
            // Without scenes all nodes are shown.
            return;
        };
        if let Some(nodes) = scene.entry("nodes").or_insert_with(|| json!([])).as_array_mut() {
            nodes.push(json!(node));
        }
    }

    /// In a file without nodes, whose meshes are shown as they are, give each of the first `count` meshes a node.
    pub fn place_loose_meshes(&mut self, count: usize) -> Result<()> {
        if self.json.get("nodes").and_then(Value::as_array).is_some_and(|nodes| !nodes.is_empty()) {
            return Ok(());
        }
        for mesh in 0..count {
            let node = self.push("nodes", json!({"mesh": mesh}))?;
            self.add_to_scene(node);
        }
        Ok(())
    }

    /// Record the copied files in the JSON, for the next run.
    fn keep_copies(&mut self, saved: &Saved) -> Result<()> {
        let Some((parent, key)) = COPIES.rsplit_once('/') else { return Ok(()) };
        if saved.copies.is_empty() {
            let extras = self.json.pointer_mut(parent).and_then(Value::as_object_mut);
            extras.and_then(|extras| extras.remove(key));
            return Ok(());
        }
        let asset = Self::object(&self.path, &mut self.json, "asset")?;
        Self::object(&self.path, asset, "extras")?[key] = json!(saved.copies);
        Ok(())
    }

    /// Make the references that the file has resolve from where it will be saved; files outside that folder are copied
    /// into it. To be called before anything is added.
    ///
    /// # Errors
    /// Where a file cannot be read or written, and where a copy would replace a different file of the same name.
    pub fn relocate_references(&mut self, output: &Path, saved: &mut Saved) -> Result<()> {
        for uri in uris(&mut self.json) {
            let text = uri.as_str().unwrap_or_default();
            if !text.starts_with("data:") && files::contained(text).is_none() {
                return Err(Error::input(&self.path, "uri", format!("{text:?} {}", files::NOT_CONTAINED)));
            }
        }
        if is_glb(output) && self.bin.is_none() {
            self.take_first_buffer()?;
        }
        saved.earlier = copies_of(&overview(output)).collect();
        self.relocate(output, saved)
    }

    /// Write the file as `.glb` or, by any other name, as `.gltf`; what was added goes into the BIN chunk or a file beside.
    pub fn save(mut self, output: &Path, saved: &Saved) -> Result<()> {
        let glb = is_glb(output);
        self.keep_copies(saved)?;
        let stem = output.file_stem().and_then(OsStr::to_str).unwrap_or("landscape").to_owned();
        let shell = self.unused(&stem);
        self.place_added(glb, &shell)?;
        let folder = output.parent().unwrap_or(Path::new(""));
        if glb {
            let mut text = self.json.to_string().into_bytes();
            text.resize(text.len().next_multiple_of(4), b' ');
            let mut chunks = vec![(*b"JSON", text)];
            chunks.extend(self.bin.map(|mut bin| {
                bin.resize(bin.len().next_multiple_of(4), 0);
                (*b"BIN\0", bin)
            }));
            let length = 12 + chunks.iter().map(|(_, c)| 8 + c.len()).sum::<usize>();
            let too_long =
                |_| Error::Limit { what: "a .glb file".into(), needed: length as u64, allowed: u32::MAX.into() };
            let mut head = b"glTF\x02\0\0\0".to_vec();
            head.extend(u32::try_from(length).map_err(too_long)?.to_le_bytes());
            let mut pieces = vec![head];
            for (kind, chunk) in chunks {
                pieces.push([&(chunk.len() as u32).to_le_bytes()[..], &kind[..]].concat());
                pieces.push(chunk);
            }
            write_part(output, &pieces)?.finish()?;
        } else {
            let mut beside = None;
            if let Some(bin) = self.bin.take() {
                let name = format!("{stem}.bin");
                self.json["buffers"][0]["uri"] = json!(encode(&name));
                self.json["buffers"][0]["byteLength"] = json!(bin.len());
                beside = Some(write_part(&folder.join(name), &[bin])?);
            } else if !self.added.is_empty() {
                beside = Some(write_part(&folder.join(shell), &[std::mem::take(&mut self.added)])?);
            }
            let text =
                serde_json::to_vec_pretty(&self.json).map_err(|e| Error::input(output, "JSON", e.to_string()))?;
            let text = write_part(output, &[text])?;
            // Both files are on the disk before either gets its name, so that a landscape is hardly ever half old and half new.
            beside.map_or(Ok(()), PartFile::finish)?;
            text.finish()?;
        }
        Ok(())
    }

    /// A name for a new buffer that no other buffer of the file has.
    fn unused(&self, stem: &str) -> String {
        let buffers = self.json.get("buffers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        let taken = |name: &str| buffers.iter().any(|b| b.get("uri").is_some_and(|uri| *uri == encode(name)));
        let first = format!("{stem}.shell.bin");
        let more = (2..).map(|n| format!("{stem}.shell{n}.bin"));
        std::iter::once(first.clone()).chain(more).find(|name| !taken(name)).unwrap_or(first)
    }

    /// Move what `buffers[0]` names into the BIN chunk, so that a `.glb` can hold more in it.
    fn take_first_buffer(&mut self) -> Result<()> {
        let Some(buffer) = self.json.pointer_mut("/buffers/0") else {
            return Ok(());
        };
        let Some(uri) = buffer.get("uri").and_then(Value::as_str).map(str::to_owned) else { return Ok(()) };
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let bytes = match files::target(&uri).map_err(|what| Error::input(&self.path, "buffers[0]", what))? {
            UriTarget::Data(bytes) => bytes,
            UriTarget::File(name) => files::read(&folder.join(&*name), self.limit)?,
        };
        if let Some(buffer) = buffer.as_object_mut() {
            buffer.shift_remove("uri");
        }
        self.bin = Some(bytes);
        Ok(())
    }

    /// Assign the new views to a buffer: the BIN chunk if there is one, else a new file beside the output.
    fn place_added(&mut self, glb: bool, name: &str) -> Result<()> {
        if self.added.is_empty() {
            return Ok(());
        }
        let (buffer, base) = match &mut self.bin {
            Some(bin) => {
                bin.resize(bin.len().next_multiple_of(4), 0);
                let base = bin.len();
                bin.append(&mut self.added);
                self.json["buffers"][0]["byteLength"] = json!(bin.len());
                (0, base)
            }
            None if glb && self.json.pointer("/buffers/0").is_none() => {
                let bin = std::mem::take(&mut self.added);
                self.push("buffers", json!({"byteLength": bin.len()}))?;
                self.bin = Some(bin);
                (0, 0)
            }
            None if glb => {
                let what =
                    "buffers[0] has no bytes of its own, so nothing can be added to a .glb; write a .gltf instead";
                return Err(Error::unsupported(&self.path, what));
            }
            None => {
                let uri = encode(name);
                let length = self.added.len();
                (self.push("buffers", json!({"uri": uri, "byteLength": length}))?, 0)
            }
        };
        for &view in &self.views {
            let view = &mut self.json["bufferViews"][view];
            let offset = view["byteOffset"].as_u64().unwrap_or(0) + base as u64;
            view["buffer"] = json!(buffer);
            view["byteOffset"] = json!(offset);
        }
        Ok(())
    }

    /// Make every relative URI resolve from the output's folder.
    fn relocate(&mut self, output: &Path, saved: &mut Saved) -> Result<()> {
        let folder = |path: &Path| match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let (from, to) = (folder(&self.path), folder(output));
        let to_real = to.canonicalize().map_err(|e| Error::io(&to, e))?;
        if from.canonicalize().is_ok_and(|from| from == to_real) {
            saved.copies = copies_of(&self.json).collect();
            saved.earlier.extend(saved.copies.clone());
            return Ok(());
        }
        for slot in uris(&mut self.json) {
            let Some(uri) = slot.as_str() else { continue };
            let Ok(UriTarget::File(name)) = files::target(uri) else { continue };
            let Some(source) = Some(files::locate(&from, uri, &name, false)).filter(|path| path.is_file()) else {
                saved.warnings.add(format!("{name} is missing beside the input; its reference was left as it is"));
                continue;
            };
            *slot = json!(copy_beside(&source, &to, &to_real, saved)?);
        }
        Ok(())
    }
}

/// Every URI of the file: of buffers, images, texels and their meshes.
fn uris(json: &mut Value) -> Vec<&mut Value> {
    let mut uris: Vec<&mut Value> = Vec::new();
    let Some(root) = json.as_object_mut() else { return uris };
    for (key, value) in root.iter_mut() {
        match key.as_str() {
            "buffers" | "images" => uris.extend(entries(value).filter_map(|v| v.get_mut("uri"))),
            "extensions" => {
                if let Some(own) = value.get_mut(super::extension::NAME).and_then(Value::as_object_mut) {
                    uris.extend(own_uris(own));
                }
            }
            _ => {}
        }
    }
    uris
}

/// The URIs of our own extension: of texels, their meshes, and a picture of the sky.
fn own_uris(own: &mut serde_json::Map<String, Value>) -> Vec<&mut Value> {
    let mut uris: Vec<&mut Value> = Vec::new();
    for (key, value) in own.iter_mut() {
        if key == "environment" {
            uris.extend(value.pointer_mut("/image/uri"));
        } else if key == "texels" {
            for texel in entries(value).filter_map(Value::as_object_mut) {
                for (key, value) in texel.iter_mut() {
                    match key.as_str() {
                        "frames" => uris.extend(entries(value).filter_map(|v| v.get_mut("uri"))),
                        "geometry" => uris.extend(value.get_mut("uri")),
                        _ => {}
                    }
                }
            }
        }
    }
    uris
}

fn entries(value: &mut Value) -> impl Iterator<Item = &mut Value> {
    value.as_array_mut().into_iter().flatten()
}

/// The URI of `file` for a glTF file in `folder`: a path below the folder, or the name of a copy in it.
///
/// # Errors
/// Where a different file of that name is in the folder.
pub fn reference(file: &Path, output: &Path, saved: &mut Saved) -> Result<String> {
    let folder = match output.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let real = folder.canonicalize().map_err(|e| Error::io(folder, e))?;
    copy_beside(file, folder, &real, saved)
}

fn copy_beside(file: &Path, folder: &Path, folder_real: &Path, saved: &mut Saved) -> Result<String> {
    let real = file.canonicalize().map_err(|e| Error::io(file, e))?;
    if let Ok(below) = real.strip_prefix(folder_real) {
        let segments: Option<Vec<String>> = below.iter().map(|s| s.to_str().map(encode)).collect();
        return segments
            .map(|s| s.join("/"))
            .ok_or_else(|| Error::Options(format!("{}: a file name must be UTF-8 to be referred to", file.display())));
    }
    let name = real.file_name().and_then(OsStr::to_str);
    let name =
        name.ok_or_else(|| Error::Options(format!("{}: a file name must be UTF-8 to be copied", file.display())))?;
    let copy = folder.join(name);
    let from = relative_path(folder_real, &real);
    if !copy.exists() || !same_bytes(&real, &copy)? {
        // An existing copy is overwritten only if an earlier run copied it, byte for byte, from the same original.
        if copy.exists() && !is_earlier_copy(&copy, folder, (name, &from), saved)? {
            return Err(Error::Options(format!(
                "{} lies outside the output's folder, and a different {name} is already there; write to another folder, or remove that one",
                file.display()
            )));
        }
        let mut source = open_file(&real)?;
        let mut part = PartFile::create(&copy)?;
        std::io::copy(&mut source, &mut part).map_err(|e| Error::io(&copy, e))?;
        part.finish()?;
        saved.copied.push(copy.clone());
    }
    saved.copies.insert(name.to_owned(), Copied { from, sha256: files::sha256(&copy)? });
    Ok(encode(name))
}

/// Whether `copy` is, byte for byte, what an earlier landscape of this name or another one in `folder` has copied there from
/// the same original.
fn is_earlier_copy(copy: &Path, folder: &Path, (name, from): (&str, &str), saved: &Saved) -> Result<bool> {
    if !copy.is_file() {
        return Ok(false);
    }
    let there = Copied { from: from.to_owned(), sha256: files::sha256(copy)? };
    if saved.earlier.get(name) == Some(&there) {
        return Ok(true);
    }
    let others = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?.flatten().map(|entry| entry.path());
    let mut landscapes = others.filter(|path| ["gltf", "glb"].contains(&files::extension(path).as_str()));
    Ok(landscapes.any(|path| copies_of(&overview(&path)).any(|known| known.0 == name && known.1 == there)))
}

fn same_bytes(a: &Path, b: &Path) -> Result<bool> {
    use std::io::{BufRead, BufReader};
    let (mut of_a, mut of_b) = (BufReader::new(open_file(a)?), BufReader::new(open_file(b)?));
    loop {
        let x = of_a.fill_buf().map_err(|e| Error::io(a, e))?;
        let y = of_b.fill_buf().map_err(|e| Error::io(b, e))?;
        let n = x.len().min(y.len());
        if n == 0 {
            return Ok(x.len() == y.len());
        }
        if x[..n] != y[..n] {
            return Ok(false);
        }
        of_a.consume(n);
        of_b.consume(n);
    }
}

fn encode(name: &str) -> String {
    utf8_percent_encode(name, SEGMENT).to_string()
}

/// Write and sync the content of the file `path` under a temporary name; finishing it gives it its name.
fn write_part(path: &Path, pieces: &[Vec<u8>]) -> Result<PartFile> {
    let mut part = PartFile::create(path)?;
    for piece in pieces {
        part.write_all(piece).map_err(|e| Error::io(path, e))?;
    }
    part.sync()?;
    Ok(part)
}
