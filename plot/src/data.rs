//! What a picture is made of: fed with messages, in bounded memory.

use super::series::{Lane, Series, Ticks, Track};
use crate::Footprint;
use diagnostics::Subjects;
use messages::{Message, common, lowlevel, middlelevel, simulation};
use navitools::{Point, Pose};
use simulator::people::Contact;
use simulator::world::World;
use std::collections::BTreeMap;

/// Between two ellipses, s, in the beginning; more than so many are not kept.
const ELLIPSES: f64 = 2.0;
const ELLIPSES_MOST: usize = 256;
/// Who does not announce its state for so long is not there, s.
const STATE_HOLD: f64 = 2.5;
/// The same for the reason not to move, which comes at 5 Hz or more, and for the PAUSE line, at 2 Hz.
const REASON_HOLD: f64 = 1.0;
const PAUSE_HOLD: f64 = 2.0;
/// More is not kept of each; what is left out is counted.
const MODULES: usize = 256;
const TEXTS: usize = 500;
const MARKS: usize = 100;
const CONTACTS: usize = 1000;
const CELLS: usize = 50_000;
/// A text is not kept longer than this, characters.
const TEXT: usize = 200;
/// A moment that is farther from the first one is a mistake, s.
const RUN_MOST: f64 = 31.0 * 86_400.0;

/// What stands in the headline of a picture.
#[derive(Clone, Debug, Default)]
pub struct Title {
    /// The run's name.
    pub run: String,
    /// The robot's name.
    pub robot: String,
    /// The program that recorded it.
    pub program: String,
    /// What the reader of the run has to say about it: what is damaged, what is missing.
    pub remarks: Vec<String>,
}

/// A run, as far as a picture shows it.
#[derive(Debug)]
pub struct Picture {
    pub(super) title: Title,
    pub(super) world: World,
    pub(super) geometry: Option<Footprint>,
    /// From when to when, s since the UNIX epoch.
    pub(super) span: Option<(f64, f64)>,
    /// Messages of impossible moments.
    pub(super) strays: u64,
    pub(super) truth: Track,
    pub(super) estimate: Track,
    pub(super) pose: Option<Pose>,
    pub(super) ellipses: Vec<Ellipse>,
    ellipse_every: f64,
    pub(super) plan: Vec<Point>,
    pub(super) cells: Vec<Point>,
    pub(super) cell: f64,
    pub(super) contacts: Vec<Point>,
    /// How often the body touched something, as the simulation counts: first and last.
    collisions: Option<(i32, i32)>,
    pub(super) speed: Series,
    pub(super) speed_target: Series,
    pub(super) steering: Series,
    pub(super) steering_target: Series,
    pub(super) voltage: Series,
    pub(super) charge: Series,
    /// By severity.
    pub(super) errors: [Ticks; 3],
    pub(super) texts: Vec<Told>,
    subjects: Subjects,
    /// Reports whose text found no room.
    pub(super) untold: u64,
    pub(super) states: BTreeMap<String, Lane<i8>>,
    /// Announcements of modules that found no room.
    pub(super) unheard: u64,
    /// Why it does not move, by number.
    holds: Lane<Stand>,
    /// The same as text, of a log from before the numbers.
    reasons: Lane<Stand>,
    /// What holds the PAUSE line.
    pub(super) pause: Lane<Stand>,
    pub(super) marks: Vec<(f64, String)>,
    pub(super) unmarked: u64,
}

/// Why the robot stands for a while.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stand {
    /// In words; empty: it does not.
    pub words: String,
    /// Nothing is wrong: nobody wants it to move.
    pub idle: bool,
}

impl Stand {
    fn of(words: &str) -> Self {
        Self { words: brief(words), idle: false }
    }
}

/// Where the robot was believed to be, and how sure that was.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse {
    at: f64,
    /// m.
    pub middle: Point,
    /// Covariance of x and y, m²: xx, xy, yy.
    pub covariance: [f64; 3],
}

/// What was reported, once or often: the same fault of the same subject; where no subject is known, in the same words.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// When first, s.
    pub first: f64,
    /// When last, s.
    pub last: f64,
    /// How often.
    pub times: u64,
    /// 0 NOTICE, 1 WARNING, 2 ERROR.
    pub severity: usize,
    /// By whom.
    pub module: String,
    /// What, by number.
    pub number: i32,
    /// Which of several, where that is known.
    pub subject: Option<String>,
    /// In words, as it was said first.
    pub message: String,
}

impl Picture {
    /// An empty one of this world, for a robot of this geometry where that is known.
    #[must_use]
    pub fn new(world: World, geometry: Option<Footprint>) -> Self {
        Self {
            title: Title::default(),
            world,
            geometry,
            span: None,
            strays: 0,
            truth: Track::default(),
            estimate: Track::default(),
            pose: None,
            ellipses: Vec::new(),
            ellipse_every: ELLIPSES,
            plan: Vec::new(),
            cells: Vec::new(),
            cell: 0.0,
            contacts: Vec::new(),
            collisions: None,
            speed: Series::default(),
            speed_target: Series::default(),
            steering: Series::default(),
            steering_target: Series::default(),
            voltage: Series::default(),
            charge: Series::default(),
            errors: Default::default(),
            texts: Vec::new(),
            subjects: Subjects::default(),
            untold: 0,
            states: BTreeMap::new(),
            unheard: 0,
            holds: Lane::default(),
            reasons: Lane::default(),
            pause: Lane::default(),
            marks: Vec::new(),
            unmarked: 0,
        }
    }

    /// What stands above it.
    pub fn entitle(&mut self, title: Title) {
        self.title = title;
    }

    /// Whether nothing of a robot is in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let nowhere = self.truth.spots().is_empty() && self.estimate.spots().is_empty();
        nowhere && self.speed.range().is_none() && self.states.is_empty()
    }

    /// Takes a message that was sent or heard at this moment, microseconds since the UNIX epoch. Those that have no place
    /// in a picture change nothing. Of one channel and sender they come in order; what comes from before is left out.
    pub fn take(&mut self, at_us: i64, message: &Message) {
        let at = at_us as f64 / 1e6;
        match message {
            Message::SimDataTruth(truth) => self.at(at).map(|this| this.on_truth(at, truth)),
            Message::MlDataEstimate(estimate) => self.at(at).map(|this| this.on_estimate(at, estimate)),
            Message::MlDataPlan(plan) => self.at(at).map(|this| this.plan = path(&plan.x, &plan.y)),
            Message::MlDataObstacles(obstacles) => self.at(at).map(|this| {
                this.cells = path(&obstacles.x, &obstacles.y);
                this.cell = obstacles.size;
            }),
            Message::LlDataMotion(motion) => self.at(at).map(|this| this.on_motion(at, motion)),
            Message::LlDataPower(power) => self.at(at).map(|this| {
                this.voltage.push(at, power.voltage);
                this.charge.push(at, 100.0 * power.charge);
            }),
            Message::LlDataHold(list) if list.is_of_motion() => self.at(at).map(|this| {
                let words = list.holds.first().map_or(String::new(), lowlevel::Hold::words);
                this.holds.push(at, Stand { idle: list.is_idle(), ..Stand::of(&words) }, REASON_HOLD);
            }),
            Message::LlEventStop(stop) => self.at(at).map(|this| {
                let source = if stop.source.is_empty() { "engaged" } else { &stop.source };
                let stand = if stop.engaged { Stand::of(source) } else { Stand::default() };
                this.pause.push(at, stand, PAUSE_HOLD);
            }),
            Message::CmDataState(state) => self.at(at).map(|this| this.on_state(at, state)),
            Message::CmEventError(error) => self.at(at).map(|this| this.on_error(at, error)),
            Message::CmDataFaults(list) => {
                self.subjects.list(list);
                None
            }
            Message::CmCmdLog(log) if log.action == common::CmdLog::MARK => {
                self.mark(at_us, &log.text);
                None
            }
            _ => None,
        };
    }

    /// Takes a mark that somebody put into the run at this moment, microseconds since the UNIX epoch.
    pub fn mark(&mut self, at_us: i64, text: &str) {
        let at = at_us as f64 / 1e6;
        let Some(this) = self.at(at) else { return };
        let mark = (at, brief(text));
        if this.marks.contains(&mark) {
            return;
        }
        match this.marks.len() < MARKS {
            true => this.marks.push(mark),
            false => this.unmarked += 1,
        }
    }

    /// Takes a line that a module printed: contacts are told so.
    pub fn note(&mut self, line: &str) {
        if let Ok(contact) = line.parse::<Contact>()
            && self.contacts.len() < CONTACTS
        {
            self.contacts.push(contact.at);
        }
    }

    /// Why it did not move: by number, or the text of a log that has none.
    pub(super) fn stands(&self) -> &Lane<Stand> {
        if self.holds.spans().is_empty() { &self.reasons } else { &self.holds }
    }

    /// How often the body touched something.
    #[must_use]
    pub fn contacts(&self) -> u64 {
        let counted = self.collisions.map_or(0, |(first, last)| i64::from(last) - i64::from(first));
        (self.contacts.len() as u64).max(u64::try_from(counted).unwrap_or(0))
    }

    /// This, at a moment that can be one of the run.
    fn at(&mut self, at: f64) -> Option<&mut Self> {
        let (from, to) = self.span.unwrap_or((at, at));
        if (at - from).abs() > RUN_MOST || (at - to).abs() > RUN_MOST {
            self.strays += 1;
            return None;
        }
        self.span = Some((from.min(at), to.max(at)));
        Some(self)
    }

    fn on_truth(&mut self, at: f64, truth: &simulation::DataTruth) {
        let pose = Pose::new(truth.x, truth.y, truth.theta);
        let sound = truth.x.is_finite() && truth.y.is_finite() && truth.theta.is_finite();
        self.pose = if sound { Some(pose) } else { self.pose };
        self.truth.push(at, pose.point());
        let first = self.collisions.map_or(truth.collisions, |(first, _)| first);
        self.collisions = Some((first, truth.collisions));
    }

    fn on_estimate(&mut self, at: f64, estimate: &middlelevel::DataEstimate) {
        if estimate.quality < middlelevel::DataEstimate::COARSE {
            return;
        }
        let middle = Point { x: estimate.x, y: estimate.y };
        self.estimate.push(at, middle);
        if self.ellipses.last().is_some_and(|last| at - last.at < self.ellipse_every) {
            return;
        }
        let [[xx, xy, _], [_, yy, _], _] = estimate.covariance;
        self.ellipses.push(Ellipse { at, middle, covariance: [xx, xy, yy] });
        if self.ellipses.len() > ELLIPSES_MOST {
            self.ellipse_every *= 2.0;
            let mut n = 0;
            self.ellipses.retain(|_| {
                n += 1;
                n % 2 == 1
            });
        }
    }

    fn on_motion(&mut self, at: f64, motion: &lowlevel::DataMotion) {
        self.speed.push(at, motion.speed);
        self.speed_target.push(at, motion.speed_target);
        self.steering.push(at, motion.steering);
        self.steering_target.push(at, motion.steering_target);
        self.reasons.push(at, Stand::of(&motion.reason), REASON_HOLD);
    }

    fn on_state(&mut self, at: f64, state: &common::DataState) {
        let module = brief(&state.module);
        if self.states.len() >= MODULES && !self.states.contains_key(&module) {
            self.unheard += 1;
            return;
        }
        self.states.entry(module).or_default().push(at, state.state, STATE_HOLD);
    }

    fn on_error(&mut self, at: f64, error: &common::Error) {
        let severity = usize::try_from(error.severity).map_or(2, |severity| severity.min(2));
        self.errors[severity].push(at);
        let (module, message) = (brief(&error.module), brief(&error.message));
        let subject = self.subjects.of(error).map(|subject| brief(&subject));
        let same = |told: &&mut Told| {
            (told.number, told.severity) == (error.number, severity)
                && told.module == module
                && told.subject == subject
                && (subject.is_some() || told.message == message)
        };
        if let Some(told) = self.texts.iter_mut().find(same) {
            (told.first, told.last) = (told.first.min(at), told.last.max(at));
            told.times += 1;
        } else if self.texts.len() < TEXTS {
            let number = error.number;
            self.texts.push(Told { first: at, last: at, times: 1, severity, module, number, subject, message });
        } else {
            self.untold += 1;
        }
    }
}

fn path(x: &[f64], y: &[f64]) -> Vec<Point> {
    let sound = |point: &Point| point.x.is_finite() && point.y.is_finite();
    x.iter().zip(y).map(|(x, y)| Point { x: *x, y: *y }).filter(sound).take(CELLS).collect()
}

/// One line of words, not too long.
fn brief(text: &str) -> String {
    text.chars().take(TEXT).map(|c| if c.is_control() { ' ' } else { c }).collect()
}
