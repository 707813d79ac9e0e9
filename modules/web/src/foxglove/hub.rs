//! Topics that every viewer may see, and pending output of each viewer. No sockets, no clock.
//!
//! A slow viewer gets the newest message of each channel: older ones are dropped from its queue, and counted. Other
//! viewers are not affected.

use super::protocol::{self, Channel, Subscription};
use axum::body::Bytes;
use logger::ros::Topic;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use tokio::sync::Notify;

/// Limits of the hub.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Maximum number of topics; further ones are not shown.
    pub topics: usize,
    /// A message longer than this is not shown, bytes.
    pub message: usize,
    /// Maximum size of a viewer's queue, bytes.
    pub queue: usize,
}

impl Limits {
    /// Defaults: a robot has some hundred topics and 60 kB/s.
    pub const DEFAULT: Self = Self { topics: 2000, message: 512 << 10, queue: 512 << 10 };
}

/// Step of the time sent to viewers, ns.
const CLOCK_STEP: u64 = 20_000_000;

/// Maximum number of channels whose newest message is kept for a topic.
const SOURCES_MAX: usize = 8;
/// Time for which a full message is kept beside a newer partial one, ns: full state is published once a second.
const FULL_AGE: u64 = 3_000_000_000;

/// Number of a viewer.
pub type ViewerId = u64;

/// Counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages that were published.
    pub published: u64,
    /// Messages queued, once for each viewer.
    pub queued: u64,
    /// Messages dropped because the viewer was too slow.
    pub dropped: u64,
    /// Messages that were too long to be shown.
    pub too_long: u64,
    /// Messages of topics beyond the limit.
    pub too_many: u64,
}

/// Topics and viewers.
pub struct Hub {
    limits: Limits,
    topics: BTreeMap<u32, Entry>,
    /// Their numbers in order of appearance.
    order: Vec<u32>,
    viewers: BTreeMap<ViewerId, Viewer>,
    next: ViewerId,
    counts: Counts,
    /// Viewers with new messages.
    stirred: BTreeSet<ViewerId>,
}

struct Entry {
    topic: Topic,
    /// Newest message of each channel of the bus, for later viewers; absent if the topic is not a state.
    latest: BTreeMap<String, Kept>,
}

/// Kept messages of a channel that publishes full state now and then, and changes in between.
struct Kept {
    newest: LatestMessage,
    fullest: LatestMessage,
}

#[derive(Clone)]
struct LatestMessage {
    time: u64,
    data: Bytes,
}

struct Viewer {
    /// Numbers of the viewer's subscriptions, by channel.
    subscriptions: BTreeMap<u32, u32>,
    queue: VecDeque<Queued>,
    bytes: usize,
    /// Number of topics announced to it.
    told: usize,
    /// Newest time sent to it.
    time: u64,
    wake: Arc<Notify>,
}

#[derive(Clone)]
struct Queued {
    channel: u32,
    subscription: u32,
    said: LatestMessage,
}

/// Message for a viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outgoing {
    /// A text message.
    Text(String),
    /// A binary message.
    Binary(Vec<u8>),
}

impl Hub {
    /// Creates an empty hub.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            topics: BTreeMap::new(),
            order: Vec::new(),
            viewers: BTreeMap::new(),
            next: 0,
            counts: Counts::default(),
            stirred: BTreeSet::new(),
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Number of topics.
    #[must_use]
    pub fn topics(&self) -> usize {
        self.order.len()
    }

    /// Names of the topics, in order of appearance.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.order.iter().filter_map(|number| self.topics.get(number)).map(|entry| &*entry.topic.name)
    }

    /// Number of viewers.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.viewers.len()
    }

    /// Processes a message of a topic, from a channel of the bus, at `time` ns since the UNIX epoch. Viewers are woken
    /// by [`Self::wake_viewers`].
    pub fn publish(&mut self, topic: &Topic, from: &str, time: u64, data: &[u8]) {
        let id = u32::from(topic.id);
        self.counts.published += 1;
        if data.len() > self.limits.message {
            self.counts.too_long += 1;
            return;
        }
        if !self.topics.contains_key(&id) {
            if self.order.len() >= self.limits.topics {
                self.counts.too_many += 1;
                return;
            }
            self.order.push(id);
            self.topics.insert(id, Entry { topic: topic.clone(), latest: BTreeMap::new() });
            self.stirred.extend(self.viewers.keys());
        }
        let Some(entry) = self.topics.get_mut(&id) else { return };
        let wanted = self.viewers.values().any(|viewer| viewer.subscriptions.contains_key(&id));
        if !wanted && !entry.is_state() {
            return;
        }
        let said = LatestMessage { time, data: Bytes::copy_from_slice(data) };
        if entry.is_state() {
            entry.keep(from, said.clone());
        }
        for (viewer_id, viewer) in &mut self.viewers {
            if let Some(&subscription) = viewer.subscriptions.get(&id) {
                self.counts.queued += 1;
                self.counts.dropped +=
                    viewer.push(Queued { channel: id, subscription, said: said.clone() }, self.limits.queue);
                self.stirred.insert(*viewer_id);
            }
        }
    }

    /// Wakes viewers with new messages.
    pub fn wake_viewers(&mut self) {
        for id in std::mem::take(&mut self.stirred) {
            if let Some(viewer) = self.viewers.get(&id) {
                viewer.wake.notify_one();
            }
        }
    }

    /// Adds a viewer; returns its number, and the notification that [`take`](Self::take) has output.
    pub fn join(&mut self) -> (ViewerId, Arc<Notify>) {
        let (id, wake) = (self.next, Arc::new(Notify::new()));
        self.next += 1;
        // Announces the existing channels first.
        wake.notify_one();
        let viewer = Viewer {
            subscriptions: BTreeMap::new(),
            queue: VecDeque::new(),
            bytes: 0,
            told: 0,
            time: 0,
            wake: wake.clone(),
        };
        self.viewers.insert(id, viewer);
        (id, wake)
    }

    /// Removes a viewer.
    pub fn leave(&mut self, id: ViewerId) {
        self.viewers.remove(&id);
    }

    /// Adds a subscription; queues the newest message of the channel if that is a state.
    ///
    /// # Errors
    /// Text for the user: unknown channel, duplicate subscription, or number already in use.
    pub fn subscribe(&mut self, id: ViewerId, wanted: Subscription) -> Result<(), String> {
        let Subscription { id: subscription, channel_id } = wanted;
        let Some(viewer) = self.viewers.get_mut(&id) else { return Ok(()) };
        // Announced channels only: each viewer has its own.
        let known = self.order[..viewer.told].contains(&channel_id);
        let Some(entry) = self.topics.get(&channel_id).filter(|_| known) else {
            return Err(format!("there is no channel {channel_id}"));
        };
        if viewer.subscriptions.contains_key(&channel_id) {
            return Err(format!("{} is subscribed to already", entry.topic.name));
        }
        if viewer.subscriptions.values().any(|used| *used == subscription) {
            return Err(format!("subscription {subscription} is in use"));
        }
        viewer.subscriptions.insert(channel_id, subscription);
        for said in entry.kept() {
            self.counts.queued += 1;
            self.counts.dropped += viewer.push(Queued { channel: channel_id, subscription, said }, self.limits.queue);
            viewer.wake.notify_one();
        }
        Ok(())
    }

    /// Removes a subscription.
    ///
    /// # Errors
    /// Text: no subscription with this number.
    pub fn unsubscribe(&mut self, id: ViewerId, subscription: u32) -> Result<(), String> {
        let Some(viewer) = self.viewers.get_mut(&id) else { return Ok(()) };
        let before = viewer.subscriptions.len();
        viewer.subscriptions.retain(|_, number| *number != subscription);
        if viewer.subscriptions.len() == before {
            return Err(format!("there is no subscription {subscription}"));
        }
        viewer.queue.retain(|queued| queued.subscription != subscription);
        viewer.bytes = viewer.queue.iter().map(Queued::len).sum();
        Ok(())
    }

    /// Next messages for a viewer, about `at_most` bytes; empty if it has all.
    pub fn take(&mut self, id: ViewerId, at_most: usize) -> Vec<Outgoing> {
        let Some(viewer) = self.viewers.get_mut(&id) else { return Vec::new() };
        let mut outgoing = Vec::new();
        let mut length = 0;
        while viewer.told < self.order.len() && length < at_most {
            let (text, told) = advertise(&self.topics, &self.order[viewer.told..], at_most);
            viewer.told += told;
            length += text.len();
            outgoing.push(Outgoing::Text(text));
        }
        while length < at_most {
            let Some(queued) = viewer.queue.pop_front() else { break };
            viewer.bytes -= queued.len();
            length += queued.len();
            let LatestMessage { time, data } = &queued.said;
            if *time >= viewer.time + CLOCK_STEP {
                viewer.time = *time;
                outgoing.push(Outgoing::Binary(protocol::time(*time)));
            }
            outgoing.push(Outgoing::Binary(protocol::message_data(queued.subscription, *time, data)));
        }
        // Continues with the rest at the next call.
        if viewer.told < self.order.len() || !viewer.queue.is_empty() {
            viewer.wake.notify_one();
        }
        outgoing
    }
}

/// Announcement of the first topics, about `at_most` bytes, at least one; and their number.
fn advertise(topics: &BTreeMap<u32, Entry>, ids: &[u32], at_most: usize) -> (String, usize) {
    let mut length = 0;
    let channels: Vec<Channel<'_>> = ids
        .iter()
        .filter_map(|id| {
            let entry = topics.get(id)?;
            Some(Channel {
                id: *id,
                topic: &entry.topic.name,
                encoding: "cdr",
                schema_name: &entry.topic.schema_name,
                schema_encoding: "ros2msg",
                schema: &entry.topic.schema_text,
            })
        })
        .take_while(|channel| {
            let fits = length < at_most;
            length += channel.schema.len() + 200;
            fits
        })
        .collect();
    (protocol::advertise(&channels), channels.len())
}

impl Entry {
    /// True if its newest message is a state; old commands and events are meaningless.
    fn is_state(&self) -> bool {
        let name = &self.topic.name;
        !name.contains("_CMD_") && !name.contains("_EVENT_") && !["/marks", "/rosout"].contains(&&**name)
    }

    fn keep(&mut self, from: &str, said: LatestMessage) {
        if let Some(kept) = self.latest.get_mut(from) {
            let old = said.time.saturating_sub(kept.fullest.time) > FULL_AGE;
            if old || said.data.len() >= kept.fullest.data.len() {
                kept.fullest = said.clone();
            }
            kept.newest = said;
        } else if self.latest.len() < SOURCES_MAX {
            self.latest.insert(from.into(), Kept { newest: said.clone(), fullest: said });
        }
    }

    /// Kept messages, in order of time.
    fn kept(&self) -> Vec<LatestMessage> {
        let more = self.latest.values().filter(|kept| self.gathers() && kept.fullest.time < kept.newest.time);
        let mut kept: Vec<LatestMessage> = more.map(|kept| kept.fullest.clone()).collect();
        kept.extend(self.latest.values().map(|kept| kept.newest.clone()));
        kept.sort_by_key(|said| said.time);
        kept
    }

    /// True if viewers combine several messages of the topic.
    fn gathers(&self) -> bool {
        ["/scene", "/tf"].contains(&&*self.topic.name)
    }
}

impl Viewer {
    /// Queues a message; returns the number of messages dropped for it.
    fn push(&mut self, queued: Queued, limit: usize) -> u64 {
        self.bytes += queued.len();
        self.queue.push_back(queued);
        if self.bytes <= limit {
            return 0;
        }
        let before = self.queue.len();
        let mut seen = BTreeSet::new();
        let mut newest: VecDeque<Queued> = VecDeque::new();
        for queued in self.queue.drain(..).rev() {
            if seen.insert(queued.channel) {
                newest.push_front(queued);
            }
        }
        self.bytes = newest.iter().map(Queued::len).sum();
        while self.bytes > limit
            && let Some(oldest) = newest.pop_front()
        {
            self.bytes -= oldest.len();
        }
        self.queue = newest;
        (before - self.queue.len()) as u64
    }
}

impl Queued {
    /// Size with overhead.
    fn len(&self) -> usize {
        self.said.data.len() + 64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { topics: 3, message: 1000, queue: 2000 };

    fn topic(id: u16, name: &str) -> Topic {
        Topic { id, name: name.into(), schema_name: "p/msg/T".into(), schema_text: "int32 a\n".into() }
    }

    /// Output for a viewer: channel texts unchanged, messages as subscription and payload, without times.
    fn taken(hub: &mut Hub, id: ViewerId) -> Vec<String> {
        let shown = |outgoing| match outgoing {
            Outgoing::Text(text) => Some(text),
            Outgoing::Binary(bytes) if bytes[0] == 1 => {
                Some(format!("{}: {}", bytes[1], String::from_utf8_lossy(&bytes[13..])))
            }
            Outgoing::Binary(_) => None,
        };
        hub.take(id, usize::MAX).into_iter().filter_map(shown).collect()
    }

    fn wanted(id: u32, channel_id: u32) -> Subscription {
        Subscription { id, channel_id }
    }

    #[test]
    fn a_late_client_gets_the_current_state_but_no_old_commands() {
        let mut hub = Hub::new(LIMITS);
        hub.publish(&topic(0, "/plan"), "ML_DATA_PLAN", 1, b"old");
        hub.publish(&topic(0, "/plan"), "ML_DATA_PLAN", 2, b"new");
        hub.publish(&topic(1, "/LL_CMD_MOTION"), "LL_CMD_MOTION", 3, b"drive");
        let (id, _) = hub.join();
        assert!(hub.subscribe(id, wanted(9, 0)).is_err(), "nothing was advertised to it");
        let told = taken(&mut hub, id);
        assert!(told.len() == 1 && told[0].contains(r#""id":1,"topic":"/LL_CMD_MOTION""#), "{told:?}");
        hub.subscribe(id, wanted(9, 0)).unwrap();
        hub.subscribe(id, wanted(8, 1)).unwrap();
        assert_eq!(taken(&mut hub, id), ["9: new"]);
        hub.publish(&topic(1, "/LL_CMD_MOTION"), "LL_CMD_MOTION", 4, b"stop");
        assert_eq!(taken(&mut hub, id), ["8: stop"]);
    }

    #[test]
    fn a_topic_of_several_messages_is_kept_complete() {
        let mut hub = Hub::new(LIMITS);
        let scene = topic(0, "/scene");
        hub.publish(&scene, "ML_DATA_ESTIMATE", 1_000_000_000, b"ellipse and outline");
        hub.publish(&scene, "ML_DATA_OBSTACLES", 1_100_000_000, b"obstacles");
        hub.publish(&scene, "ML_DATA_ESTIMATE", 1_200_000_000, b"ellipse");
        let (id, _) = hub.join();
        taken(&mut hub, id);
        hub.subscribe(id, wanted(1, 0)).unwrap();
        assert_eq!(taken(&mut hub, id), ["1: ellipse and outline", "1: obstacles", "1: ellipse"]);
        hub.publish(&scene, "ML_DATA_ESTIMATE", 5_000_000_000, b"x");
        let (id, _) = hub.join();
        taken(&mut hub, id);
        hub.subscribe(id, wanted(1, 0)).unwrap();
        assert_eq!(taken(&mut hub, id), ["1: obstacles", "1: x"], "a full message is not outdated");
    }

    #[test]
    fn a_slow_client_gets_the_newest_and_does_not_slow_others() {
        let mut hub = Hub::new(LIMITS);
        let (fast, slow) = (topic(0, "/fast"), topic(1, "/slow"));
        let viewers = [hub.join().0, hub.join().0];
        hub.publish(&fast, "F", 0, b"");
        hub.publish(&slow, "S", 0, b"");
        for id in viewers {
            taken(&mut hub, id);
            hub.subscribe(id, wanted(0, 0)).unwrap();
            hub.subscribe(id, wanted(1, 1)).unwrap();
            taken(&mut hub, id);
        }
        hub.publish(&slow, "S", 1, b"rare");
        let mut read = 0;
        for number in 0..1000 {
            hub.publish(&fast, "F", 2 + number, format!("{number}").as_bytes());
            read += taken(&mut hub, viewers[0]).len();
            assert!(hub.viewers[&viewers[1]].bytes <= LIMITS.queue);
        }
        assert_eq!(read, 1001);
        let late = taken(&mut hub, viewers[1]);
        assert_eq!((late.first().unwrap(), late.last().unwrap()), (&"1: rare".to_string(), &"0: 999".to_string()));
        let counts = hub.counts();
        assert_eq!(counts.queued - counts.dropped, (4 + read + late.len()) as u64);
        assert!(counts.dropped > 900);
    }

    #[test]
    fn excess_data_is_counted_and_not_shown() {
        let mut hub = Hub::new(LIMITS);
        for id in 0..5 {
            hub.publish(&topic(id, &format!("/{id}")), "C", 0, b"");
        }
        hub.publish(&topic(0, "/0"), "C", 0, &[0; 1001]);
        assert_eq!((hub.topics(), hub.counts().too_many, hub.counts().too_long), (3, 2, 1));
    }

    #[test]
    fn a_subscription_is_one_number_for_one_channel() {
        let mut hub = Hub::new(LIMITS);
        hub.publish(&topic(0, "/a"), "A", 0, b"a");
        hub.publish(&topic(1, "/b"), "B", 0, b"b");
        let (id, _) = hub.join();
        taken(&mut hub, id);
        hub.subscribe(id, wanted(5, 0)).unwrap();
        assert!(hub.subscribe(id, wanted(6, 0)).is_err(), "the channel");
        assert!(hub.subscribe(id, wanted(5, 1)).is_err(), "the number");
        assert!(hub.subscribe(id, wanted(6, 7)).is_err(), "no such channel");
        hub.unsubscribe(id, 5).unwrap();
        assert!(hub.unsubscribe(id, 5).is_err());
        assert!(taken(&mut hub, id).is_empty(), "pending messages are dropped with the subscription");
        hub.subscribe(id, wanted(5, 1)).unwrap();
        assert_eq!(taken(&mut hub, id), ["5: b"]);
        hub.leave(id);
        assert!(hub.subscribe(id, wanted(5, 1)).is_ok() && taken(&mut hub, id).is_empty(), "it has gone");
    }

    #[test]
    fn many_channels_are_advertised_in_pieces_completely() {
        let mut hub = Hub::new(Limits { topics: 100, ..LIMITS });
        for id in 0..100 {
            hub.publish(&topic(id, &format!("/{id}")), "C", 0, b"");
        }
        let (id, wake) = hub.join();
        let mut pieces = 0;
        let mut channels = 0;
        loop {
            let outgoing = hub.take(id, 1000);
            if outgoing.is_empty() {
                break;
            }
            pieces += 1;
            let texts = outgoing.iter().map(|outgoing| match outgoing {
                Outgoing::Text(text) => text.matches("schemaName").count(),
                Outgoing::Binary(_) => 0,
            });
            channels += texts.sum::<usize>();
        }
        assert!(channels == 100 && pieces > 5, "{channels} {pieces}");
        let _ = wake;
    }
}
