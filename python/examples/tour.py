"""The loop from logs in memory to a named effect, on the logs of `dynid tour`."""

import tempfile
from pathlib import Path

import dynid
import pandas


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    dynid.tour(folder)

    robot = dynid.devices["freedom6s"]  # or Device.load("robot.toml"), Device.from_urdf("robot.urdf")
    logs = dynid.Experiment(robot)
    logs.add(pandas.read_csv(folder / "wrist-1.csv"), role="fit")
    logs.add(pandas.read_csv(folder / "wrist-2.csv"), role="fit")
    logs.add(pandas.read_csv(folder / "wrist-3.csv"), role="validate")

    fitted = dynid.fit(dynid.Model.load(folder / "believed.toml"), logs)
    found = dynid.diagnose(fitted.model, logs)
    print(found.sentences[-1])

    better = dynid.fit(found.best.add(), logs)
    for own in dynid.ladder([fitted, better], logs, names=["fitted", "better"]).json()["rungs"]:
        print(f"{own['model']}: {own['rmse_validate']:.3e} rad RMS on the held-out run")
    dynid.report([fitted, found, better], folder / "report.html")


if __name__ == "__main__":
    main()
