//! Chromium by WebDriver, one call at a time.

use std::fmt::Debug;
use std::future::Future;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fantoccini::actions::{InputSource, KeyAction, KeyActions, MOUSE_BUTTON_LEFT, MouseActions, PointerAction};
use fantoccini::elements::Element;
use fantoccini::error::CmdError;
use fantoccini::wd::WebDriverCompatibleCommand;
use fantoccini::{Client, ClientBuilder, Locator};
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::runtime::{self, Runtime};

use crate::keys;

/// What nothing on the page takes, even where the machine is slow.
const PATIENCE: Duration = Duration::from_secs(120);

/// No dialogs, no services and no network but this machine.
const FLAGS: [&str; 11] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--window-size=1280,900",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
];

/// Which colours a user prefers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// Dark on light.
    Light,
    /// Light on dark.
    Dark,
}

impl Scheme {
    fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Dark => "dark",
        }
    }
}

/// A browser of its own, with a fresh profile; gone at the end of the test.
pub struct Browser {
    runtime: Runtime,
    client: Client,
    driver: Child,
    _profile: TempDir,
}

/// A command of the driver that WebDriver's standard does not have.
#[derive(Debug)]
struct Extension {
    path: &'static str,
    body: Value,
}

impl WebDriverCompatibleCommand for Extension {
    fn endpoint(&self, base: &url::Url, session: Option<&str>) -> Result<url::Url, url::ParseError> {
        base.join(&format!("session/{}/{}", session.unwrap_or_default(), self.path))
    }

    fn method_and_body(&self, _: &url::Url) -> (http::Method, Option<String>) {
        (http::Method::POST, Some(self.body.to_string()))
    }
}

/// Starts Debian's driver at a port that is free.
fn driver() -> (Child, String) {
    let mut child = Command::new("chromedriver")
        .arg("--port=0")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("chromedriver starts; install Debian's chromium and chromium-driver");
    let mut lines = BufReader::new(child.stdout.take().expect("it is piped")).lines();
    let port = loop {
        let line = lines.next().expect("chromedriver says its port").expect("chromedriver says text");
        if let Some((_, port)) = line.split_once("started successfully on port ") {
            break port.trim_end_matches('.').to_owned();
        }
    };
    // Nobody reads on: what it says later must not make it wait.
    std::thread::spawn(move || lines.for_each(drop));
    (child, format!("http://127.0.0.1:{port}"))
}

impl Default for Browser {
    fn default() -> Self {
        Self::new()
    }
}

impl Browser {
    /// Starts it.
    ///
    /// # Panics
    ///
    /// Without Debian's `chromium` and `chromium-driver`.
    #[must_use]
    pub fn new() -> Self {
        let profile = TempDir::new().expect("a temporary folder");
        let flags: Vec<String> = FLAGS
            .iter()
            .map(|flag| (*flag).to_owned())
            .chain([format!("--user-data-dir={}", profile.path().display())])
            .collect();
        let wishes = json!({
            "goog:chromeOptions": { "args": flags },
            "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
        });
        let Value::Object(wishes) = wishes else { unreachable!("it is an object") };
        let runtime = runtime::Builder::new_current_thread().enable_all().build().expect("a runtime starts");
        let (driver, address) = driver();
        let client = runtime
            .block_on(ClientBuilder::new(HttpConnector::new()).capabilities(wishes).connect(&address))
            .expect("Chromium starts");
        Self { runtime, client, driver, _profile: profile }
    }

    fn wait<T, E: Debug>(&self, work: impl Future<Output = Result<T, E>>) -> T {
        self.runtime.block_on(work).unwrap_or_else(|error| panic!("the browser refuses: {error:?}\n{}", self.seen()))
    }

    /// What the page says, for messages of tests that fail.
    fn seen(&self) -> String {
        let script = "return location.href + '\\n' + document.body.innerText";
        let text = self.runtime.block_on(self.client.execute(script, Vec::new()));
        text.ok().and_then(|text| text.as_str().map(str::to_owned)).unwrap_or_default()
    }

    fn extension(&self, path: &'static str, body: Value) -> Value {
        self.wait(self.client.issue_cmd(Extension { path, body }))
    }

    /// A command of Chromium's own protocol.
    pub fn devtools(&self, command: &str, parameters: Value) -> Value {
        self.extension("goog/cdp/execute", json!({ "cmd": command, "params": parameters }))
    }

    /// Goes to an address.
    pub fn go(&self, address: &str) {
        self.wait(self.client.goto(address));
    }

    /// Loads the page anew.
    pub fn reload(&self) {
        self.wait(self.client.refresh());
    }

    /// Opens another tab and looks at it.
    pub fn tab(&self) {
        let new = self.wait(self.client.new_window(true));
        self.wait(self.client.switch_to_window(new.handle));
    }

    /// Looks at the n-th of the tabs, or the last.
    pub fn to_tab(&self, n: usize) {
        let all = self.wait(self.client.windows());
        let tab = all.get(n).or(all.last()).expect("there is one").clone();
        self.wait(self.client.switch_to_window(tab));
    }

    /// The value of some JavaScript, which says `return` or is an expression.
    pub fn value(&self, script: &str) -> Value {
        let script = if script.contains("return ") { script.to_owned() } else { format!("return ({script})") };
        self.wait(self.client.execute(&script, Vec::new()))
    }

    /// The text that some JavaScript gives.
    pub fn text(&self, script: &str) -> String {
        let value = self.value(script);
        value.as_str().map_or_else(|| value.to_string(), str::to_owned)
    }

    /// Waits until an expression of JavaScript is true.
    ///
    /// # Panics
    ///
    /// Where that does not come.
    pub fn until(&self, expression: &str) {
        let begun = Instant::now();
        let script = format!("return !!({expression})");
        loop {
            // While a page loads there may be none to ask.
            let is_so = self.runtime.block_on(self.client.execute(&script, Vec::new()));
            if is_so.is_ok_and(|value| value == true) {
                return;
            }
            assert!(begun.elapsed() < PATIENCE, "this never came: {expression}\n{}", self.seen());
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// Waits until an element is there.
    pub fn shown(&self, selector: &str) {
        self.until(&format!("document.querySelector({})?.getClientRects().length", json!(selector)));
    }

    /// Waits until nothing on the page is at work.
    pub fn idle(&self) {
        self.until("document.querySelector('#view section') && !document.querySelector('[aria-busy=true], .waiting')");
    }

    fn element(&self, selector: &str) -> Element {
        self.wait(self.client.find(Locator::Css(selector)))
    }

    /// Clicks at an element once it can be used, as a mouse does: it must be in the way of nothing.
    ///
    /// # Panics
    ///
    /// Where that does not come.
    pub fn click(&self, selector: &str) {
        self.until(&format!(
            "(() => {{ const own = document.querySelector({}); return own?.getClientRects().length && !own.disabled; }})()",
            json!(selector)
        ));
        let begun = Instant::now();
        loop {
            let done = self.runtime.block_on(async {
                let element = self.client.find(Locator::Css(selector)).await?;
                element.click().await?;
                Ok::<(), CmdError>(())
            });
            match done {
                Ok(()) => return,
                // The view was drawn anew meanwhile, or a strip that stays lies over it: a user scrolls and tries again.
                Err(error) => {
                    assert!(begun.elapsed() < Duration::from_secs(10), "{selector}: {error}\n{}", self.seen())
                }
            }
            let middle = format!("document.querySelector({})?.scrollIntoView({{ block: 'center' }})", json!(selector));
            self.value(&format!("{middle}; return 0"));
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Chooses an option of a select by its value.
    pub fn choose(&self, selector: &str, value: &str) {
        self.shown(selector);
        let element = self.element(selector);
        self.wait(element.select_by_value(value));
    }

    /// Gives files to an element that takes them, as the system's own dialog would.
    pub fn give(&self, selector: &str, files: &[&Path]) {
        let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
        let element = self.element(selector);
        self.wait(element.send_keys(&names.join("\n")));
    }

    fn middle(&self, selector: &str) -> (f64, f64) {
        let at = self.value(&format!(
            "const own = document.querySelector({}); own.scrollIntoView({{ block: 'center' }}); \
             const at = own.getBoundingClientRect(); return [at.x + at.width / 2, at.y + at.height / 2]",
            json!(selector)
        ));
        (at[0].as_f64().expect("a number"), at[1].as_f64().expect("a number"))
    }

    /// Drops files on an element, from outside of the browser.
    pub fn drop_files(&self, selector: &str, files: &[&Path]) {
        self.shown(selector);
        let (x, y) = self.middle(selector);
        let data = json!({ "items": [], "files": files, "dragOperationsMask": 1 });
        for kind in ["dragEnter", "dragOver", "drop"] {
            self.devtools("Input.dispatchDragEvent", json!({ "type": kind, "x": x, "y": y, "data": data }));
        }
    }

    /// Drags over an element from one share of its width to another.
    pub fn drag(&self, selector: &str, from: f64, to: f64) {
        let (x, y) = self.middle(selector);
        let width = self.value(&format!("document.querySelector({}).clientWidth", json!(selector)));
        let width = width.as_f64().expect("a number");
        let at = |share: f64| PointerAction::MoveTo {
            duration: Some(Duration::from_millis(50)),
            x: x + (share - 0.5) * width,
            y,
        };
        let mouse = MouseActions::new("mouse".to_owned())
            .then(at(from))
            .then(PointerAction::Down { button: MOUSE_BUTTON_LEFT })
            .then(at(0.5 * (from + to)))
            .then(at(to))
            .then(PointerAction::Up { button: MOUSE_BUTTON_LEFT });
        self.wait(self.client.perform_actions(mouse));
    }

    /// Clicks twice at the middle of an element.
    pub fn double_click(&self, selector: &str) {
        let (x, y) = self.middle(selector);
        let button = MOUSE_BUTTON_LEFT;
        let mouse = MouseActions::new("mouse".to_owned())
            .then(PointerAction::MoveTo { duration: None, x, y })
            .then(PointerAction::Down { button })
            .then(PointerAction::Up { button })
            .then(PointerAction::Down { button })
            .then(PointerAction::Up { button });
        self.wait(self.client.perform_actions(mouse));
    }

    /// Presses a key, with others held: `Tab`, `Control+z`.
    pub fn press(&self, keys: &str) {
        let codes = keys::codes(keys);
        let down = codes.iter().map(|&value| KeyAction::Down { value });
        let up = codes.iter().rev().map(|&value| KeyAction::Up { value });
        let actions = down.chain(up).fold(KeyActions::new("keys".to_owned()), KeyActions::then);
        self.wait(self.client.perform_actions(actions));
    }

    /// Types some text, key by key.
    pub fn type_text(&self, text: &str) {
        text.chars().for_each(|key| self.press(&key.to_string()));
    }

    /// The id of what has the focus; its tag where it has none.
    pub fn focus(&self) -> String {
        self.text("document.activeElement.id || document.activeElement.tagName")
    }

    /// Goes on with the Tab key until an element has the focus.
    ///
    /// # Panics
    ///
    /// Where it is not reached.
    pub fn tab_to(&self, id: &str) {
        self.until(&format!("document.getElementById({})", json!(id)));
        for _ in 0..250 {
            if self.focus() == id {
                return;
            }
            self.press("Tab");
        }
        panic!("the Tab key does not reach #{id}; it is at #{}\n{}", self.focus(), self.seen());
    }

    /// Makes the window so large (pixels), in these colours.
    pub fn look(&self, width: u32, height: u32, scheme: Scheme) {
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false }),
        );
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme.name() }]);
        self.devtools("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// The picture of what is in the window, as PNG.
    pub fn picture(&self) -> Vec<u8> {
        self.wait(self.client.screenshot())
    }

    fn log(&self, kind: &str) -> Vec<Value> {
        match self.extension("se/log", json!({ "type": kind })) {
            Value::Array(all) => all,
            other => panic!("a log is a list: {other}"),
        }
    }

    /// Errors and warnings on the console since the last time that this was asked.
    pub fn complaints(&self) -> Vec<String> {
        let is_bad = |own: &Value| own["level"] == "SEVERE" || own["level"] == "WARNING";
        let message = |own: Value| own["message"].as_str().unwrap_or_default().to_owned();
        self.log("browser").into_iter().filter(is_bad).map(message).collect()
    }

    /// The events of Chromium's own protocol since the last time that this was asked: method and parameters.
    pub fn events(&self) -> Vec<(String, Value)> {
        let event = |own: Value| {
            let text = own["message"].as_str().unwrap_or_default();
            let mut event: Value = serde_json::from_str(text).expect("events are JSON");
            (event["message"]["method"].as_str().unwrap_or_default().to_owned(), event["message"]["params"].take())
        };
        self.log("performance").into_iter().map(event).collect()
    }

    /// Requests to anything but this address since the last time that events were asked for.
    ///
    /// # Panics
    ///
    /// Where there was none to the address either: then nothing was seen.
    pub fn strangers(&self, address: &str) -> Vec<String> {
        let asked: Vec<String> = self
            .events()
            .into_iter()
            .filter(|(method, _)| method == "Network.requestWillBeSent" || method == "Network.webSocketCreated")
            // Chromium's own page of a new tab, which is there before ours.
            .filter(|(_, own)| !own["documentURL"].as_str().is_some_and(|page| page.starts_with("chrome://")))
            .filter_map(|(_, own)| own["request"]["url"].as_str().or(own["url"].as_str()).map(str::to_owned))
            .collect();
        assert!(asked.iter().any(|url| url.starts_with(address)), "requests are seen: {asked:?}");
        let is_own = |url: &String| [address, "data:", "blob:", "about:"].iter().any(|own| url.starts_with(own));
        asked.into_iter().filter(|url| !is_own(url)).collect()
    }

    /// Asserts that nothing complained on the console, and that every request went to this address.
    ///
    /// # Panics
    ///
    /// Where something did, or one did not.
    pub fn assert_clean(&self, address: &str) {
        assert_eq!(self.complaints(), [""; 0], "the console is clean");
        assert_eq!(self.strangers(address), [""; 0], "no request goes elsewhere");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.runtime.block_on(self.client.clone().close());
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
