"""The same work on many experiments, models or seeds: on one machine, in a pool of processes, or on a Ray cluster.

    from dynid import many
    many.make(nights, ["fit", "{experiment}", "--model", "nominal.toml", "--out", "{out}.toml"], "jobs")
    done = many.run("jobs", "results")                    # on="ray" on a cluster, or any concurrent.futures.Executor
    estimates = many.estimates("results")                 # a DataFrame: robot, night, quantity, value, std_error
    changed = many.fleet("results", page="fleet.html")    # what has changed on which robot, and since when

A job is a JSON file named by its digest, its result one file of the same name, written by renaming (`dynid job --help`). So work
that is stopped goes on, wherever it was stopped and whoever goes on, and comes to the same bytes as on one machine. Machines of a
cluster share the folder.

    python -m dynid.many nights.csv --out results/ -- fit '{experiment}' --model nominal.toml --out '{out}.toml'
"""

from __future__ import annotations

import argparse
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

from dynid._dynid import Error
from dynid._optional import needed

Progress = Callable[[int, int], None]
"""Hears how many of how many jobs are done."""

_RETRIES = 3
"""A worker that dies is replaced so often, for each job; what kills more of them kills the next."""


@dataclass(frozen=True)
class Done:
    """What became of the jobs."""

    jobs: int
    done: int
    failed: list[str]
    """Digests of jobs whose result is an error."""
    left: int


def command(arguments: Sequence[str], folder: Path | str = ".") -> dict[str, Any]:
    """Runs a command of `dynid` in a process of its own; what it prints with `--json`."""
    words = [sys.executable, "-m", "dynid", "--json", *arguments]
    ran = subprocess.run(words, capture_output=True, text=True, cwd=folder, check=False)
    if not ran.stdout.strip():
        raise Error(ran.stderr.rpartition("error: ")[2].strip() or f"`dynid {arguments[0]}` died")
    printed: dict[str, Any] = json.loads(ran.stdout)
    return printed


def make(table: Any, arguments: Sequence[str], jobs: Path | str = "jobs", folder: Path | str = ".") -> int:
    """Makes a job of each row of a table (a DataFrame, a dict of columns, or the path of a CSV, Parquet or Arrow file): `{column}` in an argument is what the row
    has there, and all other columns are labels. Returns how many jobs are new."""
    with tempfile.TemporaryDirectory() as place:
        path = _as_file(table, Path(place) / "table.csv")
        made = command(["job", str(jobs), "--from", str(path), "--", *arguments], folder)
    return int(made["written"])


def _as_file(table: Any, path: Path) -> Path:
    if isinstance(table, (str, Path)):
        return Path(table).resolve()
    pandas = needed("pandas", "pandas", "a table in memory", "give the path of one")
    frame = table if hasattr(table, "to_csv") else pandas.DataFrame(table)
    frame.to_csv(path, index=False)
    return path


def run(
    jobs: Path | str = "jobs",
    out: Path | str = "results",
    *,
    on: str | Executor = "here",
    folder: Path | str = ".",
    address: str | None = None,
    progress: Progress | None = None,
) -> Done:
    """Does all jobs that are not done yet: `"here"` in as many processes as there are processors, on `"ray"` (the cluster at `address`, or one that
    is started here), or in an executor of yours."""
    folder = Path(folder).resolve()
    (folder / out).mkdir(parents=True, exist_ok=True)
    if on == "here":
        return _done(command(["job", str(jobs), "--out", str(out)], folder))
    left = [path for path in sorted((folder / jobs).glob("*.json")) if not (folder / out / path.name).is_file()]
    tell = progress or (lambda done, of: None)
    if isinstance(on, Executor):
        futures = [on.submit(work, str(path), str(out), str(folder)) for path in left]
        for count, future in enumerate(as_completed(futures), 1):
            future.result()
            tell(count, len(left))
    elif on == "ray":
        _on_ray(left, out, folder, address, tell)
    else:
        raise ValueError(f"on={on!r}: expected 'here', 'ray' or an executor")
    # Whatever became of each is in the folder.
    return _state(folder, jobs, out)


def work(job: str, out: str, folder: str) -> None:
    """Does one job, whoever asks: its result is a file."""
    command(["job", job, "--out", out, "--at-once", "1"], folder)


def _on_ray(left: Sequence[Path], out: Path | str, folder: Path, address: str | None, tell: Progress) -> None:
    ray = needed("ray", "ray", "work on a cluster", "leave on=\"ray\" out")
    is_own = not ray.is_initialized()
    if is_own:
        ray.init(address=address, log_to_driver=False, include_dashboard=False, configure_logging=False)
    try:
        remote = ray.remote(num_cpus=1, max_retries=_RETRIES)(work)
        pending = [remote.remote(str(path), str(out), str(folder)) for path in left]
        count = 0
        while pending:
            ready, pending = ray.wait(pending, num_returns=1)
            ray.get(ready)
            count += len(ready)
            tell(count, len(left))
    finally:
        if is_own:
            ray.shutdown()


def _done(printed: Mapping[str, Any]) -> Done:
    return Done(printed["jobs"], printed["done"], list(printed["failed"]), printed["left"])


def _state(folder: Path, jobs: Path | str, out: Path | str) -> Done:
    names = [path.stem for path in sorted((folder / jobs).glob("*.json"))]
    found = {own["job"]: own for own in results(folder / out)}
    failed = [name for name in names if name in found and found[name]["error"] is not None]
    left = sum(name not in found for name in names)
    return Done(len(names), len(names) - len(failed) - left, failed, left)


def results(out: Path | str = "results") -> list[dict[str, Any]]:
    """All results of a folder, by digest: `job`, `labels`, `arguments`, `status`, `result` (what the verb prints with `--json`), `error`."""
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(Path(out).glob("*.json"))]


def estimates(out: Path | str = "results") -> Any:
    """What fits found, as a DataFrame: a row for each parameter of each job, with the job's labels."""
    pandas = needed("pandas", "pandas", "a table of estimates", "read results()")
    return pandas.DataFrame(_rows(results(out)))


def _rows(found: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [
        {"job": own["job"], **own["labels"], "quantity": one["name"], "value": one["value"], "std_error": one["std_error"], "unit": one["unit"]}
        for own in found
        for one in (own["result"] or {}).get("parameters", [])
    ]


def dataset(out: Path | str = "results", to: Path | str = "estimates") -> int:
    """Lets a Parquet dataset grow by the fits that it does not have yet: one more file. Returns how many rows it grew by."""
    arrow, parquet = (needed(name, "pyarrow", "a Parquet dataset", "take estimates()") for name in ("pyarrow", "pyarrow.parquet"))
    to = Path(to)
    to.mkdir(parents=True, exist_ok=True)
    known: set[str] = set()
    for path in to.glob("*.parquet"):
        known.update(parquet.read_table(path, columns=["job"])["job"].to_pylist())
    new = [own for own in results(out) if own["job"] not in known]
    rows = _rows(new)
    if rows:
        # Named by what it begins with, and whole or not there.
        path = to / f"{new[0]['job'][:16]}-{len(new)}.parquet"
        partial = path.with_suffix(f".{os.getpid()}.partial")
        parquet.write_table(arrow.Table.from_pylist(rows), partial)
        os.replace(partial, path)
    return len(rows)


def fleet(out: Path | str = "results", page: Path | str | None = None, false_alarms: float = 0.05) -> dict[str, Any]:
    """What has changed on which robot, and since when, by jobs with the labels `robot` and `night` (`dynid fleet --help`)."""
    written = ["--out", str(page), "--force"] if page is not None else []
    return command(["fleet", str(out), "--false-alarms", repr(false_alarms), *written])


def _main() -> int:
    parser = argparse.ArgumentParser(prog="python -m dynid.many", description="Makes jobs of a table and does them.")
    parser.add_argument("table", help="CSV, Parquet or Arrow: one job a row")
    parser.add_argument("--jobs", default="jobs", help="folder of the jobs")
    parser.add_argument("--out", default="results", help="folder of the results")
    parser.add_argument("--on", choices=["here", "ray"], default="here")
    parser.add_argument("--address", help="of the Ray cluster; without it, one is started here")
    parser.add_argument("--dataset", metavar="FOLDER", help="a Parquet dataset that grows by what is found")
    parser.add_argument("arguments", nargs="+", help="those of dynid, after --: {column} is what a row has there")
    asked = parser.parse_args()
    make(asked.table, asked.arguments, asked.jobs)
    done = run(asked.jobs, asked.out, on=asked.on, address=asked.address, progress=_told)
    if asked.dataset:
        dataset(asked.out, asked.dataset)
    print(f"{done.done} of {done.jobs} jobs done, {len(done.failed)} failed, {done.left} left; results: {asked.out}")
    return 0 if done.done == done.jobs else 1


def _told(done: int, of: int) -> None:
    print(f"\r{done} of {of}", end="" if done < of else "\n", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(_main())
