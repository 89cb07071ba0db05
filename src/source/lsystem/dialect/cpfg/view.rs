//! What lies beside a cpfg file: its view file, of which angles, widths, colours and surfaces are taken, and its map of
//! colours.

use std::path::{Path, PathBuf};

use super::patches;
use crate::scene::files;
use crate::scene::texture::srgb_to_linear;
use crate::source::lsystem::alphabet::{Action, ColourChange, Fallback, WidthChange};
use crate::source::lsystem::grammar::Grammar;
use crate::{Error, Result};

/// Bytes of a map: 256 colours.
const MAP_BYTES: usize = 768;
/// Largest view file, in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// The view file and the map of the same name that there are, and the surfaces that the view file names.
pub fn files(path: &Path) -> Vec<PathBuf> {
    let mut files = tables(path);
    let view = files.first().filter(|f| files::extension(f) == "v").and_then(|f| files::read(f, MAX_BYTES).ok());
    let text = view.map(|bytes| crate::scene::text::decode(&bytes).into_owned()).unwrap_or_default();
    let named = text.lines().filter_map(|line| line.split_once(':')).filter(|(label, _)| is_surface(label));
    files.extend(named.filter_map(|(_, value)| beside(path, value.split_whitespace().nth(1)?)));
    files
}

/// The view file and the map that there are.
fn tables(path: &Path) -> Vec<PathBuf> {
    ["v", "map"].into_iter().map(|extension| path.with_extension(extension)).filter(|p| p.is_file()).collect()
}

fn is_surface(label: &str) -> bool {
    label.trim().eq_ignore_ascii_case("surface")
}

fn beside(path: &Path, name: &str) -> Option<PathBuf> {
    files::find(path.parent().unwrap_or(Path::new("")), name, false)
}

/// Take over what the files beside `path` say.
///
/// # Errors
/// [`Error::Input`] where a number is none, or a map has another size; and what reading gives.
pub fn read(path: &Path, grammar: &mut Grammar) -> Result<()> {
    let mut surfaces = Vec::new();
    for file in tables(path) {
        let bytes = files::read(&file, MAX_BYTES)?;
        if files::extension(&file) == "map" {
            let Ok(map) = <[u8; MAP_BYTES]>::try_from(bytes) else {
                return Err(Error::input(&file, "", "a map has 256 colours of three bytes each"));
            };
            let colours = map.as_chunks::<3>().0.iter().map(|c| c.map(srgb_to_linear));
            grammar.colours = (0..).zip(colours).collect();
        } else {
            surfaces = view(&file, &crate::scene::text::decode(&bytes), grammar)?;
        }
    }
    grammar.first_colour = if grammar.colours.is_empty() { 0.0 } else { grammar.first_colour };
    for NamedSurface { letter, file, size, steps } in surfaces {
        let symbol = grammar.words.iter().find(|(_, word)| word.strip_prefix('~') == Some(&letter));
        let Some(symbol) = symbol.map(|(symbol, _)| *symbol) else { continue };
        let Some(found) = beside(path, &file) else {
            grammar.warnings.add(format!("there is no file {file} of the view file beside the grammar"));
            continue;
        };
        let text = files::read(&found, MAX_BYTES)?;
        let surface = patches::read(&found, &crate::scene::text::decode(&text), size, steps, grammar)?;
        grammar.surfaces.insert(symbol, surface);
    }
    Ok(())
}

/// A line `surface: letter file size steps steps`.
struct NamedSurface {
    letter: String,
    file: String,
    size: f64,
    /// Each way of a patch; without them as the file says.
    steps: [Option<usize>; 2],
}

impl NamedSurface {
    fn new(words: &[&str]) -> Option<NamedSurface> {
        let [letter, file, size, steps @ ..] = words else { return None };
        let size = size.parse().ok().filter(|v: &f64| v.is_finite())?;
        let steps = [0, 1].map(|i| steps.get(i).and_then(|w| w.parse().ok()).filter(|n| *n > 0));
        Some(NamedSurface { letter: (*letter).to_owned(), file: (*file).to_owned(), size, steps })
    }
}

/// Lines `label: value`; those of the picture alone are passed over. Gives the surfaces.
fn view(file: &Path, text: &str, grammar: &mut Grammar) -> Result<Vec<NamedSurface>> {
    let mut surfaces = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let Some((label, value)) = line.split_once(':') else { continue };
        let label = label.trim().to_lowercase();
        let words: Vec<&str> = value.split_whitespace().collect();
        let number = || {
            let number = words.first().and_then(|w| w.parse().ok()).filter(|v: &f64| v.is_finite());
            number.ok_or_else(|| {
                Error::input(file, format!("line {}", i + 1), format!("{label}: has to be followed by a number"))
            })
        };
        match label.as_str() {
            "surface" => {
                let what = "surface: has to be followed by a letter, a file and a size";
                let surface = NamedSurface::new(&words);
                surfaces.push(surface.ok_or_else(|| Error::input(file, format!("line {}", i + 1), what))?);
            }
            "angle increment" => grammar.angle = number()?,
            "angle factor" => grammar.angle = 360.0 / number()?.max(f64::MIN_POSITIVE),
            "initial color" => grammar.first_colour = number()?,
            "color increment" => colours(grammar, number()?),
            "line width increment" => widths(grammar, number()?),
            "initial line width" => {
                let width = number()?;
                // Widths in pixels are none of the plant's; so are those that its symbols give.
                if words.get(1).is_some_and(|w| w.starts_with("pi")) {
                    ['!', '#'].iter().for_each(|symbol| {
                        grammar.actions.remove(symbol);
                    });
                } else {
                    grammar.width = Some(width.max(0.0));
                }
            }
            _ => {}
        }
    }
    Ok(surfaces)
}

fn widths(grammar: &mut Grammar, increment: f64) {
    for (symbol, sign) in [('#', 1.0), ('!', -1.0)] {
        if let Some(Action::Width(WidthChange { otherwise, .. })) = grammar.actions.get_mut(&symbol) {
            *otherwise = Fallback::Add(sign * increment);
        }
    }
}

fn colours(grammar: &mut Grammar, increment: f64) {
    for (symbol, sign) in [(';', 1.0), (',', -1.0)] {
        if let Some(Action::Colour(ColourChange { default, .. })) = grammar.actions.get_mut(&symbol) {
            *default = sign * increment;
        }
    }
}
