//! A job as a template of Open Job Description (specification 2023-09, extension TASK_CHUNKING).
//!
//! Based on: <https://github.com/OpenJobDescription/openjd-specifications>, *Template Schemas* and RFC 0001 *Task Chunking*.

use serde_json::{Value, json};

use super::paths::Paths;
use crate::cli::frames::Frames;
use crate::render::CropWindow;
use crate::{Error, Result};

/// Longest list of a task's parameter.
pub const MAX_TILES: usize = 1024;
/// Longest name of a step, in characters.
const STEP_NAME: usize = 64;
/// Longest name of a job, in characters.
const JOB_NAME: usize = 128;

/// What a farm is to do.
pub struct Job {
    /// Name of the pictures, without number and extension.
    pub name: String,
    /// `.png` or `.exr`.
    pub extension: &'static str,
    /// Arguments of each bake, with what it makes.
    pub bakes: Vec<(String, Vec<String>)>,
    /// How the landscape is named.
    pub landscape: String,
    pub frames: Option<Frames>,
    pub frames_per_task: u32,
    /// One, or those that make up a picture.
    pub tiles: Vec<CropWindow>,
    /// Options of `vtex render`.
    pub render: Vec<String>,
}

/// Folder of the pictures, by default, and in it that of the tiles.
pub fn folders(name: &str) -> [String; 2] {
    let pictures = format!("{name}-frames");
    let tiles = format!("{pictures}/tiles");
    [pictures, tiles]
}

impl Job {
    /// # Errors
    /// `Limit` where there are too many tiles, or files.
    pub fn template(&self, paths: &Paths) -> Result<Value> {
        if self.tiles.len() > MAX_TILES {
            let (needed, allowed) = (self.tiles.len() as u64, MAX_TILES as u64);
            return Err(Error::Limit { what: "the job's tiles".into(), needed, allowed });
        }
        let tiled = self.tiles.len() > 1;
        let [pictures, tiles] = folders(&self.name);
        let folder = |name: &str, flow: &str, default: &str| json!({ "name": name, "type": "PATH", "objectType": "DIRECTORY", "dataFlow": flow, "default": default });
        let mut parameters = vec![json!({
            "name": "Vtex", "type": "STRING", "default": "vtex", "description": "The program, if it is not on the path",
        })];
        if let Some(frames) = self.frames {
            let range = format!("{}-{}", frames.first, frames.last);
            parameters.push(json!({ "name": "Frames", "type": "STRING", "default": range }));
            parameters.push(
                json!({ "name": "FramesPerTask", "type": "INT", "minValue": 1, "default": self.frames_per_task }),
            );
        }
        parameters.push(folder("Pictures", "OUT", &pictures));
        if tiled {
            parameters.push(folder("Tiles", "INOUT", &tiles));
        }
        parameters.extend(paths.definitions()?);
        let steps = self.steps();
        Ok(json!({
            "specificationVersion": "jobtemplate-2023-09",
            "extensions": ["TASK_CHUNKING"],
            "name": self.name.chars().take(JOB_NAME).collect::<String>(),
            "parameterDefinitions": parameters,
            "steps": steps,
        }))
    }

    fn steps(&self) -> Vec<Value> {
        let step = |name: &str, needs: &[String], parameters: Vec<Value>, words: Vec<String>| {
            let mut step = json!({ "name": name });
            if !needs.is_empty() {
                step["dependencies"] = needs.iter().map(|name| json!({ "dependsOn": name })).collect();
            }
            if !parameters.is_empty() {
                step["parameterSpace"] = json!({ "taskParameterDefinitions": parameters });
            }
            step["script"] = json!({ "actions": { "onRun": { "command": "{{Param.Vtex}}", "args": words } } });
            step
        };
        let (mut steps, mut baked) = (Vec::new(), Vec::new());
        for (i, (texel, words)) in self.bakes.iter().enumerate() {
            let name: String = format!("Bake {} {texel}", i + 1).chars().take(STEP_NAME).collect();
            steps.push(step(&name, &[], Vec::new(), words.clone()));
            baked.push(name);
        }
        let chunks = || {
            self.frames.map(|_| {
                json!({
                    "name": "Frame", "type": "CHUNK[INT]", "range": "{{Param.Frames}}",
                    "chunks": { "defaultTaskCount": "{{Param.FramesPerTask}}", "rangeConstraint": "CONTIGUOUS" },
                })
            })
        };
        let render = "Render".to_owned();
        let tiled = self.tiles.len() > 1;
        let tiles: Vec<String> = self.tiles.iter().map(CropWindow::to_string).collect();
        let tile = tiled.then(|| json!({ "name": "Tile", "type": "STRING", "range": tiles }));
        steps.push(step(&render, &baked, chunks().into_iter().chain(tile).collect(), self.render_words(tiled)));
        if tiled {
            let mut words: Vec<String> = vec!["stitch".into()];
            words.extend(tiles.iter().map(|tile| self.tile(tile)));
            words.extend(self.frame_words());
            words.extend(["-o".into(), self.picture()]);
            steps.push(step("Stitch", &[render], chunks().into_iter().collect(), words));
        }
        steps
    }

    fn render_words(&self, tiled: bool) -> Vec<String> {
        let mut words: Vec<String> = vec!["render".into(), self.landscape.clone()];
        words.extend(self.frame_words());
        words.extend(self.render.iter().cloned());
        if tiled {
            words.extend(["--tile".into(), "{{Task.Param.Tile}}".into()]);
        }
        let output = if tiled { self.tile("{{Task.Param.Tile}}") } else { self.picture() };
        words.extend(["-o".into(), output]);
        words
    }

    fn frame_words(&self) -> Vec<String> {
        self.frames.map_or_else(Vec::new, |_| vec!["--frames".into(), "{{Task.Param.Frame}}".into()])
    }

    /// The number's place in a name.
    fn number(&self) -> &'static str {
        if self.frames.is_some() { ".####" } else { "" }
    }

    fn picture(&self) -> String {
        format!("{{{{Param.Pictures}}}}/{}{}{}", self.name, self.number(), self.extension)
    }

    fn tile(&self, tile: &str) -> String {
        format!("{{{{Param.Tiles}}}}/{}.{tile}{}{}", self.name, self.number(), self.extension)
    }
}
