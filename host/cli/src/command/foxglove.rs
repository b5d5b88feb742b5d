//! The results of matches, live, for ROS 2 and Foxglove: the messages of `match --mcap` over Foxglove's WebSocket protocol
//! (<https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>), which needs nothing of ROS.
//!
//! The server advertises a channel for each topic, and sends a client what it subscribes to: the newest result at once, as a latched
//! topic of ROS does, and each further one. A client that is too slow for a result skips it.

use std::{
    collections::BTreeMap,
    net::SocketAddr,
    sync::Arc,
    thread::{self, JoinHandle},
    time::Duration,
};

use axum::{
    Router,
    extract::{
        State, WebSocketUpgrade,
        ws::{Message, WebSocket},
    },
    routing::get,
};
use clap::Args;
use multiscopic::{
    Error, Result,
    files::ros::{RosMessage, RosRecording},
};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::{
    net::TcpListener,
    runtime::Builder,
    sync::{oneshot, watch},
    time::timeout,
};

use super::{connections, terminal};

/// The protocol, by its present name and its former one.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// The most bytes of a message of a client.
const MOST_BYTES: usize = 64 << 10;
/// The time for a client to take a message.
const TAKE_TIME: Duration = Duration::from_secs(10);

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
                "--foxglove has depths, which need the focal length in pixels: give --focal-px or --lens, or put it into rig.toml"
                    .into(),
            )),
            Some(address) => Publisher::bind(address).map(Some),
            None => Ok(None),
        }
    }
}

/// A server of results.
pub struct Publisher {
    newest: watch::Sender<Newest>,
    /// Ends the server when it is dropped.
    end: Option<oneshot::Sender<()>>,
    server: Option<JoinHandle<()>>,
}

/// The newest message of each topic. Its place is the number of its channel.
type Newest = Vec<Arc<Sent>>;

/// A message that was sent.
#[derive(Clone, Debug)]
struct Sent {
    message: RosMessage,
    /// The time since 1970 in nanoseconds.
    time: u64,
}

impl Publisher {
    /// Listens on an address.
    ///
    /// # Errors
    /// [`Error::Usage`] if it cannot.
    pub fn bind(address: SocketAddr) -> Result<Publisher> {
        let refused = |error| Error::Usage(format!("cannot listen on {address}: {error}; --foxglove gives another address"));
        let runtime = Builder::new_current_thread().enable_all().build().map_err(refused)?;
        let listener = runtime.block_on(TcpListener::bind(address)).map_err(refused)?;
        let listening = listener.local_addr().map_err(refused)?;
        let (newest, results) = watch::channel(Newest::new());
        let (end, ended) = oneshot::channel::<()>();
        let router = Router::new().route("/", get(upgrade)).with_state(results);
        let server = thread::spawn(move || {
            runtime.block_on(connections::serve(listener, router, async {
                let _ = ended.await;
            }));
        });
        terminal::say(&format!("publishing at ws://{listening}"));
        Ok(Publisher { newest, end: Some(end), server: Some(server) })
    }

    /// Sends one message for each topic to whoever has subscribed to it, all from a `time` since 1970.
    ///
    /// # Errors
    /// Those of [`RosRecording::messages`].
    pub fn publish(&self, recording: &RosRecording, time: Duration) -> Result<()> {
        let messages = recording.messages(time)?;
        let time = time.as_nanos() as u64;
        self.newest.send_modify(|newest| {
            for message in messages {
                let place = newest.iter().position(|sent| sent.message.topic == message.topic);
                let sent = Arc::new(Sent { message, time });
                match place {
                    Some(place) => newest[place] = sent,
                    None => newest.push(sent),
                }
            }
        });
        Ok(())
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        drop(self.end.take());
        // Its panic was printed; there is nobody to tell it to.
        let _ = self.server.take().map(JoinHandle::join);
    }
}

async fn upgrade(State(results): State<watch::Receiver<Newest>>, upgrade: WebSocketUpgrade) -> axum::response::Response {
    let upgrade = upgrade.protocols(PROTOCOLS).max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES);
    upgrade.on_upgrade(async move |mut socket| {
        // Whoever breaks off need not be told.
        let _ = talk(&mut socket, results).await;
    })
}

/// A message of a client. Others than these are for what the server does not offer.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Request {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        #[serde(rename = "subscriptionIds")]
        ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
struct Subscription {
    id: u32,
    #[serde(rename = "channelId")]
    channel: usize,
}

/// Talks to a client until it leaves, is too slow, or says what makes no sense. `None` at the end.
async fn talk(socket: &mut WebSocket, mut results: watch::Receiver<Newest>) -> Option<()> {
    let name = concat!("multiscopic ", env!("CARGO_PKG_VERSION"));
    tell(socket, &json!({ "op": "serverInfo", "name": name, "capabilities": [], "supportedEncodings": [], "metadata": {} }))
        .await?;
    let (mut advertised, mut channels) = (0, BTreeMap::new());
    results.mark_changed();
    loop {
        tokio::select! {
            changed = results.changed() => {
                changed.ok()?;
                let newest = results.borrow_and_update().clone();
                let new: Vec<Value> = (advertised..).zip(&newest[advertised..]).map(|(id, sent)| channel(id, &sent.message)).collect();
                advertised = newest.len();
                if !new.is_empty() {
                    tell(socket, &json!({ "op": "advertise", "channels": new })).await?;
                }
                for (&id, &channel) in &channels {
                    send(socket, id, newest.get::<usize>(channel)).await?;
                }
            }
            received = socket.recv() => match received?.ok()? {
                Message::Text(text) => match serde_json::from_str(&text).ok()? {
                    Request::Subscribe { subscriptions } => {
                        for Subscription { id, channel } in subscriptions.into_iter().filter(|asked| asked.channel < advertised) {
                            channels.insert(id, channel);
                            let sent = results.borrow().get(channel).cloned();
                            send(socket, id, sent.as_ref()).await?;
                        }
                    }
                    Request::Unsubscribe { ids } => channels.retain(|id, _| !ids.contains(id)),
                    Request::Other => {}
                },
                Message::Close(_) => return None,
                Message::Binary(_) | Message::Ping(_) | Message::Pong(_) => {}
            },
        }
    }
}

/// A channel as it is advertised.
fn channel(id: usize, message: &RosMessage) -> Value {
    json!({
        "id": id,
        "topic": message.topic,
        "encoding": RosMessage::ENCODING,
        "schemaName": message.schema_name(),
        "schema": message.schema_text(),
        "schemaEncoding": RosMessage::SCHEMA_ENCODING,
    })
}

async fn tell(socket: &mut WebSocket, message: &Value) -> Option<()> {
    timeout(TAKE_TIME, socket.send(Message::Text(message.to_string().into()))).await.ok()?.ok()
}

/// Sends a message to the subscription of this number.
async fn send(socket: &mut WebSocket, subscription: u32, sent: Option<&Arc<Sent>>) -> Option<()> {
    let Some(sent) = sent else { return Some(()) };
    const MESSAGE_DATA: u8 = 1;
    let head = [&[MESSAGE_DATA][..], &subscription.to_le_bytes(), &sent.time.to_le_bytes()];
    let data = [&head.concat()[..], &sent.message.cdr].concat();
    timeout(TAKE_TIME, socket.send(Message::Binary(data.into()))).await.ok()?.ok()
}
