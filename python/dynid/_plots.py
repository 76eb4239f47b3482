"""Pictures by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy

from dynid._optional import needed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynid._results import Overlay


def _figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    pyplot = needed("matplotlib.pyplot", "matplotlib", "a picture", "take the numbers from `.json()`")
    figure, axes = pyplot.subplots(rows, columns, squeeze=False, figsize=size, layout="constrained")
    return figure, axes


def overlays(panels: Sequence[Overlay]) -> Figure:
    """Measured and model above, what is left below; twice the noise of the log as a band."""
    figure, axes = _figure(2 * max(len(panels), 1), 1, (9.0, 4.0 * max(len(panels), 1)))
    for index, panel in enumerate(panels):
        above, below = axes[2 * index][0], axes[2 * index + 1][0]
        above.plot(panel.t, panel.measured, color="0.75", linewidth=3, label="measured")
        above.plot(panel.t, panel.model, linewidth=1, label="model")
        above.set_title(panel.title)
        above.set_ylabel(f"{panel.quantity} [{panel.unit}]")
        above.legend(loc="upper right")
        if panel.noise is not None:
            below.axhspan(-2 * panel.noise, 2 * panel.noise, color="0.9")
        below.plot(panel.t, panel.measured - panel.model, linewidth=1)
        below.set_ylabel(f"left [{panel.unit}]")
        below.set_xlabel("t [s]")
    return figure


def ladder(rungs: Sequence[dict[str, Any]], noise: float | None) -> Figure:
    """How the error falls from model to model, on the runs fitted to and on those held out."""
    figure, axes = _figure(1, 1, (7.0, 4.0))
    axis = axes[0][0]
    places = range(len(rungs))
    for key, label in [("rmse_fit", "runs fitted to"), ("rmse_validate", "held-out runs")]:
        values = [numpy.nan if rung[key] is None else rung[key] for rung in rungs]
        axis.plot(places, values, marker="o", label=label)
    if noise is not None:
        axis.axhline(noise, color="0.5", linestyle="--", label="noise of the logs")
    axis.set_xticks(places, [rung["model"] for rung in rungs])
    axis.set_yscale("log")
    axis.set_ylabel("position error, RMS [rad or m]")
    axis.legend()
    return figure


def bars(names: Sequence[str], values: Sequence[float], label: str) -> Figure:
    """Named values as bars, the first on top."""
    figure, axes = _figure(1, 1, (7.0, 0.6 + 0.4 * max(len(names), 1)))
    axis = axes[0][0]
    axis.barh(range(len(names)), values)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlabel(label)
    return figure


def parameters(rows: Sequence[dict[str, Any]]) -> Figure:
    """Values of a fit over their starts, with standard errors, each in units of its start."""
    figure, axes = _figure(1, 1, (7.0, 0.6 + 0.3 * max(len(rows), 1)))
    axis = axes[0][0]
    sizes = [abs(row["start"]) or 1.0 for row in rows]
    values = [(row["value"] - row["start"]) / size for row, size in zip(rows, sizes, strict=True)]
    errors = [(row["std_error"] or 0.0) / size for row, size in zip(rows, sizes, strict=True)]
    axis.errorbar(values, range(len(rows)), xerr=errors, fmt="o")
    axis.axvline(0.0, color="0.7")
    axis.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axis.invert_yaxis()
    axis.set_xlabel("change, in sizes of the start")
    return figure
