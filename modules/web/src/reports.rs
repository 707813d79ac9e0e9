//! What a recorded run contains as a whole: `/api/runs/RUN/events` for its time line, `/api/runs/RUN/summary` in
//! figures, `/api/runs/RUN/report.png` as a picture.
//!
//! For each the whole log is read: one at a time, by a thread that gives way to everything else on the computer.

use super::app::App;
use super::center::Center;
use super::center::events::{self, RunEvents};
use super::center::recorded::Recorded;
use super::center::summaries::RunSummary;
use super::logs;
use super::request::refused;
use super::stats::Refusal;
use axum::extract::{Path as Named, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use host::sys;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::time::timeout;

/// Maximum length of a run that is read as a whole, bytes.
const BYTES_MAX: u64 = 2 << 30;
/// Nice value of the thread that reads.
const NICE: i8 = 10;
/// Maximum time for which a request waits while another run is read; the page asks for summaries in the background.
const WAIT_MAX: Duration = Duration::from_secs(20);

/// `/api/runs/{run}/events`
pub async fn events(State(app): State<App>, Named(run): Named<String>) -> Response {
    let center = app.center.clone();
    let read = move |folder: PathBuf, bytes| json(&scanned(&center, &folder, bytes)?.0);
    answer(&app, &run, "application/json", read).await
}

/// `/api/runs/{run}/summary`
pub async fn summary(State(app): State<App>, Named(run): Named<String>) -> Response {
    let center = app.center.clone();
    let read = move |folder: PathBuf, bytes| match center.summaries.get(&name(&folder), bytes) {
        Some(known) => json(&known),
        None => json(&scanned(&center, &folder, bytes)?.1),
    };
    answer(&app, &run, "application/json", read).await
}

/// Reads the run, and keeps its summary.
fn scanned(center: &Center, folder: &Path, bytes: u64) -> Result<(RunEvents, RunSummary), String> {
    let recorded = Recorded::open(&center.logs, &name(folder), center.recorded, &center.scene)?;
    let found = events::of(&recorded).map_err(|error| format!("the run cannot be read: {error}"))?;
    center.summaries.keep(name(folder), bytes, found.1.clone());
    Ok(found)
}

fn json(what: &impl Serialize) -> Result<Vec<u8>, String> {
    serde_json::to_vec(what).map_err(|error| error.to_string())
}

/// `/api/runs/{run}/report.png`
pub async fn picture(State(app): State<App>, Named(run): Named<String>) -> Response {
    let picture = app.center.picture;
    answer(&app, &run, "image/png", move |folder, _| picture(&folder)).await
}

fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// What `read` makes of the folder of a listed run and the length of its files, bytes.
async fn answer(
    app: &App,
    run: &str,
    content: &'static str,
    read: impl FnOnce(PathBuf, u64) -> Result<Vec<u8>, String> + Send + 'static,
) -> Response {
    let Ok(Ok(permit)) = timeout(WAIT_MAX, app.center.reads.clone().acquire_owned()).await else {
        app.stats.refuse(Refusal::Reads, "");
        return refused(StatusCode::SERVICE_UNAVAILABLE, Refusal::Reads.name());
    };
    let (folder, run) = (app.center.logs.clone(), run.to_owned());
    let (tell, told) = tokio::sync::oneshot::channel();
    let work = move || {
        // On Linux this applies to the calling thread only.
        let _ = sys::set_nice(NICE);
        let listed = logs::runs(&folder, None).into_iter().find(|listed| listed.run == run);
        let done = match listed {
            None => Err((StatusCode::NOT_FOUND, "there is no such run; /api/logs has all".to_owned())),
            Some(listed) if listed.bytes() > BYTES_MAX => {
                let why = format!("the run is longer than {} GiB; advee plot draws it", BYTES_MAX >> 30);
                Err((StatusCode::UNPROCESSABLE_ENTITY, why))
            }
            Some(listed) => {
                read(folder.join(&run), listed.bytes()).map_err(|why| (StatusCode::UNPROCESSABLE_ENTITY, why))
            }
        };
        // Before the answer: whoever has it may ask for the next one. Whoever asked may have gone.
        drop(permit);
        let _ = tell.send(done);
    };
    let started = std::thread::Builder::new().name("report".into()).spawn(work);
    match (started, told.await) {
        (Ok(_), Ok(Ok(bytes))) => ([(header::CONTENT_TYPE, content)], bytes).into_response(),
        (Ok(_), Ok(Err((code, why)))) => refused(code, &why),
        _ => refused(StatusCode::INTERNAL_SERVER_ERROR, "the run cannot be read"),
    }
}
