"""Inverse dynamics and inertia matrices of URDFs by Pinocchio, at random states: JSON to stdout, a line for each file.

python3 by_pinocchio.py STATES FILE..
"""

import json
import re
import sys
import xml.etree.ElementTree as ElementTree

import numpy
import pinocchio


def followers(joints):
    """Of each joint that mimics another: the other, the factor and the offset."""
    found = {}
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed":
            number = lambda key, default: float(mimic.get(key, default))
            found[joint.get("name")] = (mimic.get("joint"), number("multiplier", 1), number("offset", 0))
    return found


def of_file(path, states):
    # Prefixes that nobody declared are no XML, but stand in robot descriptions.
    text = re.sub(r"(</?)(\w+):", r"\1\2_", open(path, encoding="utf-8").read())
    text = re.sub(r"(\s)(?!xmlns)(\w+):(\w+\s*=)", r"\1\2_\3", text)
    joints = ElementTree.fromstring(text.strip().encode()).findall("joint")
    child_of = {joint.get("name"): joint.find("child").get("link") for joint in joints}
    model = pinocchio.buildModelFromUrdf(path)
    data = model.createData()
    own = list(model.names)[1:]
    mimic = {name: rule for name, rule in followers(joints).items() if name in own}
    leaders = [name for name in own if name not in mimic]
    # All joints' positions are `factors @ leaders + offsets`: Pinocchio takes joints that follow others for free ones.
    factors, offsets = numpy.zeros((model.nv, len(leaders))), numpy.zeros(model.nv)
    for name in own:
        leader, factor, offset = mimic.get(name, (name, 1.0, 0.0))
        at = model.joints[model.getJointId(name)].idx_v
        factors[at, leaders.index(leader)] = factor
        offsets[at] = offset
    random = numpy.random.default_rng(7)
    found = []
    for _ in range(states):
        q, dq, ddq = (random.uniform(-size, size, len(leaders)) for size in (2.0, 3.0, 10.0))
        angles = factors @ q + offsets
        position = numpy.zeros(model.nq)
        for name in own:
            joint = model.joints[model.getJointId(name)]
            angle = angles[joint.idx_v]
            at = slice(joint.idx_q, joint.idx_q + joint.nq)
            position[at] = [numpy.cos(angle), numpy.sin(angle)] if joint.nq == 2 else [angle]
        torque = factors.T @ pinocchio.rnea(model, data, position, factors @ dq, factors @ ddq)
        inertia = pinocchio.crba(model, data, position)
        inertia = numpy.triu(inertia) + numpy.triu(inertia, 1).T
        inertia = factors.T @ inertia @ factors
        vectors = {"q": q, "dq": dq, "ddq": ddq, "torque": torque, "inertia": inertia.ravel()}
        found.append({key: vector.tolist() for key, vector in vectors.items()})
    bodies = {}
    for name in own:
        body = model.inertias[model.getJointId(name)]
        tensor = body.inertia
        moments = [tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2]]
        bodies[child_of[name]] = [body.mass, *body.lever.tolist(), *moments]
    return {"joints": leaders, "bodies": bodies, "states": found}


for path in sys.argv[2:]:
    try:
        answer = of_file(path, int(sys.argv[1]))
    except Exception as error:  # What Pinocchio cannot read is reported, not the end.
        answer = {"error": f"{type(error).__name__}: {error}"}
    print(json.dumps({"path": path, **answer}))
