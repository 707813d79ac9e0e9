//! The web server as a module: started, supervised, reported and ended here.

use super::app::{App, Seats};
use super::center::command;
use super::center::command_queue::CommandQueue;
use super::center::publish::Publisher;
use super::center::session_store::SessionStore;
use super::guard::Guard;
use super::server::{Parts, Server, listen};
use super::settings::Web as Section;
use super::stats::Stats;
use super::{NAME, bus};
use base::{Duration, Fault, Instant, Severity};
use host::clock;
use host::log::Log;
use logger::ros::RobotScene;
use module::{Actions, Event, Module, State, exit};
use record::Header;
use std::fs;
use std::io::IsTerminal;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tokio::sync::{Semaphore, watch};

use super::center::{Center, Scene};
use super::foxglove::hub::{Hub, Limits};

/// Period of checks on the server, and of retries for a refused address.
const PERIOD: Duration = Duration::from_secs(1);
/// Period of checks while the server ends.
const END_CHECK_PERIOD: Duration = Duration::from_millis(20);
/// Checks without a turn of the server's loop after which it counts as hung.
const MISSED_TURNS_MAX: u32 = 5;
/// Maximum number of CANopen objects requested at a time.
const OBJECTS_MAX: usize = 4;
/// Length of credentials, characters; all visible.
const TOKEN_LEN: std::ops::RangeInclusive<usize> = 16..=256;

/// Parameters of the server.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The robot's name.
    pub robot: String,
    /// The LCM bus.
    pub lcm_url: String,
    /// `[web]`.
    pub web: Section,
    /// Folder that `token_file` is relative to.
    pub config: PathBuf,
    /// Constant parts of the robot for Foxglove.
    pub scene: RobotScene,
    /// Scene for pages, with the map.
    pub center: Scene,
    /// Scene of a recorded run, from the configuration in its log.
    pub recorded: fn(&Header) -> Option<Scene>,
    /// PNG of a recorded run, from the log in its folder; an error is one line.
    pub picture: fn(&Path) -> Result<Vec<u8>, String>,
    /// Modules without which the robot does not move.
    pub critical: Vec<String>,
    /// The folder of recorded runs.
    pub logs: PathBuf,
    /// The run folder.
    pub run: PathBuf,
    /// Data of the robot for checking commands.
    pub commands: command::Robot,
}

/// The module.
pub struct Web {
    settings: Settings,
    server: Option<Server>,
    /// Paired devices, and the thread that stores them.
    session_store: Option<(Arc<SessionStore>, JoinHandle<()>)>,
    next: Option<Instant>,
    /// Number of turns of the server's loop when it last changed, and number of checks since.
    turns: (u32, u32),
}

impl Web {
    /// Creates the module; the server is not started yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, server: None, session_store: None, next: None, turns: (0, 0) }
    }

    fn open(&mut self, now: Instant, out: &mut Actions) {
        self.next = Some(now + PERIOD);
        match start(&self.settings) {
            Ok((server, session_store, keeps, broken)) => {
                self.server = Some(server);
                self.turns = (0, 0);
                let at = self.settings.web.listen;
                out.clear(Fault::PortDown, NAME, format!("{at}: the web server is there"));
                out.working();
                out.note(format!("http://{at}/   Foxglove: ws://{at}/foxglove"));
                broken.into_iter().chain(session_store.news()).for_each(|line| out.note(line));
                // Only to a person at a terminal: a text would appear in the journal and in the logs. `advee up`, whose
                // watchdog starts this process, shows them itself.
                if std::io::stderr().is_terminal()
                    && std::env::var_os(host::processes::VARIABLE).is_none()
                    && let Some(invitation) = session_store.invitation()
                {
                    Log::new(NAME).line(invitation);
                }
                self.session_store = Some((session_store, keeps));
            }
            Err(why) => {
                out.raise(Severity::Warning, Fault::PortDown, NAME, why);
                out.failed();
            }
        }
    }

    fn look(&mut self, now: Instant, out: &mut Actions) {
        let Some(server) = &self.server else { return self.open(now, out) };
        self.next = Some(now + PERIOD);
        let kept = self.session_store.iter().flat_map(|(session_store, _)| session_store.news());
        server.stats.take_news().into_iter().chain(kept).for_each(|line| out.note(line));
        let (seen, silent) = self.turns;
        let turns = server.bus.turns();
        self.turns = if turns == seen { (seen, silent + 1) } else { (turns, 0) };
        if server.has_ended() || silent >= MISSED_TURNS_MAX {
            let why = "the web server stands still: it is started again";
            out.fatal(Fault::PortDown, NAME, why, exit::SERVER_STALLED);
        }
    }
}

impl Module for Web {
    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.open(now, out),
            Event::Timer if self.next.is_some_and(|next| next <= now) => match &self.server {
                Some(server) if server.is_ending() => self.next = Some(now + END_CHECK_PERIOD),
                _ => self.look(now, out),
            },
            Event::State(State::Terminate) => {
                self.next = Some(now + END_CHECK_PERIOD);
                if let Some(server) = &self.server {
                    server.end();
                }
            }
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }

    fn finished(&self) -> bool {
        self.server.as_ref().is_none_or(Server::has_ended)
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        if let Some((session_store, keeps)) = self.session_store.take() {
            session_store.close();
            // Its files disappear with the process.
            let _ = keeps.join();
        }
    }
}

/// Server, paired devices, the thread that stores them, and a note on the stored ones.
type Started = (Server, Arc<SessionStore>, JoinHandle<()>, Option<String>);

fn start(settings: &Settings) -> Result<Started, String> {
    let Settings { robot, lcm_url, web, config, scene, center, recorded, picture, critical, logs, run, commands } =
        settings;
    let at = web.listen;
    let token = web.token_file.as_ref().map(|path| token(&config.join(path))).transpose()?;
    let listener = listen(at).map_err(|error| match error.kind() {
        std::io::ErrorKind::AddrInUse => {
            format!("{at} is in use: there is no web server here until it is free; --http takes another address")
        }
        _ => format!("{at}: {error}"),
    })?;
    let guard = Guard { hosts: web.hosts.clone(), origins: web.origins.clone(), token };
    let bus = bus::BusReader::open(lcm_url, scene.clone())?;
    let (session_store, broken) = SessionStore::open(run, at, &web.hosts)?;
    let session_store = Arc::new(session_store);
    let limits = Limits::DEFAULT;
    let publisher = Publisher::new(commands.simulated)?;
    let scene_of_pages = Scene { publish: publisher.offered(), ..center.clone() };
    let model = diagnostics::Config { robot: robot.clone(), critical: critical.clone(), simulated: commands.simulated };
    let app = App {
        hub: Arc::new(Mutex::new(Hub::new(limits))),
        center: Arc::new(Center::new(scene_of_pages, *recorded, *picture, model, logs)),
        bus: Arc::default(),
        stats: Arc::new(Stats::default()),
        session_store: session_store.clone(),
        command_queue: CommandQueue::open(lcm_url, commands.clone())?,
        publisher: Arc::new(publisher),
        commanders: Seats::new(web.viewers.into()),
        objects: Arc::new(Semaphore::new(OBJECTS_MAX)),
        lcm_url: lcm_url.as_str().into(),
        robot: robot.as_str().into(),
        session: clock::wall().to_string().into(),
        seats: Seats::new(web.viewers.into()),
        message_max: limits.message,
        end: watch::channel(false).1,
        started: std::time::Instant::now(),
    };
    let command_queue = app.command_queue.clone();
    let server = Server::start(Parts { listener, guard, bus, app }).map_err(|error| {
        command_queue.close();
        format!("the web server: {error}")
    })?;
    let theirs = session_store.clone();
    let keeps = std::thread::Builder::new().name("web keep".into()).spawn(move || theirs.keep());
    match keeps {
        Ok(keeps) => Ok((server, session_store, keeps, broken)),
        Err(error) => {
            server.end();
            Err(format!("the web server: {error}"))
        }
    }
}

/// Reads the credentials: one line of visible characters, in a file that only its owner can read.
///
/// # Errors
/// One line: the defect of the file.
pub fn token(path: &std::path::Path) -> Result<String, String> {
    let wrong = |why: &dyn std::fmt::Display| format!("web.token_file = {:?}: {why}", path.display().to_string());
    let metadata = fs::metadata(path).map_err(|error| wrong(&error))?;
    if metadata.permissions().mode() & 0o077 != 0 {
        return Err(wrong(&"others may read it; chmod 600"));
    }
    if metadata.len() > 1 + *TOKEN_LEN.end() as u64 {
        return Err(wrong(&format_args!("it is longer than {} characters", TOKEN_LEN.end())));
    }
    let text = fs::read_to_string(path).map_err(|error| wrong(&error))?;
    let token = text.trim_end();
    // Characters that a URL would have to escape are not allowed.
    let plain = token.chars().all(|c| c.is_ascii_alphanumeric() || "-._~".contains(c));
    if !plain || !TOKEN_LEN.contains(&token.len()) {
        let (from, to) = (TOKEN_LEN.start(), TOKEN_LEN.end());
        return Err(wrong(&format_args!("expected {from} to {to} letters, digits and -._~ on one line")));
    }
    Ok(token.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credentials_are_long_and_readable_by_the_owner_only() {
        let path = std::env::temp_dir().join(format!("advee-token-{}", std::process::id()));
        let read = |text: &str, mode: u32| {
            fs::write(&path, text).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            token(&path)
        };
        assert_eq!(read("0123456789abcdef\n", 0o600).unwrap(), "0123456789abcdef");
        let refused = [("0123456789abcdef", 0o640), ("0123456789abcde", 0o600), ("0123456789 abcdef", 0o600)];
        for (text, mode) in refused {
            assert!(read(text, mode).unwrap_err().starts_with("web.token_file = "), "{text} {mode:o}");
        }
        assert!(read(&"x".repeat(300), 0o600).is_err());
        fs::remove_file(&path).unwrap();
        assert!(token(&path).is_err());
    }
}
