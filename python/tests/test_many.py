"""The command line from Python, and the same work on many experiments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pandas
import pytest

from dynid import many

FIT = ["fit", "{experiment}", "--model", "believed.toml", "--out", "{out}.toml"]


@pytest.fixture
def folder(tour: Path, tmp_path: Path) -> Path:
    """The tour's logs and a table of four nights, all of these logs."""
    for path in tour.iterdir():
        if path.is_file():
            (tmp_path / path.name).write_bytes(path.read_bytes())
    nights = pandas.DataFrame({"robot": ["a", "a", "b", "b"], "night": [1, 2, 1, 2], "experiment": "experiment.toml"})
    assert many.make(nights, FIT, "jobs", tmp_path) == 4
    return tmp_path


def content(folder: Path) -> dict[str, str]:
    """Results by name; where they lie is no part of them."""
    return {path.name: path.read_text().replace(f"{folder.name}/", "") for path in folder.iterdir()}


def test_the_command_line_is_that_of_the_program(folder: Path) -> None:
    words = ["compare", "experiment.toml", "--model", "believed.toml", "--json"]
    ran = subprocess.run([sys.executable, "-m", "dynid", *words], cwd=folder, capture_output=True, text=True, check=True)
    expected = subprocess.run([os.environ["DYNID"], *words], cwd=folder, capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout) == json.loads(expected.stdout)
    wrong = subprocess.run([sys.executable, "-m", "dynid", "compare", "nowhere.toml"], cwd=folder, capture_output=True, check=False)
    assert wrong.returncode == 2 and b"nowhere.toml" in wrong.stderr


def test_wherever_jobs_are_done_they_come_to_the_same(folder: Path) -> None:
    told: list[tuple[int, int]] = []
    assert many.run("jobs", "here", folder=folder) == many.Done(4, 4, [], 0)
    with ProcessPoolExecutor(2) as pool:
        done = many.run("jobs", "pool", on=pool, folder=folder, progress=lambda done, of: told.append((done, of)))
    assert done == many.Done(4, 4, [], 0) and told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert content(folder / "here") == content(folder / "pool")
    # What is done is done.
    assert many.run("jobs", "pool", on="ray", folder=folder) == done if has_ray() else True

    frame = many.estimates(folder / "here")
    assert set(frame["robot"]) == {"a", "b"} and (frame.groupby(["robot", "night"]).size() == 6).all()
    assert many.dataset(folder / "here", folder / "estimates") == len(frame)
    assert many.dataset(folder / "here", folder / "estimates") == 0
    pandas.testing.assert_frame_equal(pandas.read_parquet(folder / "estimates"), frame, check_dtype=False)
    changed = many.fleet(folder / "here", page=folder / "fleet.html")
    assert changed["events"] == [] and (folder / "fleet.html").is_file()


def has_ray() -> bool:
    try:
        import ray  # noqa: F401
    except ImportError:
        return False
    return True


@pytest.mark.skipif(not has_ray(), reason="ray is not installed")
def test_on_a_cluster(folder: Path) -> None:
    assert many.run("jobs", "here", folder=folder).done == 4
    assert many.run("jobs", "ray", on="ray", folder=folder) == many.Done(4, 4, [], 0)
    assert content(folder / "here") == content(folder / "ray")


def test_the_driver(folder: Path) -> None:
    pandas.DataFrame({"robot": ["a"], "night": [3], "experiment": "experiment.toml"}).to_parquet(folder / "nights.parquet")
    words = ["nights.parquet", "--jobs", "more", "--out", "driven", "--dataset", "found", "--", *FIT]
    ran = subprocess.run([sys.executable, "-m", "dynid.many", *words], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout == "1 of 1 jobs done, 0 failed, 0 left; results: driven\n"
    assert len(pandas.read_parquet(folder / "found")) == 6


def test_what_fails_is_told(folder: Path) -> None:
    with pytest.raises(many.Error, match="unknown column `nihgt`"):
        many.make({"night": [1]}, ["fit", "{nihgt}"], "jobs", folder)
    with pytest.raises(ValueError, match="expected 'here', 'ray' or an executor"):
        many.run("jobs", "results", on="elsewhere", folder=folder)
