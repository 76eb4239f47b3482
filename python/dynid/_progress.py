"""Who hears how far a work is: nobody, a function of the user's, or a bar of tqdm."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from dynid._optional import needed

Listener: TypeAlias = Callable[[dict[str, Any]], object]
"""Hears of events, each a dict whose entry `progress` says what it is: the lines of `dynid --progress json`."""

Progress: TypeAlias = "Listener | bool | None"
"""A listener; `True` for a bar of tqdm; `False` or `None` for silence."""


@contextmanager
def told(progress: Progress, what: str) -> Iterator[Callable[[str], object] | None]:
    """What the library is to call with each line."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        tqdm = needed("tqdm.auto", "tqdm", "a bar (progress=True)", "hand in a function")
        with tqdm.tqdm(desc=what, unit="step") as bar:
            yield lambda line: _show(bar, json.loads(line))
    else:
        yield lambda line: progress(json.loads(line))


def _show(bar: Any, event: dict[str, Any]) -> None:
    kind = event["progress"]
    if kind == "count":
        bar.total = event["of"]
        bar.update(event["done"] - bar.n)
    elif kind == "note":
        bar.write(f"note: {event['note']}")
    else:
        said = {key: event[key] for key in ("iteration", "cost", "candidates", "search") if key in event}
        if isinstance(said.get("candidates"), list):
            said["candidates"] = len(said["candidates"])
        bar.set_postfix(said, refresh=False)
        bar.update()
