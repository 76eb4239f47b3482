//! The cases.

use super::Kind::{Hidden, Nothing, Outside};
use super::{Case, Plan, make};

const ARM: &str = "freedom6s";
const PLANAR: &str = "planar2r";
const DOUBLE: &str = "double_pendulum";
const SERVO: &str = "servo_pendulum";
const MASS: &str = "oscillator";

/// All cases, in an order that stays.
#[must_use]
pub fn cases() -> Vec<Case> {
    varied(0)
}

/// The same questions asked of other machines: what was mended by looking at one variation is judged by others.
#[must_use]
pub fn varied(variation: u32) -> Vec<Case> {
    (1..).zip(plans()).map(|(number, plan)| make(number, &plan, variation)).collect()
}

fn hidden(device: &'static str, free: &[usize], friction: &'static str, effect: &'static str) -> Plan {
    Plan::new(Hidden, device, free, friction, Some(effect))
}

fn outside(device: &'static str, free: &[usize], friction: &'static str, effect: &'static str) -> Plan {
    Plan::new(Outside, device, free, friction, Some(effect))
}

fn nothing(device: &'static str, free: &[usize], friction: &'static str) -> Plan {
    Plan::new(Nothing, device, free, friction, None).off(0.05)
}

fn plans() -> Vec<Plan> {
    let all = &[0, 1, 2, 3, 4, 5];
    vec![
        // friction at one joint
        hidden(ARM, &[3], "viscous", "coulomb@3 Fc=0.012"),
        hidden(ARM, &[5], "viscous", "coulomb@5 Fc=0.004"),
        hidden(PLANAR, &[0, 1], "viscous", "coulomb@1 Fc=0.1"),
        hidden(ARM, &[3], "coulomb", "viscous@3 Fv=0.05").no("viscous@3"),
        hidden(ARM, &[4, 5], "coulomb", "viscous@4 Fv=0.006").no("viscous@4"),
        hidden(ARM, &[4], "viscous", "lugre@4 sigma0=1.2 sigma1=0.008 sigma2=0.006 vs=0.2 Fs=0.009 Fc=0.005"),
        hidden(ARM, &[4, 5], "viscous", "lugre@5 sigma0=0.6 sigma1=0.004 sigma2=0.008 vs=0.1 Fs=0.012 Fc=0.006"),
        hidden(ARM, &[3], "viscous", "lugre@3 sigma0=6.5 sigma1=0.067 sigma2=0.06 vs=0.4 Fs=0.04 Fc=0.012"),
        hidden(ARM, &[5], "coulomb", "stribeck@5 Fs=0.009 Fc=0.003 vs=0.15"),
        hidden(SERVO, &[0], "viscous", "stribeck@0 Fs=0.06 Fc=0.02 vs=0.6"),
        hidden(ARM, &[3], "viscous", "turner@3 s1=0.5 v1=0.06 Fk=0.012 v4=0.4 s2=0.06"),
        hidden(PLANAR, &[0, 1], "viscous", "turner@0 s1=5 v1=0.08 Fk=0.15 v4=0.5 s2=0.6"),
        hidden(ARM, &[5], "viscous", "dahl@5 sigma0=0.15 Fc=0.005"),
        hidden(ARM, &[0, 1], "viscous", "dahl@1 sigma0=0.1 Fc=0.008"),
        hidden(ARM, &[3], "viscous", "viscous_asymmetric@3 Fv_p=0.08 Fv_n=0.05"),
        hidden(DOUBLE, &[0, 1], "viscous", "viscous_asymmetric@1 Fv_p=0.05 Fv_n=0.09"),
        hidden(ARM, &[5], "coulomb", "coulomb_asymmetric@5 Fc_p=0.006 Fc_n=0.003").fixed("spring.qeq@5"),
        hidden(PLANAR, &[0], "coulomb", "coulomb_asymmetric@0 Fc_p=0.35 Fc_n=0.15"),
        hidden(ARM, &[0], "lugre", "friction_bias@0 bias=1.7"),
        hidden(ARM, &[3, 4, 5], "coulomb", "friction_bias@3 bias=1.8"),
        hidden(SERVO, &[0], "coulomb", "friction_load@0 mu=0.15"),
        hidden(PLANAR, &[0, 1], "coulomb", "friction_load@0 mu=0.12"),
        hidden(ARM, &[4, 5], "viscous", "friction_coupled@5<4 Fv=0.002 Fc=0.002"),
        hidden(PLANAR, &[0, 1], "coulomb", "friction_coupled@1<0 Fv=0.05 Fc=0.15"),
        hidden(ARM, &[5], "coulomb", "friction_drift@5 Fd=0.0025 tau=8"),
        hidden(SERVO, &[0], "coulomb", "friction_drift@0 Fd=0.015 tau=6"),
        hidden(ARM, &[4], "viscous", "quadratic_drag@4 Cd=0.002"),
        hidden(PLANAR, &[0, 1], "coulomb", "quadratic_drag@0 Cd=0.2"),
        // springs and what repeats over position
        hidden(ARM, &[5], "coulomb", "spring@5 Ks=0.035 qeq=-0.41").no("spring@5"),
        hidden(ARM, &[4, 5], "viscous", "spring@4 Ks=0.025 qeq=-0.25").no("spring@4"),
        hidden(ARM, &[3], "coulomb", "spring_cubic@3 K3=0.12 q_mid=0.35"),
        hidden(MASS, &[0], "viscous", "spring_cubic@0 K3=60 q_mid=0"),
        hidden(ARM, &[0, 1], "viscous", "spring_cubic@0 K3=0.5 q_mid=0"),
        hidden(ARM, &[3], "viscous", "spring_polynomial@3 K2=0.02 K3=-0.12 K5=0.25 q_mid=0.35"),
        hidden(MASS, &[0], "viscous", "spring_polynomial@0 K2=2 K3=-40 K5=9000 q_mid=0"),
        hidden(ARM, &[3], "viscous", "hysteresis@3 Kh=0.025 travel=0.03"),
        hidden(PLANAR, &[0, 1], "viscous", "hysteresis@1 Kh=0.25 travel=0.05"),
        hidden(ARM, &[3], "coulomb", "cogging@3 A=0.004 B=0.006 period=0.21"),
        hidden(ARM, all, "lugre", "cogging@5 A=0.003 B=0.002 period=0.15"),
        hidden(SERVO, &[0], "coulomb", "cogging@0 A=0.02 B=-0.03 period=0.26"),
        // the drive
        hidden(PLANAR, &[0, 1], "coulomb", "gain@1 Kp=1.2").links_within(0.02),
        hidden(DOUBLE, &[0], "coulomb", "gain@0 Kp=0.85").links_within(0.02),
        hidden(PLANAR, &[0, 1], "coulomb", "torque_offset@0 offset=0.3"),
        hidden(SERVO, &[0], "coulomb", "torque_offset@0 offset=0.4"),
        hidden(ARM, &[0], "coulomb", "torque_offset@0 offset=0.003")
            .fixed("spring.qeq@0")
            // about a vertical axis only the spring feels where zero is
            .or("sensor_offset@0 shift=0"),
        hidden(ARM, &[3], "viscous", "dead_zone@3 width=0.0012"),
        hidden(ARM, &[4, 5], "lugre", "dead_zone@5 width=0.0009"),
        hidden(PLANAR, &[0, 1], "coulomb", "dead_zone@1 width=0.08"),
        hidden(ARM, &[5], "viscous", "saturation@5 limit=0.0065"),
        hidden(SERVO, &[0], "coulomb", "saturation@0 limit=3.5"),
        hidden(ARM, &[0, 1], "lugre", "saturation@1 limit=0.017"),
        hidden(ARM, &[3], "coulomb", "input_lag@3 T=0.03"),
        hidden(SERVO, &[0], "coulomb", "input_lag@0 T=0.04"),
        hidden(ARM, &[4, 5], "viscous", "input_delay@4 delay=0.023"),
        hidden(PLANAR, &[0, 1], "coulomb", "input_delay@0 delay=0.034"),
        hidden(ARM, &[4, 5], "lugre", "input_coupling@4<5 gain=0.2"),
        hidden(ARM, &[3, 4, 5], "coulomb", "input_coupling@5<3 gain=-0.12"),
        hidden(ARM, all, "lugre", "input_coupling@4<5 gain=0.25"),
        hidden(DOUBLE, &[0, 1], "coulomb", "input_coupling@1<0 gain=-0.1"),
        // the transmission
        hidden(SERVO, &[0], "coulomb", "joint_elasticity@0 compliance=0.3 damping=0.01 Jm=0.002"),
        hidden(PLANAR, &[0, 1], "viscous", "joint_elasticity@1 compliance=0.06 damping=0.05 Jm=0.02"),
        hidden(SERVO, &[0], "viscous", "backlash@0 gap=0.04 Jm=0.0005"),
        hidden(ARM, &[3], "viscous", "backlash@3 gap=0.03 Jm=0.0002"),
        // links
        hidden(PLANAR, &[0, 1], "coulomb", "payload@1 m=0.15 x=0.03 y=0.02 z=0").links_within(0.03),
        hidden(ARM, &[3, 4, 5], "viscous", "payload@5 m=0.02 x=0.02 y=0.01 z=0.03").links_within(0.03),
        hidden(SERVO, &[0], "coulomb", "rotor_inertia@0 Ia=0.002").no("rotor_inertia@0"),
        hidden(ARM, &[4, 5], "coulomb", "rotor_inertia@5 Ia=0.0002").links_within(0.05),
        hidden(DOUBLE, &[0, 1], "coulomb", "rotor_inertia@1 Ia=0.006").no("rotor_inertia@1").links_within(0.05),
        hidden(PLANAR, &[0, 1], "coulomb", "rotor_coupling@1<0 Ia=0.01").links_within(0.03),
        // sensors
        hidden(SERVO, &[0], "coulomb", "sensor_offset@0 shift=0.06").drive(1.15),
        hidden(PLANAR, &[0, 1], "coulomb", "sensor_offset@1 shift=0.05").drive(1.3).links_within(0.03),
        hidden(SERVO, &[0], "coulomb", "sensor_scale@0 scale=0.06").drive(1.15),
        hidden(PLANAR, &[0, 1], "coulomb", "sensor_scale@0 scale=0.03").drive(1.3),
        // nothing
        nothing(ARM, &[0], "lugre"),
        nothing(ARM, &[1], "lugre"),
        nothing(ARM, &[2], "lugre"),
        nothing(ARM, &[3], "lugre"),
        nothing(ARM, &[4], "lugre"),
        nothing(ARM, &[5], "lugre"),
        nothing(ARM, &[3], "coulomb"),
        nothing(ARM, &[4], "viscous"),
        nothing(ARM, &[5], "coulomb"),
        nothing(ARM, &[0, 1], "lugre"),
        nothing(ARM, &[0, 1], "coulomb"),
        nothing(ARM, &[4, 5], "lugre"),
        nothing(ARM, &[4, 5], "coulomb"),
        nothing(ARM, &[3, 4, 5], "lugre"),
        nothing(ARM, &[2, 3, 4, 5], "viscous"),
        nothing(ARM, all, "lugre"),
        nothing(PLANAR, &[0, 1], "coulomb"),
        nothing(PLANAR, &[1], "viscous"),
        nothing(SERVO, &[0], "coulomb"),
        nothing(DOUBLE, &[0, 1], "coulomb"),
        nothing(MASS, &[0], "viscous"),
        // what no library has
        outside(ARM, &[5], "viscous", "viscous_position@5 F=0.008 k=3")
            .term("sin(q5)*dq5")
            .term("cos(q5)*dq5")
            .term("q5*dq5"),
        outside(PLANAR, &[0, 1], "coulomb", "speed_product@0<1 G=0.06").term("dq0*dq1"),
        outside(PLANAR, &[0, 1], "coulomb", "speed_square_from@1<0 G=0.08").term("dq0*dq0"),
        outside(ARM, &[3, 4, 5], "viscous", "gyroscopic@3<4 other=5 G=0.004").term("dq4*dq5"),
        outside(ARM, &[3], "coulomb", "gain_ripple@3 a=0.2 k=3")
            .term("tau3*sin(q3)")
            .term("tau3*cos(q3)")
            .term("tau3*q3"),
        outside(ARM, &[4], "viscous", "command_root@4 c0=0.004"),
        outside(SERVO, &[0], "coulomb", "command_cubic@0 k3=0.012").drive(0.75).term("tau0*tau0*tau0"),
        outside(ARM, &[0, 1], "viscous", "friction_position_from@0<1 F=0.02 q0=0.1 v_eps=0.01").term("q1*sign(dq0)"),
        outside(ARM, &[4, 5], "viscous", "spring_between@4<5 K=0.008 ratio=1").term("q5"),
        outside(SERVO, &[0], "coulomb", "resonance@0 J=0.002 K=1.2 d=0.004"),
        outside(ARM, &[5], "viscous", "torque_wave@5 A=0.002 hz=1.7"),
        outside(ARM, &[3], "coulomb", "command_position@3 C=4").term("tau3*q3"),
        outside(ARM, &[3], "viscous", "wandering_detent@3 A=0.008 period=0.2 growth=0.6"),
        outside(ARM, &[5], "viscous", "stiffness_growth@5 K=0.0006 q0=-0.4").term("q5*t"),
        outside(ARM, &[4, 5], "coulomb", "viscous_from@5<4 F=0.003").term("dq4"),
        outside(ARM, &[0, 1], "viscous", "position_product@1<0 K=0.08").term("q0*q1"),
        outside(SERVO, &[0], "coulomb", "gain_droop@0 a=0.15 tau=12").term("tau0*t"),
    ]
}
