//! The connections of servers: how many, and for how long.

use std::{sync::Arc, time::Duration};

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use tokio::{
    net::{TcpListener, TcpStream},
    sync::Semaphore,
    time::{sleep, timeout},
};

/// The most connections that have not become web sockets. Further ones are closed at once.
const MOST_CONNECTIONS: usize = 64;
/// The time for the head of a request.
const HEAD_TIME: Duration = Duration::from_secs(5);
/// The time for a request and its answer.
const REQUEST_TIME: Duration = Duration::from_secs(20);
/// Bytes of a request's head.
const MOST_HEAD_BYTES: usize = 16 << 10;
const MOST_HEADERS: usize = 64;
/// The time to wait if the system has no connection to give, as when it has no more files.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves a limited number of connections, each for a limited time, until `end` is complete.
pub async fn serve(listener: TcpListener, router: Router, end: impl Future<Output = ()>) {
    let permits = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    tokio::pin!(end);
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = &mut end => return,
        };
        match (accepted, permits.clone().try_acquire_owned()) {
            (Ok((stream, _)), Ok(permit)) => {
                let router = router.clone();
                tokio::spawn(async move {
                    let _ = timeout(REQUEST_TIME, answer(stream, router)).await;
                    drop(permit);
                });
            }
            (Ok(_), Err(_)) => {}
            (Err(_), _) => sleep(PAUSE).await,
        }
    }
}

/// Answers the request of a connection. A socket goes on by itself.
async fn answer(stream: TcpStream, router: Router) {
    let _ = stream.set_nodelay(true);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .keep_alive(false)
        .max_buf_size(MOST_HEAD_BYTES)
        .max_headers(MOST_HEADERS)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    // Whoever breaks off need not be told.
    let _ = connection.await;
}
