//! The page itself, inside the binary.

/// Name, media type and bytes of every file of the page; the first is what the address shows.
const FILES: [(&str, &str, &[u8]); 18] = [
    ("index.html", HTML, include_bytes!("page/index.html")),
    ("style.css", CSS, include_bytes!("page/style.css")),
    ("app.js", SCRIPT, include_bytes!("page/app.js")),
    ("chart.js", SCRIPT, include_bytes!("page/chart.js")),
    ("check.js", SCRIPT, include_bytes!("page/check.js")),
    ("compare.js", SCRIPT, include_bytes!("page/compare.js")),
    ("diagnose.js", SCRIPT, include_bytes!("page/diagnose.js")),
    ("dom.js", SCRIPT, include_bytes!("page/dom.js")),
    ("events.js", SCRIPT, include_bytes!("page/events.js")),
    ("jobs.js", SCRIPT, include_bytes!("page/jobs.js")),
    ("ladder.js", SCRIPT, include_bytes!("page/ladder.js")),
    ("lineage.js", SCRIPT, include_bytes!("page/lineage.js")),
    ("logs.js", SCRIPT, include_bytes!("page/logs.js")),
    ("server.js", SCRIPT, include_bytes!("page/server.js")),
    ("slider.js", SCRIPT, include_bytes!("page/slider.js")),
    ("state.js", SCRIPT, include_bytes!("page/state.js")),
    ("try.js", SCRIPT, include_bytes!("page/try.js")),
    ("wall.js", SCRIPT, include_bytes!("page/wall.js")),
];

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Media type and bytes of a file; of the page where nothing is named.
pub fn file(name: &str) -> Option<(&'static str, &'static [u8])> {
    let found = FILES.iter().find(|(own, ..)| *own == name || (name.is_empty() && *own == FILES[0].0));
    found.map(|(_, media, bytes)| (*media, *bytes))
}
