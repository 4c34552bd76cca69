//! Tiles, sample ranges, units of work and the fixed pass schedule.

use serde::{Deserialize, Serialize};

/// Side of a tile in pixels; tiles at the right and bottom border are cut.
pub const TILE_SIZE: u32 = 64;

/// Most samples that a pixel can have.
pub const SPP_MAX: u32 = 1 << 24;

/// Longest side of a picture in pixels.
pub const SIDE_MAX: u32 = 65_536;

/// Most pixels of a picture.
pub const PIXELS_MAX: u64 = 1 << 28;

/// Samples from `begin` up to but not including `end`, for every pixel of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SampleRange {
    /// First sample index.
    pub begin: u32,
    /// One past the last sample index.
    pub end: u32,
}

impl SampleRange {
    /// Number of samples.
    pub fn len(self) -> u32 {
        self.end - self.begin
    }
    /// Whether it holds no sample.
    pub fn is_empty(self) -> bool {
        self.begin >= self.end
    }
    /// Whether a sample is in both.
    pub fn overlaps(self, other: SampleRange) -> bool {
        self.begin < other.end && other.begin < self.end
    }
}

/// The first pass border above `index`. Passes end at 1, 2, 4, 8, ... 512, then every 512, in every
/// job, so that an extension or a tighter target goes on where the straight run would. Indices that
/// nobody renders come from damaged files: their border is the largest number there is.
pub fn pass_end(index: u32) -> u32 {
    if index == 0 {
        1
    } else if index < 512 {
        (index + 1).next_power_of_two()
    } else {
        (index / 512 + 1).saturating_mul(512)
    }
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Tile {
    /// Left edge, pixels from the left of the picture.
    pub x: u32,
    /// Top edge, pixels from the top of the picture.
    pub y: u32,
    /// Width in pixels, 1 to [`TILE_SIZE`].
    pub width: u32,
    /// Height in pixels, 1 to [`TILE_SIZE`].
    pub height: u32,
}

impl Tile {
    /// Number of pixels.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// How a picture is cut into tiles, row by row from the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileGrid {
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
}

impl TileGrid {
    /// Tiles side by side.
    pub fn columns(self) -> u32 {
        self.width.div_ceil(TILE_SIZE)
    }
    /// Tiles one above the other.
    pub fn rows(self) -> u32 {
        self.height.div_ceil(TILE_SIZE)
    }
    /// Number of tiles.
    pub fn count(self) -> u32 {
        self.columns() * self.rows()
    }
    /// The rectangle of tile `index`.
    pub fn tile(self, index: u32) -> Tile {
        let x = (index % self.columns()) * TILE_SIZE;
        let y = (index / self.columns()) * TILE_SIZE;
        Tile {
            x,
            y,
            width: (self.width - x).min(TILE_SIZE),
            height: (self.height - y).min(TILE_SIZE),
        }
    }
}

/// What a worker renders in one go: a range of samples, inside one pass, for every pixel of a tile
/// of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Unit {
    /// Frame number.
    pub frame: u32,
    /// Index in the [`TileGrid`].
    pub tile: u32,
    /// Which samples.
    pub samples: SampleRange,
}

/// `frame-tile-begin-end`: the name of a unit in addresses and logs.
impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}-{}-{}-{}",
            self.frame, self.tile, self.samples.begin, self.samples.end
        )
    }
}

/// A text that does not name a unit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' does not name a unit (frame-tile-begin-end)")]
pub struct UnitNameError(String);

impl std::str::FromStr for Unit {
    type Err = UnitNameError;
    fn from_str(text: &str) -> Result<Self, UnitNameError> {
        let parse = || -> Option<Unit> {
            let mut parts = text.split('-');
            let mut next = || parts.next()?.parse::<u32>().ok();
            let (frame, tile, begin, end) = (next()?, next()?, next()?, next()?);
            (parts.next().is_none() && begin < end).then_some(Unit {
                frame,
                tile,
                samples: SampleRange { begin, end },
            })
        };
        parse().ok_or_else(|| UnitNameError(text.chars().take(64).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_end_where_the_design_says() {
        let mut borders = vec![];
        let mut at = 0;
        while at < 2048 {
            at = pass_end(at);
            borders.push(at);
        }
        assert_eq!(
            borders,
            [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 1536, 2048]
        );
        assert_eq!(pass_end(300), 512);
        assert_eq!(pass_end(513), 1024);
        assert_eq!(pass_end(u32::MAX), u32::MAX);
    }

    #[test]
    fn tiles_cover_the_picture_once() {
        let grid = TileGrid {
            width: 130,
            height: 65,
        };
        let area: usize = (0..grid.count()).map(|i| grid.tile(i).pixels()).sum();
        assert_eq!((grid.count(), area), (6, 130 * 65));
    }

    #[test]
    fn unit_names_round_trip() {
        let unit = Unit {
            frame: 3,
            tile: 17,
            samples: SampleRange { begin: 8, end: 16 },
        };
        assert_eq!(unit.to_string().parse(), Ok(unit));
        for bad in [
            "",
            "1-2-3",
            "1-2-3-4-5",
            "1-2-4-4",
            "a-b-c-d",
            "1-2-5-4",
            "-1-2-3-4",
        ] {
            assert!(bad.parse::<Unit>().is_err(), "{bad}");
        }
    }
}
