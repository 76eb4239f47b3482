"""What the calls find: objects on the JSON that the program prints."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy

from dynid import _dynid, _html, _plots
from dynid._frames import frame

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from dynid._experiment import Experiment
    from dynid._progress import Progress

Floats = numpy.ndarray[Any, numpy.dtype[numpy.float64]]


class Result:
    """Something that was found, as the JSON of the program with the same verb."""

    def __init__(self, text: str) -> None:
        self._json: dict[str, Any] = json.loads(text)

    def json(self) -> dict[str, Any]:
        """All of it."""
        return self._json

    def _sentences(self) -> list[str]:
        return []

    def __repr__(self) -> str:
        said = " ".join(self._sentences())
        return f"<dynid.{type(self).__name__}: {said}>"


class Fitted(Result):
    """A fit: the model with its values, and how sure they are."""

    def __init__(self, experiment: Experiment, found: tuple[_dynid.Model, bool, str]) -> None:
        self._model, self._is_minimum, text = found
        self._experiment = experiment
        super().__init__(text)

    @property
    def model(self) -> _dynid.Model:
        """The fitted model."""
        if not self._is_minimum:
            raise _dynid.Error(
                f"the fit did not end at a minimum ({self.status}); start from other values, or allow more iterations (iterations=)"
            )
        return self._model

    @property
    def status(self) -> str:
        """How it ended."""
        return str(self._json["status"])

    @property
    def cost(self) -> float | None:
        """What was made small, at the end."""
        cost: float | None = self._json["cost_after"]
        return cost

    @property
    def parameters(self) -> pandas.DataFrame:
        """Start, value and standard error of every parameter that was fitted."""
        columns = ["name", "unit", "start", "value", "std_error", "identifiable", "at_bound"]
        rows = [[own.get(column) for column in columns] for own in self._json["parameters"]]
        return frame(rows, columns, 'use `.json()["parameters"]`').set_index("name")

    def compare(self, experiment: Experiment | None = None, *, progress: Progress = None) -> Compared:
        """How far the fitted model is from logs; from its own where none are given."""
        from dynid._verbs import compare

        return compare(self.model, self._experiment if experiment is None else experiment, progress=progress)

    def plot(self) -> Figure:
        """How far each value moved, with its standard error."""
        return _plots.parameters(self._json["parameters"])

    def _sentences(self) -> list[str]:
        return [f"{self._json['error']} error, {self.status} after {self._json['iterations']} iterations, cost {self.cost}"]

    def _repr_html_(self) -> str:
        columns = ["name", "unit", "start", "value", "std_error", "at_bound"]
        rows = [[own.get(column) for column in columns] for own in self._json["parameters"]]
        return _html.titled("Fitted", self._sentences(), _html.table(columns, rows))


@dataclass(frozen=True)
class Overlay:
    """Measured and model of one quantity of one joint of one run."""

    title: str
    quantity: str
    unit: str
    noise: float | None
    t: Floats
    measured: Floats
    model: Floats


class Compared(Result):
    """How far a model is from logs, and where."""

    def __init__(self, found: tuple[str, list[dict[str, Any]]]) -> None:
        super().__init__(found[0])
        self.overlays = [Overlay(**panel) for panel in found[1]]

    @property
    def rmse_fit(self) -> float | None:
        """Root mean square of the position error of the runs fitted to [rad or m]."""
        rmse: float | None = self._json["rmse_fit"]
        return rmse

    @property
    def rmse_validate(self) -> float | None:
        """The same of the held-out runs."""
        rmse: float | None = self._json["rmse_validate"]
        return rmse

    @property
    def joints(self) -> pandas.DataFrame:
        """The errors of every joint of every run."""
        columns = ["run", "role", "joint", "rmse", "noise_floor", "max_abs", "fit_percent", "white", "torque_rmse", "torque_percent"]
        return frame(self._rows(columns), columns, 'use `.json()["runs"]`')

    @property
    def findings(self) -> list[str]:
        """What the errors follow and where they lie, the most telling first."""
        return [f"{own['run']}, joint {own['joint']}: {own['what']}" for own in self._json["where"]]

    def plot(self, quantity: str = "position") -> Figure:
        """Measured and model of every run and joint: of "position" or of "torque"."""
        return _plots.overlays([panel for panel in self.overlays if panel.quantity == quantity])

    def _rows(self, columns: Sequence[str]) -> list[list[Any]]:
        rows = []
        for run in self._json["runs"]:
            of_run = {"run": run["file"], "role": run["role"]}
            rows += [[{**joint, **of_run}.get(column) for column in columns] for joint in run["joints"]]
        return rows

    def _sentences(self) -> list[str]:
        return [f"position error {self.rmse_fit} RMS of the runs fitted to, {self.rmse_validate} of the held-out runs"]

    def _repr_html_(self) -> str:
        columns = ["run", "role", "joint", "rmse", "noise_floor", "fit_percent", "torque_percent"]
        table = _html.table(columns, self._rows(columns))
        return _html.titled("Compared", self._sentences() + self.findings[:5], table)


class Candidate:
    """An effect that a model may lack, at its place."""

    def __init__(self, base: _dynid.Model, found: dict[str, Any]) -> None:
        self._base = base
        self._json = found

    @property
    def effect(self) -> _dynid.Effect:
        """Which, and where."""
        return _dynid.Effect(self._json["effect"], self._json.get("joint"), self._json.get("from"))

    @property
    def delta_bic(self) -> float:
        """Change of the Bayesian information criterion: below 0 the effect is worth its parameters."""
        return float(self._json["delta_bic"])

    def json(self) -> dict[str, Any]:
        """All that is known of it."""
        return self._json

    def add(self) -> _dynid.Model:
        """The model that was diagnosed with this effect more, where it does nothing yet; a fit finds its values."""
        return self._base.add(self.effect)

    def __repr__(self) -> str:
        return f"<dynid.Candidate {self.effect!r}>"


class Diagnosis(Result):
    """Which effect a model lacks, how sure that is, and what else it could be."""

    def __init__(
        self, model: _dynid.Model, experiment: Experiment, found: tuple[str, _dynid.Model | None, _dynid.Model | None]
    ) -> None:
        super().__init__(found[0])
        self.model = model
        self._experiment = experiment
        self.better = found[2]
        """The model with all effects that it lacked, fitted; `None` where it lacks none."""

    @property
    def verdict(self) -> str:
        """What the diagnosis comes to."""
        return str(self._json["verdict"])

    @property
    def sentences(self) -> list[str]:
        """The same for people."""
        return list(self._json["sentences"])

    @property
    def candidates(self) -> list[Candidate]:
        """Effects that explain what is left, the best first."""
        return [Candidate(self.model, found) for found in self._json["ranking"]]

    @property
    def best(self) -> Candidate:
        """The first of them."""
        if not self._json["ranking"]:
            raise _dynid.Error(f"no effect explains what is left: {' '.join(self.sentences)}")
        return self.candidates[0]

    @property
    def ranking(self) -> pandas.DataFrame:
        """The candidates as a table."""
        columns = [
            "effect",
            "joint",
            "from",
            "delta_bic",
            "rmse_validate_before",
            "rmse_validate_after",
            "torque_percent_before",
            "torque_percent_after",
        ]
        rows = [[own.get(column) for column in columns] for own in self._json["ranking"]]
        return frame(rows, columns, "use `.candidates`")

    def plot(self) -> Figure:
        """How much each candidate is worth."""
        names = [repr(own.effect).removeprefix("dynid.Effect") for own in self.candidates]
        return _plots.bars(names, [-own.delta_bic for own in self.candidates], "worth (minus the change of BIC)")

    def _sentences(self) -> list[str]:
        return self.sentences

    def _repr_html_(self) -> str:
        columns = ["effect", "joint", "from", "delta_bic", "rmse_validate_before", "rmse_validate_after"]
        rows = [[own.get(column) for column in columns] for own in self._json["ranking"]]
        return _html.titled("Diagnosis", self.sentences, _html.table(columns, rows))


class Ladder(Result):
    """Models of a lineage on the same runs."""

    def __init__(self, models: list[tuple[str, _dynid.Model]], experiment: Experiment, text: str) -> None:
        super().__init__(text)
        self._models = models
        self._experiment = experiment

    @property
    def rungs(self) -> pandas.DataFrame:
        """A row a model."""
        columns = ["model", "rmse_fit", "rmse_validate", "torque_percent_fit", "torque_percent_validate", "free_parameters", "bic", "delta_bic"]
        rows = [[own.get(column) for column in columns] for own in self._json["rungs"]]
        return frame(rows, columns, 'use `.json()["rungs"]`')

    def plot(self) -> Figure:
        """How the error falls."""
        return _plots.ladder(self._json["rungs"], self._json["noise_floor"])

    def _sentences(self) -> list[str]:
        return [f"{own['model']}: {own['rmse_validate']} rad or m RMS of the held-out runs." for own in self._json["rungs"]]

    def _repr_html_(self) -> str:
        columns = ["model", "rmse_fit", "rmse_validate", "torque_percent_fit", "torque_percent_validate", "bic"]
        rows = [[own.get(column) for column in columns] for own in self._json["rungs"]]
        return _html.titled("Ladder", [], _html.table(columns, rows))


class Checked(Result):
    """What logs cannot answer, and what looks wrong in them."""

    def __init__(self, found: tuple[str, str]) -> None:
        self.sentence, text = found
        """The verdict, for people."""
        super().__init__(text)

    @property
    def verdict(self) -> str:
        """The verdict."""
        return str(self._json["verdict"])

    def _sentences(self) -> list[str]:
        return [self.sentence]

    def _repr_html_(self) -> str:
        return _html.titled("Checked", self._sentences())


@dataclass(frozen=True)
class Simulated:
    """What a model shows of a run."""

    file: str
    free: list[int]
    t: Floats
    """Time of each sample (s)."""
    q: Floats
    """Positions of the free joints, one row a sample [rad or m]."""
    tau: Floats
    """Commanded torques of all joints, one row a sample [N*m or N]."""
    integration: Floats
    """How far shorter integration steps move each free joint at most [rad or m]."""
    rmse: Floats | None
    """Root mean square off the log of each free joint [rad or m]; `None` for a run that is only planned."""
