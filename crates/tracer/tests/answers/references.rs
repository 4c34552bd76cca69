//! Papers are cited by keys in brackets; each key is in `docs/references.md`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// `[Name99`, `[NameOther99a`: a capital, letters, two or four digits.
fn keys(text: &str) -> Vec<String> {
    let key = |rest: &str| {
        let letters = rest.chars().take_while(char::is_ascii_alphabetic).count();
        let digits = rest[letters..]
            .chars()
            .take_while(char::is_ascii_digit)
            .count();
        let fits = letters >= 2
            && rest.starts_with(|c: char| c.is_ascii_uppercase())
            && matches!(digits, 2 | 4);
        let ends = rest[letters + digits..].starts_with([']', ',', ' ']);
        (fits && ends).then(|| rest[..letters + digits].to_owned())
    };
    text.split('[').skip(1).filter_map(key).collect()
}

#[test]
fn every_cited_paper_is_listed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let listed = std::fs::read_to_string(root.join("docs/references.md")).unwrap();
    let mut files = vec![];
    for krate in std::fs::read_dir(root.join("crates")).unwrap() {
        let src = krate.unwrap().path().join("src");
        if src.is_dir() {
            sources(&src, &mut files);
        }
    }
    let mut missing: BTreeMap<String, PathBuf> = BTreeMap::new();
    let mut cited = 0;
    for file in files {
        for line in std::fs::read_to_string(&file).unwrap().lines() {
            let Some((_, comment)) = line.split_once("//") else {
                continue;
            };
            for key in keys(comment) {
                cited += 1;
                if !listed.contains(&format!("[{key}]")) {
                    missing.insert(key, file.clone());
                }
            }
        }
    }
    assert!(cited > 10, "only {cited} citations found");
    assert!(missing.is_empty(), "not in docs/references.md: {missing:?}");
}
