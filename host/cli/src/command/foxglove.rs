//! The results of matches, live, for ROS 2 and Foxglove: the messages of `match --mcap` over Foxglove's WebSocket protocol, which needs
//! nothing of ROS.
//!
//! Whoever subscribes gets the newest result at once, as from a latched topic of ROS.

use std::{
    collections::BTreeMap,
    net::SocketAddr,
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use clap::Args;
use foxglove::{
    ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServer, WebSocketServerHandle,
    websocket::{ChannelView, Client, ServerListener},
};
use multiscopic::{
    Error, Result,
    files::ros::{RosMessage, RosRecording},
};

use super::terminal;

/// The address of the server.
#[derive(Clone, Debug, Args)]
pub struct FoxgloveOptions {
    /// Publish each result for ROS 2 and Foxglove, without ROS: the topics of `match --mcap` over Foxglove's WebSocket protocol,
    /// such as at 127.0.0.1:8765; needs the focal length and the baseline. Whoever reaches the address can read it, as can the
    /// pages of a browser on this machine
    #[arg(long, value_name = "ADDRESS:PORT", help_heading = "Output")]
    foxglove: Option<SocketAddr>,
}

impl FoxgloveOptions {
    /// Returns true if there is an address.
    pub fn is_given(&self) -> bool {
        self.foxglove.is_some()
    }

    /// Listens, if an address is given. `has_depth` tells if the focal length and the baseline are known.
    pub fn publisher(&self, has_depth: bool) -> Result<Option<Publisher>> {
        match self.foxglove {
            Some(_) if !has_depth => Err(Error::Usage(
                "--foxglove has depths, which need the focal length in pixels: give --focal-px or --lens, or put it into rig.toml".into(),
            )),
            Some(address) => Publisher::bind(address).map(Some),
            None => Ok(None),
        }
    }
}

/// A server of results.
pub struct Publisher {
    context: Arc<Context>,
    newest: Arc<Newest>,
    server: Option<WebSocketServerHandle>,
}

/// The newest message of each topic.
#[derive(Default)]
struct Newest(Mutex<BTreeMap<String, Sent>>);

/// A message that was sent.
struct Sent {
    channel: Arc<RawChannel>,
    cdr: Vec<u8>,
    /// The time since 1970 in nanoseconds.
    time: u64,
}

impl Publisher {
    /// Listens on an address.
    ///
    /// # Errors
    /// [`Error::Usage`] if it cannot.
    pub fn bind(address: SocketAddr) -> Result<Publisher> {
        let (context, newest) = (Context::new(), Arc::<Newest>::default());
        let server = WebSocketServer::new()
            .name(concat!("multiscopic ", env!("CARGO_PKG_VERSION")))
            .bind(address.ip().to_string(), address.port())
            .context(&context)
            .listener(newest.clone())
            .start_blocking();
        let server = server
            .map_err(|error| Error::Usage(format!("cannot listen on {address}: {error}; --foxglove gives another address")))?;
        terminal::say(&format!("publishing at ws://{}", SocketAddr::new(address.ip(), server.port())));
        Ok(Publisher { context, newest, server: Some(server) })
    }

    /// Sends one message for each topic to whoever has subscribed to it, all from a `time` since 1970.
    ///
    /// # Errors
    /// Those of [`RosRecording::messages`].
    pub fn publish(&self, recording: &RosRecording, time: Duration) -> Result<()> {
        let time = time.as_nanos() as u64;
        for message in recording.messages(Duration::from_nanos(time))? {
            let mut newest = self.newest.0.lock().unwrap_or_else(PoisonError::into_inner);
            let channel = match newest.get(message.topic) {
                Some(sent) => sent.channel.clone(),
                None => self.channel(&message)?,
            };
            channel.log_with_meta(&message.cdr, PartialMetadata::with_log_time(time));
            newest.insert(message.topic.into(), Sent { channel, cdr: message.cdr, time });
        }
        Ok(())
    }

    fn channel(&self, message: &RosMessage) -> Result<Arc<RawChannel>> {
        let text = message.schema_text().into_bytes();
        let channel = ChannelBuilder::new(message.topic)
            .message_encoding(RosMessage::ENCODING)
            .schema(Schema::new(message.schema_name(), RosMessage::SCHEMA_ENCODING, text))
            .context(&self.context)
            .build_raw();
        channel.map_err(|error| Error::Usage(format!("{} cannot be published: {error}", message.topic)))
    }
}

impl ServerListener for Newest {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        let newest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(Sent { channel, cdr, time }) = newest.get(channel.topic()) {
            channel.log_with_meta_to_sink(cdr, PartialMetadata::with_log_time(*time), client.sink_id());
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            server.stop().wait_blocking();
        }
    }
}
