//! Services of ROS: requests on `rq/NAMERequest`, answers on `rr/NAMEReply`, and which answer belongs to which request.
//!
//! Fast DDS names the request in front of the answer, by a parameter (DDS-RPC 1.0, 7.8.2); the request itself names the
//! reader of its answers there. Cyclone DDS has a header of its own in front of the content of both, 16 bytes: a number
//! of the client, and one of the request (`rmw_cyclonedds_cpp`, `cdds_request_header_t`). Clients tell by either
//! whether an answer is theirs, since all that listen receive all.

use base::{Duration, Instant};
use rtps::{Entity, Guid, Participant, Qos, ReaderId, Sample, SampleIdentity, WriterId};
use std::borrow::Cow;
use std::collections::VecDeque;

/// Quality of services in ROS, `rmw_qos_profile_services_default`; more answers are kept than its ten.
const QOS: Qos = Qos { depth: 32, ..Qos::RELIABLE };
/// Answers at most that wait for a client whose reader is not known yet.
const WAITING_MAX: usize = 32;
/// Longest time that such an answer waits.
const WAIT_MAX: Duration = Duration::from_secs(1);
/// Number of the vendor of Eclipse Cyclone DDS (<https://www.dds-foundation.org/dds-rtps-vendor-and-product-ids/>).
const CYCLONE: [u8; 2] = [1, 0x10];
/// Length of the encapsulation, bytes (9.4.2.12 of RTPS).
const ENCAPSULATION: usize = 4;
/// Length of the header of Cyclone DDS, bytes.
const HEADER: usize = 16;

/// A service of the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceId(usize);

/// Who sent a request, as an answer names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caller {
    request: SampleIdentity,
    /// The reader of the answer, or its participant: it has to be there before the answer is written.
    reader: Guid,
    /// Header of Cyclone DDS, least significant bytes first.
    header: Option<[u8; HEADER]>,
}

#[cfg(test)]
impl Caller {
    /// One of a program of Fast DDS.
    pub fn of(writer: Guid, number: i64) -> Self {
        Self { request: SampleIdentity { writer, number }, reader: writer, header: None }
    }

    /// Number of the request.
    pub fn number(self) -> i64 {
        self.request.number
    }
}

#[derive(Clone, Copy, Debug)]
struct Endpoint {
    reader: ReaderId,
    writer: WriterId,
}

#[derive(Debug)]
struct Waiting {
    service: ServiceId,
    caller: Caller,
    cdr: Vec<u8>,
    until: Instant,
}

/// The services of a node.
#[derive(Debug, Default)]
pub struct Services {
    endpoints: Vec<Endpoint>,
    waiting: VecDeque<Waiting>,
    lost: u64,
}

impl Services {
    /// Offers a service of the full name `name`, as `/courier/list_parameters`, and of a type as
    /// `std_srvs/srv/Trigger`.
    pub fn add(&mut self, participant: &mut Participant, now: Instant, name: &str, kind: &str) -> Option<ServiceId> {
        let (package, kind) = kind.rsplit_once('/')?;
        let package = package.replace('/', "::");
        let kind = |part: &str| format!("{package}::dds_::{kind}_{part}_");
        let reader = participant.add_request_reader(now, &format!("rq{name}Request"), &kind("Request"), QOS)?;
        let writer = participant.add_writer(now, &format!("rr{name}Reply"), &kind("Response"), QOS)?;
        self.endpoints.push(Endpoint { reader, writer });
        Some(ServiceId(self.endpoints.len() - 1))
    }

    /// The service whose requests a reader receives.
    #[must_use]
    pub fn find(&self, reader: ReaderId) -> Option<ServiceId> {
        self.endpoints.iter().position(|endpoint| endpoint.reader == reader).map(ServiceId)
    }

    /// Readers and writers, for the graph of ROS.
    pub fn endpoints(&self) -> impl Iterator<Item = (ReaderId, WriterId)> + '_ {
        self.endpoints.iter().map(|endpoint| (endpoint.reader, endpoint.writer))
    }

    /// Writes an answer, or keeps it for a moment if nobody would receive it: a client may ask before its reader is
    /// known here.
    pub fn answer(
        &mut self,
        participant: &mut Participant,
        now: Instant,
        micros: i64,
        service: ServiceId,
        caller: Caller,
        cdr: Vec<u8>,
    ) {
        let waiting = Waiting { service, caller, cdr, until: now + WAIT_MAX };
        if let Err(waiting) = self.write(participant, now, micros, waiting) {
            if self.waiting.len() >= WAITING_MAX {
                self.waiting.pop_front();
                self.lost += 1;
            }
            self.waiting.push_back(waiting);
        }
    }

    fn write(&self, participant: &mut Participant, now: Instant, micros: i64, answer: Waiting) -> Result<(), Waiting> {
        let Some(Endpoint { writer, .. }) = self.endpoints.get(answer.service.0).copied() else { return Ok(()) };
        if !participant.reaches(writer, answer.caller.reader) {
            return Err(answer);
        }
        let Caller { request, header, .. } = answer.caller;
        match header {
            None => participant.write_related(now, writer, micros, Some(request), &answer.cdr),
            Some(header) => {
                let (encapsulation, content) = answer.cdr.split_at(ENCAPSULATION.min(answer.cdr.len()));
                participant.write(now, writer, micros, &[encapsulation, &header, content].concat());
            }
        }
        Ok(())
    }

    /// Writes the answers whose readers are there by now, and drops those that waited too long.
    pub fn flush(&mut self, participant: &mut Participant, now: Instant, micros: i64) {
        for _ in 0..self.waiting.len() {
            let Some(waiting) = self.waiting.pop_front() else { return };
            match self.write(participant, now, micros, waiting) {
                Ok(()) => {}
                Err(waiting) if waiting.until <= now => self.lost += 1,
                Err(waiting) => self.waiting.push_back(waiting),
            }
        }
    }

    /// When [`flush`](Self::flush) is to be called at the latest.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.until).min()
    }

    /// Answers that were dropped since the last call.
    pub fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }
}

/// Who sent a request, and its content with the encapsulation; `None`: it is too short.
#[must_use]
pub fn request<'a>(participant: &Participant, sample: &'a Sample) -> Option<(Caller, Cow<'a, [u8]>)> {
    let Sample { writer, number, ref payload, related, .. } = *sample;
    let participant_guid = Guid { entity: Entity::PARTICIPANT, ..writer };
    if participant.vendor(writer.prefix) == Some(CYCLONE) {
        let (encapsulation, rest) = payload.split_at_checked(ENCAPSULATION)?;
        let (header, content) = rest.split_first_chunk::<HEADER>()?;
        let mut header = *header;
        if encapsulation[1] % 2 == 0 {
            header.chunks_exact_mut(HEADER / 2).for_each(<[u8]>::reverse);
        }
        let caller =
            Caller { request: SampleIdentity { writer, number }, reader: participant_guid, header: Some(header) };
        return Some((caller, Cow::Owned([encapsulation, content].concat())));
    }
    // The reader of the answers is one of the same program: whatever else is said names nobody to wait for.
    let reader = related.map(|related| related.writer).filter(|reader| reader.prefix == writer.prefix);
    let request = SampleIdentity { writer: reader.unwrap_or(writer), number };
    let caller = Caller { request, reader: reader.unwrap_or(participant_guid), header: None };
    Some((caller, Cow::Borrowed(payload)))
}
