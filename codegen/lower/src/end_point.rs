//! Where a device's end point is and how it moves, from the frames table alone.
//!
//! A row of the table is four elementary motions along or about the x and z axes. Following them with the joint variables
//! as terms gives the pose; what turns about an axis moves the point by `axis x lever`, what shifts moves it along, which
//! is the Jacobian without a derivative (Spong & Vidyasagar, section 4.6). Angles are sums of joint variables and a
//! constant, of which whole quarter turns are exact; turns about parallel axes add up before a sine is taken.

use std::collections::BTreeMap;

use dynid_model::device::{EndPoint as Point, joint_variable};
use dynid_model::{Convention, Device, Expression, JointKind};

use crate::kernel::{Argument, Function, Results};
use crate::{Input, Node, Program};

/// The kernels of a device's end point.
#[derive(Debug, Clone)]
pub struct EndPoint {
    /// Id of the device.
    pub device: String,
    /// Name of the frame that the point is fixed to.
    pub frame: String,
    /// Number of the device's joints.
    pub n_joints: usize,
    /// Names of the model parameters that the functions take: the device's lengths, in its order.
    pub parameters: Vec<String>,
    /// `pose`, and `motion`, which adds the Jacobian.
    pub functions: [Function; 2],
}

/// A row that no chain can be made of: the reader of device files lets none pass.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("device `{device}`, frame `{frame}`: {what}")]
pub struct NoChain {
    device: String,
    frame: String,
    what: String,
}

impl EndPoint {
    /// Makes the programs; `None` of a device that names no end point.
    ///
    /// # Errors
    /// An angle that is no sum of joint variables, or an unknown symbol.
    pub fn new(device: &Device) -> Result<Option<EndPoint>, NoChain> {
        let Some(point) = &device.end_point else { return Ok(None) };
        let mut chain = Chain::new(device);
        chain.follow(point)?;
        let lengths = device.lengths.iter().map(|length| parameter(&length.symbol)).collect::<Vec<Input>>();
        let n_joints = device.joints.len();
        let arguments = vec![
            Argument { name: "lengths", elements: lengths },
            Argument { name: "q", elements: (0..n_joints).map(Input::Position).collect() },
        ];
        let results = chain.results();
        let function = |name, title, results: &[Results]| {
            let elements: Vec<&str> = results.iter().flat_map(|own| &own.elements).map(String::as_str).collect();
            Function {
                name,
                title,
                form: String::new(),
                arguments: arguments.clone(),
                results: results.to_vec(),
                program: chain.program.select_outputs(&elements),
            }
        };
        let pose = "Position of the end point and rotation from its frame to the base's.";
        let motion = "As `pose`, and the Jacobian: velocity and angular velocity for a unit of each joint's speed.";
        Ok(Some(EndPoint {
            device: device.id.clone(),
            frame: device.frames[point.frame].name.clone(),
            n_joints,
            parameters: device.lengths.iter().map(|length| format!("length.{}", length.symbol)).collect(),
            functions: [function("pose", pose, &results[..2]), function("motion", motion, &results)],
        }))
    }
}

fn parameter(symbol: &str) -> Input {
    Input::Parameter(format!("length.{symbol}"))
}

type Vector = [Node; 3];

/// A sum of joint variables with factors, and a constant.
#[derive(Debug, Clone, Default)]
struct Angle {
    factors: BTreeMap<usize, f64>,
    constant: f64,
}

/// A joint's share in an elementary motion.
struct Share {
    joint: usize,
    /// Unit of the motion for a unit of the joint variable.
    factor: Node,
    axis: Vector,
    /// `None` of a shift; of a turn the number of offsets that come before it.
    turns_before: Option<usize>,
}

/// The chain of elementary motions as far as it has been followed, all vectors in base axes.
struct Chain<'a> {
    device: &'a Device,
    program: Program,
    scope: BTreeMap<String, Node>,
    /// Axes before the turns about z that are still to be taken.
    axes: [Vector; 3],
    about_z: Angle,
    offsets: Vec<Vector>,
    shares: Vec<Share>,
}

impl<'a> Chain<'a> {
    fn new(device: &'a Device) -> Self {
        let mut program = Program::new();
        let mut scope = BTreeMap::new();
        for length in &device.lengths {
            scope.insert(length.symbol.clone(), program.input(parameter(&length.symbol), "m"));
        }
        for (joint, own) in device.joints.iter().enumerate() {
            let unit = if own.kind == JointKind::Revolute { "rad" } else { "m" };
            scope.insert(format!("q{joint}"), program.position(joint, unit));
        }
        let (zero, one) = (program.number(0.0), program.number(1.0));
        let axes = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
        Self { device, program, scope, axes, about_z: Angle::default(), offsets: Vec::new(), shares: Vec::new() }
    }

    fn follow(&mut self, point: &Point) -> Result<(), NoChain> {
        let mut rows = Vec::new();
        let mut next = Some(point.frame);
        while let Some(index) = next {
            rows.push(index);
            next = self.device.frames[index].parent;
        }
        for &index in rows.iter().rev() {
            let frame = &self.device.frames[index];
            let wrong = |what: String| NoChain { device: self.device.id.clone(), frame: frame.name.clone(), what };
            let (theta, alpha) = (angle(&frame.theta).map_err(wrong)?, angle(&frame.alpha).map_err(wrong)?);
            match self.device.convention {
                Convention::Standard => {
                    self.turn_about_z(&theta);
                    self.shift(Axis::Z, &frame.d).map_err(wrong)?;
                    self.shift(Axis::X, &frame.a).map_err(wrong)?;
                    self.turn_about_x(&alpha);
                }
                Convention::Modified => {
                    self.turn_about_x(&alpha);
                    self.shift(Axis::X, &frame.a).map_err(wrong)?;
                    self.turn_about_z(&theta);
                    self.shift(Axis::Z, &frame.d).map_err(wrong)?;
                }
            }
        }
        self.take_turns_about_z();
        for (axis, distance) in self.axes.into_iter().zip(point.point) {
            let distance = self.program.number(distance);
            self.offset(axis, distance);
        }
        Ok(())
    }

    fn turn_about_z(&mut self, angle: &Angle) {
        self.share_turn(self.axes[2], angle);
        self.about_z.constant += angle.constant;
        for (&joint, factor) in &angle.factors {
            *self.about_z.factors.entry(joint).or_default() += factor;
        }
    }

    fn turn_about_x(&mut self, angle: &Angle) {
        if angle.factors.is_empty() && angle.constant == 0.0 {
            return;
        }
        self.take_turns_about_z();
        self.share_turn(self.axes[0], angle);
        let [x, y, z] = self.axes;
        let (y, z) = self.turned(y, z, angle);
        self.axes = [x, y, z];
    }

    fn take_turns_about_z(&mut self) {
        let angle = std::mem::take(&mut self.about_z);
        let [x, y, z] = self.axes;
        let (x, y) = self.turned(x, y, &angle);
        self.axes = [x, y, z];
    }

    /// Two axes after a turn from the first towards the second.
    fn turned(&mut self, first: Vector, second: Vector, angle: &Angle) -> (Vector, Vector) {
        let [cosine, sine] = self.cosine_and_sine(angle);
        let minus_sine = self.program.negate(sine);
        (self.combined([cosine, sine], [first, second]), self.combined([minus_sine, cosine], [first, second]))
    }

    fn combined(&mut self, factors: [Node; 2], vectors: [Vector; 2]) -> Vector {
        [0, 1, 2].map(|row| {
            let terms = [0, 1].map(|k| self.program.multiply(factors[k], vectors[k][row]));
            self.program.add(terms[0], terms[1])
        })
    }

    fn cosine_and_sine(&mut self, angle: &Angle) -> [Node; 2] {
        let mut sum = self.program.number(0.0);
        for (&joint, &factor) in &angle.factors {
            let (factor, position) = (self.program.number(factor), self.program.input(Input::Position(joint), ""));
            let term = self.program.multiply(factor, position);
            sum = self.program.add(sum, term);
        }
        let quarters = angle.constant / std::f64::consts::FRAC_PI_2;
        if (quarters - quarters.round()).abs() >= WHOLE {
            let constant = self.program.number(angle.constant);
            let sum = self.program.add(sum, constant);
            return [self.program.cos(sum), self.program.sin(sum)];
        }
        let (cosine, sine) = (self.program.cos(sum), self.program.sin(sum));
        match (quarters.round() as i64).rem_euclid(4) {
            0 => [cosine, sine],
            1 => [self.program.negate(sine), cosine],
            2 => [self.program.negate(cosine), self.program.negate(sine)],
            _ => [sine, self.program.negate(cosine)],
        }
    }

    fn share_turn(&mut self, axis: Vector, angle: &Angle) {
        for (&joint, &factor) in &angle.factors {
            let factor = self.program.number(factor);
            self.shares.push(Share { joint, factor, axis, turns_before: Some(self.offsets.len()) });
        }
    }

    fn shift(&mut self, axis: Axis, distance: &Expression) -> Result<(), String> {
        let distance_node = self
            .program
            .expression(distance, &self.scope)
            .map_err(|symbol| format!("`{distance}` reads `{symbol}`, which is no length and no joint variable"))?;
        let direction = match axis {
            Axis::Z => self.axes[2],
            Axis::X => {
                if self.program.is_zero(distance_node) {
                    return Ok(());
                }
                let angle = self.about_z.clone();
                let [x, y, _] = self.axes;
                self.turned(x, y, &angle).0
            }
        };
        let mut joints = Vec::new();
        distance.for_each_symbol(&mut |symbol| joints.extend(joint_variable(symbol)));
        joints.sort_unstable();
        joints.dedup();
        for joint in joints {
            let by = self.program.input(Input::Position(joint), "");
            let factor = self.program.derivative(&[distance_node], by)[0];
            self.shares.push(Share { joint, factor, axis: direction, turns_before: None });
        }
        self.offset(direction, distance_node);
        Ok(())
    }

    fn offset(&mut self, direction: Vector, distance: Node) {
        if !self.program.is_zero(distance) {
            self.offsets.push(direction.map(|component| self.program.multiply(distance, component)));
        }
    }

    /// Declares the outputs: position, rotation, Jacobian.
    fn results(&mut self) -> Vec<Results> {
        // What is left of the way to the end point, before each offset.
        let zero = self.program.number(0.0);
        let mut levers = vec![[zero; 3]];
        for offset in self.offsets.clone().into_iter().rev() {
            let rest = levers[levers.len() - 1];
            levers.push([0, 1, 2].map(|k| self.program.add(offset[k], rest[k])));
        }
        levers.reverse();
        let n_joints = self.device.joints.len();
        let mut jacobian = vec![zero; 6 * n_joints];
        for share in std::mem::take(&mut self.shares) {
            let (linear, angular) = match share.turns_before {
                Some(before) => (self.cross(share.axis, levers[before]), share.axis),
                None => (share.axis, [zero; 3]),
            };
            for (row, component) in linear.into_iter().chain(angular).enumerate() {
                let place = row * n_joints + share.joint;
                let term = self.program.multiply(share.factor, component);
                jacobian[place] = self.program.add(jacobian[place], term);
            }
        }
        let axes = self.axes;
        let rotation: Vec<Node> = (0..9).map(|place| axes[place % 3][place / 3]).collect();
        let arrays = [("position", levers[0].to_vec()), ("rotation", rotation), ("jacobian", jacobian)];
        let declared = arrays.map(|(name, nodes)| {
            let elements = nodes.into_iter().enumerate().map(|(place, node)| {
                let element = format!("{name}[{place}]");
                self.program.output(&element, node);
                element
            });
            Results { name, elements: elements.collect() }
        });
        declared.to_vec()
    }

    fn cross(&mut self, a: Vector, b: Vector) -> Vector {
        [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
            let (plus, minus) = (self.program.multiply(a[i], b[j]), self.program.multiply(a[j], b[i]));
            self.program.subtract(plus, minus)
        })
    }
}

#[derive(Clone, Copy)]
enum Axis {
    X,
    Z,
}

/// Angles closer than this to a multiple of a quarter turn, in quarter turns, are that multiple. A numerical choice.
const WHOLE: f64 = 1e-12;

fn angle(expression: &Expression) -> Result<Angle, String> {
    let wanted = "an angle is a sum of joint variables with constant factors and a constant";
    let affine = expression.affine().ok_or_else(|| wanted.to_owned())?;
    let mut factors = BTreeMap::new();
    for (name, factor) in affine.coefficients {
        let joint = joint_variable(&name).ok_or_else(|| wanted.to_owned())?;
        factors.insert(joint, factor);
    }
    Ok(Angle { factors, constant: affine.constant })
}
