//! The end point's kinematics meet the plant's, which carries positions and velocities through the rows with numbers.

use std::fmt::Write;
use std::path::Path;

use dynid_generated::{EndPoint, end_point};
use dynid_lower::Input;
use dynid_model::Device;
use dynid_plant::Mechanism;
use dynid_plant::random::Noise;

/// Of lengths of about 1 m: what two derivations may differ by.
const TOLERANCE: f64 = 1e-12;

fn assert_close(computed: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(computed.len(), expected.len(), "{what}");
    for (place, (computed, expected)) in computed.iter().zip(expected).enumerate() {
        assert!((computed - expected).abs() <= tolerance, "entry {place} of {what}: {computed:e}, not {expected:e}");
    }
}

/// Pose and Jacobian by the plant: the point's velocity for a unit of each joint's speed.
fn by_plant(device: &Device, lengths: &dyn Fn(&str) -> f64, q: &[f64]) -> [Vec<f64>; 3] {
    let wanted = device.end_point.as_ref().expect("a device with an end point");
    let value = |name: &str| if name.starts_with("length.") { lengths(name) } else { 0.1 };
    let plant = Mechanism::new(device, &value);
    let n = q.len();
    let rest = vec![0.0; n];
    let motion = plant.motions(q, &rest, &rest).swap_remove(wanted.frame);
    let offset = motion.rotation * nalgebra::Vector3::from(wanted.point);
    let position = motion.position + offset;
    let mut jacobian = vec![0.0; 6 * n];
    for joint in 0..n {
        let mut dq = rest.clone();
        dq[joint] = 1.0;
        let moving = plant.motions(q, &dq, &rest).swap_remove(wanted.frame);
        let velocity = moving.velocity + moving.angular_velocity.cross(&offset);
        for row in 0..3 {
            jacobian[row * n + joint] = velocity[row];
            jacobian[(row + 3) * n + joint] = moving.angular_velocity[row];
        }
    }
    [position.as_slice().to_vec(), motion.rotation.transpose().as_slice().to_vec(), jacobian]
}

fn with_end_point() -> impl Iterator<Item = (&'static Device, &'static EndPoint)> {
    dynid_model::devices().iter().filter_map(|device| Some((device, end_point(&device.id)?)))
}

#[test]
fn every_device_that_names_an_end_point_has_one() {
    for device in dynid_model::devices() {
        let found = end_point(&device.id);
        assert_eq!(device.end_point.is_some(), found.is_some(), "{}", device.id);
        if let Some(found) = found {
            assert_eq!(found.n_joints, device.joints.len());
        }
    }
    assert!(with_end_point().count() >= 4 && end_point("no such device").is_none());
}

#[test]
fn kernels_match_the_plant() {
    let mut noise = Noise::new(41);
    for (device, kernel) in with_end_point() {
        for _ in 0..300 {
            let mut random = |size: f64| size * (2.0 * noise.uniform() - 1.0);
            let lengths: Vec<f64> = kernel.parameters.iter().map(|_| random(0.5)).collect();
            let q: Vec<f64> = (0..kernel.n_joints).map(|_| random(3.0)).collect();
            let value = |name: &str| lengths[kernel.parameters.iter().position(|own| *own == name).expect("a length")];
            let [position, rotation, jacobian] = by_plant(device, &value, &q);
            let [mut own_position, mut own_rotation] = [vec![f64::NAN; 3], vec![f64::NAN; 9]];
            kernel.functions.pose(&lengths, &q, &mut own_position, &mut own_rotation);
            assert_close(&own_position, &position, TOLERANCE, &device.id);
            assert_close(&own_rotation, &rotation, TOLERANCE, &device.id);
            let mut own_jacobian = vec![f64::NAN; 6 * q.len()];
            let [mut again, mut turned] = [vec![f64::NAN; 3], vec![f64::NAN; 9]];
            kernel.functions.motion(&lengths, &q, &mut again, &mut turned, &mut own_jacobian);
            assert_eq!((&again, &turned), (&own_position, &own_rotation));
            assert_close(&own_jacobian, &jacobian, TOLERANCE, &device.id);
            // and the velocity is that of the plant's position
            for joint in 0..q.len() {
                let moved = |by: f64| {
                    let mut q = q.clone();
                    q[joint] += by;
                    by_plant(device, &value, &q)[0].clone()
                };
                for (row, (after, before)) in moved(1e-5).iter().zip(moved(-1e-5)).enumerate() {
                    let slope = (after - before) / 2e-5;
                    assert!((own_jacobian[row * q.len() + joint] - slope).abs() < 1e-9, "{}", device.id);
                }
            }
        }
    }
}

/// Appendix A: the SDK measures from where the end point is when all joints are at 0.
#[test]
fn at_zero_the_handle_is_at_the_origin_of_appendix_a() {
    let device = dynid_model::device("freedom6s").expect("a shipped device");
    let kernel = end_point("freedom6s").expect("its end point");
    let lengths: Vec<f64> = device.lengths.iter().map(|length| length.value).collect();
    let sdk = |q: &[f64; 6]| {
        let (mut position, mut rotation) = ([f64::NAN; 3], [f64::NAN; 9]);
        kernel.functions.pose(&lengths, q, &mut position, &mut rotation);
        [-(position[1] + 0.23), position[0] + 0.2, position[2]]
    };
    assert_close(&sdk(&[0.0; 6]), &[0.0; 3], 1e-15, "Eqs. A.1 to A.3");
    // yaw alone: a turn of the point (-0.2, -0.23) about the base axis
    let (s, c) = 0.3_f64.sin_cos();
    let turned = [0.23 * s - 0.2 * c, -0.2 * s - 0.23 * c];
    let expected = [-(turned[1] + 0.23), turned[0] + 0.2, 0.0];
    assert_close(&sdk(&[0.3, 0.0, 0.0, 0.0, 0.0, 0.0]), &expected, 1e-15, "Eqs. A.1 to A.3");
    // L7 = 0: the wrist turns the handle where it is
    assert_close(&sdk(&[0.0, 0.0, 0.0, 0.4, -0.9, 0.7]), &[0.0; 3], 1e-15, "Eqs. A.1 to A.3");
}

/// A device file of a random chain with a side branch: any convention, turns and slides in any column, quarter turns and
/// crooked ones, parallel axes, joints that stand in two rows.
fn random_device(noise: &mut Noise) -> Device {
    let mut below = |most: usize| (noise.uniform() * most as f64) as usize;
    let n_rows = 1 + below(6);
    let mut kinds: Vec<bool> = Vec::new();
    let mut rows = String::new();
    for row in 0..n_rows {
        let parent = if row == 0 { "base".to_owned() } else { format!("f{}", row - 1) };
        let crooked = ["0", "pi/2", "-pi/2", "pi", "0.3", "-1.1"];
        let mut cells = [0, 1, 2, 3].map(|column: usize| match column {
            0 | 3 => crooked[below(6)].to_owned(),
            _ => ["0", "La", "-Lb", "La + Lb", "0.1"][below(5)].to_owned(),
        });
        for (column, cell) in cells.iter_mut().enumerate() {
            let turns = column == 0 || column == 3;
            let known = kinds.iter().position(|kind| *kind == turns);
            match below(6) {
                0 | 1 if kinds.len() < 6 => {
                    let sign = ["", "-", "2*"][below(3)];
                    let _ = write!(cell, " + {sign}q{}", kinds.len());
                    *cell = cell.replace("+ -", "- ");
                    kinds.push(turns);
                }
                2 => {
                    if let Some(joint) = known {
                        let _ = write!(cell, " - q{joint}");
                    }
                }
                _ => {}
            }
        }
        if row + 1 == n_rows && kinds.is_empty() {
            cells[0] = "q0".to_owned();
            kinds.push(true);
        }
        let [theta, d, a, alpha] = cells;
        let _ = writeln!(
            rows,
            "{{ name = \"f{row}\", parent = \"{parent}\", theta = \"{theta}\", d = \"{d}\", a = \"{a}\", alpha = \"{alpha}\" }},"
        );
    }
    let convention = ["standard", "modified"][below(2)];
    let last = n_rows - 1;
    let mut text = format!(
        "title = \"t\"\nsource = \"s\"\n[units]\nangle = \"rad\"\nlength = \"m\"\nmass = \"kg\"\ninertia = \"kg*m^2\"\n\
         time = \"s\"\ncommand = \"N*m\"\n[base]\ngravity = 0\n[lengths]\nLa = 0.3\nLb = 0.2\n[kinematics]\n\
         convention = \"{convention}\"\nframes = [\n{rows}]\n[end_point]\nframe = \"f{last}\"\npoint = [0.1, 0, -0.2]\n\
         [bounds]\nmass = 0.5\ncentroid = 0.5\ninertia = 0.5\n"
    );
    for (joint, turns) in kinds.iter().enumerate() {
        let kind = if *turns { "revolute" } else { "prismatic" };
        let _ = writeln!(
            text,
            "[[joint]]\ntitle = \"{joint}\"\nkind = \"{kind}\"\nposition = [-1, 1]\nspeed = inf\ntorque = inf"
        );
    }
    for row in 0..n_rows {
        let _ = write!(text, "[[link]]\ntitle = \"l\"\nframe = \"f{row}\"\nm = 1\nx = 0\ny = 0\nz = 0\n");
        text.push_str("Ixx = 1\nIxy = 0\nIxz = 0\nIyy = 1\nIyz = 0\nIzz = 1\n");
    }
    text.push_str("[identification]\nconfigurations = [[0]]\n");
    Device::parse(&text, Path::new("random_robot.toml")).unwrap_or_else(|error| panic!("{error:?}\n{text}"))
}

#[test]
fn random_robots_move_as_the_plant_says() {
    let mut noise = Noise::new(77);
    for number in 0..400 {
        let device = random_device(&mut noise);
        let own = dynid_lower::end_point::EndPoint::new(&device).expect("a chain").expect("an end point");
        let q: Vec<f64> = device.joints.iter().map(|_| 4.0 * noise.uniform() - 2.0).collect();
        let length = |name: &str| {
            let symbol = name.strip_prefix("length.").expect("a length");
            device.lengths.iter().find(|length| length.symbol == symbol).expect("a known length").value
        };
        let [position, rotation, jacobian] = by_plant(&device, &length, &q);
        let values = own.functions[1].program.evaluate(|input| match input {
            Input::Position(joint) => q[*joint],
            Input::Parameter(name) => length(name),
            other => panic!("{other:?} is no input of a chain"),
        });
        let expected = [position, rotation, jacobian].concat();
        assert_close(&values, &expected, 1e-11, &format!("robot {number}: {:?}", device.frames));
    }
}
