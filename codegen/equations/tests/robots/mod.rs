//! Robots from a seed, for the tests of both arithmetics.

use std::{fmt::Write, path::Path};

use dynid_model::Device;

/// Numbers from a seed (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    pub fn one_of<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }
}

/// A random tree of two to four joints: either convention, odd angles, prismatic joints, joints that stand in several
/// frames, links on any frame, a base that may be tilted.
#[allow(dead_code)]
pub fn random_robot(seed: u64) -> Device {
    let mut random = Random(1000 + seed);
    let n_joints = 2 + random.below(3);
    robot(seed, random, n_joints, false)
}

/// As [`random_robot`], of so many joints; `general` ones turn about and slide along any axis.
#[allow(dead_code)]
pub fn random_robot_of(seed: u64, n_joints: usize, general: bool) -> Device {
    robot(seed, Random(2000 + seed), n_joints, general)
}

/// Of a joint variable that stands in another row already: a whole one, a fraction, a number or a gear ratio.
fn multiple(random: &mut Random, joint: usize) -> String {
    random.one_of(&["-q#", "2 * q#", "q# / 3", "-1.7 * q#", "-12 * q#"]).replace('#', &joint.to_string())
}

fn robot(seed: u64, mut random: Random, n_joints: usize, general: bool) -> Device {
    let prismatic: Vec<bool> = (0..n_joints).map(|_| random.below(4) == 0).collect();
    let angles = ["0", "pi/2", "-pi/2", "pi", "0.3", "-1.1"];
    let lengths = ["0", "0", "L1", "-L2", "L1 + L2", "0.37"];
    let mut frames = String::new();
    let n_frames = n_joints + random.below(3);
    let mut used: Vec<bool> = vec![false; n_joints];
    for frame in 0..n_frames {
        let parent = match frame {
            0 => "base".to_owned(),
            _ if random.below(3) == 0 => format!("f{}", random.below(frame)),
            _ => format!("f{}", frame - 1),
        };
        let joint = if frame < n_joints { frame } else { random.below(n_joints) };
        let (mut theta, mut d) = (random.one_of(&angles).to_owned(), random.one_of(&lengths).to_owned());
        let (a, mut alpha) = (random.one_of(&lengths), random.one_of(&angles).to_owned());
        match (prismatic[joint], random.below(4)) {
            (true, _) => d = format!("{d} {} q{joint}", random.one_of(&["+", "-"])),
            (false, 0) if used[joint] => theta = format!("{} + {theta}", multiple(&mut random, joint)),
            (false, 1) if used[joint] => alpha = format!("{alpha} + {}", multiple(&mut random, joint)),
            (false, _) => theta = format!("q{joint} + {theta}"),
        }
        used[joint] = true;
        if general {
            let (roll, pitch, yaw) = (random.one_of(&angles), random.one_of(&angles), random.one_of(&angles));
            let axis =
                random.one_of(&["[0, 0, 1]", "[0, 0, -1]", "[0, 1, 0]", "[-1, 0, 0]", "[1, 2, -0.5]", "[0.6, 0, 0.8]"]);
            let motion = if prismatic[joint] { format!("slide = \"{d}\"") } else { format!("turn = \"{theta}\"") };
            let _ = writeln!(
                frames,
                "  {{ name = \"f{frame}\", parent = \"{parent}\", xyz = [\"{a}\", \"{}\", 0.1], \
                 rpy = [\"{roll}\", \"{pitch}\", \"{yaw}\"], axis = {axis}, {motion} }},",
                random.one_of(&lengths)
            );
            continue;
        }
        let _ = writeln!(
            frames,
            "  {{ name = \"f{frame}\", parent = \"{parent}\", theta = \"{theta}\", d = \"{d}\", a = \"{a}\", alpha = \"{alpha}\" }},"
        );
    }
    let convention = if general { "transform" } else { random.one_of(&["standard", "modified"]) };
    let up = random.one_of(&["[0, 0, 1]", "[0, 1, 0]", "[0.6, 0, 0.8]"]);
    let all: Vec<usize> = (0..n_joints).collect();
    let some: Vec<usize> = all.iter().copied().filter(|_| random.below(2) == 0).collect();
    let mut sets = vec![format!("{all:?}")];
    if n_joints > 1 {
        sets.push("[0]".to_owned());
    }
    if some.len() > 1 && some.len() < n_joints {
        sets.push(format!("{some:?}"));
    }
    device(&format!("random{seed}"), convention, up, &frames, n_joints, &sets.join(", "))
}

/// Joints one on the other: next axes at right angles, or no two axes parallel or at right angles.
#[allow(dead_code)]
pub fn chain(n_joints: usize, at_right_angles: bool) -> Device {
    let mut frames = String::new();
    for joint in 0..n_joints {
        let parent = if joint == 0 { "base".to_owned() } else { format!("f{}", joint - 1) };
        let alpha = if at_right_angles { "pi/2".to_owned() } else { (0.3 + 0.05 * joint as f64).to_string() };
        let _ = writeln!(
            frames,
            "  {{ name = \"f{joint}\", parent = \"{parent}\", theta = \"q{joint}\", d = \"L1\", a = \"L2\", alpha = \"{alpha}\" }},"
        );
    }
    device("chain", "modified", "[0, 0, 1]", &frames, n_joints, "[0]")
}

/// A device with a link in every frame, one a line.
fn device(name: &str, convention: &str, up: &str, frames: &str, n_joints: usize, configurations: &str) -> Device {
    let mut text = format!(
        "title = \"{name}\"\nsource = \"a seed\"\n\
         [units]\nangle = \"rad\"\nlength = \"m\"\nmass = \"kg\"\ninertia = \"kg*m^2\"\ntime = \"s\"\ncommand = \"N*m\"\n\
         [base]\ngravity = 9.81\nup = {up}\n[lengths]\nL1 = 0.4\nL2 = 0.3\n\
         [kinematics]\nconvention = \"{convention}\"\nframes = [\n{frames}]\n"
    );
    for _ in 0..n_joints {
        text += "[[joint]]\ntitle = \"joint\"\nposition = [-inf, inf]\nspeed = inf\ntorque = inf\n";
    }
    text += "[bounds]\nmass = 0.5\ncentroid = 0.3\ninertia = 0.5\n";
    for frame in 0..frames.lines().count() {
        let _ = write!(
            text,
            "[[link]]\ntitle = \"link\"\nframe = \"f{frame}\"\nm = 1.0\nx = 0.1\ny = 0.2\nz = 0.3\n\
             Ixx = 0.02\nIxy = 0.001\nIxz = 0.002\nIyy = 0.02\nIyz = 0.001\nIzz = 0.02\n"
        );
    }
    let _ = write!(
        text,
        "[identification]\nconfigurations = [{configurations}]\n\
         [[identification.method]]\nname = \"coupling\"\nsequence = [1]\n"
    );
    match Device::parse(&text, Path::new(&format!("{name}.toml"))) {
        Ok(device) => device,
        Err(error) => panic!("{error}\n{text}"),
    }
}
