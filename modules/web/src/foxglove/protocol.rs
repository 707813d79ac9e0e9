//! Wire format of the WebSocket: stateless encoding and decoding.
//!
//! Protocol: <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>, v1; text is JSON with an `op`, binary
//! begins with an opcode, numbers are little-endian. The names `foxglove.sdk.v1` and `foxglove.websocket.v1` are
//! equivalent if, as here, channels carry their schemas as text.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Names in the WebSocket handshake, in order of preference.
pub const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Maximum length of a client's message, bytes: enough for subscriptions to a thousand channels.
pub const MESSAGE_MAX: usize = 64 << 10;
/// Maximum length of a quotation from a client.
const QUOTED_MAX: usize = 40;

/// Request of a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Messages of these channels.
    Subscribe(Vec<Subscription>),
    /// Ends these subscriptions, by the client's own numbers.
    Unsubscribe(Vec<u32>),
}

/// A subscription.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Subscription {
    /// Number assigned by the client.
    pub id: u32,
    /// Channel.
    pub channel_id: u32,
}

/// Reason why a client's message is rejected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Not part of the protocol.
    Malformed(String),
    /// Not supported: publishing, setting, calling.
    NotGranted(String),
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed(why) => write!(f, "not understood: {why}"),
            Self::NotGranted(what) => write!(f, "{what} is not granted: this server is read-only"),
        }
    }
}

impl Request {
    /// Parses a text message.
    ///
    /// # Errors
    /// Malformed, or not supported.
    pub fn text(text: &str) -> Result<Self, Refused> {
        #[derive(Deserialize)]
        struct Op<'a> {
            #[serde(borrow)]
            op: std::borrow::Cow<'a, str>,
        }
        #[derive(Deserialize)]
        struct Subscribe {
            subscriptions: Vec<Subscription>,
        }
        #[derive(Deserialize)]
        #[serde(rename_all = "camelCase")]
        struct Unsubscribe {
            subscription_ids: Vec<u32>,
        }
        let malformed = |error: serde_json::Error| Refused::Malformed(error.to_string().chars().take(200).collect());
        let Op { op } = serde_json::from_str(text).map_err(malformed)?;
        match &*op {
            "subscribe" => {
                let Subscribe { subscriptions } = serde_json::from_str(text).map_err(malformed)?;
                Ok(Self::Subscribe(subscriptions))
            }
            "unsubscribe" => {
                let Unsubscribe { subscription_ids } = serde_json::from_str(text).map_err(malformed)?;
                Ok(Self::Unsubscribe(subscription_ids))
            }
            "advertise"
            | "unadvertise"
            | "getParameters"
            | "setParameters"
            | "subscribeParameterUpdates"
            | "unsubscribeParameterUpdates"
            | "subscribeConnectionGraph"
            | "unsubscribeConnectionGraph"
            | "fetchAsset" => Err(Refused::NotGranted(op.into_owned())),
            _ => Err(Refused::Malformed(format!("op {:?}", op.chars().take(QUOTED_MAX).collect::<String>()))),
        }
    }

    /// Parses a binary message. None in the protocol is supported.
    #[must_use]
    pub fn binary(bytes: &[u8]) -> Refused {
        match bytes.first() {
            Some(1) => Refused::NotGranted("message data".into()),
            Some(2) => Refused::NotGranted("a service call".into()),
            Some(3) => Refused::NotGranted("playback control".into()),
            Some(opcode) => Refused::Malformed(format!("opcode {opcode}")),
            None => Refused::Malformed("no opcode".into()),
        }
    }
}

/// First message to each client; `session` identifies this start of the server.
#[must_use]
pub fn server_info(robot: &str, session: &str) -> String {
    #[derive(Serialize)]
    #[serde(rename_all = "camelCase")]
    struct ServerInfo<'a> {
        op: &'a str,
        name: &'a str,
        capabilities: &'a [&'a str],
        metadata: Metadata<'a>,
        session_id: &'a str,
    }
    #[derive(Serialize)]
    struct Metadata<'a> {
        version: &'a str,
    }
    json(&ServerInfo {
        op: "serverInfo",
        name: robot,
        capabilities: &["time"],
        metadata: Metadata { version: env!("CARGO_PKG_VERSION") },
        session_id: session,
    })
}

/// A channel as it is advertised.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Channel<'a> {
    /// Number.
    pub id: u32,
    /// `/LL_DATA_ODO`
    pub topic: &'a str,
    /// `cdr`
    pub encoding: &'a str,
    /// `lowlevel/msg/DataOdo`
    pub schema_name: &'a str,
    /// `ros2msg`
    pub schema_encoding: &'a str,
    /// Schema of the type, with those of its fields.
    pub schema: &'a str,
}

/// Announces channels.
#[must_use]
pub fn advertise(channels: &[Channel<'_>]) -> String {
    #[derive(Serialize)]
    struct Advertise<'a> {
        op: &'a str,
        channels: &'a [Channel<'a>],
    }
    json(&Advertise { op: "advertise", channels })
}

/// Status message for the user of the client.
#[must_use]
pub fn status_error(message: &str) -> String {
    #[derive(Serialize)]
    struct Status<'a> {
        op: &'a str,
        level: u8,
        message: &'a str,
    }
    json(&Status { op: "status", level: 2, message })
}

/// Serializes texts and numbers by name, which cannot fail.
fn json(message: &impl Serialize) -> String {
    serde_json::to_string(message).unwrap_or_default()
}

/// Message of a channel; `time` in nanoseconds since the UNIX epoch.
#[must_use]
pub fn message_data(subscription: u32, time: u64, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(13 + data.len());
    bytes.push(1);
    bytes.extend(subscription.to_le_bytes());
    bytes.extend(time.to_le_bytes());
    bytes.extend(data);
    bytes
}

/// Robot time, in nanoseconds since the UNIX epoch.
#[must_use]
pub fn time(time: u64) -> Vec<u8> {
    let mut bytes = vec![2];
    bytes.extend(time.to_le_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_requests_of_a_client_are_parsed() {
        let text = r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":3},{"id":1,"channelId":5,"more":[]}]}"#;
        let [first, second] = [(0, 3), (1, 5)].map(|(id, channel_id)| Subscription { id, channel_id });
        assert_eq!(Request::text(text), Ok(Request::Subscribe(vec![first, second])));
        let text = r#" {"subscriptionIds":[7,4294967295],"op":"unsu\u0062scribe"}"#;
        assert_eq!(Request::text(text), Ok(Request::Unsubscribe(vec![7, u32::MAX])));
    }

    #[test]
    fn unsupported_requests_are_distinguished_from_invalid_ones() {
        for op in ["advertise", "setParameters", "fetchAsset", "subscribeConnectionGraph"] {
            let refused = Request::text(&format!(r#"{{"op":"{op}"}}"#)).unwrap_err();
            assert_eq!(refused, Refused::NotGranted(op.into()));
        }
        for opcode in 1..=3 {
            assert!(matches!(Request::binary(&[opcode, 0, 0]), Refused::NotGranted(_)));
        }
        for text in ["", "{", "[]", "null", r#"{"op":1}"#, r#"{"op":"hello"}"#, r#"{"op":"subscribe"}"#] {
            assert!(matches!(Request::text(text), Err(Refused::Malformed(_))), "{text}");
        }
        for subscription in [r#"{"id":-1,"channelId":1}"#, r#"{"id":1}"#, r#"{"id":1e9,"channelId":1}"#, "[1]"] {
            let text = format!(r#"{{"op":"subscribe","subscriptions":[{subscription}]}}"#);
            assert!(text.contains("[1]") || matches!(Request::text(&text), Err(Refused::Malformed(_))), "{text}");
        }
        assert_eq!(Request::binary(&[]), Refused::Malformed("no opcode".into()));
        assert_eq!(Request::binary(&[9]), Refused::Malformed("opcode 9".into()));
    }

    #[test]
    fn refusals_are_bounded_in_length() {
        let text = format!(r#"{{"op":"{}"}}"#, "x".repeat(60_000));
        assert!(Request::text(&text).unwrap_err().to_string().len() < 300);
        assert!(status_error("\"\n\u{1}").contains(r#""\"\n\u0001""#));
    }

    #[test]
    fn output_matches_the_protocol() {
        assert_eq!(message_data(258, 3, b"x"), [1, 2, 1, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0, b'x']);
        assert_eq!(time(1 << 56), [2, 0, 0, 0, 0, 0, 0, 0, 1]);
        let channel = Channel {
            id: 1,
            topic: "/a",
            encoding: "cdr",
            schema_name: "p/msg/A",
            schema_encoding: "ros2msg",
            schema: "int32 a\n",
        };
        let expected = r#"{"op":"advertise","channels":[{"id":1,"topic":"/a","encoding":"cdr","schemaName":"p/msg/A","schemaEncoding":"ros2msg","schema":"int32 a\n"}]}"#;
        assert_eq!(advertise(&[channel]), expected);
        let info = server_info("advee", "7");
        assert!(info.contains(r#""capabilities":["time"]"#) && info.contains(r#""sessionId":"7""#), "{info}");
    }
}
