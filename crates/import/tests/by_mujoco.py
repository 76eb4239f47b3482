"""Inverse dynamics and inertia matrices of MJCFs by MuJoCo, at random states: JSON to stdout, a line for each file.

python3 by_mujoco.py STATES FILE..

Rotors, damping and friction are effects of a device, so they are taken off.
"""

import json
import sys

import mujoco
import numpy


def of_file(path, states):
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    random = numpy.random.default_rng(7)
    found = []
    for _ in range(states):
        q, dq, ddq = (random.uniform(-size, size, model.nv) for size in (2.0, 3.0, 10.0))
        data.qpos[:], data.qvel[:] = q, dq
        mujoco.mj_forward(model, data)
        # Inverse dynamics of unit accelerations, without what is not of rigid bodies: tau = M ddq + h.
        bias = numpy.zeros(model.nv)
        mujoco.mj_rne(model, data, 0, bias)
        inertia = numpy.zeros((model.nv, model.nv))
        for joint in range(model.nv):
            data.qacc[:] = 0
            data.qacc[joint] = 1
            column = numpy.zeros(model.nv)
            mujoco.mj_rne(model, data, 1, column)
            inertia[:, joint] = column - bias
        data.qacc[:] = ddq
        torque = numpy.zeros(model.nv)
        mujoco.mj_rne(model, data, 1, torque)
        vectors = {"q": q, "dq": dq, "ddq": ddq, "torque": torque, "inertia": inertia.ravel()}
        found.append({key: vector.tolist() for key, vector in vectors.items()})
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in range(model.njnt)]
    return {"joints": names, "states": found}


for path in sys.argv[2:]:
    try:
        answer = of_file(path, int(sys.argv[1]))
    except Exception as error:  # What MuJoCo cannot read is reported, not the end.
        answer = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps({"path": path, **answer}))
