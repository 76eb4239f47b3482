"""The fit of one joint with a numba simulator and scipy's least squares, whose Jacobian is by differences."""

import math
import time

import numba
import numpy as np
from scipy.optimize import least_squares

from robot import Robot


@numba.njit(cache=False)
def simulate(p, commands, up_x, up_y, substeps, out):
    m, x, y, izz, kp, s0, s1, s2, vs, fs, fc, ks, qeq, q = p
    inertia = izz + m * (x * x + y * y)
    h = 0.01 / substeps
    state = np.array([q, 0.0, 0.0])
    k = np.zeros((4, 3))
    out[0] = q
    for sample in range(len(commands) - 1):
        drive = kp * commands[sample]
        for _ in range(substeps):
            at0, at1, at2 = state
            for stage in range(4):
                v = at1
                ratio = v / vs
                g = fc + (fs - fc) * math.exp(-(ratio * ratio))
                dz = v - s0 * abs(v) / g * at2
                c, s = math.cos(at0), math.sin(at0)
                weight = m * ((x * c - y * s) * up_y - (x * s + y * c) * up_x)
                k[stage, 0] = v
                k[stage, 1] = (drive - (s0 * at2 + s1 * dz + s2 * v) - ks * (at0 - qeq) - weight) / inertia
                k[stage, 2] = dz
                reach = h if stage == 2 else 0.5 * h
                at0 = state[0] + reach * k[stage, 0]
                at1 = state[1] + reach * k[stage, 1]
                at2 = state[2] + reach * k[stage, 2]
            for i in range(3):
                state[i] += h / 6 * (k[0, i] + 2 * k[1, i] + 2 * k[2, i] + k[3, i])
        out[sample + 1] = state[0]


def upwards(robot: Robot, joint: int):
    """Up, times gravity, in the frame before the joint, about whose z it turns."""
    def is_last(k):
        return not any(other["parent"] == k for other in robot.joints)

    k = next(k for k, own in enumerate(robot.joints) if own["slope"][joint] == 1 and is_last(k))
    chain = []
    while k is not None:
        chain.append(robot.joints[k]["place"][:3, :3])
        k = robot.joints[k]["parent"]
    turn = np.eye(3)
    for place in reversed(chain):
        turn = turn @ place
    return turn.T @ robot.up


def measure(robot: Robot, work: dict) -> dict:
    joint = work["joint"]
    commands, log = np.array(work["commands"]), np.array(work["position"])
    up = upwards(robot, joint)
    order = ["link.7.m", "link.7.x", "link.7.y", "link.7.Izz"]
    order += [f"joint.{joint}.gain.Kp"]
    order += [f"joint.{joint}.lugre.{s}" for s in ("sigma0", "sigma1", "sigma2", "vs", "Fs", "Fc")]
    order += [f"joint.{joint}.spring.{s}" for s in ("Ks", "qeq")]
    unknowns = {u["name"]: u for u in work["unknowns"]}
    assert sorted(unknowns) == sorted(order), sorted(unknowns)
    start = np.array([unknowns[name]["start"] for name in order] + [log[0]])
    lower = np.array([unknowns[name]["lower"] for name in order] + [log[0] - 0.1])
    upper = np.array([unknowns[name]["upper"] for name in order] + [log[0] + 0.1])
    out = np.zeros(len(log))
    simulate(start, commands[:3], up[0], up[1], 60, out)  # compiles
    evaluations = 0

    def residual(p):
        nonlocal evaluations
        evaluations += 1
        simulate(p, commands, up[0], up[1], 60, out)
        error = (out - log) / work["noise"]
        return np.where(np.isfinite(error), error, 1e6)

    begin = time.process_time()
    one = residual(start)
    once = time.process_time() - begin
    assert np.isfinite(one).all()
    begin = time.process_time()
    fit = least_squares(residual, start, bounds=(lower, upper), x_scale=np.maximum(np.abs(start), 1e-6), max_nfev=200)
    took = time.process_time() - begin
    rmse = float(np.sqrt(np.mean(fit.fun**2)) * work["noise"])
    return {"fit": took, "rmse": rmse, "evaluations": evaluations, "simulate_one_joint": once,
            "noise_reached": rmse < 1.03 * work["noise"]}
