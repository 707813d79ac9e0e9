//! Common part of the server's WebSockets: bounds on output, input and waiting.

use super::stats::{Refusal, Stats};
use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use futures_util::SinkExt;
use std::borrow::Cow;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{Instant, sleep_until, timeout};

/// Maximum number of bytes written at a time.
pub const BATCH: usize = 64 << 10;
/// Time without progress after which a client is disconnected.
pub const STALL_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum number of messages read in a second.
const MESSAGES_PER_SECOND_MAX: u32 = 200;
const SECOND: Duration = Duration::from_secs(1);
/// Number of refusals after which a client is disconnected.
const REFUSED_MAX: u32 = 100;
/// Timeout of closing a connection.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(200);

/// Reason for the end of a connection.
pub enum EndReason {
    /// The client has gone, or does not read.
    Gone,
    /// Disconnected with a close code (RFC 6455, 7.4) and a reason.
    Sent(u16, Cow<'static, str>),
}

/// A WebSocket.
pub struct Line {
    socket: WebSocket,
    stats: Arc<Stats>,
    /// Number of messages read since this time.
    spoken: (u32, Instant),
    refused: u32,
}

impl Line {
    /// Creates the connection of a new client.
    pub fn new(socket: WebSocket, stats: Arc<Stats>) -> Self {
        Self { socket, stats, spoken: (0, Instant::now()), refused: 0 }
    }

    /// Sends all messages in one write.
    ///
    /// # Errors
    /// The client has gone, or does not read.
    pub async fn send(&mut self, outgoing: Vec<Message>) -> Result<(), EndReason> {
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
        match timeout(STALL_TIMEOUT, sending).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(EndReason::Gone),
            Err(_) => Err(self.stalled()),
        }
    }

    /// Ends the connection of a client that does not read.
    pub fn stalled(&self) -> EndReason {
        self.stats.refuse(Refusal::SentAway, "");
        EndReason::Gone
    }

    /// Waits for input: texts, bytes and pongs. Cancelling the wait loses nothing.
    ///
    /// # Errors
    /// The client has gone, or sent an invalid frame.
    pub async fn hear(&mut self) -> Result<Message, EndReason> {
        loop {
            if self.spoken.0 >= MESSAGES_PER_SECOND_MAX {
                sleep_until(self.spoken.1 + SECOND).await;
            }
            if self.spoken.1.elapsed() >= SECOND {
                self.spoken = (0, Instant::now());
            }
            let said = self.socket.recv().await;
            self.spoken.0 += 1;
            match said {
                None | Some(Ok(Message::Close(_))) => return Err(EndReason::Gone),
                Some(Ok(Message::Ping(_))) => {}
                Some(Ok(said)) => return Ok(said),
                Some(Err(error)) if is_of_the_line(&error) => return Err(EndReason::Gone),
                Some(Err(error)) => {
                    self.stats.refuse(Refusal::Frame, &error.to_string());
                    return Err(EndReason::Sent(close_code::POLICY, "a frame that is too long or broken".into()));
                }
            }
        }
    }

    /// Counts a refused message; the caller reports the reason.
    ///
    /// # Errors
    /// Too many refusals.
    pub fn refuse(&mut self, kind: Refusal, why: &str) -> Result<(), EndReason> {
        self.stats.refuse(kind, why);
        self.refused += 1;
        if self.refused < REFUSED_MAX {
            return Ok(());
        }
        self.stats.refuse(Refusal::SentAway, why);
        Err(EndReason::Sent(close_code::POLICY, "too much that was refused".into()))
    }

    /// Closes the connection.
    pub async fn close(mut self, over: EndReason) {
        if let EndReason::Sent(code, reason) = over {
            let farewell = Message::Close(Some(CloseFrame { code, reason: reason.as_ref().into() }));
            let _ = timeout(CLOSE_TIMEOUT, self.socket.send(farewell)).await;
        }
    }
}

/// True if the connection broke or ended without a close message.
pub fn is_of_the_line(error: &axum::Error) -> bool {
    let mut cause: Option<&(dyn Error + 'static)> = Some(error);
    while let Some(error) = cause {
        if error.is::<std::io::Error>() || error.to_string().contains("without closing handshake") {
            return true;
        }
        cause = error.source();
    }
    false
}
