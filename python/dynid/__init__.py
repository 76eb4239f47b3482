"""Identify the dynamics of a robot from logs: parameters, and which physical effect a model lacks.

    robot = dynid.Device.from_urdf("robot.urdf")     # or Device.load("robot.toml"), dynid.devices["freedom6s"]
    logs = dynid.Experiment(robot)
    logs.add(frame, role="fit")                       # a DataFrame, a dict of arrays, an Arrow table or a path
    fitted = dynid.fit(dynid.Model(robot), logs)
    found = dynid.diagnose(fitted.model, logs)
    better = dynid.fit(found.best.add(), logs)

What is wrong is a `dynid.Error` that says where and what to do. Units are SI throughout: rad or m, N*m or N, s, kg.
"""

from dynid._devices import devices
from dynid._dynid import Device, Effect, Error, Kernel, Model, Residuals, __version__, add_effects, tour
from dynid._experiment import Experiment, RunInfo
from dynid._results import Candidate, Checked, Compared, Diagnosis, Fitted, Ladder, Overlay, Result, Simulated
from dynid._verbs import check, compare, diagnose, fit, ladder, report, simulate

__all__ = [
    "Candidate",
    "Checked",
    "Compared",
    "Device",
    "Diagnosis",
    "Effect",
    "Error",
    "Experiment",
    "Fitted",
    "Kernel",
    "Ladder",
    "Model",
    "Overlay",
    "Residuals",
    "Result",
    "RunInfo",
    "Simulated",
    "__version__",
    "add_effects",
    "check",
    "compare",
    "devices",
    "diagnose",
    "fit",
    "ladder",
    "report",
    "simulate",
    "tour",
]
