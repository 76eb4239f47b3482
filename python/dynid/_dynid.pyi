"""What the compiled module holds; `dynid` exports what is meant for users."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal, TypeAlias, final

import numpy
import numpy.typing
import pandas

from dynid import _experiment

Floats: TypeAlias = numpy.ndarray[Any, numpy.dtype[numpy.float64]]
Numbers: TypeAlias = numpy.typing.ArrayLike
Listener: TypeAlias = Callable[[str], object] | None
Path: TypeAlias = str | os.PathLike[str]

__version__: str

class Error(Exception):
    """What went wrong, where, and what to do, in one sentence."""

@final
class Device:
    """A mechanism: its joints, links and default effects."""

    @staticmethod
    def load(path: Path) -> Device:
        """Reads a device file (TOML)."""
    @staticmethod
    def from_urdf(path: Path, *, end_point: str | None = None) -> Device:
        """Turns a URDF (or an MJCF) into a device; `notes` say what was guessed."""
    @staticmethod
    def from_toml(text: str, path: Path) -> Device:
        """The device of the text of a device file that is to lie at `path`."""
    @staticmethod
    def _shipped(id: str) -> Device: ...
    def save(self, path: Path | None = None, *, overwrite: bool = False) -> Device:
        """Writes the device file, without a path where it is to lie; model files name their device by it."""
    def as_toml(self) -> str:
        """The text of its file."""
    @property
    def id(self) -> str:
        """Its name."""
    @property
    def title(self) -> str:
        """What it is, in a line."""
    @property
    def joints(self) -> list[str]:
        """Titles of its joints, by index."""
    @property
    def notes(self) -> list[str]:
        """What an import guessed, changed or left out."""
    def kernel(self, free: Sequence[int] | None = None, *, locked: Numbers | None = None) -> Kernel:
        """The equations of motion of the joints `free` (all where it is left out), the others standing at `locked`."""
    def model(self) -> Model:
        """The default model."""
    def __hash__(self) -> int: ...

@final
class Effect:
    """An effect of the library, the joint that it acts on, and values of its parameters by their symbols."""

    def __init__(self, id: str, joint: int | None = None, from_: int | None = None, **values: float) -> None: ...
    @property
    def id(self) -> str:
        """Its name in the library."""
    @property
    def joint(self) -> int | None:
        """The joint that it acts on."""
    @property
    def from_(self) -> int | None:
        """The other joint of a pair."""
    @property
    def values(self) -> dict[str, float]:
        """Values by symbols, as far as they were said."""

@final
class Model:
    """A device, the effects that it is believed to have, and parameter values. It never changes; calls return another."""

    def __init__(self, device: Device, effects: Sequence[Effect] | None = None) -> None:
        """With these effects and no others; without, with the device's default ones."""
    @staticmethod
    def load(path: Path, *, clip: bool = False) -> Model:
        """Reads a model file; `clip` puts values outside their bounds on the nearest one."""
    @staticmethod
    def from_toml(device: Device, text: str) -> Model:
        """Reads the text of a model file of `device`."""
    def save(self, path: Path, *, overwrite: bool = False) -> None:
        """Writes the model file."""
    def as_toml(self) -> str:
        """The text of its file."""
    @property
    def device(self) -> Device:
        """The mechanism."""
    @property
    def effects(self) -> list[Effect]:
        """The effects with all their values."""
    @property
    def notes(self) -> list[str]:
        """What a person should know about its file."""
    @property
    def digest(self) -> str:
        """SHA-256 of every parameter."""
    @property
    def names(self) -> list[str]:
        """Names of all parameters."""
    @property
    def parameters(self) -> pandas.DataFrame:
        """Value, bounds, unit and standard error of every parameter, by its name."""
    def __getitem__(self, name: str) -> float:
        """The value of a parameter."""
    def __contains__(self, name: object) -> bool:
        """Whether a parameter has this name."""
    def __iter__(self) -> Iterator[str]:
        """Over the names of all parameters."""
    def with_values(self, values: Mapping[str, float]) -> Model:
        """The model with other values of some parameters, within their bounds."""
    def fix(self, names: Sequence[str], fixed: bool = True) -> Model:
        """The model in which some parameters keep their values in fits, or are let go with `fixed=False`."""
    def add(self, effect: Effect) -> Model:
        """The model with an effect more, where it does nothing yet but for the values that are said."""
    def remove(self, id: str, joint: int | None = None, from_: int | None = None) -> Model:
        """The model without an effect."""
    def kernel(self, free: Sequence[int] | None = None, *, locked: Numbers | None = None) -> Kernel:
        """The equations of the rigid body with the model's values."""
    def _rows(self) -> list[tuple[Any, ...]]: ...
    def _repr_html_(self) -> str: ...
    __hash__: None  # type: ignore[assignment]

@final
class Kernel:
    """The equations of motion of a rigid body, some of whose joints are free.

    Arrays have any shape whose last axis is that of the free joints, ascending; one state alone is an array of one axis. Friction and other
    effects of a model are not in them.
    """

    @property
    def free(self) -> list[int]:
        """The free joints, ascending."""
    def forward_dynamics(self, q: Numbers, dq: Numbers, tau: Numbers) -> Floats:
        """Accelerations: `D^-1 (tau - h)`."""
    def forward_dynamics_derivatives(self, q: Numbers, dq: Numbers, tau: Numbers) -> tuple[Floats, Floats, Floats, Floats]:
        """Accelerations and their derivatives by q, dq and tau."""
    def inverse_dynamics(self, q: Numbers, dq: Numbers, ddq: Numbers) -> Floats:
        """Torques: `D ddq + h`."""
    def inverse_dynamics_derivatives(self, q: Numbers, dq: Numbers, ddq: Numbers) -> tuple[Floats, Floats, Floats, Floats]:
        """Torques and their derivatives by q, dq and ddq."""
    def mass_matrix(self, q: Numbers) -> Floats:
        """Inertia matrices D."""
    def gravity(self, q: Numbers) -> Floats:
        """Torques of gravity."""
    def bias(self, q: Numbers, dq: Numbers) -> Floats:
        """Torques without acceleration: `h = C dq + gravity`."""

@final
class Residuals:
    """What a fit makes small, as a function of all unknowns, for optimisers such as `scipy.optimize.least_squares`.

    Half the sum of the squares is the cost of the fit, with its weak prior. The unknowns are the parameters that the model does not fix and,
    for the position error, where each run starts. The runs are those whose role is "fit".
    """

    def __init__(
        self,
        model: Model,
        experiment: _experiment.Experiment,
        error: Literal["position", "torque"] = "position",
        *,
        free: Sequence[int] | None = None,
        substeps: int | None = None,
    ) -> None: ...
    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
    @property
    def start(self) -> Floats:
        """The model's values, and where the logs begin."""
    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest values."""
    def __call__(self, x: Numbers) -> Floats:
        """The residuals at `x`; infinite where the logs cannot be simulated."""
    def jacobian(self, x: Numbers) -> Floats:
        """Their derivatives at `x`, one row a residual."""
    def model(self, x: Numbers) -> Model:
        """The model with the parameters of `x`."""

@final
class Experiment:
    def __init__(self, device: Device) -> None: ...
    @staticmethod
    def load(path: str, planned: bool) -> Experiment: ...
    def add(self, settings: str, columns: dict[str, Any] | None, path: str | None) -> None: ...
    @property
    def device(self) -> Device: ...
    @property
    def digest(self) -> str: ...
    def runs(self) -> list[tuple[str, str, list[int], int, float, str | None]]: ...
    def given(self, run: int) -> tuple[str, dict[str, Floats]]: ...

def add_effects(folder: Path) -> None:
    """Adds the effect files of a folder to the library; to be called before anything else."""

def tour(folder: Path, *, overwrite: bool = False) -> None:
    """Writes the logs and the model that `dynid tour` starts from into a folder."""

def main(arguments: list[str], again: list[str]) -> int: ...
def shipped() -> list[str]: ...
def columns_of(table: Any) -> dict[str, Floats]: ...
def names_in(path: str) -> list[str]: ...
def fit(
    model: Model,
    experiment: Experiment,
    *,
    error: str | None,
    free: list[int] | None,
    method: str | None,
    weights: str,
    only: list[str],
    starts: int,
    seed: int,
    from_s: float | None,
    first_half: float | None,
    substeps: int | None,
    iterations: int | None,
    checkpoint: str | None,
    resume: bool,
    progress: Listener,
) -> tuple[Model, bool, str]: ...
def compare(
    model: Model, experiment: Experiment, *, free: list[int] | None, progress: Listener
) -> tuple[str, list[dict[str, Any]]]: ...
def diagnose(
    model: Model, experiment: Experiment, *, free: list[int] | None, error: str | None, depth: int | None, progress: Listener
) -> tuple[str, Model | None, Model | None]: ...
def ladder(
    models: list[tuple[str, Model]], experiment: Experiment, *, free: list[int] | None, progress: Listener
) -> str: ...
def report(
    models: list[tuple[str, Model]],
    experiment: Experiment,
    path: str,
    *,
    diagnosis: str | None,
    overwrite: bool,
    progress: Listener,
) -> list[str]: ...
def check(model: Model, experiment: Experiment, *, free: list[int] | None) -> tuple[str, str]: ...
def simulate(model: Model, experiment: Experiment, *, substeps: int | None, progress: Listener) -> list[dict[str, Any]]: ...
