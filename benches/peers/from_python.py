"""Forward dynamics called from Python, by the packages that compute it: what a script pays for a call."""

import time

import numpy as np

from mujoco_robot import document, slopes
from robot import Robot


def measure(forward, state: dict) -> dict:
    still, dq, tau = (np.array(state[name]) for name in ("q", "dq", "tau"))
    ddq = forward(still, dq, tau)
    calls, best = 2000, float("inf")
    for _ in range(5):
        q = still
        begin = time.process_time()
        for _ in range(calls):
            # The posture hardly moves, but the next call has to wait for this one.
            q = still + 1e-9 * forward(q, dq, tau)
        best = min(best, (time.process_time() - begin) / calls)
    return {"forward_dynamics": best, "ddq": ddq.tolist()}


def pinocchio(robot: Robot, state: dict) -> dict:
    import pinocchio as pin

    model = pin.Model()
    ids = []
    for k, joint in enumerate(robot.joints):
        parent = 0 if joint["parent"] is None else ids[joint["parent"]]
        ids.append(model.addJoint(parent, pin.JointModelRZ(), pin.SE3(np.array(joint["place"], dtype=float)), f"j{k}"))
    for joint, mass, centroid, inertia in robot.bodies:
        body = pin.Inertia(mass, np.array(centroid, dtype=float), np.array(inertia, dtype=float))
        model.appendBodyToJoint(ids[joint], body, pin.SE3.Identity())
    model.gravity.linear = -robot.up
    data = model.createData()
    # Pinocchio numbers joints as they were added; so do we.
    table = np.zeros((model.nv, robot.n))
    for k, joint in enumerate(robot.joints):
        table[model.joints[ids[k]].idx_v] = joint["slope"]

    def forward(q, dq, tau):
        tree_q, tree_v = table @ q, table @ dq
        inertia = pin.crba(model, data, tree_q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        bias = pin.nonLinearEffects(model, data, tree_q, tree_v)
        return np.linalg.solve(table.T @ inertia @ table, tau - table.T @ bias)

    return measure(forward, state)


def mujoco(robot: Robot, state: dict) -> dict:
    import mujoco as mj

    model = mj.MjModel.from_xml_string(document(robot))
    data = mj.MjData(model)
    table = slopes(robot)
    inertia, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)

    def forward(q, dq, tau):
        data.qpos[:], data.qvel[:] = table @ q, table @ dq
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_makeM(model, data)
        mj.mj_comVel(model, data)
        mj.mj_rne(model, data, 0, bias)
        mj.mj_fullM(model, data, inertia)
        return np.linalg.solve(table.T @ inertia @ table, tau - table.T @ bias)

    return measure(forward, state)
