"""Silverbox, an electronic Duffing oscillator: simulation errors on the official test parts, without and with the cubic spring.

    python docs/proof/silverbox.py PATH/SNLS80mV.csv
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import dynid
import numpy
from rows import Row, digest, options, picture, write

RATE_HZ = 610.35
# The split of the package nonlinear_benchmarks 1.0.1, in rows of SNLS80mV; the first 50 samples of a test do not count.
TRAIN = (40650, 105712)
TESTS = {"multisine": (105712, 127400), "arrow": (100, 40575), "arrow, amplitudes of the training only": (100, 32100)}
START = 50
# SysIdentPy's book, section "Silver Box System": polynomial NARX, multisine part, simulated [mV].
PUBLISHED_MV = {"multisine": 7.728}
# freq-statespace, README at 111e780: errors of simulation on six multisine periods of the training part, over their standard deviation.
PUBLISHED_LINEAR, PUBLISHED_CUBIC = 13.17, 0.44
# What has no content above half the rate is the same in four times the samples, and straight lines between them come close to it.
FINER = 4
# What the diagnosis reads of the training part, and the part after it that it holds out.
DIAGNOSED = 8192

Floats = numpy.ndarray[Any, numpy.dtype[numpy.float64]]


def read(path: Path) -> tuple[Floats, Floats]:
    """Input and output [V], of SNLS80mV.csv (V1, V2) or of a table with time."""
    table = numpy.genfromtxt(path, delimiter=",", names=True)
    names = table.dtype.names or ()
    u, y = ("V1", "V2") if "V1" in names else ("tau_1", "q_1")
    return table[u], table[y]


def finer(values: Floats, times: int) -> Floats:
    """Band-limited samples in between: the part is mirrored at its ends, and its spectrum continued by zeros."""
    mirrored = numpy.concatenate([values, values[::-1]])
    spectrum = numpy.fft.rfft(mirrored)
    return numpy.fft.irfft(spectrum, len(mirrored) * times)[: len(values) * times] * times


def part(u: Floats, y: Floats, rows: tuple[int, int], times: int = 1) -> dict[str, Floats]:
    """The rows of a part as a log; volts stand for force and position."""
    force, position = (finer(values[rows[0] : rows[1]], times) for values in (u, y))
    return {"t": numpy.arange(len(force)) / (RATE_HZ * times), "tau0": force, "q0": position}


def errors(model: dynid.Model, u: Floats, y: Floats, tests: dict[str, tuple[int, int]], times: int) -> dict[str, float]:
    """RMS of measured less simulated [mV], of the original samples."""
    return {name: 1e3 * float(numpy.sqrt(numpy.mean(left[START:] ** 2))) for name, left in residuals(model, u, y, tests, times).items()}


def residuals(model: dynid.Model, u: Floats, y: Floats, tests: dict[str, tuple[int, int]], times: int) -> dict[str, Floats]:
    """Measured less simulated [V]."""
    found = {}
    for name, rows in tests.items():
        logs = dynid.Experiment(model.device)
        logs.add(part(u, y, rows, times), role="validate", label=name, moving=True, hold="linear")
        (run,) = dynid.simulate(model, logs)
        found[name] = y[rows[0] : rows[1]] - run.q[::times, 0]
    return found


def main() -> None:
    arguments = options(__doc__ or "", "SNLS80mV.csv of the benchmark's SilverboxFiles.zip").parse_args()
    u, y = read(arguments.path)
    scale = len(u) / 131072  # a made-up record is shorter
    rows = {name: (int(begin * scale), int(end * scale)) for name, (begin, end) in {"train": TRAIN, **TESTS}.items()}
    tests = {name: own for name, own in rows.items() if name != "train"}
    robot = dynid.devices["oscillator"]

    logs = dynid.Experiment(robot).add(part(u, y, rows["train"]), role="fit", moving=True, hold="linear")
    linear = dynid.fit(robot.model(), logs, error="position").model
    begin, some = rows["train"][0], int(DIAGNOSED * min(1.0, 4 * scale))
    short = dynid.Experiment(robot)
    short.add(part(u, y, (begin, begin + some)), role="fit", moving=True, hold="linear")
    short.add(part(u, y, (begin + some, begin + 2 * some)), role="validate", moving=True, hold="linear")
    found = dynid.diagnose(linear, short, depth=1)

    cubic = dynid.fit(linear.add(dynid.Effect("spring_cubic", 0)), logs, error="position").model
    fine = dynid.Experiment(robot).add(part(u, y, rows["train"], FINER), role="fit", moving=True, hold="linear")
    finest = dynid.fit(cubic, fine, error="position").model

    arrow = {"arrow": tests["arrow"]}
    end = slice(tests["arrow"][1] - int(600 * scale), tests["arrow"][1])  # the largest amplitudes
    t, measured = numpy.arange(end.start, end.stop) / RATE_HZ, y[end]
    curves = [("measured", t, measured)]
    for name, model, times in (("without the cubic spring", linear, 1), ("with it", finest, FINER)):
        curves.append((name, t, measured - residuals(model, u, y, arrow, times)["arrow"][-len(t) :]))
    picture(arguments.readme, "silverbox", "end of the arrow, simulated", "output [V]", curves)

    without, straight, best = errors(linear, u, y, tests, 1), errors(cubic, u, y, tests, 1), errors(finest, u, y, tests, FINER)
    trained = errors(finest, u, y, {"train": rows["train"]}, FINER)["train"] / (1e3 * float(numpy.std(y[slice(*rows["train"])])))
    plain = errors(linear, u, y, {"train": rows["train"]}, 1)["train"] / (1e3 * float(numpy.std(y[slice(*rows["train"])])))
    table = [Row(f"{name}: without the cubic spring", "mV", None, without[name]) for name in tests]
    table += [Row(f"{name}: with it", "mV", None, straight[name]) for name in tests]
    table += [Row(f"{name}: and four times the samples", "mV", PUBLISHED_MV.get(name), best[name]) for name in tests]
    table += [Row("training part, linear, of its standard deviation", "%", PUBLISHED_LINEAR, 100 * plain)]
    table += [Row("training part, cubic, of its standard deviation", "%", PUBLISHED_CUBIC, 100 * trained)]
    values = ", ".join(f"{name.split('.')[-1]} = {finest[name]:.4g}" for name in finest.names if "spring" in name or "viscous" in name)
    said = [f"`diagnose` of the linear model: {' '.join(found.sentences)}", f"fitted: {values}"]
    write(arguments.readme, "silverbox", table, said, digest([arguments.path]))


if __name__ == "__main__":
    main()
