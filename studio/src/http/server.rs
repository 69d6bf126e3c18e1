//! The server: its addresses, and its limits of connections.

use super::socket::Socket;
use super::{App, router};
use crate::project::OWN;
use crate::security::entry::Entry;
use crate::security::hosts::Hosts;
use crate::studio::{Options, Studio};
use crate::{Error, Result};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, watch};

/// Connections at a time; others wait until one ends.
const MOST_CONNECTIONS: usize = 256;
/// Uploads at a time.
const MOST_UPLOADS: usize = 4;
/// Threads that wait for files and compute for pages, beside those that sample.
const MOST_THREADS: usize = 16;
/// The longest time for the head of a request, and the most bytes of it.
const HEAD_TIME: Duration = Duration::from_secs(10);
const HEAD_BYTES: usize = 64 << 10;

/// The addresses of a studio.
#[derive(Debug, Clone, Default)]
pub struct Listen {
    /// The port; 0: a free one.
    pub port: u16,
    /// Names and addresses of this machine beside loopback under which it answers.
    pub bind: Vec<String>,
    /// A folder of the page's files, instead of those in the program.
    pub assets: Option<PathBuf>,
}

/// A server that listens.
pub struct Server {
    app: Arc<App>,
    listeners: Vec<TcpListener>,
    address: String,
    file: PathBuf,
}

/// Ends a server from elsewhere.
#[derive(Debug, Clone)]
pub struct Stopper(watch::Sender<bool>);

impl Stopper {
    /// Ends it.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl Server {
    /// Opens a project and listens.
    ///
    /// # Errors
    /// Those of [`Studio::open`]; a port that is taken, a host that isn't this machine's.
    pub fn open(options: &Options, listen: &Listen) -> Result<Server> {
        // first, as a port that is taken is found before a project is locked
        let (listeners, port) = listeners(listen)?;
        let studio = Studio::open(options)?;
        let address = format!("http://127.0.0.1:{port}");
        let file = studio.project().folder().join(OWN).join("open.html");
        let entry = Entry::new(&file, &address, port)?;
        let (hosts, uploads) = (Hosts::new(port, &listen.bind), Semaphore::new(MOST_UPLOADS));
        let (assets, stop) = (listen.assets.clone(), watch::Sender::new(false));
        let app = Arc::new(App { studio, entry, hosts, assets, uploads, stop });
        Ok(Server { app, listeners, address, file })
    }

    /// The file that leads a browser in.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Its address: `http://127.0.0.1:PORT`.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// The studio.
    pub fn studio(&self) -> &Arc<Studio> {
        &self.app.studio
    }

    /// A handle that ends it.
    pub fn stopper(&self) -> Stopper {
        Stopper(self.app.stop.clone())
    }

    /// Serves until it is stopped. It needs a thread that isn't one of the pool that computes.
    ///
    /// # Errors
    /// A runtime that can't be made.
    pub fn run(self) -> Result<()> {
        let threads = self.app.studio.start();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(MOST_THREADS)
            .build()
            .map_err(Error::io("the runtime"))?;
        let served = runtime.block_on(serve(self.app.clone(), self.listeners));
        self.app.entry.close();
        self.app.studio.end();
        // the work of a page's last request may still write
        runtime.shutdown_timeout(Duration::from_secs(5));
        threads.into_iter().for_each(|thread| {
            let _ = thread.join();
        });
        served
    }
}

/// Listens on loopback of both kinds, and on the hosts that were named.
fn listeners(listen: &Listen) -> Result<(Vec<TcpListener>, u16)> {
    let bound = |address: SocketAddr| {
        let listener = TcpListener::bind(address).map_err(Error::io(address.to_string()))?;
        // tokio takes a listener as it is, and a blocking one would stop its only thread
        listener.set_nonblocking(true).map_err(Error::io(address.to_string()))?;
        Ok::<_, Error>(listener)
    };
    let first = bound((Ipv4Addr::LOCALHOST, listen.port).into())?;
    let port = first.local_addr().map_err(Error::io("127.0.0.1"))?.port();
    let mut all = vec![first];
    // a system without it has one way less
    all.extend(bound((Ipv6Addr::LOCALHOST, port).into()).ok());
    for host in &listen.bind {
        let wrong = |found: String| {
            Error::invalid_parameter("bind", found, "a name or an address of this machine, as browsers will name it")
        };
        let ip = host.parse::<IpAddr>();
        if host.is_empty() || host.contains(['/', ' ', '@']) || ip.is_ok_and(|ip| ip.is_unspecified()) {
            return Err(wrong(host.clone()));
        }
        let found = (host.as_str(), port).to_socket_addrs().map_err(|e| wrong(format!("{host}: {e}")))?;
        // loopback has its listener already: binding it again would fail
        let found: Vec<SocketAddr> = found.filter(|address| !address.ip().is_loopback()).collect();
        for address in &found {
            all.push(bound(*address)?);
        }
    }
    Ok((all, port))
}

async fn serve(app: Arc<App>, listeners: Vec<TcpListener>) -> Result<()> {
    let (router, mut stop) = (router(app.clone()), app.stop.subscribe());
    let room = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    for listener in listeners {
        let listener = tokio::net::TcpListener::from_std(listener).map_err(Error::io("the server"))?;
        tokio::spawn(accept(listener, router.clone(), room.clone()));
    }
    let _ = stop.wait_for(|stop| *stop).await;
    // the answer to the request that stopped it
    tokio::time::sleep(Duration::from_millis(100)).await;
    Ok(())
}

/// Takes connections as long as there is room.
async fn accept(listener: tokio::net::TcpListener, router: axum::Router, room: Arc<Semaphore>) {
    loop {
        // before accepting: connections beyond the limit wait in the system's queue, not in our memory
        let Ok(place) = room.clone().acquire_owned().await else { return };
        let Ok((stream, _)) = listener.accept().await else {
            // too many open files: some will be closed
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).max_buf_size(HEAD_BYTES);
            // errors of a client end its own connection only
            let _ = http.serve_connection(TokioIo::new(Socket::new(stream)), service).await;
            drop(place);
        });
    }
}
