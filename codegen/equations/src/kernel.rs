//! One configuration's equations: each form of them, and the cheapest kept.

use dynid_lower::kir::NO_CONFIGURATION;
use dynid_lower::{Form, Kir, OperationCounts, Program};
use dynid_model::Device;

use crate::{
    DeriveError,
    algebra::{Algebra, Symbol, joint_unit},
    arithmetic::Arithmetic,
    collected::Subset,
    composite,
    emit::Context,
    lagrangian::Lagrangian,
    lumps::Lumps,
    recursion::{Mechanism, Motion},
    tree::Tree,
};

/// A group of outputs that a form gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Inertia matrix: `D_<i>_<j>`, i <= j.
    Inertia,
    /// Bias `C dq + phi`: `h_<i>`.
    Bias,
    /// Inverse dynamics `D ddq + h`: `tau_<i>`.
    Torque,
}

impl Group {
    /// All groups, in the order in which they are written.
    pub const ALL: [Group; 3] = [Group::Inertia, Group::Bias, Group::Torque];

    /// As it stands in headers.
    pub fn symbol(self) -> &'static str {
        match self {
            Group::Inertia => "D",
            Group::Bias => "h",
            Group::Torque => "tau",
        }
    }

    /// Names of its outputs.
    pub fn outputs(self, free: &[usize]) -> Vec<String> {
        match self {
            Group::Inertia => pairs(free).into_iter().map(|(i, j)| format!("D_{i}_{j}")).collect(),
            Group::Bias => free.iter().map(|i| format!("h_{i}")).collect(),
            Group::Torque => free.iter().map(|i| format!("tau_{i}")).collect(),
        }
    }
}

/// Joint pairs (i, j), i <= j.
pub fn pairs(free: &[usize]) -> Vec<(usize, usize)> {
    let with = |&i: &usize| free.iter().filter(move |&&j| j >= i).map(move |&j| (i, j));
    free.iter().flat_map(with).collect()
}

/// A form's equations for one group.
struct Candidate {
    form: String,
    program: Program,
    counts: OperationCounts,
}

impl Candidate {
    /// Fewest operations first. Between equals the one that names fewer inputs: the recursion's second moments name
    /// inertias that cancel in their sums.
    fn cost(&self) -> (usize, usize) {
        (self.counts.arithmetic(), self.program.live_inputs().len())
    }

    /// Whether no number of it was too large for the arithmetic.
    fn is_exact(&self) -> bool {
        self.program.live().into_iter().all(|node| !self.program.number_of(node).is_some_and(f64::is_nan))
    }
}

/// The equations of a set of free joints, ascending, each group in its cheapest form: the recursion or, given the Lagrangian,
/// what Lagrange's equations come to.
///
/// # Errors
/// A frames table that no mechanism can be made of, or whose equations have numbers that are too large.
pub fn derive<A: Arithmetic>(
    algebra: &Algebra<A>,
    lagrangian: Option<&Lagrangian<A>>,
    device: &Device,
    free: &[usize],
) -> Result<Kir, DeriveError> {
    let free = free.to_vec();
    let locked = (0..device.joints.len()).filter(|joint| !free.contains(joint)).collect();
    let context = Context { algebra, device, free: &free };
    let tree = Tree::new(algebra, device, &free)?;
    let mut program = declared(&context);
    let mut forms = Vec::new();
    for group in Group::ALL {
        let mut candidates = vec![candidate("recursion", recursion(&context, &tree, group))];
        // A sum of many more products than the recursion has operations is not worth forming.
        let limit = candidates[0].counts.arithmetic().max(ALWAYS_FORMED);
        if let Some(subset) = lagrangian.and_then(|lagrangian| Subset::new(&context, lagrangian, limit)) {
            let n_angles = algebra.pairs().iter().filter(|(cosine, _)| algebra.moves(*cosine, &free)).count();
            let variants = (0..1usize << n_angles.min(MAX_CHOICES))
                .map(|kept_sines| candidate("lagrangian", subset.program(&context, group, kept_sines)));
            candidates.extend(variants.min_by_key(Candidate::cost));
        }
        let costs: Vec<String> =
            candidates.iter().map(|known| format!("{} {}", known.form, known.counts.arithmetic())).collect();
        let best = candidates.into_iter().filter(Candidate::is_exact).min_by_key(Candidate::cost);
        let best = best.ok_or_else(|| DeriveError::TooLarge { device: device.id.clone(), free: free.clone() })?;
        program.append(&best.program);
        forms.push(Form {
            outputs: group.symbol().to_owned(),
            form: best.form,
            reason: format!("operations: {}", costs.join(", ")),
        });
    }
    Ok(Kir {
        device: device.id.clone(),
        configuration: device.configuration_of(&free).unwrap_or(NO_CONFIGURATION),
        free,
        locked,
        model_sha256: device.structure_digest(),
        forms,
        program,
    })
}

/// A program that declares every input in the device's order; those that are not used are not written.
fn declared<A: Arithmetic>(context: &Context<A>) -> Program {
    let mut program = Program::new();
    for symbol in context.algebra.symbols() {
        if let Symbol::Parameter(name, unit) = symbol {
            program.parameter(name, unit);
        }
    }
    let device = context.device;
    let (free, locked): (Vec<usize>, Vec<usize>) =
        (0..device.joints.len()).partition(|joint| context.free.contains(joint));
    for joint in locked {
        program.locked(joint, joint_unit(device, joint));
    }
    for &joint in &free {
        program.position(joint, joint_unit(device, joint));
    }
    for &joint in &free {
        program.velocity(joint, &format!("{}/s", joint_unit(device, joint)));
    }
    for &joint in &free {
        program.acceleration(joint, &format!("{}/s^2", joint_unit(device, joint)));
    }
    program
}

/// A subset of so few products is formed however cheap the recursion is; a numerical choice.
const ALWAYS_FORMED: usize = 16;

/// Choices of which square to eliminate are tried for so many angles; a numerical choice.
const MAX_CHOICES: usize = 3;

fn candidate(form: &str, program: Program) -> Candidate {
    let program = program.compact();
    let counts = program.split().eval.operations();
    Candidate { form: form.to_owned(), program, counts }
}

/// A group by the recursion.
pub fn recursion<A: Arithmetic>(context: &Context<A>, tree: &Tree<A>, group: Group) -> Program {
    let mut program = Program::new();
    let lumps = Lumps::new(context, tree, &mut program);
    let mechanism = Mechanism { context: *context, tree, lumps: &lumps };
    match group {
        Group::Bias | Group::Torque => {
            let motion = motion(context, &mut program, group);
            let torques = mechanism.torques(&mut program, &motion);
            for (&joint, name) in context.free.iter().zip(group.outputs(context.free)) {
                program.output(&name, torques[joint]);
            }
        }
        Group::Inertia => {
            let inertia = composite::inertia(&mechanism, &mut program);
            let zero = program.number(0.0);
            for (pair, name) in pairs(context.free).iter().zip(group.outputs(context.free)) {
                program.output(&name, inertia.get(pair).copied().unwrap_or(zero));
            }
        }
    }
    program
}

/// Any motion under gravity; for the bias without acceleration.
fn motion<A: Arithmetic>(context: &Context<A>, program: &mut Program, group: Group) -> Motion {
    let zero = program.number(0.0);
    let n_joints = context.device.joints.len();
    let (mut dq, mut ddq) = (vec![zero; n_joints], vec![zero; n_joints]);
    for &joint in context.free {
        let unit = joint_unit(context.device, joint);
        dq[joint] = program.velocity(joint, &format!("{unit}/s"));
        if group == Group::Torque {
            ddq[joint] = program.acceleration(joint, &format!("{unit}/s^2"));
        }
    }
    let gravity = ["base.gx", "base.gy", "base.gz"].map(|name| context.emit(program, &context.algebra.parameter(name)));
    let prefix = if group == Group::Torque { "tau_" } else { "" };
    Motion { dq, ddq, gravity, prefix: prefix.to_owned() }
}
