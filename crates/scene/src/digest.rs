//! The name of a scene: a digest of its files and of which one is the main file.

use crate::assets::{AssetError, AssetSource};
use std::collections::BTreeMap;

/// BLAKE3 of a scene, as 64 lowercase hexadecimal digits.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, schemars::JsonSchema,
)]
#[serde(transparent)]
pub struct SceneDigest(String);

impl SceneDigest {
    /// The digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for SceneDigest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Text that is not a digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a digest: expected 64 lowercase hexadecimal digits")]
pub struct NotADigest;

impl std::str::FromStr for SceneDigest {
    type Err = NotADigest;
    fn from_str(text: &str) -> Result<Self, NotADigest> {
        let valid =
            text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        if valid {
            Ok(SceneDigest(text.to_owned()))
        } else {
            Err(NotADigest)
        }
    }
}

impl<'de> serde::Deserialize<'de> for SceneDigest {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

/// The BLAKE3 digest of one file.
pub fn file_digest(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

/// The digest of a scene from the digests of its files, by path. Lengths are part of it, so that no
/// two different sets of names and digests give the same input.
pub fn scene_digest(main: &str, files: &BTreeMap<String, [u8; 32]>) -> SceneDigest {
    let mut hasher = blake3::Hasher::new();
    let mut text = |text: &str| {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    text("brolly scene 1");
    text(main);
    for (path, digest) in files {
        hasher.update(&(path.len() as u64).to_le_bytes());
        hasher.update(path.as_bytes());
        hasher.update(digest);
    }
    SceneDigest(hasher.finalize().to_hex().to_string())
}

/// The same, reading the files.
pub fn digest_of<'p>(
    main: &str,
    paths: impl IntoIterator<Item = &'p String>,
    assets: &dyn AssetSource,
) -> Result<SceneDigest, AssetError> {
    let mut files = BTreeMap::new();
    for path in paths {
        files.insert(path.clone(), file_digest(&assets.read(path)?));
    }
    Ok(scene_digest(main, &files))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_contents_count() {
        let files = |names: &[(&str, &str)]| {
            names
                .iter()
                .map(|(n, b)| ((*n).to_owned(), file_digest(b.as_bytes())))
                .collect::<BTreeMap<_, _>>()
        };
        let base = scene_digest("a", &files(&[("a", "1"), ("b", "2")]));
        assert_eq!(base, scene_digest("a", &files(&[("b", "2"), ("a", "1")])));
        assert_ne!(base, scene_digest("b", &files(&[("a", "1"), ("b", "2")])));
        assert_ne!(base, scene_digest("a", &files(&[("a", "2"), ("b", "1")])));
        assert_ne!(base, scene_digest("a", &files(&[("a", "1")])));
        assert_eq!(base.as_str().parse(), Ok(base.clone()));
        assert_eq!(
            serde_json::from_str::<SceneDigest>(&serde_json::to_string(&base).unwrap()).unwrap(),
            base
        );
        assert!("ABC".parse::<SceneDigest>().is_err());
    }
}
