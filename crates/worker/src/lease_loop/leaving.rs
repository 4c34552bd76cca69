//! Leaving in order: finish what fits into the grace time, give back the rest.

use super::{Call, GOODBYE, LeaseLoop, QUIET};
use crate::held::Phase;
use protocol::SyncRequest;
use tokio::time::Instant;

impl LeaseLoop {
    pub(super) fn begin_leaving(&mut self) {
        tracing::info!(
            in_work = self.held.count(Phase::InPool),
            grace_seconds = self.config.grace.as_secs_f64(),
            "leaving: finishing what is in work"
        );
        self.leaving = Some(Instant::now() + self.config.grace);
        self.give_back_unstarted();
    }

    /// Nothing is left to finish, or the time for it is over.
    pub(super) fn may_leave(&self) -> bool {
        let Some(deadline) = self.leaving else {
            return false;
        };
        let settled = self.held.is_empty() && self.outbox.bytes() == 0;
        settled || Instant::now() > deadline + GOODBYE
    }

    pub(super) async fn say_goodbye(&mut self) {
        let lost = self.held.in_phase(Phase::Delivering).len();
        if lost > 0 {
            tracing::warn!(
                results = lost,
                "leaving with results that the coordinator did not take: they will be rendered again"
            );
        }
        let Some(registered) = self.registered.clone() else {
            return;
        };
        // Twice, because an open call may still have brought leases.
        for last in [false, true] {
            if last && self.open.values().all(|want| !want.is_some()) {
                break;
            }
            let request = SyncRequest {
                worker: registered.worker,
                held: Vec::new(),
                given_back: std::mem::take(&mut self.reports.given_back),
                failed: std::mem::take(&mut self.reports.failed),
                want: 0,
                want_samples: 0,
                wait_ms: 0,
                draining: true,
                prepared: std::mem::take(&mut self.reports.prepared),
            };
            match tokio::time::timeout(GOODBYE, self.client.sync(&request)).await {
                Ok(Ok(_)) => tracing::info!("left"),
                _ => {
                    tracing::info!("left without the coordinator knowing");
                    return;
                }
            }
            if !last {
                self.collect_late_leases().await;
            }
        }
    }

    /// Takes the answers that are on their way and gives back what they bring.
    pub(super) async fn collect_late_leases(&mut self) {
        // A call that is not answered by now is still waiting for work, and dropping it ends that.
        let deadline = Instant::now() + 4 * QUIET;
        while self.open.values().any(|want| want.is_some()) {
            match tokio::time::timeout_at(deadline, self.calls.join_next()).await {
                Ok(Some(Ok(Call::Synced { number, result, .. }))) => {
                    self.open.remove(&number);
                    let leases = result.map(|response| response.leases).unwrap_or_default();
                    self.reports
                        .given_back
                        .extend(leases.into_iter().map(|lease| lease.at));
                }
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return,
            }
        }
    }
}
