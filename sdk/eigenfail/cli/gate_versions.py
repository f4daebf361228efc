"""Which version of the planners a gate judges, and by which other one, as it was asked for."""

import re

from eigenfail.cli.planner_code import fingerprint
from eigenfail.errors import InvalidValue
from eigenfail.suites import Suite

VERSION = re.compile(r"[\w.+/-]{1,80}")


def named(baseline: str | None) -> str:
    """The baseline that was named; empty where this run becomes one.

    Raises:
        InvalidValue: the name is empty, as that of a variable that was never set.
    """
    if baseline is not None and not baseline.strip():
        raise InvalidValue("baseline", "is empty.", "Name one, or leave --baseline out.")
    return baseline or ""


def checked(version: str) -> str:
    """The version that was given; empty if none was.

    Raises:
        InvalidValue: it cannot be part of a name.
    """
    if version and not VERSION.fullmatch(version):
        raise InvalidValue(
            "planner-version",
            f"'{version}' is not of letters, digits and any of . _ + / - alone, at most 80.",
            "Give a commit or a tag.",
        )
    return version


def of_this_machine(suite: Suite, url: str | None) -> str:
    """A fingerprint of the planners that are installed here.

    Raises:
        InvalidValue: those that are tested are elsewhere.
    """
    if url:
        raise InvalidValue(
            "planner-version",
            "is not given, and the code of a service elsewhere cannot be seen from here.",
            "Name what is installed there, such as a commit.",
        )
    return fingerprint(suite)
