//! Which parameters appear in which entry of a device's equations.

/// Which parameters appear in which entry of a device's equations, locked angles being general: the thesis's
/// Figure 4.2, computed. Names stand in the device's order.
#[derive(Debug, Clone, Copy)]
pub struct Structure {
    /// Id of the device.
    pub device: &'static str,
    /// Entries `(i, j)`, i <= j, of the inertia matrix D, in order. What C holds comes from D.
    pub inertia: &'static [((usize, usize), &'static [&'static str])],
    /// Entries of the gravity vector phi, in order.
    pub gravity: &'static [(usize, &'static [&'static str])],
}

impl Structure {
    /// True where the parameter appears in the equations of motion of these free joints, all others being locked.
    pub fn appears(&self, parameter: &str, free: &[usize]) -> bool {
        let within = |joint: &usize| free.contains(joint);
        let inertia = self.inertia.iter().filter(|((i, j), _)| within(i) && within(j)).map(|(_, names)| names);
        let gravity = self.gravity.iter().filter(|(joint, _)| within(joint)).map(|(_, names)| names);
        inertia.chain(gravity).any(|names| names.contains(&parameter))
    }
}
