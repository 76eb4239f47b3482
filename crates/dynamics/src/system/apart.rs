//! What tells two systems of one mechanism apart, where that is joint effects alone: most of what a diagnosis asks about.

use super::{Block, Element, NONE, System};

impl System {
    /// This system and `other`, each without the joint effects that both have alike: [`System::loads`] of the two differ by what those
    /// of the whole systems do. States and parameters keep their places. Only [`System::effects_alone`], [`System::loads`] and
    /// [`System::measure`] mean anything of them.
    ///
    /// `None` where something else differs that a torque hangs on, or where effects read the friction of others.
    pub fn loads_apart(&self, other: &Self) -> Option<[Self; 2]> {
        let is_one_mechanism = std::ptr::eq(self.kernel, other.kernel)
            && (&self.prepared, &self.locked) == (&other.prepared, &other.locked)
            && self.added_inertia == other.added_inertia;
        let late = |system: &Self| system.delays.iter().map(|delay| (delay.joint, delay.span_s)).collect::<Vec<_>>();
        let is_one_drive = late(self) == late(other)
            && self.all_alike(&self.actuators, other, &other.actuators)
            && self.all_alike(&self.transmissions, other, &other.transmissions);
        if !is_one_mechanism || !is_one_drive || self.friction_is_read || other.friction_is_read {
            return None;
        }
        Some([self.without_those_of(other), other.without_those_of(self)])
    }

    fn without_those_of(&self, other: &Self) -> Self {
        let mut apart = self.clone();
        let own = |elements: &[Element], others: &[Element]| -> Vec<Element> {
            let is_shared = |element: &&Element| others.iter().any(|known| self.alike(element, other, known));
            elements.iter().filter(|element| !is_shared(element)).cloned().collect()
        };
        apart.frictions = own(&self.frictions, &other.frictions);
        apart.loads = own(&self.loads, &other.loads);
        apart.drive_is_read = apart.frictions.iter().chain(&apart.loads).any(|element| element.reads_torques);
        apart.friction_blocks = Block::all(&apart.frictions, self.n_free());
        apart.load_blocks = Block::all(&apart.loads, self.n_free());
        apart.fusion = self.fusion.as_ref().map(super::Fusion::anew);
        apart.prepare();
        apart
    }

    fn all_alike(&self, elements: &[Element], other: &Self, others: &[Element]) -> bool {
        elements.len() == others.len()
            && elements.iter().zip(others).all(|(element, known)| self.alike(element, other, known))
    }

    /// Whether two effects are the same law at the same place with the same values.
    fn alike(&self, element: &Element, other: &Self, known: &Element) -> bool {
        let (own, others) = (element.p..element.p + element.np, known.p..known.p + known.np);
        let rest = |system: &Self, of: &Element| (of.qeq != NONE).then(|| system.effect_parameters[of.qeq]);
        std::ptr::eq(element.kernel, known.kernel)
            && (element.joint.joint, element.from.joint) == (known.joint.joint, known.from.joint)
            && self.effect_names[own.clone()] == other.effect_names[others.clone()]
            && self.effect_parameters[own] == other.effect_parameters[others]
            && rest(self, element) == rest(other, known)
    }
}

#[cfg(test)]
mod tests {
    use super::super::PlacedEffect;
    use super::super::fixtures::{ARM, FRICTION_BIAS, GAIN, LUGRE, ROTOR_INERTIA, SPRING, VISCOUS, full_arm, placed};
    use super::*;

    fn arm(effects: &[PlacedEffect]) -> System {
        System::new(&ARM, 2, full_arm().link_parameters().to_vec(), Vec::new(), effects).unwrap()
    }

    fn loads(system: &System, x: &[f64]) -> Vec<f64> {
        let (mut scratch, mut dx) = (system.scratch(), vec![0.0; x.len()]);
        system.effects_alone(&mut scratch, 0.3, x, &[0.4, -0.2], &mut dx);
        scratch.load
    }

    /// What is left of both differs by what the whole systems do.
    #[test]
    fn shared_effects_cancel() {
        let base = [
            placed(&GAIN, 0, None, &[1.4]),
            placed(&VISCOUS, 0, None, &[0.1]),
            placed(&LUGRE, 1, None, &[2.0, 0.2, 0.03, 0.1, 0.2, 0.1]),
        ];
        let with = |more: &[PlacedEffect]| arm(&[&base[..], more].concat());
        let known = with(&[]);
        let others = [
            with(&[placed(&VISCOUS, 1, None, &[0.2])]),
            with(&[placed(&SPRING, 1, None, &[0.9, 2.5])]),
            arm(&[placed(&GAIN, 0, None, &[1.4]), placed(&LUGRE, 0, None, &[2.0, 0.2, 0.03, 0.1, 0.2, 0.1])]),
            arm(&[&base[..1], &[placed(&VISCOUS, 0, None, &[0.3])], &base[2..]].concat()),
        ];
        for other in others {
            let [apart, rest] = other.loads_apart(&known).expect("joint effects alone");
            let state = |system: &System| -> Vec<f64> {
                (0..system.n_states()).map(|k| [0.3, -0.4, 0.7, -1.1, 0.02, 0.03][k]).collect()
            };
            let (x, own) = (state(&other), state(&known));
            let whole = loads(&other, &x).iter().zip(loads(&known, &own)).map(|(a, b)| a - b).collect::<Vec<_>>();
            let left = loads(&apart, &x).iter().zip(loads(&rest, &own)).map(|(a, b)| a - b).collect::<Vec<_>>();
            for (whole, left) in whole.iter().zip(&left) {
                assert!((whole - left).abs() < 1e-14, "{whole} {left}, {other:?}");
            }
        }
        let elsewhere = [
            placed(&ROTOR_INERTIA, 1, None, &[1e-3]),
            placed(&GAIN, 1, None, &[1.1]),
            placed(&FRICTION_BIAS, 0, None, &[1.3]),
        ];
        assert!(elsewhere.iter().all(|more| with(std::slice::from_ref(more)).loads_apart(&known).is_none()));
        assert!(
            known
                .loads_apart(&known)
                .is_some_and(|both| both.iter().all(|left| left.loads.is_empty() && left.frictions.is_empty()))
        );
    }
}
