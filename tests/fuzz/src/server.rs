//! The page's server under damaged requests: its own with other values, bodies, paths, methods and headers, and bytes that are none.
//!
//! A request fails that is answered by a status of 500 or more, by JSON that is none, by what lies outside of the folder, in words of
//! a panic, or within [`HANGS_AFTER`] not at all. A server fails that ends by itself, speaks of a panic, does not end when it is asked
//! to, or changes what lies outside of its folder.
//!
//! What a request does depends on those before it: with one that failed, all that its server was sent are kept.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    net::{Shutdown, TcpStream},
    ops::Range,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Child, ExitStatus, Stdio},
    sync::{Mutex, PoisonError},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, ensure};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{
    binary::{contents, limited, says_panic, share_out},
    draw::Draw,
    mutate,
    parent::HANGS_AFTER,
    readers::root,
};

/// Requests of a server; the next has a new folder.
const PORTION: u64 = 250;

/// Rows of a log: a comparison takes a hundredth of a second.
const ROWS: usize = 150;

/// What lies outside of the folder, and is never told.
const SECRET: &str = "of the house";

/// What stands in a request for what each server has of its own, of the same length: so a request is the same wherever it is made.
const HOST: &str = "127.0.0.1:00000";
const TOKEN: &str = "70c3e07f0a1b2c3d4e5f60718293a4b5";
const PAGES: &str = "9a6e5f60718293a4b570c3e07f0a1b2c";
/// Of a comparison.
const KEY: &str = "c0395a7e1d2b3c4f5a6978879605a4b3";
/// Of `second.toml`.
const DIGEST: &str = "d1935700112233445566778899aabbccddeeff00f1e2d3c4b5a6978877665544";

/// What the page asks, but for its events, which have no end: method, path and body.
const REQUESTS: &[(&str, &str, &str)] = &[
    ("GET", "api/folder", ""),
    ("GET", "api/file?path=experiment.toml", ""),
    ("GET", "/PAGES/api/page?path=page.html", ""),
    ("GET", "api/experiment?path=experiment.toml", ""),
    ("GET", "api/lineage", ""),
    ("GET", "api/jobs", ""),
    ("GET", "api/jobs/1", ""),
    ("POST", "api/jobs/1/stop", "{}"),
    ("GET", "", ""),
    ("GET", "app.js", ""),
    ("POST", "api/upload?name=log.csv", "t,q4,tau4\n0,0.1,0\n0.01,0.2,0\n0.02,0.1,0\n"),
    ("POST", "api/jobs", r#"{"args": ["check", "experiment.toml", "--model", "believed.toml"]}"#),
    ("POST", "api/jobs", r#"{"args": ["table", "believed.toml", "fitted.toml", "--out", "t.html"]}"#),
    ("POST", "api/jobs", r#"{"args": ["export", "fitted.toml", "--as", "json"]}"#),
    ("POST", "api/write", r#"{"path": "sub/mine.toml", "text": "a = 1\n[b]\nc = [1, 2]\n", "replaces": null}"#),
    ("POST", "api/write", r#"{"path": "second.toml", "text": "device = \"freedom6s\"\n", "replaces": "DIGEST"}"#),
    (
        "POST",
        "api/edit",
        r#"{"path": "second.toml", "replaces": "DIGEST", "changes": [{"keys": ["run", 1, "role"], "value": "fit"},
            {"keys": ["run", 0], "parts": [{"from_s": 0, "to_s": 1}, {"from_s": 1}]}, {"keys": ["run"], "insert": {"file": "a.csv"}}]}"#,
    ),
    ("POST", "api/rows", r#"{"experiment": "experiment.toml", "run": 0, "from": 0.1, "to": 0.9}"#),
    ("POST", "api/compared", r#"{"experiment": "experiment.toml", "model": "believed.toml"}"#),
    ("POST", "api/compared", r#"{"experiment": "experiment.toml", "model": "fitted.toml", "free": [4, 5]}"#),
    (
        "POST",
        "api/series",
        r#"{"of": {"key": "KEY", "run": 0}, "names": ["residual:4", "measured:5", "simulated:4"], "from": 0.1, "to": 1.0, "width": 100}"#,
    ),
    (
        "POST",
        "api/series",
        r#"{"of": {"experiment": "experiment.toml", "run": 1}, "names": ["q4", "tau5", "q:4"], "width": 50}"#,
    ),
    ("POST", "api/scatter", r#"{"key": "KEY", "run": 0, "joint": 4, "against": "speed", "error": "torque"}"#),
    ("POST", "api/scatter", r#"{"key": "KEY", "run": 1, "joint": 5, "against": "frequency"}"#),
    ("POST", "api/parameters", r#"{"experiment": "experiment.toml", "model": "believed.toml"}"#),
    (
        "POST",
        "api/try",
        r#"{"experiment": "experiment.toml", "model": "believed.toml", "run": 0, "values": {"joint.4.gain.Kp": 0.01, "link.7.m": 0.2}, "width": 100}"#,
    ),
    (
        "POST",
        "api/tried",
        r#"{"experiment": "experiment.toml", "model": "believed.toml", "values": {"joint.4.gain.Kp": 0.01}, "out": "tried.toml"}"#,
    ),
    ("POST", "api/wall", r#"{"model": null, "setting": "setting.toml", "wall": "wall.toml", "changes": {"k": 300}}"#),
    (
        "POST",
        "api/wall",
        r#"{"wall": "fuzzy", "changes": {"sample_rate": 500}, "hand": 1, "speed": "slow", "out": "felt.toml"}"#,
    ),
];

/// How requests were answered.
#[derive(Debug, Default)]
pub struct Answers {
    /// By status; 0 is none: the connection was closed.
    pub statuses: BTreeMap<u16, u64>,
    pub slowest_s: f64,
    pub failures: Vec<String>,
}

/// Requests of these numbers to servers of a program.
pub fn requests(program: &Path, numbers: Range<u64>, seed: u64, failures: &Path) -> anyhow::Result<Answers> {
    let program = program.canonicalize().with_context(|| format!("there is no program {}", program.display()))?;
    let all = Mutex::new(Answers::default());
    share_out(numbers, PORTION, |portion| {
        let own = asked_in_turn(&program, seed, portion, failures)?;
        all.lock().unwrap_or_else(PoisonError::into_inner).add(own);
        Ok(())
    })?;
    Ok(all.into_inner().unwrap_or_else(PoisonError::into_inner))
}

impl Answers {
    fn add(&mut self, other: Self) {
        for (status, count) in other.statuses {
            *self.statuses.entry(status).or_default() += count;
        }
        self.slowest_s = self.slowest_s.max(other.slowest_s);
        self.failures.extend(other.failures);
    }
}

/// Those of one server, or of the next where one was lost.
fn asked_in_turn(program: &Path, seed: u64, numbers: Range<u64>, failures: &Path) -> anyhow::Result<Answers> {
    let others: Vec<Vec<u8>> = REQUESTS.iter().map(|(.., body)| body.as_bytes().to_vec()).collect();
    let mut answers = Answers::default();
    let mut next = numbers.start;
    while next < numbers.end {
        let mut server = Server::new(program)?;
        let mut sent: Vec<Vec<u8>> = Vec::new();
        let mut wrong = None;
        while next < numbers.end && wrong.is_none() {
            let request = Request::of(&others, &mut Draw::of(seed, "server", next));
            let begun = Instant::now();
            let answer = server.answer(&request)?;
            answers.slowest_s = answers.slowest_s.max(begun.elapsed().as_secs_f64());
            *answers.statuses.entry(answer.status).or_default() += 1;
            sent.push(request.bytes);
            next += 1;
            wrong = answer.wrong;
        }
        let wrong = [wrong, server.end()?].into_iter().flatten().collect::<Vec<String>>();
        if !wrong.is_empty() {
            let kept = failures.join(format!("request-{seed}-{}", next - 1));
            fs::create_dir_all(&kept)?;
            for (number, bytes) in (next - sent.len() as u64..).zip(&sent) {
                fs::write(kept.join(number.to_string()), bytes)?;
            }
            let failure = format!("request {}: {}; {}", next - 1, wrong.join("; "), kept.display());
            eprintln!("{failure}");
            answers.failures.push(failure);
        }
    }
    Ok(answers)
}

/// What is sent, with [`TOKEN`] and the like in it.
struct Request {
    bytes: Vec<u8>,
    /// Whether it may be no request at all.
    is_broken: bool,
}

impl Request {
    /// `others` are bodies that are mixed into it.
    fn of(others: &[Vec<u8>], draw: &mut Draw) -> Self {
        let (method, path, body) = draw.copy_of(REQUESTS);
        let with_names = |text: &str| text.replace("KEY", KEY).replace("DIGEST", DIGEST).replace("PAGES", PAGES);
        let (mut method, mut path, mut body) = (method.to_owned(), with_names(path), with_names(body).into_bytes());
        let mut media = if path.starts_with("api/upload") { "application/octet-stream" } else { "application/json" };
        let mut host = HOST;
        let changed =
            |text: &str, draw: &mut Draw| String::from_utf8_lossy(&mutate::of_text(text, others, draw)).into_owned();
        match draw.below(16) {
            0 => {}
            1 => {
                method =
                    draw.copy_of(&["PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "get", "", "POST", "GET"]).to_owned()
            }
            2 => {
                media =
                    draw.copy_of(&["text/plain", "", "application/octet-stream", "application/json; charset=utf-16"])
            }
            3 => host = draw.copy_of(&["example.org", "", "localhost:1", "127.0.0.1"]),
            4 => path = changed(&path, draw),
            _ if path.contains('=') => {
                let (start, value) = path.split_once('=').unwrap_or((&path, ""));
                let value = if draw.one_in(3) { changed(value, draw) } else { draw.copy_of(&NAMES).to_owned() };
                path = format!("{start}={value}");
            }
            5..=7 => body = mutate::of_text(&String::from_utf8_lossy(&body), others, draw),
            _ => body = with_other_values(body, draw),
        }
        // Mostly as a browser writes a path; else as it stands.
        if !draw.one_in(4) {
            path = escaped(&path);
        }
        let path = if path.starts_with('/') { path } else { format!("/{TOKEN}/{path}") };
        let head = format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: {media}\r\n");
        let mut bytes = format!("{head}Content-Length: {}\r\nConnection: close\r\n\r\n", body.len()).into_bytes();
        bytes.extend(body);
        // A path as it stands may end a line, or be longer than a head may be.
        let is_line = |own: char| own.is_ascii_whitespace() || own.is_control();
        let mut is_broken = path.contains(is_line) || path.len() > LONGEST_PATH || method.is_empty();
        if draw.one_in(20) {
            bytes = mutate::of_bytes(&bytes, others, draw);
            is_broken = true;
        }
        Self { bytes, is_broken }
    }
}

/// A longer one may be refused before it is read to its end.
const LONGEST_PATH: usize = 1 << 15;

/// Names that a request may hold.
const NAMES: [&str; 24] = [
    "../secret.toml",
    "sub/../../secret.toml",
    "link.toml",
    "linked/secret.toml",
    "linked/new.toml",
    "dangling.toml",
    "second.toml",
    "page.html",
    "experiment.toml",
    "believed.toml",
    "fitted.toml",
    "wrist-1.csv",
    "setting.toml",
    "wall.toml",
    "nowhere.toml",
    ".",
    "torque",
    "position",
    "q:5",
    "residual:5",
    "time",
    "validate",
    "damped",
    "joint.5.gain.Kp",
];

/// A body of JSON with one or two of its values replaced.
fn with_other_values(body: Vec<u8>, draw: &mut Draw) -> Vec<u8> {
    let Ok(mut whole) = serde_json::from_slice::<Value>(&body) else { return body };
    for _ in 0..1 + draw.below(2) {
        let mut value = &mut whole;
        // Down to a leaf, mostly.
        loop {
            let n_inside = match &*value {
                Value::Array(inside) => inside.len(),
                Value::Object(inside) => inside.len(),
                _ => 0,
            };
            if n_inside == 0 || draw.one_in(12) {
                break;
            }
            let place = draw.below(n_inside);
            let inside = match value {
                Value::Array(inside) => inside.get_mut(place),
                Value::Object(inside) => inside.values_mut().nth(place),
                _ => None,
            };
            let Some(inside) = inside else { return body };
            value = inside;
        }
        *value = match draw.below(8) {
            0..=2 => serde_json::from_str(draw.copy_of(&mutate::NUMBERS)).unwrap_or(Value::Null),
            3 => draw.copy_of(&mutate::WORDS).into(),
            4 | 5 => draw.copy_of(&NAMES).into(),
            6 => draw.copy_of(&[0_i64, 1, 2, 4, 5, -1]).into(),
            _ => draw.of_these(&[Value::Null, json!([]), json!({}), json!(true), json!([0, 1])]).clone(),
        };
    }
    whole.to_string().into_bytes()
}

/// Percent signs for what a path or a query may not hold.
fn escaped(path: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.~/?=&".contains(&byte);
    path.bytes()
        .map(|byte| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

struct Answer {
    /// 0 where there was none.
    status: u16,
    wrong: Option<String>,
}

/// A server in a folder of its own, within others that are not its own.
struct Server {
    child: Child,
    /// What stands in requests, and what this server has in its place.
    own: [(&'static str, String); 5],
    around: TempDir,
    /// What lies outside of the folder.
    outside: BTreeMap<PathBuf, Vec<u8>>,
}

impl Server {
    fn new(program: &Path) -> anyhow::Result<Self> {
        let around = tempfile::tempdir()?;
        let folder = around.path().join("house/folder");
        fs::create_dir_all(&folder)?;
        for outside in ["secret.toml", "house/secret.toml"] {
            fs::write(around.path().join(outside), format!("secret = \"{SECRET}\"\n"))?;
        }
        let said = File::create(around.path().join("said"))?;
        for (name, path) in [
            ("wrist-1.csv", "src/tour/wrist-1.csv"),
            ("wrist-2.csv", "src/tour/wrist-2.csv"),
            ("wrist-3.csv", "src/tour/wrist-3.csv"),
            ("experiment.toml", "src/tour/experiment.toml"),
            ("second.toml", "src/tour/experiment.toml"),
            ("believed.toml", "src/tour/believed.toml"),
            ("fitted.toml", "tests/fuzz/corpus/model/fitted.toml"),
            ("setting.toml", "crates/haptics/src/wall/shipped/setting.toml"),
            ("wall.toml", "crates/haptics/src/wall/shipped/pd.toml"),
        ] {
            let mut text = fs::read_to_string(root().join(path)).with_context(|| format!("no file {path}"))?;
            if name.ends_with(".csv") {
                text = text.split_inclusive('\n').take(ROWS).collect();
            }
            fs::write(folder.join(name), text)?;
        }
        fs::write(folder.join("page.html"), "<p>a report</p>")?;
        for (name, to) in [("link.toml", "../secret.toml"), ("linked", ".."), ("dangling.toml", "../new.toml")] {
            symlink(to, folder.join(name))?;
        }
        let child = limited(program, &folder)
            .args(["open", "--no-browser"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(said)
            .spawn()?;
        let outside = BTreeMap::new();
        let mut server = Self { child, own: Default::default(), around, outside };
        server.outside = server.outside()?;
        let stdout = server.child.stdout.as_mut().context("a server has an output")?;
        let line = BufReader::new(stdout).lines().next().context("the server says where it is")??;
        let address = line.strip_prefix("open: http://").and_then(|own| own.strip_suffix('/'));
        let (host, token) = address.and_then(|own| own.split_once('/')).context("an address")?;
        server.own[0] = (HOST, host.to_owned());
        server.own[1] = (TOKEN, token.to_owned());
        let text = |value: &Value| value.as_str().map(str::to_owned).context("a text");
        let pages = text(&server.asked("GET", "api/folder", "")?["pages"])?;
        server.own[2] = (PAGES, pages.trim_start_matches('/').split('/').next().unwrap_or_default().to_owned());
        let body = json!({ "experiment": "experiment.toml", "model": "believed.toml" }).to_string();
        server.own[3] = (KEY, text(&server.asked("POST", "api/compared", &body)?["key"])?);
        server.own[4] = (DIGEST, text(&server.asked("GET", "api/file?path=second.toml", "")?["digest"])?);
        Ok(server)
    }

    fn outside(&self) -> anyhow::Result<BTreeMap<PathBuf, Vec<u8>>> {
        let folder = self.around.path().join("house/folder");
        let said = self.around.path().join("said");
        let mut all = contents(self.around.path())?;
        all.retain(|path, _| !path.starts_with(&folder) && *path != said);
        Ok(all)
    }

    /// What is asked as it should be.
    fn asked(&self, method: &str, path: &str, body: &str) -> anyhow::Result<Value> {
        let head = format!("{method} /{TOKEN}/{path} HTTP/1.1\r\nHost: {HOST}\r\nContent-Type: application/json\r\n");
        let more = format!("Content-Length: {}\r\nConnection: close\r\n\r\n{body}", body.len());
        let request = Request { bytes: (head + &more).into_bytes(), is_broken: false };
        let bytes = self.sent(&request)?;
        let text = String::from_utf8_lossy(&bytes);
        let (head, body) = text.split_once("\r\n\r\n").context("an answer")?;
        ensure!(head.contains(" 200 "), "{method} {path}: {text}");
        Ok(serde_json::from_str(body)?)
    }

    /// What comes back until the connection is closed, or lost.
    fn sent(&self, request: &Request) -> anyhow::Result<Vec<u8>> {
        /// What is no request may say that more is to come, and be waited for.
        const WAITS: Duration = Duration::from_millis(50);
        let given = self.own.iter().fold(request.bytes.clone(), |bytes, (stands, own)| replaced(&bytes, stands, own));
        let begun = Instant::now();
        let mut bytes = Vec::new();
        let Ok(mut stream) = TcpStream::connect(&self.own[0].1) else { return Ok(bytes) };
        stream.set_read_timeout(Some(WAITS))?;
        stream.set_write_timeout(Some(HANGS_AFTER))?;
        // A server that refuses does not read on.
        let _ = stream.write_all(&given);
        let mut part = [0; 1 << 16];
        while begun.elapsed() < HANGS_AFTER {
            match stream.read(&mut part) {
                Ok(0) => break,
                Ok(length) => bytes.extend_from_slice(&part[..length]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    if request.is_broken {
                        let _ = stream.shutdown(Shutdown::Write);
                    }
                }
                Err(_) => break,
            }
        }
        Ok(bytes)
    }

    fn answer(&mut self, request: &Request) -> anyhow::Result<Answer> {
        let begun = Instant::now();
        let bytes = self.sent(request)?;
        let hangs = begun.elapsed() >= HANGS_AFTER;
        let text = String::from_utf8_lossy(&bytes);
        let end = bytes.windows(4).position(|window| window == b"\r\n\r\n").unwrap_or(bytes.len());
        let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        // What stands behind it answers what broken bytes asked besides.
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")?.parse::<usize>().ok());
        let body = bytes.get(end + 4..).unwrap_or_default();
        let has_body = !request.bytes.starts_with(b"HEAD ");
        let is_whole = !has_body || length.is_none_or(|length| length <= body.len());
        let body = &body[..length.unwrap_or(body.len()).min(body.len())];
        let is_json = has_body && head.contains("content-type: application/json");
        let beginning = || String::from_utf8_lossy(body).chars().take(300).collect::<String>();
        let wrong = if hangs {
            Some(format!("hangs for {} s", HANGS_AFTER.as_secs()))
        } else if status == 0 && !request.is_broken {
            Some("no answer".to_owned())
        } else if status >= 500 {
            Some(format!("status {status}: {}", beginning()))
        } else if is_json && is_whole && serde_json::from_slice::<Value>(body).is_err() {
            Some(format!("JSON that is none: {}", beginning()))
        } else if !is_whole && !request.is_broken {
            Some("an answer that is broken off".to_owned())
        } else if says_panic(&text) {
            Some(format!("speaks of a panic: {}", beginning()))
        } else if text.contains(SECRET) {
            Some(format!("tells what lies outside: {}", beginning()))
        } else {
            // What has no answer may be the end of the server, which takes a moment.
            let ended = if status == 0 { self.ended_within(WAITED)? } else { self.child.try_wait()? };
            ended.map(|status| format!("the server ended: {status}"))
        };
        Ok(Answer { status, wrong })
    }

    fn ended_within(&mut self, time: Duration) -> anyhow::Result<Option<ExitStatus>> {
        let begun = Instant::now();
        loop {
            let ended = self.child.try_wait()?;
            if ended.is_some() || begun.elapsed() > time {
                return Ok(ended);
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// Asks it to end, and says what was wrong all the time.
    fn end(mut self) -> anyhow::Result<Option<String>> {
        drop(self.child.stdin.take());
        // It gives what runs for the page its time, too.
        let ended = self.ended_within(2 * HANGS_AFTER)?;
        let said = fs::read(self.around.path().join("said"))?;
        let said = String::from_utf8_lossy(&said);
        let beginning = || said.chars().take(500).collect::<String>();
        let outside = self.outside()?;
        let changed = outside.iter().find(|(path, bytes)| self.outside.get(*path) != Some(bytes));
        let gone = self.outside.keys().find(|path| !outside.contains_key(*path));
        Ok(if says_panic(&said) {
            Some(format!("panics: {}", beginning()))
        } else if let Some(path) = changed.map(|(path, _)| path).or(gone) {
            Some(format!("changed {}, outside of its folder", path.display()))
        } else {
            match ended.map(|status| status.code()) {
                None => Some("does not end".to_owned()),
                Some(Some(0 | 130)) => None,
                Some(code) => Some(format!("ends with {code:?}: {}", beginning())),
            }
        })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// How long a server that fell may take until it is seen to have.
const WAITED: Duration = Duration::from_millis(300);

/// Bytes with one text in place of another.
fn replaced(bytes: &[u8], stands: &str, own: &str) -> Vec<u8> {
    let mut made = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while let Some(at) = rest.windows(stands.len().max(1)).position(|window| window == stands.as_bytes()) {
        made.extend_from_slice(&rest[..at]);
        made.extend_from_slice(own.as_bytes());
        rest = &rest[at + stands.len()..];
    }
    made.extend_from_slice(rest);
    made
}
