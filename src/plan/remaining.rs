//! What is left of a run, by the measured cost of its kind.
//!
//! Trackers differ in speed by a factor of a thousand, so that neither units nor frames say how long the rest takes. A
//! frame of a tracker is taken to cost what frames of the same search method and appearance model have cost so far; where
//! none has been tracked, what those of the search method have; else the mean of all.

use super::units::{Plan, Unit};
use std::collections::BTreeMap;

/// Frames that are done and left, and what those that are done have cost.
#[derive(Clone, Copy, Debug, Default)]
struct Account {
    done: f64,
    left: f64,
    seconds: f64,
}

impl Account {
    fn add(&mut self, other: &Account) {
        self.done += other.done;
        self.left += other.left;
        self.seconds += other.seconds;
    }

    /// Time of a frame, s; `None` before the first.
    fn rate(&self) -> Option<f64> {
        (self.done > 0.0).then(|| self.seconds / self.done)
    }
}

/// The cost of what is left of a run, as far as it is known.
#[derive(Clone, Debug, Default)]
pub struct Remaining {
    /// By tracker: its kind.
    kinds: Vec<usize>,
    /// By kind: its search method.
    methods: Vec<usize>,
    accounts: Vec<Account>,
}

impl Remaining {
    /// Before the first frame of the units `pending` of `plan`.
    pub fn new<'a>(plan: &Plan, pending: impl IntoIterator<Item = &'a Unit>) -> Remaining {
        let (mut kinds, mut methods) = (BTreeMap::new(), BTreeMap::new());
        let mut remaining = Remaining::default();
        for tracker in &plan.trackers {
            // A composite has no parts and is a kind of its own.
            let method = if tracker.sm.is_empty() {
                &tracker.id
            } else {
                &tracker.sm
            };
            let (next_kind, next_method) = (kinds.len(), methods.len());
            let method = *methods.entry(method).or_insert(next_method);
            let kind = *kinds.entry((method, &tracker.am)).or_insert(next_kind);
            if kind == next_kind {
                remaining.methods.push(method);
                remaining.accounts.push(Account::default());
            }
            remaining.kinds.push(kind);
        }
        for unit in pending {
            let kind = remaining.kinds[unit.tracker as usize];
            remaining.accounts[kind].left += plan.unit_frames(unit) as f64;
        }
        remaining
    }

    /// Tracker number `tracker` is done with `count` more frames, which took `seconds`.
    pub fn add(&mut self, tracker: u32, count: u64, seconds: f64) {
        let Some(&kind) = self.kinds.get(tracker as usize) else {
            return;
        };
        let account = &mut self.accounts[kind];
        account.done += count as f64;
        account.left = (account.left - count as f64).max(0.0);
        account.seconds += seconds;
    }

    /// Time that trackers have taken so far, s of one core.
    pub fn spent(&self) -> f64 {
        self.accounts.iter().map(|account| account.seconds).sum()
    }

    /// Time that the rest will take, s of one core; `None` before anything is done.
    pub fn left(&self) -> Option<f64> {
        let count = self.methods.iter().map(|m| m + 1).max().unwrap_or(0);
        let (mut of_methods, mut all) = (vec![Account::default(); count], Account::default());
        for (account, &method) in self.accounts.iter().zip(&self.methods) {
            of_methods[method].add(account);
            all.add(account);
        }
        let mean = all.rate().filter(|_| all.seconds > 0.0)?;
        let left = self.accounts.iter().zip(&self.methods).map(|(account, &method)| {
            let rate = account.rate().or(of_methods[method].rate()).unwrap_or(mean);
            account.left * rate
        });
        Some(left.sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_costs_what_its_kind_has_cost() {
        let tracker = |id: &str| {
            let mut parts = id.split('/');
            let mut part = || parts.next().unwrap_or_default();
            serde_json::json!({"id": id, "sm": part(), "am": part(), "ssm": part(), "ilm": "", "slug": id,
                "parameters": null})
        };
        let sequence = |name: &str| {
            serde_json::json!({"dataset": "d", "sequence": name, "frames": 100, "starts": [[0]],
                "fingerprint": ""})
        };
        let plan = serde_json::json!({
            "schema_version": 1, "tool": "t", "version": "1", "protocol": "ope", "seed": 0, "pre": "none",
            "frame_logs": "none",
            "trackers": [tracker("esm/ssd/affine"), tracker("esm/ssd/homography"), tracker("nn/ssd/affine"),
                tracker("nn/mi/affine"), tracker("pf/ssd/affine")],
            "sequences": [sequence("a"), sequence("b")],
        });
        let plan: Plan = serde_json::from_value(plan).unwrap();
        let pending: Vec<_> = plan.units().collect();
        let mut remaining = Remaining::new(&plan, &pending);
        assert_eq!(remaining.left(), None);
        // 200 frames of esm at 0.01 s (half of them), 100 of nn/ssd at 0.1 s (half of them).
        remaining.add(0, 200, 2.0);
        remaining.add(2, 100, 10.0);
        // Left: 200 of esm/ssd, 100 of nn/ssd, 200 of nn/mi as nn, 200 of pf at the mean of all, 0.04 s.
        assert!((remaining.left().unwrap() - (2.0 + 10.0 + 20.0 + 8.0)).abs() < 1e-9);
        // By units it would be 6/3; the dear ones done, little is left.
        remaining.add(2, 100, 10.0);
        remaining.add(3, 200, 20.0);
        remaining.add(4, 200, 100.0);
        assert!((remaining.left().unwrap() - 2.0).abs() < 1e-9);
        assert!((remaining.spent() - 142.0).abs() < 1e-9);
    }
}
