"""Logs of a device, and what was free in each."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy

from dynid import _benchmark, _dynid, _html
from dynid._optional import needed

if TYPE_CHECKING:
    import pandas

Log: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any] | Any"
Role: TypeAlias = Literal["fit", "validate"]


@dataclass(frozen=True)
class RunInfo:
    """One log and what it is for."""

    label: str
    role: str
    free: list[int]
    samples: int
    seconds: float
    payload: str | None


class Experiment:
    """Logs of a device, and what was free in each."""

    def __init__(self, device: _dynid.Device) -> None:
        self._own = _dynid.Experiment(device)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, planned: bool = False) -> Experiment:
        """Reads an experiment file (TOML) with its logs; `planned` runs say where they start and have no measured positions."""
        made = cls.__new__(cls)
        made._own = _dynid.Experiment.load(os.fspath(path), planned)
        return made

    def add(
        self,
        log: Log,
        *,
        role: Role,
        free: Sequence[int] | None = None,
        columns: Mapping[str, str] | None = None,
        scale: Mapping[str, float] | None = None,
        label: str | None = None,
        turn: Mapping[str, float] | None = None,
        rows: tuple[int, int] | None = None,
        repeated_times: Literal["refuse", "skip"] | None = None,
        mask: str | None = None,
        hold: Literal["zero", "linear"] | None = None,
        moving: bool | None = None,
        payload: str | None = None,
        cutoff_hz: float | None = None,
        decimate: int | None = None,
        min_speed: Sequence[float] | None = None,
        from_s: float | None = None,
        first_half: float | None = None,
        controller: str | os.PathLike[str] | None = None,
        start: Sequence[float] | None = None,
        transmission: Mapping[str, Any] | None = None,
        sampling_time: float | None = None,
    ) -> Experiment:
        """Adds a run, and returns the experiment.

        `log` is a DataFrame, a dict of arrays, whatever hands out an Arrow stream, or the path of a file. Its columns are `t` [s], and for
        joint i `tau<i>` [N*m or N], `q<i>` [rad or m] and, where it is known, `ref<i>`; `columns` says where they have other names, `scale`
        what brings them to SI. `role` is "fit" for a run that parameters are fitted to, "validate" for one that models are judged by.
        Times become seconds, those with a date counted from the first row. Without `free`, the joints that move by more than noise are free.
        `turn` is a turn of an encoder that begins anew after each, `rows` the part of the log that counts, `hold` how torques go on between
        samples; the others are those of an experiment file.

        `log` may also be a data set of the package `nonlinear_benchmarks`, or a tuple of them, each of which becomes a run: column i of its `u`
        is `tau<i>`, column i of its `y` is `q<i>`. `sampling_time` [s] is for those that do not say theirs.
        """
        said: dict[str, Any] = {
            "role": role,
            "free": None if free is None else [int(joint) for joint in free],
            "columns": None if columns is None else dict(columns),
            "scale": _floats(scale),
            "turn": _floats(turn),
            "rows": None if rows is None else [int(row) for row in rows],
            "repeated_times": repeated_times,
            "mask": mask,
            "hold": hold,
            "moving": moving,
            "payload": payload,
            "cutoff_hz": None if cutoff_hz is None else float(cutoff_hz),
            "decimate": None if decimate is None else int(decimate),
            "min_speed": None if min_speed is None else [float(speed) for speed in min_speed],
            "from_s": None if from_s is None else float(from_s),
            "first_half": None if first_half is None else float(first_half),
            "controller": None if controller is None else os.path.abspath(os.fspath(controller)),
            "start": None if start is None else [float(position) for position in start],
            "transmission": None if transmission is None else dict(transmission),
        }
        sets = _benchmark.sets(log)
        if sets is not None:
            for own in sets:
                self._add(said, label or _benchmark.name(own), _benchmark.columns(own, sampling_time), None)
            return self
        if sampling_time is not None:
            raise _dynid.Error("sampling_time= is for data sets of nonlinear_benchmarks; other logs have a column `t`")
        path = os.fspath(log) if isinstance(log, (str, os.PathLike)) else None
        self._add(said, label or path, _columns(log) if path is None else None, path)
        return self

    def _add(self, said: Mapping[str, Any], label: str | None, columns: dict[str, Any] | None, path: str | None) -> None:
        settings = {"file": label or f"run {len(self) + 1}", **{key: value for key, value in said.items() if value is not None}}
        self._own.add(json.dumps(settings), columns, path)

    @property
    def device(self) -> _dynid.Device:
        """The mechanism."""
        return self._own.device

    @property
    def digest(self) -> str:
        """SHA-256 of every number that the runs hold."""
        return self._own.digest

    @property
    def runs(self) -> list[RunInfo]:
        """What the runs are."""
        return [RunInfo(*run) for run in self._own.runs()]

    def columns(self, run: int) -> dict[str, numpy.ndarray[Any, numpy.dtype[numpy.float64]]]:
        """A run's log in SI: `t`, `tau<i>`, `q<i>` and, where it has them, `ref<i>` and `mask`."""
        return self._own.given(run)[1]

    def frame(self, run: int) -> pandas.DataFrame:
        """The same as a DataFrame."""
        made: pandas.DataFrame = needed("pandas", "pandas", "a DataFrame", "use `columns`").DataFrame(self.columns(run))
        return made

    def __len__(self) -> int:
        return len(self._own.runs())

    def __repr__(self) -> str:
        return f"<dynid.Experiment of {self.device.id}: {len(self)} runs>"

    def _repr_html_(self) -> str:
        names = ["run", "role", "free", "samples", "s", "payload"]
        rows = [(own.label, own.role, own.free, own.samples, own.seconds, own.payload) for own in self.runs]
        return _html.titled(repr(self).strip("<>"), [], _html.table(names, rows))


def _floats(values: Mapping[str, float] | None) -> dict[str, float] | None:
    return None if values is None else {name: float(value) for name, value in values.items()}


def _columns(log: Any) -> dict[str, Any]:
    """The columns of numbers and times of a table."""
    if isinstance(log, Mapping):
        return {str(name): _seconds(values) for name, values in log.items()}
    # pandas hands out Arrow only where pyarrow is installed.
    if hasattr(log, "select_dtypes"):
        return {str(name): _numbers(column) for name, column in log.items() if column.dtype.kind in "biufmM"}
    if hasattr(log, "__arrow_c_stream__"):
        return _dynid.columns_of(log)
    raise _dynid.Error(
        f"a log of the type {type(log).__name__} is not understood; "
        "give a DataFrame, a dict of arrays, an Arrow table or the path of a file"
    )


def _numbers(column: Any) -> Any:
    return _seconds(column) if column.dtype.kind in "mM" else column.to_numpy(dtype=float, na_value=numpy.nan)


def _seconds(values: Any) -> Any:
    """Times in seconds, those with a date counted from the first, as in files; other values as they are."""
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    if kind not in ("m", "M"):
        return values
    times = numpy.asarray(values, dtype=f"{kind}8[ns]")
    if kind == "M":
        times = times - numpy.append(times[~numpy.isnat(times)], numpy.datetime64("NaT"))[0]
    return times / numpy.timedelta64(1, "s")
