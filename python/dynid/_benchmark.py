"""Data sets of the package `nonlinear_benchmarks`, known by their attributes, so that nobody needs the package."""

from __future__ import annotations

from typing import Any

import numpy

from dynid._dynid import Error


def sets(log: Any) -> list[Any] | None:
    """The data sets that a log is, or a tuple of them holds; `None` for a log of another kind."""
    if _is_set(log):
        return [log]
    if isinstance(log, (list, tuple)) and any(_is_set(own) for own in log):
        if not all(_is_set(own) for own in log):
            raise Error("a benchmark's pair of training and test data is two logs; add each with its role")
        return list(log)
    return None


def _is_set(log: Any) -> bool:
    return all(hasattr(log, name) for name in ("u", "y", "sampling_time"))


def columns(log: Any, sampling_time: float | None) -> dict[str, Any]:
    """Time from 0, inputs as `tau<i>` and outputs as `q<i>`."""
    step = log.sampling_time if sampling_time is None else sampling_time
    if step is None:
        raise Error(f"the data set {name(log) or log!r} does not say its sampling time; give it: sampling_time= [s]")
    inputs, outputs = _by_column("u", log.u), _by_column("y", log.y)
    made: dict[str, Any] = {"t": numpy.arange(len(inputs)) * float(step)}
    for symbol, values in (("tau", inputs), ("q", outputs)):
        made |= {f"{symbol}{column}": values[:, column] for column in range(values.shape[1])}
    return made


def _by_column(attribute: str, values: Any) -> Any:
    array = numpy.asarray(values, dtype=float)
    if array.ndim not in (1, 2):
        raise Error(f"`{attribute}` of a data set has {array.ndim} axes; it needs one, or two: samples and channels")
    return array.reshape(len(array), -1)


def name(log: Any) -> str | None:
    """What the data set is called."""
    return getattr(log, "name", None) or None

