//! The pictures of a scene under a budget of memory.
//!
//! Every picture is decoded once during preparation, so that a broken one is found there. If all fit
//! into the budget they stay and their files are let go. If not, the files stay and the pictures used
//! longest ago are dropped and decoded again when they are looked up: that costs time and never a bit.
//! The budget may be exceeded by what the samples in work hold, and by pictures that must stay.

use super::decode::{self, Raw};
use super::image::Image;
use crate::{PrepareError, StopFlag};
use rayon::prelude::*;
use scene::AssetSource;
use scene::assets::AssetBytes;
use scene::model::{Encoding, ImageDesc};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a scene wants of one of its pictures.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wanted {
    /// Looked up over an area: it needs a pyramid.
    pub filtered: bool,
    /// Looked up where nobody can wait for it: it stays whatever the budget.
    pub stays: bool,
    /// Its mean luminance is asked for.
    pub mean: bool,
}

/// What is known of a picture even while it is not there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PictureFacts {
    /// No pixel is transparent.
    pub opaque: bool,
    /// Mean luminance, 0 where nobody asked.
    pub mean: f64,
}

impl PictureFacts {
    pub fn of(image: &Image, mean: bool) -> PictureFacts {
        PictureFacts {
            opaque: image.is_opaque(),
            mean: if mean { image.mean_luminance() } else { 0.0 },
        }
    }
}

/// All pictures of a scene, those with the same bytes and use once.
#[derive(Default)]
pub(crate) struct Pool {
    budget_bytes: u64,
    files: Vec<File>,
    pictures: Vec<Picture>,
    /// Which picture an image of the scene is.
    of: Vec<usize>,
    /// Nothing was dropped and nothing will be.
    complete: bool,
    state: Mutex<State>,
    /// Pictures dropped so far.
    dropped: AtomicU64,
}

/// A file that pictures are decoded from.
struct File {
    /// For messages, and for the decoder where the content leaves its kind open.
    path: String,
    /// As it is; none once all pictures are there to stay.
    bytes: Option<AssetBytes>,
    /// Its pictures.
    pictures: Vec<usize>,
    /// Held while it is decoded, so that others wait instead of doing the same.
    turn: Mutex<()>,
}

/// One way to read a file.
struct Picture {
    /// None for the stand-in of what is missing.
    file: Option<usize>,
    encoding: Encoding,
    wanted: Wanted,
}

#[derive(Default)]
struct State {
    /// By picture.
    held: Vec<Held>,
    /// Sum over what is held; pixels that two pictures share count for both.
    bytes: u64,
    /// Counts uses.
    clock: u64,
}

#[derive(Default)]
struct Held {
    image: Option<Image>,
    bytes: u64,
    used: u64,
}

/// No code that can panic runs under these locks, so a poisoned state is still a good one.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn size_bytes(image: &Image) -> u64 {
    image.parts().iter().map(|(_, bytes)| *bytes as u64).sum()
}

impl Pool {
    /// A pool of pictures that are there to stay.
    pub fn of_images(images: Vec<Image>) -> Pool {
        let held = |image: Image| Held {
            bytes: size_bytes(&image),
            image: Some(image),
            used: 0,
        };
        Pool {
            of: (0..images.len()).collect(),
            complete: true,
            state: Mutex::new(State {
                bytes: images.iter().map(size_bytes).sum(),
                held: images.into_iter().map(held).collect(),
                clock: 0,
            }),
            ..Pool::default()
        }
    }

    /// Reads and decodes the pictures of a scene, spread over threads by whole files. `wanted` has an
    /// entry for each of `described`. Also returns what is known of each.
    pub fn load(
        described: &[ImageDesc],
        wanted: &[Wanted],
        budget_bytes: u64,
        assets: &dyn AssetSource,
        stop: &StopFlag,
    ) -> Result<(Pool, Vec<PictureFacts>), PrepareError> {
        let files: Vec<Option<(AssetBytes, [u8; 32])>> = described
            .par_iter()
            .map(|desc| {
                if desc.missing {
                    return Ok(None);
                }
                if stop.is_stopped() {
                    return Err(PrepareError::Stopped);
                }
                let bytes = match &desc.bytes {
                    Some(inside) => inside.clone(),
                    None => assets.read(&desc.path)?,
                };
                // The name matters to the decoder only where the content has no mark of its own.
                let mut hash = blake3::Hasher::new();
                hash.update(&bytes);
                hash.update(decode::ending(&desc.path).as_bytes());
                Ok(Some((bytes, *hash.finalize().as_bytes())))
            })
            .collect::<Result<_, PrepareError>>()?;
        let mut pool = Pool {
            budget_bytes,
            ..Pool::default()
        };
        pool.sort_out(described, wanted, files);
        let pool_ref = &pool;
        let known: Vec<Vec<(usize, PictureFacts)>> = pool
            .files
            .par_iter()
            .map(|file| {
                if stop.is_stopped() {
                    return Err(PrepareError::Stopped);
                }
                let failed = |reason| PrepareError::Decode {
                    path: file.path.clone(),
                    reason,
                };
                let raw = file.decode().map_err(failed)?;
                let one = |&i: &usize| {
                    let picture = &pool_ref.pictures[i];
                    let image = picture.image(raw.clone());
                    let facts = PictureFacts::of(&image, picture.wanted.mean);
                    pool_ref.insert(i, image);
                    (i, facts)
                };
                Ok(file.pictures.iter().map(one).collect())
            })
            .collect::<Result<_, PrepareError>>()?;
        let stand_in = PictureFacts::of(&Image::stand_in(), true);
        let mut facts = vec![stand_in; pool.pictures.len()];
        for (i, of_picture) in known.into_iter().flatten() {
            facts[i] = of_picture;
        }
        let facts = pool.of.iter().map(|i| facts[*i]).collect();
        if pool.dropped() == 0 {
            pool.complete = true;
            for file in &mut pool.files {
                file.bytes = None;
            }
        }
        Ok((pool, facts))
    }

    /// Finds out which images are the same picture, and which pictures come from the same file.
    fn sort_out(
        &mut self,
        described: &[ImageDesc],
        wanted: &[Wanted],
        files: Vec<Option<(AssetBytes, [u8; 32])>>,
    ) {
        let mut known_files: BTreeMap<[u8; 32], usize> = BTreeMap::new();
        let mut known: BTreeMap<(Option<usize>, u64, bool), usize> = BTreeMap::new();
        for ((desc, wanted), file) in described.iter().zip(wanted).zip(files) {
            let file = file.map(|(bytes, hash)| {
                *known_files.entry(hash).or_insert_with(|| {
                    self.files.push(File {
                        path: desc.path.clone(),
                        bytes: Some(bytes),
                        pictures: vec![],
                        turn: Mutex::new(()),
                    });
                    self.files.len() - 1
                })
            });
            let encoding = match desc.encoding {
                Encoding::Auto => 0,
                Encoding::Srgb => 1,
                Encoding::Linear => 2,
                Encoding::GammaMicros(micros) => 3 + u64::from(micros),
            };
            let key = (file, encoding, wanted.filtered);
            let i = *known.entry(key).or_insert_with(|| {
                self.pictures.push(Picture {
                    file,
                    encoding: desc.encoding,
                    wanted: Wanted {
                        filtered: wanted.filtered,
                        ..Wanted::default()
                    },
                });
                let i = self.pictures.len() - 1;
                if let Some(file) = file {
                    self.files[file].pictures.push(i);
                }
                i
            });
            let all = &mut self.pictures[i].wanted;
            all.stays |= wanted.stays;
            all.mean |= wanted.mean;
            self.of.push(i);
        }
        lock(&self.state)
            .held
            .resize_with(self.pictures.len(), Held::default);
    }

    /// The picture of an image, decoded if it is not there.
    #[cold]
    pub fn get(&self, image: usize) -> Image {
        let i = self.of[image];
        if let Some(found) = self.resident(i) {
            return found;
        }
        let picture = &self.pictures[i];
        let Some(file) = picture.file.map(|f| &self.files[f]) else {
            return Image::stand_in();
        };
        let _turn = lock(&file.turn);
        if let Some(found) = self.resident(i) {
            return found;
        }
        let shared = {
            let state = lock(&self.state);
            let of_file = file.pictures.iter();
            let mut others = of_file.filter_map(|j| state.held[*j].image.as_ref());
            others.find_map(Image::raw_as_decoded)
        };
        let raw = match shared {
            Some(raw) => raw,
            None => match file.decode() {
                Ok(raw) => raw,
                // The same bytes were decoded before. If a decoder fails all the same (for want of
                // memory, say), samples must be rejected, not wrong.
                Err(_) => return Image::not_a_number(),
            },
        };
        let image = picture.image(raw);
        self.insert(i, image.clone());
        image
    }

    fn resident(&self, i: usize) -> Option<Image> {
        let mut state = lock(&self.state);
        state.clock += 1;
        let now = state.clock;
        let held = &mut state.held[i];
        held.used = now;
        held.image.clone()
    }

    /// Keeps a picture and drops others, those used longest ago first, until the budget holds.
    fn insert(&self, i: usize, image: Image) {
        let bytes = size_bytes(&image);
        let mut state = lock(&self.state);
        state.clock += 1;
        let used = state.clock;
        state.bytes += bytes;
        state.held[i] = Held {
            image: Some(image),
            bytes,
            used,
        };
        while state.bytes > self.budget_bytes {
            let may_go = |(j, held): &(usize, &Held)| {
                held.image.is_some() && *j != i && !self.pictures[*j].wanted.stays
            };
            // The clock makes all ages different.
            let oldest = (state.held.iter().enumerate())
                .filter(may_go)
                .min_by_key(|(_, held)| held.used);
            let Some((j, _)) = oldest else { break };
            state.held[j].image = None;
            state.bytes -= state.held[j].bytes;
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Whether all pictures are there to stay.
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// How many pictures have been dropped so far.
    #[inline]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Memory held: pictures, those that share their pixels counted once, and files that are kept.
    pub fn memory_bytes(&self) -> usize {
        let mut seen: BTreeMap<usize, usize> = BTreeMap::new();
        for image in lock(&self.state)
            .held
            .iter()
            .filter_map(|h| h.image.as_ref())
        {
            seen.extend(image.parts());
        }
        let files = self.files.iter().filter_map(|f| f.bytes.as_ref());
        seen.values().sum::<usize>() + files.map(|bytes| bytes.len()).sum::<usize>()
    }
}

impl File {
    fn decode(&self) -> Result<Arc<Raw>, String> {
        let bytes = self.bytes.as_deref().unwrap_or(&[]);
        decode::decode(&self.path, bytes).map(Arc::new)
    }
}

impl Picture {
    fn image(&self, raw: Arc<Raw>) -> Image {
        let image = Image::new(raw, self.encoding);
        if self.wanted.filtered {
            image.with_pyramid()
        } else {
            image
        }
    }
}
