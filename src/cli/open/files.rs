//! Files of the folder, read and written whole.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, Request, State};
use axum::http::header::InvalidHeaderValue;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::IntoResponse;
use base64::{Engine, prelude::BASE64_STANDARD};
use dynid_files::{FileError, Overwrite, PartialFile, make_folder, write_new};
use dynid_model::sha256_hex;
use dynid_report::plot::SCRIPT;
use futures_util::StreamExt;
use serde::Deserialize;
use serde_json::json;
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;

use super::App;
use super::answer::{Answered, Asked, Refusal, blocking, check_media};
use super::edit::{Change, edited};
use super::folder::{LARGEST_TEXT, with_slashes};

/// Bytes of a log that is handed in.
const LARGEST_LOG: u64 = 2 << 30;
/// What may be handed in beside logs.
const HANDED_IN: [&str; 4] = ["urdf", "xml", "mjcf", "toml"];

/// What a report may do when it is shown: its own pictures and styles, and the one script that the program writes into it.
fn page_policy() -> Result<HeaderValue, InvalidHeaderValue> {
    let script = BASE64_STANDARD.encode(Sha256::digest(format!("\n{SCRIPT}")));
    HeaderValue::from_str(&format!(
        "sandbox allow-scripts; default-src 'none'; script-src 'sha256-{script}'; style-src 'unsafe-inline'; img-src data:; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ))
}

pub type Named = Query<HashMap<String, String>>;

/// A part of the query.
pub fn named<'a>(query: &'a Named, key: &str) -> Result<&'a str, Refusal> {
    query.get(key).map(String::as_str).ok_or_else(|| Refusal::bad(format!("say which: ?{key}=..")))
}

/// `GET api/folder`
pub async fn folder(State(app): State<Arc<App>>) -> Answered {
    blocking(move || {
        let (files, more) = app.folder.files();
        let mut answer = json!({
            "folder": app.folder.root().display().to_string(),
            "experiment": app.experiment.as_deref().map(with_slashes),
            "model": app.model.as_deref().map(with_slashes),
            "version": env!("CARGO_PKG_VERSION"),
            "pages": format!("/{}/api/page", app.pages),
            "log_endings": dynid_tables::ENDINGS,
            "files": files,
        });
        if more > 0 {
            answer["more"] = more.into();
        }
        Ok(Json(answer))
    })
    .await
}

/// `GET api/file`
pub async fn file(State(app): State<Arc<App>>, query: Named) -> Answered {
    let path = app.folder.place(named(&query, "path")?)?;
    blocking(move || {
        let text = text(&path)?;
        Ok(Json(json!({ "path": with_slashes(&path), "digest": sha256_hex(text.as_bytes()), "text": text })))
    })
    .await
}

fn text(path: &Path) -> Result<String, Refusal> {
    let found = fs::metadata(path).ok().filter(fs::Metadata::is_file);
    let found = found.ok_or_else(|| Refusal::missing(format!("there is no file {}", path.display())))?;
    if found.len() > LARGEST_TEXT {
        let sentence = format!("{} is longer than 1 MB; open it with another program", path.display());
        return Err(Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, sentence));
    }
    Ok(dynid_files::read(path)?)
}

#[derive(Deserialize)]
pub struct Writing {
    path: String,
    text: String,
    replaces: Option<String>,
}

/// `POST api/write`
pub async fn write(State(app): State<Arc<App>>, Asked(asked): Asked<Writing>) -> Answered {
    let path = app.folder.place(&asked.path)?;
    blocking(move || {
        let _alone = app.writing();
        if asked.text.len() as u64 > LARGEST_TEXT {
            return Err(Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, "a text file has 1 MB at most"));
        }
        if path.extension().is_some_and(|extension| extension == "toml") {
            asked.text.parse::<toml::Table>().map_err(|error| Refusal::bad(format!("this is no TOML: {error}")))?;
        }
        if let Some(digest) = &asked.replaces {
            same(&path, digest)?;
        }
        make_folder(path.parent().unwrap_or(Path::new("")))?;
        put(&path, &asked.text, asked.replaces.is_some())?;
        Ok(Json(json!({ "digest": sha256_hex(asked.text.as_bytes()) })))
    })
    .await
}

/// Writes a file whole; one that is there is a conflict unless it `replaces` it.
pub fn put(path: &Path, text: &str, replaces: bool) -> Result<(), Refusal> {
    write_new(path, text, Overwrite::if_forced(replaces)).map_err(|error| match error {
        FileError::Exists { .. } => {
            Refusal::conflict(format!("{} is there already and is kept; choose another name", path.display()))
        }
        error => error.into(),
    })
}

/// The text of a file, if it still is the one that was read.
fn same(path: &Path, digest: &str) -> Result<String, Refusal> {
    let text = text(path)?;
    if sha256_hex(text.as_bytes()) == digest {
        return Ok(text);
    }
    Err(Refusal::conflict(format!("{} was changed since it was read; look at it again", path.display())))
}

#[derive(Deserialize)]
pub struct Editing {
    path: String,
    replaces: String,
    changes: Vec<Change>,
}

/// `POST api/edit`
pub async fn edit(State(app): State<Arc<App>>, Asked(asked): Asked<Editing>) -> Answered {
    let path = app.folder.place(&asked.path)?;
    blocking(move || {
        let _alone = app.writing();
        let text = edited(&same(&path, &asked.replaces)?, &asked.changes)?;
        put(&path, &text, true)?;
        Ok(Json(json!({ "digest": sha256_hex(text.as_bytes()), "text": text })))
    })
    .await
}

/// `POST api/upload`
pub async fn upload(State(app): State<Arc<App>>, query: Named, request: Request) -> Answered {
    check_media(&request, "application/octet-stream")?;
    let path = app.folder.place(named(&query, "name")?)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_taken = dynid_tables::ending(&path).is_some() || HANDED_IN.contains(&extension.as_str());
    if path.components().count() != 1 || !is_taken {
        let endings = [&dynid_tables::ENDINGS[..], &HANDED_IN].concat().join(", ");
        return Err(Refusal::bad(format!("give a plain name that ends in one of: {endings}")));
    }
    let unwritable = |source| FileError::Unwritable { path: path.clone(), source };
    let mut partial = PartialFile::of(&path)?;
    let mut file = tokio::fs::File::from_std(partial.file().try_clone().map_err(unwritable)?);
    let mut body = request.into_body().into_data_stream();
    let mut bytes = 0;
    while let Some(chunk) = body.next().await {
        let chunk = chunk.map_err(|_| Refusal::bad("the upload broke off; send it again"))?;
        bytes += chunk.len() as u64;
        if bytes > LARGEST_LOG {
            return Err(Refusal::new(
                StatusCode::PAYLOAD_TOO_LARGE,
                "a log has 2 GiB at most; copy it into the folder",
            ));
        }
        file.write_all(&chunk).await.map_err(unwritable)?;
    }
    // Only flushing tells what became of the last chunk.
    file.flush().await.map_err(unwritable)?;
    file.sync_all().await.map_err(unwritable)?;
    drop(file);
    blocking(move || match partial.take_name(Overwrite::Refuse) {
        // The same log once more is no conflict.
        Err(FileError::Exists { .. }) if !are_equal(partial.file(), &path)? => {
            let sentence = format!(
                "{} is there already with other content and is kept; give the log another name",
                path.display()
            );
            Err(Refusal::conflict(sentence))
        }
        Ok(()) | Err(FileError::Exists { .. }) => Ok(Json(json!({ "path": with_slashes(&path) }))),
        Err(error) => Err(error.into()),
    })
    .await
}

fn are_equal(mut one: &fs::File, other: &Path) -> std::io::Result<bool> {
    use std::io::{BufReader, Read, Seek};
    let other = fs::File::open(other)?;
    one.rewind()?;
    if one.metadata()?.len() != other.metadata()?.len() {
        return Ok(false);
    }
    let mut bytes = BufReader::new(one).bytes().zip(BufReader::new(other).bytes());
    bytes.try_fold(true, |same, (one, other)| Ok(same && one? == other?))
}

/// `GET api/page`, below the secret of pages. A page may be of elsewhere, and needs no script to hand its address on: it may lead to
/// another site, and ask the browser to say where it came from.
pub async fn page(State(app): State<Arc<App>>, query: Named) -> Result<impl IntoResponse, Refusal> {
    let path = app.folder.place(named(&query, "path")?)?;
    if path.extension().is_none_or(|extension| extension != "html") {
        return Err(Refusal::bad("only pages (.html) are shown"));
    }
    let bytes =
        tokio::fs::read(&path).await.map_err(|_| Refusal::missing(format!("there is no page {}", path.display())))?;
    let html = HeaderValue::from_static("text/html; charset=utf-8");
    let headers = [(header::CONTENT_TYPE, html), (header::CONTENT_SECURITY_POLICY, page_policy()?)];
    Ok((headers, bytes))
}
