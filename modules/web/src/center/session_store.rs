//! Storage of sessions, codes on demand, and source of randomness: [`super::access`] with a clock and files.
//!
//! All in `RUN_FOLDER/web`, readable by its owner only. `server-PORT` is there while a server runs. A user of the
//! robot's own computer asks for codes by a file `ask-PORT-NUMBER`; the server answers by `codes-PORT-NUMBER`, which is
//! deleted once it has been read (`advee web code`). `sessions-PORT.json` has digests of the keys of paired devices,
//! for the next start. A separate thread serves the files, so that neither the server nor the module waits for a disk.

use super::access::{Access, Chance, Codes, IDLE_MAX, Role, Session};
use crate::request::without_port;
use base::Duration;
use host::clock;
use serde::{Deserialize, Serialize};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Maximum size of a file that is read, bytes.
const FILE_MAX: u64 = 64 << 10;
/// Minimum interval of storing the last use of a device, s.
const LAST_USE_PERIOD: u64 = 60;
/// Period of checks for something to write, and for a user who asks for codes.
const WRITE_PERIOD: Duration = Duration::from_millis(500);
/// Time within which a server answers a request for codes, and interval of checks for the answer.
const ANSWER_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(3);
const ANSWER_PERIOD: std::time::Duration = std::time::Duration::from_millis(50);
/// Maximum number of requests for codes answered at a time.
const ASKED_MAX: usize = 16;
/// Maximum number of write failures that wait to be reported.
const FAILED_MAX: usize = 4;

/// A session in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredSession {
    id: u32,
    digest: String,
    name: String,
    role: Role,
    /// Last use, s since the UNIX epoch.
    seen: u64,
}

/// Answer to `advee web code`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShownCodes {
    /// Address of the server.
    pub address: String,
    /// Code of an operator, eight digits.
    pub operator: String,
    /// Code of an engineer, eight digits.
    pub engineer: String,
    /// Time for which both pair, s.
    pub valid_s: u64,
}

impl ShownCodes {
    /// Link that pairs a browser at once.
    #[must_use]
    pub fn link(&self, code: &str) -> String {
        format!("http://{}/#{code}", self.address)
    }

    /// True if other devices may reach the server at its address, which is a name, or neither loopback nor `0.0.0.0`.
    #[must_use]
    pub fn is_reachable(&self) -> bool {
        let here = |address: SocketAddr| address.ip().is_loopback() || address.ip().is_unspecified();
        !self.address.parse().is_ok_and(here)
    }
}

/// Codes and sessions, and their storage.
pub struct SessionStore {
    access: Mutex<Access>,
    chance: File,
    address: String,
    folder: PathBuf,
    port: u16,
    sessions: PathBuf,
    inner: Mutex<Inner>,
    wake: Condvar,
    ended: watch::Sender<()>,
}

impl SessionStore {
    /// Restores paired devices. If the stored ones are invalid, no device is paired, and a line
    /// reports that.
    ///
    /// # Errors
    /// The folder cannot be created, or the kernel provides no random bytes.
    pub fn open(run: &Path, at: SocketAddr, hosts: &[String]) -> Result<(Self, Option<String>), String> {
        let folder = run.join("web");
        let named = |error: io::Error| format!("{}: {error}", folder.display());
        DirBuilder::new().recursive(true).mode(0o700).create(&folder).map_err(named)?;
        let chance = File::open("/dev/urandom").map_err(|error| format!("/dev/urandom: {error}"))?;
        draw(&chance).map_err(|error| format!("/dev/urandom: {error}"))?;
        let sessions = folder.join(format!("sessions-{}.json", at.port()));
        let (kept, broken) = match read(&sessions) {
            Ok(kept) => (kept, None),
            Err(why) => (Vec::new(), Some(format!("{}: {why}: all must be paired anew", sessions.display()))),
        };
        let (now, wall) = (clock::now(), seconds());
        let session = |kept: &StoredSession| {
            let idle = Duration::from_secs(wall.saturating_sub(kept.seen)).min(IDLE_MAX);
            Session::kept(kept.id, kept.digest.clone(), &kept.name, kept.role, now - idle)
        };
        let access = Access::new(now, kept.iter().map(session).collect());
        let address = match hosts.first() {
            Some(host) if !at.ip().is_loopback() => format!("{host}:{}", at.port()),
            _ => at.to_string(),
        };
        let session_store = Self {
            access: Mutex::new(access),
            chance,
            address,
            folder,
            port: at.port(),
            sessions,
            inner: Mutex::new(Inner { kept, failed: Vec::new(), closed: false }),
            wake: Condvar::new(),
            ended: watch::channel(()).0,
        };
        let server = session_store.file("server");
        write(&server, &session_store.address).map_err(|error| format!("{}: {error}", server.display()))?;
        Ok((session_store, broken))
    }

    /// Path of a file of this server.
    fn file(&self, kind: &str) -> PathBuf {
        self.folder.join(format!("{kind}-{}", self.port))
    }

    /// Paired devices, locked.
    pub fn access(&self) -> MutexGuard<'_, Access> {
        self.access.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Random bytes of the kernel.
    ///
    /// # Errors
    /// The kernel provides none.
    pub fn chance(&self) -> io::Result<Chance> {
        draw(&self.chance)
    }

    /// Waits until a device is no longer paired; forever for one that never was.
    pub async fn forgotten(&self, device: Option<u32>) {
        let mut ended = self.ended.subscribe();
        while device.is_none_or(|device| self.access().is_paired(device)) {
            // The sender lives as long as this object.
            let _ = ended.changed().await;
        }
    }

    /// Ends a session; true if it existed.
    pub fn forget(&self, device: u32) -> bool {
        let forgotten = self.access().forget(device);
        self.ended.send_replace(());
        forgotten
    }

    /// Reports of write failures, one line each.
    pub fn news(&self) -> Vec<String> {
        std::mem::take(&mut self.inner().failed)
    }

    /// Codes that pair now, in a line for a person at the robot's own terminal; nothing else may show it.
    pub fn invitation(&self) -> Option<String> {
        let shown = self.codes()?;
        let [operator, engineer] = [&shown.operator, &shown.engineer].map(|code| spaced(code));
        Some(format!(
            "to pair a device within 10 minutes: operator code {operator}, engineer code {engineer}, engineer link {}; \
             later: advee web code",
            shown.link(&shown.engineer)
        ))
    }

    /// Codes that pair now; `None` without randomness.
    fn codes(&self) -> Option<ShownCodes> {
        let chance = self.chance().ok()?;
        let Codes { operator, engineer, valid } = self.access().codes(clock::now(), &chance);
        Some(ShownCodes { address: self.address.clone(), operator, engineer, valid_s: valid.as_secs() })
    }

    /// Link that pairs by a code: at the page's own address, as that is where the browser that asks reached the server;
    /// if that is a loopback address, at the server's. `None` if that is one, too: a phone does not reach it.
    pub fn link(&self, page: Option<&str>, code: &str) -> Option<String> {
        let server = ShownCodes { address: self.address.clone(), ..ShownCodes::default() };
        match page.filter(|page| !is_loopback(page)) {
            Some(page) => Some(format!("{page}/#{code}")),
            None => server.is_reachable().then(|| server.link(code)),
        }
    }

    /// Answers requests for codes.
    fn answer(&self) -> Vec<String> {
        let prefix = format!("ask-{}-", self.port);
        let mut failed = Vec::new();
        for name in names(&self.folder, &prefix).into_iter().take(ASKED_MAX) {
            let number = name.strip_prefix(&prefix).unwrap_or_default();
            let answer = self.folder.join(format!("codes-{}-{number}", self.port));
            let result = fs::remove_file(self.folder.join(&name)).and_then(|()| match self.codes() {
                Some(codes) => write(&answer, &serde_json::to_string(&codes)?),
                None => Err(io::ErrorKind::NotFound.into()),
            });
            failed.extend(result.err().map(|error| format!("{}: {error}", answer.display())));
        }
        failed
    }

    /// Writes changes until [`Self::close`]; runs on a separate thread, because disks are slow.
    pub fn keep(&self) {
        let mut written = self.inner().kept.clone();
        let mut closed = false;
        while !closed {
            let mut failed = self.write(&mut written);
            failed.extend(self.answer());
            let mut inner = self.inner();
            inner.failed.extend(failed);
            inner.failed.truncate(FAILED_MAX);
            if !inner.closed {
                inner = self.wake.wait_timeout(inner, WRITE_PERIOD).unwrap_or_else(PoisonError::into_inner).0;
            }
            closed = inner.closed;
        }
        let _ = self.write(&mut written);
        self.clear();
    }

    /// The server has ended; [`Self::keep`] writes a last time and returns.
    pub fn close(&self) {
        self.inner().closed = true;
        self.wake.notify_all();
    }

    fn write(&self, written: &mut Vec<StoredSession>) -> Vec<String> {
        let sessions = {
            let access = self.access();
            let (now, wall) = (clock::now(), seconds());
            let kept = |session: &Session| StoredSession {
                id: session.id,
                digest: session.digest.clone(),
                name: session.name.to_string(),
                role: session.role,
                seen: wall.saturating_sub(now.since(session.used).as_secs()),
            };
            access.sessions().iter().map(kept).collect::<Vec<_>>()
        };
        if !differ(&sessions, written) {
            return Vec::new();
        }
        let text = serde_json::to_string(&sessions);
        let result = text.map_err(io::Error::from).and_then(|text| self::write(&self.sessions, &text));
        *written = sessions;
        result.err().map(|error| format!("{}: {error}", self.sessions.display())).into_iter().collect()
    }

    /// Deletes the files of this server, those of sessions only if no device is paired.
    fn clear(&self) {
        let port = self.port;
        let asked = [format!("ask-{port}-"), format!("codes-{port}-")];
        let asked = asked.iter().flat_map(|prefix| names(&self.folder, prefix));
        asked.chain([format!("server-{port}")]).for_each(|name| drop(fs::remove_file(self.folder.join(name))));
        if self.access().sessions().is_empty() {
            let _ = fs::remove_file(&self.sessions);
        }
        // Another server may have its files there.
        let _ = fs::remove_dir(&self.folder);
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// State shared by the module's thread and the writing one.
struct Inner {
    /// Devices stored at the start.
    kept: Vec<StoredSession>,
    failed: Vec<String>,
    closed: bool,
}

/// Asks the servers of a run folder for the codes that pair a device.
///
/// # Errors
/// One line: a running server cannot be asked.
pub fn ask(run: &Path) -> Result<Vec<ShownCodes>, String> {
    let folder = run.join("web");
    let number = format!("{:x}-{:x}", std::process::id(), clock::wall());
    let mut answers = Vec::new();
    for server in names(&folder, "server-") {
        let port = server.strip_prefix("server-").unwrap_or_default();
        let [asked, answer] = ["ask", "codes"].map(|kind| folder.join(format!("{kind}-{port}-{number}")));
        write(&asked, "").map_err(|error| format!("{}: {error}", asked.display()))?;
        answers.push((asked, answer));
    }
    let begun = std::time::Instant::now();
    let mut shown = Vec::new();
    for (asked, answer) in answers {
        loop {
            if let Ok(text) = bounded(&answer) {
                let _ = fs::remove_file(&answer);
                shown.extend(serde_json::from_str(&text).ok());
                break;
            }
            if begun.elapsed() > ANSWER_TIMEOUT {
                // The server was killed.
                let _ = fs::remove_file(&asked);
                break;
            }
            std::thread::sleep(ANSWER_PERIOD);
        }
    }
    Ok(shown)
}

/// Names of the files in a folder that begin with a prefix and are not being written, in order.
fn names(folder: &Path, prefix: &str) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| name.starts_with(prefix) && !name.ends_with(".new")).collect();
    names.sort();
    names
}

/// A code, grouped for reading.
#[must_use]
pub fn spaced(code: &str) -> String {
    match code.split_at_checked(4) {
        Some((first, rest)) => format!("{first} {rest}"),
        None => code.into(),
    }
}

fn differ(now: &[StoredSession], before: &[StoredSession]) -> bool {
    let same = |(a, b): (&StoredSession, &StoredSession)| {
        a.id == b.id && a.digest == b.digest && a.seen.abs_diff(b.seen) < LAST_USE_PERIOD
    };
    now.len() != before.len() || !now.iter().zip(before).all(same)
}

fn draw(mut chance: &File) -> io::Result<Chance> {
    let mut drawn = Chance::default();
    chance.read_exact(&mut drawn)?;
    Ok(drawn)
}

fn seconds() -> u64 {
    clock::wall() / 1_000_000_000
}

fn bounded(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    File::open(path)?.take(FILE_MAX).read_to_string(&mut text)?;
    Ok(text)
}

fn read(path: &Path) -> Result<Vec<StoredSession>, String> {
    match bounded(path) {
        Ok(text) => serde_json::from_str(&text).map_err(|error| error.to_string()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error.to_string()),
    }
}

/// Replaces a file atomically, readable by its owner only.
fn write(path: &Path, text: &str) -> io::Result<()> {
    let fresh = path.with_extension("new");
    match fs::remove_file(&fresh) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&fresh)?;
    file.write_all(text.as_bytes())?;
    fs::rename(&fresh, path)
}

/// True for the origin of a page that only this computer reaches.
fn is_loopback(origin: &str) -> bool {
    let host = origin.split_once("://").map_or(origin, |(_, host)| host);
    let name = without_port(host).trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("advee-keeper-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        folder
    }

    const AT: &str = "127.0.0.1:8080";

    #[test]
    fn a_restarted_server_keeps_its_sessions_and_no_codes() {
        let run = folder("restart");
        let open = || SessionStore::open(&run, AT.parse().unwrap(), &[]).unwrap();
        let closed = |session_store: &SessionStore| {
            session_store.close();
            session_store.keep();
        };
        let (session_store, broken) = open();
        assert_eq!((broken, session_store.news()), (None, Vec::new()), "codes are in no report");
        let codes = session_store.codes().unwrap();
        let invitation = session_store.invitation().unwrap();
        assert!(invitation.contains(&format!("http://{AT}/#{}", codes.engineer)), "{invitation}");
        let mut written = Vec::new();
        let chance = session_store.chance().unwrap();
        let from = "10.0.0.1".parse().unwrap();
        let paired = session_store.access().pair(clock::now(), from, &codes.operator, "phone", &chance);
        let (key, who) = paired.unwrap();
        assert!(session_store.write(&mut written).is_empty());
        let file = run.join("web/sessions-8080.json");
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        assert!(!fs::read_to_string(&file).unwrap().contains(&key), "only its digest is stored");
        drop(session_store);
        let (session_store, _) = open();
        assert_eq!(session_store.access().who(clock::now(), &key), Some(who));
        assert_ne!(session_store.codes().unwrap().engineer, codes.engineer);
        closed(&session_store);
        assert!(ask(&run).unwrap().is_empty() && run.join("web/sessions-8080.json").exists());
        let (session_store, _) = open();
        assert!(session_store.forget(1) && !session_store.forget(1));
        closed(&session_store);
        assert!(!run.join("web").exists(), "nothing is left");
        fs::remove_dir_all(run).unwrap();
    }

    #[test]
    fn codes_are_made_for_who_asks_on_the_robot_s_computer() {
        let run = folder("ask");
        let session_store = SessionStore::open(&run, AT.parse().unwrap(), &[]).unwrap().0;
        std::thread::scope(|scope| {
            let keeps = scope.spawn(|| session_store.keep());
            let (shown, again) = (ask(&run).unwrap(), ask(&run).unwrap());
            let left = names(&run.join("web"), "");
            // Before what may panic: the scope waits for the thread.
            session_store.close();
            keeps.join().unwrap();
            assert_eq!((shown.len(), shown[0].address.as_str(), shown[0].valid_s), (1, AT, 600));
            let codes = |shown: &[ShownCodes]| (shown[0].operator.clone(), shown[0].engineer.clone());
            assert_eq!(codes(&shown), codes(&again), "the same while they are fresh");
            assert_eq!(left, ["server-8080"], "no code is on the disk");
        });
        assert!(!run.join("web").exists());
        fs::remove_dir_all(run).unwrap();
    }

    #[test]
    fn a_link_leads_to_where_other_devices_reach_the_server_or_there_is_none() {
        let run = folder("link");
        let link = |at: &str, hosts: &[String], page| {
            let store = SessionStore::open(&run, at.parse().unwrap(), hosts).unwrap().0;
            store.link(page, "12345678")
        };
        let named = ["robot.local".to_owned()];
        let there = Some("http://robot.local:8080/#12345678".to_owned());
        assert_eq!(link(AT, &[], Some("https://robot.example")), Some("https://robot.example/#12345678".into()));
        for here in ["http://127.0.0.1:8080", "http://[::1]:8080", "http://localhost:8080", "http://Localhost"] {
            assert_eq!(link(AT, &[], Some(here)), None, "{here}");
            assert_eq!(link("192.168.1.7:8080", &named, Some(here)), there, "through a tunnel: {here}");
        }
        assert_eq!(link("0.0.0.0:8080", &[], None), None);
        assert_eq!(link("0.0.0.0:8080", &named, None), there);
        fs::remove_dir_all(run).unwrap();
    }

    #[test]
    fn a_broken_store_is_reported_and_restores_no_session() {
        let run = folder("broken");
        fs::create_dir_all(run.join("web")).unwrap();
        for text in ["", "{}", "[{\"id\":1}]", &"[".repeat(100_000)] {
            fs::write(run.join("web/sessions-8080.json"), text).unwrap();
            let (session_store, broken) = SessionStore::open(&run, AT.parse().unwrap(), &[]).unwrap();
            assert!(broken.unwrap().contains("paired anew") && session_store.access().sessions().is_empty());
        }
        fs::remove_dir_all(run).unwrap();
    }
}
