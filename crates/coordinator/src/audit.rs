//! Two results of one unit that differ: one of two machines is wrong, and nobody knows which. A
//! third worker renders the unit again; whoever disagrees with two equal results is quarantined,
//! and what it touched is rendered again.

use crate::control;
use crate::farm::Farm;
use crate::job::{Audit, Job};
use crate::owner::Order;
use crate::plan::Accepted;
use crate::record::Void;
use crate::results::Delivery;
use film::Unit;
use protocol::TimestampMs;
use std::collections::BTreeMap;
use std::sync::Arc;
use uuid::Uuid;

/// How a result compares with what is known of its unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Compared {
    /// The same bytes.
    Same,
    /// The same bytes, and these workers are convicted by it.
    SameAndGuilty(Vec<Uuid>),
    /// Other bytes; nobody knows yet.
    Other,
    /// Other bytes than the film has, and these workers are convicted.
    OtherAndGuilty(Vec<Uuid>),
}

/// Compares a result with the accepted one of its unit.
pub fn compare(job: &mut Job, delivery: &Delivery, known: &Accepted, now: TimestampMs) -> Compared {
    let unit = delivery.unit;
    let same = known.digest == delivery.digest;
    if same && !job.audits.contains_key(&unit) {
        return Compared::Same;
    }
    let audit = job.audits.entry(unit).or_insert_with(|| {
        tracing::error!(job.id = %delivery.job, unit.id = %unit, worker.id = %delivery.worker, other = %known.worker, "two results of one unit differ");
        Audit {
            claims: vec![(known.digest, known.worker)],
            since: now,
            leased: None,
        }
    });
    if audit.leased.is_some_and(|l| l.worker == delivery.worker) {
        audit.leased = None;
    }
    let claim = (delivery.digest, delivery.worker);
    if !audit.claims.contains(&claim) {
        audit.claims.push(claim);
    }
    let mut voices: BTreeMap<[u8; 32], std::collections::BTreeSet<Uuid>> = BTreeMap::new();
    for (digest, worker) in &audit.claims {
        voices.entry(*digest).or_default().insert(*worker);
    }
    // A worker that disagrees with itself is no witness for either.
    let right = voices.iter().find(|(digest, workers)| {
        let honest = |w: &&Uuid| !voices.iter().any(|(d, ws)| d != *digest && ws.contains(w));
        workers.iter().filter(honest).count() >= 2
    });
    let Some((right, _)) = right else {
        let text = format!("unit {unit}: two results differ; a third worker renders it again");
        job.note(now, "error", text, None, Some(delivery.worker));
        return if same {
            Compared::Same
        } else {
            Compared::Other
        };
    };
    let right = *right;
    let guilty: Vec<Uuid> = audit
        .claims
        .iter()
        .filter(|(d, _)| *d != right)
        .map(|(_, w)| *w)
        .collect();
    // The audit stays open, and holds the job, until the guilty are taken out.
    job.note(
        now,
        "info",
        format!("unit {unit}: the audit is settled"),
        None,
        None,
    );
    if same {
        Compared::SameAndGuilty(guilty)
    } else {
        Compared::OtherAndGuilty(guilty)
    }
}

/// Ends an audit: quarantines the guilty without making the caller wait.
pub fn conclude_later(farm: &Arc<Farm>, id: Uuid, unit: Unit, guilty: Vec<Uuid>) {
    let farm = farm.clone();
    // Under the caller's lock nothing may be done to other jobs: a task of its own does.
    farm.clone().tasks.spawn(async move {
        for worker in guilty {
            quarantine(
                &farm,
                worker,
                "its result differs from those of two other workers",
            );
        }
        if let Some(job) = farm.state().jobs.get_mut(&id) {
            job.audits.remove(&unit);
            if let Err(error) = farm.order(job, Order::Review) {
                tracing::error!(job.id = %id, %error, "no owner");
            }
        }
    });
}

/// Takes a worker out: no more leases, no more results, and the tiles that it touched in
/// unfinished jobs are rendered again.
pub fn quarantine(farm: &Arc<Farm>, id: Uuid, why: &str) {
    let now = farm.clock.now();
    let mut touched = Vec::new();
    {
        let mut state = farm.state();
        let state = &mut *state;
        // One that is long gone, or in quarantine already, may still have touched what was taken up
        // again since.
        if let Some(worker) = state.workers.get_mut(&id)
            && worker.quarantined.is_none()
        {
            worker.quarantined = Some(why.to_owned());
            worker.held.clear();
            tracing::error!(worker.id = %id, reason = why, "a worker is quarantined");
        }
        for (job_id, job) in &mut state.jobs {
            if job.record.state.is_final() {
                continue;
            }
            let held: Vec<_> = job
                .leases
                .iter()
                .filter(|(_, l)| l.worker == id)
                .map(|(u, l)| (*u, l.attempt))
                .collect();
            for (unit, attempt) in held {
                let at = protocol::LeaseRef {
                    job: *job_id,
                    unit,
                    attempt,
                };
                job.end_lease(&at, id, now);
            }
            for audit in job.audits.values_mut() {
                if audit.leased.is_some_and(|l| l.worker == id) {
                    audit.leased = None;
                }
            }
            if clear_touched(farm, job, id, now) {
                touched.push(*job_id);
            }
        }
    }
    farm.wake.notify_waiters();
    farm.save_worker_later(id);
    for job in touched {
        control::save_later(farm, job);
        farm.tell_job(job);
    }
}

/// Has the tiles rendered again that hold results of a worker.
pub fn clear_touched(farm: &Arc<Farm>, job: &mut Job, worker: Uuid, now: TimestampMs) -> bool {
    let before = farm.stores.log.end();
    let frames: Vec<u32> = job.plans.keys().copied().collect();
    let mut count = 0;
    for frame in frames {
        let Some(plan) = job.plans.get_mut(&frame) else {
            continue;
        };
        let tiles = plan.tiles_of(worker);
        if tiles.is_empty() {
            continue;
        }
        count += tiles.len();
        for tile in &tiles {
            for unit in plan.accepted(*tile) {
                farm.stores.log.forget(job.record.id, unit);
                job.audits.remove(&unit);
            }
            plan.clear_tile(*tile);
        }
        let about = job.record.begun.entry(frame).or_default();
        about.voids.extend(tiles.iter().map(|tile| Void {
            tile: *tile,
            before,
        }));
        job.clearing.push(before);
        let order = Order::Clear {
            frame,
            tiles,
            before,
        };
        if let Err(error) = farm.order(job, order) {
            tracing::error!(job.id = %job.record.id, %error, "no owner");
        }
    }
    if count > 0 {
        let text = format!("worker {worker} is not trusted: {count} tiles are rendered again");
        job.note(now, "warn", text, None, Some(worker));
    }
    count > 0
}
