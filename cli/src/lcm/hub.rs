//! `advee lcm hub`: relays between programs that reach the bus by `tcpq://`, until Ctrl-C.

use crate::bus::{interrupt, wait};
use crate::{Failed, Outcome, complain, print, seconds};
use base::{Duration, Instant};
use host::clock;
use lcm::tcpq::hub::{Limits, Overflow, Stats};
use lcm::url::TCPQ_PORT;
use serde_json::json;
use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::AsFd;
use std::process::ExitCode;

/// The other programs: --lcm-url tcpq://ADDRESS:PORT, or LCM_DEFAULT_URL of the official library.
#[derive(clap::Args)]
pub struct Hub {
    /// Address to listen on; other hosts reach it only at an address of this host's network
    #[arg(value_name = "ADDRESS:PORT", value_parser = address, default_value_t = DEFAULT)]
    address: SocketAddrV4,
    /// Lose nothing: publishers wait for the slowest program, in place of dropping its oldest messages; one that takes
    /// nothing for 4 s is disconnected
    #[arg(long)]
    lossless: bool,
    /// JSON lines: {"listening"}, and at the end the counters
    #[arg(long)]
    json: bool,
    /// Duration, s; without it until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
}

const DEFAULT: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, TCPQ_PORT);

pub fn hub(command: &Hub) -> Outcome {
    let interrupt = interrupt()?;
    let overflow = if command.lossless { Overflow::Wait } else { Overflow::DropOldest };
    let limits = Limits { overflow, ..Limits::default() };
    let mut hub = lcm::live::Hub::with_limits(command.address, limits).map_err(failed)?;
    let address = hub.address().map_err(failed)?;
    if command.json {
        print(json!({"listening": format!("tcpq://{address}")}))?;
    } else {
        print(format_args!("listening at tcpq://{address}"))?;
    }
    let until = command.time.map_or(Instant::NEVER, |time| clock::now() + time);
    loop {
        let now = clock::now();
        if now >= until || matches!(interrupt.read_signal(), Ok(Some(_))) {
            break;
        }
        wait(&[hub.as_fd(), interrupt.as_fd()], until.since(now))?;
        hub.serve_once().map_err(failed)?;
        while let Some(event) = hub.poll_event() {
            // A closed stderr must not end the relay.
            let _ = writeln!(io::stderr(), "{event}");
        }
    }
    let Stats { accepted, refused, malformed, published, delivered, dropped, unusable, .. } = hub.stats();
    if command.json {
        print(json!({
            "clients": accepted, "refused": refused, "malformed": malformed, "published": published,
            "delivered": delivered, "dropped": dropped, "unusable": unusable,
        }))?;
    } else {
        print(format_args!(
            "{accepted} clients, {published} messages from them, {delivered} to them, {dropped} dropped"
        ))?;
    }
    if refused + malformed + unusable > 0 && !command.json {
        complain(&format_args!(
            "{refused} connections too many, {malformed} closed for what they sent, {unusable} messages or subscriptions \
             not usable"
        ));
    }
    Ok(ExitCode::SUCCESS)
}

fn failed(error: io::Error) -> Failed {
    format!("LCM hub: {error}").into()
}

/// An address and a port, of which the port may be left out; port 0 is any free one.
fn address(text: &str) -> Result<SocketAddrV4, String> {
    let whole = text.parse().or_else(|_| text.parse().map(|address| SocketAddrV4::new(address, TCPQ_PORT)));
    whole.map_err(|_| "expected an IPv4 address of this host, or ADDRESS:PORT".into())
}
