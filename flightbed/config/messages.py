"""Messages for the problems that pydantic's validation of a scenario finds."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any


def message(item: Any) -> str:
    """Return the message of a problem, such as "must be a number"."""
    return _MESSAGES.get(item["type"], _plain)(item)


def brief(value: Any) -> str:
    """Return the text of a value in a message, cut to 40 characters."""
    text = (
        re.sub(r"[()]", lambda m: "[" if m[0] == "(" else "]", repr(value).replace(",)", ")"))
        if isinstance(value, tuple)
        else repr(value)
    )
    return text if len(text) <= 40 else text[:37] + "..."


def _plain(item: Any) -> str:
    text: str = item["msg"]
    return re.sub(r"^Input should be", "must be", text[:1].upper() + text[1:]) if text.startswith("Input") else text


_MESSAGES: dict[str, Callable[[Any], str]] = {
    "missing": lambda _: "is missing",
    "string_pattern_mismatch": lambda _: "must be letters, digits, - and _, and start with a letter or digit",
    "model_type": lambda _: "must be a table",
    "dict_type": lambda _: "must be a table",
    "float_type": lambda _: "must be a number",
    "int_type": lambda _: "must be a whole number",
    "bool_type": lambda _: "must be true or false",
    "string_type": lambda _: "must be a string",
    "finite_number": lambda _: "must be finite",
    "too_long": lambda item: f"must have {item['ctx']['max_length']} values",
    "tuple_type": lambda _: "must be a list",
}
