//! Effects whose torque jumps where a joint passes its rest position, e.g. friction that differs on its two sides.
//!
//! At such a jump the derivatives S of the motion jump too. A neighbouring motion passes `dt = -(S_q - dqeq) / dq` later
//! and until then has the old acceleration, so `S_dq` changes by `(ddq_after - ddq_before) (S_q - dqeq) / dq` (the
//! saltation of hybrid systems: Aizerman & Gantmacher 1958).

use dynid_generated::{N_SIGNALS, Signal};

use super::{Element, Linear, NONE, Scratch, System, solve};

/// A joint effect that may switch at its joint's rest position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Switch {
    /// The joint's place among the free ones.
    pub slot: usize,
    /// The rest position's index among the effect parameters.
    pub qeq: usize,
    /// Index among the frictions, then the loads.
    element: usize,
}

impl System {
    /// All effects that see where their joint stands and where it rests.
    pub fn switches(&self) -> Vec<Switch> {
        let sees = |element: &Element| {
            element.joint.slot != NONE
                && element.torque != NONE
                && element.qeq != NONE
                && element.uses.contains(Signal::Q)
                && element.uses.contains(Signal::Qeq)
        };
        self.joint_elements()
            .enumerate()
            .filter(|(_, element)| sees(element))
            .map(|(index, element)| Switch { slot: element.joint.slot, qeq: element.qeq, element: index })
            .collect()
    }

    fn joint_elements(&self) -> impl Iterator<Item = &Element> {
        self.frictions.iter().chain(&self.loads)
    }
}

impl Linear {
    /// By how much the accelerations (into `jump`, one per free joint) change at `x` where the joint of `switch` goes on
    /// to larger positions (`rising`) or smaller ones, under the drive and friction in `scratch`. False where they do not.
    #[allow(clippy::too_many_arguments)]
    pub fn jump(
        &mut self,
        system: &System,
        switch: Switch,
        t: f64,
        x: &[f64],
        scratch: &Scratch,
        rising: bool,
        jump: &mut [f64],
    ) -> bool {
        /// How far from the rest position its two sides are looked at, in its units in the last place.
        const SIDE: f64 = 4.0 * f64::EPSILON;
        let Some(element) = system.joint_elements().nth(switch.element) else { return false };
        let qeq = system.effect_parameters[switch.qeq];
        let side = SIDE * qeq.abs().max(1.0);
        let mut signals = system.signals(element, t, x);
        signals[Signal::Load as usize] = scratch.drive[switch.slot];
        signals[Signal::Friction as usize] = scratch.friction[switch.slot];
        let mut rates = vec![0.0; x.len()];
        let mut load = |signals: &mut [f64; N_SIGNALS], q: f64| {
            signals[Signal::Q as usize] = q;
            self.evaluate(system, element, signals, x, &mut rates)[element.torque]
        };
        let (below, above) = (load(&mut signals, qeq - side), load(&mut signals, qeq + side));
        let change = if rising { above - below } else { below - above };
        // What is continuous changes by its slope's share of the two sides only.
        let rounding = 1e-9 * (below.abs() + above.abs());
        if change.abs() <= rounding {
            return false;
        }
        jump.fill(0.0);
        jump[switch.slot] = -change;
        let n = system.n_free();
        let mut inertia = vec![0.0; n * n];
        system.kernel.functions.inertia(&system.prepared, &x[..n], &mut inertia);
        for &(row, column, value) in &system.added_inertia {
            inertia[row * n + column] += value;
        }
        solve::solve(n, &mut inertia, jump);
        true
    }
}
