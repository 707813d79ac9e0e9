//! SDO server without a node: it stores whatever is written to any object, up to the maximum length.

use base::can::Frame;
use base::{Duration, Instant};
use canopen::sdo::{Objects, Server};
use canopen::wire::Service;
use canopen::{Abort, Payload};
use std::collections::BTreeMap;

#[derive(Default)]
struct Kept(BTreeMap<(u16, u8), Payload>);

impl Objects for Kept {
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort> {
        self.0.get(&(index, sub)).cloned().ok_or(Abort::NO_OBJECT)
    }

    fn check_write(&self, _: u16, _: u8, _: Option<usize>) -> Result<Option<usize>, Abort> {
        Ok(None)
    }

    fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort> {
        self.0.insert((index, sub), data.into());
        Ok(())
    }
}

pub struct Store {
    node: u8,
    server: Server,
    kept: Kept,
    answer: Option<[u8; 8]>,
}

impl Store {
    pub fn new(node: u8) -> Self {
        Self { node, server: Server::new(Duration::from_secs(2)), kept: Kept::default(), answer: None }
    }

    /// Processes a frame from the bus; then drain [`Self::poll_tx`].
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        if Service::of(frame) == Some(Service::SdoRequest { node: self.node }) {
            self.answer = self.server.handle_rx(now, frame.data(), &mut self.kept);
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(abort) = self.server.handle_timeout(now) {
            self.answer = Some(abort);
        }
    }

    pub fn poll_tx(&mut self) -> Option<Frame> {
        let data = self.answer.take().or_else(|| self.server.poll_tx())?;
        Some(Frame::standard(Service::SdoResponse { node: self.node }.cob_id(), &data))
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.server.poll_timeout()
    }
}
