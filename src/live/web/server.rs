//! The server: connections with limits, four files, one stream of events, one way to control.

use super::body::Answer;
use super::feed::{Feed, Update};
use super::guard::Guard;
use super::patience::Patient;
use http_body_util::{BodyExt as _, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderValue, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
    X_FRAME_OPTIONS,
};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, broadcast, mpsc, oneshot};
use tokio::time::{sleep, timeout};

const PAGE: &str = include_str!("../../../assets/live/page.html");
const SCRIPT: &str = include_str!("../../../assets/live/page.js");
const STYLE: &str = include_str!("../../../assets/live/page.css");
const CHARTS: &str = include_str!("../../../assets/live/uPlot.iife.min.js");
const CHARTS_STYLE: &str = include_str!("../../../assets/live/uPlot.min.css");

/// Largest number of connections; further ones are closed at once.
const CONNECTIONS: usize = 128;
/// How long a request's head may take, and its body.
const HEAD: Duration = Duration::from_secs(5);
const BODY: Duration = Duration::from_secs(5);
/// Largest size of a head and of a body \[bytes\].
const HEAD_BYTES: usize = 16 * 1024;
const BODY_BYTES: usize = 4 * 1024;
/// How long a browser may leave sent data unread.
const UNREAD: Duration = Duration::from_secs(10);
/// Bytes that the system buffers for a slow browser.
const SEND_BUFFER: u32 = 64 * 1024;
/// How long a browser waits for the answer to a command.
const CONTROL: Duration = Duration::from_secs(5);
/// How long the last events may take when the server ends.
const LAST: Duration = Duration::from_millis(200);

/// Options of the server.
#[derive(Debug)]
pub struct WebOptions {
    /// Address to listen on; port 0 for any free port.
    pub address: SocketAddr,
    /// Receiver of commands; without it there are no controls.
    pub control: Option<SyncSender<ControlRequest>>,
}

/// A command from the page, as JSON: `{"command": "pause"}`, `{"command": "fix", "name": "theta_1",
/// "value": 1.5}`.
#[derive(Debug)]
pub struct ControlRequest {
    /// The JSON text, at most 4 kB.
    pub text: String,
    /// Channel for the answer: a text, `Err` if it was refused.
    pub answer: oneshot::Sender<Result<String, String>>,
}

/// A server on a separate thread; it ends on drop.
#[derive(Debug)]
pub struct WebServer {
    address: SocketAddr,
    token: Option<String>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    feed: Feed,
    guard: Guard,
    control: Option<SyncSender<ControlRequest>>,
}

impl WebServer {
    /// Listens and begins to serve.
    ///
    /// # Errors
    /// If the address is not one of this machine or is in use, or no thread can be started.
    pub fn start(feed: Feed, options: WebOptions) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let listener = runtime.block_on(async { listen(options.address) })?;
        let address = listener.local_addr()?;
        let guard = Guard::new(address)?;
        let needs_token = guard.is_closed() || options.control.is_some();
        let token = needs_token.then(|| guard.token().to_owned());
        let shared = Arc::new(Shared {
            feed,
            guard,
            control: options.control,
        });
        let (stop, stopped) = oneshot::channel();
        let thread = std::thread::Builder::new()
            .name("web".into())
            .spawn(move || serve(&runtime, &listener, &shared, stopped))?;
        Ok(Self {
            address,
            token,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// The address to open in a browser; includes the token if needed.
    pub fn url(&self) -> String {
        match &self.token {
            Some(token) => format!("http://{}/?token={token}", self.address),
            None => format!("http://{}/", self.address),
        }
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // The next server may use the address while old connections are still closing.
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(64)
}

fn serve(runtime: &Runtime, listener: &TcpListener, shared: &Arc<Shared>, stopped: oneshot::Receiver<()>) {
    let room = Arc::new(Semaphore::new(CONNECTIONS));
    runtime.block_on(async {
        let accept = async {
            loop {
                match listener.accept().await {
                    Ok((stream, _)) => {
                        // A connection beyond the limit is closed by dropping it.
                        if let Ok(place) = room.clone().try_acquire_owned() {
                            let shared = shared.clone();
                            runtime.spawn(async move {
                                connection(stream, shared).await;
                                drop(place);
                            });
                        }
                    }
                    // A temporary failure, for example no free file descriptor.
                    Err(_) => sleep(Duration::from_millis(100)).await,
                }
            }
        };
        either(accept, stopped).await;
        sleep(LAST).await;
    });
}

/// Runs until the first of the two ends.
async fn either(endless: impl Future<Output = ()>, stopped: oneshot::Receiver<()>) {
    let (mut endless, mut stopped) = (std::pin::pin!(endless), std::pin::pin!(stopped));
    std::future::poll_fn(|cx| {
        let done = stopped.as_mut().poll(cx).is_ready() || endless.as_mut().poll(cx).is_ready();
        if done {
            std::task::Poll::Ready(())
        } else {
            std::task::Poll::Pending
        }
    })
    .await;
}

async fn connection(stream: TcpStream, shared: Arc<Shared>) {
    let io = TokioIo::new(Patient::new(stream, UNREAD));
    let service = service_fn(move |request| {
        let shared = shared.clone();
        async move { Ok::<_, Infallible>(answer(request, &shared).await) }
    });
    // After a failed connection there is no one to report to.
    let _ = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .max_buf_size(HEAD_BYTES)
        .keep_alive(false)
        .serve_connection(io, service)
        .await;
}

async fn answer(request: Request<Incoming>, shared: &Shared) -> Response<Answer> {
    if let Err(why) = shared.guard.admits(request.headers()) {
        return refusal(StatusCode::FORBIDDEN, why);
    }
    let token = request.uri().query().and_then(|query| {
        let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
        pairs.find(|(name, _)| *name == "token").map(|(_, token)| token)
    });
    let known = shared.guard.knows(token);
    let open = known || !shared.guard.is_closed();
    let closed = || {
        refusal(
            StatusCode::FORBIDDEN,
            "open the address that the monitor has printed: its token is missing or of another start",
        )
    };
    match (request.method(), request.uri().path()) {
        (&Method::GET, "/") if open => with_headers(
            StatusCode::OK,
            "text/html; charset=utf-8",
            Answer::of(page(&shared.feed)),
        ),
        (&Method::GET, "/page.js") => file(SCRIPT, "text/javascript; charset=utf-8"),
        (&Method::GET, "/page.css") => file(STYLE, "text/css; charset=utf-8"),
        (&Method::GET, "/uplot.js") => file(CHARTS, "text/javascript; charset=utf-8"),
        (&Method::GET, "/uplot.css") => file(CHARTS_STYLE, "text/css; charset=utf-8"),
        (&Method::GET, "/events") if open => events(&shared.feed),
        (&Method::POST, "/control") => match &shared.control {
            None => refusal(
                StatusCode::NOT_FOUND,
                "this page only shows; start the monitor with --web-control to control by it",
            ),
            Some(_) if !known => closed(),
            Some(control) => command(request, control).await,
        },
        (&Method::GET, "/" | "/events") => closed(),
        (_, "/" | "/events" | "/control") => refusal(StatusCode::METHOD_NOT_ALLOWED, "wrong method"),
        _ => refusal(StatusCode::NOT_FOUND, "there is no such page"),
    }
}

async fn command(request: Request<Incoming>, control: &SyncSender<ControlRequest>) -> Response<Answer> {
    if !Guard::is_json(request.headers()) {
        return refusal(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "expected content-type application/json",
        );
    }
    let body = timeout(BODY, Limited::new(request.into_body(), BODY_BYTES).collect()).await;
    let text = body
        .ok()
        .and_then(Result::ok)
        .and_then(|body| String::from_utf8(body.to_bytes().to_vec()).ok());
    let Some(text) = text else {
        return refusal(StatusCode::BAD_REQUEST, "expected at most 4 kB of JSON in UTF-8");
    };
    let (answer, answered) = oneshot::channel();
    match control.try_send(ControlRequest { text, answer }) {
        Ok(()) => {}
        Err(TrySendError::Full(_)) => return refusal(StatusCode::TOO_MANY_REQUESTS, "other commands are waiting"),
        Err(TrySendError::Disconnected(_)) => return refusal(StatusCode::BAD_GATEWAY, "the monitor is ending"),
    }
    match timeout(CONTROL, answered).await {
        Ok(Ok(Ok(words))) => with_headers(StatusCode::OK, "text/plain; charset=utf-8", Answer::of(words)),
        Ok(Ok(Err(words))) => refusal(StatusCode::CONFLICT, &words),
        _ => refusal(
            StatusCode::GATEWAY_TIMEOUT,
            "no answer; the command may still take effect",
        ),
    }
}

/// The complete state, then updates, while the browser is connected.
fn events(feed: &Feed) -> Response<Answer> {
    let (send, receive) = mpsc::channel(1);
    let mut updates = feed.subscribe();
    let feed = feed.clone();
    tokio::spawn(async move {
        let mut next = Some(feed.whole());
        loop {
            if let Some(bytes) = next.take()
                && send.send(bytes).await.is_err()
            {
                return;
            }
            next = match updates.recv().await {
                Ok(Update::Part(bytes)) => Some(bytes),
                // Too slow, or too much at once: send the complete state again.
                Ok(Update::Renew) | Err(broadcast::error::RecvError::Lagged(_)) => Some(feed.whole()),
                Err(broadcast::error::RecvError::Closed) => return,
            };
        }
    });
    with_headers(StatusCode::OK, "text/event-stream", Answer::Events(receive))
}

/// The page with the embedded state, so that it shows data before the first event.
fn page(feed: &Feed) -> String {
    // Text in the state must not close the script element.
    let state = feed.first_json().replace('<', "\\u003c");
    PAGE.replace(
        "<!--state-->",
        &format!("<script type=\"application/json\" id=\"first\">{state}</script>"),
    )
}

fn file(text: &'static str, kind: &'static str) -> Response<Answer> {
    with_headers(StatusCode::OK, kind, Answer::of(Bytes::from_static(text.as_bytes())))
}

fn refusal(code: StatusCode, why: &str) -> Response<Answer> {
    with_headers(code, "text/plain; charset=utf-8", Answer::of(format!("{why}\n")))
}

/// Adds headers that forbid loading from elsewhere, framing, sharing with other pages, and caching.
fn with_headers(code: StatusCode, kind: &'static str, body: Answer) -> Response<Answer> {
    let mut response = Response::new(body);
    *response.status_mut() = code;
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_TYPE, kind),
        (CACHE_CONTROL, "no-store"),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (X_FRAME_OPTIONS, "DENY"),
        (REFERRER_POLICY, "no-referrer"),
        (
            CONTENT_SECURITY_POLICY,
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; \
             img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        ),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}
