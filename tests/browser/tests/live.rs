//! From hand to picture, as the browser itself measures it. Times are printed beside what they should be; none is asserted,
//! for machines differ. What is asserted is that pictures are whole.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

use dynid_browser::{Browser, Server};
use dynid_plant::recipe::{self, Recipe};
use serde_json::json;

/// Measurements wait for each other.
static ALONE: Mutex<()> = Mutex::new(());

/// One joint with friction that has a state, for 30 s at 100 Hz.
const RECIPE: &str = r#"
device = "freedom6s"
seed = 28
sample_s = 0.01
steps_per_sample = 60
noise_rms = 2e-4
quantum = 1e-4
start = [0.1, -0.05, 0.0, 0.0, -0.28, -0.05]

[[run]]
file = "wrist.csv"
free = [4]
role = "fit"
duration_s = 30.0
torque = [{ joint = 4, amplitude = 0.005, hz = 0.25 }, { joint = 4, amplitude = 0.002, hz = 0.9 }]
"#;

const MODEL: &str = r#"
device = "freedom6s"

[[effect]]
id = "gain"
joint = 4
Kp = { value = 7.15, fixed = true }

[[effect]]
id = "spring"
joint = 4

[[effect]]
id = "lugre"
joint = 4
"#;

/// Marks when a control was moved and when the picture that follows is on the screen: a panel says in words what it draws
/// before it draws, and what comes after the next frame comes after it is painted.
const WATCH: &str = r"
    const panel = document.querySelector('canvas[role=img]');
    window.times = [];
    let began = null;
    for (const kind of ['input', 'keydown']) document.addEventListener(kind, (event) => {
        if (kind === 'keydown' && event.target.matches('input')) return;
        performance.mark('moved', { startTime: event.timeStamp });
        began = true;
    }, true);
    new MutationObserver(() => {
        if (!began) return;
        began = null;
        requestAnimationFrame(() => setTimeout(() => {
            performance.mark('painted');
            window.times.push(performance.measure('hand to picture', 'moved', 'painted').duration);
        }));
    }).observe(panel, { attributes: true, attributeFilter: ['aria-label'] });
    return true;
";

/// Presses a key again and again, each time when the picture of the time before is there; median and 95th percentile (ms).
fn measured(browser: &Browser, keys: &[&str]) -> (f64, f64) {
    assert_eq!(browser.value(WATCH), true);
    for (n, key) in keys.iter().enumerate() {
        browser.press(key);
        browser.until(&format!("window.times.length > {n}"));
    }
    let times = browser.value("window.times");
    let mut times: Vec<f64> = times.as_array().unwrap().iter().map(|own| own.as_f64().unwrap()).collect();
    times.sort_by(f64::total_cmp);
    (times[times.len() / 2], times[times.len() * 95 / 100])
}

#[test]
#[ignore = "drives Chromium"]
fn a_value_under_a_slider() {
    let _alone = ALONE.lock();
    let recipe: Recipe = toml::from_str(RECIPE).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device(&recipe.device).unwrap()).unwrap() {
        fs::write(folder.path().join(name), text).unwrap();
    }
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "model.toml"]);
    let browser = Browser::new();
    browser.go(&format!("{}#view=try&joint=4", server.address));
    browser.shown("#fit-these");
    browser.idle();
    browser.until("/measured from .* simulated from/.test(document.querySelector('canvas[role=img]').ariaLabel)");
    // The mouse's way to the same: a click beside the knob moves it.
    browser.tab_to("slide-joint.4.spring.Ks");
    let error = "document.querySelector('#tried-error .number').dataset.value";
    let before = browser.text(error);
    let keys: Vec<&str> = std::iter::repeat_n("ArrowRight", 60).collect();
    let (median, late) = measured(&browser, &keys);
    println!(
        "slider to picture, one joint, 30 s at 100 Hz: median {median:.0} ms (at most 50), 95 % within {late:.0} ms"
    );
    browser.idle();
    assert_ne!(browser.text(error), before, "another value, another error");
    // What is drawn is what the model does with the value under the slider.
    let value = browser.text("document.getElementById('value-joint.4.spring.Ks').title");
    let tried = browser.text(error);
    let model = MODEL.replacen("id = \"spring\"\njoint = 4", &format!("id = \"spring\"\njoint = 4\nKs = {value}"), 1);
    fs::write(folder.path().join("as_tried.toml"), model).unwrap();
    let printed = dynid_browser::json(folder.path(), &["compare", "experiment.toml", "--model", "as_tried.toml"]);
    let rmse = printed["runs"][0]["joints"][0]["rmse"].as_f64().unwrap();
    let tried: f64 = tried.parse().unwrap();
    assert!((tried / rmse - 1.0).abs() < 0.05, "{tried} under the slider, {rmse} by compare");
    browser.assert_clean(&server.address);
}

const ROWS: usize = 1_000_000;
/// Where one sample sticks out, and how far.
const SPIKE: (usize, f64) = (618_034, 2.75);

/// A million rows at 1 kHz, in one of which the position jumps.
fn long_log(folder: &Path) {
    let mut text = String::with_capacity(64 * ROWS);
    text.push_str("t,q0,q1,q2,q3,q4,q5,tau0,tau1,tau2,tau3,tau4,tau5\n");
    for row in 0..ROWS {
        let t = row as f64 * 1e-3;
        let q = if row == SPIKE.0 { SPIKE.1 } else { 0.4 * (0.05 * t).sin() + 0.1 * (3.0 * t).sin() };
        let tau = 0.003 * (0.05 * t).cos();
        writeln!(text, "{t:.3},0,0,0,0,{q:.5},0,0,0,0,0,{tau:.6},0").unwrap();
    }
    fs::write(folder.join("long.csv"), text).unwrap();
    let experiment = "device = \"freedom6s\"\n\n[[run]]\nfile = \"long.csv\"\nfree = [4]\nrole = \"fit\"\n";
    fs::write(folder.join("experiment.toml"), experiment).unwrap();
}

/// The most that the first panel draws, as it says in words.
const MOST: &str =
    "Number(document.querySelector('canvas[role=img]').ariaLabel.match(/q4.* to (\\S+) rad/)[1].replaceAll('−', '-'))";

/// Whether the picture holds the colour of its first series in the upper eighth of the panel, at a share of its time.
fn is_drawn_high(browser: &Browser, share: f64) -> bool {
    let found = browser.value(&format!(
        "const panel = document.querySelector('canvas[role=img]');
         const copy = new OffscreenCanvas(panel.width, panel.height);
         const pen = copy.getContext('2d', {{ willReadFrequently: true }});
         pen.drawImage(panel, 0, 0);
         const at = Math.round((66 + {share} * (panel.clientWidth - 76)) * devicePixelRatio);
         const {{ data }} = pen.getImageData(at - 4, 0, 9, Math.round(panel.height / 8));
         for (let i = 0; i < data.length; i += 4)
             if (data[i] - data[i + 2] > 100 && data[i + 3] > 60) return true;
         return false;"
    ));
    found == true
}

#[test]
#[ignore = "drives Chromium"]
fn a_million_rows() {
    let _alone = ALONE.lock();
    let folder = tempfile::tempdir().unwrap();
    long_log(folder.path());
    // Without a name: what is named is read ahead, while the browser starts.
    let server = Server::open(folder.path(), &[]);
    let browser = Browser::new();
    browser.look(1280, 900, dynid_browser::Scheme::Light);
    let drawn = "/q4.*from/.test(document.querySelector('canvas[role=img]')?.ariaLabel ?? '')";
    let first_picture = || {
        // Since the address was entered; a panel is painted when the frame after its words is over.
        let script = format!(
            "return (async () => {{ while (!({drawn})) await new Promise(requestAnimationFrame);
             await new Promise((painted) => requestAnimationFrame(() => setTimeout(painted)));
             return performance.now(); }})()"
        );
        browser.value(&script).as_f64().unwrap()
    };
    browser.go(&format!("{}#view=logs", server.address));
    let first = first_picture();
    browser.reload();
    let again = first_picture();
    println!(
        "a million rows: first picture {first:.0} ms (at most 1000), by a server that has read them {again:.0} ms"
    );

    assert_eq!(browser.value(MOST), json!(SPIKE.1), "the spike is drawn when all is shown");
    let share = SPIKE.0 as f64 / (ROWS - 1) as f64;
    assert!(is_drawn_high(&browser, share) && !is_drawn_high(&browser, share - 0.05), "it is on the screen");

    browser.shown("canvas[role=img]");
    while browser.value("document.activeElement.matches('canvas[role=img]')") != true {
        browser.press("Tab");
    }
    let keys: Vec<&str> = std::iter::repeat_n(["+", "ArrowRight", "-", "ArrowLeft"], 12).flatten().collect();
    let (median, late) = measured(&browser, &keys);
    println!("a million rows: zoom and pan, median {median:.0} ms (at most 50), 95 % within {late:.0} ms");

    // About the spike and beside it, down to single samples.
    let t = SPIKE.0 as f64 * 1e-3;
    for half in [100.0, 1.0, 0.02] {
        for (about, is_there) in [(t, true), (t - 2.5 * half, false)] {
            mark(&browser, about - half, about + half);
            browser.click("#zoom-part");
            browser.until(&format!(
                "Math.abs(Number(document.querySelector('canvas[role=img]').ariaLabel.match(/time (\\S+) to/)[1]) - {}) < 0.1",
                about - half
            ));
            browser.idle();
            let most = browser.value(MOST).as_f64().unwrap();
            let expected: f64 = extreme(about - half, about + half);
            assert_eq!(most == SPIKE.1, is_there, "{about} +- {half}: {most}");
            assert!(
                (most - expected).abs() <= 2e-3 * expected.abs(),
                "{about} +- {half}: {most}, the log has {expected}"
            );
        }
    }
    browser.assert_clean(&server.address);
}

/// The largest position of the log between two times; one sample beyond either end is drawn, too.
fn extreme(from: f64, to: f64) -> f64 {
    let rows = (from * 1e3).floor() as usize - 1..=(to * 1e3).ceil() as usize + 1;
    rows.map(|row| {
        let t = row as f64 * 1e-3;
        if row == SPIKE.0 { SPIKE.1 } else { 0.4 * (0.05 * t).sin() + 0.1 * (3.0 * t).sin() }
    })
    .fold(f64::NEG_INFINITY, f64::max)
}

/// Marks a part of the run by its two times.
fn mark(browser: &Browser, from: f64, to: f64) {
    for (id, value) in [("part-from", from), ("part-to", to)] {
        browser.click(&format!("#{id}"));
        browser.press("Control+a");
        browser.type_text(&format!("{value:.3}"));
        browser.press("Tab");
        browser.until(&format!("Math.abs(Number(document.getElementById('{id}').value) - {value}) < 1e-3"));
    }
}
