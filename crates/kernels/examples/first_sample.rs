//! How long a device file takes from its text to the first value of its forward dynamics, and what a kernel of it costs.
//!
//! `cargo run --release -p dynid-kernels --example first_sample -- my_robot.toml`

use std::{path::Path, time::Instant};

fn main() {
    let Some(file) = std::env::args().nth(1) else {
        eprintln!("name a device file");
        return;
    };
    let begun = Instant::now();
    let lap = |what: &str| println!("{:8.1} ms  {what}", 1e3 * begun.elapsed().as_secs_f64());
    let device = match dynid_model::device_named(&file, Path::new("")) {
        Ok(device) => device,
        Err(error) => {
            eprintln!("error: {error}; {}", error.remedy());
            return;
        }
    };
    lap("the file is read");
    let free: Vec<usize> = (0..device.joints.len()).collect();
    let kernel = match dynid_kernels::kernel(device, &free) {
        Ok(kernel) => kernel,
        Err(error) => {
            eprintln!("error: {error}");
            return;
        }
    };
    lap("the equations are formed");
    let parameters: Vec<f64> = kernel.parameters.iter().map(|_| 0.5).collect();
    let mut prepared = vec![0.0; kernel.prepared.len()];
    kernel.functions.prepare(&parameters, &[], &mut prepared);
    lap("the parameters are prepared");
    let n = free.len();
    let (q, mut ddq) = (vec![0.1; n], vec![0.0; n]);
    kernel.functions.forward_dynamics(&prepared, &q, &q, &q, &mut ddq);
    lap("the first acceleration");
    for own in kernel.operations {
        println!("{:6} operations  {}", own.adds + own.muls + own.divs, own.kernel);
    }
}
