"""The Python in the book runs: a chapter's blocks in order, as one program, in a folder with the chapter's logs.

A block of text directly after one of Python is what it prints; a line of `...` in it stands for any lines, `[..]` for any text.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
from pathlib import Path

import pytest

BOOK = Path(__file__).parents[2] / "docs" / "book"
FENCE = "```"


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and content of each fenced block."""
    return re.findall(rf"^{FENCE}(\S*)\n(.*?)^{FENCE}$", text, flags=re.MULTILINE | re.DOTALL)


def chapters() -> list[str]:
    texts = ((path.stem, path.read_text(encoding="utf-8")) for path in sorted((BOOK / "src").glob("*.md")))
    return [stem for stem, text in texts if any(language == "python" for language, _ in blocks(text))]


def pattern(shown: str) -> str:
    """A regular expression of what may be printed."""

    def line(own: str) -> str:
        return r"(?:.*\n)*" if own == "..." else r".*".join(map(re.escape, own.rstrip().split("[..]"))) + r" *\n"

    return "".join(map(line, shown.splitlines()))


@pytest.mark.parametrize("chapter", chapters())
def test_a_chapter_runs(chapter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (BOOK / "src" / f"{chapter}.md").read_text(encoding="utf-8")
    if named := re.search(r"`docs/book/logs/([^`]+)`", text):
        shutil.copytree(BOOK / "logs" / named[1], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    told: str | None = None
    for language, content in blocks(text):
        if language == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(content, f"{chapter}.md", "exec"), names)
            told = printed.getvalue()
        elif language == "text" and told is not None:
            assert re.fullmatch(pattern(content), told), f"it prints\n{told}"
            told = None
        else:
            # What a block prints is shown directly after it, or nowhere.
            told = None


def test_dots_stand_for_what_is_left_out() -> None:
    assert re.fullmatch(pattern("a\n...\nc [..] s\n"), "a\nb\nb\nc 6 s\n")
    assert re.fullmatch(pattern("a\n...\nc\n"), "a\nc\n")
    assert not re.fullmatch(pattern("a\n...\nc\n"), "a\nb\n")
    assert not re.fullmatch(pattern("a\n"), "a\nb\n")


def test_there_is_python_in_the_book() -> None:
    assert "python" in chapters()
