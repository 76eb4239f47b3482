"""Logs from memory: whatever holds columns."""

from __future__ import annotations

from pathlib import Path

import dynid
import numpy
import pandas
import pyarrow
import pytest


class OnlyArrow:
    """What polars, DuckDB and others hand out, and nothing else."""

    def __init__(self, table: pyarrow.Table) -> None:
        self.table = table

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.table.__arrow_c_stream__(requested_schema)


@pytest.fixture
def frame(frames: dict[str, pandas.DataFrame]) -> pandas.DataFrame:
    return frames["wrist-1.csv"]


def digest(robot: dynid.Device, log: object, **settings: object) -> str:
    return dynid.Experiment(robot).add(log, role="fit", **settings).digest  # type: ignore[arg-type]


def test_all_kinds_of_tables_are_the_same_log(
    robot: dynid.Device, frame: pandas.DataFrame, tour: Path, tmp_path: Path
) -> None:
    frame.to_parquet(tmp_path / "log.parquet")
    arrow = pyarrow.Table.from_pandas(frame)
    pieces = pyarrow.concat_tables([arrow.slice(0, 300), arrow.slice(300)])
    logs: list[object] = [
        frame,
        {name: frame[name].to_numpy() for name in frame},
        {name: list(frame[name]) for name in frame},
        arrow,
        pieces,
        OnlyArrow(pieces),
        tmp_path / "log.parquet",
        tour / "wrist-1.csv",
        str(tour / "wrist-1.csv"),
    ]
    assert len({digest(robot, log) for log in logs}) == 1


def test_what_arrow_holds_becomes_numbers() -> None:
    table = pyarrow.table(
        {
            "whole": pyarrow.array([1, None, 3], pyarrow.int32()),
            "small": pyarrow.array([0.5, 1.5, 2.5], pyarrow.float32()),
            "stamp": pyarrow.array([0, 1500, 3000], pyarrow.timestamp("ms")),
            "flag": [True, False, None],
            "word": ["a", "b", "c"],
        }
    )
    columns = dynid._dynid.columns_of(table)
    assert list(columns) == ["whole", "small", "stamp", "flag"]
    numpy.testing.assert_array_equal(columns["whole"], [1, numpy.nan, 3])
    numpy.testing.assert_array_equal(columns["small"], [0.5, 1.5, 2.5])
    numpy.testing.assert_array_equal(columns["stamp"], [0, 1.5, 3])
    numpy.testing.assert_array_equal(columns["flag"], [1, 0, numpy.nan])


def test_settings_are_those_of_an_experiment_file(robot: dynid.Device, frame: pandas.DataFrame) -> None:
    degrees = frame.assign(q4=numpy.degrees(frame["q4"]))
    turned = dynid.Experiment(robot).add(degrees, role="fit", scale={"q4": numpy.pi / 180}, rows=(100, 400), label="part")
    (run,) = turned.runs
    assert (run.label, run.samples, run.free, run.role) == ("part", 300, [4, 5], "fit")
    numpy.testing.assert_allclose(turned.columns(0)["q4"], frame["q4"][100:400], rtol=1e-14)
    assert list(turned.frame(0).columns)[:2] == ["t", "tau0"]


def test_errors_say_what_and_where(robot: dynid.Device, frame: pandas.DataFrame, tmp_path: Path) -> None:
    def said(log: object, **settings: object) -> str:
        with pytest.raises(dynid.Error) as raised:
            dynid.Experiment(robot).add(log, **{"role": "fit", "label": "frame", **settings})  # type: ignore[arg-type]
        return str(raised.value)

    assert said(frame, role="test").startswith('frame: role: expected "fit" or "validate", found "test"; say "fit"')
    assert said(frame, columns={"q9": "q4"}).startswith("frame: columns: there is no column `q9` of `freedom6s`; did you mean")
    assert "column `angle` is missing; the log has `t`, `tau0`" in said(frame, columns={"q4": "angle"}, free=[4, 5])
    broken = frame.assign(q4=frame["q4"].where(frame.index != 17))
    assert said(broken, free=[4, 5]).startswith("frame: column `q4`, row 17: expected a finite number, found `NaN`")
    assert said(frame[["t", "q4"]].iloc[:1], free=[4]).startswith("frame: column `tau4` is missing")
    assert said(frame * 0 + 1).startswith("frame: free: no column of a position moves by more than its noise; say which")
    assert said({"t": [0, 1], "q0": [0]}) == "column `q0` has 1 samples, the others 2; give one for each sample"
    assert said({"t": ["a", "b"]}) == "column `t` is no row of numbers; give one number for each sample"
    assert "of the type int is not understood; give a DataFrame" in said(3)
    assert "cannot be read" in said(tmp_path / "none.csv")
    with pytest.raises(dynid.Error, match="the experiment has no run; add one"):
        dynid.fit(dynid.Model(robot), dynid.Experiment(robot))
    other = dynid.Experiment(dynid.devices["planar2r"])
    with pytest.raises(dynid.Error, match="use files of one device"):
        dynid.compare(dynid.Model(robot), other.add({"t": [0.0, 1.0], "tau0": [0, 0], "q0": [0, 1], "q1": [0, 0]}, role="fit", free=[0]))
