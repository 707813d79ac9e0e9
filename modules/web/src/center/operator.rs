//! `/ws/command`: the command socket of a page. Its messages are bounded, checked against its role and the authority,
//! and executed at once; answers come from the command queue. `POST /api/stop` needs no socket.

use super::access::{Role, Who};
use super::command::{self, Answer, Command, FRAME_MAX, Needs, SCENARIO_FRAME_MAX};
use super::command_queue::QueueHandle;
use super::objects;
use super::publish;
use crate::app::App;
use crate::request::refused;
use crate::socket::is_of_the_line;
use crate::stats::Refusal;
use axum::Extension;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::extract::{RawQuery, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use host::clock;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep_until, timeout};

/// Maximum number of messages in a second; 20 commands, 4 pings and a person's clicks are far below.
const MESSAGES_PER_SECOND_MAX: u32 = 100;
/// Silence after which a page counts as gone: it pings four times a second, and each second in the background.
const SILENCE_MAX: Duration = Duration::from_secs(10);
/// Time without progress after which a page counts as gone.
const STALL_TIMEOUT: Duration = Duration::from_secs(5);
/// Number of refusals after which a page is disconnected.
const REFUSED_MAX: u32 = 100;
/// Timeout of closing a connection.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(200);

/// `/ws/command`
pub async fn upgrade(
    State(app): State<App>,
    Extension(who): Extension<Who>,
    RawQuery(query): RawQuery,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    if query.is_some_and(|query| query.split('&').any(|pair| pair.split('=').next() == Some("demo"))) {
        return refused(StatusCode::FORBIDDEN, "a recorded run is played: nothing can be commanded");
    }
    let Ok(upgrade) = upgrade else {
        app.stats.refuse(Refusal::Protocol, "");
        return refused(StatusCode::BAD_REQUEST, "a WebSocket is expected here");
    };
    let Some(seat) = app.commanders.take(who.role) else {
        app.stats.refuse(Refusal::Viewers, "");
        return refused(StatusCode::SERVICE_UNAVAILABLE, Refusal::Viewers.name());
    };
    let may_send_scenarios = app.command_queue.robot.simulated && who.role >= Role::Engineer;
    let most = if may_send_scenarios { SCENARIO_FRAME_MAX } else { FRAME_MAX };
    upgrade.max_message_size(most).max_frame_size(most).on_upgrade(move |socket| async move {
        let (page, command_queue) = Page::new(app, who);
        page.serve(socket, command_queue).await;
        drop(seat);
    })
}

/// `POST /api/stop`: as the command of the same name, for a device that has no command socket.
pub async fn stop(State(app): State<App>, Extension(who): Extension<Who>) -> Response {
    let (name, source) = names(&who);
    match app.command_queue.stop(name, who.role, source) {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(why) => refused(StatusCode::SERVICE_UNAVAILABLE, &why),
    }
}

/// Name of a user, and its source on the bus.
fn names(who: &Who) -> (Arc<str>, Arc<str>) {
    // A client without a name used the credentials of a program.
    let name: Arc<str> = if who.name.is_empty() { "a program".into() } else { who.name.clone() };
    let source = format!("web:{name}").into();
    (name, source)
}

/// Reason for the end of a page's connection.
enum EndReason {
    /// The page has gone, or does not read.
    Gone,
    /// Disconnected with a close code and a reason.
    Sent(u16, &'static str),
}

/// A page; its holds are released when it is dropped, whatever the cause.
struct Page {
    app: App,
    who: Who,
    id: u32,
    source: Arc<str>,
    tell: tokio::sync::mpsc::Sender<String>,
    /// Number of messages read since this time.
    spoken: (u32, Instant),
    heard: Instant,
    refused: u32,
}

impl Drop for Page {
    fn drop(&mut self) {
        self.app.command_queue.leave(self.id);
        if let Some(device) = self.who.device {
            self.app.session_store.access().disconnect(clock::now(), device);
        }
    }
}

impl Page {
    fn new(app: App, who: Who) -> (Self, tokio::sync::mpsc::Receiver<String>) {
        let (name, source) = names(&who);
        let QueueHandle { id, tell, told } = app.command_queue.join(name, who.role, source.clone());
        if let Some(device) = who.device {
            app.session_store.access().connect(device);
        }
        let now = Instant::now();
        (Self { app, who, id, source, tell, spoken: (0, now), heard: now, refused: 0 }, told)
    }

    async fn serve(mut self, mut socket: WebSocket, mut told: tokio::sync::mpsc::Receiver<String>) {
        let over = self.talk(&mut socket, &mut told).await;
        // Releases its holds before waiting for the network.
        drop(self);
        if let EndReason::Sent(code, reason) = over {
            let farewell = async {
                socket.send(Message::Close(Some(CloseFrame { code, reason: reason.into() }))).await?;
                // Unread input would make the kernel reset the connection before the reason is read.
                while let Some(Ok(_)) = socket.recv().await {}
                Ok::<(), axum::Error>(())
            };
            let _ = timeout(CLOSE_TIMEOUT, farewell).await;
        }
    }

    async fn talk(&mut self, socket: &mut WebSocket, told: &mut tokio::sync::mpsc::Receiver<String>) -> EndReason {
        let (mut end, session_store, device) = (self.app.end.clone(), self.app.session_store.clone(), self.who.device);
        let mut forgotten = std::pin::pin!(session_store.forgotten(device));
        let limits = self.app.command_queue.robot.limits;
        let welcome = Answer::Welcome { you: self.id, name: &self.who.name, role: self.who.role, limits }.text();
        let mut outgoing = Some(welcome);
        loop {
            if let Some(text) = outgoing.take()
                && !matches!(timeout(STALL_TIMEOUT, socket.send(Message::Text(text.into()))).await, Ok(Ok(())))
            {
                return EndReason::Gone;
            }
            tokio::select! {
                biased;
                _ = end.changed() => return EndReason::Sent(close_code::AWAY, "the robot's web server ends"),
                () = &mut forgotten => return EndReason::Sent(close_code::POLICY, "this device is not paired any more"),
                text = told.recv() => match text {
                    Some(text) => outgoing = Some(text),
                    None => return EndReason::Gone,
                },
                said = socket.recv() => match self.hear(said) {
                    Ok(answer) => outgoing = answer,
                    Err(over) => return over,
                },
                () = sleep_until(self.heard + SILENCE_MAX) => {
                    return EndReason::Sent(close_code::POLICY, "nothing was heard for 10 s");
                }
            }
        }
    }

    /// Handles a message of the page; returns the answer.
    fn hear(&mut self, said: Option<Result<Message, axum::Error>>) -> Result<Option<String>, EndReason> {
        let now = Instant::now();
        self.heard = now;
        if now - self.spoken.1 >= Duration::from_secs(1) {
            self.spoken = (0, now);
        }
        self.spoken.0 += 1;
        if self.spoken.0 > MESSAGES_PER_SECOND_MAX {
            self.app.stats.refuse(Refusal::SentAway, "");
            return Err(EndReason::Sent(close_code::POLICY, "more than 100 messages a second"));
        }
        match said {
            None | Some(Ok(Message::Close(_))) => Err(EndReason::Gone),
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(None),
            Some(Ok(Message::Text(text))) => match Command::read(&text) {
                Ok(command) if !command.fits(text.len()) => Err(self.too_long()),
                Err(_) if text.len() > FRAME_MAX => Err(self.too_long()),
                Ok(command) => self.obey(&command),
                Err(malformed) => self.refuse(Refusal::Malformed, malformed.id, &malformed.why, true),
            },
            Some(Ok(Message::Binary(bytes))) if bytes.len() > FRAME_MAX => Err(self.too_long()),
            Some(Ok(Message::Binary(_))) => self.refuse(Refusal::Malformed, None, "text is expected", true),
            Some(Err(error)) if is_of_the_line(&error) => Err(EndReason::Gone),
            Some(Err(error)) => {
                self.app.stats.refuse(Refusal::Frame, &error.to_string());
                Err(EndReason::Sent(close_code::SIZE, "a frame that is too long, or broken"))
            }
        }
    }

    /// The end of a page that sent a frame longer than it may.
    fn too_long(&self) -> EndReason {
        self.app.stats.refuse(Refusal::Frame, "longer than 4 KiB");
        EndReason::Sent(close_code::SIZE, "a frame that is too long, or broken")
    }

    fn obey(&mut self, command: &Command) -> Result<Option<String>, EndReason> {
        let (id, Needs { role, authority }) = (command.id(), command.needs());
        if self.who.role < role {
            let why = match role {
                Role::Engineer => "this is for engineers: pair with their code from the robot's console",
                _ => "this is for operators: pair with the code from the robot's console",
            };
            return self.refuse(Refusal::NotGranted, id, why, false);
        }
        if authority && !self.app.command_queue.holds(self.id) {
            let why = match self.app.command_queue.holder() {
                Some(holder) => format!("{} holds the robot: take over first", holder.name),
                None => "take control of the robot first".into(),
            };
            return self.refuse(Refusal::NotGranted, id, &why, false);
        }
        let (command_queue, me) = (&self.app.command_queue, self.id);
        let mut timestamp = None;
        let done: Result<(), String> = match command {
            Command::Ping { t } => {
                let _ = command_queue.with(|now, authority| authority.ping(now, me, *t));
                return Ok(Some(Answer::Pong { t: *t }.text()));
            }
            Command::Drive { .. } | Command::Zero { .. } => {
                let said = command_queue.with(|now, authority| match (command, command.drive()) {
                    (Command::Zero { hold, seq }, _) => authority.zero(now, me, *hold, *seq),
                    (_, Some(drive)) => authority.drive(now, me, drive),
                    _ => {}
                });
                return match said {
                    Ok(()) => Ok(None),
                    Err(why) => Ok(Some(Answer::Refused { id: None, why: &why }.text())),
                };
            }
            Command::Take { from, .. } => {
                command_queue.with(|now, authority| authority.take(now, me, *from)).and_then(|done| done)
            }
            Command::Release { .. } => {
                command_queue.with(|now, authority| authority.release(now, me)).and_then(|done| done)
            }
            Command::Stop { .. } => command_queue.with(|now, authority| authority.stop(now, me)),
            Command::Resume { .. } => command_queue.with(|now, authority| authority.resume(now, me)),
            Command::Sdo { id, node, index, subindex, data } => {
                match command::sdo(*node, *index, *subindex, data.as_deref()) {
                    Ok(asked) => return Ok(self.ask(*id, asked)),
                    Err(why) => Err(why),
                }
            }
            Command::Publish { channel, message_type, message, .. } => self.publish((channel, message_type), message),
            _ => {
                let message = command::message(command, &command_queue.robot, command_queue.timestamp(), &self.source);
                let message = message.and_then(|message| match command {
                    Command::Scenario { .. } => self.app.publisher.permit(clock::now()).map(|()| message),
                    _ => Ok(message),
                });
                message.and_then(|message| {
                    let Some(message) = message else { return Ok(()) };
                    timestamp = Some(message.timestamp());
                    command_queue.publish(&message)
                })
            }
        };
        match (done, id) {
            (Ok(()), Some(id)) => Ok(Some(Answer::Done { id, timestamp }.text())),
            (Ok(()), None) => Ok(None),
            (Err(why), id) => Ok(Some(Answer::Refused { id, why: &why }.text())),
        }
    }

    /// Publishes a message of an engineer's, given as JSON, and says who did it.
    fn publish(&self, (channel, message_type): (&str, &str), json: &str) -> Result<(), String> {
        let (command_queue, who) = (&self.app.command_queue, &*self.source);
        let stamp = (command_queue.timestamp(), who);
        let bytes = self.app.publisher.message(clock::now(), (channel, message_type), json, stamp)?;
        command_queue.publish_raw(channel, &bytes)?;
        self.app.stats.say(publish::note(who, channel, json));
        Ok(())
    }

    /// Requests an object in parallel; few at a time.
    fn ask(&self, id: i64, asked: messages::lowlevel::CmdSdo) -> Option<String> {
        let Ok(permit) = self.app.objects.clone().try_acquire_owned() else {
            return Some(Answer::Refused { id: Some(id), why: "too many objects are asked for at once" }.text());
        };
        let (url, tell) = (self.app.lcm_url.clone(), self.tell.clone());
        tokio::task::spawn_blocking(move || {
            let answer = objects::ask(&url, id, asked);
            // A page that has gone or does not read is not waited for.
            let _ = tell.try_send(answer);
            drop(permit);
        });
        None
    }

    /// Refuses a message. `nonsense`: its intent is unknown, so its hold ends.
    fn refuse(
        &mut self,
        kind: Refusal,
        id: Option<i64>,
        why: &str,
        nonsense: bool,
    ) -> Result<Option<String>, EndReason> {
        self.app.stats.refuse(kind, why);
        if nonsense {
            let _ = self.app.command_queue.with(|now, authority| authority.nonsense(now, self.id));
        }
        self.refused += 1;
        if self.refused > REFUSED_MAX {
            self.app.stats.refuse(Refusal::SentAway, why);
            return Err(EndReason::Sent(close_code::POLICY, "too much that was refused"));
        }
        Ok(Some(Answer::Refused { id, why }.text()))
    }
}
