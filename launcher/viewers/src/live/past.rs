//! What is published once in a flight, for viewers that come later: owners, orders, seats and events.

use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{PartialMetadata, RawChannel};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

/// Messages of one channel that are kept, the newest.
const KEPT: usize = 256;

/// Messages with their stamps, Unix time \[ns\].
type Messages = VecDeque<(u64, Vec<u8>)>;

/// The last messages of some channels.
#[derive(Debug)]
pub(super) struct Past {
    /// By topic.
    kept: BTreeMap<String, (Arc<RawChannel>, Mutex<Messages>)>,
}

impl Past {
    /// Of these channels.
    pub(super) fn of(channels: impl IntoIterator<Item = Arc<RawChannel>>) -> Self {
        let channels = channels.into_iter();
        let kept = channels.map(|channel| {
            let topic = channel.topic().to_owned();
            (topic, (channel, Mutex::default()))
        });
        Self { kept: kept.collect() }
    }

    /// True if what is published on a topic is kept.
    pub(super) fn keeps(&self, topic: &str) -> bool {
        self.kept.contains_key(topic)
    }

    /// Keeps a message, if its topic is one of those.
    pub(super) fn keep(&self, topic: &str, unix_ns: u64, message: &[u8]) {
        let Some((_, messages)) = self.kept.get(topic) else { return };
        let mut messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
        if messages.len() == KEPT {
            messages.pop_front();
        }
        messages.push_back((unix_ns, message.to_vec()));
    }
}

impl ServerListener for Past {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        let Some((channel, messages)) = self.kept.get(channel.topic()) else { return };
        let messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
        for (unix_ns, message) in messages.iter() {
            let stamp = PartialMetadata::with_log_time(*unix_ns);
            channel.log_with_meta_to_sink(message, stamp, client.sink_id());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{KEPT, Past};
    use foxglove::{ChannelBuilder, Context};

    #[test]
    fn the_newest_messages_of_the_topics_named_are_kept_and_no_others() {
        let context = Context::new();
        let channel = |topic| {
            let channel = ChannelBuilder::new(topic).message_encoding("protobuf");
            channel.context(&context).build_raw().unwrap()
        };
        let past = Past::of([channel("/events")]);
        assert!(past.keeps("/events") && !past.keeps("/truth"));
        past.keep("/truth", 1, b"x");
        for i in 0..KEPT as u64 + 10 {
            past.keep("/events", i, &i.to_le_bytes());
        }
        let messages = past.kept["/events"].1.lock().unwrap();
        assert_eq!((messages.len(), messages[0].0), (KEPT, 10));
    }
}
