//! `dynid open`, asked for a command over HTTP as its page does.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::Child;

use anyhow::{Context, bail};
use serde_json::{Value, json};

/// Where a server listens, and its secret.
pub struct Server {
    host: String,
    token: String,
}

impl Server {
    /// Of a process that has just been started, by what it prints.
    pub fn of(child: &mut Child) -> anyhow::Result<Self> {
        let stdout = child.stdout.take().context("its stdout is a pipe")?;
        for line in BufReader::new(stdout).lines() {
            if let Some(address) = line?.strip_prefix("open: http://") {
                let (host, token) =
                    address.trim_end_matches('/').split_once('/').context("an address with a secret")?;
                return Ok(Self { host: host.to_owned(), token: token.to_owned() });
            }
        }
        bail!("the server told no address")
    }

    fn ask(&self, method: &str, path: &str, body: &str) -> anyhow::Result<Value> {
        let mut stream = TcpStream::connect(&self.host)?;
        write!(
            stream,
            "{method} /{}/{path} HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\
             Connection: close\r\n\r\n{body}",
            self.token,
            self.host,
            body.len()
        )?;
        let mut text = String::new();
        stream.read_to_string(&mut text)?;
        let (_, body) = text.split_once("\r\n\r\n").context("an answer with a head")?;
        Ok(serde_json::from_str(body)?)
    }

    /// Starts a command; its number.
    pub fn start(&self, arguments: &[String]) -> anyhow::Result<u64> {
        let answer = self.ask("POST", "api/jobs", &json!({ "args": arguments }).to_string())?;
        answer["id"].as_u64().with_context(|| format!("no job was started: {answer}"))
    }

    /// The words of an ended command's error, if it failed; `None` while it goes on or when it is done.
    pub fn state(&self, id: u64) -> anyhow::Result<(bool, String)> {
        let job = self.ask("GET", &format!("api/jobs/{id}"), "")?;
        let is_over = !["waiting", "running"].contains(&job["state"].as_str().unwrap_or("running"));
        Ok((is_over, job["error"].as_str().unwrap_or_default().to_owned()))
    }
}
