"""The fit of one joint without LuGre friction, which MuJoCo does not have, by its own toolbox of system identification."""

import time

import numpy as np

from mujoco_robot import numbers
from numba_fit import upwards
from robot import Robot

# Of the integration (s); the command is held for ten of them.
STEP = 1e-3


def measure(robot: Robot, work: dict) -> dict:
    import mujoco
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        raise RuntimeError("mujoco.sysid does not find the packages that it needs")
    joint, noise = work["joint"], work["noise"]
    commands, log = np.array(work["commands"]), np.array(work["position"])
    gain = robot.effects["gain"][joint]["Kp"]
    start = {u["name"]: u for u in work["unknowns"]}
    mass = next(link["m"] for link in robot.links if link["title"] == "handle")
    xml = f"""<mujoco><compiler angle="radian"/><option gravity="{numbers(-upwards(robot, joint))}" timestep="{STEP}" integrator="RK4">
        <flag contact="disable" constraint="disable"/></option><worldbody><body name="link">
        <joint name="joint" type="hinge" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-4 1e-4 1e-4"/></body></worldbody>
        <actuator><motor name="motor" joint="joint" gear="{gain!r}"/></actuator>
        <sensor><jointpos name="position" joint="joint"/></sensor></mujoco>"""
    spec = mujoco.MjSpec.from_string(xml)

    def inertia(spec, p):
        # The other two do not take part in a turn about z; together with this one they must be a body's.
        spec.body("link").inertia = [p.value[0], p.value[0], p.value[0]]

    def centroid(axis):
        def change(spec, p):
            ipos = np.array(spec.body("link").ipos)
            ipos[axis] = p.value[0]
            spec.body("link").ipos = ipos

        return change

    def first(values, value):
        """Springs and dampers are polynomials in newer releases: their linear term."""
        values = np.array(values, dtype=float)
        if values.ndim == 0:
            return value
        values.flat[0] = value
        return values

    def of_joint(name):
        def change(spec, p):
            own = spec.joint("joint")
            setattr(own, name, first(getattr(own, name), p.value[0]))

        return change

    changes = {"link.7.x": centroid(0), "link.7.y": centroid(1), "link.7.Izz": inertia,
               f"joint.{joint}.viscous.Fv": of_joint("damping"), f"joint.{joint}.spring.Ks": of_joint("stiffness"),
               f"joint.{joint}.spring.qeq": of_joint("springref")}
    assert sorted(changes) == sorted(start), sorted(start)
    parameters = sysid.ParameterDict()
    for name, change in changes.items():
        own = start[name]
        parameters.add(sysid.Parameter(name, own["start"], own["lower"], own["upper"], modifier=change))

    model = spec.compile()
    # Ours has the initial position among its unknowns; here the simulation starts at the log's first sample, and the true one.
    initial = sysid.create_initial_state(model, np.array([work["start"]]), np.zeros(1), np.zeros(0))
    held = round(0.01 / STEP)
    control = sysid.TimeSeries(np.arange(held * (len(log) - 1)) * STEP, np.repeat(commands[:-1], held)[:, None])
    times = 0.01 * np.arange(1, len(log) - 1)
    qpos = [("joint_qpos", 1, sysid.SignalType.MjStateQPos)]
    measured = sysid.TimeSeries.from_custom_map(times, log[1:-1][:, None], qpos)
    sequences = sysid.ModelSequences("joint", spec, "chirp", initial, control, measured)
    evaluations = 0
    last = None
    build = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)

    def residual(x, p, **more):
        nonlocal evaluations, last
        evaluations += 1 if np.ndim(x) == 1 else x.shape[1]
        found = build(x, p, **more)
        last = found[1][0][0] if found[1] else None
        return found

    begin = time.process_time()
    fitted, _ = sysid.optimize(initial_params=parameters, residual_fn=residual, optimizer="mujoco", verbose=False)
    took = time.process_time() - begin
    residual(fitted.as_vector(), fitted)
    away = np.interp(times, last.times, last.data[:, 0]) - log[1:-1]
    rmse = float(np.sqrt(np.mean(away**2)))
    return {"linear_fit": took, "linear_rmse": rmse, "evaluations": evaluations, "linear_noise_reached": rmse < 1.03 * noise}
