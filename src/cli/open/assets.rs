//! The page itself, inside the binary.

/// Name, media type and bytes of every file of the page; the first is what the address shows.
const FILES: [(&str, &str, &[u8]); 1] = [("index.html", HTML, include_bytes!("page/index.html"))];

const HTML: &str = "text/html; charset=utf-8";

/// Media type and bytes of a file; of the page where nothing is named.
pub fn file(name: &str) -> Option<(&'static str, &'static [u8])> {
    let found = FILES.iter().find(|(own, ..)| *own == name || (name.is_empty() && *own == FILES[0].0));
    found.map(|(_, media, bytes)| (*media, *bytes))
}
