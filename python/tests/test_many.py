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
    assert many.run("jobs", "here", folder=folder, progress=lambda done, of: told.append((done, of))) == many.Done(4, 4, [], 0)
    assert told[-1] == (4, 4)
    told.clear()
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


def test_a_table_in_memory_makes_the_jobs_of_one_in_a_file(folder: Path) -> None:
    nights = pandas.DataFrame(
        {
            "robot": pandas.Categorical(["a", "b"]),
            "night": pandas.to_datetime(["2026-03-01", "2026-03-02"]),
            "began": pandas.to_datetime(["2026-03-01 23:30", "2026-03-02 00:00"]).tz_localize("Europe/Berlin"),
            "load": [1.0, 2.5],
            "experiment": "experiment.toml",
        }
    )
    nights.to_parquet(folder / "nights.parquet")
    nights.to_feather(folder / "nights.arrow", compression="uncompressed")
    assert many.make(nights, FIT, "same", folder) == 2
    for file in ["nights.parquet", "nights.arrow"]:
        assert many.make(file, FIT, "same", folder) == 0
    found = [json.loads(path.read_text())["labels"] for path in (folder / "same").iterdir()]
    assert sorted((own["night"], own["began"], own["load"]) for own in found) == [
        ("2026-03-01", "2026-03-01 22:30:00Z", "1"),
        ("2026-03-02", "2026-03-01 23:00:00Z", "2.5"),
    ]


def test_what_failed_is_done_again_where_that_is_asked(folder: Path) -> None:
    one = {"robot": ["a"], "night": [1], "experiment": ["experiment.toml"]}
    many.make(one, [*FIT[:-1], "nowhere/{out}.toml"], "bad", folder)
    failed = many.run("bad", "out", folder=folder)
    assert (len(failed.failed), failed.done, failed.left) == (1, 0, 0)
    (folder / "nowhere/out").mkdir(parents=True)
    assert many.run("bad", "out", folder=folder) == failed
    assert many.run("bad", "out", folder=folder, again=True) == many.Done(1, 1, [], 0)


def test_fits_without_a_minimum_are_no_estimates(folder: Path) -> None:
    (folder / "results").mkdir()
    one = {"name": "Fv", "value": 1.0, "std_error": 0.1, "unit": "N*m*s/rad"}
    for job, status in [("x", "iteration limit"), ("y", "converged")]:
        result = {"job": job, "labels": {"robot": "a", "night": job}, "error": None, "result": {"status": status, "parameters": [one]}}
        (folder / "results" / f"{job}.json").write_text(json.dumps(result))
    assert list(many.estimates("results", folder)["night"]) == ["y"]
    assert many.dataset("results", "found", folder) == 1
    kinds = pandas.read_parquet(folder / "found").dtypes
    assert kinds["value"] == float and kinds["std_error"] == float


def test_what_fails_is_told(folder: Path) -> None:
    with pytest.raises(many.Error, match="holds the jobs; name another folder"):
        many.run("jobs", "jobs", folder=folder)
    with pytest.raises(many.Error, match="a label is called `value`"):
        many.make({"value": [1], "experiment": ["experiment.toml"]}, FIT, "jobs", folder)
    (folder / "estimates.csv").write_text("robot,night,quantity,value\na,1,p\n")
    with pytest.raises(many.Error, match=r"^estimates.csv: it is no table \(CSV error"):
        many.fleet("estimates.csv", folder=folder)
    with pytest.raises(many.Error, match="unknown column `nihgt`"):
        many.make({"night": [1]}, ["fit", "{nihgt}"], "jobs", folder)
    with pytest.raises(ValueError, match="expected 'here', 'ray' or an executor"):
        many.run("jobs", "results", on="elsewhere", folder=folder)
