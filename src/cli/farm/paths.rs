//! The files of a job as parameters of its template, so that a farm knows what to bring to a machine and what to take from it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::{Error, Result};

/// Files that are named one by one: a template may have 50 parameters. More are named by their folders.
const MAX_FILES: usize = 36;
/// Folders that are named.
const MAX_FOLDERS: usize = 40;

/// Whether a farm takes a file to the machines, or also back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Flow {
    In,
    InOut,
}

/// Files below the folder of the template.
pub struct Paths {
    /// By their paths from the template's folder.
    files: BTreeMap<PathBuf, Flow>,
    base: PathBuf,
}

impl Paths {
    /// `template`: the file that will be written.
    ///
    /// # Errors
    /// `Io` where its folder is not there.
    pub fn new(template: &Path) -> Result<Paths> {
        let folder = template.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let base = std::fs::canonicalize(folder).map_err(|e| Error::io(folder, e))?;
        Ok(Paths { files: BTreeMap::new(), base })
    }

    /// Path of a file from the template's folder.
    fn relative(&self, path: &Path) -> Result<PathBuf> {
        // What a link leads to has another folder; the folder's own name may be a link.
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = std::fs::canonicalize(folder).map_err(|e| Error::io(path, e))?;
        let whole = folder.join(path.file_name().unwrap_or_default());
        match whole.strip_prefix(&self.base) {
            Ok(relative) => Ok(relative.to_path_buf()),
            Err(_) => {
                let what = format!(
                    "{}: lies outside of {}, the job's folder, to which a farm's paths are relative; write the job into a \
                     folder above all of its files",
                    path.display(),
                    self.base.display()
                );
                Err(Error::Options(what))
            }
        }
    }

    /// Declare a file; the stronger of two flows counts.
    ///
    /// # Errors
    /// `Options` where it does not lie below the template's folder, or has a name that a template cannot say.
    pub fn add(&mut self, path: &Path, flow: Flow) -> Result<()> {
        let relative = self.relative(path)?;
        let Some(text) = relative.to_str().filter(|t| !t.contains("{{") && !t.contains(char::is_control)) else {
            let what = "a job cannot name a file whose name holds {{, a control character or what is not UTF-8";
            return Err(Error::Options(format!("{}: {what}", path.display())));
        };
        // As on every system.
        let relative = PathBuf::from(if cfg!(windows) { text.replace('\\', "/") } else { text.to_owned() });
        let known = self.files.entry(relative).or_insert(flow);
        *known = flow.max(*known);
        Ok(())
    }

    fn by_folder(&self) -> bool {
        self.files.len() > MAX_FILES
    }

    /// The folders of all files, with the strongest flow in each.
    fn folders(&self) -> BTreeMap<&Path, Flow> {
        let mut folders = BTreeMap::new();
        for (file, &flow) in &self.files {
            let known = folders.entry(file.parent().unwrap_or(Path::new(""))).or_insert(flow);
            *known = flow.max(*known);
        }
        folders
    }

    /// How an argument names a declared file.
    ///
    /// # Errors
    /// `Options` where it was not declared.
    pub fn refer(&self, path: &Path) -> Result<String> {
        let relative = self.relative(path)?;
        let undeclared = || Error::Options(format!("{}: is no file of the job", path.display()));
        if self.by_folder() {
            let folder = relative.parent().unwrap_or(Path::new(""));
            let index = self.folders().keys().position(|&f| f == folder).ok_or_else(undeclared)?;
            let name = relative.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Ok(format!("{{{{Param.Folder{}}}}}/{name}", index + 1));
        }
        let index = self.files.keys().position(|f| *f == relative).ok_or_else(undeclared)?;
        Ok(format!("{{{{Param.File{}}}}}", index + 1))
    }

    /// The parameters' definitions.
    ///
    /// # Errors
    /// `Limit` where a template has no room for them.
    pub fn definitions(&self) -> Result<Vec<Value>> {
        let define = |kind: &str, object: &str, index: usize, path: &Path, flow: Flow| {
            let flow = if flow == Flow::In { "IN" } else { "INOUT" };
            let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
            json!({
                "name": format!("{kind}{}", index + 1), "type": "PATH", "objectType": object, "dataFlow": flow,
                "default": path.to_string_lossy(),
            })
        };
        if !self.by_folder() {
            let files = self.files.iter().enumerate();
            return Ok(files.map(|(i, (path, &flow))| define("File", "FILE", i, path, flow)).collect());
        }
        let folders = self.folders();
        if folders.len() > MAX_FOLDERS {
            let what = "folders of the job's files; put the files together: a job".to_owned();
            return Err(Error::Limit { what, needed: folders.len() as u64, allowed: MAX_FOLDERS as u64 });
        }
        let folders = folders.into_iter().enumerate();
        Ok(folders.map(|(i, (path, flow))| define("Folder", "DIRECTORY", i, path, flow)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_one_by_one_or_by_their_folders() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("in")).unwrap();
        let mut paths = Paths::new(&dir.path().join("job.yaml")).unwrap();
        let land = dir.path().join("land.gltf");
        paths.add(&land, Flow::In).unwrap();
        let texel = dir.path().join("in/../in/tree.vtex");
        paths.add(&texel, Flow::InOut).unwrap();
        paths.add(&texel, Flow::In).unwrap();
        assert_eq!(paths.refer(&land).unwrap(), "{{Param.File2}}");
        assert_eq!(paths.refer(&texel).unwrap(), "{{Param.File1}}");
        let defined = paths.definitions().unwrap();
        assert_eq!(defined[0]["default"], "in/tree.vtex");
        assert_eq!((&defined[0]["dataFlow"], &defined[1]["dataFlow"]), (&json!("INOUT"), &json!("IN")));
        for i in 0..MAX_FILES {
            paths.add(&dir.path().join(format!("in/{i}.png")), Flow::In).unwrap();
        }
        assert_eq!(paths.refer(&texel).unwrap(), "{{Param.Folder2}}/tree.vtex");
        let defined = paths.definitions().unwrap();
        let all: Vec<_> = defined.iter().map(|d| (d["default"].clone(), d["dataFlow"].clone())).collect();
        assert_eq!(all, [(json!("."), json!("IN")), (json!("in"), json!("INOUT"))]);
    }

    #[test]
    fn what_a_job_cannot_name_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("jobs")).unwrap();
        let mut paths = Paths::new(&dir.path().join("jobs/job.yaml")).unwrap();
        let refused = |line: Result<()>| line.unwrap_err().to_string();
        assert!(refused(paths.add(&dir.path().join("land.gltf"), Flow::In)).contains("lies outside of"));
        assert!(refused(paths.add(&dir.path().join("jobs/a{{b"), Flow::In)).contains("cannot name"));
        assert!(paths.refer(&dir.path().join("jobs/c")).is_err());
    }
}
