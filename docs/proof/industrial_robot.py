"""Industrial robot of nonlinear_benchmarks (KUKA KR300 R2500, forward identification): simulated positions from motor torques.

    python docs/proof/industrial_robot.py kr300.urdf

The package downloads the data; `kr300.urdf` (or a device file) is a description of the robot, which they do not contain.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import dynid
import numpy
from rows import Row, options, write

Role: TypeAlias = Literal["fit", "validate"]

# Torques in N m of the motors, positions in degrees, ten samples a second (Weigand and others, 2022).
SAMPLING_TIME = 0.1


def experiment(robot: dynid.Device, train: Sequence[Any], test: Sequence[Any]) -> dynid.Experiment:
    """The package's data sets as runs of all joints."""
    logs, joints = dynid.Experiment(robot), range(len(robot.joints))
    scale = {f"q{joint}": numpy.pi / 180 for joint in joints}
    roles: list[tuple[Role, Sequence[Any]]] = [("fit", train), ("validate", test)]
    for role, sets in roles:
        for number, own in enumerate(sets, 1):
            label = f"{role} {number}"
            logs.add(own, role=role, free=joints, label=label, scale=scale, moving=True, hold="linear", sampling_time=SAMPLING_TIME)
    return logs


def model(robot: dynid.Device) -> dynid.Model:
    """Every joint: the gear's ratio as an unknown gain, friction, an offset and a rotor."""
    kinds = ["gain", "viscous", "coulomb", "torque_offset", "rotor_inertia"]
    return dynid.Model(robot, [dynid.Effect(kind, joint) for joint in range(len(robot.joints)) for kind in kinds])


def scored(robot: dynid.Device, train: Sequence[Any], test: Sequence[Any]) -> tuple[list[Row], list[str]]:
    """The benchmark's figure, errors of simulated positions over their standard deviation, and the torque error."""
    logs = experiment(robot, train, test)
    fitted = dynid.fit(model(robot), logs, error="torque").model
    compared = [run for run in dynid.compare(fitted, logs).json()["runs"] if run["role"] == "validate"]
    rows: list[Row] = []
    for joint in range(len(robot.joints)):
        torque = [run["joints"][joint]["torque_percent"] for run in compared]
        rows.append(Row(f"torque error, joint {joint + 1}", "%", None, float(numpy.mean(torque))))
    only = experiment(robot, [], test)
    try:
        simulated = dynid.simulate(fitted, only)
    except dynid.Error as error:
        return rows, [f"open-loop simulation from the torques does not come to its end: {error}"]
    for joint in range(len(robot.joints)):
        pairs = [(own.q[:, joint], only.columns(run)[f"q{joint}"]) for run, own in enumerate(simulated)]
        shares = [numpy.sqrt(numpy.mean((own - q) ** 2)) / numpy.std(q) for own, q in pairs]
        rows.append(Row(f"simulated position, joint {joint + 1}, of its standard deviation", "%", None, 100 * float(numpy.mean(shares))))
    return rows, []


def main() -> None:
    arguments = options(__doc__ or "", "the robot's URDF, MJCF or device file").parse_args()
    robot = load(arguments.path)
    train, test = importlib.import_module("nonlinear_benchmarks.not_splitted_benchmarks").Industrial_robot()
    rows, said = scored(robot, train, test)
    write(arguments.readme, "industrial-robot", rows, said, "that the package downloads is not kept")


def load(path: Path) -> dynid.Device:
    """A device file or a description of another program."""
    return dynid.Device.load(path) if path.suffix == ".toml" else dynid.Device.from_urdf(path)


if __name__ == "__main__":
    main()
