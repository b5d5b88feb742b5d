//! The rig on the page, the settings that were asked for, and the thread that matches the one with the other.

use std::{
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use multiscopic::{
    Engine, Error, Processor, Progress, Result,
    stereo::{CostFunction, MethodName, Pipeline},
    target::Ram,
};
use multiscopic_core::{BlockMatchingParams, SemiGlobalCost, SemiGlobalParams};
use multiscopic_edge::Matching;
use multiscopic_options::page::{self, Control, Settings};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::tuned_rig::{Tuned, TunedMatch, TunedRig};
use crate::command::{
    advice,
    budget::{Prediction, TargetOptions},
    foxglove::Publisher,
    live::notice_board::{NoticeBoard, Subject},
    options::{MatchingOptions, Named},
    view::shell_line,
};

/// A match that runs longer than this ends when the settings change. Faster ones come to their end, so that the picture follows a
/// slider that does not stop.
const PATIENCE: Duration = Duration::from_millis(150);
/// The least time between two notices of progress.
const BETWEEN_NOTICES: Duration = Duration::from_millis(100);

/// The match that a page asks for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wish {
    settings: Settings,
    /// The microcontroller whose memory and time are predicted.
    core: String,
}

impl Default for Wish {
    fn default() -> Wish {
        Wish {
            settings: Settings::from([("method".into(), MethodName::Net.name().into())]),
            core: Processor::ALL[0].name().into(),
        }
    }
}

/// The rig, the wish, and what came of it.
pub struct Workbench {
    /// The notices for pages.
    pub board: NoticeBoard,
    controls: Vec<Control>,
    engine: Engine,
    /// The server of results for others than pages.
    publisher: Option<Publisher>,
    desk: Mutex<Desk>,
    /// Notified when the desk changes.
    change: Condvar,
    /// The number of its changes.
    changes: AtomicU64,
}

/// The rig and the wish that are to be matched.
#[derive(Default)]
struct Desk {
    rig: Option<Arc<TunedRig>>,
    wish: Wish,
    /// True until the rig is matched.
    is_new: bool,
    is_closed: bool,
}

/// The notice to a page before the match.
#[derive(Debug, Serialize)]
struct PlanNotice {
    settings: Settings,
    /// The options that have an effect.
    applying: Vec<&'static str>,
    core: String,
    command: String,
    rust: String,
    /// The prediction, or why there is none.
    prediction: std::result::Result<Prediction, String>,
}

impl Workbench {
    /// An empty one.
    pub fn new(engine: Engine, publisher: Option<Publisher>) -> Workbench {
        Workbench {
            board: NoticeBoard::new(),
            controls: page::controls(),
            engine,
            publisher,
            desk: Mutex::default(),
            change: Condvar::new(),
            changes: AtomicU64::new(0),
        }
    }

    /// Returns the options that can be set.
    pub fn controls(&self) -> &[Control] {
        &self.controls
    }

    /// Puts a rig onto the page, in the place of the one before.
    pub fn open(&self, rig: TunedRig) {
        let found = rig.found_range().map(|(least, count)| json!({ "min_disparity": least, "num_disparities": count }));
        let folder = rig.folder().display().to_string();
        self.board.put(Subject::Scene, json!({ "folder": folder, "scene": rig.scene(), "found_range": found }));
        self.alter(|desk| (desk.rig, desk.is_new) = (Some(Arc::new(rig)), true));
    }

    /// Asks for another match.
    pub fn ask(&self, wish: Wish) {
        self.alter(|desk| desk.wish = wish);
    }

    /// Ends the matching.
    pub fn close(&self) {
        self.alter(|desk| desk.is_closed = true);
    }

    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn alter(&self, alter: impl FnOnce(&mut Desk)) {
        let mut desk = self.desk();
        alter(&mut desk);
        self.changes.fetch_add(1, Ordering::Relaxed);
        self.change.notify_all();
    }

    /// Matches whatever is asked for, until it is closed.
    pub fn run(&self) {
        let mut seen = 0;
        loop {
            let (rig, wish, is_new) = {
                let mut desk = self.desk();
                while self.changes.load(Ordering::Relaxed) == seen && !desk.is_closed {
                    desk = self.change.wait(desk).unwrap_or_else(PoisonError::into_inner);
                }
                if desk.is_closed {
                    return;
                }
                seen = self.changes.load(Ordering::Relaxed);
                (desk.rig.clone(), desk.wish.clone(), std::mem::take(&mut desk.is_new))
            };
            if let Some(rig) = rig
                && let Err(error) = self.match_once(&rig, &wish, seen, is_new)
            {
                let settings = &wish.settings;
                self.board.put(Subject::Result, json!({ "settings": settings, "failure": advice::error(&error) }));
            }
        }
    }

    /// Matches a rig. One that is new is shown by block matching first, which takes no time.
    fn match_once(&self, rig: &TunedRig, wish: &Wish, number: u64, is_new: bool) -> Result<()> {
        let words = page::words(&self.controls, &wish.settings)?;
        let processor = Processor::ALL.iter().find(|processor| processor.name() == wish.core).copied();
        let processor =
            processor.ok_or_else(|| Error::Usage(format!("{:.40} is none of the processors on the page", wish.core)))?;
        let plan = rig.plan(&MatchingOptions::parse(&words)?)?;
        let rust = rust_code(&words);
        let ends = ["-o", "disparity.pfm"].map(str::to_owned);
        let folder = rig.folder().display().to_string();
        let command = ["match".to_owned(), folder.clone()].into_iter().chain(words).chain(ends);
        let applying = self.controls.iter().filter(|control| control.applies(&wish.settings)).map(Control::option);
        self.board.put(
            Subject::Plan,
            PlanNotice {
                settings: wish.settings.clone(),
                applying: applying.collect(),
                core: wish.core.clone(),
                command: shell_line(command),
                rust,
                prediction: prediction(&plan, processor),
            },
        );
        let watcher = Watcher { bench: self, number, start: Instant::now(), steps: Mutex::new(Steps::default()) };
        let first = (is_new && plan.name != MethodName::Bm.name()).then(|| plan.by_blocks());
        for plan in first.iter().chain([&plan]) {
            let outcome = rig.run(plan, &self.engine, &watcher);
            if watcher.is_interrupted() {
                break;
            }
            let outcome = outcome?;
            let deviations = self.publisher.as_ref().and_then(|_| rig.deviations(plan, &self.engine, &outcome));
            if let (Some(publisher), Some(recording)) = (&self.publisher, rig.recording(plan, &outcome, deviations.as_ref())) {
                publisher.publish(&recording, rig.exposed())?;
            }
            let Tuned { map, summary, warnings } = rig.tuned(plan, outcome);
            let notice =
                json!({ "settings": wish.settings, "folder": folder, "map": map, "summary": summary, "warnings": warnings });
            self.board.put(Subject::Result, notice);
        }
        Ok(())
    }
}

/// A function in Rust that matches frames by these options. It needs the crates `multiscopic` and `multiscopic-options`.
fn rust_code(words: &[String]) -> String {
    format!(
        "use multiscopic::{{DisparityMap, Engine, Frames, Method, Result}};
use multiscopic_options::MatchingOptions;

/// The disparities of frames without distortion, by what `multiscopic tune` found.
pub fn disparities(frames: &Frames) -> Result<DisparityMap> {{
    let options = MatchingOptions::parse({words:?})?;
    let search = options.search(frames.size(), frames.views(), Method::DEFAULT_RANGE)?;
    options.method(frames.views())?.disparities(&Engine::new(None, 0)?, frames, &search, &())
}}
"
    )
}

/// Predicts what the same match takes on a microcontroller, or says why it cannot run there.
fn prediction(plan: &TunedMatch, processor: Processor) -> std::result::Result<Prediction, String> {
    let TunedMatch { name, method, search } = plan;
    let matching = match &method.pipeline {
        Pipeline::BlockMatching { block_size } => {
            let params = BlockMatchingParams::block_matching(*search, *block_size).map_err(|error| error.to_string())?;
            Matching::Blocks { params, tile_width: params.width() }
        }
        Pipeline::SemiGlobal { cost: CostFunction::Sad { block_size }, paths } => {
            let cost = SemiGlobalCost::Sad { block_size: *block_size };
            let params = SemiGlobalParams::new(*search, cost).map_err(|error| error.to_string())?;
            if paths.penalties != params.penalties() || paths.paths.count() != SemiGlobalParams::PATHS {
                return Err("The firmware has five paths and the default penalties.".into());
            }
            Matching::SemiGlobal(params)
        }
        Pipeline::SemiGlobal { .. } => {
            return Err("The firmware has semi-global matching by sad alone: choose this cost.".into());
        }
        _ => return Err(format!("{name} does not run on microcontrollers: bm does, and sgm by sad.")),
    };
    Ok(Prediction::new(&TargetOptions::of(processor), &matching, &Ram::new(&matching, processor), false))
}

/// Tells pages how far a match has come, and ends it if it is no longer asked for.
struct Watcher<'a> {
    bench: &'a Workbench,
    number: u64,
    start: Instant,
    steps: Mutex<Steps>,
}

#[derive(Default)]
struct Steps {
    done: u64,
    total: u64,
    name: String,
    told: Option<Instant>,
}

impl Progress for Watcher<'_> {
    fn begin(&self, steps: u64, name: &str) {
        let mut now = self.steps.lock().unwrap_or_else(PoisonError::into_inner);
        *now = Steps { done: 0, total: steps, name: name.into(), told: now.told };
    }

    fn advance(&self, steps: u64) {
        let mut now = self.steps.lock().unwrap_or_else(PoisonError::into_inner);
        now.done += steps;
        // What is done at once needs no progress.
        let is_due = now.told.unwrap_or(self.start).elapsed() > BETWEEN_NOTICES;
        if is_due && !self.is_interrupted() {
            now.told = Some(Instant::now());
            let Steps { done, total, name, .. } = &*now;
            self.bench.board.put(Subject::Progress, json!({ "done": done, "total": total, "name": name }));
        }
    }

    fn is_interrupted(&self) -> bool {
        let is_newest = self.bench.changes.load(Ordering::Relaxed) == self.number;
        !is_newest && self.start.elapsed() > PATIENCE
    }
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Views;
    use proptest::{
        collection::{btree_map, vec},
        prelude::*,
        sample::{Index, select},
    };

    use super::*;
    use crate::{command::options::SearchOptions, tests::tally};

    /// Values that some options take, and values that none does.
    const VALUES: [&str; 23] = [
        "", "0", "1", "-1", "7", "8", "9", "64", "0.5", "1e9", "nan", "inf", "bm", "sgm", "net", "gc", "min", "half", "sad",
        "5x5", "none", "--output", "\u{0}",
    ];

    /// The messages of a page, of which every other one is damaged.
    fn messages() -> impl Strategy<Value = String> {
        let options = page::controls().iter().map(Control::option).chain(["output", ""]).collect::<Vec<_>>();
        let value = prop_oneof![8 => select(&VALUES[..]).prop_map(String::from), 1 => any::<String>()];
        let settings = btree_map(select(options), value, 0..6);
        let damages = prop_oneof![Just(Vec::new()), vec((any::<Index>(), any::<char>(), 0..3), 1..4)];
        (settings, damages).prop_map(|(settings, damages)| {
            let mut text: Vec<char> = json!({ "settings": settings, "core": "cortex-m4" }).to_string().chars().collect();
            for (at, letter, kind) in damages {
                let at = at.index(text.len());
                match kind {
                    0 => text[at] = letter,
                    1 => text.insert(at, letter),
                    _ if at > 0 => text.truncate(at),
                    _ => {}
                }
            }
            text.into_iter().collect()
        })
    }

    #[test]
    fn any_message_is_taken_or_refused() {
        let controls = page::controls();
        let plan = |text: &str| {
            let wish: Wish = serde_json::from_str(text).ok()?;
            let words = page::words(&controls, &wish.settings).ok()?;
            let offered = |word: &String| controls.iter().any(|control| word[2..] == *control.option());
            assert!(words.iter().filter(|word| word.starts_with("--")).all(offered), "{words:?}");
            let matching = MatchingOptions::parse(&words).ok()?;
            let search = matching.search([48, 36], Views::CROSS, SearchOptions::DEFAULT_RANGE).ok()?;
            let plan = TunedMatch { name: matching.method.name(), method: matching.method(Views::CROSS).ok()?, search };
            let prediction = prediction(&plan, Processor::ALL[0]);
            Some(prediction.map(|prediction| json!(prediction)))
        };
        let outcomes = tally(2000, &messages(), |text| Ok(if plan(&text).is_some() { "planned" } else { "refused" }));
        assert!(outcomes["planned"] > 100 && outcomes["refused"] > 500);
    }
}
