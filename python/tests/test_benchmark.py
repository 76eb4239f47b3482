"""Data sets of nonlinear_benchmarks as logs: objects of its class where it is installed, and of one like it."""

from __future__ import annotations

import dynid
import numpy
import pytest

STEP = 0.01


class LikeTheirs:
    """What dynid looks for: the attributes of `nonlinear_benchmarks.Input_output_data`."""

    def __init__(self, u: object, y: object, sampling_time: float | None = None, name: str | None = None) -> None:
        self.u, self.y, self.sampling_time = u, y, sampling_time
        self.name = "" if name is None else name


def classes() -> list[type]:
    found: list[type] = [LikeTheirs]
    try:
        from nonlinear_benchmarks import Input_output_data
    except ImportError:
        return found
    return [*found, Input_output_data]


@pytest.fixture(params=classes(), ids=lambda own: own.__module__)
def kind(request: pytest.FixtureRequest) -> type:
    made: type = request.param
    return made


def sine(samples: int = 300) -> tuple[numpy.ndarray, numpy.ndarray]:
    t = numpy.arange(samples) * STEP
    return numpy.sin(5 * t), 0.1 * numpy.cos(5 * t)


def test_one_channel(kind: type) -> None:
    u, y = sine()
    robot = dynid.devices["oscillator"]
    plain = dynid.Experiment(robot).add({"t": numpy.arange(len(u)) * STEP, "tau0": u, "q0": y}, role="fit")
    for shape in [u.shape, (len(u), 1)]:
        logs = dynid.Experiment(robot).add(kind(u.reshape(shape), y.reshape(shape), STEP, "train"), role="fit")
        assert logs.digest == plain.digest
        assert (logs.runs[0].label, logs.runs[0].free, logs.runs[0].samples) == ("train", [0], 300)


def test_a_split_becomes_runs_with_their_roles(kind: type) -> None:
    u, y = sine()
    train, test = kind(u, y, STEP), (kind(u[:200], y[:200], STEP, "first"), kind(u[100:], y[100:], STEP, "second"))
    logs = dynid.Experiment(dynid.devices["oscillator"]).add(train, role="fit").add(test, role="validate", moving=True)
    assert [(run.label, run.role, run.samples) for run in logs.runs] == [
        ("run 1", "fit", 300),
        ("first", "validate", 200),
        ("second", "validate", 200),
    ]
    with pytest.raises(dynid.Error, match="pair of training and test data is two logs; add each with its role"):
        dynid.Experiment(dynid.devices["oscillator"]).add((train, test), role="fit")


def test_six_channels_that_do_not_say_their_step(kind: type) -> None:
    u, y = sine(606)
    robot, set_ = dynid.devices["staubli_tx40"], kind(numpy.tile(u[:, None], 6), numpy.tile(numpy.degrees(y)[:, None], 6))
    scale = {f"q{joint}": numpy.pi / 180 for joint in range(6)}
    logs = dynid.Experiment(robot).add([set_, set_], role="fit", sampling_time=0.1, scale=scale)
    assert [(run.free, run.samples) for run in logs.runs] == [(list(range(6)), 606)] * 2
    numpy.testing.assert_allclose(logs.columns(1)["q5"], y, rtol=1e-12)
    numpy.testing.assert_allclose(logs.columns(0)["t"][-1], 60.5)
    with pytest.raises(dynid.Error, match="does not say its sampling time; give it: sampling_time="):
        dynid.Experiment(robot).add(set_, role="fit")


def test_what_is_no_such_log() -> None:
    robot = dynid.devices["oscillator"]
    u, y = sine()
    with pytest.raises(dynid.Error, match="`u` of a data set has 3 axes"):
        dynid.Experiment(robot).add(LikeTheirs(u.reshape(-1, 1, 1), y, STEP), role="fit")
    with pytest.raises(dynid.Error, match="sampling_time= is for data sets"):
        dynid.Experiment(robot).add({"t": [0.0], "tau0": [0.0], "q0": [0.0]}, role="fit", sampling_time=STEP)
