//! A JSON object of the extension, whose properties are read with their ranges checked. The methods return `None` for absent properties.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::{Map, Value};

use super::super::document::Document;
use crate::scene::files;
use crate::scene::shell::{CellWrap, EXTENSION_NAME as NAME, Pose};
use crate::{Error, Result, Warnings};

/// Any finite number.
pub const ANY: std::ops::RangeInclusive<f64> = f64::MIN..=f64::MAX;

/// A JSON object and where it is.
pub struct Object<'a> {
    pub document: &'a Document,
    pub json: &'a Map<String, Value>,
    /// Place in the file, for messages.
    pub at: String,
}

impl<'a> Object<'a> {
    pub fn new(document: &'a Document, json: &'a Value, at: String) -> Result<Self> {
        match json.as_object() {
            Some(json) => Ok(Object { document, json, at }),
            None => Err(document.error(at, "is not an object")),
        }
    }

    pub fn error(&self, key: &str, what: &str) -> Error {
        self.document.error(format!("{}.{key}", self.at), what)
    }

    pub fn ignored(&self, what: &str, warnings: &mut Warnings) {
        warnings.add(format!("{NAME}: {what} is ignored"));
    }

    /// Warn of every property that is not read: `later` lists those that the specification defines; the others are unknown.
    pub fn known(&self, read: &[&str], later: &[&str], warnings: &mut Warnings) {
        for key in self.json.keys().map(String::as_str) {
            if later.contains(&key) {
                self.ignored(key, warnings);
            } else if !read.contains(&key) && !["extensions", "extras"].contains(&key) {
                warnings.add(format!("{NAME}: {key} is not a known property and is ignored"));
            }
        }
    }

    pub fn object(&self, key: &str) -> Result<Option<Object<'a>>> {
        self.json.get(key).map(|v| Object::new(self.document, v, format!("{}.{key}", self.at))).transpose()
    }

    /// A list of `least` to `most` objects.
    pub fn list(&self, key: &str, least: usize, most: usize) -> Result<Option<Vec<Object<'a>>>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        let list = json.as_array().filter(|l| (least..=most).contains(&l.len()));
        let list = list.ok_or_else(|| self.error(key, &format!("is not a list of {least} to {most}")))?;
        let object = |(i, v)| Object::new(self.document, v, format!("{}.{key}[{i}]", self.at));
        list.iter().enumerate().map(object).collect::<Result<_>>().map(Some)
    }

    pub fn numbers<const N: usize>(&self, key: &str, range: std::ops::RangeInclusive<f64>) -> Result<Option<[f64; N]>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        let list = json.as_array().filter(|l| l.len() == N);
        let list = list.ok_or_else(|| self.error(key, &format!("is not a list of {N} numbers")))?;
        let mut out = [0.0; N];
        for (out, v) in out.iter_mut().zip(list) {
            *out = self.within(key, v, &range)?;
        }
        Ok(Some(out))
    }

    pub fn vec3(&self, key: &str, range: std::ops::RangeInclusive<f64>) -> Result<Option<[f64; 3]>> {
        self.numbers(key, range)
    }

    pub fn number(&self, key: &str, range: std::ops::RangeInclusive<f64>) -> Result<Option<f64>> {
        self.json.get(key).map(|v| self.within(key, v, &range)).transpose()
    }

    pub fn within(&self, key: &str, json: &Value, range: &std::ops::RangeInclusive<f64>) -> Result<f64> {
        json.as_f64().filter(|v| range.contains(v)).ok_or_else(|| {
            let (from, to) = (range.start(), range.end());
            let bounds = match (*from > f64::MIN, *to < f64::MAX) {
                (false, false) => "is not a number".into(),
                (true, false) => format!("is not a number of at least {from}"),
                _ => format!("is not a number in [{from}, {to}]"),
            };
            self.error(key, &bounds)
        })
    }

    /// A list of three booleans.
    pub fn flags(&self, key: &str) -> Result<Option<[bool; 3]>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        let flags: Option<Vec<bool>> = json.as_array().and_then(|l| l.iter().map(Value::as_bool).collect());
        let flags = flags.and_then(|f| <[bool; 3]>::try_from(f).ok());
        flags.ok_or_else(|| self.error(key, "is not three times true or false")).map(Some)
    }

    /// A ramp of 2 to 16 colours; none where it is absent.
    pub fn colours(&self, key: &str) -> Result<Vec<[f64; 3]>> {
        let Some(json) = self.json.get(key) else { return Ok(Vec::new()) };
        let wrong = || self.error(key, "is not a list of 2 to 16 colours, each three numbers of at least 0");
        let list = json.as_array().filter(|l| (2..=16).contains(&l.len())).ok_or_else(wrong)?;
        let colour = |v: &Value| {
            let numbers: Option<Vec<f64>> = v.as_array()?.iter().map(|x| x.as_f64().filter(|x| *x >= 0.0)).collect();
            <[f64; 3]>::try_from(numbers?).ok()
        };
        list.iter().map(|v| colour(v).ok_or_else(wrong)).collect()
    }

    pub fn integer(&self, key: &str, most: u64) -> Result<Option<u64>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        let value = json.as_u64().filter(|v| *v <= most);
        value.ok_or_else(|| self.error(key, &format!("is not a whole number in [0, {most}]"))).map(Some)
    }

    pub fn text(&self, key: &str) -> Result<Option<&'a str>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        json.as_str().ok_or_else(|| self.error(key, "is not a text")).map(Some)
    }

    /// Pose of the texel's geometry when a frame was baked.
    pub fn pose(&self, warnings: &mut Warnings) -> Result<Option<Pose>> {
        let Some(json) = self.object("pose")? else { return Ok(None) };
        json.known(&["time", "animations"], &[], warnings);
        let names = json.json.get("animations").map(|v| {
            let list = v.as_array().and_then(|l| l.iter().map(|n| n.as_str().map(str::to_owned)).collect());
            list.ok_or_else(|| json.error("animations", "is not a list of names"))
        });
        let animations = names.transpose()?.unwrap_or_default();
        Ok(Some(Pose { time: json.number("time", ANY)?.unwrap_or(0.0), animations }))
    }

    /// 32 hexadecimal digits, in small letters.
    pub fn content_id(&self) -> Result<Option<[u8; 16]>> {
        let Some(text) = self.text("contentId")? else { return Ok(None) };
        let digits = text.len() == 32 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        let id = u128::from_str_radix(text, 16).ok().filter(|_| digits);
        let id = id.ok_or_else(|| self.error("contentId", "is not 32 hexadecimal digits"))?;
        Ok(Some(id.to_be_bytes()))
    }

    pub fn choice<T: Copy>(&self, key: &str, of: &[(&str, T)]) -> Result<Option<T>> {
        let Some(json) = self.json.get(key) else { return Ok(None) };
        pick(json, of).ok_or_else(|| self.error(key, &one_of(of))).map(Some)
    }

    pub fn wrap(&self) -> Result<[CellWrap; 3]> {
        use CellWrap::{Empty, Mirror, Repeat};
        const NAMES: [(&str, CellWrap); 3] = [("repeat", Repeat), ("mirror", Mirror), ("empty", Empty)];
        let Some(json) = self.json.get("wrap") else { return Ok([Repeat, Repeat, Empty]) };
        let wraps: Option<Vec<CellWrap>> = json.as_array().and_then(|l| l.iter().map(|v| pick(v, &NAMES)).collect());
        wraps
            .and_then(|w| <[CellWrap; 3]>::try_from(w).ok())
            .ok_or_else(|| self.error("wrap", &format!("is not three times {}", &one_of(&NAMES)[7..])))
    }

    /// The index of one of `count` texels.
    pub fn texel(&self, count: usize) -> Result<Option<usize>> {
        let Some(json) = self.json.get("texel") else { return Ok(None) };
        let index = json.as_u64().filter(|&i| i < count as u64);
        let what = format!("is not the index of one of the {count} texels of the file");
        index.map(|i| Some(i as usize)).ok_or_else(|| self.error("texel", &what))
    }

    /// The bytes of the buffer view that it names, and a path that names them in messages.
    pub fn buffer_view(&self) -> Result<Option<(PathBuf, Arc<[u8]>)>> {
        let Some(index) = self.integer("bufferView", u32::MAX.into())? else { return Ok(None) };
        let view = self.document.view(index as usize)?;
        self.document.charge(view.bytes.len() as u64, &self.at)?;
        let name = self.document.path.join(format!("bufferViews[{index}]"));
        Ok(Some((name, view.bytes.into())))
    }

    /// A relative path within the file's folder, resolved.
    pub fn path(&self, key: &str) -> Result<Option<PathBuf>> {
        let Some(uri) = self.text(key)? else { return Ok(None) };
        let path = files::contained(uri).ok_or_else(|| self.error(key, files::NOT_CONTAINED))?;
        Ok(Some(self.document.dir().join(&*path)))
    }
}

fn pick<T: Copy>(json: &Value, of: &[(&str, T)]) -> Option<T> {
    of.iter().find(|(name, _)| json.as_str() == Some(name)).map(|(_, value)| *value)
}

fn one_of<T>(of: &[(&str, T)]) -> String {
    format!("is not {}", of.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", "))
}
