"""Accelerations of a million states of a robot with six joints: dynid on whole arrays, Pinocchio in a loop, CasADi mapped on two threads.

    pip install pin casadi && python arrays.py robot.urdf

All three read the same description. Each is measured once, after a first call on a few states; the table says what each took and by how much
its accelerations differ from Pinocchio's.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("RAYON_NUM_THREADS", "2")

import casadi
import dynid
import numpy
import pinocchio

STATES = 1_000_000
FEW = 1_000
THREADS = 2

Forward = Callable[[Any, Any, Any], Any]


def by_dynid(path: Path) -> Forward:
    return dynid.Device.from_urdf(path).kernel().forward_dynamics


def by_pinocchio(path: Path) -> Forward:
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()

    def forward(q: Any, dq: Any, tau: Any) -> Any:
        return numpy.array([pinocchio.aba(model, data, *state) for state in zip(q, dq, tau)])

    return forward


def by_casadi(path: Path) -> Forward:
    model = pinocchio.buildModelFromUrdf(str(path))
    n = model.nv
    q, dq, tau = (casadi.SX.sym(name, n) for name in ("q", "dq", "tau"))
    bias = newton_euler(model, q, dq, casadi.SX.zeros(n), -model.gravity.linear)
    still = [newton_euler(model, q, casadi.SX.zeros(n), casadi.SX.eye(n)[:, k], numpy.zeros(3)) for k in range(n)]
    function = casadi.Function("forward", [q, dq, tau], [casadi.cse(solved(casadi.horzcat(*still), tau - bias))])

    def forward(q: Any, dq: Any, tau: Any) -> Any:
        mapped = function.map(len(q), "thread", THREADS)
        return numpy.array(mapped(q.T, dq.T, tau.T)).T

    return forward


def newton_euler(model: Any, q: Any, dq: Any, ddq: Any, push: Any) -> Any:
    """Torques of a chain of revolute joints, whose base accelerates by `push`, by the recursion of Luh, Walker and Paul (1980)."""
    spin, turn_up, accelerate = (casadi.SX.zeros(3) for _ in range(3))
    accelerate = casadi.SX(push)
    steps = []
    for k in range(model.nv):
        joint, place, body = model.joints[k + 1], model.jointPlacements[k + 1], model.inertias[k + 1]
        axis = {"RX": [1, 0, 0], "RY": [0, 1, 0], "RZ": [0, 0, 1]}.get(joint.shortname()[-2:]) or list(joint.extract().axis)
        x, y, z = axis
        cross = casadi.SX([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = place.rotation @ (casadi.SX.eye(3) + casadi.sin(q[k]) * cross + (1 - casadi.cos(q[k])) * (cross @ cross))
        axis = casadi.SX(axis)
        lever = casadi.SX(place.translation)
        accelerate = turn.T @ (accelerate + casadi.cross(turn_up, lever) + casadi.cross(spin, casadi.cross(spin, lever)))
        carried = turn.T @ spin
        turn_up = turn.T @ turn_up + axis * ddq[k] + casadi.cross(carried, axis * dq[k])
        spin = carried + axis * dq[k]
        centre = casadi.SX(body.lever)
        of_centre = accelerate + casadi.cross(turn_up, centre) + casadi.cross(spin, casadi.cross(spin, centre))
        force = body.mass * of_centre
        moment = body.inertia @ turn_up + casadi.cross(spin, body.inertia @ spin) + casadi.cross(centre, force)
        steps.append((turn, lever, axis, force, moment))
    force, moment = casadi.SX.zeros(3), casadi.SX.zeros(3)
    torques = []
    for turn, lever, axis, own_force, own_moment in reversed(steps):
        force, moment = own_force + force, own_moment + moment
        torques.append(casadi.dot(axis, moment))
        force = turn @ force
        moment = turn @ moment + casadi.cross(lever, force)
    return casadi.vertcat(*reversed(torques))


def solved(matrix: Any, x: Any) -> Any:
    """By `L diag(d) L^T`, unrolled."""
    n = matrix.shape[0]
    x = [x[i] for i in range(n)]
    low, pivot = {}, []
    for i in range(n):
        for j in range(i):
            low[i, j] = (matrix[i, j] - sum(low[i, k] * low[j, k] * pivot[k] for k in range(j))) / pivot[j]
        pivot.append(matrix[i, i] - sum(low[i, k] ** 2 * pivot[k] for k in range(i)))
        x[i] = x[i] - sum(low[i, k] * x[k] for k in range(i))
    for i in reversed(range(n)):
        x[i] = x[i] / pivot[i] - sum(low[k, i] * x[k] for k in range(i + 1, n))
    return casadi.vertcat(*x)


def main() -> None:
    path = Path(sys.argv[1])
    n = len(dynid.Device.from_urdf(path).joints)
    generator = numpy.random.default_rng(1)
    q, dq, tau = (generator.uniform(-1.0, 1.0, (STATES, n)) for _ in range(3))
    expected = None
    rows = []
    for name, make in [("pinocchio in a loop", by_pinocchio), ("casadi mapped", by_casadi), ("dynid", by_dynid)]:
        forward = make(path)
        forward(q[:FEW], dq[:FEW], tau[:FEW])
        begun = time.perf_counter()
        ddq = forward(q, dq, tau)
        seconds = time.perf_counter() - begun
        expected = ddq if expected is None else expected
        off = abs(ddq - expected).max() / abs(expected).max()
        rows.append((name, seconds, off))
    ours = rows[-1][1]
    print(f"{STATES} states, {n} joints, {THREADS} threads")
    for name, seconds, off in rows:
        print(f"{name:22} {seconds:8.3f} s  {seconds / ours:8.1f} times dynid's  off by {off:.0e} of the largest")


if __name__ == "__main__":
    main()
