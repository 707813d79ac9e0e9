//! `/ws/view`: the WebSocket of a viewer, which receives the newest parts, each once, and selects the channels to
//! watch.
//!
//! An update that waits in a network queue would be taken for current. So a ping follows every few updates, which
//! browsers answer by themselves, and while two of them are unanswered no update is sent: at most `UPDATES_PER_PING`
//! × `UNANSWERED_PINGS_MAX` updates, 0.6 s, are on their way to a viewer.

use super::access::Who;
use super::inspect::ALL;
use super::view_publisher::ViewPublisher;
use super::{Center, demo};
use crate::app::App;
use crate::request::refused;
use crate::socket::{BATCH, EndReason, Line, STALL_TIMEOUT};
use crate::stats::Refusal;
use axum::Extension;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::{StatusCode, Uri};
use axum::response::Response;
use demo::{Play, Request};
use serde::Deserialize;
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until};

/// Maximum length of a viewer's message, bytes.
const MESSAGE_MAX: usize = 4 << 10;
/// Maximum number of channels that a viewer may watch.
const WATCHED_MAX: usize = 8;
/// Maximum length of a channel's name (LCM).
const NAME_MAX: usize = 63;
/// Number of updates between two pings.
const UPDATES_PER_PING: u32 = 3;
/// Maximum number of unanswered pings.
const UNANSWERED_PINGS_MAX: u32 = 2;
/// Size of the write buffer, bytes: the longest message shown as JSON, with reserve.
const WRITE_BUFFER_MAX: usize = 2 << 20;

/// `/ws/view`
pub async fn upgrade(
    State(app): State<App>,
    Extension(who): Extension<Who>,
    uri: Uri,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let Ok(upgrade) = upgrade else {
        return refuse(&app, Refusal::Protocol, StatusCode::BAD_REQUEST);
    };
    let Some(seat) = app.seats.take(who.role) else {
        return refuse(&app, Refusal::Viewers, StatusCode::SERVICE_UNAVAILABLE);
    };
    let demo = demo_of(&uri);
    upgrade
        .read_buffer_size(MESSAGE_MAX)
        .write_buffer_size(BATCH)
        .max_write_buffer_size(WRITE_BUFFER_MAX)
        .max_message_size(MESSAGE_MAX)
        .max_frame_size(MESSAGE_MAX)
        .on_upgrade(move |socket| async move {
            tokio::select! {
                () = serve(socket, &app, demo) => {}
                // Its new role takes effect when it reconnects.
                () = app.session_store.forgotten(who.device) => {}
            }
            drop(seat);
        })
}

fn refuse(app: &App, refusal: Refusal, code: StatusCode) -> Response {
    app.stats.refuse(refusal, "");
    refused(code, refusal.name())
}

async fn serve(socket: WebSocket, app: &App, demo: Option<String>) {
    let mut line = Line::new(socket, app.stats.clone());
    let over = match demo {
        None => talk(&mut line, app, &app.center.show, app.center.scene.json(), None).await,
        Some(run) => play(&mut line, app, &run).await,
    };
    line.close(over).await;
}

/// Plays a recorded run.
async fn play(line: &mut Line, app: &App, run: &str) -> EndReason {
    let Center { demos, config, .. } = &*app.center;
    let Ok(permit) = demos.clone().try_acquire_owned() else {
        return EndReason::Sent(close_code::AGAIN, "as many recorded runs are played as may be at once".into());
    };
    let run = match demo::open(&app.center, run, permit).await {
        Ok(run) => run,
        // Maximum length of a reason, bytes (RFC 6455, 5.5).
        Err(why) => return EndReason::Sent(close_code::POLICY, why.chars().take(120).filter(char::is_ascii).collect()),
    };
    // A run is played by its timestamps, however fast time passed when it was recorded.
    let config = diagnostics::Config { simulated: false, ..config.clone() };
    let show = ViewPublisher::new(config.clone());
    let scene = run.scene.json();
    let (player, requests) = watch::channel(Request::default());
    tokio::select! {
        over = talk(line, app, &show, scene, Some(&player)) => over,
        over = run.play(&show, &config, requests) => over,
    }
}

/// Requested run, if any.
fn demo_of(uri: &Uri) -> Option<String> {
    let pairs = uri.query().unwrap_or_default().split('&');
    pairs
        .map(|pair| pair.split_once('=').unwrap_or((pair, "")))
        .find(|(key, _)| *key == "demo")
        .map(|(_, run)| run.into())
}

/// Serves the viewer to its end. `player`: plays the recorded run that is shown.
async fn talk(
    line: &mut Line,
    app: &App,
    show: &ViewPublisher,
    scene: String,
    player: Option<&watch::Sender<Request>>,
) -> EndReason {
    let (mut turns, mut place) = show.join();
    let mut end = app.end.clone();
    let mut flow = Flow::new();
    let mut outgoing = vec![Message::Text(scene.into())];
    let over = loop {
        if let Err(over) = line.send(std::mem::take(&mut outgoing)).await {
            break over;
        }
        tokio::select! {
            said = line.hear() => match said.and_then(|said| hear(line, said, &mut flow, player.is_some())) {
                Ok(Some(Said::Watch(Watch { watch }))) => show.watch(&mut place, watch),
                Ok(Some(Said::Play(play))) => if let Some(player) = player {
                    player.send_modify(|request| request.add(play));
                },
                Ok(None) => {}
                Err(over) => break over,
            },
            _ = turns.changed(), if flow.is_free() => {
                outgoing.extend(show.news(&mut place).into_iter().map(Message::Text));
                outgoing.extend(flow.sent());
            }
            () = sleep_until(flow.asked_at + STALL_TIMEOUT), if !flow.is_free() => break line.stalled(),
            _ = end.changed() => break EndReason::Sent(close_code::AWAY, "the robot's web server ends".into()),
        }
    };
    show.leave(place);
    over
}

/// Updates on their way to a viewer.
struct Flow {
    pictures: u32,
    /// Number of pings sent, and of the last one answered.
    asked: u32,
    answered: u32,
    asked_at: Instant,
}

impl Flow {
    fn new() -> Self {
        Self { pictures: 0, asked: 0, answered: 0, asked_at: Instant::now() }
    }

    /// True if more may be sent.
    fn is_free(&self) -> bool {
        self.asked.wrapping_sub(self.answered) < UNANSWERED_PINGS_MAX
    }

    /// Counts a sent update; returns the ping that follows it, if due.
    fn sent(&mut self) -> Option<Message> {
        self.pictures += 1;
        if self.pictures < UPDATES_PER_PING {
            return None;
        }
        (self.pictures, self.asked, self.asked_at) = (0, self.asked.wrapping_add(1), Instant::now());
        Some(Message::Ping(self.asked.to_be_bytes().to_vec().into()))
    }

    /// A ping was answered, and so are those before it (RFC 6455, 5.5.3). Unknown numbers are ignored.
    fn answered(&mut self, payload: &[u8]) {
        let Ok(number) = <[u8; 4]>::try_from(payload).map(u32::from_be_bytes) else { return };
        if self.asked.wrapping_sub(number) < self.asked.wrapping_sub(self.answered) {
            self.answered = number;
        }
    }
}

/// Page to `/ws/view`: the channels whose messages it is sent, at most eight, and `*` for the latest messages of all;
/// replaces the list before.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Watch {
    watch: Vec<String>,
}

/// Message of a viewer.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(untagged)]
enum Said {
    Watch(Watch),
    Play(Play),
}

/// Parses the message of a viewer, who may play a recorded run or not.
fn hear(line: &mut Line, said: Message, flow: &mut Flow, plays: bool) -> Result<Option<Said>, EndReason> {
    let asked = match said {
        Message::Pong(payload) => {
            flow.answered(&payload);
            return Ok(None);
        }
        Message::Text(text) => parse(&text, plays),
        _ => Err("no text".into()),
    };
    match asked {
        Ok(said) => Ok(Some(said)),
        Err(why) => line.refuse(Refusal::Malformed, &why).map(|()| None),
    }
}

fn parse(text: &str, plays: bool) -> Result<Said, String> {
    let mut said = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let valid = match &mut said {
        Said::Watch(Watch { watch }) => {
            watch.sort_unstable();
            watch.dedup();
            let is_name = |name: &String| (1..=NAME_MAX).contains(&name.len());
            let channels = watch.iter().filter(|name| *name != ALL).count();
            channels <= WATCHED_MAX && watch.iter().all(is_name)
        }
        Said::Play(play) => plays && play.is_valid(),
    };
    match valid {
        true => Ok(said),
        false => {
            Err(format!("expected {WATCHED_MAX} channels at most, of 1 to {NAME_MAX} bytes each, or how to play a run"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_wait_for_answers() {
        let mut flow = Flow::new();
        let pings: Vec<_> = (0..6).filter_map(|_| flow.sent()).collect();
        assert!(pings.len() == 2 && !flow.is_free());
        for strange in [&b""[..], b"\0\0\0\x03", b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\0\x01\0"] {
            flow.answered(strange);
            assert!(!flow.is_free(), "{strange:?}");
        }
        flow.answered(&2u32.to_be_bytes());
        assert!(flow.is_free() && flow.answered == 2);
        flow.answered(&1u32.to_be_bytes());
        assert_eq!(flow.answered, 2, "an old answer takes nothing back");
    }

    #[test]
    fn a_viewer_may_watch_some_channels_and_play_a_recorded_run() {
        let watched = |text: &str| match parse(text, false) {
            Ok(Said::Watch(Watch { watch })) => Some(watch),
            _ => None,
        };
        assert_eq!(watched(r#"{"watch":["B","A","B"]}"#), Some(vec!["A".into(), "B".into()]));
        assert_eq!(watched(r#"{"watch":[]}"#), Some(vec![]));
        let most = format!(r#"{{"watch":["*",{}]}}"#, r#""A","B","C","D","E","F","G","H""#);
        assert_eq!(watched(&most).map(|names| names.len()), Some(9));
        let long = format!(r#"{{"watch":["{}"]}}"#, "x".repeat(64));
        let many = format!(r#"{{"watch":{:?}}}"#, (0..9).map(|n| n.to_string()).collect::<Vec<_>>());
        for wrong in [&long, &many, "", "[]", "{}", r#"{"watch":"A"}"#, r#"{"watch":[""]}"#, r#"{"watch":[],"x":1}"#] {
            assert!(parse(wrong, true).is_err(), "{wrong}");
        }
        let play = r#"{"rate":2,"at":31.5}"#;
        assert!(matches!(parse(play, true), Ok(Said::Play(_))));
        assert!(parse(play, false).is_err(), "nothing is played to who looks at the live robot");
    }
}
