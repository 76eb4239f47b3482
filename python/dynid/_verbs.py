"""The calls of the library."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Literal, TypeAlias

from dynid import _dynid
from dynid._experiment import Experiment
from dynid._progress import Progress, told
from dynid._results import Candidate, Checked, Compared, Diagnosis, Fitted, Ladder, Simulated
from dynid._words import listed

ErrorSignal: TypeAlias = Literal["prediction", "position", "torque", "both"]
ModelOrFit: TypeAlias = "_dynid.Model | Fitted"
Of: TypeAlias = "_dynid.Model | Fitted | Candidate | Ladder | Diagnosis"


def fit(
    model: ModelOrFit,
    experiment: Experiment,
    *,
    error: ErrorSignal | None = None,
    free: Sequence[int] | None = None,
    method: str | None = None,
    weights: Literal["noise", "method"] = "noise",
    only: Sequence[str] = (),
    starts: int = 1,
    seed: int = 0,
    from_s: float | None = None,
    first_half: float | None = None,
    substeps: int | None = None,
    iterations: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Progress = None,
) -> Fitted:
    """Fits the parameters of a model, or of what a fit found, to the runs whose role is "fit".

    What is made small is, without `error`, the likelihood of one-step predictions; of what is fixed in the model, nothing moves. `free` takes
    only the runs with just these joints free, `only` names the parameters that move, with `*` for any text. With `checkpoint`, a file, a fit
    that Ctrl-C stopped goes on with `resume=True`, to the same bits.
    """
    with told(progress, "fit") as listener:
        found = _dynid.fit(
            _model(model),
            experiment._own,
            error=error,
            free=None if free is None else list(free),
            method=method,
            weights=weights,
            only=listed(only),
            starts=starts,
            seed=seed,
            from_s=from_s,
            first_half=first_half,
            substeps=substeps,
            iterations=iterations,
            checkpoint=None if checkpoint is None else os.fspath(checkpoint),
            resume=resume,
            progress=listener,
        )
    return Fitted(experiment, found)


def compare(
    model: ModelOrFit, experiment: Experiment, *, free: Sequence[int] | None = None, progress: Progress = None
) -> Compared:
    """Says how far a model is from logs, and where."""
    with told(progress, "compare") as listener:
        return Compared(_dynid.compare(_model(model), experiment._own, free=None if free is None else list(free), progress=listener))


def diagnose(
    model: ModelOrFit,
    experiment: Experiment,
    *,
    free: Sequence[int] | None = None,
    error: ErrorSignal | None = None,
    depth: int | None = None,
    progress: Progress = None,
) -> Diagnosis:
    """Says which effect of the library a model lacks, at which joint, how sure that is, and what else it could be.

    `depth` is how many effects are looked for, one after the other; without it, as many as it pays.
    """
    model = _model(model)
    with told(progress, "diagnose") as listener:
        joints = None if free is None else list(free)
        found = _dynid.diagnose(model, experiment._own, free=joints, error=error, depth=depth, progress=listener)
    return Diagnosis(model, experiment, found)


def ladder(
    models: Sequence[ModelOrFit],
    experiment: Experiment,
    *,
    names: Sequence[str] | None = None,
    free: Sequence[int] | None = None,
    progress: Progress = None,
) -> Ladder:
    """Puts the models of a lineage, first to last, on the same runs: does what each step added pay for its parameters?"""
    named = _named([_model(own) for own in models], names)
    with told(progress, "ladder") as listener:
        text = _dynid.ladder(named, experiment._own, free=None if free is None else list(free), progress=listener)
    return Ladder(named, experiment, text)


def report(
    of: Sequence[Of],
    path: str | os.PathLike[str],
    *,
    experiment: Experiment | None = None,
    names: Sequence[str] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> list[str]:
    """Writes one page (HTML, opens with no network) with all that is known, and returns its verdict in sentences.

    `of` are fits, ladders and models, first to last, the last model being what the page is about, and a diagnosis, if there is one. Models of
    a ladder keep their names, unless `names` has one for each model. The logs are those of the fits, unless `experiment` says others.
    """
    models: list[tuple[str, _dynid.Model]] = []
    diagnosis = None
    for own in of:
        if isinstance(own, Diagnosis):
            diagnosis = json.dumps(own.json())
        else:
            rungs = own._models if isinstance(own, Ladder) else [("", own.add() if isinstance(own, Candidate) else _model(own))]
            for name, model in rungs:
                # No two have one name.
                models.append((name if name and name not in dict(models) else f"model {len(models) + 1}", model))
        experiment = experiment or (own._experiment if isinstance(own, (Fitted, Ladder, Diagnosis)) else None)
    if experiment is None:
        raise _dynid.Error("a report of models alone does not know their logs; say which: experiment=")
    named = models if names is None else _named([model for _, model in models], names)
    with told(progress, "report") as listener:
        return _dynid.report(named, experiment._own, os.fspath(path), diagnosis=diagnosis, overwrite=overwrite, progress=listener)


def check(model: ModelOrFit, experiment: Experiment, *, free: Sequence[int] | None = None) -> Checked:
    """Says what logs cannot answer, how to excite what is missing, and what looks wrong in them; nothing is fitted."""
    return Checked(_dynid.check(_model(model), experiment._own, free=None if free is None else list(free)))


def simulate(
    model: ModelOrFit, experiment: Experiment, *, substeps: int | None = None, progress: Progress = None
) -> list[Simulated]:
    """Plays the commanded torques of every run on a model."""
    with told(progress, "simulate") as listener:
        runs = _dynid.simulate(_model(model), experiment._own, substeps=substeps, progress=listener)
    return [Simulated(**run) for run in runs]


def _model(own: ModelOrFit) -> _dynid.Model:
    return own.model if isinstance(own, Fitted) else own


def _named(models: Sequence[_dynid.Model], names: Sequence[str] | None) -> list[tuple[str, _dynid.Model]]:
    given = listed(names) if names is not None else [f"model {number}" for number in range(1, len(models) + 1)]
    if len(given) != len(models):
        raise _dynid.Error(f"there are {len(given)} names for {len(models)} models; give one for each")
    return list(zip(given, models, strict=True))
