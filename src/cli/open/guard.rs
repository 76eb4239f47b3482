//! Who may ask: only what comes to the loopback address, from the page itself, below the secret token.

use std::net::SocketAddr;
use std::sync::Arc;

use anyhow::anyhow;
use axum::extract::{Request, State};
use axum::http::{HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::answer::{LARGEST_BODY, Refusal};

/// What the page may do: show and ask what is its own.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The names under which this server may be addressed.
pub struct Guard {
    hosts: [String; 3],
}

impl Guard {
    pub fn new(address: SocketAddr) -> Self {
        let port = address.port();
        Self { hosts: ["127.0.0.1", "localhost", "[::1]"].map(|name| format!("{name}:{port}")) }
    }

    fn check(&self, request: &Request) -> Result<(), Refusal> {
        let text = |name| request.headers().get(name).map(|value: &HeaderValue| value.to_str().unwrap_or_default());
        // A page of elsewhere whose name was made to point here asks under its own name.
        if !text(header::HOST).is_some_and(|host| self.hosts.iter().any(|own| own == host)) {
            return Err(Refusal::forbidden("this server answers under the address that it printed only"));
        }
        let is_own =
            |origin: &str| origin.strip_prefix("http://").is_some_and(|host| self.hosts.iter().any(|own| own == host));
        if text(header::ORIGIN).is_some_and(|origin| !is_own(origin)) {
            return Err(Refusal::forbidden("this server answers its own page only"));
        }
        Ok(())
    }
}

/// Checks every request, and adds to every answer what keeps a browser from doing more than it should.
pub async fn guard(State(guard): State<Arc<Guard>>, request: Request, next: Next) -> Response {
    let mut response = match guard.check(&request) {
        Ok(()) => as_sentence(next.run(request).await).await,
        Err(refusal) => refusal.into_response(),
    };
    let headers = response.headers_mut();
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// A refusal in the form of all others, where it is in the words of what takes requests apart.
async fn as_sentence(response: Response) -> Response {
    let status = response.status();
    let is_json = response.headers().get(header::CONTENT_TYPE).is_some_and(|media| media == "application/json");
    if is_json || !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let words = axum::body::to_bytes(response.into_body(), LARGEST_BODY).await.unwrap_or_default();
    let words = String::from_utf8_lossy(&words);
    let words = if words.is_empty() { status.canonical_reason().unwrap_or_default() } else { &words };
    Refusal::new(status, format!("this is not asked as the page asks: {words}")).into_response()
}

/// A secret of 32 hexadecimal digits.
pub fn token() -> anyhow::Result<String> {
    let mut bytes = [0_u8; 16];
    getrandom::fill(&mut bytes).map_err(|error| anyhow!("the system gives no random numbers: {error}"))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
