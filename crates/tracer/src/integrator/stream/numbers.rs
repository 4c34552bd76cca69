//! Numbers of an event for all paths.

use super::paths::{self, Group, Paths, Place};
use super::{Wave, draw_one, entry};
use crate::lanes::{Int, Row, Wide};
use crate::sampler;
use scene::model::SamplerKind;

/// Draws the numbers of some paths for this wave's event.
pub(super) fn draw(wave: &Wave, paths: &mut Paths, places: &[Place]) {
    if wave.scene.sampler == SamplerKind::Lattice {
        entry::lattice(wave.scene.geometry.level, wave, paths, places);
        return;
    }
    for place in places {
        draw_one(wave, paths, *place);
    }
}

/// [`draw`] in lanes, for points of the lattice.
#[inline(always)]
pub(super) fn lattice<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    let dimension = sampler::dimension_of(wave.event);
    paths.make_keys(dimension, places.len());
    for places in places.chunks(N) {
        let group = Group::new(places);
        let mut shifts = [Row::ZERO; N];
        let mut orders = [0; N];
        let mut reversed = [0; N];
        for lane in 0..N {
            let slot = group.slots[lane];
            let keys = paths.keys(slot, dimension);
            shifts[lane] = Row(bytemuck::cast(keys.shift));
            orders[lane] = keys.order;
            reversed[lane] = paths.reversed[slot as usize];
        }
        let shifts = W::turn(&shifts);
        let numbers = sampler::event_in_lanes::<W, N>(
            W::I::load(&reversed),
            W::I::load(&orders),
            shifts,
            wave.event,
        );
        paths::scatter::<W, N>(&mut paths.numbers, &group.slots, numbers);
    }
}
