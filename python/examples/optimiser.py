"""An optimiser of scipy on our residuals and Jacobian reaches the optimum of our fit."""

import tempfile
from pathlib import Path

import dynid
from scipy.optimize import least_squares


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    dynid.tour(folder)
    logs = dynid.Experiment.load(folder / "experiment.toml")
    believed = dynid.Model.load(folder / "believed.toml")

    residuals = dynid.Residuals(believed, logs, error="position", substeps=4)
    found = least_squares(residuals, residuals.start, jac=residuals.jacobian, bounds=residuals.bounds, x_scale="jac", xtol=1e-14, ftol=1e-14)

    ours = dynid.fit(believed, logs, error="position", substeps=4)
    theirs = residuals.model(found.x)
    for own in ours.json()["parameters"]:
        print(f"{own['name']}: {own['value']:.6g} by dynid, {theirs[own['name']]:.6g} by scipy")


if __name__ == "__main__":
    main()
