//! Long work is the program itself, run beside the server: the page shows the command line, and the answer is the verb's own.

mod permitted;

use std::collections::VecDeque;
use std::process::Stdio;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use axum::Json;
use axum::extract::{Path as Segment, State};
use axum::http::header;
use axum::response::IntoResponse;
use dynid_format::shell_line;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, BufReader};
use tokio::process::{Child, Command};
use tokio::sync::{Semaphore, mpsc};

use super::super::program;
use super::App;
use super::answer::{Answered, Asked, Refusal};
use super::events::Hub;

/// Commands that run beside each other.
const AT_A_TIME: usize = 4;
/// Commands that are remembered, and the bytes that all of them may take before the oldest are forgotten.
const REMEMBERED: usize = 200;
const REMEMBERED_BYTES: usize = 8 * LONGEST;
/// Lines of progress that are kept of each, and which of them are thinned.
const MOST_LINES: usize = 2000;
const REPEATED: [&str; 3] = ["count", "iteration", "searched"];
/// Bytes of a command's answer that are kept, of its notes and of its error: more than the largest of them have, and little beside
/// what is kept of logs.
const LONGEST: usize = 16 << 20;
/// Options of the program by which it answers programs.
const TO_PROGRAMS: [&str; 3] = ["--json", "--progress", "json"];
/// How long a command may take to keep what it has, once it is told to stop (s).
const GRACE: Duration = Duration::from_secs(10);

/// All commands since the server began.
pub struct Jobs {
    list: Mutex<VecDeque<Job>>,
    slots: Semaphore,
    hub: Hub,
    /// What every command gets besides, such as the user's effects.
    always: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
enum JobState {
    Waiting,
    Running,
    Done,
    Failed,
    Stopped,
}

impl JobState {
    fn is_over(self) -> bool {
        !matches!(self, Self::Waiting | Self::Running)
    }
}

struct Job {
    id: u64,
    args: Vec<String>,
    command: String,
    state: JobState,
    status: Option<i32>,
    began: SystemTime,
    started: Instant,
    took: Option<Duration>,
    progress: Vec<Value>,
    notes: Vec<String>,
    /// Bytes of all its notes.
    noted: usize,
    /// The JSON object that it printed.
    result: Option<String>,
    error: Option<String>,
    /// Each message is a wish that it stop.
    stop: mpsc::UnboundedSender<()>,
}

impl Job {
    fn new(id: u64, args: Vec<String>, command: String, stop: mpsc::UnboundedSender<()>) -> Self {
        Self {
            id,
            args,
            command,
            state: JobState::Waiting,
            status: None,
            began: SystemTime::now(),
            started: Instant::now(),
            took: None,
            progress: Vec::new(),
            notes: Vec::new(),
            noted: 0,
            result: None,
            error: None,
            stop,
        }
    }

    fn summary(&self) -> Value {
        let took = self.took.unwrap_or_else(|| self.started.elapsed());
        json!({
            "id": self.id,
            "args": self.args,
            "command": self.command,
            "state": self.state,
            "status": self.status,
            "began": self.began.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64),
            "seconds": took.as_secs_f64(),
            "last": self.progress.last(),
        })
    }

    /// About what its texts take; progress is thinned to little.
    fn bytes(&self) -> usize {
        self.noted.min(LONGEST) + [&self.result, &self.error].into_iter().flatten().map(String::len).sum::<usize>()
    }

    /// All that is known of it, as JSON. Its answer stands in it as it was printed, to the last digit.
    fn whole(&self) -> String {
        let mut whole = self.summary();
        whole["progress"] = self.progress.clone().into();
        whole["notes"] = self.notes.clone().into();
        whole["error"] = self.error.clone().into();
        let whole = whole.to_string();
        let result = self.result.as_deref().unwrap_or("null");
        format!("{},\"result\":{result}}}", &whole[..whole.len() - 1])
    }

    /// Keeps a line of stderr; answers what it tells of the progress.
    fn hear(&mut self, line: String) -> Option<Value> {
        let told = serde_json::from_str::<Value>(&line).ok().filter(|told| told.get("progress").is_some());
        match (&told, &mut self.error) {
            (Some(told), _) => {
                if self.progress.len() >= MOST_LINES {
                    // What is told once stays.
                    let is_repeated = |line: &Value| REPEATED.iter().any(|kind| line["progress"] == *kind);
                    let mut number = 0;
                    self.progress.retain(|line| {
                        number += usize::from(is_repeated(line));
                        !is_repeated(line) || number % 2 == 0
                    });
                }
                self.progress.push(told.clone());
            }
            // An error is told last, and may go on over lines.
            (None, Some(error)) if error.len() < LONGEST => {
                error.push('\n');
                error.push_str(&line);
            }
            (None, Some(_)) => {}
            (None, None) => match line.strip_prefix("error: ") {
                Some(error) => self.error = Some(error.to_owned()),
                None => {
                    self.noted += line.len();
                    if self.noted <= LONGEST {
                        self.notes.push(line.strip_prefix("note: ").unwrap_or(&line).to_owned());
                    }
                }
            },
        }
        told
    }
}

/// Makes room for one more: of those that are over, the oldest go.
fn forget(list: &mut VecDeque<Job>) {
    let is_full = |list: &VecDeque<Job>| {
        list.len() >= REMEMBERED || list.iter().map(Job::bytes).sum::<usize>() > REMEMBERED_BYTES
    };
    while is_full(list)
        && let Some(over) = list.iter().position(|job| job.state.is_over())
    {
        list.remove(over);
    }
}

impl Jobs {
    pub fn new(hub: Hub, always: Vec<String>) -> Self {
        Self { list: Mutex::default(), slots: Semaphore::new(AT_A_TIME), hub, always }
    }

    fn list(&self) -> MutexGuard<'_, VecDeque<Job>> {
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `change` to a job that is remembered.
    fn with<T>(&self, id: u64, change: impl FnOnce(&mut Job) -> T) -> Option<T> {
        self.list().iter_mut().find(|job| job.id == id).map(change)
    }

    pub fn summaries(&self) -> Vec<Value> {
        self.list().iter().map(Job::summary).collect()
    }

    /// Changes a job and tells of it.
    fn change(&self, id: u64, change: impl FnOnce(&mut Job)) {
        let summary = self.with(id, |job| {
            change(job);
            job.summary()
        });
        summary.iter().for_each(|summary| self.hub.tell("job", summary));
    }

    fn begin(self: &Arc<Self>, args: Vec<String>) -> Value {
        let (stop, stops) = mpsc::unbounded_channel();
        let mut list = self.list();
        forget(&mut list);
        let id = 1 + list.back().map_or(0, |job| job.id);
        let words: Vec<&String> = self.always.iter().chain(&args).collect();
        let job = Job::new(id, args.clone(), shell_line(&words), stop);
        let summary = job.summary();
        list.push_back(job);
        drop(list);
        self.hub.tell("job", &summary);
        tokio::spawn(Arc::clone(self).work(id, args, stops));
        summary
    }

    /// Waits for its turn, runs, and keeps what comes of it.
    async fn work(self: Arc<Self>, id: u64, args: Vec<String>, mut stops: mpsc::UnboundedReceiver<()>) {
        let slot = tokio::select! {
            slot = self.slots.acquire() => slot,
            _ = stops.recv() => return self.change(id, |job| {
                job.state = JobState::Stopped;
                job.took = Some(job.started.elapsed());
            }),
        };
        let ended = match spawn(&self.always, &args) {
            Ok(child) => {
                self.change(id, |job| (job.state, job.started) = (JobState::Running, Instant::now()));
                self.follow(id, child, &mut stops).await
            }
            Err(error) => Err(error),
        };
        drop(slot);
        self.change(id, |job| {
            job.took = Some(job.started.elapsed());
            match ended {
                Ok((status, out, was_stopped)) => {
                    job.status = status;
                    let is_kept = out.is_some();
                    let text = out.and_then(|out| Some(String::from_utf8(out).ok()?.trim().to_owned()));
                    job.result =
                        text.filter(|text| serde_json::from_str::<serde_json::Map<String, Value>>(text).is_ok());
                    if !is_kept {
                        let sentence = "the answer is too long to be shown here; run the command on a terminal";
                        job.error.get_or_insert_with(|| sentence.to_owned());
                    }
                    // Ended by Ctrl-C, a signal, or the verb that was told to end.
                    let stopped =
                        status == Some(i32::from(super::super::interrupt::STATUS)) || (was_stopped && status.is_none());
                    job.state = match status {
                        _ if stopped => JobState::Stopped,
                        Some(0 | 1) if is_kept => JobState::Done,
                        _ => JobState::Failed,
                    };
                }
                Err(error) => {
                    job.error = Some(format!("the program cannot be run: {error}"));
                    job.state = JobState::Failed;
                }
            }
        });
    }

    /// Hears of a command until it ends: its exit status, what it printed unless that is too long, and whether somebody stopped it.
    async fn follow(
        &self,
        id: u64,
        mut child: Child,
        stops: &mut mpsc::UnboundedReceiver<()>,
    ) -> std::io::Result<(Option<i32>, Option<Vec<u8>>, bool)> {
        let (out, err) = (child.stdout.take(), child.stderr.take());
        // Without it the command does as after Ctrl-C; so it does when this server ends, in whichever way.
        let mut stdin = child.stdin.take();
        let read = async {
            match out {
                Some(out) => read_up_to(LONGEST, out).await,
                None => Ok(Some(Vec::new())),
            }
        };
        let listen = async {
            let Some(err) = err else { return Ok(()) };
            let mut lines = BufReader::new(err).lines();
            while let Some(line) = lines.next_line().await? {
                if let Some(mut told) = self.with(id, |job| job.hear(line)).flatten() {
                    told["job"] = id.into();
                    self.hub.tell("progress", &told);
                }
            }
            std::io::Result::Ok(())
        };
        let end = async {
            let mut asked = 0;
            loop {
                tokio::select! {
                    status = child.wait() => return status.map(|status| (status, asked > 0)),
                    Some(()) = stops.recv() => {
                        asked += 1;
                        if asked == 1 { stdin = None } else { child.start_kill()? }
                    }
                }
            }
        };
        let (bytes, (), (status, was_stopped)) = tokio::try_join!(read, listen, end)?;
        Ok((status.code(), bytes, was_stopped))
    }

    /// Stops everything, and waits until all that can be kept is.
    pub async fn end(&self) {
        for _ in 0..2 {
            for job in self.list().iter().filter(|job| !job.state.is_over()) {
                // One that is over by now hears nothing.
                let _ = job.stop.send(());
            }
            let until = Instant::now() + GRACE;
            while self.list().iter().any(|job| !job.state.is_over()) && Instant::now() < until {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        }
    }
}

/// All that is printed, or nothing of what is longer. It is read to its end: who prints waits for that.
async fn read_up_to(most: usize, mut printed: impl AsyncRead + Unpin) -> std::io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    (&mut printed).take(most as u64 + 1).read_to_end(&mut bytes).await?;
    if bytes.len() <= most {
        return Ok(Some(bytes));
    }
    drop(bytes);
    tokio::io::copy(&mut printed, &mut tokio::io::sink()).await?;
    Ok(None)
}

/// Runs the program beside this one.
fn spawn(always: &[String], args: &[String]) -> std::io::Result<Child> {
    let mut command = Command::from(program()?);
    command.args(TO_PROGRAMS).arg("--stop-with-stdin").args(always).args(args);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).kill_on_drop(true);
    // Ctrl-C on the terminal is the server's: it passes it on, once.
    #[cfg(unix)]
    command.process_group(0);
    command.spawn()
}

#[derive(Deserialize)]
pub struct Beginning {
    args: Vec<String>,
}

/// `POST api/jobs`
pub async fn begin(State(app): State<Arc<App>>, Asked(asked): Asked<Beginning>) -> Answered {
    permitted::check(&asked.args, &app.folder)?;
    Ok(Json(app.jobs.begin(asked.args)))
}

/// `GET api/jobs`
pub async fn all(State(app): State<Arc<App>>) -> Json<Value> {
    Json(app.jobs.summaries().into())
}

/// `GET api/jobs/ID`
pub async fn one(State(app): State<Arc<App>>, Segment(id): Segment<String>) -> Result<impl IntoResponse, Refusal> {
    let whole = found(&app, &id, |job| job.whole())?;
    Ok(([(header::CONTENT_TYPE, "application/json")], whole))
}

/// `POST api/jobs/ID/stop`
pub async fn stop(State(app): State<Arc<App>>, Segment(id): Segment<String>, _: Asked<Value>) -> Answered {
    let summary = found(&app, &id, |job| {
        // One that is over hears nothing.
        let _ = job.stop.send(());
        job.summary()
    });
    summary.map(Json)
}

fn found<T>(app: &App, id: &str, of: impl FnOnce(&mut Job) -> T) -> Result<T, Refusal> {
    let found = id.parse().ok().and_then(|id| app.jobs.with(id, of));
    found.ok_or_else(|| Refusal::missing(format!("there is no job {id}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_command_says_is_kept_up_to_a_limit() {
        let (stop, _stops) = mpsc::unbounded_channel();
        let mut job = Job::new(1, Vec::new(), String::new(), stop);
        let line = "x".repeat(LONGEST / 4);
        (0..9).for_each(|_| assert!(job.hear(line.clone()).is_none()));
        assert_eq!(job.notes.len(), 4);
        // What went wrong is said after all notes.
        job.hear("error: no".to_owned());
        (0..9).for_each(|_| assert!(job.hear(line.clone()).is_none()));
        let error = job.error.unwrap();
        assert!(error.starts_with("no\nx") && error.len() < 2 * LONGEST, "{}", error.len());
    }

    #[test]
    fn the_oldest_that_are_over_are_forgotten_where_all_take_too_much() {
        let (stop, _stops) = mpsc::unbounded_channel();
        let mut list: VecDeque<Job> = (1..12).map(|id| Job::new(id, Vec::new(), String::new(), stop.clone())).collect();
        for job in list.iter_mut().skip(1) {
            (job.state, job.result) = (JobState::Done, Some("x".repeat(LONGEST)));
        }
        forget(&mut list);
        let left: Vec<u64> = list.iter().map(|job| job.id).collect();
        assert_eq!(left, [1, 4, 5, 6, 7, 8, 9, 10, 11], "8 of the largest fit, and what runs stays");
    }

    #[tokio::test]
    async fn what_a_command_prints_is_kept_whole_or_not_at_all() {
        for (printed, kept) in
            [(&b"{}"[..], Some(b"{}".to_vec())), (b"12345678", Some(b"12345678".to_vec())), (b"123456789", None)]
        {
            let (mut from, to) = tokio::io::duplex(2);
            let print = async {
                tokio::io::AsyncWriteExt::write_all(&mut from, printed).await.unwrap();
                drop(from);
            };
            let (read, ()) = tokio::join!(read_up_to(8, to), print);
            assert_eq!(read.unwrap(), kept);
        }
    }
}
