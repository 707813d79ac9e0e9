//! Client of the web server without a browser: HTTP by hand, and WebSockets of RFC 6455.
#![allow(dead_code, reason = "each test binary uses its part")]

use serde_json::Value;
use std::io::{self, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Unused address.
pub fn free() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free address")
}

/// Answer.
pub struct Answer {
    pub status: u16,
    /// All headers as received.
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    /// Value of a header; its name in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        let lines = self.head.lines().filter_map(|line| line.split_once(": "));
        lines.filter(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value).next()
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

/// Sends a request; `headers` end with a line feed each. `None` without an answer.
pub fn ask(at: SocketAddr, method: &str, path: &str, headers: &str) -> Option<Answer> {
    let mut line = TcpStream::connect(at).ok()?;
    line.set_read_timeout(Some(Duration::from_secs(10))).ok()?;
    let host = if headers.contains("Host:") { "" } else { "Host: localhost\r\n" };
    write!(line, "{method} {path} HTTP/1.1\r\n{host}Connection: close\r\n{headers}\r\n").ok()?;
    let mut all = Vec::new();
    let _ = line.read_to_end(&mut all);
    let end = all.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = String::from_utf8_lossy(&all[..end]).into_owned();
    let status = head.strip_prefix("HTTP/1.1 ")?.get(..3)?.parse().ok()?;
    Some(Answer { status, head, body: all.split_off(end + 4) })
}

pub fn get(at: SocketAddr, path: &str) -> Option<Answer> {
    ask(at, "GET", path, "")
}

/// Data received over a WebSocket.
#[derive(Debug)]
pub enum Frame {
    Text(String),
    Binary(Vec<u8>),
    Ping(Vec<u8>),
    Close(u16, String),
}

/// Client end of a WebSocket.
pub struct Socket {
    line: TcpStream,
    read: BufReader<TcpStream>,
    /// True if pings are answered, as by a browser.
    pub answers: bool,
    /// Bytes of received texts.
    pub bytes: u64,
}

impl Socket {
    /// Opens a socket; returns the status if it is refused.
    pub fn open(at: SocketAddr, path: &str, headers: &str) -> Result<Self, u16> {
        let mut line = TcpStream::connect(at).expect("the server is there");
        line.set_read_timeout(Some(Duration::from_secs(10))).expect("a time limit");
        let host = if headers.contains("Host:") { "" } else { "Host: localhost\r\n" };
        write!(
            line,
            "GET {path} HTTP/1.1\r\n{host}Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
            Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n{headers}\r\n"
        )
        .expect("it hears");
        let mut read = BufReader::with_capacity(1 << 16, line.try_clone().expect("a descriptor"));
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            read.read_exact(&mut byte).expect("it answers");
            head.push(byte[0]);
        }
        let status = String::from_utf8_lossy(&head[9..12]).parse().expect("a status");
        if status == 101 { Ok(Self { line, read, answers: true, bytes: 0 }) } else { Err(status) }
    }

    /// Sends a frame, masked with zeros.
    pub fn send(&mut self, opcode: u8, payload: &[u8]) -> io::Result<()> {
        let mut frame = vec![0x80 | opcode];
        match payload.len() {
            short @ 0..126 => frame.push(0x80 | short as u8),
            wide @ 126..0x1_0000 => {
                frame.push(0x80 | 126);
                frame.extend((wide as u16).to_be_bytes());
            }
            long => {
                frame.push(0x80 | 127);
                frame.extend((long as u64).to_be_bytes());
            }
        }
        frame.extend([0; 4]);
        frame.extend(payload);
        self.line.write_all(&frame)
    }

    pub fn say(&mut self, text: &str) {
        self.send(1, text.as_bytes()).expect("it hears");
    }

    /// Sets the timeout for receiving.
    pub fn patience(&mut self, patience: Duration) {
        self.line.set_read_timeout(Some(patience)).expect("a time limit");
    }

    /// Next frame; `None` at the end.
    pub fn frame(&mut self) -> Option<Frame> {
        let mut head = [0; 2];
        self.read.read_exact(&mut head).ok()?;
        let mut length = [0; 8];
        let wide = match head[1] {
            126 => 2,
            127 => 8,
            short => {
                length[7] = short;
                0
            }
        };
        self.read.read_exact(&mut length[8 - wide..]).ok()?;
        let mut payload = vec![0; u64::from_be_bytes(length) as usize];
        self.read.read_exact(&mut payload).ok()?;
        match head[0] & 15 {
            1 => {
                self.bytes += payload.len() as u64;
                Some(Frame::Text(String::from_utf8(payload).expect("UTF-8")))
            }
            2 => Some(Frame::Binary(payload)),
            8 => {
                let code = payload.first_chunk::<2>().map_or(1005, |code| u16::from_be_bytes(*code));
                Some(Frame::Close(code, String::from_utf8_lossy(payload.get(2..).unwrap_or_default()).into_owned()))
            }
            9 => {
                if self.answers {
                    let _ = self.send(10, &payload);
                }
                Some(Frame::Ping(payload))
            }
            _ => self.frame(),
        }
    }

    /// Next text as JSON; `Err` with the reason if the socket was closed.
    pub fn json(&mut self) -> Result<Value, String> {
        loop {
            match self.frame() {
                Some(Frame::Text(text)) => return Ok(serde_json::from_str(&text).expect("JSON")),
                Some(Frame::Close(code, why)) => return Err(format!("{code} {why}")),
                Some(_) => {}
                None => return Err("gone".into()),
            }
        }
    }

    /// All texts of a while, each with its time of arrival, s.
    pub fn during(&mut self, seconds: f64) -> Vec<(f64, Value)> {
        let begin = Instant::now();
        let mut texts = Vec::new();
        while begin.elapsed().as_secs_f64() < seconds {
            match self.json() {
                Ok(text) => texts.push((begin.elapsed().as_secs_f64(), text)),
                Err(why) => panic!("closed: {why}"),
            }
        }
        texts
    }
}
