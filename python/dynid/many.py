"""The same work on many experiments, models or seeds: on one machine, in a pool of processes, or on a Ray cluster.

    from dynid import many
    many.make(nights, ["fit", "{experiment}", "--model", "nominal.toml", "--out", "{out}.toml"], "jobs")
    done = many.run("jobs", "results")                    # on="ray" on a cluster, or any concurrent.futures.Executor
    estimates = many.estimates("results")                 # a DataFrame: robot, night, quantity, value, std_error
    changed = many.fleet("results", page="fleet.html")    # what has changed on which robot, and since when

A job is a JSON file named by its digest, its result one file of the same name, written by renaming (`dynid job --help`). So work
that is stopped goes on, wherever it was stopped and whoever goes on, and comes to the same bytes as on one machine. Machines of a
cluster share the folder.

All paths are those of `folder`, which is the working folder where it is left out.

    python -m dynid.many nights.csv --out results/ -- fit '{experiment}' --model nominal.toml --out '{out}.toml'
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid import _dynid
from dynid._dynid import Error
from dynid._optional import is_there, needed
from dynid._words import listed

Progress = Callable[[int, int], None]
"""Hears how many of how many jobs are done, those counted that were done before."""

_RETRIES = 3
"""A worker that dies is replaced so often, for each job; what kills more of them kills the next."""

_FOUND = ("quantity", "value", "std_error", "unit")
"""Columns of a table of estimates, after the job and its labels."""

_UNENDED = ("iteration limit", "numerical error")
"""How fits end that are no minimum: their values are none."""


@dataclass(frozen=True)
class Done:
    """What became of the jobs."""

    jobs: int
    done: int
    failed: list[str]
    """Digests of jobs whose result is an error."""
    left: int


def command(arguments: Sequence[str], folder: Path | str = ".", progress: Progress | None = None) -> dict[str, Any]:
    """Runs a command of `dynid` in a process of its own; what it prints with `--json`."""
    words = [sys.executable, "-m", "dynid", "--json", "--progress", "json", "--stop-with-stdin", *listed(arguments)]
    said: list[str] = []
    # What is printed goes to a file: a pipe that nobody empties meanwhile would be full some time.
    with tempfile.TemporaryFile("w+", encoding="utf-8") as printed:
        # Whatever is raised here ends its stdin, by which it stops as by Ctrl-C. That of the terminal is not for it: a second one would not wait.
        with subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=printed,
            stderr=subprocess.PIPE,
            cwd=folder,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        ) as running:
            for line in running.stderr or ():
                if line.startswith("note: ") and not said:
                    print(line, end="", file=sys.stderr)
                elif not line.startswith('{"'):
                    said.append(line)
                elif progress is not None and (event := json.loads(line)).get("progress") == "count":
                    progress(event["done"], event["of"])
        printed.seek(0)
        text = printed.read()
    if not text.strip():
        raise Error(_why(said) or f"`dynid {' '.join(listed(arguments)[:1])}` died; give the same command again")
    result: dict[str, Any] = json.loads(text)
    return result


def _why(said: Sequence[str]) -> str:
    """The words of an error, which may go on over lines."""
    begun = next((place for place, line in enumerate(said) if line.startswith("error: ")), 0)
    return "".join(said[begun:]).removeprefix("error: ").strip()


def make(table: Any, arguments: Sequence[str], jobs: Path | str = "jobs", folder: Path | str = ".") -> int:
    """Makes a job of each row of a table (a DataFrame, a dict of columns, whatever hands out an Arrow stream, or the path of a CSV, Parquet or Arrow
    file): `{column}` in an argument is what the row has there, and all columns are labels. Returns how many jobs are new."""
    with tempfile.TemporaryDirectory() as place:
        path = _as_file(table, Path(folder).resolve(), Path(place))
        _refuse_own_columns(_dynid.names_in(str(path)))
        made = command(["job", str(jobs), "--from", str(path), "--", *listed(arguments)], folder)
    return int(made["written"])


def _as_file(table: Any, folder: Path, place: Path) -> Path:
    """The path of a table, or of one in `place` with what a table in memory holds."""
    if isinstance(table, (str, os.PathLike)):
        return folder / table
    # Others than pandas have a `to_csv` of their own.
    is_frame = hasattr(table, "to_csv") and hasattr(table, "to_numpy")
    if is_frame and not is_there("pyarrow"):
        table.to_csv(place / "table.csv", index=False)
        return place / "table.csv"
    # As a file of Arrow it says the same words as if it had been read from one.
    arrow, ipc = (needed(name, "pyarrow", "a table in memory", "give the path of one") for name in ("pyarrow", "pyarrow.ipc"))
    try:
        table = arrow.Table.from_pandas(table, preserve_index=False) if is_frame else arrow.table(table)
    except (TypeError, ValueError) as error:
        raise Error(f"this is no table ({error}); give a DataFrame, a dict of columns, an Arrow table or the path of a file") from None
    with ipc.new_file(place / "table.arrow", table.schema) as written:
        written.write_table(table)
    return place / "table.arrow"


def _refuse_own_columns(labels: Iterable[str]) -> None:
    for label in labels:
        if label in ("job", *_FOUND):
            raise Error(f"a label is called `{label}`, as a column of estimates is; rename that column of the table, and make the jobs anew")


def run(
    jobs: Path | str = "jobs",
    out: Path | str = "results",
    *,
    on: str | Executor = "here",
    folder: Path | str = ".",
    address: str | None = None,
    again: bool = False,
    progress: Progress | None = None,
) -> Done:
    """Does all jobs of a folder that are not done yet, with `again` also those that failed: `"here"` in as many processes as there are processors,
    on `"ray"` (where Ray is initialised already, else on the cluster at `address` or at `RAY_ADDRESS`, else on one that is started here), or in an
    executor of yours."""
    folder = Path(folder).resolve()
    paths = _json_files(folder / jobs, "jobs; many.make() makes them")
    (folder / out).mkdir(parents=True, exist_ok=True)
    if on == "here":
        command(["job", str(jobs), "--out", str(out), *_again(again)], folder, progress)
        return _state(paths, folder / out)
    left = [path for path in paths if (own := _result(folder / out / path.name)) is None or again and own["error"] is not None]
    before = len(paths) - len(left)

    def tell(count: int) -> None:
        if progress is not None:
            progress(before + count, len(paths))

    if isinstance(on, Executor):
        futures = [on.submit(work, str(path), str(out), str(folder), again) for path in left]
        for count, future in enumerate(as_completed(futures), 1):
            future.result()
            tell(count)
    elif on == "ray":
        _on_ray(left, out, folder, address, again, tell)
    else:
        raise ValueError(f"on={on!r}: expected 'here', 'ray' or an executor")
    # Whatever became of each is in the folder.
    return _state(paths, folder / out)


def work(job: str, out: str, folder: str, again: bool = False) -> None:
    """Does one job, whoever asks: its result is a file."""
    command(["job", job, "--out", out, "--at-once", "1", *_again(again)], folder)


def _again(again: bool) -> list[str]:
    return ["--again"] if again else []


def _on_ray(left: Sequence[Path], out: Path | str, folder: Path, address: str | None, again: bool, tell: Callable[[int], None]) -> None:
    ray = needed("ray", "ray", "work on a cluster", "leave on=\"ray\" out")
    is_own = not ray.is_initialized()
    if is_own:
        # Without an address Ray would join whatever cluster it finds.
        ray.init(address=address or os.environ.get("RAY_ADDRESS") or "local", log_to_driver=False, include_dashboard=False, configure_logging=False)
    try:
        remote = ray.remote(num_cpus=1, max_retries=_RETRIES)(work)
        pending = [remote.remote(str(path), str(out), str(folder), again) for path in left]
        count = 0
        while pending:
            ready, pending = ray.wait(pending, num_returns=1)
            ray.get(ready)
            count += len(ready)
            tell(count)
    finally:
        if is_own:
            ray.shutdown()


def _json_files(folder: Path, what: str) -> list[Path]:
    if not folder.is_dir():
        raise Error(f"{folder} is no folder of {what}, or say where they are")
    return sorted(folder.glob("*.json"))


def _result(path: Path) -> dict[str, Any] | None:
    """The result in a file; `None` where it is not there, not whole, or something else: what a verb wrote lies beside it."""
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    return read if isinstance(read, dict) and read.get("job") == path.stem else None


def _state(jobs: Sequence[Path], out: Path) -> Done:
    found = {path.stem: _result(out / path.name) for path in jobs}
    failed = [digest for digest, own in found.items() if own is not None and own["error"] is not None]
    left = sum(own is None for own in found.values())
    return Done(len(jobs), len(jobs) - len(failed) - left, failed, left)


def results(out: Path | str = "results", folder: Path | str = ".") -> list[dict[str, Any]]:
    """All results of a folder, by digest: `job`, `labels`, `arguments`, `status`, `result` (what the verb prints with `--json`), `error`."""
    found = map(_result, _json_files(Path(folder) / out, "results; many.run() makes them"))
    return [own for own in found if own is not None]


def estimates(out: Path | str = "results", folder: Path | str = ".") -> Any:
    """What fits found, as a DataFrame: a row for each parameter of each job, with the job's labels. Fits that did not end at a minimum are left out,
    as `dynid fleet` leaves them out."""
    pandas = needed("pandas", "pandas", "a table of estimates", "read results()")
    rows = _rows(results(out, folder))
    return pandas.DataFrame(rows, columns=["job", *_labels(rows), *_FOUND]).astype({"value": float, "std_error": float})


def _rows(found: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for own in found:
        fit = own["result"] or {}
        if "status" in fit and fit["status"] not in _UNENDED:
            _refuse_own_columns(own["labels"])
            rows += [
                {"job": own["job"], **own["labels"], "quantity": one["name"], "value": one["value"], "std_error": one["std_error"], "unit": one["unit"]}
                for one in fit.get("parameters", [])
            ]
    return rows


def _labels(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Those that any job has."""
    return [name for name in dict.fromkeys(name for row in rows for name in row) if name not in ("job", *_FOUND)]


def dataset(out: Path | str = "results", to: Path | str = "estimates", folder: Path | str = ".") -> int:
    """Lets a Parquet dataset grow by the estimates that it does not have yet, those of `estimates()`: one more file. Returns how many rows it grew by.
    One process at a time may write a dataset."""
    arrow, parquet = (needed(name, "pyarrow", "a Parquet dataset", "take estimates()") for name in ("pyarrow", "pyarrow.parquet"))
    to = Path(folder) / to
    to.mkdir(parents=True, exist_ok=True)
    known: set[str] = set()
    for path in to.glob("*.parquet"):
        known.update(parquet.read_table(path, columns=["job"])["job"].to_pylist())
    rows = _rows(own for own in results(out, folder) if own["job"] not in known)
    if rows:
        # Named by what it holds, and whole or not there.
        digests = sorted({row["job"] for row in rows})
        path = to / f"{hashlib.sha256(''.join(digests).encode()).hexdigest()[:16]}-{len(digests)}.parquet"
        if path.exists():
            raise Error(f"{path} is there already and kept; let one process at a time write a dataset, and do it again")
        # Of one kind in all files, also where a column is empty.
        numbers = {"value", "std_error"}
        names = ["job", *_labels(rows), *_FOUND]
        schema = arrow.schema([(name, arrow.float64() if name in numbers else arrow.string()) for name in names])
        partial = path.with_suffix(f".{os.getpid()}.partial")
        parquet.write_table(arrow.Table.from_pylist(rows, schema=schema), partial)
        os.replace(partial, path)
    return len(rows)


def fleet(
    out: Path | str = "results", page: Path | str | None = None, false_alarms: float = 0.05, folder: Path | str = "."
) -> dict[str, Any]:
    """What has changed on which robot, and since when, by jobs with the labels `robot` and `night` (`dynid fleet --help`)."""
    written = ["--out", str(page), "--force"] if page is not None else []
    return command(["fleet", str(out), "--false-alarms", repr(false_alarms), *written], folder)


def _main() -> int:
    parser = argparse.ArgumentParser(prog="python -m dynid.many", description="Makes jobs of a table and does them.")
    parser.add_argument("table", help="CSV, Parquet or Arrow: one job a row")
    parser.add_argument("--jobs", default="jobs", help="folder of the jobs")
    parser.add_argument("--out", default="results", help="folder of the results")
    parser.add_argument("--on", choices=["here", "ray"], default="here")
    parser.add_argument("--address", help="of the Ray cluster; without it and RAY_ADDRESS, one is started here")
    parser.add_argument("--again", action="store_true", help="also do again what failed")
    parser.add_argument("--dataset", metavar="FOLDER", help="a Parquet dataset that grows by what is found")
    parser.add_argument("arguments", nargs="+", help="those of dynid, after --: {column} is what a row has there")
    asked = parser.parse_args()
    make(asked.table, asked.arguments, asked.jobs)
    done = run(asked.jobs, asked.out, on=asked.on, address=asked.address, again=asked.again, progress=_told)
    if asked.dataset:
        dataset(asked.out, asked.dataset)
    print(f"{done.done} of {done.jobs} jobs done, {len(done.failed)} failed, {done.left} left; results: {asked.out}")
    for digest in done.failed:
        print(f"failed: {asked.out}/{digest}.json says why; --again tries it again")
    return 0 if done.done == done.jobs else 1


def _status() -> int:
    try:
        return _main()
    except Error as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _told(done: int, of: int) -> None:
    print(f"\r{done} of {of}", end="" if done < of else "\n", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(_status())
