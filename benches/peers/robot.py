"""The robot as the device file gives it, and its equations by recursive Newton-Euler, for numbers and for symbols.

A row of the Denavit-Hartenberg table turns by an affine function of the joint variables. Rows that start at the same
frame and turn by the same function, up to a constant, are one joint of a tree; the torque of a variable is the sum over the joints that
depend on it, each times its slope.
"""

import math
import tomllib
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]


class Robot:
    def __init__(self, device="freedom6s"):
        data = tomllib.loads((ROOT / "model" / "devices" / f"{device}.toml").read_text())
        self.n = len(data["joint"])
        numbers = {"pi": math.pi, "sin": math.sin, "cos": math.cos, **data["lengths"]}

        def value(text, variables=()):
            names = {f"q{i}": v for i, v in enumerate(variables)}
            return float(eval(str(text), {"__builtins__": {}}, {**numbers, **names}))

        angles = {name: value(text) for name, text in data["base"].get("angles", {}).items()}
        numbers.update(angles)
        self.up = np.array([value(c) for c in data["base"]["up"]]) * data["base"]["gravity"]
        unit = np.eye(self.n)
        # joints of the tree: parent frame, slope by the variables, constant; frames hang on joints or on frames
        self.joints, self.frames = [], {"base": (None, np.eye(4))}
        for row in data["kinematics"]["frames"]:
            constant = value(row["theta"], [0.0] * self.n)
            slope = np.array([value(row["theta"], e) - constant for e in unit]).round(12)
            after = screw(0.0, value(row["d"])) @ tilt(value(row["a"]), value(row["alpha"]))
            joint, offset = self.frames[row["parent"]]
            if not slope.any():
                self.frames[row["name"]] = (joint, offset @ screw(constant, 0.0) @ after)
                continue
            # Turns about one axis commute: the constant one comes after the joint's.
            after = screw(constant, 0.0) @ after
            key = (joint, offset.round(12).tobytes(), slope.tobytes())
            known = [k for k, j in enumerate(self.joints) if j["key"] == key]
            if not known:
                self.joints.append({"key": key, "parent": joint, "place": offset, "slope": slope})
                known = [len(self.joints) - 1]
            self.frames[row["name"]] = (known[0], after)
        # bodies: joint, mass, centroid and inertia about it in the joint's frame
        self.bodies = []
        self.links = data["link"]
        for link in data["link"]:
            joint, place = self.frames[link["frame"]]
            if joint is None:
                continue
            inertia = np.array([[link["Ixx"], link["Ixy"], link["Ixz"]], [link["Ixy"], link["Iyy"], link["Iyz"]],
                                [link["Ixz"], link["Iyz"], link["Izz"]]])
            turn = place[:3, :3]
            centroid = turn @ [link["x"], link["y"], link["z"]] + place[:3, 3]
            self.bodies.append((joint, link["m"], centroid, turn @ inertia @ turn.T))
        self.effects = {}
        for effect in data["effect"]:
            numbers_of = {k: (v["value"] if isinstance(v, dict) else v) for k, v in effect.items() if k not in ("id", "joint")}
            self.effects.setdefault(effect["id"], {})[effect["joint"]] = numbers_of

    def column(self, effect, symbol):
        return [self.effects[effect][joint][symbol] for joint in range(self.n)]

    def inverse_dynamics(self, q, dq, ddq, sin, cos, gravity=1.0):
        """tau = D ddq + h; `sin`, `cos` are those of the numbers that q is made of."""
        spin, push, force, moment = [], [], [], []
        z = np.array([0, 0, 1], dtype=object)
        zero = np.array([0, 0, 0], dtype=object)
        turns = []
        for joint in self.joints:
            angle, rate, acceleration = (sum(c * v[i] for i, c in enumerate(joint["slope"]) if c) for v in (q, dq, ddq))
            place = exact(joint["place"])
            s, c = sin(angle), cos(angle)
            turn = place[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=object)
            if joint["parent"] is None:
                w, dw, a = zero, zero, gravity * exact(self.up).astype(object)
            else:
                w, dw, a = spin[joint["parent"]][0], spin[joint["parent"]][1], push[joint["parent"]]
            p = place[:3, 3]
            a = a + cross(dw, p) + cross(w, cross(w, p))
            w, dw, a = turn.T @ w, turn.T @ dw, turn.T @ a
            dw = dw + cross(w, z * rate) + z * acceleration
            w = w + z * rate
            turns.append(turn)
            spin.append((w, dw))
            push.append(a)
            force.append(zero)
            moment.append(zero)
        for joint, mass, centroid, inertia in self.bodies:
            (w, dw), a = spin[joint], push[joint]
            c, inertia = exact(centroid), exact(inertia)
            f = mass * (a + cross(dw, c) + cross(w, cross(w, c)))
            force[joint] = force[joint] + f
            moment[joint] = moment[joint] + inertia @ dw + cross(w, inertia @ w) + cross(c, f)
        tau = [0] * self.n
        for k in reversed(range(len(self.joints))):
            joint = self.joints[k]
            for i, slope in enumerate(joint["slope"]):
                if slope:
                    tau[i] = tau[i] + slope * moment[k][2]
            if joint["parent"] is not None:
                f = turns[k] @ force[k]
                force[joint["parent"]] = force[joint["parent"]] + f
                p = exact(joint["place"])[:3, 3]
                moment[joint["parent"]] = moment[joint["parent"]] + turns[k] @ moment[k] + cross(p, f)
        return tau


def exact(matrix):
    """Rounding residues of sines of multiples of pi/2 become zeros, so that symbols vanish."""
    return np.where(np.abs(matrix - np.round(matrix)) < 1e-15, np.round(matrix), matrix).astype(object)


def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], dtype=object)


def screw(angle, along):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])


def tilt(along, angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
