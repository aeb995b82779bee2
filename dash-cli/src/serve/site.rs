//! What the page's server answers.
//!
//! Every answer comes from memory: paths are names in a list, and none is a path of the machine.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::board::Board;

/// The cookie that carries the token once the page's address has.
const COOKIE: &str = "dash-token";

/// A request, as far as an answer depends on it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Request<'a> {
    pub method: &'a str,
    /// As it came: nothing is decoded.
    pub path: &'a str,
    /// What stands behind the question mark.
    pub query: &'a str,
    pub host: &'a str,
    pub cookie: &'a str,
    /// Whether it has the header of the page's own requests, which a page of another origin can't send.
    pub is_own: bool,
}

/// An answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    pub status: u16,
    /// The media type of the body.
    pub kind: &'static str,
    /// A cookie to set.
    pub cookie: Option<String>,
    pub body: Vec<u8>,
}

/// What there is to hand out.
pub struct Site {
    board: Arc<Board>,
    files: BTreeMap<String, Vec<u8>>,
    token: Option<String>,
}

impl Site {
    /// A site of these files, `index.html` among them, that a token guards where it is public.
    pub fn new(board: Arc<Board>, files: BTreeMap<String, Vec<u8>>, public: bool) -> Self {
        let token = public.then(|| format!("{:032x}", rand::random::<u128>()));
        Self {
            board,
            files,
            token,
        }
    }

    pub fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// The answer to a request.
    pub fn answer(&self, request: &Request) -> Answer {
        if !self.may_enter(request) {
            return Answer::plain(403, self.refusal());
        }
        let path = request.path;
        match (request.method, path) {
            ("GET", "/") => Answer {
                cookie: self
                    .token
                    .as_ref()
                    .map(|token| format!("{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/")),
                ..self.file("index.html")
            },
            ("GET", "/state.json") => Answer::found(self.board.json(), "application/json"),
            ("GET", _) => match versioned(path) {
                Some((version, name)) => match self.board.file(version, name) {
                    Some(bytes) => Answer::found(bytes, kind(name)),
                    None => Answer::missing(),
                },
                None => self.file(path.strip_prefix('/').unwrap_or(path)),
            },
            ("POST", "/pause" | "/resume") if request.is_own => {
                self.board.pause(path == "/pause");
                Answer::plain(200, "done")
            }
            ("POST", "/pause" | "/resume") => {
                Answer::plain(403, "only this run's page may ask for that")
            }
            ("POST", _) => Answer::missing(),
            _ => Answer::plain(405, "only GET and POST are answered"),
        }
    }

    fn file(&self, name: &str) -> Answer {
        match self.files.get(name) {
            Some(bytes) => Answer::found(bytes.clone(), kind(name)),
            None => Answer::missing(),
        }
    }

    /// Behind a token, whoever has it; else whoever is on this machine. A name that was made to point at this machine is
    /// none of its names.
    fn may_enter(&self, request: &Request) -> bool {
        let Some(token) = &self.token else {
            let host = request.host;
            let name = host.rsplit_once(':').map_or(host, |(name, port)| {
                match port.bytes().all(|b| b.is_ascii_digit()) {
                    true => name,
                    false => host,
                }
            });
            return name == "localhost" || is_loopback(name);
        };
        let pairs = request.query.split('&');
        let by_query = pairs.filter_map(|pair| pair.strip_prefix("token="));
        let cookies = request.cookie.split("; ");
        let by_cookie = cookies.filter_map(|pair| pair.strip_prefix(COOKIE)?.strip_prefix('='));
        by_query.chain(by_cookie).any(|given| is_same(given, token))
    }

    fn refusal(&self) -> &'static str {
        match &self.token {
            Some(_) => "this page needs the token in its address, which the run has printed",
            None => "this page is for the machine that trains: open 127.0.0.1 or localhost",
        }
    }
}

fn is_loopback(name: &str) -> bool {
    let address = name.trim_matches(['[', ']']).parse::<std::net::IpAddr>();
    address.is_ok_and(|address| address.is_loopback())
}

/// In a time that says nothing about where they differ.
fn is_same(given: &str, token: &str) -> bool {
    let pairs = given.bytes().zip(token.bytes());
    given.len() == token.len() && pairs.fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
}

/// The version and name in `/v3/part0.bin.gz`.
fn versioned(path: &str) -> Option<(usize, &str)> {
    let (version, name) = path.strip_prefix("/v")?.split_once('/')?;
    Some((version.parse().ok()?, name))
}

fn kind(name: &str) -> &'static str {
    match name.rsplit_once('.') {
        Some((_, "html")) => "text/html; charset=utf-8",
        Some((_, "js")) => "text/javascript; charset=utf-8",
        _ => "application/octet-stream",
    }
}

impl Answer {
    fn found(body: Vec<u8>, kind: &'static str) -> Self {
        Self {
            status: 200,
            kind,
            cookie: None,
            body,
        }
    }

    /// A sentence.
    pub fn plain(status: u16, text: &str) -> Self {
        Self {
            status,
            ..Self::found(text.into(), "text/plain; charset=utf-8")
        }
    }

    fn missing() -> Self {
        Self::plain(404, "nothing is here")
    }
}
