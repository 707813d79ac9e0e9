//! A disk with a folder of log files: one request after the other, each with its duration; unsynchronized data is lost
//! in a power failure. A real folder can take its place: the requests are passed on, with the same durations.

use super::owner::Owner;
use super::served::Server;
use base::Duration;
use base::store::{Answer, Entry, Request, Trouble, is_name};
use std::collections::BTreeMap;
use std::fmt;

/// A small SD card: bytes per second, duration of any request, and of a synchronization.
const RATE_BYTES_PER_S: u64 = 40_000_000;
const ACCESS_TIME: Duration = Duration::from_micros(100);
const SYNC_TIME: Duration = Duration::from_millis(5);

/// A file: its content, and the part that survives a power failure.
#[derive(Clone, Debug, Default)]
pub struct Stored {
    /// Bytes.
    pub bytes: Vec<u8>,
    /// Number of them on the medium.
    pub durable: usize,
}

/// State of the disk, for tests.
#[derive(Clone, Debug)]
pub struct Disk {
    /// The files by their names.
    pub files: BTreeMap<String, Stored>,
    /// Bytes that it holds.
    pub capacity: u64,
    /// Factor by which it is slower.
    pub slow: u32,
    /// True if it is read-only.
    pub read_only: bool,
}

impl Default for Disk {
    fn default() -> Self {
        Self { files: BTreeMap::new(), capacity: 1 << 32, slow: 1, read_only: false }
    }
}

impl Disk {
    /// Free space, bytes.
    #[must_use]
    pub fn free(&self) -> u64 {
        self.capacity.saturating_sub(self.files.values().map(|file| file.bytes.len() as u64).sum())
    }

    /// Power failure: each file keeps its synchronized data.
    pub fn cut(&mut self) {
        self.files.values_mut().for_each(|file| file.bytes.truncate(file.durable));
    }

    fn entries(&self) -> Vec<Entry> {
        let mut entries: Vec<Entry> = Vec::new();
        for (path, file) in &self.files {
            let (name, bytes) = (path.split('/').next().unwrap_or(path), file.bytes.len() as u64);
            match entries.last_mut() {
                Some(last) if last.name == name => last.bytes += bytes,
                _ => entries.push(Entry { name: name.into(), bytes }),
            }
        }
        entries
    }
}

/// What executes the requests of a port in the place of a [`Disk`].
pub(super) struct Backing(pub Box<dyn FnMut(Request) -> Answer>);

impl fmt::Debug for Backing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Backing")
    }
}

/// A disk, and the file to which each port appends.
#[derive(Debug, Default)]
pub(super) struct Store {
    pub disk: Disk,
    open: BTreeMap<(u32, u8), String>,
    pub backing: Option<Backing>,
}

impl Server for Store {
    type Request = Request;
    type Answer = Answer;

    fn duration(&self, request: &Request) -> Duration {
        let takes = match request {
            Request::Append { bytes, sync } => {
                let writing = Duration::from_nanos(bytes.len() as u64 * 1_000_000_000 / RATE_BYTES_PER_S);
                ACCESS_TIME + writing + if *sync { SYNC_TIME } else { Duration::ZERO }
            }
            Request::Create { .. } => ACCESS_TIME + SYNC_TIME,
            Request::Remove { .. } | Request::List => ACCESS_TIME,
        };
        takes * self.disk.slow.max(1)
    }

    fn perform(&mut self, owner: Owner, request: Request) -> Answer {
        if let Some(Backing(backing)) = &mut self.backing {
            return backing(request);
        }
        self.done((owner.pid, owner.port.0), request).unwrap_or_else(Answer::Failed)
    }

    /// Its data stays, synchronized or not.
    fn gone(&mut self, pid: u32) {
        self.open.retain(|(owner, _), _| *owner != pid);
    }
}

impl Store {
    fn done(&mut self, key: (u32, u8), request: Request) -> Result<Answer, Trouble> {
        if self.disk.read_only && !matches!(request, Request::List) {
            return Err(Trouble::ReadOnly);
        }
        match request {
            Request::Create { name } | Request::Remove { name } if !is_name(&name) => {
                return Err(Trouble::Other(format!("{name:?} is no valid file name")));
            }
            Request::Create { name } => {
                self.close(key);
                if self.disk.files.contains_key(&name) {
                    return Err(Trouble::Other(format!("{name} is there already")));
                }
                self.disk.files.insert(name.clone(), Stored::default());
                self.open.insert(key, name);
            }
            Request::Append { bytes, sync } => {
                let free = self.disk.free();
                let file = self.open.get(&key).and_then(|name| self.disk.files.get_mut(name));
                let file = file.ok_or_else(|| Trouble::Other("no file is open".into()))?;
                if bytes.len() as u64 > free {
                    return Err(Trouble::Full);
                }
                file.bytes.extend_from_slice(&bytes);
                if sync {
                    file.durable = file.bytes.len();
                }
            }
            Request::Remove { name } => {
                let inside = format!("{name}/");
                self.disk.files.retain(|path, _| *path != name && !path.starts_with(&inside));
            }
            Request::List => return Ok(Answer::Listed { entries: self.disk.entries(), free: self.disk.free() }),
        }
        Ok(Answer::Done { free: self.disk.free() })
    }

    fn close(&mut self, key: (u32, u8)) {
        if let Some(file) = self.open.remove(&key).and_then(|name| self.disk.files.get_mut(&name)) {
            file.durable = file.bytes.len();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::served::Served;
    use super::*;
    use base::Instant;
    use module::PortId;
    use std::sync::Arc;

    fn ask(wire: &mut Served<Store>, request: Request) -> Answer {
        let owner = Owner { pid: 1, port: PortId(0) };
        wire.send(Instant::ZERO, owner, request);
        let over = wire.poll_timeout().unwrap();
        wire.handle_timeout(over).unwrap().1
    }

    fn append(count: usize, sync: bool) -> Request {
        Request::Append { bytes: Arc::new(vec![7; count]), sync }
    }

    #[test]
    fn unsynchronized_data_is_lost_in_a_power_failure() {
        let mut wire = Served::<Store>::default();
        ask(&mut wire, Request::Create { name: "run/a".into() });
        ask(&mut wire, append(10, true));
        ask(&mut wire, append(5, false));
        assert_eq!(wire.server.disk.files["run/a"].bytes.len(), 15);
        wire.server.disk.cut();
        assert_eq!(wire.server.disk.files["run/a"].bytes.len(), 10);
    }

    #[test]
    fn a_backing_executes_the_requests_in_the_place_of_the_disk() {
        let mut wire = Served::<Store>::default();
        wire.server.backing = Some(Backing(Box::new(|request| match request {
            Request::Append { bytes, .. } => Answer::Done { free: bytes.len() as u64 },
            _ => Answer::Failed(Trouble::ReadOnly),
        })));
        assert_eq!(ask(&mut wire, Request::Create { name: "run/a".into() }), Answer::Failed(Trouble::ReadOnly));
        assert_eq!(ask(&mut wire, append(7, true)), Answer::Done { free: 7 });
        assert!(wire.server.disk.files.is_empty());
    }

    #[test]
    fn a_full_disk_rejects_writes_and_lists_its_files() {
        let mut wire = Served::<Store>::default();
        wire.server.disk.capacity = 100;
        ask(&mut wire, Request::Create { name: "run/a".into() });
        assert_eq!(ask(&mut wire, append(60, false)), Answer::Done { free: 40 });
        assert_eq!(ask(&mut wire, append(60, false)), Answer::Failed(Trouble::Full));
        let run = Entry { name: "run".into(), bytes: 60 };
        assert_eq!(ask(&mut wire, Request::List), Answer::Listed { entries: vec![run], free: 40 });
        assert_eq!(ask(&mut wire, Request::Remove { name: "run".into() }), Answer::Done { free: 100 });
        wire.server.disk.read_only = true;
        assert_eq!(ask(&mut wire, Request::Create { name: "b".into() }), Answer::Failed(Trouble::ReadOnly));
    }
}
