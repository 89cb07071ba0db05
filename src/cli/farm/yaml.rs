//! JSON values as YAML that people read: blocks, but for short lists of plain values.

use serde_json::Value;

/// Columns that a list may take in a line.
const WIDTH: usize = 110;

/// A YAML document. Strings are quoted as in JSON, which YAML reads the same.
pub fn document(value: &Value) -> String {
    let mut out = String::new();
    block(value, 0, &mut out);
    out
}

/// The lines of a value, the first of which begins where `out` ends; the others are indented by `indent` spaces.
fn block(value: &Value, indent: usize, out: &mut String) {
    match value {
        Value::Object(map) if !map.is_empty() => {
            for (i, (key, value)) in map.iter().enumerate() {
                if i > 0 {
                    pad(indent, out);
                }
                let key = if is_plain(key) { key.clone() } else { Value::from(key.as_str()).to_string() };
                out.push_str(&key);
                out.push(':');
                below(value, indent + 2, out);
            }
        }
        Value::Array(list) if !list.is_empty() => {
            for (i, value) in list.iter().enumerate() {
                if i > 0 {
                    pad(indent, out);
                }
                out.push_str("- ");
                block(value, indent + 2, out);
            }
        }
        _ => {
            out.push_str(&value.to_string());
            out.push('\n');
        }
    }
}

/// A key's value: beside it where that is short, else below.
fn below(value: &Value, indent: usize, out: &mut String) {
    match value {
        Value::Array(list) if list.iter().all(is_scalar) => {
            let line = format!("[{}]", list.iter().map(Value::to_string).collect::<Vec<_>>().join(", "));
            if indent + line.len() <= WIDTH {
                out.push(' ');
                out.push_str(&line);
                out.push('\n');
                return;
            }
        }
        Value::Array(_) | Value::Object(_) => {}
        _ => {
            out.push(' ');
            return block(value, indent, out);
        }
    }
    if is_empty(value) {
        out.push(' ');
    } else {
        out.push('\n');
        pad(indent, out);
    }
    block(value, indent, out);
}

fn pad(indent: usize, out: &mut String) {
    out.extend(std::iter::repeat_n(' ', indent));
}

fn is_scalar(value: &Value) -> bool {
    !value.is_array() && !value.is_object()
}

fn is_empty(value: &Value) -> bool {
    value.as_array().is_some_and(Vec::is_empty) || value.as_object().is_some_and(serde_json::Map::is_empty)
}

/// Whether a key needs no quotes. Words that YAML takes for values (`no`, `null`) are not among keys of a template.
fn is_plain(key: &str) -> bool {
    key.starts_with(|c: char| c.is_ascii_alphabetic()) && key.bytes().all(|b| b.is_ascii_alphanumeric())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn values_are_blocks() {
        let value = json!({
            "name": "a: \"b\" #c\n", "count": 3, "none": [], "nothing": {}, "a key": true,
            "steps": [{ "name": "x", "args": ["-o", "y z"] }, { "name": "w", "inner": { "deep": null } }],
            "nested": [[1, 2], [3]],
            "long": ["a".repeat(60), "b".repeat(60)],
        });
        let wanted = format!(
            r#"name: "a: \"b\" #c\n"
count: 3
none: []
nothing: {{}}
"a key": true
steps:
  - name: "x"
    args: ["-o", "y z"]
  - name: "w"
    inner:
      deep: null
nested:
  - - 1
    - 2
  - - 3
long:
  - "{}"
  - "{}"
"#,
            "a".repeat(60),
            "b".repeat(60)
        );
        assert_eq!(document(&value), wanted);
    }
}
