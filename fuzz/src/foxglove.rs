//! Foxglove hub with viewers that misbehave.

use logger::ros::Topic;
use web::foxglove::hub::{Hub, Limits, Outgoing, ViewerId};
use web::foxglove::protocol::{Request, Subscription};
use std::collections::BTreeMap;

const LIMITS: Limits = Limits { topics: 20, message: 200, queue: 1000 };

/// Viewers of the Foxglove endpoint that connect, leave, send and read arbitrarily, while topics are published.
///
/// The queue of a viewer is bounded; each message is delivered once or counted as dropped; only subscribed channels are
/// delivered.
pub fn foxglove(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<(u8, u8, u16, &[u8])>>(data) else { return };
    let mut hub = Hub::new(LIMITS);
    // Of each viewer: channel to its number for it.
    let mut viewers: BTreeMap<ViewerId, BTreeMap<u32, u32>> = BTreeMap::new();
    let mut delivered = 0;
    for (what, who, number, data) in steps {
        let id = viewers.keys().nth(usize::from(who) % viewers.len().max(1)).copied();
        match (what % 8, id) {
            (0, _) if viewers.len() < 8 => {
                viewers.insert(hub.join().0, Default::default());
            }
            (1, Some(id)) if who % 8 == 0 => {
                delivered += take(&mut hub, id, usize::MAX, &viewers[&id]);
                hub.leave(id);
                viewers.remove(&id);
            }
            (2, Some(id)) => {
                let wanted = Subscription { id: u32::from(number), channel_id: u32::from(who) };
                if hub.subscribe(id, wanted).is_ok() {
                    let had = viewers.get_mut(&id).map(|viewer| viewer.insert(wanted.channel_id, wanted.id));
                    assert_eq!(had, Some(None), "one subscription for one channel");
                }
            }
            (3, Some(id)) => {
                delivered += take(&mut hub, id, usize::MAX, &viewers[&id]);
                let known = viewers[&id].values().any(|subscription| *subscription == u32::from(number));
                assert_eq!(hub.unsubscribe(id, number.into()).is_ok(), known);
                viewers.entry(id).or_default().retain(|_, subscription| *subscription != u32::from(number));
            }
            (4, Some(id)) => delivered += take(&mut hub, id, usize::from(number), &viewers[&id]),
            (5, _) => {
                let text = String::from_utf8_lossy(data);
                let refused = Request::text(&text).err().map(|refused| refused.to_string());
                assert!(refused.is_none_or(|refused| refused.len() < 1000));
                assert!(Request::binary(data).to_string().len() < 200);
            }
            _ => {
                let (id, name) = (u16::from(who % 32), ["/scene", "/LL_DATA_A", "/LL_CMD_A", "/marks"]);
                let suffix = if id < 4 { String::new() } else { id.to_string() };
                let name = format!("{}{suffix}", name[usize::from(id % 4)]).into();
                let topic = Topic { id, name, schema_name: "p/msg/T".into(), schema_text: "int32 a".into() };
                hub.publish(&topic, ["A", "B"][usize::from(what) / 8 % 2], u64::from(number), data);
                hub.wake_viewers();
            }
        }
    }
    for (id, subscriptions) in &viewers {
        delivered += take(&mut hub, *id, usize::MAX, subscriptions);
        assert!(hub.take(*id, usize::MAX).is_empty());
    }
    let counts = hub.counts();
    assert_eq!(counts.queued, counts.dropped + delivered);
    assert!(hub.topics() <= LIMITS.topics);
}

/// What a viewer is sent at once; how many messages.
fn take(hub: &mut Hub, id: ViewerId, at_most: usize, subscriptions: &BTreeMap<u32, u32>) -> u64 {
    let (mut messages, mut bytes) = (0, 0);
    for outgoing in hub.take(id, at_most) {
        match outgoing {
            Outgoing::Text(text) => assert!(text.starts_with(r#"{"op":"advertise","channels":[{"#)),
            Outgoing::Binary(sent) if sent[0] == 1 => {
                let subscription = u32::from_le_bytes([sent[1], sent[2], sent[3], sent[4]]);
                assert!(subscriptions.values().any(|known| *known == subscription));
                messages += 1;
                bytes += sent.len() - 13;
            }
            Outgoing::Binary(sent) => assert!(sent[0] == 2 && sent.len() == 9),
        }
    }
    assert!(bytes <= LIMITS.queue, "{bytes}");
    messages
}
