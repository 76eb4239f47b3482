//! `dynid open`: the loop on a live page, served to the browser of this machine.
//!
//! Files are the truth. Long work is this program, run beside the server ([`jobs`]); only what must be quick is computed here.

mod answer;
mod assets;
mod compared;
mod edit;
mod effects;
mod events;
mod files;
mod folder;
mod guard;
mod jobs;
mod lineage;
mod logs;
mod pyramid;
mod query;
mod recent;
mod series;
mod starter;
mod touch;
mod trial;

use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, anyhow, bail};
use axum::extract::{DefaultBodyLimit, Path as Segment};
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::{get, post};
use axum::{Router, middleware};
use dynid_files::remove_all_leftovers;
use serde_json::json;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

use super::{Answer, Outcome};
use answer::{LARGEST_BODY, Refusal};
use compared::Comparison;
use effects::OwnEffects;
use events::Hub;
use folder::{Folder, with_slashes};
use guard::{Guard, guard, token};
use jobs::Jobs;
use logs::Loaded;
use recent::Recent;
use trial::Trial;

/// Open the loop on a page in the browser: logs, models, what is missing, and every file and command that the page comes to.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid open                                          the working folder
  dynid open experiment.toml --model fitted.toml      the folder of this experiment
  dynid open experiment.toml --no-browser             prints the address only

The server answers this machine only, under an address that holds a secret, and reads and writes files of that folder only. What
the page does is a file and a command line, which it shows; what is written by other programs it shows by itself. Ctrl-C ends
the server and what runs for the page; fits and diagnoses keep what they have, as on a terminal.")]
pub struct Arguments {
    /// The experiment, or a folder; without it, the working folder.
    pub experiment: Option<PathBuf>,
    /// The model to begin with; it lies in the same folder.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// The port; without it, one that is free.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Print the address, and open no browser.
    #[arg(long)]
    pub no_browser: bool,
}

impl Arguments {
    /// The model and experiment beside which, or the folder in which, the user's effects may lie.
    pub fn files(&self) -> Vec<&Path> {
        let opened = self.experiment.as_deref().unwrap_or(Path::new("."));
        self.model.as_deref().into_iter().chain([opened]).collect()
    }
}

/// All that requests share.
struct App {
    folder: Folder,
    /// What was named on the command line, relative to the folder.
    experiment: Option<PathBuf>,
    model: Option<PathBuf>,
    effects: OwnEffects,
    hub: Hub,
    jobs: Arc<Jobs>,
    /// The secret below which pages of the folder are shown, and nothing else: what they bring may tell others their address.
    pages: String,
    writing: Mutex<()>,
    /// Comparisons are made one after the other: each uses all processors.
    comparing: Semaphore,
    experiments: Recent<Loaded>,
    comparisons: Recent<Comparison>,
    trials: Recent<Trial>,
}

impl App {
    /// Of those who write files one goes on at a time: between looking and writing nothing changes.
    fn writing(&self) -> MutexGuard<'_, ()> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Serves until Ctrl-C.
pub fn run(arguments: &Arguments, effects: Option<&Path>) -> anyhow::Result<Outcome> {
    let app = app(arguments, effects)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(16)
        .enable_all()
        .build()
        .context("the server cannot start its threads")?;
    runtime.block_on(serve(arguments, app))?;
    Ok(Outcome { text: String::new(), json: json!({ "ended": true }), answer: Answer::Yes })
}

fn app(arguments: &Arguments, effects: Option<&Path>) -> anyhow::Result<App> {
    let absolute = |path: &Path| {
        path.canonicalize()
            .with_context(|| format!("cannot open {}; name a file or folder that is there", path.display()))
    };
    let experiment = arguments.experiment.as_deref().map(absolute).transpose()?;
    let model = arguments.model.as_deref().map(absolute).transpose()?;
    let effects = effects.map(absolute).transpose()?;
    let root = match &experiment {
        Some(folder) if folder.is_dir() => folder.clone(),
        Some(file) => file.parent().unwrap_or(file).to_owned(),
        None => absolute(Path::new("."))?,
    };
    let inside = |path: PathBuf| match path.strip_prefix(&root) {
        Ok(relative) => Ok(relative.to_owned()),
        Err(_) => bail!("{} lies outside of {}; open a folder that holds both", path.display(), root.display()),
    };
    let experiment = experiment.filter(|path| path.is_file()).map(inside).transpose()?;
    let model = model.map(inside).transpose()?;
    // Commands run here, and their paths are those of requests.
    std::env::set_current_dir(&root).with_context(|| format!("cannot work in {}", root.display()))?;
    // Uploads of a server that was killed.
    remove_all_leftovers(Path::new("."));
    let hub = Hub::new();
    let folder = Folder::new(root);
    let always = match &effects {
        Some(named) => vec!["--effects".to_owned(), named.display().to_string()],
        None => {
            folder.check_effects(Path::new("effects")).map_err(|refusal| anyhow!(refusal.sentence))?;
            Vec::new()
        }
    };
    Ok(App {
        folder,
        effects: OwnEffects::new(effects.unwrap_or_else(|| PathBuf::from("effects"))),
        experiment,
        model,
        jobs: Arc::new(Jobs::new(hub.clone(), always)),
        hub,
        pages: token()?,
        writing: Mutex::default(),
        comparing: Semaphore::new(1),
        experiments: Recent::new(4),
        comparisons: Recent::new(8),
        trials: Recent::new(8),
    })
}

async fn serve(arguments: &Arguments, app: App) -> anyhow::Result<()> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, arguments.port));
    let listener = TcpListener::bind(address)
        .await
        .with_context(|| format!("cannot listen on port {}; leave --port out for one that is free", arguments.port))?;
    let address = listener.local_addr()?;
    let token = token()?;
    let app = Arc::new(app);
    let watcher = events::watch(app.folder.root().to_owned(), app.hub.clone());
    if let Err(error) = &watcher {
        say!("note: the folder cannot be watched ({error}): reload the page to see what other programs write");
    }
    let routes = routes(&token, Arc::clone(&app))
        .fallback(async || Refusal::missing("there is nothing here; open the address that the server printed"))
        .layer(middleware::from_fn_with_state(Arc::new(Guard::new(address)), guard));
    let url = format!("http://{address}/{token}/");
    let mut stdout = std::io::stdout();
    writeln!(stdout, "open: {url}").and_then(|()| stdout.flush())?;
    let shown = if arguments.no_browser { Ok(None) } else { starter::show(&url) };
    if let Err(error) = &shown {
        say!("note: no browser was started ({error}): open the address yourself");
    }
    if let Some(experiment) = app.experiment.clone() {
        // What is looked at first is read while the browser starts; the page is told what is wrong with it.
        let app = Arc::clone(&app);
        tokio::task::spawn_blocking(move || drop(logs::described(&app, &with_slashes(&experiment))));
    }
    // Pages listen as long as they are open, so nobody waits for them.
    let ended = tokio::select! {
        served = axum::serve(listener, routes) => served,
        () = asked_to_end() => Ok(()),
    };
    app.jobs.end().await;
    Ok(ended?)
}

fn routes(token: &str, app: Arc<App>) -> Router {
    let at = |path: &str| format!("/{token}/{path}");
    Router::new()
        .route(&at("api/folder"), get(files::folder))
        .route(&at("api/file"), get(files::file))
        .route(&at("api/write"), post(files::write))
        .route(&at("api/edit"), post(files::edit))
        .route(&at("api/upload"), post(files::upload))
        .route(&format!("/{}/api/page", app.pages), get(files::page))
        .route(&at("api/events"), get(events::events))
        .route(&at("api/jobs"), get(jobs::all).post(jobs::begin))
        .route(&at("api/jobs/{id}"), get(jobs::one))
        .route(&at("api/jobs/{id}/stop"), post(jobs::stop))
        .route(&at("api/experiment"), get(logs::experiment))
        .route(&at("api/rows"), post(logs::rows_between))
        .route(&at("api/lineage"), get(lineage::lineage))
        .route(&at("api/compared"), post(compared::compared))
        .route(&at("api/series"), post(query::series))
        .route(&at("api/scatter"), post(query::scatter))
        .route(&at("api/parameters"), post(trial::parameters))
        .route(&at("api/try"), post(trial::attempt))
        .route(&at("api/tried"), post(trial::tried))
        .route(&at("api/wall"), post(touch::touch))
        .route(&at(""), get(async || asset("")))
        .route(&at("{file}"), get(async |Segment(file): Segment<String>| asset(&file)))
        .layer(DefaultBodyLimit::max(LARGEST_BODY))
        .with_state(app)
}

fn asset(name: &str) -> Result<impl IntoResponse + use<>, Refusal> {
    let (media, bytes) = assets::file(name).ok_or_else(|| Refusal::missing("the page has no such file"))?;
    Ok(([(header::CONTENT_TYPE, media)], bytes))
}

/// Ctrl-C, or the wish of whoever runs it.
async fn asked_to_end() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        // A terminal that is closed hangs up.
        let others = (signal(SignalKind::terminate()), signal(SignalKind::hangup()));
        if let (Ok(mut terminated), Ok(mut hung_up)) = others {
            tokio::select! {
                _ = terminated.recv() => {}
                _ = hung_up.recv() => {}
                _ = tokio::signal::ctrl_c() => {}
            }
            return;
        }
    }
    // Where it cannot be listened for, Ctrl-C ends the program all the same.
    let _ = tokio::signal::ctrl_c().await;
}
