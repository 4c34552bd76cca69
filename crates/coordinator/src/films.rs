//! Films in memory: those in work, and a few finished ones that people look at.

use film::Film;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use uuid::Uuid;

/// Bytes of finished films that are kept for the next look.
const KEPT_BYTES: usize = 1 << 30;

/// A film that is read by many and changed by its owner alone.
pub type SharedFilm = Arc<RwLock<Film>>;

struct Kept {
    film: SharedFilm,
    /// Not to be dropped: it is in work, or nowhere else.
    pinned: bool,
    used: u64,
    bytes: usize,
}

/// A count of uses, and the films by job and frame.
type Clocked = (u64, HashMap<(Uuid, u32), Kept>);

/// Films by job and frame.
#[derive(Default)]
pub struct Films {
    films: Mutex<Clocked>,
}

impl Films {
    /// The film, if it is in memory.
    pub fn get(&self, job: Uuid, frame: u32) -> Option<SharedFilm> {
        let mut films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        films.0 += 1;
        let now = films.0;
        let kept = films.1.get_mut(&(job, frame))?;
        kept.used = now;
        Some(kept.film.clone())
    }

    /// Adds a film, or returns the one that is there already.
    pub fn insert(&self, job: Uuid, frame: u32, film: Film, pinned: bool) -> SharedFilm {
        let bytes = film.bytes();
        let mut films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        films.0 += 1;
        let used = films.0;
        let kept = films.1.entry((job, frame)).or_insert_with(|| Kept {
            film: Arc::new(RwLock::new(film)),
            pinned,
            used,
            bytes,
        });
        kept.pinned |= pinned;
        let film = kept.film.clone();
        evict(&mut films.1);
        film
    }

    /// The film, if it is in memory and in work or nowhere else.
    pub fn pinned(&self, job: Uuid, frame: u32) -> Option<SharedFilm> {
        let films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = films.1.get(&(job, frame)).filter(|k| k.pinned)?;
        Some(kept.film.clone())
    }

    /// Puts a film in work in the place of a copy that somebody looks at.
    pub fn replace(&self, job: Uuid, frame: u32, film: Film) -> SharedFilm {
        let mut films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        films.1.remove(&(job, frame));
        drop(films);
        self.insert(job, frame, film, true)
    }

    /// A finished film may be dropped from now on: it is in a checkpoint.
    pub fn unpin(&self, job: Uuid, frame: u32) {
        let mut films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = films.1.get_mut(&(job, frame)) {
            kept.pinned = false;
            kept.bytes = kept.film.read().map_or(0, |f| f.bytes());
        }
        evict(&mut films.1);
    }

    /// Forgets all films of a job.
    pub fn forget(&self, job: Uuid) {
        let mut films = self.films.lock().unwrap_or_else(PoisonError::into_inner);
        films.1.retain(|(j, _), _| *j != job);
    }
}

fn evict(films: &mut HashMap<(Uuid, u32), Kept>) {
    loop {
        let loose = || films.iter().filter(|(_, k)| !k.pinned);
        if loose().map(|(_, k)| k.bytes).sum::<usize>() <= KEPT_BYTES || loose().count() <= 1 {
            return;
        }
        let Some(oldest) = loose().min_by_key(|(_, k)| k.used).map(|(key, _)| *key) else {
            return;
        };
        films.remove(&oldest);
    }
}
