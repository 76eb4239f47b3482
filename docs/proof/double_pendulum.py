"""Double pendulum of the DFKI, design A.0: torque errors of the published model, of a structure without dry friction, and of ours.

    python docs/proof/double_pendulum.py PATH/double_pendulum
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynid
import numpy
from rows import Row, digest, options, picture, write

# The recordings of 2022-08-12, wherever below the path they lie, and what else their tables may be called.
FIT = [("20220812-061157-PM_measured.csv", "dpA_slow75s_train.csv"), ("20220812-060329-PM_measured.csv", "dpA_fast1_train.csv")]
TEST = [("20220812-060143-PM_measured.csv", "dpA_fast2_test.csv"), ("20220812-060245-PM_measured.csv", "dpA_fast3_test.csv")]
TITLES = ["slow, 75 s", "fast 1", "fast 2", "fast 3"]
CUTOFF_HZ = 8.0

Floats = numpy.ndarray[Any, numpy.dtype[numpy.float64]]


def found_at(folder: Path, names: tuple[str, str]) -> Path:
    """A recording by one of its names."""
    for name in names:
        for path in sorted(folder.rglob(name)):
            return path
    raise SystemExit(f"{folder} has neither {names[0]} nor {names[1]}")


def read(path: Path) -> dict[str, Floats]:
    """Time, torques and positions: by name, or (in the repository) in the order t, two positions, two speeds, two torques."""
    table = numpy.genfromtxt(path, delimiter=",", names=True)
    names = table.dtype.names or ()
    order = ["t", "tau_1", "tau_2", "q_1", "q_2"] if "tau_1" in names else [names[column] for column in (0, 5, 6, 1, 2)]
    return dict(zip(["t", "tau0", "tau1", "q0", "q1"], (table[name] for name in order), strict=True))


def torque_errors(model: dynid.Model, logs: dynid.Experiment, role: str) -> list[tuple[str, int, float]]:
    """Root mean square of the torque error over that of the torque [%], of every joint of every run."""
    runs = dynid.compare(model, logs).json()["runs"]
    return [(run["file"], joint["joint"], joint["torque_percent"]) for run in runs if run["role"] == role for joint in run["joints"]]


def main() -> None:
    parser = options(__doc__ or "", "a folder with the recordings, e.g. a clone of the repository")
    parser.add_argument("--rounds", type=int, default=2, help="how many effects are looked for, one after the other")
    arguments = parser.parse_args()
    files = [found_at(arguments.path, names) for names in FIT + TEST]
    robot = dynid.devices["double_pendulum"]
    logs = dynid.Experiment(robot)
    for title, path in zip(TITLES, files, strict=True):
        role = "fit" if TITLES.index(title) < len(FIT) else "validate"
        logs.add(read(path), role=role, label=title, free=[0, 1], cutoff_hz=CUTOFF_HZ)  # type: ignore[arg-type]

    published = robot.model()  # with the values of model_2.0
    fixed = published.remove("coulomb", 0).remove("coulomb", 1)
    without = dynid.fit(fixed, logs, error="torque").model
    fitted = dynid.fit(published, logs, error="torque").model
    models, said, now = {"the structure without dry friction": without}, [], without
    for _ in range(arguments.rounds):
        found = dynid.diagnose(now, logs, error="torque", depth=1)
        said.append(f"`diagnose`: {' '.join(found.sentences)}")
        effect = found.best.effect
        now = dynid.fit(found.best.add(), logs, error="torque").model
        models[f"and `{effect.id}` at joint {effect.joint}, its best candidate"] = now
    models["the published structure, fitted"] = fitted

    theirs = torque_errors(published, logs, "validate")
    rows = []
    for name, model in models.items():
        for (run, joint, value), (_, _, own) in zip(theirs, torque_errors(model, logs, "validate"), strict=True):
            rows.append(Row(f"{run}, joint {joint}: {name}", "%", value, own))
    rows += [Row(f"{name}", "N m", published[name], fitted[name], is_error=False) for name in fitted.names if name.endswith("Fc")]
    panels = [[own for own in dynid.compare(model, logs).overlays if own.quantity == "torque"] for model in (without, now)]
    shown = [next(own for own in panel if TITLES[2] in own.title) for panel in panels]
    curves = [("measured", shown[0].t, shown[0].measured)]
    curves += [(name, own.t, own.model) for name, own in zip(("without dry friction", "with what is named"), shown, strict=True)]
    picture(arguments.readme, "double_pendulum", shown[0].title, "torque [N m]", curves)
    write(arguments.readme, "double-pendulum", rows, said, digest(files))


if __name__ == "__main__":
    main()
