//! A wire of requests and answers: one request after the other, each with its duration.

use super::news::Traffic;
use super::owner::Owner;
use base::{Duration, Instant};
use module::OUTSTANDING;
use std::collections::VecDeque;

/// Serves the requests on a wire.
pub(super) trait Server {
    /// A request of a port.
    type Request;
    /// Its answer.
    type Answer;
    /// Duration of a request.
    fn duration(&self, request: &Self::Request) -> Duration;
    /// Performs a request at the end of its duration.
    fn perform(&mut self, owner: Owner, request: Self::Request) -> Self::Answer;
    /// A process has ended.
    fn gone(&mut self, pid: u32);
}

/// A server, and the ports on its wire.
#[derive(Debug)]
pub(super) struct Served<S: Server> {
    pub server: S,
    pub ports: Vec<Owner>,
    queue: VecDeque<(Owner, S::Request)>,
    until: Option<Instant>,
    pub traffic: Traffic,
}

impl<S: Server + Default> Default for Served<S> {
    fn default() -> Self {
        let (ports, queue) = (Vec::new(), VecDeque::new());
        Self { server: S::default(), ports, queue, until: None, traffic: Traffic::default() }
    }
}

impl<S: Server> Served<S> {
    pub fn send(&mut self, now: Instant, owner: Owner, request: S::Request) {
        if self.queue.iter().filter(|(own, _)| *own == owner).count() >= OUTSTANDING {
            self.traffic.dropped += 1;
            return;
        }
        self.queue.push_back((owner, request));
        self.go_on(now);
    }

    fn go_on(&mut self, now: Instant) {
        if self.until.is_none()
            && let Some((_, request)) = self.queue.front()
        {
            let takes = self.server.duration(request);
            self.traffic.busy += takes;
            self.until = Some(now + takes);
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.until
    }

    /// Answer to a request that ends at `now`.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<(Owner, S::Answer)> {
        self.until.take_if(|until| *until <= now)?;
        let (owner, request) = self.queue.pop_front()?;
        self.traffic.sent += 1;
        let answer = self.server.perform(owner, request);
        self.go_on(now);
        Some((owner, answer))
    }

    /// A process has ended: its requests are dropped.
    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
        let first = self.queue.front().is_some_and(|(owner, _)| owner.pid == pid);
        self.queue.retain(|(owner, _)| owner.pid != pid);
        self.server.gone(pid);
        if first && let Some(until) = self.until.take() {
            // The next one begins when the wire is free.
            self.go_on(until);
        }
    }
}
