//! The page's server under damaged requests: its own with changed bodies, paths, methods and headers, and bytes that are none.
//!
//! A request fails that is answered by a status of 500 or more, by JSON that is none, or within [`HANGS_AFTER`] not at all; a server
//! fails that ends by itself, speaks of a panic, does not end when it is asked to, or wrote outside of its folder.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{BufRead, BufReader, Read, Write},
    net::{Shutdown, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Instant,
};

use anyhow::{Context, ensure};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{
    binary::{MEMORY_KIB, contents},
    draw::Draw,
    mutate,
    parent::HANGS_AFTER,
    readers::root,
};

/// Requests of a server; the next has a new folder.
const PORTION: u64 = 250;

/// Rows of a log: a comparison takes a hundredth of a second.
const ROWS: usize = 150;

/// What the page asks: method, path and body. `KEY` is that of a comparison, `DIGEST` that of the experiment.
const REQUESTS: &[(&str, &str, &str)] = &[
    ("GET", "api/folder", ""),
    ("GET", "api/file?path=experiment.toml", ""),
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
    ("POST", "api/write", r#"{"path": "experiment.toml", "text": "device = \"freedom6s\"\n", "replaces": "DIGEST"}"#),
    (
        "POST",
        "api/edit",
        r#"{"path": "experiment.toml", "replaces": "DIGEST", "changes": [{"keys": ["run", 1, "role"], "value": "fit"},
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

/// So many requests of the server of a program.
pub fn requests(program: &Path, count: u64, seed: u64, failures: &Path) -> anyhow::Result<Answers> {
    let program = program.canonicalize().with_context(|| format!("there is no program {}", program.display()))?;
    let next = AtomicU64::new(0);
    let all = Mutex::new(Answers::default());
    let n_workers = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let worker = || -> anyhow::Result<()> {
            loop {
                let from = next.fetch_add(PORTION, Ordering::Relaxed);
                if from >= count {
                    return Ok(());
                }
                let own = portion(&program, seed, from..(from + PORTION).min(count), failures)?;
                own.failures.iter().for_each(|failure| eprintln!("{failure}"));
                all.lock().unwrap_or_else(PoisonError::into_inner).add(own);
            }
        };
        let workers: Vec<_> = (0..n_workers).map(|_| scope.spawn(worker)).collect();
        for worker in workers {
            worker.join().map_err(|_| anyhow::anyhow!("a thread of the fuzzer panicked"))??;
        }
        anyhow::Ok(())
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

/// Those of one server.
fn portion(program: &Path, seed: u64, numbers: std::ops::Range<u64>, failures: &Path) -> anyhow::Result<Answers> {
    let mut server = Server::new(program)?;
    let others: Vec<Vec<u8>> = REQUESTS.iter().map(|(.., body)| body.as_bytes().to_vec()).collect();
    let mut answers = Answers::default();
    for number in numbers.clone() {
        let (request, is_broken) = request(&server, &others, &mut Draw::of(seed, "server", number));
        let begun = Instant::now();
        let answer = server.answer(&request, is_broken);
        let seconds = begun.elapsed().as_secs_f64();
        answers.slowest_s = answers.slowest_s.max(seconds);
        let (status, wrong) = match answer {
            Ok(Answer { status, wrong }) => (status, wrong),
            Err(error) if seconds >= HANGS_AFTER.as_secs_f64() => (0, Some(format!("no answer: {error}"))),
            Err(_) => (0, None),
        };
        *answers.statuses.entry(status).or_default() += 1;
        let wrong = match server.child.try_wait()? {
            Some(status) => Some(format!("the server ended: {status}")),
            None => wrong,
        };
        if let Some(wrong) = wrong {
            fs::create_dir_all(failures)?;
            let kept = failures.join(format!("request-{seed}-{number}"));
            fs::write(&kept, &request)?;
            answers.failures.push(format!("request {number}: {wrong}; {}", kept.display()));
            if server.child.try_wait()?.is_some() {
                server = Server::new(program)?;
            }
        }
    }
    answers.failures.extend(server.end()?.map(|wrong| format!("requests {numbers:?}: {wrong}")));
    Ok(answers)
}

/// The bytes of a request, and whether they may be none.
fn request(server: &Server, others: &[Vec<u8>], draw: &mut Draw) -> (Vec<u8>, bool) {
    let (method, path, body) = draw.copy_of(REQUESTS);
    let with_names = |text: &str| text.replace("KEY", &server.key).replace("DIGEST", &server.digest);
    let (mut method, mut path, mut body) = (method.to_owned(), path.to_owned(), with_names(body).into_bytes());
    let mut media = if path.starts_with("api/upload") { "application/octet-stream" } else { "application/json" };
    let mut host = server.host.clone();
    match draw.below(16) {
        0 => {}
        1 => method = draw.copy_of(&["PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "get", "", "POST", "GET"]).to_owned(),
        2 => media = draw.copy_of(&["text/plain", "", "application/octet-stream", "application/json; charset=utf-16"]),
        3 => host = draw.copy_of(&["example.org", "", "localhost:1", "127.0.0.1"]).to_owned(),
        4 | 5 => path = String::from_utf8_lossy(&mutate::of_text(&path, others, draw)).into_owned(),
        _ if body.is_empty() => {
            let (start, value) = path.split_once('=').unwrap_or((&path, ""));
            let value = String::from_utf8_lossy(&mutate::of_text(value, others, draw)).into_owned();
            path = format!("{start}={value}");
        }
        6..=8 => body = mutate::of_text(&String::from_utf8_lossy(&body), others, draw),
        _ => body = with_other_values(body, draw),
    }
    // Mostly as a browser writes a path; else as it stands.
    if !draw.one_in(4) {
        path = escaped(&path);
    }
    let mut bytes = format!(
        "{method} /{}/{path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: {media}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        server.token,
        body.len()
    )
    .into_bytes();
    bytes.extend(body);
    // A path as it stands may end a line.
    let is_whole = !path.contains(|own: char| own.is_ascii_whitespace() || own.is_control());
    if draw.one_in(20) { (mutate::of_bytes(&bytes, others, draw), true) } else { (bytes, !is_whole) }
}

/// Names that a request may hold.
const NAMES: [&str; 16] = [
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
    for _ in 0..draw.size(2) {
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
    status: u16,
    wrong: Option<String>,
}

/// A server in a folder of its own, which lies in one of the test's.
struct Server {
    child: Child,
    host: String,
    token: String,
    key: String,
    digest: String,
    outside: TempDir,
}

impl Server {
    fn new(program: &Path) -> anyhow::Result<Self> {
        let outside = tempfile::tempdir()?;
        let folder = outside.path().join("folder");
        fs::create_dir(&folder)?;
        for (name, path) in [
            ("wrist-1.csv", "src/tour/wrist-1.csv"),
            ("wrist-2.csv", "src/tour/wrist-2.csv"),
            ("wrist-3.csv", "src/tour/wrist-3.csv"),
            ("experiment.toml", "src/tour/experiment.toml"),
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
        let mut child = Command::new("sh")
            .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")])
            .arg(program)
            .args(["open", "--no-browser"])
            .current_dir(&folder)
            .env("RAYON_NUM_THREADS", "1")
            .env_remove("DYNID_EFFECTS")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(File::create(outside.path().join("said"))?)
            .spawn()?;
        let stdout = child.stdout.as_mut().context("a server has an output")?;
        let line = BufReader::new(stdout).lines().next().context("the server says where it is")??;
        let address = line.strip_prefix("open: http://").and_then(|own| own.strip_suffix('/'));
        let (host, token) = address.and_then(|own| own.split_once('/')).context("an address")?;
        let (host, token) = (host.to_owned(), token.to_owned());
        let mut server = Self { child, host, token, key: String::new(), digest: String::new(), outside };
        let body = json!({ "experiment": "experiment.toml", "model": "believed.toml" }).to_string();
        server.key = server.asked("POST", "api/compared", &body)?["key"].as_str().context("a key")?.to_owned();
        let file = server.asked("GET", "api/file?path=experiment.toml", "")?;
        server.digest = file["digest"].as_str().context("a digest")?.to_owned();
        Ok(server)
    }

    /// What is asked as it should be.
    fn asked(&self, method: &str, path: &str, body: &str) -> anyhow::Result<Value> {
        let head = format!("{method} /{}/{path} HTTP/1.1\r\nHost: {}\r\n", self.token, self.host);
        let more = format!("Content-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n", body.len());
        let bytes = self.sent(format!("{head}{more}\r\n{body}").as_bytes(), false)?;
        let text = String::from_utf8_lossy(&bytes);
        let (head, body) = text.split_once("\r\n\r\n").context("an answer")?;
        ensure!(head.contains(" 200 "), "{method} {path}: {text}");
        Ok(serde_json::from_str(body)?)
    }

    fn sent(&self, request: &[u8], is_broken: bool) -> std::io::Result<Vec<u8>> {
        let mut stream = TcpStream::connect(&self.host)?;
        stream.set_read_timeout(Some(HANGS_AFTER))?;
        stream.set_write_timeout(Some(HANGS_AFTER))?;
        // A server that refuses does not read on.
        let _ = stream.write_all(request);
        if is_broken {
            // What says that more is to come would be waited for.
            let _ = stream.shutdown(Shutdown::Write);
        }
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn answer(&self, request: &[u8], is_broken: bool) -> std::io::Result<Answer> {
        let bytes = self.sent(request, is_broken)?;
        let end = bytes.windows(4).position(|window| window == b"\r\n\r\n").unwrap_or(bytes.len());
        let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        // What stands behind it answers what broken bytes asked besides.
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")?.parse::<usize>().ok());
        let body = bytes.get(end + 4..).unwrap_or_default();
        let body = &body[..length.unwrap_or(body.len()).min(body.len())];
        let has_body = !request.starts_with(b"HEAD ") && !body.is_empty();
        let is_json = has_body && head.contains("content-type: application/json");
        let wrong = if status >= 500 {
            Some(format!("status {status}: {}", String::from_utf8_lossy(body)))
        } else if is_json && serde_json::from_slice::<Value>(body).is_err() {
            Some(format!("JSON that is none: {}", String::from_utf8_lossy(body).chars().take(200).collect::<String>()))
        } else {
            None
        };
        Ok(Answer { status, wrong })
    }

    /// Asks it to end, and says what was wrong all the time.
    fn end(mut self) -> anyhow::Result<Option<String>> {
        let is_well = self.asked("GET", "api/folder", "").map(|_| ());
        Command::new("kill").args(["-INT", &self.child.id().to_string()]).status()?;
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait()? {
                break status;
            }
            if begun.elapsed() > HANGS_AFTER {
                self.child.kill()?;
                self.child.wait()?;
                return Ok(Some("does not end".to_owned()));
            }
            thread::sleep(std::time::Duration::from_millis(5));
        };
        let said = fs::read_to_string(self.outside.path().join("said"))?;
        if said.contains("panicked at") || said.contains("overflowed its stack") {
            return Ok(Some(format!("panics: {}", said.chars().take(500).collect::<String>())));
        }
        if let Err(error) = is_well {
            return Ok(Some(format!("does not answer any more: {error:#}")));
        }
        if !matches!(status.code(), Some(0 | 130)) {
            return Ok(Some(format!("ends with {status}: {said}")));
        }
        let folder = self.outside.path().join("folder");
        let others = contents(self.outside.path())?;
        let foreign = others.keys().find(|path| !path.starts_with(&folder) && !path.ends_with("said"));
        Ok(foreign.map(|path| format!("wrote {}", path.display())))
    }
}
