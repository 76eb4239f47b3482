//! A tick of the controller asks nothing of the allocator, whatever the sensors show.

// The trait of an allocator is unsafe; this one only counts and hands on.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System as Allocator};
use std::cell::Cell;

use dynid_control::{Compensation, CompensationRatios, Estimator, Law, PlaneWall, Wall};
use dynid_dynamics::system::System;
use dynid_haptics::{wall, wall::Setting, wall::space};
use dynid_user_model::{EffectInstance, Model};

/// Counts what each thread asks for.
struct Counting;

thread_local! {
    static ASKED: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // A thread that ends has no counter any more.
    let _ = ASKED.try_with(|asked| asked.set(asked.get() + 1));
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { Allocator.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        unsafe { Allocator.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { Allocator.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

fn asked() -> u64 {
    ASKED.with(Cell::get)
}

/// The device with all joints free, its default effects and some more kinds.
fn model() -> Model {
    let device = dynid_model::device("freedom6s").expect("a shipped device");
    let mut model = Model::of_device(device);
    for (id, joint, from) in [
        ("coulomb", 0, None),
        ("friction_bias", 1, None),
        ("hysteresis", 2, None),
        ("friction_load", 3, None),
        ("input_coupling", 4, Some(5)),
        ("input_coupling", 5, Some(4)),
        ("torque_offset", 0, None),
        ("input_lag", 1, None),
        ("sensor_offset", 2, None),
        ("rotor_inertia", 3, None),
    ] {
        model.effects.push(EffectInstance::new(device, id, Some(joint), from).expect("an effect of the library"));
    }
    model
}

/// Every wall that the program carries: at joint 0, and along the normal of a plane about where the arm is moved.
fn walls(model: &Model, system: &System) -> Vec<(Wall, PlaneWall)> {
    let (mut setting, mut place) = (Setting::shipped().expect("shipped"), space::Setting::shipped().expect("shipped"));
    (setting.sample_s, place.sampling.sample_s) = (SAMPLE_S, SAMPLE_S);
    let made = wall::library().map(|(name, _)| {
        let file = wall::shipped(name).expect("shipped");
        let kinematics = model.kinematics(&place.free, &place.posture).expect("an end point");
        let felt = (place.wall(&file).expect("a wall"), place.lever);
        let plane = PlaneWall::new(system, kinematics, place.plane, felt, &place.torque_limits).expect("a plane");
        (file.wall(&setting).expect("a wall"), plane)
    });
    made.collect()
}

const SAMPLE_S: f64 = 1e-3;

fn ticks(model: &Model, readings: impl Fn(u32, usize) -> f64) -> (u64, Vec<f64>) {
    const JOINTS: usize = 6;
    let system = model.system(&[0, 1, 2, 3, 4, 5], |_| 0.0).expect("a configuration of the device");
    let mut walls = walls(model, &system);
    let mut compensation =
        Compensation::new(system, CompensationRatios::default(), SAMPLE_S).expect("a model that can be carried");
    let mut estimator = Estimator::new(JOINTS, SAMPLE_S, 20.0, 1e-4, 1);
    let [mut reading, mut q, mut dq, mut ddq, mut sum] = [[0.0; JOINTS]; 5];
    let before = asked();
    for k in 0..5000 {
        for (joint, reading) in reading.iter_mut().enumerate() {
            *reading = readings(k, joint);
        }
        estimator.tick(&reading, &mut q, &mut dq, &mut ddq);
        let command = compensation.tick(&q, &dq, &ddq);
        sum.iter_mut().zip(command).for_each(|(sum, command)| *sum += command.abs());
        for (at_joint, plane) in &mut walls {
            sum[0] += at_joint.tick(q[0], dq[0]).abs();
            sum.iter_mut().zip(plane.tick(&q, &dq)).for_each(|(sum, felt)| *sum += felt.abs());
        }
        if k == 2500 {
            estimator.restart();
            compensation.restart();
        }
    }
    (asked() - before, sum.to_vec())
}

#[test]
fn the_counter_counts() {
    let before = asked();
    std::hint::black_box(vec![1.0; 100]);
    assert_eq!(asked() - before, 2);
}

/// What is ticked below are laws of every kind, watched and not.
#[test]
fn walls_of_every_kind_are_ticked() {
    let model = model();
    let system = model.system(&[0, 1, 2, 3, 4, 5], |_| 0.0).expect("a configuration of the device");
    let walls = walls(&model, &system);
    let any = |is: &dyn Fn(&Wall) -> bool| walls.iter().any(|(at_joint, plane)| is(at_joint) && is(plane.wall()));
    assert!(any(&|wall| matches!(wall.law(), Law::Linear(_))) && any(&|wall| matches!(wall.law(), Law::Rules(_))));
    assert!(any(&|wall| matches!(wall.law(), Law::Coupled(_))) && any(&|wall| matches!(wall.law(), Law::Leaky { .. })));
    assert!(any(&|wall| wall.observed_energy().is_some()));
}

#[test]
fn a_tick_allocates_nothing() {
    let motion = |k: u32, joint: usize| 0.3 * ((1.0 + joint as f64) * f64::from(k) * 1e-3).sin();
    for model in [Model::of_device(dynid_model::device("freedom6s").expect("a shipped device")), model()] {
        let (asked, sum) = ticks(&model, motion);
        assert_eq!(asked, 0);
        assert!(sum.iter().all(|sum| sum.is_finite() && *sum > 1.0), "{sum:?}");
    }
}

/// Readings that no joint has: no number, beyond all bounds, jumping.
#[test]
fn no_reading_makes_a_tick_panic_or_command_what_is_no_number() {
    let nonsense = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -1e300, 1e-310, 0.0, 1e6, -2.0];
    let (asked, sum) = ticks(&model(), |k, joint| nonsense[(k as usize * 7 + joint * 5) % nonsense.len()]);
    assert_eq!(asked, 0);
    assert!(sum.iter().all(|sum| sum.is_finite()), "{sum:?}");
}
