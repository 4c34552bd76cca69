//! Pictures to files.

use anyhow::Context;
use client::{Client, ImageQuery};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use uuid::Uuid;

/// Fetches every frame in `frames` into every file in `outputs`. With several frames the number goes
/// where the name has `####`, else before the extension.
pub async fn fetch(
    client: &Client,
    job: Uuid,
    frames: [u32; 2],
    outputs: &[PathBuf],
    query: &ImageQuery,
) -> anyhow::Result<()> {
    for frame in frames[0]..=frames[1] {
        for output in outputs {
            let path = if frames[0] == frames[1] {
                output.clone()
            } else {
                numbered(output, frame)
            };
            let query = ImageQuery {
                frame: Some(frame),
                ..query.clone()
            };
            let picture = client
                .image(job, format(output), &query, None)
                .await
                .with_context(|| format!("{} cannot be fetched", path.display()))?;
            if let Some(picture) = picture {
                write(&path, &picture.bytes)?;
            }
        }
    }
    Ok(())
}

/// `png` or `exr`; the command line lets nothing else in.
fn format(path: &Path) -> &'static str {
    match path.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("exr") => "exr",
        _ => "png",
    }
}

fn numbered(path: &Path, frame: u32) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let number = format!("{frame:04}");
    let name = if name.contains("####") {
        name.replacen("####", &number, 1)
    } else {
        match name.rsplit_once('.') {
            Some((stem, extension)) => format!("{stem}.{number}.{extension}"),
            None => format!("{name}.{number}"),
        }
    };
    path.with_file_name(name)
}

/// Writes beside the target and renames, so that a picture is there whole or not at all.
fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let mut part: OsString = path.as_os_str().to_owned();
    part.push(format!(".{}.part", std::process::id()));
    let part = PathBuf::from(part);
    std::fs::write(&part, bytes)
        .and_then(|()| std::fs::rename(&part, path))
        .inspect_err(|_| {
            let _ = std::fs::remove_file(&part);
        })
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// Refuses before hours of rendering what could not be written after them.
pub fn check_writable(outputs: &[PathBuf]) -> anyhow::Result<()> {
    for output in outputs {
        let folder = output
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        if !folder.is_dir() {
            anyhow::bail!(
                "{}: there is no folder {}",
                output.display(),
                folder.display()
            );
        }
        if output.is_dir() {
            anyhow::bail!("{} is a folder", output.display());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_numbered() {
        let check = |path: &str, expect: &str| {
            assert_eq!(numbered(Path::new(path), 7), PathBuf::from(expect));
        };
        check("a/b.png", "a/b.0007.png");
        check("a/b.####.exr", "a/b.0007.exr");
        check("####.png", "0007.png");
    }

    #[test]
    fn a_missing_folder_is_told_at_once() {
        let dir = tempfile::tempdir().unwrap();
        assert!(check_writable(&[dir.path().join("a.png")]).is_ok());
        assert!(check_writable(&[dir.path().join("no/a.png")]).is_err());
        assert!(check_writable(&[dir.path().to_owned()]).is_err());
        write(&dir.path().join("a.png"), b"x").unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
