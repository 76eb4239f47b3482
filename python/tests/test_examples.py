"""The examples run, and README shows the first and what it says."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
README = Path(__file__).parents[2] / "README.md"


@pytest.mark.parametrize("name", [path.name for path in sorted(EXAMPLES.glob("*.py"))])
def test_an_example_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    said = capsys.readouterr().out
    assert said.strip()
    if name == "tour.py":
        readme = README.read_text(encoding="utf-8")
        assert f"```text\n{said}```" in readme
        code = (EXAMPLES / name).read_text(encoding="utf-8")
        shown = readme.split("```python\n")[1].split("```")[0]
        body = [line.strip() for line in code.splitlines()]
        assert all(line.strip() in body for line in shown.splitlines())
    if name == "arrays.py":
        assert "less than 1e-9 N*m: True" in said
