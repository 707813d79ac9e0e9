//! One viewer's WebSocket: what it asks for is read, what the hub has for it is written, and either is bounded.

use super::hub::{Outgoing, ViewerId};
use super::protocol::{self, Refused, Request};
use crate::web::router::App;
use crate::web::stats::Refusal;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use futures_util::SinkExt;
use std::error::Error;
use std::time::Duration;
use tokio::time::{Instant, interval, sleep_until, timeout};

/// Written at once, bytes.
const BATCH: usize = 64 << 10;
/// A viewer that takes nothing for so long is sent away.
const STALLED: Duration = Duration::from_secs(30);
/// One that is not there any more is found out by this.
const PING: Duration = Duration::from_secs(20);
/// No more of a viewer's messages than this are read in a second.
const SPOKEN_MAX: u32 = 200;
/// One that was refused so often is sent away.
const REFUSED_MAX: u32 = 100;
/// Saying good-bye takes no longer.
const FAREWELL: Duration = Duration::from_millis(200);

/// `/foxglove`
pub async fn upgrade(State(app): State<App>, upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>) -> Response {
    let upgrade = upgrade.map(|upgrade| upgrade.protocols(protocol::SUBPROTOCOLS));
    let Some(upgrade) = upgrade.ok().filter(|upgrade| upgrade.selected_protocol().is_some()) else {
        return refuse(&app, Refusal::Protocol, StatusCode::BAD_REQUEST);
    };
    let Ok(seat) = app.seats.clone().try_acquire_owned() else {
        return refuse(&app, Refusal::Viewers, StatusCode::SERVICE_UNAVAILABLE);
    };
    upgrade
        .read_buffer_size(4 << 10)
        .write_buffer_size(BATCH)
        .max_write_buffer_size(2 * BATCH + app.message_max)
        .max_message_size(protocol::MESSAGE_MAX)
        .max_frame_size(protocol::MESSAGE_MAX)
        .on_upgrade(move |socket| async move {
            Viewer::new(socket, &app).serve().await;
            drop(seat);
        })
}

fn refuse(app: &App, refusal: Refusal, code: StatusCode) -> Response {
    app.stats.refuse(refusal, "");
    (code, format!("{}\n", refusal.why())).into_response()
}

struct Viewer<'a> {
    socket: WebSocket,
    app: &'a App,
    id: ViewerId,
    /// Messages read since the moment.
    spoken: (u32, Instant),
    refused: u32,
}

/// Why a viewer is not served any longer.
enum Over {
    /// It has gone, or takes nothing.
    Gone,
    /// It is told so.
    Sent(u16, &'static str),
}

impl<'a> Viewer<'a> {
    fn new(socket: WebSocket, app: &'a App) -> Self {
        Self { socket, app, id: 0, spoken: (0, Instant::now()), refused: 0 }
    }

    async fn serve(mut self) {
        let over = self.talk().await;
        self.app.hub().leave(self.id);
        if let Over::Sent(code, reason) = over {
            let farewell = Message::Close(Some(CloseFrame { code, reason: reason.into() }));
            let _ = timeout(FAREWELL, self.socket.send(farewell)).await;
        }
    }

    async fn talk(&mut self) -> Over {
        let (id, wake) = self.app.hub().join();
        self.id = id;
        let mut end = self.app.end.clone();
        let mut ping = interval(PING);
        let info = protocol::server_info(&self.app.robot, &self.app.session);
        let mut outgoing = vec![Message::Text(info.into())];
        loop {
            if let Err(over) = self.send(std::mem::take(&mut outgoing)).await {
                return over;
            }
            let (spoken, since) = self.spoken;
            tokio::select! {
                said = self.socket.recv(), if spoken < SPOKEN_MAX => match self.hear(said) {
                    Ok(answer) => outgoing.extend(answer),
                    Err(over) => return over,
                },
                () = sleep_until(since + Duration::from_secs(1)), if spoken > 0 => self.spoken = (0, Instant::now()),
                () = wake.notified() => outgoing.extend(self.app.hub().take(id, BATCH).into_iter().map(message)),
                _ = ping.tick() => outgoing.push(Message::Ping(Vec::new().into())),
                _ = end.changed() => return Over::Sent(close_code::AWAY, "the robot's web server ends"),
            }
        }
    }

    async fn send(&mut self, outgoing: Vec<Message>) -> Result<(), Over> {
        if outgoing.is_empty() {
            return Ok(());
        }
        let socket = &mut self.socket;
        let sending = async {
            for message in outgoing {
                socket.feed(message).await?;
            }
            socket.flush().await
        };
        match timeout(STALLED, sending).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(Over::Gone),
            Err(_) => {
                self.app.stats.refuse(Refusal::SentAway, "");
                Err(Over::Gone)
            }
        }
    }

    /// What a viewer said, and what it is answered.
    fn hear(&mut self, said: Option<Result<Message, axum::Error>>) -> Result<Option<Message>, Over> {
        if self.spoken.0 == 0 {
            self.spoken.1 = Instant::now();
        }
        self.spoken.0 += 1;
        let refused = match said {
            None | Some(Ok(Message::Close(_))) => return Err(Over::Gone),
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => return Ok(None),
            Some(Ok(Message::Binary(bytes))) => Request::binary(&bytes),
            Some(Ok(Message::Text(text))) => match Request::text(&text) {
                Ok(request) => match self.obey(request) {
                    Ok(()) => return Ok(None),
                    Err(why) => Refused::Malformed(why),
                },
                Err(refused) => refused,
            },
            Some(Err(error)) if is_of_the_line(&error) => return Err(Over::Gone),
            Some(Err(error)) => {
                self.app.stats.refuse(Refusal::Frame, &error.to_string());
                return Err(Over::Sent(close_code::POLICY, "a frame that is too long or broken"));
            }
        };
        let why = refused.to_string();
        let kind = match refused {
            Refused::Malformed(_) => Refusal::Malformed,
            Refused::NotGranted(_) => Refusal::NotGranted,
        };
        self.app.stats.refuse(kind, &why);
        self.refused += 1;
        if self.refused >= REFUSED_MAX {
            self.app.stats.refuse(Refusal::SentAway, &why);
            return Err(Over::Sent(close_code::POLICY, "too much that was refused"));
        }
        Ok(Some(Message::Text(protocol::status_error(&why).into())))
    }

    /// All of it that can be done; the first that cannot.
    fn obey(&self, request: Request) -> Result<(), String> {
        let mut hub = self.app.hub();
        let done: Vec<Result<(), String>> = match request {
            Request::Subscribe(wanted) => wanted.into_iter().map(|wanted| hub.subscribe(self.id, wanted)).collect(),
            Request::Unsubscribe(numbers) => {
                numbers.into_iter().map(|number| hub.unsubscribe(self.id, number)).collect()
            }
        };
        let mut refused = done.into_iter().filter_map(Result::err);
        match (refused.next(), refused.count()) {
            (None, _) => Ok(()),
            (Some(why), 0) => Err(why),
            (Some(why), more) => Err(format!("{why}, and {more} more")),
        }
    }
}

fn message(outgoing: Outgoing) -> Message {
    match outgoing {
        Outgoing::Text(text) => Message::Text(text.into()),
        Outgoing::Binary(bytes) => Message::Binary(bytes.into()),
    }
}

/// Whether it is nothing that the viewer said: the line is broken, or it went without a word.
fn is_of_the_line(error: &axum::Error) -> bool {
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(error) = cause {
        if error.is::<std::io::Error>() || error.to_string().contains("without closing handshake") {
            return true;
        }
        cause = error.source();
    }
    false
}
