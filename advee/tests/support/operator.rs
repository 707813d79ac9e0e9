//! Scripted page of the diagnostic center: HTTP by hand, and a WebSocket that sends anything, including malformed data.
#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// Answer: status, headers, body.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: String,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|_| panic!("no JSON: {self:?}"))
    }

    /// Cookie that it sets, in the form to be returned.
    pub fn cookie(&self) -> String {
        let line = self.head.lines().find_map(|line| line.strip_prefix("set-cookie: ")).expect("a cookie");
        line.split(';').next().unwrap().into()
    }
}

/// Sends one request on a separate connection; `headers` are lines that end with `\r\n`.
pub fn request(at: SocketAddr, method: &str, path: &str, headers: &str, body: &str) -> Answer {
    let mut line = TcpStream::connect(at).expect("the server is there");
    line.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let length =
        if method == "GET" || method == "HEAD" { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
    let text = format!("{method} {path} HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n{length}{headers}\r\n{body}");
    // A client that is refused early may not receive the rest.
    let _ = line.write_all(text.as_bytes());
    let mut answer = Vec::new();
    let _ = line.read_to_end(&mut answer);
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    Answer { status, head: head.to_ascii_lowercase().replace("httponly", "HttpOnly"), body: body.into() }
}

/// Posts like the robot's own page.
pub fn post(at: SocketAddr, path: &str, cookie: &str, body: &Value) -> Answer {
    let headers = format!("Origin: http://{at}\r\nContent-Type: application/json\r\nCookie: {cookie}\r\n");
    request(at, "POST", path, &headers, &body.to_string())
}

pub fn get(at: SocketAddr, path: &str, cookie: &str) -> Answer {
    request(at, "GET", path, &format!("Cookie: {cookie}\r\n"), "")
}

/// Data received on a WebSocket.
#[derive(Debug, PartialEq)]
pub enum Received {
    Message(Value),
    Closed(u16, String),
    Nothing,
}

pub struct Page {
    stream: TcpStream,
    bytes: Vec<u8>,
    begun: Instant,
    pub seq: u64,
}

impl Page {
    /// Opens a socket; returns the status if it is refused.
    pub fn open(at: SocketAddr, host: SocketAddr, path: &str, headers: &str) -> Result<Self, u16> {
        let mut stream = TcpStream::connect(at).expect("the server is there");
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                       Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n{upgrade}{headers}\r\n").unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            if stream.read(&mut byte).unwrap_or(0) == 0 {
                return Err(0);
            }
            head.push(byte[0]);
        }
        let head = String::from_utf8_lossy(&head).into_owned();
        let status: u16 = head.split(' ').nth(1).unwrap().parse().unwrap();
        match status {
            101 => Ok(Self { stream, bytes: Vec::new(), begun: Instant::now(), seq: 0 }),
            refused => Err(refused),
        }
    }

    /// Command socket of the robot's own page.
    pub fn command(at: SocketAddr, cookie: &str) -> Self {
        let headers = format!("Origin: http://{at}\r\nCookie: {cookie}\r\n");
        Self::open(at, at, "/ws/command", &headers).expect("the command socket opens")
    }

    /// Clock of the page, ms.
    pub fn clock(&self) -> f64 {
        1000.0 + self.begun.elapsed().as_secs_f64() * 1e3
    }

    pub fn send(&mut self, what: &Value) {
        self.send_text(&what.to_string());
    }

    pub fn send_text(&mut self, text: &str) {
        self.frame(1, text.as_bytes());
    }

    /// A closed connection is detected when receiving.
    pub fn frame(&mut self, opcode: u8, payload: &[u8]) {
        let mask = [0x37, 0xfa, 0x21, 0x3d];
        let mut frame = vec![0x80 | opcode];
        match payload.len() {
            short @ ..126 => frame.push(0x80 | short as u8),
            long @ ..65536 => {
                frame.push(0x80 | 126);
                frame.extend_from_slice(&(long as u16).to_be_bytes());
            }
            longest => {
                frame.push(0x80 | 127);
                frame.extend_from_slice(&(longest as u64).to_be_bytes());
            }
        }
        frame.extend_from_slice(&mask);
        frame.extend(payload.iter().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
        let _ = self.stream.write_all(&frame);
    }

    /// Sends a command of a hold with the current time.
    pub fn drive(&mut self, hold: u64, speed: f64, steering: f64) {
        self.seq += 1;
        let (seq, t) = (self.seq, self.clock());
        let command = serde_json::json!({
            "type": "drive", "hold": hold, "seq": seq, "t": t, "speed": speed, "steering": steering
        });
        self.send(&command);
    }

    pub fn zero(&mut self, hold: u64) {
        self.seq += 1;
        let seq = self.seq;
        self.send(&serde_json::json!({ "type": "zero", "hold": hold, "seq": seq }));
    }

    /// Next frame within the time.
    pub fn receive(&mut self, patience: Duration) -> Received {
        let until = Instant::now() + patience;
        loop {
            if let Some((opcode, payload)) = self.take() {
                match opcode {
                    1 => return Received::Message(serde_json::from_slice(&payload).unwrap()),
                    8 if payload.len() >= 2 => {
                        let code = u16::from_be_bytes([payload[0], payload[1]]);
                        return Received::Closed(code, String::from_utf8_lossy(&payload[2..]).into_owned());
                    }
                    8 => return Received::Closed(1005, String::new()),
                    9 => self.frame(10, &payload),
                    _ => {}
                }
                continue;
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Received::Nothing;
            }
            self.stream.set_read_timeout(Some(left.max(Duration::from_millis(1)))).unwrap();
            let mut buffer = [0; 4096];
            match self.stream.read(&mut buffer) {
                Ok(0) => return Received::Closed(0, String::new()),
                Ok(count) => self.bytes.extend_from_slice(&buffer[..count]),
                Err(error)
                    if [std::io::ErrorKind::WouldBlock, std::io::ErrorKind::TimedOut].contains(&error.kind()) => {}
                Err(_) => return Received::Closed(0, String::new()),
            }
        }
    }

    fn take(&mut self) -> Option<(u8, Vec<u8>)> {
        let (first, length) = (*self.bytes.first()?, usize::from(self.bytes.get(1)? & 0x7f));
        let (begin, length) = match length {
            126 => (4, usize::from(u16::from_be_bytes([*self.bytes.get(2)?, *self.bytes.get(3)?]))),
            127 => panic!("a frame this long is none of the protocol"),
            short => (2, short),
        };
        let payload = self.bytes.get(begin..begin + length)?.to_vec();
        self.bytes.drain(..begin + length);
        Some((first & 0x0f, payload))
    }

    /// Next message of that type; earlier ones are skipped.
    #[track_caller]
    pub fn until(&mut self, kind: &str) -> Value {
        let begun = Instant::now();
        let mut before = Vec::new();
        while begun.elapsed() < Duration::from_secs(8) {
            match self.receive(Duration::from_secs(8)) {
                Received::Message(message) if message["type"] == kind => return message,
                Received::Message(other) => before.push(other),
                other => panic!("no {kind}: {other:?} after {before:?}"),
            }
        }
        panic!("no {kind} within 8 s; {before:?}")
    }

    /// Close code and reason; earlier messages are skipped.
    #[track_caller]
    pub fn closed(&mut self) -> (u16, String) {
        loop {
            match self.receive(Duration::from_secs(15)) {
                Received::Message(_) => {}
                Received::Closed(code, reason) => return (code, reason),
                Received::Nothing => panic!("it is not closed"),
            }
        }
    }

    /// Sends a command and waits for its answer: `done`, `sdo`, or the reason of a refusal.
    #[track_caller]
    pub fn ask(&mut self, mut command: Value) -> Result<Value, String> {
        self.seq += 1;
        let id = self.seq;
        command["id"] = id.into();
        self.send(&command);
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(8) {
            match self.receive(Duration::from_secs(8)) {
                Received::Message(message) if message["id"] == id => {
                    return if message["type"] == "refused" {
                        Err(message["why"].as_str().unwrap().into())
                    } else {
                        Ok(message)
                    };
                }
                Received::Message(_) => {}
                other => panic!("no answer to {command}: {other:?}"),
            }
        }
        panic!("no answer to {command}")
    }
}
