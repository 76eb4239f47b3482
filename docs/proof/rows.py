"""What the proofs share: the table of published and own figures, in README.md and on the terminal."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dynid
import numpy

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Row:
    """One figure: of errors the smaller is the better, of values (`published_error` is their standard deviation) none is."""

    what: str
    unit: str
    published: float | None
    ours: float
    published_error: float | None = None
    is_error: bool = True

    def cells(self) -> list[str]:
        """As text, with what comes of the two."""
        published = "—" if self.published is None else number(self.published)
        if self.published_error is not None:
            published += f" ± {number(self.published_error)}"
        return [self.what, self.unit, published, number(self.ours), self._verdict()]

    def _verdict(self) -> str:
        if self.published is None:
            return ""
        if not self.is_error:
            if self.published_error is None:
                return f"{100 * (self.ours / self.published - 1):+.1f} %"
            return f"{(self.ours - self.published) / self.published_error:+.1f} standard deviations"
        share = self.ours / self.published
        if abs(share - 1) < 0.005:
            return "the same"
        return f"better: {share:.2f} times theirs" if share < 1 else f"**worse**: {share:.2f} times theirs"


def number(value: float) -> str:
    """Three digits."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def options(about: str, path: str) -> argparse.ArgumentParser:
    """A parser with what every proof takes."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("path", type=Path, help=path)
    parser.add_argument("--readme", type=Path, default=HERE / "README.md", help="where the table goes; its picture goes beside it")
    return parser


def digest(files: Iterable[Path]) -> str:
    """SHA-256 of the files' bytes, in this order."""
    found = hashlib.sha256()
    for file in files:
        found.update(file.read_bytes())
    return found.hexdigest()


def picture(readme: Path, name: str, title: str, unit: str, curves: Sequence[tuple[str, Any, Any]]) -> None:
    """Curves over time above, and below what each leaves of the first, as a small PNG beside README."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print(f"no picture of {name}: it needs matplotlib")
        return
    figure = Figure(figsize=(7.5, 4.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    measured = numpy.asarray(curves[0][2])
    above.plot(curves[0][1], measured, label=curves[0][0], linewidth=2.5, color="0.75")
    for label, time, values in curves[1:]:
        (line,) = above.plot(time, values, label=label, linewidth=1)
        below.plot(time, measured - values, linewidth=1, color=line.get_color())
    above.set(title=title, ylabel=unit)
    above.legend(loc="upper right", fontsize="small")
    below.set(xlabel="t [s]", ylabel=f"left, {unit}")
    figure.savefig(readme.parent / f"{name}.png", dpi=80, metadata={"Software": None})


def write(readme: Path, name: str, rows: Sequence[Row], said: Sequence[str], data: str) -> None:
    """Puts a table and sentences between the marks of their name in README, and prints them."""
    head = ["figure", "unit", "published", "dynid", ""]
    lines = ["| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *(row.cells() for row in rows)]]
    lines += ["", *(f"- {sentence}" for sentence in said), "", f"dynid {dynid.__version__}; SHA-256 of the data {data}"]
    print("\n".join(lines))
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    text = readme.read_text(encoding="utf-8") if readme.exists() else begin + end + "\n"
    before, found, rest = text.partition(begin)
    _, also, after = rest.partition(end)
    if not (found and also):
        raise SystemExit(f"{readme} has no place for {name}: it needs the lines {begin.strip()} and {end}")
    readme.write_text(before + begin + "\n".join(lines) + "\n" + end + after, encoding="utf-8")
