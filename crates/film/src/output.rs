//! Pictures from films, and pictures read back to be compared.

pub mod color;
pub mod exr;
pub mod png;
pub mod read;
pub mod tonemap;

use crate::error::PictureError;
use crate::film::Film;
use crate::version::EngineVersion;

/// What a picture file says about itself.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureInfo {
    /// Of the merged state: [`Film::digest`].
    pub digest: [u8; 32],
    /// Engine version of the samples.
    pub engine: EngineVersion,
    /// Fewest and most samples of a pixel.
    pub spp: (u32, u32),
    /// What noise is left, if there are enough samples to say.
    pub error: Option<PictureError>,
    /// Seed of the job.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Whether a clamp was asked for.
    pub biased: bool,
}

impl PictureInfo {
    /// Of a film as it stands.
    pub fn of(film: &Film, seed: u64, version: &str, biased: bool) -> PictureInfo {
        PictureInfo {
            digest: film.digest(),
            engine: film.engine(),
            spp: film.spp_span(),
            error: film.error(),
            seed,
            version: version.to_owned(),
            biased,
        }
    }

    /// Names and values, in the order in which they are written.
    pub fn fields(&self) -> Vec<(&'static str, String)> {
        let spp = match self.spp {
            (low, high) if low == high => low.to_string(),
            (low, high) => format!("{low}-{high}"),
        };
        let mut fields = vec![
            ("Software", format!("Brolly {}", self.version)),
            ("brolly.digest", hex(&self.digest)),
            ("brolly.engine", self.engine.to_string()),
            ("brolly.spp", spp),
            ("brolly.seed", self.seed.to_string()),
        ];
        if let Some(error) = self.error {
            fields.push(("brolly.error", error.value.to_string()));
            fields.push(("brolly.error_kind", error.kind.to_string()));
        }
        if self.biased {
            fields.push(("brolly.biased", "true".into()));
        }
        fields
    }
}

/// Lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Why a picture was not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The PNG encoder failed.
    #[error("the PNG could not be written")]
    Png(#[source] ::png::EncodingError),
    /// The deflate encoder failed.
    #[error("the EXR could not be compressed")]
    Deflate(#[source] std::io::Error),
}
