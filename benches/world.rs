//! Virtual world compared with real time: `cargo bench -p advee --bench world`.
//!
//! The whole shipped robot, all its modules and the watchdog, on virtual buses, in the worlds `empty` (without
//! visitors) and `hall` (20 visitors): standing, driven by commands at 20 Hz, and `checked`: driven, with the rules of
//! `advee soak` applied to every step. For each: virtual seconds per second of CPU time, events seen by an observer,
//! allocations, distance, digest. Each runs twice; different digests end the bench. Goals: 1000 × real time on one
//! core, `empty`, driving; the rules cost 5 % at most.
//!
//! `-- --minutes 10 empty driving`: duration, world, manner; `--picture FILE` draws the last run.

#[path = "sys.rs"]
mod sys;

use base::{Duration, Instant};
use messages::{Message, lowlevel};
use plot::Picture;
use robot::place::RobotLocation;
use robot::topology::virtual_machine;
use sim::check::Checkers;
use sim::host::{Config, News, Virtual};
use std::cell::{Cell, RefCell};
use std::path::Path;
use std::rc::Rc;

#[global_allocator]
static MEMORY: sys::Counting = sys::Counting::new();

/// Time from the start until the steering is homed and everything is warm.
const READY: Duration = Duration::from_secs(15);
const MINUTES: u64 = 5;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let at = arguments.iter().position(|argument| argument == "--minutes");
    let minutes = at.map_or(MINUTES, |at| arguments[at + 1].parse().expect("a number of minutes"));
    let at = arguments.iter().position(|argument| argument == "--picture");
    let picture = at.map(|at| arguments.get(at + 1).expect("a file"));
    // All values of a category are selected unless one is named.
    let chosen = |all: &[&'static str]| {
        let named: Vec<_> =
            all.iter().copied().filter(|one| arguments.iter().any(|argument| argument == one)).collect();
        if named.is_empty() { all.to_vec() } else { named }
    };
    println!(
        "world  robot     x real time  CPU us/s   news/s  allocations/s    way m  contacts  digest ({minutes} min, 2 \
         runs)"
    );
    for world in chosen(&["empty", "hall"]) {
        for robot in chosen(&["standing", "driving", "checked"]) {
            let run = || Run::of(world, robot, minutes, picture.is_some());
            let (first, second) = (run(), run());
            assert_eq!(first.digest, second.digest, "the same run twice");
            let best = first.min(second);
            best.print(world, robot);
            if let Some(file) = picture {
                std::fs::write(file, best.picture).expect("the picture can be written");
            }
        }
    }
}

/// Values seen by an observer.
#[derive(Default)]
struct Seen {
    news: Cell<u64>,
    way: Cell<f64>,
    at: Cell<Option<(f64, f64)>>,
    homed: Cell<bool>,
    /// Contacts of the body that the robot moved into.
    contacts: Cell<i32>,
    picture: RefCell<Option<Picture>>,
}

struct Run {
    seconds: f64,
    cpu_s: f64,
    news: u64,
    allocations: u64,
    way: f64,
    contacts: i32,
    digest: u64,
    picture: String,
}

impl Run {
    fn of(world: &str, robot: &str, minutes: u64, draws: bool) -> Self {
        let (mut machine, seen) = machine(world, draws, robot == "checked");
        machine.run_until(Instant::ZERO + READY);
        assert!(seen.homed.get(), "the steering is homed");
        let begin = (sys::cpu_ns(), seen.news.get(), MEMORY.allocations(), seen.way.get());
        for second in 0..60 * minutes {
            let now = machine.now();
            if robot != "standing" {
                for n in 0..20 {
                    machine.inject(now + n * Duration::from_millis(50), command(second));
                }
            }
            machine.run_until(now + Duration::from_secs(1));
        }
        Self {
            seconds: 60.0 * minutes as f64,
            cpu_s: (sys::cpu_ns() - begin.0) as f64 / 1e9,
            news: seen.news.get() - begin.1,
            allocations: MEMORY.allocations() - begin.2,
            way: seen.way.get() - begin.3,
            contacts: seen.contacts.get(),
            digest: machine.digest(),
            picture: seen.picture.take().map_or(String::new(), |picture| picture.svg()),
        }
    }

    /// Less disturbed run.
    fn min(self, other: Self) -> Self {
        if other.cpu_s < self.cpu_s { other } else { self }
    }

    fn print(&self, world: &str, robot: &str) {
        println!(
            "{world:6} {robot:9} {:11.0} {:9.0} {:8.0} {:14.1} {:8.1} {:9}  {:016x}",
            self.seconds / self.cpu_s,
            self.cpu_s / self.seconds * 1e6,
            self.news as f64 / self.seconds,
            self.allocations as f64 / self.seconds,
            self.way,
            self.contacts,
            self.digest
        );
    }
}

/// Forwards for five seconds and the same path back, each time on another arc: it stays where it began.
fn command(second: u64) -> lowlevel::CmdMotion {
    let speed = if second % 10 < 5 { 0.4 } else { -0.4 };
    let steering = [0.0, 0.55, -0.3, 0.2, -0.5][(second / 10 % 5) as usize];
    let priority = lowlevel::CmdMotion::REMOTE;
    lowlevel::CmdMotion { timestamp: 0, speed, steering, priority, source: "bench".into() }
}

fn machine(world: &str, draws: bool, checked: bool) -> (Virtual, Rc<Seen>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let place = RobotLocation {
        config: root.join("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: Vec::new(),
        sim: true,
        world: Some(root.join("conf/worlds").join(world).with_extension("toml")),
    };
    let config = Config { lcm_jitter: Duration::from_micros(200), ..Config::default() };
    let mut machine = virtual_machine(&place, config.clone()).expect("the shipped configuration");
    let seen = Rc::new(Seen::default());
    if draws {
        let known = robot::config::Config::load(&place.config, true, &[]).expect("the shipped configuration");
        let world = robot::config::world(&place.config, place.world.as_deref(), &[]).expect("a shipped world");
        seen.picture.replace(Some(Picture::new(world, Some(known.robot.footprint()))));
    }
    let keep = seen.clone();
    machine.observe(move |_, news| keep.take(news));
    if checked {
        let limits = robot::checks::limits(&place, config.restart_delay_max).expect("the shipped configuration");
        let mut checkers = Checkers::new(limits);
        machine.observe(move |now, news| {
            checkers.observe(now, news);
            assert_eq!(checkers.violation(), None);
        });
    }
    machine.keep("watchdog").expect("the watchdog starts");
    (machine, seen)
}

impl Seen {
    fn take(&self, news: &News<'_>) {
        self.news.set(self.news.get() + 1);
        if let (News::Message { message, .. }, Some(picture)) = (news, self.picture.borrow_mut().as_mut()) {
            picture.take(message.timestamp(), message);
        }
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => {
                self.contacts.set(truth.collisions);
                if let Some((x, y)) = self.at.replace(Some((truth.x, truth.y))) {
                    let (dx, dy) = (truth.x - x, truth.y - y);
                    self.way.set(self.way.get() + dx.hypot(dy));
                }
            }
            News::Message { message: Message::LlDataMotion(motion), .. } => self.homed.set(motion.homed),
            _ => {}
        }
    }
}
