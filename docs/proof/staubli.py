"""Staubli TX40: friction and rotors of the published identification beside ours, and what its coupled wrist is worth.

    python docs/proof/staubli.py PATH/examples/staubli_TX40/data
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import dynid
import numpy
from rows import HERE, Row, digest, options, picture, write

Floats = numpy.ndarray[Any, numpy.dtype[numpy.float64]]

RATE_HZ = 5000.0
RATIOS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)  # turns of the motors for one of the joints; motor 6 also turns with joint 5
MIN_SPEED = [0.05009, 0.05009, 0.07505, 0.07156, 0.05585, 0.12217]
# Names of the published base parameters that are one value of ours.
SAME = {"fv": "viscous.Fv", "fs": "coulomb.Fc"}
WRIST = {"Iam6": "rotor_coupling.5.Ia", "fvm6": "friction_coupled.5.Fv", "fsm6": "friction_coupled.5.Fc"}


def read(folder: Path) -> tuple[dict[str, Floats], list[Path]]:
    """Joint positions and torques: of the repository's two files of the motors, or of a table of the joints (tx40.csv)."""
    table = folder / "tx40.csv"
    if table.exists():
        joints = numpy.genfromtxt(table, delimiter=",", names=True)
        columns = {f"{symbol}{joint}": joints[f"{symbol}_{joint + 1}"] for symbol in ("tau", "q") for joint in range(6)}
        return {"t": joints["t"], **columns}, [table]
    files = [folder / "curr_data.csv", folder / "pos_read_data.csv"]
    torque, position = (numpy.genfromtxt(file, delimiter=",", skip_header=1) for file in files)
    turns, shares = numpy.diag(RATIOS), numpy.diag(RATIOS)
    turns[5, 4] = shares[4, 5] = RATIOS[5]
    q, tau = position @ numpy.linalg.inv(turns).T, torque @ shares.T
    q[:, 1] -= math.pi / 2
    q[:, 2] += math.pi / 2
    made = {"t": numpy.arange(len(q)) / RATE_HZ}
    for joint in range(6):
        made |= {f"tau{joint}": tau[:, joint], f"q{joint}": q[:, joint]}
    return made, files


def main() -> None:
    arguments = options(__doc__ or "", "the folder with curr_data.csv and pos_read_data.csv").parse_args()
    columns, files = read(arguments.path)
    published = json.loads((HERE / "staubli_tx40.json").read_text(encoding="utf-8"))["values"]
    robot = dynid.devices["staubli_tx40"]
    logs = dynid.Experiment(robot)
    logs.add(columns, role="fit", label="tx40", free=range(6), cutoff_hz=100.0, decimate=100, min_speed=MIN_SPEED)
    coupled = robot.model()
    apart = coupled.remove("friction_coupled", 4, 5).remove("rotor_coupling", 4, 5)
    models = {name: dynid.fit(model, logs, error="torque").model for name, model in (("apart", apart), ("coupled", coupled))}
    compared = {name: dynid.compare(model, logs) for name, model in models.items()}
    errors = {name: [joint["torque_percent"] for joint in own.json()["runs"][0]["joints"]] for name, own in compared.items()}

    ours = models["coupled"]
    uncoupled = [(joint, error) for joint, error in enumerate(errors["apart"]) if joint > 3]
    rows = [Row(f"torque error, joint {joint + 1}: wrist not coupled", "%", None, error) for joint, error in uncoupled]
    rows += [Row(f"torque error, joint {joint + 1}", "%", None, error) for joint, error in enumerate(errors["coupled"])]
    names = {f"{own}{joint + 1}": f"joint.{joint}.{name}" for own, name in SAME.items() for joint in range(6)}
    names |= {own: f"joint.4.{name}" for own, name in WRIST.items()}
    for own, name in names.items():
        value, percent = published[own]
        unit = "kg m^2" if own.startswith("I") else "N m" if own.startswith("fs") else "N m s"
        rows.append(Row(own, unit, value, ours[name], abs(value) * percent / 100, is_error=False))
    one = [[panel for panel in compared[name].overlays if panel.quantity == "torque"][5] for name in ("apart", "coupled")]
    curves = [("measured", one[0].t, one[0].measured)]
    curves += [(name, own.t, own.model) for name, own in zip(("wrist not coupled", "coupled"), one, strict=True)]
    picture(arguments.readme, "staubli", one[0].title, "torque [N m]", curves)
    write(arguments.readme, "staubli", rows, ["one trajectory, nothing held out: neither they nor we have another"], digest(files))


if __name__ == "__main__":
    main()
