"""Tables as pandas DataFrames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dynid._optional import needed

if TYPE_CHECKING:
    import pandas

PARAMETERS = ["name", "value", "lower", "upper", "fixed", "unit", "std_error"]


def frame(rows: Sequence[Any], columns: list[str], instead: str) -> pandas.DataFrame:
    """A DataFrame of rows."""
    made: pandas.DataFrame = needed("pandas", "pandas", "a DataFrame", instead).DataFrame(rows, columns=columns)
    return made


def parameters(rows: Sequence[tuple[Any, ...]]) -> pandas.DataFrame:
    """Of a model: a row a parameter, by its name."""
    made = frame(rows, PARAMETERS, "use `model[name]` and `model.names`")
    return made.set_index("name")
