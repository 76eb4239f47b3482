//! What the C99 file costs beside the Rust kernel that is compiled in: forward dynamics of the Freedom 6S with all joints free.
//!
//! Both take turns, round by round, in the same states; each time is the least of all rounds. A result goes, small, into the next
//! state, so that a call waits for the one before. `CC` names a compiler other than `cc`, `CFLAGS` options other than `-O2`.

use std::error::Error;
use std::fs;
use std::hint::black_box;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};
use std::time::Instant;

use dynid_random::Random;
use dynid_user_model::Model;

const DEVICE: &str = "freedom6s";
const ROUNDS: usize = 2000;
const CALLS: usize = 100;

/// Answers each line with the time of so many calls in a row (ns per call).
const MAIN: &str = r#"
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#define GUARD_DECLARATIONS_ONLY
#include "DEVICE.c"
static double seconds(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec + 1e-9 * t.tv_nsec; }
int main(void)
{
    static const double still[N] = {Q}, dq[N] = {DQ}, tau[N] = {TAU};
    double prepared[GUARD_N_PREPARED], q[N], ddq[N];
    DEVICE_prepare_model(prepared);
    for (int k = 0; k < N; k++) q[k] = still[k];
    for (int c = getchar(); c != EOF; c = getchar()) {
        const double start = seconds();
        for (int call = 0; call < CALLS; call++) {
            DEVICE_forward_dynamics(prepared, q, dq, tau, ddq);
            for (int k = 0; k < N; k++) q[k] = still[k] + ddq[k] * 1e-9;
        }
        printf("%.17g %.17g\n", (seconds() - start) * 1e9 / CALLS, ddq[N - 1]);
        fflush(stdout);
    }
    return 0;
}
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let model = Model::of_device(dynid_model::device(DEVICE).ok_or("a device that ships")?);
    let n = model.device.joints.len();
    let all: Vec<usize> = (0..n).collect();
    let mut random = Random::new(1);
    let [still, dq, tau] = [0; 3].map(|_| random.vector(n, -1.0, 1.0));

    let folder = tempfile::tempdir()?;
    let at = |name: &str| folder.path().join(name);
    fs::write(at(&format!("{DEVICE}.c")), dynid_export::as_c99(&model, &all, &[])?.text)?;
    let list = |numbers: &[f64]| numbers.iter().map(|own| format!("{own:?}")).collect::<Vec<_>>().join(", ");
    let main = MAIN
        .replace("{Q}", &format!("{{{}}}", list(&still)))
        .replace("{DQ}", &format!("{{{}}}", list(&dq)))
        .replace("{TAU}", &format!("{{{}}}", list(&tau)))
        .replace("[N]", &format!("[{n}]"))
        .replace("< N", &format!("< {n}"))
        .replace("[N - 1]", &format!("[{}]", n - 1))
        .replace("CALLS", &CALLS.to_string())
        .replace("GUARD", &DEVICE.to_uppercase())
        .replace("DEVICE", DEVICE);
    fs::write(at("main.c"), main)?;
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let flags = std::env::var("CFLAGS").unwrap_or_else(|_| "-O2".to_owned());
    let built = Command::new(&compiler)
        .arg("-std=c99")
        .args(flags.split_whitespace())
        .args(["main.c", &format!("{DEVICE}.c"), "-o", "main", "-lm"])
        .current_dir(folder.path())
        .status()?;
    assert!(built.success(), "`{compiler}` compiles the file");
    let mut program = Command::new(at("main")).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    let (mut ask, answers) = (program.stdin.take().ok_or("stdin")?, program.stdout.take().ok_or("stdout")?);
    let mut answers = BufReader::new(answers).lines();

    let system = model.system(&all, |_| 0.0)?;
    let (kernel, prepared) = (system.kernel(), system.prepared());
    let (mut q, mut ddq) = (still.clone(), vec![0.0; n]);
    let mut least = [f64::INFINITY; 2];
    for round in 0..ROUNDS {
        let start = Instant::now();
        for _ in 0..CALLS {
            kernel.functions.forward_dynamics(prepared, &q, &dq, &tau, &mut ddq);
            q.iter_mut().zip(&still).zip(&ddq).for_each(|((q, still), ddq)| *q = still + ddq * 1e-9);
            black_box(&ddq);
        }
        let rust = start.elapsed().as_secs_f64() * 1e9 / CALLS as f64;
        ask.write_all(b".")?;
        ask.flush()?;
        let answer = answers.next().ok_or("an answer")??;
        let numbers = answer.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        assert!((numbers[1] / ddq[n - 1] - 1.0).abs() < 1e-9, "both compute the same: {answer}, {ddq:?}");
        if round > 0 {
            least = [least[0].min(rust), least[1].min(numbers[0])];
        }
    }
    drop(ask);
    program.wait()?;
    println!("forward dynamics of {DEVICE}, all joints free, per call:");
    println!("  Rust, compiled in        {:>6.1} ns", least[0]);
    println!("  {:<24} {:>6.1} ns  {:.2}", format!("C99, {compiler} {flags}"), least[1], least[1] / least[0]);
    Ok(())
}
