"""Inverse dynamics of MJCFs by MuJoCo with all that the file states: rotors, damping, springs; without constraints.

python3 whole_by_mujoco.py STATES FILE..
"""

import json
import sys

import mujoco
import numpy


def of_file(path, states):
    model = mujoco.MjModel.from_xml_path(path)
    # Friction and limits are constraints.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    random = numpy.random.default_rng(9)
    found = []
    for _ in range(states):
        q, dq, ddq = (random.uniform(-size, size, model.nv) for size in (2.0, 3.0, 10.0))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        vectors = {"q": q, "dq": dq, "ddq": ddq, "torque": data.qfrc_inverse}
        found.append({key: vector.tolist() for key, vector in vectors.items()})
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in range(model.njnt)]
    return {"joints": names, "frictionloss": model.dof_frictionloss.tolist(), "states": found}


for path in sys.argv[2:]:
    print(json.dumps({"path": path, **of_file(path, int(sys.argv[1]))}))
