//! A module that receives the whole bus and writes it into a folder.

use super::{Notes, host_of, lcm_url, path};
use crate::clock;
use crate::ports::PortConfig;
use base::store::{Answer, Request};
use base::{Duration, Instant};
use messages::{Channel, Message, lowlevel};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec};
use nix::sys::signal::{Signal, raise};
use std::fs;
use std::sync::Arc;
use std::thread;

const STORE: PortId = PortId(0);

/// Writes each message except announcements as a line; ends itself on receiving `LAST`.
struct Scribe {
    ports: [PortSpec; 1],
    notes: Notes,
    asked: usize,
    ended: bool,
}

impl Scribe {
    fn ask(&mut self, request: Request, out: &mut Actions) {
        self.asked += 1;
        out.store(STORE, request);
    }
}

impl Module for Scribe {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataOdo]
    }

    fn wants_raw_bus(&self) -> bool {
        true
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Port { input: Input::Up, .. } => {
                self.ask(Request::Create { name: "run/heard".into() }, out);
                out.working();
            }
            Event::Port { input: Input::Store(answer), .. } => {
                assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
                self.asked -= 1;
            }
            Event::RawMessage { at, channel, data } if channel.starts_with("CM_") => {
                assert!(at <= now && !data.is_empty());
            }
            Event::RawMessage { channel, data, .. } => {
                let line = format!("{channel} {}\n", data.len());
                self.ask(Request::Append { bytes: Arc::new(line.into_bytes()), sync: true }, out);
                if channel == "LAST" {
                    raise(Signal::SIGTERM).unwrap();
                    self.ended = true;
                }
            }
            Event::Message { message, .. } => self.notes.lock().unwrap().push(format!("{:?}", message.channel())),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }

    fn finished(&self) -> bool {
        self.ended && self.asked == 0
    }
}

#[test]
fn a_module_on_the_raw_bus_receives_all_bytes_and_its_file_is_complete() {
    let (folder, url, notes) = (path("scribe"), lcm_url(), Notes::default());
    let ports = [PortSpec { bus: "log".into(), line: Line::Store }];
    let scribe = Scribe { ports, notes: notes.clone(), asked: 0, ended: false };
    let mut lcm = lcm::live::Lcm::new(&lcm::Url::parse(&url).unwrap().0).unwrap();
    lcm.subscribe("CM_DATA_STATE").unwrap();
    let peer = thread::spawn(move || {
        let until = clock::now() + Duration::from_secs(5);
        let runs = |data: &[u8]| matches!(Message::decode(Channel::CmDataState, data), Ok(Message::CmDataState(s)) if s.state == 3);
        let mut running = false;
        while !running && clock::now() < until {
            lcm.wait(Duration::from_millis(20)).unwrap();
            while let Some(received) = lcm.recv().unwrap() {
                running |= runs(received.payload);
            }
        }
        let mut odo = Vec::new();
        Message::from(lowlevel::DataOdo::default()).encode(&mut odo).unwrap();
        for (channel, data) in
            [("LL_DATA_ODO", &odo[..]), ("FOREIGN", &[]), ("LL_DATA_ODO", &[1, 2, 3]), ("LAST", &[7; 200_000])]
        {
            lcm.publish(channel, data).unwrap();
            thread::sleep(Duration::from_millis(10));
        }
    });
    assert_eq!(host_of(scribe, &url, vec![PortConfig::Store { folder: folder.clone() }]), 0);
    peer.join().unwrap();
    let written = fs::read_to_string(folder.join("run/heard")).unwrap();
    fs::remove_dir_all(&folder).unwrap();
    assert_eq!(written, "LL_DATA_ODO 56\nFOREIGN 0\nLL_DATA_ODO 3\nLAST 200000\n");
    assert_eq!(*notes.lock().unwrap(), ["LlDataOdo"], "malformed messages are not decoded");
}
