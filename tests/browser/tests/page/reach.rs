//! The page for everyone: a name for every control, a focus that is seen, no text beyond the window, dark and light.

use std::fs;

use dynid_browser::{Browser, Scheme, Server, json, tour};
use serde_json::json as value;

const VIEWS: [&str; 7] = ["logs", "check", "compare", "try", "diagnose", "ladder", "wall"];

/// What screen readers call a control.
const CONTROLS: [&str; 13] = [
    "button",
    "checkbox",
    "combobox",
    "ComboBoxMenu",
    "comboBoxMenuButton",
    "link",
    "listbox",
    "radio",
    "slider",
    "spinbutton",
    "tab",
    "textbox",
    "DisclosureTriangle",
];

/// Goes to a view and waits until it is all there.
fn look_at(browser: &Browser, server: &Server, view: &str) {
    browser.go("about:blank");
    browser.go(&format!("{}#view={view}&experiment=experiment.toml&model=fitted.toml&joint=4", server.address));
    browser.idle();
    // Charts ask for what they draw once they know their width.
    std::thread::sleep(std::time::Duration::from_millis(300));
    browser.idle();
}

/// The roles of controls, and of pictures, that a screen reader would find without a name.
fn nameless(browser: &Browser) -> Vec<String> {
    let tree = browser.devtools("Accessibility.getFullAXTree", value!({}));
    let nodes = tree["nodes"].as_array().unwrap();
    let role = |own: &serde_json::Value| own["role"]["value"].as_str().unwrap_or_default().to_owned();
    let is_control = |role: &str| CONTROLS.contains(&role) || ["img", "image", "dialog", "region"].contains(&role);
    let controls: Vec<_> = nodes.iter().filter(|own| own["ignored"] == false && is_control(&role(own))).collect();
    assert!(controls.len() > 10, "the view has controls");
    let has_name = |own: &serde_json::Value| own["name"]["value"].as_str().is_some_and(|name| !name.trim().is_empty());
    controls.into_iter().filter(|own| !has_name(own)).map(role).collect()
}

/// Whether what has the focus shows it: by an outline, or, in the graph, by the line about its box.
const IS_FOCUS_SEEN: &str = "return (() => {
    const own = document.activeElement;
    const { width, height } = own.getBoundingClientRect();
    const style = getComputedStyle(own);
    if (Math.min(width, height) < 8 || style.clipPath !== 'none') return false;
    if (style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2) return true;
    const box = own.querySelector('rect');
    return !!box && parseFloat(getComputedStyle(box).strokeWidth) >= 3;
})()";

/// The contrast of every text against what it stands on: those below the 4.5 of the Web Content Accessibility Guidelines.
const FAINT: &str = "return (() => {
    const numbers = (color) => { const pen = document.createElement('canvas').getContext('2d');
        pen.fillStyle = color; pen.fillRect(0, 0, 1, 1); return [...pen.getImageData(0, 0, 1, 1).data]; };
    const light = ([r, g, b]) => { const of = (own) => { const c = own / 255; return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4; };
        return 0.2126 * of(r) + 0.7152 * of(g) + 0.0722 * of(b); };
    const under = (own) => { let mixed = [255, 255, 255]; const above = [];
        for (let at = own; at; at = at.parentElement) above.unshift(numbers(getComputedStyle(at).backgroundColor));
        for (const [r, g, b, a] of above) mixed = mixed.map((c, i) => c + ([r, g, b][i] - c) * a / 255);
        return mixed; };
    const faint = [];
    const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let text = walk.nextNode(); text; text = walk.nextNode()) {
        const own = text.parentElement;
        if (!text.textContent.trim() || !own.getClientRects().length || own.closest(':disabled, option, svg, noscript, .unseen')) continue;
        const [a, b] = [light(numbers(getComputedStyle(own).color)), light(under(own))].sort((x, y) => y - x);
        const contrast = (a + 0.05) / (b + 0.05);
        if (contrast < 4.5) faint.push(`${text.textContent.trim().slice(0, 40)}: ${contrast.toFixed(2)}`);
    }
    return faint;
})()";

/// Controls that can be seen and used, but that the Tab key did not come to; of several radio buttons it comes to one.
const MISSED: &str =
    "return [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex=\"0\"]')]
    .filter((own) => own.checkVisibility() && !own.matches(':disabled, [tabindex=\"-1\"], [type=radio]:not(:checked)')
        && own.closest('details:not([open]) > :not(summary)') === null && !window.been.includes(own))
    .map((own) => own.outerHTML.slice(0, 120))";

#[test]
#[ignore = "drives Chromium"]
fn names_focus_room_and_contrast() {
    let folder = tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "experiment.toml", "believed.toml"]);
    let _ = json(folder.path(), &["fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml"]);
    // Long names must find room, too.
    let long = "a_model_whose_name_is_much_longer_than_any_reasonable_person_would_call_a_file_of_theirs.toml";
    fs::copy(folder.path().join("believed.toml"), folder.path().join(long)).unwrap();
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "fitted.toml"]);
    let browser = Browser::new();
    let mut wrong = Vec::new();
    for scheme in [Scheme::Light, Scheme::Dark] {
        for width in [500, 2500] {
            browser.look(width, 1000, scheme);
            for view in VIEWS {
                look_at(&browser, &server, view);
                let place = format!("{view} at {width} px, {scheme:?}");
                let beyond =
                    browser.value("document.documentElement.scrollWidth - document.documentElement.clientWidth");
                if beyond.as_i64() > Some(0) {
                    let who = browser.text(
                        "return [...document.querySelectorAll('#view *')].filter((own) => own.getBoundingClientRect().right > innerWidth + 1 \
                         && !own.parentElement.closest('.wide, .command, pre, .ticks')).slice(0, 3).map((own) => own.outerHTML.slice(0, 90))",
                    );
                    wrong.push(format!("{place}: {beyond} px beyond the window: {who}"));
                }
                if width == 500 {
                    wrong
                        .extend(nameless(&browser).into_iter().map(|role| format!("{place}: a {role} without a name")));
                    let faint = browser.value(FAINT);
                    wrong.extend(faint.as_array().unwrap().iter().map(|own| format!("{place}: faint: {own}")));
                }
            }
        }
    }
    assert_eq!(wrong, [""; 0], "{}", wrong.join("\n"));
    browser.assert_clean(&server.address);

    // What it would be that is wrong is seen.
    browser.value(
        "const own = document.createElement('button'); document.getElementById('view').append(own); \
         const said = document.createElement('p'); said.textContent = 'faint'; said.style.color = '#777'; \
         said.style.inlineSize = '4000px'; own.after(said); return 0",
    );
    assert_eq!(nameless(&browser), ["button"]);
    assert!(browser.value(FAINT).to_string().contains("faint: "));
    let beyond = browser.value("document.documentElement.scrollWidth - document.documentElement.clientWidth");
    assert!(beyond.as_i64() > Some(0));
}

/// The Tab key goes through all of a view and comes to its end; wherever it is, that is seen.
#[test]
#[ignore = "drives Chromium"]
fn the_focus_is_seen_wherever_it_goes() {
    let folder = tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "experiment.toml", "believed.toml"]);
    let _ = json(folder.path(), &["fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml"]);
    let server = Server::open(folder.path(), &["experiment.toml", "--model", "fitted.toml"]);
    let browser = Browser::new();
    let mut unseen = Vec::new();
    for view in VIEWS {
        look_at(&browser, &server, view);
        browser.value("document.activeElement.blur(); window.been = []; return 0");
        loop {
            browser.press("Tab");
            // Once about: the first again, or none, where the browser's own controls would follow.
            let is_new = browser.value(
                "return (() => { const own = document.activeElement; if (own === document.body || window.been.includes(own)) return false; \
                 window.been.push(own); return true; })()",
            );
            if is_new != true {
                break;
            }
            if browser.value(IS_FOCUS_SEEN) != true {
                unseen.push(format!("{view}: {}", browser.text("document.activeElement.outerHTML.slice(0, 120)")));
            }
        }
        let missed = browser.value(MISSED);
        unseen.extend(missed.as_array().unwrap().iter().map(|own| format!("{view}: not reached: {own}")));
    }
    assert_eq!(unseen, [""; 0], "{}", unseen.join("\n"));
    browser.assert_clean(&server.address);
}
