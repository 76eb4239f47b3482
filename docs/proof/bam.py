"""Servo XL330 with a pendulum: mean absolute error of simulated positions, the published friction models beside ours.

    python docs/proof/bam.py PATH/bam/bam/data.bak/raw
"""

from __future__ import annotations

import json
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import dynid
import numpy
from rows import HERE, Row, digest, options, picture, write

Floats = numpy.ndarray[Any, numpy.dtype[numpy.float64]]
Role: TypeAlias = Literal["fit", "validate"]

# The runs with this gain of the servo's controller judge; the models see the others.
HELD_OUT = 400
COUNTS = 885.0  # of the voltage that is full on
# Duty per radian and unit of gain, as the logs show it: the voltage over the position error, regressed where it is not cut.
ERROR_GAIN = 0.00285
MASS, LENGTH, GRAVITY = 0.49, 0.1, 9.80665
STEP = 0.005


@dataclass(frozen=True)
class Recording:
    """One run, as long as the servo's motor is on: time [s], voltage [V], position, speed, reference [rad]."""

    name: str
    gain: float
    full: float
    columns: dict[str, Floats]

    @property
    def held_out(self) -> bool:
        """Whether it judges."""
        return self.gain == HELD_OUT

    @property
    def stiffness(self) -> float:
        """What the servo's controller answers to a position error [V/rad]."""
        return ERROR_GAIN * self.gain * self.full


def read(file: Path) -> Recording:
    """A recording of the repository (JSON), or a table of it (CSV: t, tau0, q0, qd0, torque_on, q_ref), whose name ends in the gain."""
    if file.suffix == ".json":
        log = json.loads(file.read_text(encoding="utf-8"))
        entries = log["entries"]
        names = ("timestamp", "load", "position", "speed", "goal_position")
        made = {own: numpy.array([float(entry[own]) for entry in entries]) for own in names}
        # Counts of 16 bits with a sign.
        duty = numpy.clip((made["load"] - 65536 * (made["load"] > 32767)) / COUNTS, -1, 1)
        on = numpy.array([bool(entry["torque_enable"]) for entry in entries])
        full, gain, name = float(entries[0].get("input_volts", log.get("vin", 7.3))), float(log["kp"]), str(log["trajectory"])
        columns = {"t": made["timestamp"], "tau0": duty * full, "q0": made["position"], "qd0": made["speed"], "ref0": made["goal_position"]}
    else:
        table = numpy.genfromtxt(file, delimiter=",", names=True)
        on, gain, name = table["torque_on"] > 0, float(file.stem.split("kp")[-1]), file.stem.split("-")[2]
        columns = {own: table[column] for own, column in [("t", "t"), ("tau0", "tau0"), ("q0", "q0"), ("qd0", "qd0"), ("ref0", "q_ref")]}
        full = 7.3
    end = len(on) if on.all() else int(numpy.argmin(on))
    return Recording(f"{name}, gain {gain:g}", gain, full, {own: values[:end] for own, values in columns.items()})


def published(own: dict[str, float], run: Recording, error_gain: float) -> float:
    """MAE of a published model, simulated as its repository does: in steps of 5 ms, friction stops the joint or is at its limit."""
    t = numpy.arange(run.columns["t"][0], run.columns["t"][-1], STEP)
    reference, measured = (numpy.interp(t, run.columns["t"], run.columns[name]) for name in ("ref0", "q0"))
    q, dq = float(measured[0]), float(run.columns["qd0"][0])
    inertia, total = MASS * LENGTH**2 + own["armature"], 0.0
    for target, seen in zip(reference, measured, strict=True):
        total += abs(q - seen)
        volts = max(-run.full, min(run.full, error_gain * run.gain * run.full * (target - q)))
        motor = own["kt"] * (volts - own["kt"] * dq) / own["R"]
        weight = -MASS * GRAVITY * LENGTH * math.sin(q + own["q_offset"])
        net = motor + weight
        stop = inertia / STEP * dq + net
        limit = _friction(own, motor, weight, dq) + own["friction_viscous"] * abs(dq)
        acceleration = (net - math.copysign(min(abs(stop), limit), stop)) / inertia
        dq += acceleration * STEP
        q += dq * STEP + 0.5 * acceleration * STEP**2
    return total / len(t)


def _friction(own: dict[str, float], motor: float, weight: float, dq: float) -> float:
    """The dry part, as far as a model has it."""
    slow = math.exp(-(abs(dq / own["dtheta_stribeck"]) ** own["alpha"])) if "alpha" in own else 0.0
    friction = own["friction_base"] + slow * own.get("friction_stribeck", 0.0)
    if "load_friction_base" in own:
        friction += (own["load_friction_base"] + slow * own.get("load_friction_stribeck", 0.0)) * abs(weight - motor)
    if "load_friction_motor" in own:
        friction += abs(weight * own["load_friction_external"] - motor * own["load_friction_motor"])
        friction += slow * abs(weight * own["load_friction_external_stribeck"] - motor * own["load_friction_motor_stribeck"])
    if "load_friction_motor_quad" in own and weight * motor < 0:
        lesser, factor = (weight, "external") if abs(weight) < abs(motor) else (motor, "motor")
        friction += slow * own[f"load_friction_{factor}_quad"] * lesser**2
    return friction


def experiment(robot: dynid.Device, runs: list[Recording], folder: Path) -> dynid.Experiment:
    """Logs of the closed loop, without what is cut or only begins."""
    logs = dynid.Experiment(robot)
    for run in runs:
        controller = folder / f"{run.gain:g}-{run.full:g}.toml"
        controller.write_text(f"P = [{run.stiffness}]\nD = [0.0]\nlimit = [{run.full}]\n", encoding="utf-8")
        use = abs(run.columns["tau0"]) < 6.0
        use[:30] = use[-30:] = False
        table = {name: run.columns[name] for name in ("t", "tau0", "q0", "ref0")} | {"use": use.astype(float)}
        role: Role = "validate" if run.held_out else "fit"
        # The last two say of which samples the torque error is shown: at rest friction holds whatever arrives.
        logs.add(table, role=role, free=[0], label=run.name, mask="use", controller=controller, cutoff_hz=12.0, min_speed=[0.3])
    return logs


def main() -> None:
    arguments = options(__doc__ or "", "a folder with the recordings").parse_args()
    files = sorted([*arguments.path.glob("*.json"), *arguments.path.glob("run-*.csv")])
    runs = [run for run in map(read, files) if len(run.columns["t"]) > 100]
    theirs = json.loads((HERE / "bam_xl330.json").read_text(encoding="utf-8"))
    robot = dynid.devices["servo_pendulum"]
    coulomb = robot.model()
    load = dynid.Effect("friction_load", 0, mu=0.1, behind=1.0)
    stribeck = dynid.Effect("stribeck", 0, Fs=0.02, Fc=0.01)
    laws = {"M1": coulomb, "M2": coulomb.add(stribeck), "M3": coulomb.add(load), "M4": coulomb.add(load).add(stribeck)}
    said = {"M1": "Coulomb and viscous", "M2": "and Stribeck", "M3": "and load", "M4": "and load and Stribeck"}
    said |= {"M5": "and the direction of the load", "M6": "and its square"}

    rows, shown = [], {}
    with tempfile.TemporaryDirectory() as folder:
        logs = experiment(robot, runs, Path(folder))
        judges = [number for number, run in enumerate(runs) if run.held_out]
        best, values, first = math.inf, "", None
        for name, text in said.items():
            # Their gain of the controller (bam/xl330/actuator.py), which goes better with their values than the one that the logs show.
            published_mae = 1e3 * float(numpy.mean([published(theirs[name], runs[number], 0.00246) for number in judges]))
            if name not in laws:
                rows.append(Row(f"{name}, {text}; beside our best", "mrad", published_mae, best))
                continue
            fitted = dynid.fit(laws[name], logs).model
            first = first or fitted
            simulated = dynid.simulate(fitted, logs)
            errors = [1e3 * float(numpy.mean(abs(simulated[number].q[:, 0] - runs[number].columns["q0"]))) for number in judges]
            rows.append(Row(f"{name}, {text}", "mrad", published_mae, float(numpy.mean(errors))))
            shown[name] = simulated[judges[0]].q[:, 0]
            if rows[-1].ours < best:
                best = rows[-1].ours
                shown_values = [own for own in fitted.names if own.startswith("joint") and not own.endswith(("v_eps", "T_ddq"))]
                values = ", ".join(f"{own.removeprefix('joint.0.')} = {fitted[own]:.4g}" for own in shown_values)
        assert first is not None
        found = dynid.diagnose(first, logs, depth=1)
    one = runs[judges[0]].columns
    curves = [("measured", one["t"], one["q0"])] + [(own, one["t"], shown[own]) for own in ("M1", "M3")]
    picture(arguments.readme, "bam", f"{runs[judges[0]].name}, simulated", "q0 [rad]", curves)
    sentences = [f"`diagnose` of M1: {' '.join(found.sentences)}", f"our best: {values}"]
    write(arguments.readme, "bam", rows, sentences, digest(files))


if __name__ == "__main__":
    main()
