//! What a crash leaves behind: every cut of the tail, holes in it, damage in the middle.

use super::*;
use bytes::Bytes;
use film::SampleRange;
use futures::executor::block_on;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        Place {
            folder: tempfile::tempdir().unwrap(),
        }
    }
    fn open(&self, options: Options) -> Result<crate::Stores, StoreError> {
        crate::embedded::open(self.folder.path(), options)
    }
    fn segments(&self) -> Vec<PathBuf> {
        let mut paths: Vec<PathBuf> = std::fs::read_dir(self.folder.path().join("log"))
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect();
        paths.sort();
        paths
    }
}

fn entry(job: Uuid, tile: u32) -> LogEntry {
    let bytes = Bytes::from(vec![tile as u8; 100 + tile as usize]);
    LogEntry {
        job,
        unit: Unit {
            frame: 0,
            tile,
            samples: SampleRange { begin: 0, end: 1 },
        },
        digest: *blake3::hash(&bytes).as_bytes(),
        worker: Uuid::from_u128(7),
        bytes,
    }
}

fn tiles(stores: &crate::Stores, job: Uuid) -> Vec<u32> {
    let mut tiles = Vec::new();
    stores
        .log
        .read(job, 0, &mut |_, e| {
            assert_eq!(e, entry(job, e.unit.tile));
            tiles.push(e.unit.tile);
            Ok(())
        })
        .unwrap();
    tiles
}

#[test]
fn torn_log_tail() {
    let place = Place::new();
    let job = Uuid::from_u128(1);
    let stores = place.open(Options::default()).unwrap();
    let mut ends = vec![SEGMENT_HEAD];
    for tile in 0..4 {
        block_on(stores.log.append(entry(job, tile))).unwrap();
        ends.push(stores.log.end() + SEGMENT_HEAD);
    }
    drop(stores);
    let path = place.segments().remove(0);
    let whole = std::fs::read(&path).unwrap();
    assert_eq!(whole.len() as u64, ends[4]);
    // Every place is much the same; a stride that shares no factor with a frame meets all kinds.
    for cut in (0..=whole.len()).rev().step_by(7) {
        std::fs::write(&path, &whole[..cut]).unwrap();
        let stores = place.open(Options::default()).unwrap();
        let kept = ends.iter().filter(|e| **e <= cut as u64).count();
        let kept = kept.saturating_sub(1) as u32;
        assert_eq!(
            tiles(&stores, job),
            (0..kept).collect::<Vec<_>>(),
            "cut at {cut}"
        );
        drop(stores);
    }
    // After a cut the log goes on where the cut is.
    std::fs::write(&path, &whole[..whole.len() - 3]).unwrap();
    let stores = place.open(Options::default()).unwrap();
    assert!(matches!(
        block_on(stores.log.append(entry(job, 3))),
        Ok(Appended::New(_))
    ));
    assert!(matches!(
        block_on(stores.log.append(entry(job, 3))),
        Ok(Appended::Same(_))
    ));
    drop(stores);
    assert_eq!(
        tiles(&place.open(Options::default()).unwrap(), job),
        [0, 1, 2, 3]
    );
}

#[test]
fn damage_in_the_middle_stops_loudly() {
    let place = Place::new();
    let job = Uuid::from_u128(1);
    let stores = place.open(Options::default()).unwrap();
    for tile in 0..4 {
        // One sync each: every later frame says that the earlier ones were on disk.
        block_on(stores.log.append(entry(job, tile))).unwrap();
    }
    drop(stores);
    let path = place.segments().remove(0);
    let whole = std::fs::read(&path).unwrap();
    for at in [SEGMENT_HEAD as usize + 5, SEGMENT_HEAD as usize + 150, 300] {
        let mut bad = whole.clone();
        bad[at] ^= 1;
        std::fs::write(&path, &bad).unwrap();
        let error = place.open(Options::default()).map(|_| ()).unwrap_err();
        assert!(matches!(error, StoreError::Damaged { .. }), "{at}: {error}");
    }
    // A flipped bit in the last frame cannot be told from a torn write; nothing claims it.
    let mut bad = whole.clone();
    *bad.last_mut().unwrap() ^= 1;
    std::fs::write(&path, &bad).unwrap();
    assert_eq!(
        tiles(&place.open(Options::default()).unwrap(), job),
        [0, 1, 2]
    );
}

#[test]
fn writes_of_one_group_may_reach_the_disk_in_any_order() {
    let place = Place::new();
    let job = Uuid::from_u128(1);
    let stores = place.open(Options::default()).unwrap();
    block_on(stores.log.append(entry(job, 0))).unwrap();
    let synced = stores.log.end();
    drop(stores);
    // Three frames of one group, none synced: the first is lost, the others made it.
    let path = place.segments().remove(0);
    let mut bytes = std::fs::read(&path).unwrap();
    let hole = entry(job, 1);
    bytes.resize(bytes.len() + segment::frame_len(&hole) as usize, 0);
    for tile in [2, 3] {
        let e = entry(job, tile);
        bytes.extend(segment::frame_head(&e, synced));
        bytes.extend_from_slice(&e.bytes);
    }
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(tiles(&place.open(Options::default()).unwrap(), job), [0]);
}

#[test]
fn trimming_frees_segments_and_keeps_positions_rising() {
    let place = Place::new();
    let options = Options {
        segment_bytes: 500,
        ..Options::default()
    };
    let (a, b) = (Uuid::from_u128(1), Uuid::from_u128(2));
    let stores = place.open(options).unwrap();
    for tile in 0..20 {
        block_on(stores.log.append(entry(a, tile))).unwrap();
        block_on(stores.log.append(entry(b, tile))).unwrap();
    }
    let many = place.segments().len();
    let end = stores.log.end();
    stores.log.trim(a, end).unwrap();
    assert_eq!(place.segments().len(), many, "b still needs them");
    stores.log.purge(b).unwrap();
    assert_eq!(place.segments().len(), 1);
    drop(stores);
    let stores = place.open(options).unwrap();
    assert_eq!(stores.log.end(), end);
    block_on(stores.log.append(entry(a, 99))).unwrap();
    assert!(stores.log.end() > end);
}

#[test]
fn a_full_log_refuses_and_recovers() {
    let place = Place::new();
    let options = Options {
        segment_bytes: 300,
        log_bytes_max: 2000,
    };
    let job = Uuid::from_u128(1);
    let stores = place.open(options).unwrap();
    let mut tile = 0;
    let error = loop {
        match block_on(stores.log.append(entry(job, tile))) {
            Ok(_) => tile += 1,
            Err(e) => break e,
        }
    };
    assert!(matches!(error, StoreError::Full { .. }) && error.retryable());
    assert_eq!(tiles(&stores, job).len() as u32, tile);
    stores.log.purge(job).unwrap();
    block_on(stores.log.append(entry(job, 0))).unwrap();
}
