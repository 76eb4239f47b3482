"""The tour's logs, and what was found in them once for all tests."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import dynid
import numpy
import pandas
import pytest


ROLES: dict[str, str] = {"wrist-1.csv": "fit", "wrist-2.csv": "fit", "wrist-3.csv": "validate"}


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """A shell has what it starts in the background ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def tour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the tour's logs, experiment and believed model."""
    folder = tmp_path_factory.mktemp("tour")
    dynid.tour(folder)
    return folder


@pytest.fixture(scope="session")
def robot() -> dynid.Device:
    return dynid.devices["freedom6s"]


@pytest.fixture(scope="session")
def frames(tour: Path) -> dict[str, pandas.DataFrame]:
    """The logs by the names of their files, to the last bit, which pandas itself does not read in all its versions."""
    return {name: pandas.DataFrame(numpy.genfromtxt(tour / name, delimiter=",", names=True)) for name in ROLES}


@pytest.fixture
def logs(robot: dynid.Device, frames: dict[str, pandas.DataFrame]) -> dynid.Experiment:
    """The tour's experiment, from memory."""
    experiment = dynid.Experiment(robot)
    for name, frame in frames.items():
        experiment.add(frame, role=ROLES[name], label=name)  # type: ignore[arg-type]
    return experiment


@pytest.fixture(scope="session")
def believed(tour: Path) -> dynid.Model:
    return dynid.Model.load(tour / "believed.toml")


@pytest.fixture(scope="session")
def fitted(tour: Path, believed: dynid.Model) -> dynid.Fitted:
    return dynid.fit(believed, dynid.Experiment.load(tour / "experiment.toml"))


@pytest.fixture(scope="session")
def found(tour: Path, fitted: dynid.Fitted) -> dynid.Diagnosis:
    return dynid.diagnose(fitted.model, dynid.Experiment.load(tour / "experiment.toml"))
