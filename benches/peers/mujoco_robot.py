"""The robot for MuJoCo: a joint per row of the table that turns, as Pinocchio has it, and the same algebra for those that follow others.

With `v = G dq`: `G^T M G ddq = tau - G^T b(q, G dq)`, M and b by MuJoCo (composite rigid bodies, recursive Newton-Euler).
"""

import numpy as np

from robot import Robot

# Bodies must have a mass; that of a joint without a link of its own is nothing beside the others.
NOTHING = 1e-14


def numbers(values):
    return " ".join(repr(float(value)) for value in np.ravel(values))


def quaternion(turn):
    """Of a rotation matrix; the largest of the four squares first, so that nothing cancels."""
    m = np.asarray(turn, dtype=float)
    squares = 1 + np.array([np.trace(m), *(2 * np.diag(m) - np.trace(m))])
    k = int(np.argmax(squares))
    w = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    q = np.empty(4)
    if k == 0:
        q[0], q[1:] = squares[0], w
    else:
        i = k - 1
        q[0] = w[i]
        q[1:] = (m + m.T)[i]
        q[k] = squares[k]
    return q / np.linalg.norm(q)


def inertial(robot: Robot, joint: int):
    """All bodies on a joint as one."""
    bodies = [(mass, c, inertia) for k, mass, c, inertia in robot.bodies if k == joint and mass > 0]
    mass = sum(mass for mass, _, _ in bodies)
    if mass == 0:
        return f'<inertial pos="0 0 0" mass="{NOTHING}" diaginertia="{NOTHING} {NOTHING} {NOTHING}"/>'
    centroid = sum(mass * c for mass, c, _ in bodies) / mass
    total = np.zeros((3, 3))
    for own, c, inertia in bodies:
        away = c - centroid
        total += inertia + own * (away @ away * np.eye(3) - np.outer(away, away))
    entries = [total[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return f'<inertial pos="{numbers(centroid)}" mass="{mass!r}" fullinertia="{numbers(entries)}"/>'


def document(robot: Robot) -> str:
    def body(k):
        place = robot.joints[k]["place"]
        inside = "".join(body(child) for child, joint in enumerate(robot.joints) if joint["parent"] == k)
        return (f'<body name="b{k}" pos="{numbers(place[:3, 3])}" quat="{numbers(quaternion(place[:3, :3]))}">'
                f'<joint name="j{k}" type="hinge" axis="0 0 1"/>{inertial(robot, k)}{inside}</body>')

    roots = "".join(body(k) for k, joint in enumerate(robot.joints) if joint["parent"] is None)
    # Numbers that bodies may not have (a sum of two inertias below the third) are taken as they are, or refused: never changed.
    return (f'<mujoco><compiler angle="radian" balanceinertia="false"/><option gravity="{numbers(-robot.up)}"/>'
            f"<worldbody>{roots}</worldbody></mujoco>")


def order(robot: Robot):
    """MuJoCo numbers joints depth first: our joints in its order."""
    found = []

    def visit(k):
        found.append(k)
        for child, joint in enumerate(robot.joints):
            if joint["parent"] == k:
                visit(child)

    for k, joint in enumerate(robot.joints):
        if joint["parent"] is None:
            visit(k)
    return found


def slopes(robot: Robot):
    return np.array([robot.joints[k]["slope"] for k in order(robot)])
