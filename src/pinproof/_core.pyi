"""The compiled core, an extension module built from src/core; its functions state their types in their docstrings."""

from typing import Any

def __getattr__(name: str) -> Any: ...
