//! Who learns of the secret in the address: nobody but who is told.

use super::*;

/// A page from elsewhere can hand on where it was shown, which opens pages and nothing else.
#[test]
fn the_address_of_a_page_opens_pages_only() {
    let folder = tour();
    fs::write(folder.path().join("of-elsewhere.html"), "<meta name=referrer content=unsafe-url>").unwrap();
    let server = Server::new(folder.path(), &[]);
    server.get("api/page?path=of-elsewhere.html").error(404);
    let page = server.page("of-elsewhere.html");
    assert_eq!(page.status, 200);
    assert!(page.head.contains("referrer-policy: no-referrer") && page.head.contains("sandbox"), "{}", page.head);
    assert!(!String::from_utf8_lossy(&page.body).contains(&server.token));

    let pages = server.get("api/folder").ok()["pages"].as_str().unwrap().to_owned();
    let secret = pages.strip_prefix('/').unwrap().strip_suffix("/api/page").unwrap();
    assert!(secret.len() == 32 && secret != server.token, "{pages}");
    for path in ["", "app.js", "api/folder", "api/file?path=experiment.toml", "api/events", "api/jobs", EXPERIMENT] {
        server.raw("GET", &format!("/{secret}/{path}"), &[], b"").error(404);
    }
    let write = json!({ "path": "x.toml", "text": "a = 1", "replaces": null }).to_string();
    server.raw("POST", &format!("/{secret}/api/write"), &[JSON], write.as_bytes()).error(404);
}
