"""What notebooks show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from dynid._frames import PARAMETERS


def cell(value: Any) -> str:
    """A value as text; numbers in four digits."""
    if value is None:
        return "\u2014"
    if isinstance(value, bool):
        return "yes" if value else ""
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))


def table(columns: Iterable[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{cell(value)}</td>' for value in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def titled(title: str, sentences: Iterable[str], *tables: str) -> str:
    """A title, sentences and tables below each other."""
    said = "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)
    return f"<div><p><b>{escape(title)}</b></p>{said}{''.join(tables)}</div>"


def model(title: str, rows: Sequence[tuple[Any, ...]]) -> str:
    """Of a model: its parameters that are not fixed."""
    free = [row for row in rows if not row[4]]
    return titled(title.strip("<>"), [], table(PARAMETERS, free))
