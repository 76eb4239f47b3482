"""Packages that are used where they are installed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from dynid._dynid import Error


def is_there(module: str) -> bool:
    """Whether it is installed."""
    return importlib.util.find_spec(module) is not None


def needed(module: str, package: str, what: str, instead: str) -> Any:
    """The module, or an error that says who needs it and what does without."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise Error(f"{what} needs the package {package}; install it (pip install {package}), or {instead}") from None
