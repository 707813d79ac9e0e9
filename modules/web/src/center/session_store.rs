//! Storage of codes and sessions, and source of randomness: [`super::access`] with a clock and files.
//!
//! `RUN_FOLDER/web/codes-PORT` is for users on the robot's own machine (`advee web code`), `sessions-PORT.json` for the
//! next start of the server; only their owner may read them. A separate thread writes the files, so that neither the
//! server nor the module waits for a disk.

use super::access::{Access, Chance, Codes, IDLE_MAX, Role, Session};
use base::Duration;
use host::clock;
use serde::{Deserialize, Serialize};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::net::SocketAddr;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;

/// Maximum size of a file that is read, bytes.
const FILE_MAX: u64 = 64 << 10;
/// Minimum interval of storing the last use of a device, s.
const LAST_USE_PERIOD: u64 = 60;
/// Period of checks for something to write.
const WRITE_PERIOD: Duration = Duration::from_millis(500);
/// Maximum number of write failures that wait to be reported.
const FAILED_MAX: usize = 4;

/// A session in the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredSession {
    id: u32,
    key: String,
    name: String,
    role: Role,
    /// Last use, s since the UNIX epoch.
    seen: u64,
}

/// File that `advee web code` reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShownCodes {
    /// Address of the server.
    pub address: String,
    /// Code of an operator, eight digits.
    pub operator: String,
    /// Code of an engineer, eight digits.
    pub engineer: String,
}

impl ShownCodes {
    /// Link that pairs a browser at once.
    #[must_use]
    pub fn link(&self, code: &str) -> String {
        format!("http://{}/#{code}", self.address)
    }
}

/// Codes and sessions, and their storage.
pub struct SessionStore {
    access: Mutex<Access>,
    chance: File,
    address: String,
    codes: PathBuf,
    sessions: PathBuf,
    inner: Mutex<Inner>,
    wake: Condvar,
    ended: watch::Sender<()>,
}

impl SessionStore {
    /// Creates codes and restores paired devices. If the stored ones are invalid, no device is paired, and a line
    /// reports that.
    ///
    /// # Errors
    /// The folder cannot be created, or the kernel provides no random bytes.
    pub fn open(run: &Path, at: SocketAddr, hosts: &[String]) -> Result<(Self, Option<String>), String> {
        let folder = run.join("web");
        let named = |error: io::Error| format!("{}: {error}", folder.display());
        DirBuilder::new().recursive(true).mode(0o700).create(&folder).map_err(named)?;
        let chance = File::open("/dev/urandom").map_err(|error| format!("/dev/urandom: {error}"))?;
        let codes = Codes::new(&draw(&chance).map_err(|error| format!("/dev/urandom: {error}"))?);
        let sessions = folder.join(format!("sessions-{}.json", at.port()));
        let (kept, broken) = match read(&sessions) {
            Ok(kept) => (kept, None),
            Err(why) => (Vec::new(), Some(format!("{}: {why}: all must be paired anew", sessions.display()))),
        };
        let (now, wall) = (clock::now(), seconds());
        let session = |kept: &StoredSession| {
            let idle = Duration::from_secs(wall.saturating_sub(kept.seen)).min(IDLE_MAX);
            Session::kept(kept.id, kept.key.clone(), &kept.name, kept.role, now - idle)
        };
        let access = Access::new(now, codes, kept.iter().map(session).collect());
        let address = match hosts.first() {
            Some(host) if !at.ip().is_loopback() => format!("{host}:{}", at.port()),
            _ => at.to_string(),
        };
        let session_store = Self {
            access: Mutex::new(access),
            chance,
            address,
            codes: folder.join(format!("codes-{}", at.port())),
            sessions,
            inner: Mutex::new(Inner { kept, told: None, failed: Vec::new(), closed: false }),
            wake: Condvar::new(),
            ended: watch::channel(()).0,
        };
        Ok((session_store, broken))
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

    /// Reports, one line each: new codes, and write failures.
    pub fn news(&self) -> Vec<String> {
        let codes = self.access().codes().clone();
        let mut inner = self.inner();
        let mut news = std::mem::take(&mut inner.failed);
        if inner.told.as_ref() != Some(&codes) {
            let shown = self.shown(&codes);
            news.push(format!(
                "to pair a device: code {} for an operator, {} for an engineer, who opens {}",
                spaced(&shown.operator),
                spaced(&shown.engineer),
                shown.link(&shown.engineer)
            ));
            inner.told = Some(codes);
        }
        news
    }

    /// Writes changes until [`Self::close`]; runs on a separate thread, because disks are slow.
    pub fn keep(&self) {
        let mut written = Written { codes: None, sessions: self.inner().kept.clone() };
        let mut closed = false;
        while !closed {
            let failed = self.write(&mut written);
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

    fn write(&self, written: &mut Written) -> Vec<String> {
        let (codes, sessions) = {
            let access = self.access();
            let (now, wall) = (clock::now(), seconds());
            let kept = |session: &Session| StoredSession {
                id: session.id,
                key: session.key.clone(),
                name: session.name.to_string(),
                role: session.role,
                seen: wall.saturating_sub(now.since(session.used).as_secs()),
            };
            (access.codes().clone(), access.sessions().iter().map(kept).collect::<Vec<_>>())
        };
        let mut failed = Vec::new();
        let mut put = |path: &Path, text: serde_json::Result<String>| {
            let result = text.map_err(io::Error::from).and_then(|text| write(path, &text));
            failed.extend(result.err().map(|error| format!("{}: {error}", path.display())));
        };
        if written.codes.as_ref() != Some(&codes) {
            put(&self.codes, serde_json::to_string(&self.shown(&codes)));
            written.codes = Some(codes);
        }
        if differ(&sessions, &written.sessions) {
            put(&self.sessions, serde_json::to_string(&sessions));
            written.sessions = sessions;
        }
        failed
    }

    /// Deletes the codes, and all files if no device is paired.
    fn clear(&self) {
        let _ = fs::remove_file(&self.codes);
        if self.access().sessions().is_empty() {
            let _ = fs::remove_file(&self.sessions);
        }
        if let Some(folder) = self.codes.parent() {
            // Another server may have its files there.
            let _ = fs::remove_dir(folder);
        }
    }

    fn shown(&self, codes: &Codes) -> ShownCodes {
        let Codes { operator, engineer } = codes.clone();
        ShownCodes { address: self.address.clone(), operator, engineer }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// State shared by the module's thread and the writing one.
struct Inner {
    /// Devices stored at the start.
    kept: Vec<StoredSession>,
    told: Option<Codes>,
    failed: Vec<String>,
    closed: bool,
}

/// Content of the files.
struct Written {
    codes: Option<Codes>,
    sessions: Vec<StoredSession>,
}

/// Codes that the servers of a run folder show.
#[must_use]
pub fn shown(run: &Path) -> Vec<ShownCodes> {
    let entries = fs::read_dir(run.join("web")).into_iter().flatten().flatten();
    let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("codes-"));
    let mut paths: Vec<PathBuf> = named.map(|entry| entry.path()).collect();
    paths.sort();
    paths.iter().filter_map(|path| serde_json::from_str(&bounded(path).ok()?).ok()).collect()
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
        a.id == b.id && a.key == b.key && a.seen.abs_diff(b.seen) < LAST_USE_PERIOD
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
    fn a_restarted_server_keeps_its_sessions_and_renews_its_codes() {
        let run = folder("restart");
        let open = || SessionStore::open(&run, AT.parse().unwrap(), &[]).unwrap();
        let closed = |session_store: &SessionStore| {
            session_store.close();
            session_store.keep();
        };
        let (session_store, broken) = open();
        assert_eq!(broken, None);
        let codes = session_store.access().codes().clone();
        let news = session_store.news();
        assert!(news.len() == 1 && news[0].contains(&format!("http://{AT}/#{}", codes.engineer)), "{news:?}");
        assert!(session_store.news().is_empty(), "reported once");
        let mut written = Written { codes: None, sessions: Vec::new() };
        assert!(session_store.write(&mut written).is_empty());
        assert_eq!(shown(&run)[0].operator, codes.operator);
        let chance = session_store.chance().unwrap();
        let (key, who) = session_store.access().pair(clock::now(), &codes.operator, "phone", &chance).unwrap();
        assert_eq!(session_store.news().len(), 1, "the new code");
        assert!(session_store.write(&mut written).is_empty());
        for file in ["codes-8080", "sessions-8080.json"] {
            let mode = fs::metadata(run.join("web").join(file)).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600, "{file}");
        }
        drop(session_store);
        let (session_store, _) = open();
        assert_eq!(session_store.access().who(clock::now(), &key), Some(who));
        assert_ne!(session_store.access().codes(), &codes);
        closed(&session_store);
        assert!(shown(&run).is_empty() && run.join("web/sessions-8080.json").exists());
        let (session_store, _) = open();
        assert!(session_store.forget(1) && !session_store.forget(1));
        closed(&session_store);
        assert!(!run.join("web").exists(), "nothing is left");
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
