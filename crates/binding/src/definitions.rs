//! Message definitions that a log lacks. ROS 2 recorded none in its SQLite bags until 2023 (Iron), so that a log with
//! custom types cannot be read without them. ROS 1 bags written by rosjava may lack those of nested types.

use crate::error::IngestError;
use logscan::ScanError;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The longest definition, bytes.
const LONGEST: u64 = 1 << 20;
/// All ROS 2 packages together have a few thousand.
const MOST: usize = 20_000;
/// The deepest level of packages below the folder.
const DEEPEST: usize = 4;

/// Texts by type, as `px4_msgs/SensorGps`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Definitions(BTreeMap<String, String>);

impl Definitions {
    /// Adds the `PACKAGE/msg/TYPE.msg` of a folder and those below it; a later one replaces an earlier one of its type.
    /// The package is named by its `package.xml`, or else by its folder.
    ///
    /// # Errors
    /// [`IngestError::Log`], also for a folder below that cannot be listed; [`IngestError::Map`] if a definition is too
    /// long, or there are too many.
    pub(crate) fn add_folder(&mut self, folder: &Path) -> Result<(), IngestError> {
        let mut paths = vec![];
        collect(folder, 0, &mut paths)?;
        paths.sort();
        for path in paths {
            let Some(name) = type_name(&path) else { continue };
            let bad = |what: String| IngestError::Map(format!("{}: {what}", path.display()));
            let length = std::fs::metadata(&path).map_err(|e| failed(&path, e))?.len();
            if length > LONGEST || self.0.len() >= MOST {
                let what = format!("longer than {LONGEST} bytes, or there are more than {MOST} definitions");
                return Err(bad(what));
            }
            let bytes = std::fs::read(&path).map_err(|e| failed(&path, e))?;
            self.0.insert(name, String::from_utf8_lossy(&bytes).into_owned());
        }
        Ok(())
    }

    /// The text of a type, as `px4_msgs/SensorGps`.
    pub(crate) fn of(&self, type_name: &str) -> Option<&str> {
        self.0.get(type_name).map(String::as_str)
    }

    /// Types and texts, in the order of their names.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(name, text)| (name.as_str(), text.as_str()))
    }
}

fn failed(path: &Path, source: std::io::Error) -> IngestError {
    IngestError::from(ScanError::Io { file: path.display().to_string(), offset: 0, source })
}

/// `px4_msgs/SensorGps` from a path that ends in `px4_msgs/msg/SensorGps.msg`.
fn type_name(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|folder| folder.file_name().is_some_and(|name| name == "msg"))?;
    let folder = std::path::absolute(folder).ok()?;
    let package = folder.parent()?;
    let package = package_name(package).or_else(|| Some(package.file_name()?.to_str()?.to_owned()))?;
    Some(format!("{package}/{}", path.file_stem()?.to_str()?))
}

/// The package name in `package.xml`: its folder may be named after a branch, or a download.
fn package_name(package: &Path) -> Option<String> {
    let mut text = String::new();
    let path = package.join("package.xml");
    // Checked before opening: opening a pipe would wait for its writer.
    let about = std::fs::metadata(&path).ok().filter(std::fs::Metadata::is_file)?;
    File::open(path).ok()?.take(LONGEST.min(about.len())).read_to_string(&mut text).ok()?;
    let text = without_comments(&text);
    let name = text.split_once("<name>")?.1.split_once("</name>")?.0.trim();
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    (!name.is_empty() && name.chars().all(plain)).then(|| name.to_owned())
}

fn without_comments(xml: &str) -> String {
    let mut parts = xml.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + part.split_once("-->").map_or("", |(_, after)| after))
}

fn collect(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) -> Result<(), IngestError> {
    for entry in std::fs::read_dir(folder).map_err(|e| failed(folder, e))? {
        let entry = entry.map_err(|e| failed(folder, e))?;
        let path = entry.path();
        let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
        // Includes links, which `colcon --symlink-install` creates.
        if path.is_dir() && depth < DEEPEST && !is_hidden {
            collect(&path, depth + 1, paths)?;
        } else if path.is_file() && path.extension().is_some_and(|extension| extension == "msg") {
            paths.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_is_named_by_its_package_xml_or_else_by_its_folder() {
        let root = tempfile::tempdir().unwrap();
        for (folder, xml) in [
            ("px4_msgs-main", "<package format=\"3\">\n<!-- <name>old</name> -->\n  <name> px4_msgs </name>\n"),
            ("plain", ""),
            ("odd", "<name>../x</name>"),
            ("cut", "<name>half"),
        ] {
            let msg = root.path().join(folder).join("msg");
            std::fs::create_dir_all(&msg).unwrap();
            std::fs::write(msg.join("A.msg"), "int32 a\n").unwrap();
            if !xml.is_empty() {
                std::fs::write(root.path().join(folder).join("package.xml"), xml).unwrap();
            }
        }
        let mut definitions = Definitions::default();
        definitions.add_folder(root.path()).unwrap();
        let names: Vec<&str> = definitions.iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["cut/A", "odd/A", "plain/A", "px4_msgs/A"]);
    }
}
