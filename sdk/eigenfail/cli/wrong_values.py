"""Values on a command line that are none of their kind, in our words."""

from typing import Any

from eigenfail.errors import InvalidValue

NO_WHOLE_NUMBER = "is no whole number"
FAULTS = {
    "int_parsing": NO_WHOLE_NUMBER,
    "int_parsing_size": "is too large",
    "int_from_float": NO_WHOLE_NUMBER,
    "float_parsing": "is no number",
    "greater_than_equal": "is below {ge}",
    "less_than_equal": "is above {le}",
}
"""What is said, by the kind of fault that the reader of the command line found."""

CAMPAIGN = "CAMPAIGN"
IDS = "`eigenfail campaign list` shows the ids."


def wrong_value(error: Any, usage: str) -> InvalidValue | None:
    """The same error in our words; None if it is not about a number.

    Args:
        error: what typer raises of a value; its cause lists the faults.
        usage: where to read what may be given.
    """
    found: list[dict[str, Any]] = getattr(error.__cause__, "errors", list)()
    if not found or found[0]["type"] not in FAULTS:
        return None
    fault = found[0]
    said = FAULTS[fault["type"]].format(**fault.get("ctx", {}))
    is_campaign = (error.param.metavar or "").startswith(CAMPAIGN)
    name = error.param.get_error_hint().strip("'.")
    return InvalidValue(name, f"'{fault['input']}' {said}.", IDS if is_campaign else usage)
