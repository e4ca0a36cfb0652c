# pandas ships no types, and what is guessed from its source is often wrong: it is left untyped.
from typing import Any

def __getattr__(name: str) -> Any: ...  # noqa: ANN401 - pandas ships no types
