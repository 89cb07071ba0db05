//! META: the description of a texel in its file, as canonical JSON (RFC 8785), so that equal descriptions are equal bytes.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

use super::Channel;
use super::layout::{Header, MAX_META, StreamEntry};
use crate::geom::{Aabb, DVec3};
use crate::volume::material::{MAX_MATERIALS, Material};
use crate::volume::{Channels, Info, Model};
use crate::{Error, Result};

/// Largest facet size, in edges of the cube.
const MAX_FACET_SIZE: f64 = 2.0;
/// Deepest nesting.
const MAX_NESTING: usize = 16;
/// Keys that hold fields of [`Info`].
const RESERVED_KEYS: [&str; 4] = ["content", "facet_size", "materials", "model"];

/// META of `info` as JSON.
///
/// # Errors
/// [`Error::Options`] where `info.meta` uses one of [`RESERVED_KEYS`], is nested too deeply, or a material is not valid;
/// [`Error::Limit`] where META is longer than readers accept.
pub fn encode(info: &Info) -> Result<Vec<u8>> {
    let mut all = info.meta.clone();
    if let Some(key) = RESERVED_KEYS.into_iter().find(|&k| all.contains_key(k)) {
        return Err(Error::Options(format!("META: the key {key:?} is the format's own")));
    }
    let content = if info.content.is_empty() { Aabb::new(DVec3::ZERO, DVec3::ZERO) } else { info.content };
    // Rounding may lead out of the cube. A facet may be far wider than the cube that it was cut by; its exact size is then of no use.
    let unit = |v: DVec3| v.clamp(DVec3::ZERO, DVec3::ONE);
    let content = Aabb::new(unit(content.min), unit(content.max));
    let facet_size = info.facet_size.clamp(0.0, MAX_FACET_SIZE);
    let numbers = |v: DVec3| Value::from(v.to_array().to_vec());
    all.insert("content".into(), serde_json::json!({ "max": numbers(content.max), "min": numbers(content.min) }));
    all.insert("facet_size".into(), facet_size.into());
    all.insert("model".into(), serde_json::to_value(info.model).unwrap_or_default());
    if !info.materials.is_empty() {
        check(&info.materials).map_err(|what| Error::Options(format!("META: {what}")))?;
        all.insert("materials".into(), serde_json::to_value(&info.materials).unwrap_or_default());
    }
    let all = Value::Object(all);
    if nesting(&all) > MAX_NESTING {
        return Err(Error::Options(format!("META is nested deeper than {MAX_NESTING}")));
    }
    let mut out = String::new();
    put(&all, &mut out);
    if out.len() > MAX_META {
        return Err(Error::Limit { what: "META".into(), needed: out.len() as u64, allowed: MAX_META as u64 });
    }
    Ok(out.into_bytes())
}

/// Description of the texel from the bytes of META, the header and the streams. The error is a sentence that says what is wrong with
/// META.
pub fn parse(bytes: &[u8], header: &Header, streams: &[StreamEntry]) -> Result<Info, String> {
    let value: Value = serde_json::from_slice(bytes).map_err(|e| format!("META is not JSON: {e}"))?;
    let mut canonical = String::new();
    put(&value, &mut canonical);
    if canonical.as_bytes() != bytes {
        return Err("META is not canonical JSON".into());
    }
    if nesting(&value) > MAX_NESTING {
        return Err(format!("META is nested deeper than {MAX_NESTING}"));
    }
    let Value::Object(mut meta) = value else { return Err("META is not an object".into()) };
    let corner = |v: &Value, key: &str| -> Option<DVec3> {
        let v = v.get(key)?.as_array()?;
        (v.len() == 3).then_some(())?;
        Some(DVec3::new(v[0].as_f64()?, v[1].as_f64()?, v[2].as_f64()?))
    };
    let content = meta.remove("content").unwrap_or_default();
    let content = corner(&content, "min").zip(corner(&content, "max")).map(|(a, b)| Aabb::new(a, b));
    let unit = |b: &Aabb| !b.is_empty() && b.min.min_element() >= 0.0 && b.max.max_element() <= 1.0;
    let content = content.filter(unit).ok_or("META's \"content\" is not a box in [0, 1]^3")?;
    let facet_size = meta.remove("facet_size").and_then(|v| v.as_f64()).filter(|v| (0.0..=MAX_FACET_SIZE).contains(v));
    let facet_size = facet_size.ok_or("META's \"facet_size\" is not a number in [0, 2]")?;
    let model = meta.remove("model").unwrap_or_default();
    let model: Model = serde_json::from_value(model).map_err(|e| format!("META's \"model\": {e}"))?;
    let materials = materials(meta.remove("materials"))?;
    let material_stream = streams.iter().find(|s| s.channel() == Some(Channel::Material));
    if material_stream.map_or(1, |s| usize::from(s.quant_max) + 1) != materials.len()
        && (material_stream.is_some() || materials.len() > 1)
    {
        return Err(format!("META names {} materials, which is not what the streams have", materials.len()));
    }
    let has = |c: Channel| streams.iter().any(|s| s.channel() == Some(c));
    let b = &header.bounds;
    Ok(Info {
        bounds: Aabb::new(DVec3::new(b[0], b[1], b[2]), DVec3::new(b[3], b[4], b[5])),
        metres_per_unit: header.metres_per_unit,
        up: header.up,
        cyclic: std::array::from_fn(|k| header.cyclic >> k & 1 != 0),
        model,
        content,
        facet_size,
        channels: Channels {
            correlation: has(Channel::BlockCorrelation),
            support: has(Channel::Support),
            albedo: has(Channel::Albedo),
            mean_normal: has(Channel::MeanNormal),
        },
        materials,
        meta,
    })
}

/// META's materials.
fn materials(value: Option<Value>) -> Result<Vec<Material>, String> {
    let Some(value) = value else { return Ok(Vec::new()) };
    let materials: Vec<Material> = serde_json::from_value(value).map_err(|e| format!("META's \"materials\": {e}"))?;
    check(&materials).map(|()| materials)
}

/// Check that names are not empty and unique, and that numbers are in range.
fn check(materials: &[Material]) -> Result<(), String> {
    if !(1..=MAX_MATERIALS).contains(&materials.len()) {
        return Err(format!("{} materials, not 1 to {MAX_MATERIALS}", materials.len()));
    }
    let mut names = BTreeSet::new();
    for m in materials {
        if m.name.is_empty() || !names.insert(m.name.as_str()) {
            return Err(format!("the material name {:?} is empty, or there twice", m.name));
        }
        if m.albedo.iter().chain([&m.share]).any(|v| !(0.0..=1.0).contains(v)) {
            return Err(format!("albedo and share of the material {:?} are not in [0, 1]", m.name));
        }
    }
    Ok(())
}

/// Placeholder for the description of a file whose META is not read yet.
pub fn blank_info() -> Info {
    Info {
        bounds: Aabb::UNIT,
        metres_per_unit: 0.0,
        up: 0,
        cyclic: [false; 3],
        model: Model::default(),
        content: Aabb::UNIT,
        facet_size: 0.0,
        channels: Channels::default(),
        materials: Vec::new(),
        meta: Map::new(),
    }
}

fn nesting(value: &Value) -> usize {
    match value {
        Value::Array(items) => 1 + items.iter().map(nesting).max().unwrap_or(0),
        Value::Object(items) => 1 + items.values().map(nesting).max().unwrap_or(0),
        _ => 0,
    }
}

/// Append `value` as RFC 8785 writes it.
fn put(value: &Value, out: &mut String) {
    match value {
        Value::Array(items) => {
            out.push('[');
            for (i, item) in items.iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                put(item, out);
            }
            out.push(']');
        }
        Value::Object(map) => {
            let mut items: Vec<_> = map.iter().collect();
            items.sort_by_cached_key(|(key, _)| key.encode_utf16().collect::<Vec<_>>());
            out.push('{');
            for (i, (key, item)) in items.into_iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                // serde_json escapes strings as RFC 8785 asks: two-character escapes, else \u00xx in lower case.
                out.push_str(&Value::from(key.as_str()).to_string());
                out.push(':');
                put(item, out);
            }
            out.push('}');
        }
        Value::Number(number) => put_number(number.as_f64().unwrap_or(0.0), out),
        other => out.push_str(&other.to_string()),
    }
}

/// ECMAScript's Number::toString: the shortest digits that read back, placed by their exponent.
fn put_number(v: f64, out: &mut String) {
    if v == 0.0 {
        return out.push('0');
    }
    let text = format!("{:e}", v.abs());
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let digits: String = mantissa.chars().filter(|c| *c != '.').collect();
    let (n, k) = (exponent.parse::<i32>().unwrap_or(0) + 1, digits.len() as i32);
    if v < 0.0 {
        out.push('-');
    }
    let zeros = |count: i32| "0".repeat(count.max(0) as usize);
    match n {
        _ if k <= n && n <= 21 => *out += &(digits + &zeros(n - k)),
        1..=21 => *out += &format!("{}.{}", &digits[..n as usize], &digits[n as usize..]),
        -5..=0 => *out += &format!("0.{}{digits}", zeros(-n)),
        _ => {
            let point = if k > 1 { "." } else { "" };
            let sign = if n > 0 { '+' } else { '-' };
            *out += &format!("{}{point}{}e{sign}{}", &digits[..1], &digits[1..], (n - 1).abs());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn canonical_text() {
        // Number samples of RFC 8785, appendix B, and its section 3.2.2 and 3.2.3 rules for strings and keys.
        for (v, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (5e-324, "5e-324"),
            (-5e-324, "-5e-324"),
            (f64::MAX, "1.7976931348623157e+308"),
            (9007199254740992.0, "9007199254740992"),
            (295147905179352830000.0, "295147905179352830000"),
            (1e21, "1e+21"),
            (9.999999999999997e22, "9.999999999999997e+22"),
            (0.000001, "0.000001"),
            (333333333.3333332, "333333333.3333332"),
            (0.000001234, "0.000001234"),
            (1e-7, "1e-7"),
            (-123.5, "-123.5"),
        ] {
            let mut out = String::new();
            put_number(v, &mut out);
            assert_eq!(out, text);
        }
        let value: Value =
            serde_json::from_str(r#"{"\ufb33":1,"\ud83d\ude02":[true,null],"a":"\u0008\n\u001f\"€"}"#).unwrap();
        let mut out = String::new();
        put(&value, &mut out);
        assert_eq!(out, "{\"a\":\"\\b\\n\\u001f\\\"€\",\"\u{1f602}\":[true,null],\"\u{fb33}\":1}");
    }

    proptest! {
        #[test]
        fn numbers_read_back(v in proptest::num::f64::NORMAL) {
            let mut out = String::new();
            put_number(v, &mut out);
            prop_assert_eq!(serde_json::from_str::<f64>(&out).unwrap(), v);
        }
    }
}
