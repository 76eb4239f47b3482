//! `dynid open` as a process, asked over HTTP as a browser would, and as one would not.

mod robust;
mod secret;
mod walls;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::wrist;

/// A server of its own; gone at the end of the test.
struct Server {
    child: Child,
    host: String,
    token: String,
}

struct Response {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Response {
    fn json(&self) -> Value {
        assert!(self.head.contains("content-type: application/json"), "{}", self.head);
        serde_json::from_slice(&self.body).unwrap()
    }

    fn ok(&self) -> Value {
        assert_eq!(self.status, 200, "{}", String::from_utf8_lossy(&self.body));
        self.json()
    }

    /// The sentence of an answer that is none.
    fn error(&self, status: u16) -> String {
        assert_eq!(self.status, status, "{}", String::from_utf8_lossy(&self.body));
        self.json()["error"].as_str().unwrap().to_owned()
    }
}

const JSON: (&str, &str) = ("Content-Type", "application/json");

impl Server {
    fn new(folder: &Path, arguments: &[&str]) -> Self {
        Self::of(folder, &[&["open", "--no-browser"], arguments].concat())
    }

    /// Of a command that ends in a server; what it says before is passed over.
    fn of(folder: &Path, arguments: &[&str]) -> Self {
        Self::by(Command::new(env!("CARGO_BIN_EXE_dynid")).args(arguments).current_dir(folder))
    }

    fn by(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.as_mut().unwrap()).lines().map(Result::unwrap);
        let address = lines.find_map(|line| line.strip_prefix("open: http://").map(str::to_owned)).unwrap();
        let address = address.strip_suffix('/').unwrap();
        let (host, token) = address.split_once('/').unwrap();
        assert!(token.len() == 32 && token.bytes().all(|byte| byte.is_ascii_hexdigit()), "{token}");
        Self { host: host.to_owned(), token: token.to_owned(), child }
    }

    fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> TcpStream {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut head = format!("{method} {path} HTTP/1.1\r\nContent-Length: {}\r\nConnection: close\r\n", body.len());
        if headers.iter().all(|(name, _)| *name != "Host") {
            head += &format!("Host: {}\r\n", self.host);
        }
        headers.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
        stream.write_all(format!("{head}\r\n").as_bytes()).unwrap();
        // A server that refuses does not read on.
        let _ = stream.write_all(body);
        stream
    }

    /// Asks for a path as it stands.
    fn raw(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Response {
        let mut bytes = Vec::new();
        self.send(method, path, headers, body).read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|window| window == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Response { status, head: head.to_lowercase(), body: bytes[end + 4..].to_vec() }
    }

    fn at(&self, path: &str) -> String {
        format!("/{}/{path}", self.token)
    }

    fn get(&self, path: &str) -> Response {
        self.raw("GET", &self.at(path), &[], b"")
    }

    /// A page of the folder, at the address that the server tells.
    fn page(&self, path: &str) -> Response {
        let pages = self.get("api/folder").ok()["pages"].as_str().unwrap().to_owned();
        self.raw("GET", &format!("{pages}?path={path}"), &[], b"")
    }

    fn post(&self, path: &str, body: &Value) -> Response {
        self.raw("POST", &self.at(path), &[JSON], body.to_string().as_bytes())
    }

    fn run(&self, args: &[&str]) -> u64 {
        self.post("api/jobs", &json!({ "args": args })).ok()["id"].as_u64().unwrap()
    }

    /// Waits until a job is as asked.
    fn wait(&self, id: u64, is_so: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let job = self.get(&format!("api/jobs/{id}")).ok();
            if is_so(&job) {
                return job;
            }
            assert!(begun.elapsed() < Duration::from_secs(300), "{job}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Ctrl-C: it says that all is well.
    fn end(&mut self) {
        assert!(Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap().success());
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
    }

    fn done(&self, args: &[&str]) -> Value {
        self.wait(self.run(args), |job| !["waiting", "running"].contains(&job["state"].as_str().unwrap()))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn tour() -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, text) in dynid::tour::FILES {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn cli(folder: &Path, arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_dynid")).args(arguments).current_dir(folder).output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}

const EXPERIMENT: &str = "api/experiment?path=experiment.toml";

#[test]
fn only_the_page_itself_is_answered() {
    let folder = tour();
    let server = Server::new(folder.path(), &["experiment.toml"]);
    let page = server.get("");
    assert_eq!(page.status, 200);
    for header in [
        "content-security-policy: default-src 'none'; script-src 'self'",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "cache-control: no-store",
    ] {
        assert!(page.head.contains(header), "{header}: {}", page.head);
    }
    for path in
        ["/", "/api/folder", &format!("/{}/api/folder", "0".repeat(32)), &format!("/{}api/folder", server.token)]
    {
        let refused = server.raw("GET", path, &[], b"");
        refused.error(404);
        assert!(refused.head.contains("content-security-policy"), "refusals are guarded, too");
    }
    let port = server.host.split(':').nth(1).unwrap().to_owned();
    let folder = server.at("api/folder");
    let with = |headers: &[(&str, &str)]| server.raw("GET", &folder, headers, b"");
    for host in ["127.0.0.1", "localhost", "[::1]"] {
        let origin = format!("http://{host}:{port}");
        with(&[("Host", &format!("{host}:{port}")), ("Origin", &origin)]).ok();
    }
    for host in ["evil.example", &format!("evil.example:{port}"), "127.0.0.1:1", "127.0.0.1", ""] {
        with(&[("Host", host)]).error(403);
    }
    for origin in
        ["http://evil.example", "null", "https://127.0.0.1", &format!("https://127.0.0.1:{port}"), "http://127.0.0.1:1"]
    {
        with(&[("Origin", origin)]).error(403);
    }
}

#[test]
fn nothing_outside_the_folder_is_reached() {
    let outside = TempDir::new().unwrap();
    let secret = outside.path().join("secret.toml");
    fs::write(&secret, "secret = true").unwrap();
    let folder = tour();
    let path = folder.path();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, path.join("link.toml")).unwrap();
        std::os::unix::fs::symlink(outside.path(), path.join("linked")).unwrap();
        std::os::unix::fs::symlink(outside.path().join("new.toml"), path.join("dangling.toml")).unwrap();
    }
    fs::write(path.join(".hidden.toml"), "a = 1").unwrap();
    let absolute = secret.to_str().unwrap();
    let up = format!("../{}/secret.toml", outside.path().file_name().unwrap().to_str().unwrap());
    let server = Server::new(path, &[]);
    let mut places = vec![absolute, up.as_str(), "sub/../../x.toml", "..", ".hidden.toml"];
    if cfg!(unix) {
        places.extend(["link.toml", "linked/secret.toml", "linked/new.toml", "dangling.toml"]);
    }
    for place in places {
        server.get(&format!("api/file?path={place}")).error(403);
        server.page(place).error(403);
        server.get(&format!("api/experiment?path={place}")).error(403);
        server.post("api/write", &json!({ "path": place, "text": "mine", "replaces": null })).error(403);
        server.post("api/edit", &json!({ "path": place, "replaces": "", "changes": [] })).error(403);
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": place })).error(403);
        server
            .post(
                "api/tried",
                &json!({ "experiment": "experiment.toml", "model": "believed.toml", "values": {}, "out": place }),
            )
            .error(403);
        let upload = server.at(&format!("api/upload?name={place}"));
        server.raw("POST", &upload, &[("Content-Type", "application/octet-stream")], b"t\n").error(403);
        for args in [
            vec!["check", place],
            vec!["fit", "experiment.toml", "--out", place],
            vec!["wall", "run", "--model", place],
        ] {
            server.post("api/jobs", &json!({ "args": args })).error(403);
        }
    }
    // A document inside may not lead outside, either.
    for file in [absolute, up.as_str()] {
        let text = format!("device = \"freedom6s\"\n[[run]]\nfile = {file:?}\nfree = [4]\nrole = \"fit\"\n");
        fs::write(path.join("leads-out.toml"), text).unwrap();
        server.get("api/experiment?path=leads-out.toml").error(403);
        // Whatever it is called, and however many documents lie between.
        fs::copy(path.join("leads-out.toml"), path.join("leads-out.txt")).unwrap();
        fs::write(path.join("leads-there.toml"), "a = { b = [\"leads-out.txt\"] }").unwrap();
        for document in ["leads-out.toml", "leads-out.txt", "leads-there.toml"] {
            server.post("api/jobs", &json!({ "args": ["check", document] })).error(403);
        }
        server.post("api/jobs", &json!({ "args": ["check", "leads-out.toml"] })).error(403);
    }
    assert_eq!(fs::read_dir(outside.path()).unwrap().count(), 1);
    assert_eq!(fs::read_to_string(&secret).unwrap(), "secret = true");
    let listed = server.get("api/folder").ok();
    let paths: Vec<&str> =
        listed["files"].as_array().unwrap().iter().map(|file| file["path"].as_str().unwrap()).collect();
    let expected = [
        "believed.toml",
        "experiment.toml",
        "leads-out.toml",
        "leads-out.txt",
        "leads-there.toml",
        "recipe.toml",
        "wrist-1.csv",
        "wrist-2.csv",
        "wrist-3.csv",
    ];
    assert_eq!(paths, expected);
    // What is no command of the loop is none of a page.
    server.post("api/jobs", &json!({ "args": ["open"] })).error(403);
    server.post("api/jobs", &json!({ "args": ["tour"] })).error(403);
    server.post("api/jobs", &json!({ "args": ["fit", "--no-such-option"] })).error(400);
}

#[test]
fn a_body_says_what_it_is() {
    let folder = tour();
    let server = Server::new(folder.path(), &[]);
    let body = json!({ "path": "x.toml", "text": "a = 1", "replaces": null }).to_string();
    for kind in ["text/plain", "application/x-www-form-urlencoded", "application/octet-stream", ""] {
        server.raw("POST", &server.at("api/write"), &[("Content-Type", kind)], body.as_bytes()).error(415);
    }
    server.raw("POST", &server.at("api/upload?name=a.csv"), &[JSON], b"t\n").error(415);
    server.raw("POST", &server.at("api/write"), &[JSON], b"{").error(400);
    assert!(!folder.path().join("x.toml").exists() && !folder.path().join("a.csv").exists());
}

/// Also where the server takes a request apart before it is looked at.
#[test]
fn a_refusal_is_one_sentence_and_says_why() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let at = |path: &str| server.at(path);
    assert!(server.raw("DELETE", &at("api/folder"), &[], b"").error(405).contains("Method Not Allowed"));
    server.raw("GET", &at("api/write"), &[], b"").error(405);
    server.raw("GET", &at("api/jobs/%ff"), &[], b"").error(400);
    server.raw("GET", &at("%ff.js"), &[], b"").error(400);
    // The cause is told, too.
    let refused = Command::new(env!("CARGO_BIN_EXE_dynid"))
        .args(["open", "nowhere.toml", "--no-browser"])
        .current_dir(path)
        .output()
        .unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("cannot open nowhere.toml") && said.contains("No such file"), "{said}");
}

#[test]
fn nothing_is_overwritten_that_was_not_seen() {
    let folder = tour();
    let path = folder.path();
    let (one, other) = (Server::new(path, &[]), Server::new(path, &[]));
    let write = |server: &Server, text: &str, replaces: Option<&str>| {
        server.post("api/write", &json!({ "path": "sub/mine.toml", "text": text, "replaces": replaces }))
    };
    let first = write(&one, "a = 1 # one\n", None).ok()["digest"].as_str().unwrap().to_owned();
    write(&other, "a = 2\n", None).error(409);
    let read = other.get("api/file?path=sub/mine.toml").ok();
    assert_eq!((&read["text"], &read["digest"]), (&json!("a = 1 # one\n"), &json!(first)));
    let edit = |server: &Server, digest: &str, value: i64| {
        let changes = json!([{ "keys": ["a"], "value": value }]);
        server.post("api/edit", &json!({ "path": "sub/mine.toml", "replaces": digest, "changes": changes }))
    };
    let edited = edit(&other, &first, 3).ok();
    assert_eq!(edited["text"], "a = 3 # one\n");
    edit(&one, &first, 4).error(409);
    write(&one, "a = 5\n", Some(&first)).error(409);
    write(&one, "a = 6\n", edited["digest"].as_str()).ok();
    assert_eq!(fs::read_to_string(path.join("sub/mine.toml")).unwrap(), "a = 6\n");

    let upload = |bytes: &[u8]| {
        one.raw("POST", &one.at("api/upload?name=new.csv"), &[("Content-Type", "application/octet-stream")], bytes)
    };
    let log = b"t,q0\n0,1\n".repeat(100_000);
    assert_eq!(upload(&log).ok()["path"], "new.csv");
    upload(&log).ok();
    upload(b"t,q0\n").error(409);
    assert_eq!(fs::read(path.join("new.csv")).unwrap(), log);
    let hidden = fs::read_dir(path)
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
    assert_eq!(hidden.count(), 0, "nothing partial is left");
}

#[test]
fn what_a_log_or_an_effect_is_called_is_text() {
    let folder = tour();
    let path = folder.path();
    let name = "<script>alert(1)</script>";
    fs::write(path.join("odd.csv"), format!("t,{name}\n0,1\n1,2\n")).unwrap();
    let text = "device = \"freedom6s\"\n[[run]]\nfile = \"odd.csv\"\nfree = [4]\nrole = \"fit\"\n";
    fs::write(path.join("odd.toml"), text).unwrap();
    fs::write(path.join("odd.html"), format!("<p>{name}")).unwrap();
    fs::write(path.join("odd-model.toml"), format!("device = \"freedom6s\"\n[[effect]]\nid = {name:?}\n")).unwrap();
    let server = Server::new(path, &[]);
    let bodies = [
        server.get("api/experiment?path=odd.toml"),
        server.get("api/file?path=odd-model.toml"),
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "odd-model.toml" })),
    ];
    for response in bodies {
        assert!(response.json().to_string().contains(name));
        assert!(response.head.contains("x-content-type-options: nosniff"), "{}", response.head);
    }
    let job = server.done(&["check", "odd.toml"]);
    assert!(job["state"] == "failed" && job["error"].as_str().unwrap().contains(name), "{job}");
    // A page of the folder is shown where it can ask nothing.
    let page = server.page("odd.html");
    assert!(page.head.contains("content-security-policy: sandbox allow-scripts; default-src 'none'"), "{}", page.head);
    server.page("odd.csv").error(400);
}

#[test]
fn a_command_answers_as_on_a_terminal() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &["experiment.toml", "--model", "believed.toml"]);
    let opened = server.get("api/folder").ok();
    assert_eq!((&opened["experiment"], &opened["model"]), (&json!("experiment.toml"), &json!("believed.toml")));
    let kind = |name: &str| {
        let files = opened["files"].as_array().unwrap();
        files.iter().find(|file| file["path"] == name).unwrap()["kind"].clone()
    };
    assert_eq!([kind("believed.toml"), kind("experiment.toml"), kind("wrist-1.csv")], ["model", "experiment", "log"]);
    let args = ["compare", "experiment.toml", "--model", "believed.toml"];
    let printed = cli(path, &[&args[..], &["--json"]].concat());
    let job = server.done(&args);
    assert_eq!(job["command"], "dynid compare experiment.toml --model believed.toml");
    assert_eq!((&job["state"], &job["status"], &job["result"]), (&json!("done"), &json!(0), &printed));
    // Runs are compared side by side: one may be told before the other.
    let lines = job["progress"].as_array().unwrap();
    let mut counted: Vec<u64> = lines.iter().map(|line| line["done"].as_u64().unwrap()).collect();
    counted.sort_unstable();
    assert_eq!(counted, [1, 2, 3]);
    let compared =
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "believed.toml" })).ok();
    assert_eq!(compared["json"], printed, "in the server's memory, too");
    assert_eq!(compared["findings"].as_array().unwrap().len(), printed["where"].as_array().unwrap().len());

    // A file that changes outside is seen at the next question.
    let before = server.get(EXPERIMENT).ok();
    let text = fs::read_to_string(path.join("experiment.toml")).unwrap();
    fs::write(path.join("experiment.toml"), text.replacen("\"validate\"", "\"fit\"", 1)).unwrap();
    let after = server.get(EXPERIMENT).ok();
    assert_eq!((&before["runs"][2]["role"], &after["runs"][2]["role"]), (&json!("validate"), &json!("fit")));
    assert_ne!(before["digest"], after["digest"]);
}

#[test]
fn a_fit_that_is_stopped_keeps_what_it_has() {
    let folder = wrist::folder();
    let path = folder.path();
    let mut server = Server::new(path, &[]);
    let args =
        ["fit", "experiment.toml", "--model", "believed.toml", "--error", "position", "--starts", "1000", "--out"];
    let began = |id: u64| server.wait(id, |job| job["last"]["progress"] == "iteration");
    let id = server.run(&[&args[..], &["one.toml"]].concat());
    assert_eq!(began(id)["state"], "running");
    server.post(&format!("api/jobs/{id}/stop"), &json!({})).ok();
    let job = server.wait(id, |job| job["state"] == "stopped");
    assert_eq!((&job["status"], &job["result"]["status"]), (&json!(130), &json!("interrupted")));
    assert!(path.join("one.toml.checkpoint").exists() && !path.join("one.toml").exists());
    server.post("api/jobs/77/stop", &json!({})).error(404);

    // The same where the server ends; then it says that all is well.
    let id = server.run(&[&args[..], &["two.toml"]].concat());
    began(id);
    server.end();
    assert!(path.join("two.toml.checkpoint").exists());
}

#[test]
fn a_page_hears_of_files_and_commands() {
    let folder = tour();
    let server = Server::new(folder.path(), &[]);
    server.done(&["table", "believed.toml"]);
    let stream = server.send("GET", &server.at("api/events"), &[], b"");
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut lines = BufReader::new(stream).lines().map(Result::unwrap);
    let mut next = |event: &str| -> Value {
        lines.find(|line| line == &format!("event: {event}")).unwrap();
        let data = lines.find(|line| line.starts_with("data: ")).unwrap();
        serde_json::from_str(&data[6..]).unwrap()
    };
    assert_eq!(next("job")["state"], "done", "what was before is told at once");
    fs::write(folder.path().join("new.toml"), "a = 1").unwrap();
    assert_eq!(next("folder")["paths"], json!(["new.toml"]));
    let id = server.run(&["compare", "experiment.toml"]);
    let told = next("progress");
    assert_eq!((&told["job"], &told["what"], &told["of"]), (&json!(id), &json!("runs compared"), &json!(3)));
}

#[test]
fn pictures_leave_nothing_out() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let text = fs::read_to_string(path.join("wrist-2.csv")).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let column = |name: &str| -> Vec<f64> {
        let place = header.iter().position(|own| *own == name).unwrap();
        text.lines().skip(1).map(|line| line.split(',').nth(place).unwrap().parse().unwrap()).collect()
    };
    let (t, q, tau) = (column("t"), column("q4"), column("tau5"));
    let ask = |names: &[&str], of: Value, from: Value, width: usize| {
        server.post("api/series", &json!({ "of": of, "names": names, "from": from, "to": null, "width": width })).ok()
    };
    let of = json!({ "experiment": "experiment.toml", "run": 1 });
    for width in [1, 7, 100, 5000] {
        let drawn = ask(&["q4", "tau5"], of.clone(), json!(null), width);
        for (series, values) in drawn["series"].as_array().unwrap().iter().zip([&q, &tau]) {
            let numbers = |key: &str| -> Vec<f64> {
                series[key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
            };
            let columns = width.min(t.len());
            let bounds = |column: usize| t.len() * column / columns..t.len() * (column + 1) / columns;
            let of = |fold: fn(f64, f64) -> f64| -> Vec<f64> {
                (0..columns).map(|column| values[bounds(column)].iter().copied().reduce(fold).unwrap()).collect()
            };
            assert_eq!((numbers("low"), numbers("high")), (of(f64::min), of(f64::max)), "{width} columns");
        }
    }
    ask(&["q4"], of.clone(), json!(1e9), 10);
    let compared =
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "believed.toml" })).ok();
    let key = &compared["key"];
    let drawn = ask(&["residual:4", "term:gravity:4", "q4"], json!({ "key": key, "run": 2 }), json!(null), 5000);
    // What was measured is that of the log.
    let measured = ask(&["measured:4"], json!({ "key": key, "run": 2 }), json!(null), 5000);
    assert_eq!(measured["series"][0]["low"], drawn["series"][2]["low"]);
    assert_eq!(compared["runs"][2]["joints"][0]["series"][0], "measured");
    let residual = drawn["series"][0]["low"].as_array().unwrap();
    let square: f64 = residual.iter().map(|value| value.as_f64().unwrap().powi(2)).sum();
    let rmse = compared["runs"][2]["joints"][0]["rmse"].as_f64().unwrap();
    assert!(((square / residual.len() as f64).sqrt() - rmse).abs() < 1e-12 * rmse);
    // The terms of a torque, and what they leave, add up to it.
    let terms = compared["runs"][2]["joints"][0]["terms"].as_array().unwrap();
    let mut names: Vec<String> = terms.iter().map(|term| format!("term:{}:4", term.as_str().unwrap())).collect();
    names.extend(["torque_residual:4".to_owned(), "torque:4".to_owned()]);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let drawn = ask(&names, json!({ "key": key, "run": 2 }), json!(null), 20_000);
    let at = |series: &Value, k: usize| series["low"][k].as_f64().unwrap();
    let all = drawn["series"].as_array().unwrap();
    let (torque, parts) = all.split_last().unwrap();
    for k in [100, 300, 500] {
        let sum: f64 = parts.iter().map(|part| at(part, k)).sum();
        assert!((sum - at(torque, k)).abs() < 1e-9, "{sum} {}", at(torque, k));
    }
    for against in ["speed", "position", "load", "time", "frequency"] {
        let scatter = server.post("api/scatter", &json!({ "key": key, "run": 0, "joint": 4, "against": against })).ok();
        let n = scatter["x"].as_array().unwrap().len();
        assert!(n > 10 && scatter["middle"].as_array().unwrap().len() == n, "{scatter}");
    }
    server.post("api/series", &json!({ "of": { "key": "gone", "run": 0 }, "names": ["q4"], "width": 1 })).error(404);
}

/// What the torque error leaves out lies between samples that it counts: a spectrum does not take them for neighbours.
#[test]
fn a_spectrum_is_of_samples_that_lie_beside_each_other() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let spectrum = |error: &str| {
        let compared = server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": null })).ok();
        let asked = json!({ "key": compared["key"], "run": 0, "joint": 4, "against": "frequency", "error": error });
        server.post("api/scatter", &asked)
    };
    let whole = spectrum("torque").ok();
    assert_eq!(whole["note"], json!(null));
    let text = fs::read_to_string(path.join("experiment.toml")).unwrap();
    fs::write(path.join("experiment.toml"), text.replace("free = [4, 5]", "free = [4, 5]\nmin_speed = [0.3, 0.0]"))
        .unwrap();
    let fast = spectrum("torque").ok();
    let note = fast["note"].as_str().unwrap();
    let words: Vec<&str> = note.split(' ').collect();
    let times: Vec<f64> =
        words.windows(2).filter(|pair| pair[1].starts_with('s')).filter_map(|pair| pair[0].parse().ok()).collect();
    let [from, to] = times[..] else { panic!("{note}") };
    // One stretch in which the joint is fast: its spectrum is as fine as it is long.
    let step = fast["x"][1].as_f64().unwrap() - fast["x"][0].as_f64().unwrap();
    assert!((step * (to - from) - 1.0).abs() < 0.1, "{step} Hz, {note}");
    assert!(step > whole["x"][1].as_f64().unwrap(), "{note}");
    assert_eq!(spectrum("position").ok()["note"], json!(null), "every sample of it counts");
    let text = fs::read_to_string(path.join("experiment.toml")).unwrap();
    fs::write(path.join("experiment.toml"), text.replace("[0.3, 0.0]", "[1e9, 0.0]")).unwrap();
    let none = spectrum("torque").error(404);
    assert!(none.contains("lie beside each other"), "{none}");
}

/// A finding that lies on one side of the joint's rest highlights the samples that the log has there.
#[test]
fn a_finding_says_where_its_samples_are() {
    let folder = wrist::folder();
    let server = Server::new(folder.path(), &[]);
    let compared =
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "believed.toml" })).ok();
    let findings = compared["findings"].as_array().unwrap();
    let first = &findings[0];
    let sentence = first["sentence"].as_str().unwrap();
    assert!(sentence.contains("error lies below \u{2212}0.2500 rad, where the joint rests"), "{sentence}");
    assert_eq!((&first["run"], &first["error"]), (&json!(0), &json!("position")));
    let number = |value: &Value| value.as_f64().unwrap();
    let spans: Vec<[f64; 2]> =
        first["spans"].as_array().unwrap().iter().map(|span| [number(&span[0]), number(&span[1])]).collect();
    let text = fs::read_to_string(folder.path().join("wrist-1.csv")).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|name| name == "q4").unwrap();
    let mut seen = [0, 0];
    for line in text.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let (t, q) = (cells[0], cells[place]);
        // Beside the edge the filtered motion decides.
        if (q + 0.25).abs() > 0.02 {
            let inside = spans.iter().any(|[from, to]| (*from..=*to).contains(&t));
            assert_eq!(inside, q < -0.25, "{q} rad at {t} s");
            seen[usize::from(inside)] += 1;
        }
    }
    assert!(seen.iter().all(|seen| *seen > 500), "{seen:?}");
    // What an error follows is about all samples.
    let follows =
        findings.iter().find(|finding| finding["sentence"].as_str().unwrap().contains("smooth function")).unwrap();
    assert_eq!((&follows["whole"], &follows["spans"]), (&json!(true), &json!([])));
    assert_eq!(first["whole"], json!(false));
}

#[test]
fn parameters_are_tried_and_kept_as_a_model() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let fitted = server.done(&["fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml"]);
    assert_eq!(fitted["state"], "done", "{fitted}");
    let both = json!({ "experiment": "experiment.toml", "model": "fitted.toml" });
    let parameters = server.post("api/parameters", &both).ok();
    let parameters = parameters["parameters"].as_array().unwrap();
    let spring = parameters.iter().find(|own| own["name"] == "joint.4.spring.Ks").unwrap();
    let found = fitted["result"]["parameters"].as_array().unwrap();
    let found = found.iter().find(|own| own["name"] == "joint.4.spring.Ks").unwrap();
    assert_eq!((&spring["value"], &spring["std_error"]), (&found["value"], &found["std_error"]));
    assert_eq!(
        (&spring["effect"], &spring["joint"], &spring["fixed"]),
        (&json!("spring at joint 4"), &json!(4), &json!(false))
    );
    assert!(!spring["meaning"].is_null() && !spring["unit"].is_null());

    let attempt = |run: usize, values: Value| {
        let mut asked = both.clone();
        (asked["run"], asked["values"], asked["width"]) = (json!(run), values, json!(10));
        server.post("api/try", &asked)
    };
    let compared = server.post("api/compared", &both).ok();
    let rmse = |tried: &Value| tried["rmse"][0]["rmse"].as_f64().unwrap();
    let as_it_is = rmse(&attempt(2, json!({})).ok());
    assert_eq!(json!(as_it_is), compared["runs"][2]["joints"][0]["rmse"], "as in the comparison");
    let value = spring["value"].as_f64().unwrap();
    let same = rmse(&attempt(2, json!({ "joint.4.spring.Ks": value })).ok());
    assert!((same - as_it_is).abs() < 1e-4 * as_it_is, "{same} {as_it_is}: the steps are fine enough");
    let moved = rmse(&attempt(2, json!({ "joint.4.spring.Ks": 2.0 * value })).ok());
    assert!((moved - as_it_is).abs() > 0.1 * as_it_is, "{moved} {as_it_is}");
    attempt(2, json!({ "joint.4.spring.Ks": 1e9 })).error(400);
    attempt(9, json!({})).error(404);
    assert!(attempt(2, json!({ "joint.4.spring.Kz": 1.0 })).error(422).contains("Ks"), "with the nearest name");

    let keep = || {
        let values = json!({ "joint.4.spring.Ks": 1.5 * value });
        server.post(
            "api/tried",
            &json!({ "experiment": "experiment.toml", "model": "fitted.toml", "values": values, "out": "try.toml" }),
        )
    };
    assert_eq!(keep().ok()["path"], "try.toml");
    keep().error(409);
    let model = dynid::Model::load(path.join("try.toml")).unwrap();
    assert_eq!(model.parameter("joint.4.spring.Ks").unwrap().value, 1.5 * value);
    let again = ["fit", "experiment.toml", "--model", "try.toml", "--only", "joint.4.spring.Ks", "--out", "again.toml"];
    assert_eq!(server.done(&again)["state"], "done");
}

#[test]
fn a_wall_is_touched_as_on_a_terminal() {
    let folder = TempDir::new().unwrap();
    let server = Server::new(folder.path(), &[]);
    let touch = |changes: Value, out: Value| {
        let asked = json!({ "model": null, "setting": null, "wall": "pd", "changes": changes, "hand": 3, "speed": "fast", "out": out });
        server.post("api/wall", &asked)
    };
    let plain = touch(json!({}), json!(null)).ok();
    let printed = cli(folder.path(), &["wall", "run", "--wall", "pd", "--hand", "3", "--speed", "fast", "--json"]);
    assert_eq!(plain["felt"], printed);
    let change = |key: &str| plain["changes"].as_array().unwrap().iter().find(|own| own["key"] == key).unwrap().clone();
    let k1 = change("k1")["value"].as_f64().unwrap();
    assert_eq!(change("sample_rate")["value"], 100.0);
    let harder = touch(json!({ "k1": 2.0 * k1, "sample_rate": 400.0 }), json!("hard.toml")).ok();
    assert!(harder["depth_max"].as_f64() < plain["depth_max"].as_f64());
    assert_eq!(dynid_haptics::wall::WallFile::load(&folder.path().join("hard.toml")).unwrap().law, {
        let dynid_control::Law::Linear(law) = dynid_haptics::wall::shipped("pd").unwrap().law else {
            panic!("pd is linear")
        };
        dynid_control::Law::Linear(dynid_control::LinearLaw { k1: 2.0 * k1, ..law })
    });
    touch(json!({}), json!("hard.toml")).error(409);
    for wrong in [json!({ "k1": -k1 }), json!({ "sample_rate": 4.0 }), json!({ "sample_rate": 2e5 })] {
        touch(wrong, json!(null)).error(400);
    }
    touch(json!({ "k9": 1.0 }), json!(null)).error(400);
}

#[test]
fn progress_is_told_in_lines() {
    let folder = tour();
    let output = Command::new(env!("CARGO_BIN_EXE_dynid"))
        .args(["diagnose", "experiment.toml", "--model", "believed.toml", "--progress", "json", "--json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let lines = String::from_utf8(output.stderr).unwrap();
    let kinds: Vec<String> = lines
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["progress"].as_str().unwrap().to_owned())
        .collect();
    for kind in ["fitting_model", "asking", "screened", "comparing", "searched"] {
        assert!(kinds.iter().any(|own| own == kind), "{kind} is not in {kinds:?}");
    }
    let told = |kind: &str| -> Value {
        let mut told = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        told.find(|line| line["progress"] == kind && !line["candidate"].is_null() | !line["candidates"].is_null())
            .unwrap()
    };
    let best = &told("screened")["candidates"][0];
    assert!(best["gain"].as_f64().unwrap() > 0.0, "{best}");
    let screened = told("screened")["candidates"].as_array().unwrap().clone();
    let searched = told("searched");
    assert!(screened.iter().any(|own| own["candidate"] == searched["candidate"]), "{searched}");
}

/// A device is read again when its file changes, by what is kept in memory as by the program.
#[test]
fn a_comparison_follows_the_device_that_its_experiment_names() {
    let folder = tour();
    let path = folder.path();
    let shipped = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/model/devices/freedom6s.toml")).unwrap();
    fs::write(path.join("arm.toml"), &shipped).unwrap();
    for file in ["experiment.toml", "believed.toml"] {
        let text = fs::read_to_string(path.join(file)).unwrap();
        fs::write(path.join(file), text.replace("\"freedom6s\"", "\"arm.toml\"")).unwrap();
    }
    let server = Server::new(path, &[]);
    let asked = json!({ "experiment": "experiment.toml", "model": null });
    let before = server.post("api/compared", &asked).ok();
    let other = shipped.replacen("title = \"", "title = \"Another ", 1);
    assert_ne!(other, shipped);
    fs::write(path.join("arm.toml"), other).unwrap();
    let after = server.post("api/compared", &asked).ok();
    assert_ne!(before["key"], after["key"]);
    // The default model may be tried, too.
    server
        .post("api/tried", &json!({ "experiment": "experiment.toml", "model": null, "values": {}, "out": "own.toml" }))
        .ok();
    assert!(dynid::Model::load(path.join("own.toml")).is_ok());
}

#[test]
fn a_model_says_where_it_comes_from() {
    let folder = tour();
    let path = folder.path();
    let fit = |from: &str, to: &str| cli(path, &["fit", "experiment.toml", "--model", from, "--out", to, "--json"]);
    fit("believed.toml", "fitted.toml");
    let add =
        ["add", "input_coupling", "--joint", "4", "--from", "5", "--model", "fitted.toml", "--out", "better.toml"];
    cli(path, &[&add[..], &["--json"]].concat());
    fit("better.toml", "best.toml");
    fs::write(path.join("wrong.toml"), "device = \"freedom6s\"\n[[effect]]\nid = \"none\"\n").unwrap();
    let server = Server::new(path, &[]);
    let told = server.get("api/lineage").ok();
    let told: Vec<[Option<&str>; 3]> = told["models"]
        .as_array()
        .unwrap()
        .iter()
        .map(|own| ["path", "parent", "how"].map(|key| own[key].as_str()))
        .collect();
    let expected = [
        ["believed.toml", "", ""],
        ["fitted.toml", "believed.toml", "fitted"],
        ["better.toml", "fitted.toml", "added"],
        ["best.toml", "better.toml", "fitted"],
        ["wrong.toml", "", ""],
    ];
    assert_eq!(told, expected.map(|own| own.map(|word| Some(word).filter(|word| !word.is_empty()))));
    let wrong = server.get("api/lineage").ok()["models"][4]["error"].clone();
    assert!(wrong.as_str().unwrap().contains("none"), "{wrong}");

    // A model whose parent is gone stands on the one that it adds an effect to.
    fs::remove_file(path.join("better.toml")).unwrap();
    let best = server.get("api/lineage").ok()["models"][2].clone();
    assert_eq!(best, json!({ "path": "best.toml", "parent": "fitted.toml", "how": "added_and_fitted" }));
}

/// What a diagnosis writes was fitted by it, from the model that it was asked about.
#[test]
fn a_diagnosis_writes_a_child_of_what_it_was_asked_about() {
    let folder = tour();
    let path = folder.path();
    let diagnose = ["diagnose", "experiment.toml", "--model", "believed.toml", "--out", "better.toml", "--json"];
    cli(path, &diagnose);
    let server = Server::new(path, &[]);
    let better = server.get("api/lineage").ok()["models"][1].clone();
    assert_eq!(better, json!({ "path": "better.toml", "parent": "believed.toml", "how": "added_and_fitted" }));
    let [believed, better] = ["believed.toml", "better.toml"].map(|name| dynid::Model::load(path.join(name)).unwrap());
    let fit = better.fit.as_ref().unwrap();
    assert_eq!((fit.error.as_str(), &fit.parent_digest), ("prediction", &believed.digest()));
    assert!(fit.std_error["joint.4.input_coupling.5.gain"] > 0.0 && fit.cost_after.is_finite(), "{fit:?}");
    let spring = "joint.4.spring.Ks";
    assert_eq!(better.prior(spring), believed.parameter(spring).map(|own| own.value));
    let ladder = cli(path, &["ladder", "experiment.toml", "believed.toml", "better.toml", "--json"]);
    assert_eq!(ladder["rungs"][1]["lineage"], "added_and_fitted");
}

#[test]
fn times_of_a_run_are_rows_of_its_file() {
    let folder = tour();
    let path = folder.path();
    let log = fs::read_to_string(path.join("wrist-1.csv")).unwrap();
    let mut lines: Vec<&str> = log.lines().collect();
    let time = |line: &str| line.split(',').next().unwrap().parse::<f64>().unwrap();
    // Rows 10 and 200 are there twice.
    lines.insert(1 + 200, lines[1 + 200]);
    lines.insert(1 + 10, lines[1 + 10]);
    fs::write(path.join("wrist-1.csv"), lines.join("\n")).unwrap();
    let text = fs::read_to_string(path.join("experiment.toml")).unwrap();
    let server = Server::new(path, &[]);
    for first in [0, 5, 50] {
        let rows = format!("rows = [{first}, 400]\nmoving = {}\n", first > 0);
        let own = text.replacen("[[run]]\n", &format!("repeated_times = \"skip\"\n[[run]]\n{rows}"), 1);
        fs::write(path.join("experiment.toml"), own).unwrap();
        let runs = server.get(EXPERIMENT).ok()["runs"].clone();
        assert_eq!((&runs[0]["rows"], &runs[0]["moving"]), (&json!([first, 400]), &json!(first > 0)));
        assert_eq!(runs[1]["rows"], json!(null));
        let between = |from: f64, to: f64| {
            server.post("api/rows", &json!({ "experiment": "experiment.toml", "run": 0, "from": from, "to": to }))
        };
        for [from, to] in [[60, 150], [60, 300], [210, 399]] {
            let (t0, t1) = (time(lines[1 + from]), time(lines[1 + to]));
            assert_eq!(between(t0, t1).ok()["rows"], json!([from, to + 1]), "both ends are in");
        }
        assert_eq!(between(-1.0, 1e9).ok()["rows"], json!([first, 400]));
        between(1e8, 1e9).error(400);
    }
}

#[test]
fn an_effect_of_the_user_is_told_of_by_its_name_and_not_by_an_old_one() {
    let folder = tour();
    let path = folder.path();
    let title = "<script>alert(1)</script>";
    let ours = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/own_effect/end_stops.toml");
    let text = fs::read_to_string(ours).unwrap();
    let line = text.lines().find(|line| line.starts_with("title")).unwrap();
    let text = text.replacen(line, &format!("title = {title:?}"), 1);
    fs::create_dir(path.join("effects")).unwrap();
    fs::write(path.join("effects/end_stops.toml"), &text).unwrap();
    let add = ["add", "end_stops", "--joint", "4", "--model", "believed.toml", "--out", "own.toml", "--json"];
    cli(path, &add);
    let server = Server::new(path, &["experiment.toml"]);
    let ask = |model: &str| server.post("api/parameters", &json!({ "experiment": "experiment.toml", "model": model }));
    assert!(ask("own.toml").ok().to_string().contains("end_stops at joint 4"));
    // What is text in a log or an effect is text in a page.
    let column = "<script>alert(2)</script>";
    let log = fs::read_to_string(path.join("wrist-1.csv")).unwrap();
    fs::write(path.join("wrist-1.csv"), log.replacen(",q4", &format!(",{column}"), 1)).unwrap();
    let experiment = fs::read_to_string(path.join("experiment.toml")).unwrap();
    let experiment = experiment.replacen("[[run]]\n", &format!("[[run]]\ncolumns = {{ q4 = {column:?} }}\n"), 1);
    fs::write(path.join("experiment.toml"), experiment).unwrap();
    server.get(EXPERIMENT).ok();
    let report = server.done(&["report", "experiment.toml", "own.toml", "--out", "report.html"]);
    assert_eq!(report["state"], "done", "{report}");
    let page = server.page("report.html");
    assert!(!String::from_utf8_lossy(&page.body).contains("<script>alert"));

    // Commands know what is new at once; what is kept in memory is not made of what is old.
    fs::write(path.join("effects/end_stops.toml"), format!("{text}\n# changed\n")).unwrap();
    let refused = ask("own.toml").error(422);
    assert!(refused.contains("start `dynid open` again"), "{refused}");
    ask("believed.toml").ok();
    assert_eq!(server.done(&["table", "own.toml"])["state"], "done");
}

#[cfg(unix)]
#[test]
fn effects_that_lie_outside_are_not_read() {
    use std::os::unix::fs::symlink;
    let outside = TempDir::new().unwrap();
    fs::write(outside.path().join("secret.toml"), "secret = true").unwrap();
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    symlink(outside.path(), path.join("effects")).unwrap();
    server.post("api/jobs", &json!({ "args": ["table", "believed.toml"] })).error(403);
    fs::remove_file(path.join("effects")).unwrap();
    fs::create_dir(path.join("effects")).unwrap();
    symlink(outside.path().join("secret.toml"), path.join("effects/mine.toml")).unwrap();
    server.post("api/jobs", &json!({ "args": ["table", "believed.toml"] })).error(403);
    server.post("api/jobs", &json!({ "args": ["plan", "freedom6s", "--effects", "effects"] })).error(403);
    let refused =
        Command::new(env!("CARGO_BIN_EXE_dynid")).args(["open", "--no-browser"]).current_dir(path).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
}

#[test]
fn what_is_no_number_is_null_or_refused() {
    let folder = tour();
    let path = folder.path();
    let server = Server::new(path, &[]);
    let believed = fs::read_to_string(path.join("believed.toml")).unwrap();
    let compared = |value: &str| {
        fs::write(path.join("odd.toml"), believed.replacen("7.15", value, 1)).unwrap();
        server.post("api/compared", &json!({ "experiment": "experiment.toml", "model": "odd.toml" }))
    };
    // A drive that is so strong leaves its log for ever.
    let wild = compared("1e9").ok();
    assert_eq!(wild["runs"][0]["joints"][0]["rmse"], json!(null));
    assert!(wild["runs"][0]["notes"].to_string().contains("the simulation"), "{}", wild["runs"][0]);
    for value in ["nan", "inf", "-inf"] {
        let refused = compared(value).error(422);
        assert!(refused.contains("odd.toml:"), "with its place: {refused}");
    }
    for value in ["1e999", "null", "NaN", "\"1\""] {
        let body = format!(
            r#"{{"experiment":"experiment.toml","model":"believed.toml","run":0,"values":{{"joint.4.spring.Ks":{value}}},"width":9}}"#
        );
        server.raw("POST", &server.at("api/try"), &[JSON], body.as_bytes()).error(400);
    }
}

#[test]
fn a_tour_goes_on_as_a_page() {
    let folder = TempDir::new().unwrap();
    let mut server = Server::of(folder.path(), &["tour", "--open", "--no-browser"]);
    let opened = server.get("api/folder").ok();
    let place = folder.path().canonicalize().unwrap().join("dynid-tour");
    assert_eq!(opened["folder"], json!(place.display().to_string()));
    assert_eq!((&opened["experiment"], &opened["model"]), (&json!("experiment.toml"), &json!("better-fitted.toml")));
    server.end();
    let json = ["tour", "--open", "--json"];
    let refused = Command::new(env!("CARGO_BIN_EXE_dynid")).args(json).current_dir(folder.path()).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{refused:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
