//! What happens, told to every page that listens: files that changed, jobs and their progress.

use std::collections::{BTreeSet, VecDeque};
use std::convert::Infallible;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::stream::{self, Stream};
use notify::{EventKind, RecommendedWatcher, RecursiveMode, Watcher};
use serde_json::{Value, json};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, mpsc};

use super::App;
use super::folder::{is_hidden, with_slashes};

/// Events that a slow page may be behind before it misses some.
const BEHIND: usize = 4096;
/// Files that changed are told so often at most.
const APART: Duration = Duration::from_millis(200);

/// Where events are told.
#[derive(Clone)]
pub struct Hub(broadcast::Sender<(&'static str, String)>);

impl Hub {
    pub fn new() -> Self {
        Self(broadcast::Sender::new(BEHIND))
    }

    pub fn tell(&self, event: &'static str, data: &Value) {
        // Nobody may be listening.
        let _ = self.0.send((event, data.to_string()));
    }
}

/// `GET api/events`
pub async fn events(State(app): State<Arc<App>>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let listening = app.hub.0.subscribe();
    let first = known(&app);
    let told = stream::unfold((app, first, listening), |(app, mut first, mut listening)| async move {
        let (event, data) = loop {
            if let Some(known) = first.pop_front() {
                break known;
            }
            match listening.recv().await {
                Ok(told) => break told,
                // What was missed is made up for by what is.
                Err(RecvError::Lagged(_)) => {
                    first = known(&app);
                    first.push_back(("folder", json!({ "paths": [] }).to_string()));
                }
                Err(RecvError::Closed) => return None,
            }
        };
        Some((Ok(Event::default().event(event).data(data)), (app, first, listening)))
    });
    Sse::new(told).keep_alive(KeepAlive::new().interval(Duration::from_secs(15)).text("here"))
}

/// Every job, as it stands.
fn known(app: &App) -> VecDeque<(&'static str, String)> {
    app.jobs.summaries().iter().map(|summary| ("job", summary.to_string())).collect()
}

/// Tells of the files of `root` that change, as long as what it returns is kept.
pub fn watch(root: PathBuf, hub: Hub) -> notify::Result<RecommendedWatcher> {
    let (sender, mut receiver) = mpsc::unbounded_channel::<PathBuf>();
    let mut watcher = notify::recommended_watcher(move |event: notify::Result<notify::Event>| {
        // Whoever reads a file changes nothing.
        let changes = event.ok().filter(|event| !matches!(event.kind, EventKind::Access(_)));
        for path in changes.into_iter().flat_map(|event| event.paths) {
            let _ = sender.send(path);
        }
    })?;
    watcher.watch(&root, RecursiveMode::Recursive)?;
    tokio::spawn(async move {
        while let Some(first) = receiver.recv().await {
            tokio::time::sleep(APART).await;
            let mut paths = vec![first];
            while let Ok(path) = receiver.try_recv() {
                paths.push(path);
            }
            let relative = paths.iter().filter_map(|path| path.strip_prefix(&root).ok());
            let paths: BTreeSet<String> =
                relative.filter(|path| !is_hidden(path)).map(with_slashes).filter(|path| !path.is_empty()).collect();
            if !paths.is_empty() {
                hub.tell("folder", &json!({ "paths": paths }));
            }
        }
    });
    Ok(watcher)
}
