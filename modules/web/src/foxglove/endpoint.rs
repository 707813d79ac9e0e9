//! WebSocket of one viewer: its requests are read, the hub's output is written, both bounded.

use super::hub::{Outgoing, ViewerId};
use super::protocol::{self, Refused, Request};
use crate::app::App;
use crate::center::access::Role;
use crate::socket::{BATCH, EndReason, Line};
use crate::stats::Refusal;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::interval;

/// Period of pings, which detect a viewer that has gone.
const PING: Duration = Duration::from_secs(20);

/// `/foxglove`
pub async fn upgrade(State(app): State<App>, upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>) -> Response {
    let upgrade = upgrade.map(|upgrade| upgrade.protocols(protocol::SUBPROTOCOLS));
    let Some(upgrade) = upgrade.ok().filter(|upgrade| upgrade.selected_protocol().is_some()) else {
        return refuse(&app, Refusal::Protocol, StatusCode::BAD_REQUEST);
    };
    let Some(seat) = app.seats.take(Role::Viewer) else {
        return refuse(&app, Refusal::Viewers, StatusCode::SERVICE_UNAVAILABLE);
    };
    upgrade
        .read_buffer_size(4 << 10)
        .write_buffer_size(BATCH)
        .max_write_buffer_size(2 * BATCH + app.message_max)
        .max_message_size(protocol::MESSAGE_MAX)
        .max_frame_size(protocol::MESSAGE_MAX)
        .on_upgrade(move |socket| async move {
            serve(socket, &app).await;
            drop(seat);
        })
}

fn refuse(app: &App, refusal: Refusal, code: StatusCode) -> Response {
    app.stats.refuse(refusal, "");
    (code, format!("{}\n", refusal.name())).into_response()
}

async fn serve(socket: WebSocket, app: &App) {
    let (id, wake) = app.hub().join();
    let mut viewer = Viewer { line: Line::new(socket, app.stats.clone()), app, id };
    let over = viewer.talk(&wake).await;
    app.hub().leave(id);
    viewer.line.close(over).await;
}

struct Viewer<'a> {
    line: Line,
    app: &'a App,
    id: ViewerId,
}

impl Viewer<'_> {
    async fn talk(&mut self, wake: &Notify) -> EndReason {
        let mut end = self.app.end.clone();
        let mut ping = interval(PING);
        let info = protocol::server_info(&self.app.robot, &self.app.session);
        let mut outgoing = vec![Message::Text(info.into())];
        loop {
            if let Err(over) = self.line.send(std::mem::take(&mut outgoing)).await {
                return over;
            }
            tokio::select! {
                said = self.line.hear() => match said.and_then(|said| self.answer(said)) {
                    Ok(answer) => outgoing.extend(answer),
                    Err(over) => return over,
                },
                () = wake.notified() => outgoing.extend(self.app.hub().take(self.id, BATCH).into_iter().map(message)),
                _ = ping.tick() => outgoing.push(Message::Ping(Vec::new().into())),
                _ = end.changed() => return EndReason::Sent(close_code::AWAY, "the robot's web server ends".into()),
            }
        }
    }

    /// Answer to a viewer.
    fn answer(&mut self, said: Message) -> Result<Option<Message>, EndReason> {
        let refused = match said {
            Message::Binary(bytes) => Request::binary(&bytes),
            Message::Text(text) => match Request::text(&text) {
                Ok(request) => match self.obey(request) {
                    Ok(()) => return Ok(None),
                    Err(why) => Refused::Malformed(why),
                },
                Err(refused) => refused,
            },
            _ => return Ok(None),
        };
        let why = refused.to_string();
        let kind = match refused {
            Refused::Malformed(_) => Refusal::Malformed,
            Refused::NotGranted(_) => Refusal::NotGranted,
        };
        self.line.refuse(kind, &why)?;
        Ok(Some(Message::Text(protocol::status_error(&why).into())))
    }

    /// Executes all possible parts of a request; returns the first failure.
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
