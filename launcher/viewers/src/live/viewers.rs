//! Foxglove, Lichtblick and whatever else uses the Foxglove WebSocket protocol. No viewer can write.

use super::LiveError;
use super::past::Past;
use foxglove::websocket::{Capability, ServerListener};
use foxglove::{
    ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer,
    WebSocketServerHandle,
};
use prost::Message as _;
use protocol::topic::feed::Flying;
use record::scene::{self, Scene};
use record::{descriptor_set, encode, full_name, log_schema};
use runtime::clock::mono_now_ns;
use scenario::Scenario;
use shared_types::{Role, Sample, Topic, TopicInfo, TopicVisitor, topics};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread::Builder;
use std::time::Duration;

/// Messages that one viewer may be behind; then it loses the oldest.
const BACKLOG: usize = 2048;

/// From one message with the flight's time to the next \[ns\]: a viewer may be behind by as many of these as of
/// other messages, and is then disconnected.
const TIME_EVERY_NS: u64 = 20_000_000;

/// How long a viewer may take to leave.
const GOODBYE: Duration = Duration::from_millis(500);

/// The server and a channel for everything.
pub(super) struct Viewers {
    server: Option<WebSocketServerHandle>,
    address: SocketAddr,
    /// Channels live as long as this.
    _context: Arc<Context>,
    /// By topic.
    channels: BTreeMap<&'static str, Arc<RawChannel>>,
    /// By the index of the scene's channel.
    derived: Vec<Arc<RawChannel>>,
    events: Arc<RawChannel>,
    past: Arc<Past>,
    scene: Scene,
    flying: Flying,
    thinning: Thinning,
    /// Time of the flight that was sent to viewers last, and when \[ns\].
    sent_time: (u64, u64),
    buffer: Vec<u8>,
}

impl Viewers {
    pub(super) fn open(
        listen: SocketAddr,
        run: &str,
        scenario: &Scenario,
        flying: Flying,
        rate_hz: Option<f64>,
    ) -> Result<Self, LiveError> {
        let failed = |error: FoxgloveError| {
            let cause = match error {
                FoxgloveError::Bind(cause) => cause.to_string(),
                other => other.to_string(),
            };
            LiveError::Address { address: listen, cause }
        };
        let context = Context::new();
        let mut add = AddChannels { context: &context, channels: BTreeMap::new() };
        topics::visit_all(&mut add).map_err(failed)?;
        let channels = add.channels;
        let derived = scene::CHANNELS.iter().map(|channel| add_derived(&context, channel));
        let derived = derived.collect::<Result<_, _>>().map_err(failed)?;
        let (name, set) = log_schema();
        let log = Schema::new(name, "protobuf", set.encode_to_vec());
        let events = ChannelBuilder::new("/events").message_encoding("protobuf").schema(log);
        let events = events.context(&context).build_raw().map_err(failed)?;
        let seldom = topics::all().into_iter().filter(|topic| is_published_once(topic));
        let seldom = seldom.filter_map(|topic| channels.get(topic.name)).chain([&events]).cloned();
        let past = Arc::new(Past::of(seldom));
        let name = &scenario.settings().scenario.name;
        let server = WebSocketServer::new()
            .name(format!("morphquad run {run}, {name}"))
            .bind(listen.ip().to_string(), listen.port())
            .message_backlog_size(BACKLOG)
            .capabilities([Capability::Time])
            .session_id(run)
            .listener(Arc::clone(&past) as Arc<dyn ServerListener>)
            .context(&context)
            .start_blocking()
            .map_err(failed)?;
        let address = SocketAddr::new(listen.ip(), server.port());
        Ok(Self {
            server: Some(server),
            address,
            _context: context,
            channels,
            derived,
            events,
            past,
            scene: Scene::of(&scenario.real_vehicle()),
            flying,
            thinning: Thinning::to(rate_hz),
            sent_time: (0, 0),
            buffer: Vec::new(),
        })
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends a sample, and what is drawn of it, to the viewers that have subscribed.
    pub(super) fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let header = sample.header();
        let unix_ns = self.flying.unix_ns(header.release_ns);
        let stamp = PartialMetadata::with_log_time(unix_ns);
        self.send_time(unix_ns);
        // Always, for the trails behind vehicle and reference grow whether or not a viewer looks.
        for (index, message) in self.scene.observe(sample, unix_ns) {
            if let Some(channel) = self.derived.get(index) {
                channel.log_with_meta(&message, stamp);
            }
        }
        let Some(channel) = self.channels.get(topic.info.name) else { return };
        let writer = (topic.info.name, topic.info.from, header.seat);
        let is_kept = self.past.keeps(channel.topic());
        if is_kept || (channel.has_sinks() && self.thinning.lets_through(writer, header.release_ns))
        {
            self.buffer.clear();
            encode(sample, &mut self.buffer);
            channel.log_with_meta(&self.buffer, stamp);
            self.past.keep(channel.topic(), unix_ns, &self.buffer);
        }
    }

    /// Without it viewers go by their own clocks and by when a sample reaches them.
    fn send_time(&mut self, unix_ns: u64) {
        let ((sent_ns, at_ns), now_ns) = (self.sent_time, mono_now_ns());
        if unix_ns > sent_ns && now_ns >= at_ns + TIME_EVERY_NS {
            self.sent_time = (unix_ns, now_ns);
            if let Some(server) = &self.server {
                server.broadcast_time(unix_ns);
            }
        }
    }

    /// Sends a logged event.
    pub(super) fn log(&mut self, log: &[u8]) {
        let stamp_ns = record::decode_log(log).map_or(0, |(stamp_ns, ..)| stamp_ns);
        self.events.log_with_meta(log, PartialMetadata::with_log_time(stamp_ns));
        self.past.keep(self.events.topic(), stamp_ns, log);
    }

    /// True once it has closed.
    pub(super) fn is_closed(&self) -> bool {
        self.server.is_none()
    }

    /// Disconnects all viewers; one that has stopped reading is not waited for.
    pub(super) fn close(&mut self) {
        let Some(server) = self.server.take() else { return };
        let (done, is_done) = channel();
        let goodbye = Builder::new().spawn(move || {
            server.stop().wait_blocking();
            let _ = done.send(());
        });
        if let Ok(goodbye) = goodbye
            && is_done.recv_timeout(GOODBYE).is_ok()
        {
            let _ = goodbye.join();
        }
    }
}

/// Owners, orders and seats: a viewer that comes later gets them, too.
fn is_published_once(topic: &TopicInfo) -> bool {
    topic.from == Role::Supervisor
        && topic.name != topics::LOOP_STATS.info.name
        && topic.name != topics::DEVIATION.info.name
}

fn add_derived(
    context: &Arc<Context>,
    channel: &scene::Channel,
) -> Result<Arc<RawChannel>, FoxgloveError> {
    ChannelBuilder::new(channel.name)
        .message_encoding("protobuf")
        .schema((channel.schema)())
        .add_metadata("summary", channel.summary)
        .add_metadata("derived_from", &format!("/{}", channel.from))
        .context(context)
        .build_raw()
}

/// Adds a channel for every topic, as a recording has it.
struct AddChannels<'a> {
    context: &'a Arc<Context>,
    channels: BTreeMap<&'static str, Arc<RawChannel>>,
}

impl TopicVisitor for AddChannels<'_> {
    type Error = FoxgloveError;

    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), FoxgloveError> {
        let (info, layout) = (&topic.info, topic.schema());
        let set = descriptor_set(&layout).encode_to_vec();
        let channel = ChannelBuilder::new(format!("/{}", info.name))
            .message_encoding("protobuf")
            .schema(Schema::new(full_name(&layout), "protobuf", set))
            .add_metadata("summary", info.summary)
            .add_metadata("from", info.from.label())
            .context(self.context)
            .build_raw()?;
        self.channels.insert(info.name, channel);
        Ok(())
    }
}

/// Topic, role that writes it and its seat.
type Writer = (&'static str, Role, u32);

/// Lets through the first sample in each period of flight.
#[derive(Debug)]
struct Thinning {
    /// 0 lets everything through \[ns\].
    period_ns: u64,
    /// Number of the period of each writer's last sample.
    last: BTreeMap<Writer, u64>,
}

impl Thinning {
    fn to(rate_hz: Option<f64>) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let period_ns = rate_hz.map_or(0, |rate_hz| (1e9 / rate_hz) as u64);
        Self { period_ns, last: BTreeMap::new() }
    }

    fn lets_through(&mut self, writer: Writer, release_ns: u64) -> bool {
        // Several loops share the launcher's topics, and the pilot is slow.
        if self.period_ns == 0 || matches!(writer.1, Role::Supervisor | Role::Pilot) {
            return true;
        }
        let period = release_ns / self.period_ns;
        self.last.insert(writer, period) != Some(period)
    }
}
