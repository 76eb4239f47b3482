//! What holds for every page that the program writes.

/// Fails where the page could make a browser fetch anything.
pub fn opens_with_no_network(page: &str) {
    let page = page.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    let reaching = [
        "http:",
        "https:",
        "//www",
        "src=",
        "srcset",
        "href=",
        "@import",
        "url(",
        "<link",
        "<iframe",
        "<object",
        "<embed",
        "<base",
        "<form",
        "<img",
        "fetch(",
        "XMLHttpRequest",
        "WebSocket",
        "EventSource",
        "sendBeacon",
        "import(",
        "import ",
        "Worker(",
        "<meta http",
    ];
    for reaching in reaching {
        assert!(!page.contains(reaching), "the page contains `{reaching}`");
    }
}

/// Tags that open and close, in their order; void ones and comments left out.
pub fn is_well_formed(page: &str) {
    let body = page.split("<style>").next().unwrap().to_owned() + page.split("</style>").nth(1).unwrap();
    let mut open: Vec<&str> = Vec::new();
    let mut rest = body.split("<script>").next().unwrap();
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let end = rest.find('>').unwrap();
        let tag = &rest[..end];
        rest = &rest[end + 1..];
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap();
        if tag.starts_with('!') || tag.ends_with('/') || ["meta", "br"].contains(&name) {
            continue;
        }
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "</{name}> closes what it did not open");
        } else {
            open.push(name);
        }
    }
    assert_eq!(open, ["html", "body"], "what the script stands in");
}
