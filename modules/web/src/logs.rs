//! Runs on the robot's disk: `/api/logs` lists them, `/api/logs/RUN/FILE` downloads a file.
//!
//! No path is taken from a client: a name is looked up in the listing, and unlisted files do not exist. Links are not
//! followed. A file that is being written is served with its length at the time of the request.

use super::app::App;
use super::request::refused;
use super::stats::Refusal;
use axum::body::{Body, Bytes};
use axum::extract::{Path as Named, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use host::clock;
use nix::fcntl::{OFlag, open, openat};
use nix::sys::stat::Mode;
use serde::Serialize;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use tokio::task::spawn_blocking;

/// Maximum number of runs listed, newest first, and of files in a run.
const RUNS_MAX: usize = 1000;
const FILES_MAX: usize = 200;
/// Maximum length of a name.
const NAME_MAX: usize = 100;
/// Folder in a run whose files are listed too: recorded inputs of the modules.
const INPUTS: &str = "inputs";
/// Maximum number of bytes read at a time.
const PIECE_BYTES: u64 = 128 << 10;

/// A run on the robot's disk. `GET /api/logs` (viewer): all, the newest first; files: `GET /api/logs/RUN/FILE`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Run {
    /// Name.
    pub run: String,
    bytes: u64,
    /// True while it is being recorded.
    pub recording: bool,
    files: Vec<Listed>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct Listed {
    name: String,
    bytes: u64,
}

impl Run {
    /// Length of its files, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Runs of a folder, newest first; `recording` is the one being written. Empty if the folder does not exist.
pub fn runs(folder: &Path, recording: Option<&str>) -> Vec<Run> {
    let mut names: Vec<String> =
        entries(folder).filter(|(name, kind)| kind.is_dir() && is_run(name)).map(|(name, _)| name).collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    names.truncate(RUNS_MAX);
    let run = |name: String| {
        let mut files = listed(&folder.join(&name), "");
        files.extend(listed(&folder.join(&name).join(INPUTS), "inputs/"));
        files.truncate(FILES_MAX);
        let bytes = files.iter().map(|file| file.bytes).sum();
        Run { bytes, recording: recording == Some(name.as_str()), files, run: name }
    };
    names.into_iter().map(run).collect()
}

/// Plain files of a folder, sorted by name; links are skipped.
fn listed(folder: &Path, before: &str) -> Vec<Listed> {
    if !fs::symlink_metadata(folder).is_ok_and(|about| about.is_dir()) {
        return Vec::new();
    }
    let file = |name: String| {
        let about = fs::symlink_metadata(folder.join(&name)).ok().filter(fs::Metadata::is_file)?;
        Some(Listed { bytes: about.len(), name: format!("{before}{name}") })
    };
    let names = entries(folder).filter(|(_, kind)| kind.is_file()).map(|(name, _)| name);
    let mut files: Vec<Listed> = names.filter_map(file).collect();
    files.sort_unstable_by(|a, b| a.name.cmp(&b.name));
    files
}

/// Entries of a folder with plain names.
fn entries(folder: &Path) -> impl Iterator<Item = (String, fs::FileType)> {
    let named = |entry: io::Result<fs::DirEntry>| {
        let entry = entry.ok()?;
        let name = entry.file_name().into_string().ok().filter(|name| is_plain(name))?;
        Some((name, entry.file_type().ok()?))
    };
    fs::read_dir(folder).into_iter().flatten().filter_map(named)
}

fn is_plain(name: &str) -> bool {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    (1..=NAME_MAX).contains(&name.len()) && name.bytes().all(plain) && !name.starts_with('.')
}

/// `YYYY_MM_DD_HH_MM_SS`
fn is_run(name: &str) -> bool {
    let form = |(place, byte): (usize, u8)| match place {
        4 | 7 | 10 | 13 | 16 => byte == b'_',
        _ => byte.is_ascii_digit(),
    };
    name.len() == 19 && name.bytes().enumerate().all(form)
}

/// `/api/logs`
pub async fn list(State(app): State<App>) -> Response {
    let (folder, recording) = (app.center.logs.clone(), app.center.recording(clock::now()));
    let runs = spawn_blocking(move || runs(&folder, recording.as_deref())).await.unwrap_or_default();
    let text = serde_json::to_string(&runs).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// `/api/logs/{run}/{*file}`
pub async fn download(
    State(app): State<App>,
    Named((run, file)): Named<(String, String)>,
    headers: HeaderMap,
) -> Response {
    let Ok(permit) = app.center.downloads.clone().try_acquire_owned() else {
        app.stats.refuse(Refusal::Downloads, "");
        return refused(StatusCode::SERVICE_UNAVAILABLE, Refusal::Downloads.name());
    };
    let folder = app.center.logs.clone();
    let attachment = format!("attachment; filename=\"{run}_{}\"", file.replace('/', "_"));
    let opened = spawn_blocking(move || take(&folder, &run, &file)).await;
    let (mut opened, length) = match opened {
        Ok(Ok(opened)) => opened,
        Ok(Err(error)) if error.kind() == io::ErrorKind::NotFound => {
            return refused(StatusCode::NOT_FOUND, "there is no such file; /api/logs has all");
        }
        _ => return refused(StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read"),
    };
    let asked = headers.get(header::RANGE).and_then(|value| value.to_str().ok());
    let (status, from, to) = match asked.map_or(Asked::All, |asked| range(asked, length)) {
        Asked::All => (StatusCode::OK, 0, length),
        Asked::Part(from, to) => (StatusCode::PARTIAL_CONTENT, from, to),
        Asked::Beyond => {
            let all = [(header::CONTENT_RANGE, format!("bytes */{length}"))];
            return (StatusCode::RANGE_NOT_SATISFIABLE, all).into_response();
        }
    };
    if opened.seek(SeekFrom::Start(from)).is_err() {
        return refused(StatusCode::INTERNAL_SERVER_ERROR, "the file cannot be read");
    }
    let pieces = stream::unfold((Some(opened), to - from, permit), |(file, left, permit)| async move {
        let file = file.filter(|_| left > 0)?;
        let read = spawn_blocking(move || piece(file, left)).await;
        Some(match read.unwrap_or_else(|error| Err(io::Error::other(error))) {
            Ok((file, bytes)) => {
                let left = left - bytes.len() as u64;
                (Ok(bytes), (Some(file), left, permit))
            }
            // Closing the connection marks the download as incomplete.
            Err(error) => (Err(error), (None, 0, permit)),
        })
    });
    let mut answer = (
        status,
        [
            (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
            (header::CONTENT_DISPOSITION, attachment),
            (header::CONTENT_LENGTH, (to - from).to_string()),
            (header::ACCEPT_RANGES, "bytes".to_owned()),
        ],
        Body::from_stream(pieces),
    )
        .into_response();
    if status == StatusCode::PARTIAL_CONTENT
        && let Ok(value) = format!("bytes {from}-{}/{length}", to - 1).parse()
    {
        answer.headers_mut().insert(header::CONTENT_RANGE, value);
    }
    answer
}

/// Opens a listed file; returns its length.
fn take(folder: &Path, run: &str, file: &str) -> io::Result<(File, u64)> {
    let listed = runs(folder, None).into_iter().find(|listed| listed.run == run);
    let is_there = listed.is_some_and(|run| run.files.iter().any(|listed| listed.name == file));
    if !is_there {
        return Err(io::ErrorKind::NotFound.into());
    }
    // Component by component, so that none can become a link meanwhile.
    let into = OFlag::O_DIRECTORY | OFlag::O_CLOEXEC;
    let mut at = open(folder, into, Mode::empty())?;
    let (parents, name) = file.rsplit_once('/').map_or((None, file), |(parent, name)| (Some(parent), name));
    for part in std::iter::once(run).chain(parents) {
        at = openat(&at, part, into | OFlag::O_NOFOLLOW, Mode::empty())?;
    }
    let flags = OFlag::O_RDONLY | OFlag::O_NOFOLLOW | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
    let file = File::from(openat(&at, name, flags, Mode::empty())?);
    let about = file.metadata()?;
    if about.is_file() { Ok((file, about.len())) } else { Err(io::ErrorKind::NotFound.into()) }
}

fn piece(mut file: File, left: u64) -> io::Result<(File, Bytes)> {
    let mut bytes = vec![0; left.min(PIECE_BYTES) as usize];
    file.read_exact(&mut bytes)?;
    Ok((file, bytes.into()))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Asked {
    All,
    /// From the first byte up to, not including, the second.
    Part(u64, u64),
    Beyond,
}

/// A range of bytes (RFC 9110, 14.1.2); several ranges, or other units, are ignored.
fn range(asked: &str, length: u64) -> Asked {
    let Some((from, to)) = asked.strip_prefix("bytes=").and_then(|range| range.trim().split_once('-')) else {
        return Asked::All;
    };
    let (from, to) = match (from.parse::<u64>(), to.parse::<u64>()) {
        (Ok(from), Ok(to)) if from <= to => (from, to.saturating_add(1).min(length)),
        (Ok(from), Err(_)) if to.is_empty() => (from, length),
        (Err(_), Ok(last)) if from.is_empty() => (length.saturating_sub(last), length),
        _ => return Asked::All,
    };
    if from < to { Asked::Part(from, to) } else { Asked::Beyond }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    const OLD: &str = "2026_11_22_09_00_00";
    const NEW: &str = "2026_11_22_10_00_00";

    #[test]
    fn only_listed_files_can_be_downloaded() {
        let folder = std::env::temp_dir().join(format!("advee-weblogs-{}", std::process::id()));
        let write = |path: &str| {
            let path = folder.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "12345").unwrap();
        };
        for path in [
            &format!("{OLD}/log_000.mcap"),
            &format!("{NEW}/log_001.mcap"),
            &format!("{NEW}/log_000.mcap"),
            &format!("{NEW}/inputs/planner"),
            &format!("{NEW}/others/secret"),
            &format!("{NEW}/.hidden"),
            "private/log_000.mcap",
            "secret",
        ] {
            write(path);
        }
        symlink("/etc/passwd", folder.join(OLD).join("passwd")).unwrap();
        symlink("/etc", folder.join(OLD).join("inputs")).unwrap();
        symlink(folder.join(NEW), folder.join("2026_11_22_11_00_00")).unwrap();
        let listed = runs(&folder, Some(NEW));
        let names = |run: &Run| run.files.iter().map(|file| file.name.clone()).collect::<Vec<_>>();
        assert_eq!(
            listed.iter().map(|run| (&*run.run, run.recording)).collect::<Vec<_>>(),
            [(NEW, true), (OLD, false)]
        );
        assert_eq!(names(&listed[0]), ["log_000.mcap", "log_001.mcap", "inputs/planner"]);
        assert_eq!((names(&listed[1]), listed[0].bytes), (vec!["log_000.mcap".to_owned()], 15));
        for (run, files) in [(OLD, vec!["log_000.mcap"]), (NEW, vec!["log_001.mcap", "inputs/planner"])] {
            for file in files {
                assert_eq!(take(&folder, run, file).unwrap().1, 5, "{run} {file}");
            }
        }
        for (run, file) in [
            (OLD, "passwd"),
            (OLD, "inputs/passwd"),
            (OLD, "../secret"),
            (OLD, "../private/log_000.mcap"),
            (OLD, "inputs"),
            (OLD, ""),
            (NEW, ".hidden"),
            (NEW, "others/secret"),
            (NEW, "inputs/../log_000.mcap"),
            (NEW, "/etc/passwd"),
            ("private", "log_000.mcap"),
            ("2026_11_22_11_00_00", "log_000.mcap"),
            ("..", "secret"),
            ("", "secret"),
        ] {
            assert!(take(&folder, run, file).is_err(), "{run} {file}");
        }
        fs::remove_dir_all(&folder).unwrap();
        assert!(runs(&folder, None).is_empty());
    }

    #[test]
    fn byte_ranges_are_parsed() {
        for (asked, got) in [
            ("bytes=0-4", Asked::Part(0, 5)),
            ("bytes=5-", Asked::Part(5, 10)),
            ("bytes=-3", Asked::Part(7, 10)),
            ("bytes=-30", Asked::Part(0, 10)),
            ("bytes=2-99999999999999999999", Asked::All),
            ("bytes=2-18446744073709551615", Asked::Part(2, 10)),
            ("bytes=10-", Asked::Beyond),
            ("bytes=-0", Asked::Beyond),
            ("bytes=4-2", Asked::All),
            ("bytes=0-1,3-4", Asked::All),
            ("lines=1-2", Asked::All),
        ] {
            assert_eq!(range(asked, 10), got, "{asked}");
        }
        assert_eq!(range("bytes=0-0", 0), Asked::Beyond);
    }
}
