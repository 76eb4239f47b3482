"""The loop from logs to a named effect, from memory and from files, and the same numbers as the program."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import dynid
import matplotlib
import pandas
import pytest

matplotlib.use("agg")

EFFECT = dynid.Effect("input_coupling", joint=4, from_=5)


def test_the_snippet_names_the_effect(tour: Path, robot: dynid.Device, frames: dict[str, pandas.DataFrame], tmp_path: Path) -> None:
    """As in README, on logs whose currents have another name and unit."""
    gain = 8.0
    logs = dynid.Experiment(robot)
    for name, frame in frames.items():
        frame = frame.rename(columns={"tau4": "current_4"}).assign(current_4=lambda own: own["current_4"] / gain)
        role = "validate" if name == "wrist-3.csv" else "fit"
        logs.add(frame, role=role, columns={"tau4": "current_4"}, scale={"tau4": gain})  # type: ignore[arg-type]
    effects = [
        dynid.Effect("gain", joint=4, Kp=7.15),
        dynid.Effect("spring", joint=4),
        dynid.Effect("viscous", joint=4),
        dynid.Effect("gain", joint=5, Kp=3.2),
        dynid.Effect("spring", joint=5),
        dynid.Effect("viscous", joint=5),
    ]
    model = dynid.Model(robot, effects=effects).fix(["joint.4.gain.Kp", "joint.5.gain.Kp"])
    fitted = dynid.fit(model.fix([name for name in model.names if name.startswith("link.")]), logs)
    fitted.compare(logs).plot()
    found = dynid.diagnose(fitted.model, logs)
    assert found.verdict == "missing_effect" and found.best.effect == EFFECT
    assert list(found.ranking["effect"])[0] == "input_coupling"
    better = dynid.fit(found.best.add(), logs)
    dynid.ladder([fitted.model, better.model], logs).plot()
    page = tmp_path / "report.html"
    assert any("input_coupling" in sentence for sentence in dynid.report([fitted, found, better], page))
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_logs_from_memory_are_those_of_the_file(tour: Path, logs: dynid.Experiment, believed: dynid.Model) -> None:
    file = dynid.Experiment.load(tour / "experiment.toml")
    assert logs.digest == file.digest and logs.runs == file.runs
    assert dynid.fit(believed, logs).json() == dynid.fit(believed, file).json()


def program() -> Path:
    """The program of the same build."""
    named = os.environ.get("DYNID")
    if not named:
        pytest.skip("DYNID names no program to compare with (`cargo xtask ci` does)")
    return Path(named)


def said_by_program(folder: Path, *arguments: str) -> dict[str, Any]:
    done = subprocess.run([program(), *arguments, "--json"], cwd=folder, capture_output=True, check=True, text=True)
    said: dict[str, Any] = json.loads(done.stdout)
    return {key: value for key, value in said.items() if key not in ("wall_seconds", "out")}


def test_the_program_says_the_same_to_the_last_bit(
    tour: Path, logs: dynid.Experiment, fitted: dynid.Fitted, found: dynid.Diagnosis
) -> None:
    said = said_by_program(tour, "fit", "experiment.toml", "--model", "believed.toml", "--out", "fitted.toml")
    assert said == fitted.json()
    assert (tour / "fitted.toml").read_text(encoding="utf-8") == fitted.model.as_toml()
    asked = ["experiment.toml", "--model", "fitted.toml"]
    assert said_by_program(tour, "compare", *asked) == fitted.compare(logs).json()
    assert said_by_program(tour, "check", "experiment.toml", "--model", "believed.toml")["verdict"] == "nothing_wrong"
    assert said_by_program(tour, "diagnose", *asked) == found.json()
    ladder = dynid.ladder([dynid.Model.load(tour / "believed.toml"), fitted.model], logs, names=["believed", "fitted"])
    assert said_by_program(tour, "ladder", "experiment.toml", "believed.toml", "fitted.toml") == ladder.json()


def test_a_simulation_follows_a_log(logs: dynid.Experiment, found: dynid.Diagnosis) -> None:
    assert found.better is not None
    for run, log in zip(dynid.simulate(found.better, logs), logs.runs, strict=True):
        assert (run.file, run.q.shape, run.tau.shape) == (log.label, (log.samples, 2), (log.samples, 6))
        assert run.rmse is not None and (run.rmse < 3e-4).all()


def test_a_check_finds_nothing_wrong(logs: dynid.Experiment, believed: dynid.Model) -> None:
    checked = dynid.check(believed, logs)
    assert checked.verdict == "nothing_wrong" and checked.sentence in repr(checked)


def test_results_show_themselves(logs: dynid.Experiment, fitted: dynid.Fitted, found: dynid.Diagnosis) -> None:
    compared = fitted.compare()
    ladder = dynid.ladder([fitted, found.best.add()], logs)
    for result in (fitted, compared, found, ladder, dynid.check(fitted.model, logs), logs, fitted.model):
        html = result._repr_html_()
        assert html.count("<div>") == html.count("</div>") == 1 and "None" not in html
    assert list(fitted.parameters.index) == [own["name"] for own in fitted.json()["parameters"]]
    assert fitted.model.parameters.loc["joint.4.gain.Kp", "fixed"]
    assert len(compared.joints) == 6 and len(ladder.rungs) == 2
    assert len(compared.plot().axes) == len(compared.plot("torque").axes) == 12
    for result in (fitted, found, ladder):
        assert result.plot().axes
