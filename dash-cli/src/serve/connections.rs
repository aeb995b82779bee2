//! The page's server: HTTP/1.1 from a few threads of its own, one request a connection.
//!
//! Whoever comes while all threads are taken and the queue is full is turned away, and nobody is waited for longer than
//! [`PATIENCE`]: a run that trains does not suffer from its visitors.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::site::{Answer, Request, Site};
use crate::failure::Failure;

/// Threads that answer.
const THREADS: usize = 4;
/// Connections that wait for one of them; more are turned away.
const WAITING: usize = 64;
/// How long a request may take to come, and a piece of an answer to go.
const PATIENCE: Duration = Duration::from_secs(3);
/// Bytes of a request's head.
const HEAD: usize = 8192;
const HEADERS: usize = 64;

/// Takes an address.
pub fn bind(address: SocketAddr) -> Result<TcpListener, Failure> {
    TcpListener::bind(address).map_err(|error| refused(address, &error))
}

fn refused(address: SocketAddr, error: &io::Error) -> Failure {
    Failure::new(format!(
        "--serve {address}: cannot listen there: {error}; choose another port"
    ))
}

/// Serves a site until the program ends; the address where it is.
pub fn listen(address: SocketAddr, site: Site) -> Result<SocketAddr, Failure> {
    let refused = |error: io::Error| refused(address, &error);
    let listener = bind(address)?;
    let bound = listener.local_addr().map_err(refused)?;
    let (sender, receiver) = sync_channel(WAITING);
    let (site, queue) = (Arc::new(site), Arc::new(Mutex::new(receiver)));
    for _ in 0..THREADS {
        let (site, queue) = (site.clone(), queue.clone());
        let work = move || {
            while let Some(stream) = next(&queue) {
                // A visitor who is gone, or talks nonsense, is no concern of the run.
                let _ = serve(stream, &site);
            }
        };
        let named = thread::Builder::new().name("serve".into());
        named.spawn(work).map_err(refused)?;
    }
    let accept = move || {
        for stream in listener.incoming() {
            match stream {
                // Dropped, and so closed, where the queue is full.
                Ok(stream) => drop(sender.try_send(stream)),
                // The system has no room at the moment.
                Err(_) => thread::sleep(Duration::from_millis(100)),
            }
        }
    };
    let named = thread::Builder::new().name("accept".into());
    named.spawn(accept).map_err(refused)?;
    Ok(bound)
}

fn next(queue: &Mutex<Receiver<TcpStream>>) -> Option<TcpStream> {
    let queue = queue.lock().unwrap_or_else(PoisonError::into_inner);
    queue.recv().ok()
}

fn serve(mut stream: TcpStream, site: &Site) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut head = [0; HEAD];
    let n = read_head(&mut stream, &mut head)?;
    let answer = answer(&head[..n], site);
    let Answer {
        status,
        kind,
        cookie,
        body,
    } = answer;
    let cookie = cookie.map_or_else(String::new, |cookie| format!("Set-Cookie: {cookie}\r\n"));
    let reason = match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        _ => "Method Not Allowed",
    };
    let head = format!(
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n{cookie}Cache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(&body)
}

/// Reads to the end of a request's head, or as much of it as there is room for.
fn read_head(stream: &mut TcpStream, head: &mut [u8]) -> io::Result<usize> {
    let start = Instant::now();
    let mut n = 0;
    while n < head.len() && !head[..n].ends_with(b"\r\n\r\n") {
        let left = PATIENCE.checked_sub(start.elapsed());
        let left = left.filter(|left| !left.is_zero());
        stream.set_read_timeout(Some(left.ok_or(io::ErrorKind::TimedOut)?))?;
        match stream.read(&mut head[n..])? {
            0 => break,
            more => n += more,
        }
    }
    Ok(n)
}

/// The answer to a request's head.
pub fn answer(head: &[u8], site: &Site) -> Answer {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let is_whole = matches!(parsed.parse(head), Ok(httparse::Status::Complete(_)));
    let (Some(method), Some(target), true) = (parsed.method, parsed.path, is_whole) else {
        return Answer::plain(400, "expected a request of HTTP/1.1 with a short head");
    };
    let header = |name: &str| {
        let mut same = parsed.headers.iter();
        let header = same.find(|header| header.name.eq_ignore_ascii_case(name))?;
        str::from_utf8(header.value).ok()
    };
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    site.answer(&Request {
        method,
        path,
        query,
        host: header("host").unwrap_or_default(),
        cookie: header("cookie").unwrap_or_default(),
        is_own: header("x-dash").is_some(),
    })
}
