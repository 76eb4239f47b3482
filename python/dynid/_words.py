"""Words that a caller gives."""

from __future__ import annotations

from collections.abc import Sequence


def listed(words: Sequence[str]) -> list[str]:
    """A list of words; one alone is a list of one, not of its letters."""
    return [words] if isinstance(words, str) else list(words)
