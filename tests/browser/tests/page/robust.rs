//! What goes wrong outside, and what is written to do harm.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use dynid_browser::{Browser, Server, json, tour};
use serde_json::{Value, json as value};

const FILES: [&str; 5] = ["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "experiment.toml", "believed.toml"];

/// Messages at the edge of the page.
fn messages(browser: &Browser) -> Vec<String> {
    let all = browser.value("[...document.querySelectorAll('.toast p')].map((own) => own.textContent)");
    all.as_array().unwrap().iter().map(|own| own.as_str().unwrap().to_owned()).collect()
}

#[test]
#[ignore = "drives Chromium"]
fn the_server_is_killed_during_a_fit_and_started_again() {
    let folder = tour(&FILES);
    let mut server = Server::open(folder.path(), &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=try", server.address));
    browser.shown("#fit-these");
    browser.idle();
    // Something tried by hand becomes a file before it is fitted.
    browser.tab_to("slide-joint.4.spring.Ks");
    browser.press("ArrowRight");
    browser.click("#fit-these");
    browser.shown("#open-fit");
    // A fit that takes some seconds is in the middle of it.
    let begin = |more: &str| {
        browser.value(&format!(
            "fetch('api/jobs', {{ method: 'POST', headers: {{ 'Content-Type': 'application/json' }}, body: JSON.stringify({{ args: ['fit', \
             'experiment.toml', '--model', 'believed.toml', '--error', 'position', '--starts', '6', '--out', 'many.toml'{more}] }}) }}); return 0"
        ));
    };
    begin("");
    browser.until(
        "[...document.querySelectorAll('.job.running')].some((own) => own.textContent.includes('many.toml') && \
         own.querySelector('.said').textContent.includes('iteration'))",
    );
    let port = server.port().to_owned();
    server.kill();
    let many = folder.path().join("many.toml");
    assert!(!many.is_file(), "the fit was not over");
    let kept = folder.path().join("many.toml.checkpoint");
    let begun = Instant::now();
    while !kept.is_file() {
        assert!(begun.elapsed() < Duration::from_secs(60), "a fit whose server was killed keeps what it has");
        std::thread::sleep(Duration::from_millis(20));
    }

    // One message, which says what to do; nothing that was there is gone.
    browser.until("document.getElementById('link').textContent.includes('open the address that it printed')");
    assert!(browser.value("document.querySelectorAll('#fit-these').length") == 1);
    let during = messages(&browser);
    assert!(during.len() <= 1, "{during:?}");

    let killed = server.address.clone();
    let server = Server::open(folder.path(), &["experiment.toml", "--port", &port]);
    assert_eq!(server.port(), port);
    assert_ne!(server.address, killed);
    browser.go(&format!("{}#view=ladder", server.address));
    browser.shown("[id='rung-believed-tried.toml']");
    browser.idle();
    assert_eq!(browser.text("document.getElementById('link').textContent"), "");
    // The fit ended with its server and kept what it had: the page says so, and it goes on from there.
    browser.go(&format!("{}#view=try&model=believed.toml", server.address));
    browser.reload();
    browser.until("document.getElementById('view').textContent.includes('many.toml.checkpoint')");
    begin(", '--resume'");
    browser.until("[...document.querySelectorAll('#choose-model option')].some((own) => own.value === 'many.toml')");
    let _ = json(folder.path(), &["compare", "experiment.toml", "--model", "many.toml"]);
    // Fits can be had as before.
    let tried = fs::read_to_string(folder.path().join("believed-tried.toml")).unwrap();
    assert!(tried.contains("Ks"), "{tried}");
    browser.go(&format!("{}#view=try&model=believed-tried.toml", server.address));
    browser.reload();
    browser.shown("#fit-these");
    browser.idle();
    browser.click("#fit-these");
    browser.shown("#open-fit");
    let outs: Vec<String> = fs::read_dir(folder.path())
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().into_string().unwrap())
        .filter(|name| name.starts_with("believed") && name.ends_with(".toml"))
        .collect();
    for name in outs {
        // Every model file is whole.
        let _ = json(folder.path(), &["compare", "experiment.toml", "--model", &name]);
    }
    // The old page asks for its own address until it is left: of these requests some fail, whenever that is.
    let is_while_away = |own: &String| own.starts_with(&killed) && own.contains("Failed to load resource");
    let other: Vec<String> = browser.complaints().into_iter().filter(|own| !is_while_away(own)).collect();
    assert_eq!(other, [""; 0]);
}

/// What is typed stays, whatever is written in the folder meanwhile and however often the view is drawn anew for it.
#[test]
#[ignore = "drives Chromium"]
fn what_is_typed_stays() {
    let folder = tour(&FILES);
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=logs", server.address));
    browser.shown("#experiment-text");
    browser.idle();
    browser.value("document.querySelector('details:has(#experiment-text)').open = true; return 0");
    for (place, written) in [("device", "freedom6s-of-mine"), ("experiment-text", "# by hand, slowly")] {
        browser.value(&format!(
            "const own = document.getElementById('{place}'); own.focus(); own.setSelectionRange?.(0, 0); return 0"
        ));
        for (n, letter) in written.chars().enumerate() {
            fs::copy(folder.path().join("wrist-1.csv"), folder.path().join(format!("{place}-{n}.csv"))).unwrap();
            browser.press(&letter.to_string());
            std::thread::sleep(Duration::from_millis(120));
        }
        browser.until(&format!("document.getElementById('tick-{place}-{}.csv')", written.len() - 1));
        browser.idle();
        let value = browser.text(&format!("document.getElementById('{place}').value"));
        assert!(value.contains(written), "{value}");
    }
    browser.assert_clean(&server.address);
}

/// An old address is refused and says so; the page of a server that is gone does not turn into an empty one.
#[test]
#[ignore = "drives Chromium"]
fn an_old_address_is_no_way_in() {
    let folder = tour(&FILES);
    let mut server = Server::open(folder.path(), &["experiment.toml"]);
    let old = server.address.clone();
    let port = server.port().to_owned();
    server.kill();
    let server = Server::open(folder.path(), &["experiment.toml", "--port", &port]);
    assert_ne!(server.address, old, "every start has a secret of its own");
    let browser = Browser::new();
    browser.go(&old);
    let said = browser.text("document.body.innerText");
    assert!(
        !said.contains("experiment.toml") && browser.value("document.getElementById('view')") == Value::Null,
        "{said}"
    );
}

#[test]
#[ignore = "drives Chromium"]
fn twenty_tabs() {
    let folder = tour(&FILES);
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    for n in 0..20 {
        if n > 0 {
            browser.tab();
        }
        let view = ["logs", "check", "compare", "try"][n % 4];
        browser.go(&format!("{}#view={view}&experiment=experiment.toml&model=believed.toml", server.address));
    }
    for n in 0..20 {
        browser.to_tab(n);
        browser.idle();
    }
    // What one does all hear; a file that another program writes, too.
    browser.to_tab(19);
    browser.value(
        "fetch('api/jobs', { method: 'POST', headers: { 'Content-Type': 'application/json' }, \
         body: JSON.stringify({ args: ['compare', 'experiment.toml', '--model', 'believed.toml'] }) }); return 0",
    );
    fs::copy(folder.path().join("believed.toml"), folder.path().join("beside.toml")).unwrap();
    for n in [0, 7, 13, 19] {
        browser.to_tab(n);
        browser.until("[...document.querySelectorAll('#jobs .job.done code')].some((own) => own.textContent.startsWith('dynid compare'))");
        browser
            .until("[...document.querySelectorAll('#choose-model option')].some((own) => own.value === 'beside.toml')");
        assert_eq!(messages(&browser), [""; 0]);
    }
    browser.assert_clean(&server.address);
}

/// Does what a page would do that takes names of columns, files or effects for HTML.
const HARM: [&str; 2] = ["<img src=x onerror='window.harmed=1'>", "<script>window.harmed=1</script>"];

/// That nothing of it came alive in this view, and that it can be read.
fn is_harmless(browser: &Browser, expected: &str) {
    browser.until(&format!(
        "document.body.innerHTML.includes('&lt;') && document.body.textContent.includes({})",
        Value::from(expected)
    ));
    assert_eq!(browser.value("window.harmed ?? null"), Value::Null);
    assert_eq!(browser.value("document.querySelectorAll('img, #view script, #chosen script, #jobs script').length"), 0);
}

#[test]
#[ignore = "drives Chromium"]
fn names_are_shown_as_text() {
    let folder = tour(&FILES);
    let path = folder.path();
    // A column, a log, a title of an effect and a model, all named so.
    let log = fs::read_to_string(path.join("wrist-1.csv")).unwrap();
    let with = |name: &str| {
        let mut lines = log.lines();
        let head = format!("{},{name}\n", lines.next().unwrap());
        head + &lines.map(|line| format!("{line},1\n")).collect::<String>()
    };
    fs::write(path.join("named.csv"), with(HARM[0])).unwrap();
    let file = HARM[1].replace('/', "_");
    fs::write(path.join(format!("{file}.csv")), &log).unwrap();
    fs::copy(path.join("believed.toml"), path.join(format!("{file}.toml"))).unwrap();
    fs::create_dir(path.join("effects")).unwrap();
    let effect =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../own_effect/end_stops.toml")).unwrap();
    let title = effect.lines().find(|line| line.starts_with("title")).unwrap();
    fs::write(path.join("effects/harm.toml"), effect.replace(title, &format!("title = {}", Value::from(HARM[0]))))
        .unwrap();
    let server = Server::open(path, &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=logs", server.address));
    browser.idle();
    is_harmless(&browser, &file);

    // Columns that are not used are offered by their names.
    browser.click("[id='tick-named.csv']");
    browser.click("#device");
    browser.type_text("freedom6s");
    browser.click("#new");
    browser.shown("#column-q4");
    is_harmless(&browser, HARM[0]);

    // An error that names the file, in the message and in the strip of work.
    browser.value(&format!(
        "fetch('api/jobs', {{ method: 'POST', headers: {{ 'Content-Type': 'application/json' }}, body: JSON.stringify({{ args: ['fit', \
         'experiment.toml', '--model', {}, '--out', 'believed.toml'] }}) }}); return 0",
        value!(format!("{file}.toml"))
    ));
    browser.shown("#jobs-over");
    browser.click("#jobs-over");
    browser.until("document.querySelector('.job.failed')");
    is_harmless(&browser, &file);
    browser.click(".job.failed button[aria-label^='Why']");
    browser.shown(".toast.bad");
    is_harmless(&browser, &file);
    for view in ["compare", "ladder", "try", "check"] {
        browser.go("about:blank");
        browser.go(&format!(
            "{}#view={view}&experiment=experiment.toml&model={}",
            server.address,
            percent(&format!("{file}.toml"))
        ));
        browser.idle();
        is_harmless(&browser, &file);
    }
    assert_eq!(browser.complaints(), [""; 0]);
}

/// As in an address.
fn percent(text: &str) -> String {
    text.bytes().map(|byte| format!("%{byte:02X}")).collect()
}

/// What the tests call clean is not so because nobody looks.
#[test]
#[ignore = "drives Chromium"]
fn complaints_and_strangers_would_be_seen() {
    let folder = tour(&FILES);
    let server = Server::open(folder.path(), &["experiment.toml"]);
    let browser = Browser::new();
    browser.go(&server.address);
    browser.idle();
    browser.assert_clean(&server.address);
    browser.value("setTimeout(() => { throw new Error('a mistake'); }); return 0");
    // The page itself may ask nobody else: its policy forbids it, and says so on the console.
    browser.value("fetch('http://127.0.0.1:9/elsewhere').catch(() => { window.refused = true; }); return 0");
    browser.until("window.refused");
    browser.go(&format!("{}style.css", server.address));
    browser.go("about:blank");
    browser.value("fetch('http://127.0.0.1:9/elsewhere').catch(() => { window.refused = true; }); return 0");
    browser.until("window.refused");
    let said = browser.complaints().join("\n");
    assert!(said.contains("a mistake") && said.contains("Content Security Policy"), "{said}");
    assert!(browser.strangers(&server.address).iter().any(|url| url.ends_with("/elsewhere")));
}

/// A log that grows while it is looked at is read again.
#[test]
#[ignore = "drives Chromium"]
fn a_log_that_grows() {
    let folder = tour(&FILES);
    let log = folder.path().join("wrist-1.csv");
    let whole = fs::read_to_string(&log).unwrap();
    let half: String = whole.lines().take(402).map(|line| format!("{line}\n")).collect();
    fs::write(&log, half).unwrap();
    let server = Server::open(folder.path(), &["experiment.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=logs", server.address));
    browser.idle();
    let samples = "document.querySelector('td .number').dataset.value";
    assert_eq!(browser.text(samples), "401");
    fs::write(&log, whole).unwrap();
    browser.until(&format!("{samples} === '801'"));
    browser.assert_clean(&server.address);
}

/// A model that is edited outside during a fit is fitted as it was, and shown as it is.
#[test]
#[ignore = "drives Chromium"]
fn a_file_is_edited_outside_during_a_fit() {
    let folder = tour(&FILES);
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=try", server.address));
    browser.shown("#fit-these");
    browser.idle();
    browser.click("#fit-these");
    let path = folder.path().join("believed.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("7.15", "6.9")).unwrap();
    let begun = Instant::now();
    while !folder.path().join("believed-fitted.toml").is_file() {
        assert!(begun.elapsed() < Duration::from_secs(120), "the fit is written");
        std::thread::sleep(Duration::from_millis(50));
    }
    browser.shown("#open-fit");
    assert!(fs::read_to_string(&path).unwrap().contains("6.9"), "nobody writes over it");
    browser.click("#open-fit");
    browser.shown("#to-diagnose");
    browser.idle();
    assert_eq!(messages(&browser), [""; 0]);
    browser.assert_clean(&server.address);
}
