//! Search methods: known motion is recovered, standing still is no motion, failures are typed and leave the tracker usable.

use super::scene::{GRID, QUAD, Scene, distance, rng, uniform};
use super::{Checks, Report, boxed};
use crate::geom::Corners;
use crate::registry::{Registry, SpecError};
use crate::sm::SmEntry;
use crate::ssm::SsmEntry;
use crate::tracker::{Stop, TrackError, Tracker};
use rand::RngExt;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Methods that approach so slowly that they are not asked to arrive: steepest ascent.
const SLOW: [&str; 1] = ["fcsd"];

/// What is asked of a method by its group, where it has these parameters: enough iterations for what follows gradients;
/// small but able, for what samples.
const PATIENT: &[(&str, &str)] = &[("max_iters", "60"), ("epsilon", "1e-9")];
const SMALL: &[(&str, &str)] = &[
    ("n_samples", "600"),
    ("n_particles", "250"),
    ("res", "30"),
    ("max_iters", "8"),
];

/// The model that warps are tracked with, and the warp that models are tracked with.
const COMPANY: [&str; 2] = ["ncc", "homography"];

/// Checks one search method with every appearance model (and a homography) and with every warp (and NCC) that it does not
/// refuse.
///
/// Methods of the group `gradient` must end within 0.01 px of a random motion of 3 to 6 px, 0.02 px of one inside a warp's
/// family; others within 2 px, and 1 px of a translation, those with models that do not track alone within 10 px.
pub fn search(registry: &Registry, sm: &SmEntry) -> Report {
    let jobs = cases(registry, &Scenes::new(registry), sm, &|_| true);
    jobs.par_iter()
        .map(|job| job())
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

type Job<'a> = Box<dyn Fn() -> Report + Send + Sync + 'a>;

/// A job for each tracker with a part that is asked for.
pub(super) fn jobs<'a>(registry: &'a Registry, asked: &dyn Fn(&str) -> bool) -> Vec<Job<'a>> {
    let scenes = Scenes::new(registry);
    let sms = registry.sms().iter().filter(|sm| sm.listed());
    sms.flat_map(|sm| cases(registry, &scenes, sm, asked)).collect()
}

/// The frames that all trackers are shown, rendered when they are first asked for.
struct Scenes {
    still: OnceLock<Scene>,
    random: [OnceLock<Scene>; 4],
    /// What methods that sample are shown.
    sampled: OnceLock<Scene>,
    /// Translations, inside every family: for methods that follow gradients, for those that sample.
    shifted: [OnceLock<Scene>; 2],
    /// Motion inside the family of each warp of the registry.
    warps: Vec<OnceLock<Scene>>,
}

impl Scenes {
    fn new(registry: &Registry) -> Arc<Self> {
        Arc::new(Scenes {
            still: OnceLock::new(),
            random: Default::default(),
            sampled: OnceLock::new(),
            shifted: Default::default(),
            warps: registry.ssms().iter().map(|_| OnceLock::new()).collect(),
        })
    }

    fn still(&self) -> &Scene {
        self.still.get_or_init(|| Scene::new(6, QUAD))
    }

    fn sampled(&self) -> &Scene {
        self.sampled
            .get_or_init(|| Scene::new(2, Scene::corners_near(1, 3.0)))
    }

    fn shifted(&self, exact: bool) -> &Scene {
        let (seed, [dx, dy]) = if exact {
            (13, [1.7, -1.2])
        } else {
            (3, [2.6, -1.7])
        };
        self.shifted[usize::from(exact)].get_or_init(|| Scene::new(seed, QUAD.translated(dx, dy)))
    }

    fn random(&self, seed: usize) -> &Scene {
        self.random[seed].get_or_init(|| Scene::random(seed as u64, 3.0 + seed as f64))
    }
}

fn cases<'a>(
    registry: &'a Registry,
    scenes: &Arc<Scenes>,
    sm: &'a SmEntry,
    asked: &dyn Fn(&str) -> bool,
) -> Vec<Job<'a>> {
    let mut jobs: Vec<Job<'a>> = Vec::new();
    let [company, plane] = COMPANY;
    for am in registry.ams() {
        if asked(sm.name) || asked(am.name) {
            let scenes = Arc::clone(scenes);
            jobs.push(Box::new(move || {
                Case::new(registry, sm, am.name, plane).model(&scenes)
            }));
        }
    }
    for (i, ssm) in registry.ssms().iter().enumerate() {
        if asked(sm.name) || asked(ssm.name) {
            let scenes = Arc::clone(scenes);
            let job = move || Case::new(registry, sm, company, ssm.name).warp(ssm, &scenes.warps[i], &scenes);
            jobs.push(Box::new(job));
        }
    }
    if asked(sm.name) {
        jobs.push(Box::new(move || accepted(registry, sm)));
    }
    jobs
}

/// The method accepts some appearance model and some warp.
fn accepted(registry: &Registry, sm: &SmEntry) -> Report {
    let mut checks = Checks::new(sm.name);
    let [_, plane] = COMPANY;
    let takes = |am: &str| {
        let case = Case::new(registry, sm, am, plane);
        case.build(&case.plain).is_ok()
    };
    let model = registry.ams().iter().find(|am| takes(am.name));
    checks.holds(
        format!("tracks some appearance model and {plane}"),
        model.is_some(),
    );
    checks.report()
}

/// One tracker.
struct Case<'a> {
    registry: &'a Registry,
    sm: &'a SmEntry,
    am: &'a str,
    /// With its defaults, where the method follows gradients.
    plain: String,
    id: String,
}

impl<'a> Case<'a> {
    fn new(registry: &'a Registry, sm: &'a SmEntry, am: &'a str, ssm: &str) -> Self {
        let known = (sm.params)();
        let exact = sm.groups.contains(&"gradient");
        let id = |set: &[(&str, &str)]| {
            let set = set
                .iter()
                .filter(|(name, _)| known.iter().any(|p| p.name == *name));
            let set: Vec<String> = set.map(|(name, value)| format!("{name}={value}")).collect();
            format!("{}/{am}/{ssm}{{{}}}", sm.name, set.join(","))
        };
        Case {
            registry,
            sm,
            am,
            plain: id(if exact { &[] } else { SMALL }),
            id: id(if exact { PATIENT } else { SMALL }),
        }
    }

    fn exact(&self) -> bool {
        self.sm.groups.contains(&"gradient")
    }

    fn build(&self, id: &str) -> Result<Box<dyn Tracker>, SpecError> {
        self.registry.build(&self.registry.parse(id)?)
    }

    /// The tracker; `None` where its parts are refused, which is no fault.
    fn tracker(&self, checks: &mut Checks, id: &str) -> Option<Box<dyn Tracker>> {
        match self.build(id) {
            Err(SpecError::Refused { .. }) => None,
            built => checks.succeeds("build", built),
        }
    }

    /// Whether a search with the appearance model alone is asked to arrive.
    fn tracks_alone(&self) -> bool {
        let entry = self.registry.ams().iter().find(|e| e.name == self.am);
        let model = entry.and_then(|e| (e.build)(&[]).ok());
        model.is_some_and(|am| am.properties().tracks_alone)
    }

    /// With this appearance model: everything.
    fn model(&self, scenes: &Scenes) -> Report {
        let mut checks = Checks::new(&self.id);
        let ids = [&self.plain, &self.plain, &self.plain, &self.id];
        let built = ids.map(|id| self.tracker(&mut checks, id));
        let [Some(mut plain), Some(bare), Some(other), Some(mut patient)] = built else {
            return checks.report();
        };
        let (alone, slow) = (self.tracks_alone(), SLOW.contains(&self.sm.name));
        let tolerance = match (self.exact(), alone) {
            (true, _) => 0.01,
            (false, true) => 2.0,
            (false, false) => 10.0,
        };
        failures(&mut checks, &mut *plain, scenes.still(), self.exact(), tolerance);
        let asked = !self.exact() || (alone && !slow);
        let count = if self.exact() && asked { 4 } else { 1 };
        for seed in 0..count {
            let tolerance = asked.then_some(tolerance);
            let scene = if self.exact() {
                scenes.random(seed)
            } else {
                scenes.sampled()
            };
            recovers(&mut checks, &mut *patient, scene, seed, tolerance);
        }
        boxed::tracker(&mut checks, scenes.random(0), bare, other);
        self.boxed_parts(&mut checks, scenes.random(0));
        checks.report()
    }

    /// The same method over models in another box.
    fn boxed_parts(&self, checks: &mut Checks, scene: &Scene) {
        let entries = (
            self.registry.ams().iter().find(|e| e.name == self.am),
            self.registry.ssms().iter().find(|e| e.name == COMPANY[1]),
        );
        let (Some(am), Some(ssm)) = entries else { return };
        let known = (self.sm.params)();
        let set = if self.exact() { &[] } else { SMALL };
        let set: Vec<_> = set
            .iter()
            .copied()
            .filter(|(k, _)| known.iter().any(|p| p.name == *k))
            .collect();
        let build = |wrap: bool| {
            let (mut am, mut ssm) = ((am.build)(&[])?, (ssm.build)(&[])?);
            if wrap {
                (am, ssm) = (boxed::wrap_am(am), boxed::wrap_ssm(ssm));
            }
            (self.sm.build)(&set, am, ssm)
        };
        if let (Some(bare), Some(wrapped)) = (
            checks.succeeds("build", build(false)),
            checks.succeeds("build over boxed models", build(true)),
        ) {
            boxed::tracker(checks, scene, bare, wrapped);
        }
    }

    /// With this warp: motion inside its family.
    fn warp(&self, ssm: &SsmEntry, own: &OnceLock<Scene>, scenes: &Scenes) -> Report {
        let mut checks = Checks::new(&self.id);
        let Some(mut tracker) = self.tracker(&mut checks, &self.id) else {
            return checks.report();
        };
        if SLOW.contains(&self.sm.name) {
            return checks.report();
        }
        let scene = match within(ssm).filter(|_| self.exact()) {
            Some(truth) => own.get_or_init(|| Scene::new(13, truth)),
            None => scenes.shifted(self.exact()),
        };
        let tolerance = if self.exact() { 0.02 } else { 1.0 };
        recovers(&mut checks, &mut *tracker, scene, 0, Some(tolerance));
        checks.report()
    }
}

/// Where a random state of a warp that composes takes the object.
fn within(entry: &SsmEntry) -> Option<Corners> {
    let mut ssm = (entry.build)(&[]).ok()?;
    ssm.init(&QUAD, GRID).ok()?;
    let mut r = rng(31);
    let p: Vec<f64> = (0..ssm.dof()).map(|_| r.random_range(-0.035..0.035)).collect();
    ssm.set_state(&p).ok()?;
    ssm.capabilities().compositional.then(|| ssm.corners())
}

/// The motion of a scene is found, if it is asked for, and the answer is where the tracker is; the first scene's is found
/// again in the same way after a new start.
fn recovers(
    checks: &mut Checks,
    tracker: &mut dyn Tracker,
    scene: &Scene,
    seed: usize,
    tolerance: Option<f64>,
) {
    let mut track = |seed: Option<u64>| -> Result<(Corners, Corners), TrackError> {
        if let Some(seed) = seed {
            tracker.reseed(seed);
        }
        tracker.init(&scene.first, &QUAD)?;
        let update = tracker.update(&scene.next)?;
        Ok((update.corners, tracker.corners()))
    };
    let first = track(None);
    if seed == 0 {
        checks.holds("repeats exactly", track(Some(7)) == track(Some(7)));
    }
    match (checks.succeeds(&format!("track, seed {seed}"), first), tolerance) {
        (Some((answer, place)), Some(tolerance)) => {
            let error = distance(&answer, &scene.truth);
            checks.at_most(format!("recovers motion, px, seed {seed}"), error, tolerance);
            checks.holds(format!("answers where it is, seed {seed}"), answer == place);
        }
        (Some((answer, _)), None) => checks.holds(format!("finite, seed {seed}"), answer.is_finite()),
        (None, _) => {}
    }
}

/// What cannot be tracked is refused by the right error, and the tracker goes on afterwards.
fn failures(checks: &mut Checks, tracker: &mut dyn Tracker, still: &Scene, exact: bool, tolerance: f64) {
    let (flat, poisoned) = (uniform(90.0), uniform(f32::NAN));
    let none = tracker.update(&still.first).err();
    checks.holds("update before init", none == Some(TrackError::NotInitialised));
    let refused = tracker.init(&flat, &QUAD);
    checks.holds(
        "init on a flat frame",
        matches!(refused, Err(TrackError::Template(_))),
    );
    let refused = tracker.init(&poisoned, &QUAD);
    checks.holds("init on NaN", matches!(refused, Err(TrackError::NotFinite(_))));
    let refused = tracker.init(&still.first, &QUAD.translated(5000.0, 0.0));
    checks.holds("init outside the image", refused == Err(TrackError::Outside));
    let refused = tracker.init(&still.first, &Corners::rect(50.0, 50.0, 0.5, 0.5));
    checks.holds(
        "init on a tiny region",
        matches!(refused, Err(TrackError::BadRegion(_))),
    );
    if checks
        .succeeds("init", tracker.init(&still.first, &QUAD))
        .is_none()
    {
        return;
    }
    if let Some(update) = checks
        .succeeds("standing still", tracker.update(&still.first))
        .filter(|_| exact)
    {
        checks.at_most("standing still, px", distance(&update.corners, &QUAD), 1e-3);
        checks.holds("standing still converges", update.stop == Stop::Converged);
    }
    checks.holds("update on NaN", tracker.update(&poisoned).is_err());
    // A featureless frame gives no direction, or a wrong one, but never a number that is not finite.
    let _ = tracker.update(&flat);
    checks.holds("finite after a flat frame", tracker.corners().is_finite());
    checks.succeeds("put back", tracker.set_region(&QUAD));
    if let Some(update) = checks.succeeds("tracking after failures", tracker.update(&still.first)) {
        checks.at_most(
            "tracking after failures, px",
            distance(&update.corners, &QUAD),
            tolerance,
        );
    }
}
