//! From logs in which an effect is hidden to a model that has it: by mouse, and by keyboard alone.

use std::fs;
use std::path::{Path, PathBuf};

use dynid_browser::{Browser, Server, json, tour};

/// What the tour's logs hide: the motor of joint 5 pulls at joint 4.
const HIDDEN: &str = "input_coupling";

/// The tour's logs and what is believed of the wrist, outside of the folder that is opened.
fn given(from: &Path) -> Vec<PathBuf> {
    ["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "believed.toml"].iter().map(|name| from.join(name)).collect()
}

/// What the loop must have come to, whoever went through it.
fn is_found(folder: &Path, browser: &Browser, server: &Server) {
    browser.shown(".fall-chart");
    browser.idle();
    let model = browser.text("new URLSearchParams(location.hash.slice(1)).get('model')");
    let text = fs::read_to_string(folder.join(&model)).unwrap();
    assert!(text.contains(HIDDEN) && text.contains("[fit]"), "{model}: {text}");
    // The last rung of the table, and the program on its own, say that nothing is left but noise.
    let held_out = browser
        .value("Number(document.querySelector('table tbody tr:last-child td:nth-child(3) .number').dataset.value)");
    let ladder = json(folder, &["ladder", "experiment.toml", &model]);
    let noise = ladder["noise_floor"].as_f64().unwrap();
    assert_eq!(held_out.as_f64(), ladder["rungs"][0]["rmse_validate"].as_f64());
    assert!(held_out.as_f64().unwrap() < 1.5 * noise, "{held_out} of {noise}");
    // It fell: the first rung's is far above.
    let first = browser.value("Number(document.querySelector('table tbody tr td:nth-child(3) .number').dataset.value)");
    assert!(first.as_f64().unwrap() > 10.0 * noise, "{first} of {noise}");
    browser.assert_clean(&server.address);
}

/// The report that was exported opens in a tab of its own, and is one.
fn report_opens(folder: &Path, browser: &Browser, server: &Server) {
    browser.to_tab(1);
    browser.until("document.readyState === 'complete' && document.querySelector('h1')");
    // It lies below a secret of its own, and knows nothing of the page that opened it.
    let host = &server.address[..server.address.len() - 33];
    let here = browser.text("location.href");
    assert!(here.starts_with(host) && here.contains("/api/page?path=") && !here.starts_with(&server.address), "{here}");
    assert_eq!(browser.text("document.referrer"), "");
    assert_eq!(browser.value("window.opener").as_str(), None);
    let said = browser.text("document.body.innerText");
    assert!(
        said.contains(HIDDEN) && browser.value("document.querySelectorAll('svg').length").as_u64() > Some(0),
        "{said}"
    );
    assert_eq!(browser.complaints(), [""; 0]);
    let written = fs::read_dir(folder).unwrap().flatten().map(|entry| entry.file_name().into_string().unwrap());
    assert_eq!(written.filter(|name| name.ends_with("-report.html")).count(), 1);
}

#[test]
#[ignore = "drives Chromium"]
fn by_mouse() {
    let (outside, folder) = (tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "believed.toml"]), tour(&[]));
    let server = Server::open(folder.path(), &[]);
    let browser = Browser::new();
    browser.go(&server.address);

    let files = given(outside.path());
    browser.drop_files("#zone", &files.iter().map(PathBuf::as_path).collect::<Vec<_>>());
    browser.shown("[id='tick-wrist-3.csv']:checked");
    browser
        .until("[...document.querySelectorAll('#choose-model option')].some((own) => own.value === 'believed.toml')");
    browser.click("#device");
    browser.type_text("freedom6s");
    browser.click("#new");
    browser.shown("#column-q4");
    browser.idle();
    // Over the trace, a drag marks a part.
    browser.drag("figure canvas.tall", 0.3, 0.6);
    browser.until("Number(document.querySelector('#part-to').value) > 3");
    browser.choose("#choose-model", "believed.toml");
    browser.click("#to-check");

    browser.click("#fit");
    browser.shown("#to-diagnose");
    browser.idle();
    assert!(browser.text("location.hash").contains("model=believed-fitted.toml"));

    // A drag over a panel zooms all of them; a double click shows all again.
    let range = "[...document.querySelectorAll('section[aria-label=Panels] canvas[role=img]')].map((own) => own.ariaLabel.match(/time (.*?) s/)[1])";
    let whole = browser.text(range);
    browser.drag("section[aria-label=Panels] canvas.tall", 0.4, 0.6);
    browser.until(&format!("JSON.stringify({range}) !== {}", serde_json::json!(whole)));
    let zoomed = browser.value(range);
    assert!(zoomed.as_array().unwrap().iter().all(|own| own == &zoomed[0]), "{zoomed}");
    browser.double_click("section[aria-label=Panels] canvas.tall");
    browser.until(&format!("JSON.stringify({range}) === {}", serde_json::json!(whole)));
    // A chip of a finding marks its samples, and stays pressed.
    browser.click(".where .chip");
    browser.shown(".where .chip[aria-pressed=true]");
    browser.click("#to-diagnose");

    browser.click("#diagnose");
    browser.shown(".bar");
    browser.shown(".facts");
    browser.idle();
    let named = browser.text("document.querySelector('section[aria-label=Candidate] h2').textContent");
    assert_eq!(named, "input_coupling from joint 5 to joint 4");
    browser.click("#add");
    browser.until("location.hash.includes('view=ladder')");
    is_found(folder.path(), &browser, &server);

    browser.click("#report");
    browser.click(".toast a");
    report_opens(folder.path(), &browser, &server);
}

/// Goes on with Tab until a button has the focus, and presses it.
fn enter(browser: &Browser, id: &str) {
    browser.tab_to(id);
    browser.press("Enter");
}

#[test]
#[ignore = "drives Chromium"]
fn by_keyboard_alone() {
    let (outside, folder) = (tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "believed.toml"]), tour(&[]));
    let server = Server::open(folder.path(), &[]);
    let browser = Browser::new();
    browser.go(&server.address);

    // The button opens the system's dialog, which is no part of the page: what it would give is given.
    browser.devtools("Page.setInterceptFileChooserDialog", serde_json::json!({ "enabled": true }));
    enter(&browser, "choose-files");
    let files = given(outside.path());
    browser.give("#pick-files", &files.iter().map(PathBuf::as_path).collect::<Vec<_>>());
    browser.shown("[id='tick-wrist-3.csv']:checked");
    browser
        .until("[...document.querySelectorAll('#choose-model option')].some((own) => own.value === 'believed.toml')");
    browser.tab_to("device");
    browser.type_text("freedom6s");
    enter(&browser, "new");
    browser.shown("#column-q4");
    browser.idle();
    // In a choice, letters go to the option that begins so.
    browser.tab_to("choose-model");
    browser.type_text("beli");
    browser.until("location.hash.includes('model=believed.toml')");
    enter(&browser, "to-check");

    browser.idle();
    enter(&browser, "fit");
    browser.shown("#to-diagnose");
    browser.idle();
    // Arrow keys go through runs and joints; keys of a chart zoom, move and read it.
    browser.press("ArrowRight");
    browser.until("location.hash.includes('run=1')");
    browser.press("ArrowLeft");
    browser.until("location.hash.includes('run=0')");
    browser.press("ArrowDown");
    browser.until("location.hash.includes('joint=5')");
    browser.press("ArrowUp");
    browser.until("location.hash.includes('joint=4')");
    browser.idle();
    while browser.value("document.activeElement.matches('canvas[role=img]')") != true {
        browser.press("Tab");
    }
    let range =
        "document.querySelector('section[aria-label=Panels] canvas[role=img]').ariaLabel.match(/time (.*?) s/)[1]";
    let whole = browser.text(range);
    browser.press("+");
    browser.until(&format!("{range} !== {}", serde_json::json!(whole)));
    browser.press(".");
    browser.until("document.querySelector('section[aria-label=Panels] .readout').textContent.includes('measured')");
    browser.press("Home");
    browser.until(&format!("{range} === {}", serde_json::json!(whole)));

    // A value under a slider, and back.
    browser.press("4");
    browser.shown("#fit-these");
    browser.idle();
    browser.tab_to("slide-joint.4.spring.Ks");
    let value = "document.getElementById('value-joint.4.spring.Ks').title";
    let before = browser.text(value);
    browser.press("ArrowRight");
    browser.until(&format!("{value} !== {}", serde_json::json!(before)));
    browser.press("Control+z");
    browser.until(&format!("{value} === {}", serde_json::json!(before)));

    browser.press("5");
    enter(&browser, "diagnose");
    browser.shown(".facts");
    browser.idle();
    let named = browser.text("document.querySelector('section[aria-label=Candidate] h2').textContent");
    assert_eq!(named, "input_coupling from joint 5 to joint 4");
    enter(&browser, "add");
    browser.until("location.hash.includes('view=ladder')");
    is_found(folder.path(), &browser, &server);

    enter(&browser, "report");
    browser.shown(".toast a");
    while browser.value("document.activeElement.matches('.toast a')") != true {
        browser.press("Tab");
    }
    browser.press("Enter");
    report_opens(folder.path(), &browser, &server);
}

/// A part of a log is held out by dragging over its trace; the file says so, a message takes it back.
#[test]
#[ignore = "drives Chromium"]
fn a_part_is_held_out() {
    let folder = tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "experiment.toml", "believed.toml"]);
    let server = Server::open(folder.path(), &["experiment.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=logs", server.address));
    browser.idle();
    let file = folder.path().join("experiment.toml");
    let before = fs::read_to_string(&file).unwrap();
    // By times, with the keyboard: the second is below the first until it is typed, too.
    browser.drag("section[aria-label=Trace] canvas.tall", 0.1, 0.2);
    browser.until("document.getElementById('part-to').value");
    browser.tab_to("part-from");
    browser.press("Control+a");
    browser.type_text("2");
    browser.press("Tab");
    assert_eq!(browser.focus(), "part-to", "the Tab key goes on to the next field");
    browser.press("Control+a");
    browser.type_text("4");
    browser.press("Tab");
    assert_eq!(browser.focus(), "hold-out");
    browser.press("Enter");
    browser.until("document.querySelectorAll('section[aria-label=Runs] tbody tr').length === 5");
    browser.idle();
    let held = json(folder.path(), &["compare", "experiment.toml", "--model", "believed.toml"]);
    let roles: Vec<&str> = held["runs"].as_array().unwrap().iter().map(|run| run["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["fit", "validate", "fit", "fit", "validate"]);
    let text = fs::read_to_string(&file).unwrap();
    assert!(
        text.contains("rows = [0, 200]") && text.contains("rows = [200, 401]") && text.contains("rows = [401, 801]"),
        "{text}"
    );
    browser.click(".toast button:not(.plain)");
    browser.until("document.querySelectorAll('section[aria-label=Runs] tbody tr').length === 3");
    assert_eq!(fs::read_to_string(&file).unwrap(), before);
    browser.assert_clean(&server.address);
}
