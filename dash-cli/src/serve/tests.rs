//! What the page's server gives away, and to whom.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use dash_train::train::StepReport;
use proptest::prelude::*;
use serde_json::Value;

use super::board::Board;
use super::connections::{answer, listen};
use super::site::{Request, Site};

const HOST: &str = "127.0.0.1:8000";

fn board() -> Arc<Board> {
    Arc::new(Board::new("/nowhere/curve.jsonl".into()))
}

fn site(board: &Arc<Board>, public: bool) -> Site {
    let files = [("index.html", "the page"), ("player.js", "code")];
    let files = files.map(|(name, text)| (name.to_string(), text.into()));
    Site::new(board.clone(), BTreeMap::from(files), public)
}

/// A request of this machine.
fn request<'a>(method: &'a str, target: &'a str) -> Request<'a> {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    Request {
        method,
        path,
        query,
        host: HOST,
        ..Default::default()
    }
}

fn get(site: &Site, target: &str) -> u16 {
    site.answer(&request("GET", target)).status
}

fn report(step: usize, loss: f32) -> StepReport {
    StepReport {
        step,
        stage: "test",
        loss,
        psnr: 20.0,
        n_read: 1,
        n_static: 3,
        n_dynamic: 2,
        n_skipped: 0,
    }
}

fn told(board: &Board) -> Value {
    serde_json::from_slice(&board.json()).expect("JSON")
}

#[test]
fn only_what_is_listed_is_handed_out() {
    let board = board();
    let site = site(&board, false);
    for path in [
        "/",
        "/index.html",
        "/player.js",
        "/state.json",
        "/player.js?x=1",
    ] {
        assert_eq!(get(&site, path), 200, "{path}");
    }
    for path in [
        "/etc/passwd",
        "/../index.html",
        "/./index.html",
        "//index.html",
        "/%2e%2e/index.html",
        "/..%2f..%2fetc%2fpasswd",
        "/index.html/",
        "/player.js%00",
        "/v0/part0.bin.gz",
        "/v1/part0.bin.gz",
        "/v1/../player.js",
        "/v99999999999999999999/part0.bin.gz",
        "/v-1/part0.bin.gz",
    ] {
        assert_eq!(get(&site, path), 404, "{path}");
    }
    assert_eq!(site.answer(&request("PUT", "/player.js")).status, 405);
}

/// A site elsewhere can let its name point to this machine, and can send requests that need no permission.
#[test]
fn other_pages_get_nothing() {
    let board = board();
    let site = site(&board, false);
    let status = |host| {
        let request = Request {
            host,
            ..request("GET", "/")
        };
        site.answer(&request).status
    };
    for host in [
        "127.0.0.1:8000",
        "localhost:9",
        "localhost",
        "[::1]:8000",
        "127.0.0.1",
    ] {
        assert_eq!(status(host), 200, "{host}");
    }
    for host in [
        "evil.example",
        "127.0.0.1.evil.example:8000",
        "localhost.evil.example",
        "",
        "10.0.0.1:8000",
    ] {
        assert_eq!(status(host), 403, "{host}");
    }
    assert_eq!(site.answer(&request("POST", "/pause")).status, 403);
    assert!(!board.is_paused());
    let own = |path| {
        let request = Request {
            is_own: true,
            ..request("POST", path)
        };
        site.answer(&request).status
    };
    assert_eq!(own("/pause"), 200);
    assert!(board.is_paused());
    assert_eq!(own("/resume"), 200);
    assert!(!board.is_paused());
    assert_eq!(own("/stop"), 404);
}

#[test]
fn a_public_page_needs_its_token() {
    let board = board();
    let site = site(&board, true);
    let token = site.token().expect("a public site has one").to_string();
    assert_eq!(token.len(), 32);
    let other = site_token(&board);
    assert_ne!(token, other);
    let status = |path: &str, cookie: &str| {
        let request = Request {
            host: "anything.example",
            cookie,
            ..request("GET", path)
        };
        site.answer(&request).status
    };
    assert_eq!(status(&format!("/?token={token}"), ""), 200);
    assert_eq!(status(&format!("/player.js?a=1&token={token}"), ""), 200);
    assert_eq!(
        status("/player.js", &format!("a=b; dash-token={token}")),
        200
    );
    let cut = &token[..31];
    for (path, cookie) in [
        ("/".to_string(), String::new()),
        ("/state.json".into(), String::new()),
        ("/?token=".into(), String::new()),
        (format!("/?token={other}"), String::new()),
        (format!("/?token={cut}"), String::new()),
        (format!("/?nottoken={token}"), String::new()),
        ("/".into(), format!("dash-token={cut}")),
        ("/".into(), format!("token={token}")),
        ("/nothing".into(), String::new()),
    ] {
        assert_eq!(status(&path, &cookie), 403, "{path} {cookie}");
    }
    let page = site.answer(&request("GET", &format!("/?token={token}")));
    let cookie = page.cookie.expect("for what the page asks for");
    assert!(
        cookie.contains(&token) && cookie.contains("HttpOnly"),
        "{cookie}"
    );
}

fn site_token(board: &Arc<Board>) -> String {
    site(board, true).token().expect("a token").to_string()
}

#[test]
fn the_last_two_scenes_are_there() {
    let board = board();
    let site = site(&board, false);
    let scene = |text: &str| BTreeMap::from([("part0.bin.gz".to_string(), text.into())]);
    for version in 1..=3 {
        board.show(scene("values"));
        assert_eq!(told(&board)["version"], version);
        assert_eq!(told(&board)["parts"], 1);
    }
    assert_eq!(get(&site, "/v1/part0.bin.gz"), 404);
    for path in ["/v2/part0.bin.gz", "/v3/part0.bin.gz"] {
        assert_eq!(get(&site, path), 200);
    }
    assert_eq!(get(&site, "/v4/part0.bin.gz"), 404);
    assert_eq!(get(&site, "/v3/part1.bin.gz"), 404);
}

/// However long the run, a curve has few points, and their mean is that of all steps.
#[test]
fn curves_stay_short() {
    let board = board();
    let n = 4096;
    for step in 1..=n {
        board.note(&report(step, step as f32), 0.1, n);
    }
    let told = told(&board);
    let curve = told["curve"].as_array().expect("a list");
    assert!((100..=500).contains(&curve.len()), "{}", curve.len());
    let last = &curve[curve.len() - 1];
    assert!(
        last[0].as_u64() > Some(4000) && last[1].as_f64() > Some(3900.0),
        "{last}"
    );
    assert_eq!((&told["step"], &told["n_dynamic"]), (&n.into(), &2.into()));
    assert!(board.is_watched(Duration::from_secs(3600)));
}

/// Most visits until somebody is answered; who comes while the queue is full is turned away.
const VISITS: usize = 1000;

/// What a visitor hears who comes again when turned away, as a browser's reader does.
fn exchange(address: SocketAddr, text: &str) -> String {
    let visit = || -> io::Result<String> {
        let mut stream = TcpStream::connect(address)?;
        stream.write_all(text.as_bytes())?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        Ok(answer)
    };
    let again = |_| {
        let heard = visit().ok().filter(|answer| !answer.is_empty());
        if heard.is_none() {
            thread::sleep(Duration::from_millis(10));
        }
        heard
    };
    (0..VISITS).find_map(again).expect("an answer")
}

/// More visitors than there is room for, who say nothing or nonsense: those who come when they have gone are answered.
#[test]
fn visitors_who_say_nothing_do_not_stop_others() {
    let board = board();
    let listening = listen(
        "127.0.0.1:0".parse().expect("an address"),
        site(&board, false),
    );
    let address = listening.expect("a free port");
    let mute: Vec<TcpStream> = (0..100)
        .filter_map(|_| TcpStream::connect(address).ok())
        .collect();
    drop(mute);
    for text in [
        "",
        "\r\n\r\n",
        "GET",
        "GET / HTTP/9.9\r\n\r\n",
        "\0\u{1}\u{2}",
    ] {
        // One that is turned away may find the connection closed.
        let sent = TcpStream::connect(address).and_then(|mut it| it.write_all(text.as_bytes()));
        drop(sent);
    }
    let get = format!("GET / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    let answer = exchange(address, &get);
    assert!(
        answer.starts_with("HTTP/1.1 200") && answer.ends_with("the page"),
        "{answer}"
    );
    let taken = listen(address, site(&board, false)).map(drop);
    assert!(
        taken
            .expect_err("taken")
            .line()
            .contains("choose another port")
    );
}

proptest! {
    /// Whatever comes is answered, and only listed names are found.
    #[test]
    fn any_path_is_answered(path in "/[!-~]{0,40}") {
        let board = board();
        let site = site(&board, false);
        let head = format!("GET {path} HTTP/1.1\r\nHost: {HOST}\r\n\r\n");
        let answer = answer(head.as_bytes(), &site);
        let known = ["/", "/index.html", "/player.js", "/state.json"];
        let name = path.split('?').next().unwrap_or_default();
        prop_assert_eq!(answer.status == 200, known.contains(&name), "{}", answer.status);
    }

    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let board = board();
        prop_assert_eq!(answer(&bytes, &site(&board, false)).status, 400);
    }
}
