//! What of a frame is to be rendered next. Pure: no clock, no store, no randomness.
//!
//! Units are handed out pass by pass over all tiles, so that the whole picture gets better at once.
//! A tile offers one unit at a time: its lowest samples that are neither accepted nor leased, up to
//! its `limit`. With a noise target the limit is the next border at which the tile's merged state
//! decides; without one it is the stop itself, and all passes may be leased without waiting.

use film::convergence::{BORDER_MIN, is_border};
use film::unit::pass_end;
use film::{SampleRange, StopRule, Unit};
use std::collections::{BTreeMap, BTreeSet};
use uuid::Uuid;

/// Samples per pixel at which a job with nothing but a noise target or a time limit ends.
pub const OPEN_SPP_MAX: u32 = 65_536;

/// A unit whose bytes are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accepted {
    /// One past its last sample.
    pub end: u32,
    /// BLAKE3 of its bytes.
    pub digest: [u8; 32],
    /// Who rendered it.
    pub worker: Uuid,
}

/// How an arriving unit relates to what is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fit {
    /// It is missing and wanted.
    Wanted,
    /// Exactly this unit is there.
    Known(Accepted),
    /// Cut otherwise than what is there, or beyond the stop.
    Unwanted,
    /// No such frame, tile or range.
    Foreign,
}

#[derive(Clone, Debug, Default)]
struct TilePlan {
    accepted: BTreeMap<u32, Accepted>,
    leased: BTreeMap<u32, u32>,
    /// Everything below is accepted or leased.
    taken_below: u32,
    /// Everything below is merged.
    merged: u32,
    /// Wanted up to here.
    limit: u32,
    /// The limit is the end, not a border that decides.
    settled: bool,
    /// Counted as not complete.
    open: bool,
    ready: Option<SampleRange>,
}

impl TilePlan {
    fn complete(&self) -> bool {
        self.settled && self.merged >= self.limit
    }

    fn fit(&self, samples: SampleRange) -> Fit {
        let SampleRange { begin, end } = samples;
        if begin >= end || end > pass_end(begin) {
            return Fit::Foreign;
        }
        if let Some(known) = self.accepted.get(&begin)
            && known.end == end
        {
            return Fit::Known(*known);
        }
        // Accepted units do not overlap each other: the last one that begins before `end` decides.
        let before = self.accepted.range(..end).next_back();
        if before.is_some_and(|(_, a)| a.end > begin) || end > self.limit {
            return Fit::Unwanted;
        }
        Fit::Wanted
    }

    /// The lowest samples that nobody has, cut at the pass border, the limit and what comes after.
    fn gap(&mut self) -> Option<SampleRange> {
        let mut at = self.taken_below;
        loop {
            let accepted = self.accepted.get(&at).map(|a| a.end);
            match accepted.or_else(|| self.leased.get(&at).copied()) {
                Some(end) => at = end,
                None => break,
            }
        }
        self.taken_below = at;
        let after = |next: Option<u32>| next.unwrap_or(u32::MAX);
        let next = after(self.accepted.range(at..).next().map(|(b, _)| *b))
            .min(after(self.leased.range(at..).next().map(|(b, _)| *b)));
        let end = pass_end(at).min(self.limit).min(next);
        (at < end).then_some(SampleRange { begin: at, end })
    }
}

/// What of a frame is done, under way and left.
#[derive(Clone, Debug)]
pub struct FramePlan {
    frame: u32,
    goal: StopRule,
    tiles: Vec<TilePlan>,
    /// (begin, tile) of the unit that each tile offers.
    ready: BTreeSet<(u32, u32)>,
    /// Tiles that are not complete.
    open: u32,
}

impl FramePlan {
    /// Nothing done yet.
    pub fn new(frame: u32, tiles: u32, goal: StopRule) -> Self {
        let mut plan = FramePlan {
            frame,
            goal,
            tiles: vec![TilePlan::default(); tiles as usize],
            ready: BTreeSet::new(),
            open: 0,
        };
        for tile in 0..tiles {
            plan.restart_tile(tile);
        }
        plan
    }

    /// When it is done.
    pub fn goal(&self) -> &StopRule {
        &self.goal
    }
    /// Whether every tile is complete and merged.
    pub fn is_complete(&self) -> bool {
        self.open == 0
    }
    /// Whether a unit could be leased now.
    pub fn has_ready(&self) -> bool {
        !self.ready.is_empty()
    }
    /// First sample of the unit that is next.
    pub fn next_begin(&self) -> Option<u32> {
        self.ready.first().map(|(begin, _)| *begin)
    }

    /// The unit that is next.
    pub fn next_unit(&self) -> Option<Unit> {
        self.offer(self.ready.first()?.1)
    }

    /// Tiles that offer something, with the samples of a pixel up to their limit, those that are leased
    /// beyond the offer among them.
    pub fn left(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.ready.iter().filter_map(|(begin, tile)| {
            let limit = self.tiles.get(*tile as usize)?.limit;
            Some((*tile, limit.saturating_sub(*begin)))
        })
    }

    /// Whether a tile is complete, offers or has leased units.
    pub fn tile_state(&self, tile: u32) -> &'static str {
        match self.tiles.get(tile as usize) {
            Some(t) if t.settled && t.merged >= t.limit => "done",
            Some(t) if !t.leased.is_empty() => "leased",
            Some(t) if !t.accepted.is_empty() => "merged",
            _ => "queued",
        }
    }

    /// How far a tile is wanted, and whether that is its end.
    pub fn limit(&self, tile: u32) -> (u32, bool) {
        self.tiles
            .get(tile as usize)
            .map_or((0, true), |t| (t.limit, t.settled))
    }

    /// Leases the next unit for which `may` says yes. Looks at no more than a few refused units.
    pub fn lease(&mut self, may: impl Fn(&Unit) -> bool) -> Option<Unit> {
        const REFUSED_MAX: usize = 64;
        let (begin, tile) = *self
            .ready
            .iter()
            .take(REFUSED_MAX)
            .find(|(_, tile)| self.offer(*tile).is_some_and(|unit| may(&unit)))?;
        let unit = self.offer(tile)?;
        let plan = &mut self.tiles[tile as usize];
        plan.leased.insert(begin, unit.samples.end);
        self.refresh(tile);
        Some(unit)
    }

    fn offer(&self, tile: u32) -> Option<Unit> {
        let samples = self.tiles.get(tile as usize)?.ready?;
        Some(Unit {
            frame: self.frame,
            tile,
            samples,
        })
    }

    /// Notes a lease that is not new: a worker still holds it after the coordinator forgot it.
    pub fn adopt(&mut self, unit: &Unit) -> bool {
        let SampleRange { begin, end } = unit.samples;
        let Some(tile) = self.tiles.get_mut(unit.tile as usize) else {
            return false;
        };
        let free = tile.fit(unit.samples) == Fit::Wanted
            && tile.leased.iter().all(|(b, e)| *e <= begin || end <= *b);
        if free {
            tile.leased.insert(begin, end);
            self.refresh(unit.tile);
        }
        free
    }

    /// A lease ended without a result.
    pub fn release(&mut self, unit: &Unit) {
        if let Some(tile) = self.tiles.get_mut(unit.tile as usize)
            && tile.leased.get(&unit.samples.begin) == Some(&unit.samples.end)
        {
            tile.leased.remove(&unit.samples.begin);
            tile.taken_below = tile.taken_below.min(unit.samples.begin);
            self.refresh(unit.tile);
        }
    }

    /// How a unit relates to what is there.
    pub fn fit(&self, unit: &Unit) -> Fit {
        match self.tiles.get(unit.tile as usize) {
            Some(tile) if unit.frame == self.frame => tile.fit(unit.samples),
            _ => Fit::Foreign,
        }
    }

    /// A result was accepted: it will be merged. The caller has asked [`FramePlan::fit`].
    pub fn accept(&mut self, unit: &Unit, digest: [u8; 32], worker: Uuid) {
        let SampleRange { begin, end } = unit.samples;
        if let Some(tile) = self.tiles.get_mut(unit.tile as usize) {
            if tile.leased.get(&begin) == Some(&end) {
                tile.leased.remove(&begin);
            }
            tile.accepted.insert(
                begin,
                Accepted {
                    end,
                    digest,
                    worker,
                },
            );
            self.refresh(unit.tile);
        }
    }

    /// An accepted result turned out not to fit the film: it is missing again.
    pub fn reject(&mut self, unit: &Unit) {
        if let Some(tile) = self.tiles.get_mut(unit.tile as usize) {
            tile.accepted.remove(&unit.samples.begin);
            tile.taken_below = tile.taken_below.min(unit.samples.begin);
            self.refresh(unit.tile);
        }
    }

    /// The merged samples of a tile reach `spp` without a gap; its error then, where the film knows
    /// one. Decides about the next pass.
    pub fn merged(&mut self, index: u32, spp: u32, error: impl FnOnce() -> Option<f64>) {
        let cap = self.goal.cap(index);
        let Some(tile) = self.tiles.get_mut(index as usize) else {
            return;
        };
        tile.merged = spp;
        let mut error = Some(error);
        while !tile.settled && spp >= tile.limit {
            // A border that lies behind decided to go on, else nothing would be beyond it.
            let here = (spp == tile.limit).then(|| error.take()).flatten();
            let met = match (self.goal.noise, here.and_then(|error| error())) {
                (Some(target), Some(error)) => error <= target,
                _ => false,
            };
            if met || tile.limit >= cap {
                tile.settled = true;
            } else {
                tile.limit = pass_end(tile.limit).min(cap);
            }
        }
        self.refresh(index);
    }

    /// Forgets what a tile has: it is rendered again, and its passes are decided anew. Leases stay.
    pub fn clear_tile(&mut self, index: u32) {
        if let Some(tile) = self.tiles.get_mut(index as usize) {
            tile.accepted.clear();
            tile.taken_below = 0;
            tile.merged = 0;
            self.restart_tile(index);
        }
    }

    /// Another goal. Call [`FramePlan::merged`] for every tile after it.
    pub fn set_goal(&mut self, goal: StopRule) {
        self.goal = goal;
        for index in 0..self.tiles.len() as u32 {
            self.restart_tile(index);
        }
    }

    /// Ends the frame at whole units: what is accepted is the end, gaps below it and the first pass
    /// are still rendered. Returns the sample counts.
    pub fn stop_here(&mut self) -> Vec<u32> {
        let counts: Vec<u32> = self
            .tiles
            .iter()
            .zip(0..)
            .map(|(tile, index)| {
                let last = tile.accepted.values().next_back().map_or(0, |a| a.end);
                last.max(self.goal.cap(index).min(1))
            })
            .collect();
        self.set_goal(StopRule {
            spp: counts.iter().copied().max().unwrap_or(0),
            noise: None,
            samples: Some(counts.clone()),
        });
        for (index, spp) in self.merged_spp().into_iter().enumerate() {
            self.merged(index as u32, spp, || None);
        }
        counts
    }

    /// Merged samples without a gap, by tile.
    pub fn merged_spp(&self) -> Vec<u32> {
        self.tiles.iter().map(|t| t.merged).collect()
    }

    /// Leased units.
    pub fn leased(&self) -> impl Iterator<Item = Unit> + '_ {
        let frame = self.frame;
        self.tiles.iter().zip(0..).flat_map(move |(tile, index)| {
            tile.leased.iter().map(move |(begin, end)| Unit {
                frame,
                tile: index,
                samples: SampleRange {
                    begin: *begin,
                    end: *end,
                },
            })
        })
    }

    /// Units of tile `index` that a worker rendered.
    pub fn tiles_of(&self, worker: Uuid) -> Vec<u32> {
        self.tiles
            .iter()
            .zip(0..)
            .filter(|(tile, _)| tile.accepted.values().any(|a| a.worker == worker))
            .map(|(_, index)| index)
            .collect()
    }

    /// Accepted units of a tile.
    pub fn accepted(&self, index: u32) -> Vec<Unit> {
        let frame = self.frame;
        self.tiles.get(index as usize).map_or(Vec::new(), |tile| {
            tile.accepted
                .iter()
                .map(|(begin, a)| Unit {
                    frame,
                    tile: index,
                    samples: SampleRange {
                        begin: *begin,
                        end: a.end,
                    },
                })
                .collect()
        })
    }

    /// Where a tile's limit begins.
    fn restart_tile(&mut self, index: u32) {
        let cap = self.goal.cap(index);
        let Some(tile) = self.tiles.get_mut(index as usize) else {
            return;
        };
        if self.goal.noise.is_none() {
            (tile.limit, tile.settled) = (cap, true);
        } else {
            // A tile at a border decides there, one inside a pass at its end.
            let border = match tile.merged {
                0..BORDER_MIN => BORDER_MIN,
                at if is_border(at) => at,
                at => pass_end(at),
            };
            (tile.limit, tile.settled) = (border.min(cap), false);
        }
        self.refresh(index);
    }

    /// Brings what is derived from a tile up to date: its offer, and the count of open tiles.
    fn refresh(&mut self, index: u32) {
        let Some(tile) = self.tiles.get_mut(index as usize) else {
            return;
        };
        let open = !tile.complete();
        match (tile.open, open) {
            (true, false) => self.open -= 1,
            (false, true) => self.open += 1,
            _ => {}
        }
        tile.open = open;
        let offer = tile.gap();
        if offer.map(|r| r.begin) != tile.ready.map(|r| r.begin) {
            if let Some(old) = tile.ready {
                self.ready.remove(&(old.begin, index));
            }
            if let Some(new) = offer {
                self.ready.insert((new.begin, index));
            }
        }
        tile.ready = offer;
    }
}

#[cfg(test)]
#[path = "plan_tests.rs"]
mod tests;
