//! When a tile is done. Pure: from the merged state of one tile to its next unit, or to a stop.
//!
//! With a noise target a tile stops at its first pass border from 16 samples on at which its own
//! error is at most the target. The decision knows neither other tiles nor earlier borders, and a
//! film holds only the current sums, so it is made in sequence: ask again after each merged unit,
//! and give out no unit past a border at which the answer could be a stop.
//!
//! *Extension*: a tile that stopped under a looser target was above the tighter one at all earlier
//! borders too, since its error there was above even the looser target. Going on from where it
//! stands is therefore what a straight run does. The other way round is not: a looser target might
//! have stopped earlier, and samples are never taken back. Loosening a stop is refused where it is
//! asked for ([`StopRule::extends`]).

use crate::tile::TileFilm;
use crate::unit::{SampleRange, pass_end};
use serde::{Deserialize, Serialize};

/// Fewest samples at which a noise target can stop a tile: fewer say too little about their error.
pub const BORDER_MIN: u32 = 16;

/// When to stop; whichever comes first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopRule {
    /// Most samples of a pixel.
    pub spp: u32,
    /// Error of a tile at which it stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<f64>,
    /// Most samples by tile: gives the picture of a job that a time limit ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<u32>>,
}

impl StopRule {
    /// Stops at so many samples.
    pub fn at_spp(spp: u32) -> StopRule {
        StopRule {
            spp,
            noise: None,
            samples: None,
        }
    }

    /// Most samples of a tile.
    pub fn cap(&self, tile: u32) -> u32 {
        match &self.samples {
            None => self.spp,
            Some(counts) => counts
                .get(tile as usize)
                .copied()
                .unwrap_or(0)
                .min(self.spp),
        }
    }

    /// Whether every tile that this rule asks for goes at least as far as under `old`.
    pub fn extends(&self, old: &StopRule, tiles: u32) -> bool {
        let tighter = match (self.noise, old.noise) {
            (None, _) => true,
            (Some(_), None) => false,
            (Some(new), Some(old)) => new <= old,
        };
        tighter && (0..tiles).all(|tile| self.cap(tile) >= old.cap(tile))
    }
}

/// What a tile needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// These samples.
    Unit(SampleRange),
    /// Nothing more.
    Done {
        /// False if there is a noise target and the tile ran out of samples above it.
        target_met: bool,
    },
}

/// The next unit of tile `index`, or that it is done.
pub fn next_unit(tile: &TileFilm, index: u32, rule: &StopRule) -> Next {
    let (spp, cap) = (tile.spp(), rule.cap(index));
    // Ahead of a gap nothing can be decided: the sums hold more than the border does.
    let gap = tile.samples() > spp;
    let target_met = || {
        rule.noise
            .is_none_or(|target| spp >= BORDER_MIN && below(tile, target))
    };
    let stops = spp >= cap || (rule.noise.is_some() && !gap && is_border(spp) && target_met());
    if stops {
        return Next::Done {
            target_met: target_met(),
        };
    }
    let missing = tile.missing(cap.min(pass_end(spp)));
    match missing.first() {
        Some(&range) => Next::Unit(range),
        None => Next::Done {
            target_met: target_met(),
        },
    }
}

/// Whether a pass ends there.
pub fn is_border(spp: u32) -> bool {
    spp > 0 && pass_end(spp - 1) == spp
}

/// Whether the error of a tile is at most the target. A tile whose error is not known is not.
fn below(tile: &TileFilm, target: f64) -> bool {
    tile.error().is_some_and(|error| error <= target)
}
