"""How long an episode may take, and how what a user says of limits is read."""

import math
import os

import msgspec

from eigenfail.bridges import EPISODE_OPTION, EPISODE_VARIABLE
from eigenfail.errors import InvalidValue

EPISODE_S = 60.0


class Meant(msgspec.Struct, frozen=True):
    """A limit that can be given: by which names, in what unit, and the least that makes sense."""

    option: str
    variable: str
    unit: str
    least: float
    spare: str


EPISODE = Meant(EPISODE_OPTION, EPISODE_VARIABLE, "seconds", 1.0, "and 10 s")


def read_episode_limit(given: str | None = None) -> float:
    """The wall time that an episode may take, as the option or the environment has it. [s]

    Raises:
        InvalidValue: it is no number of seconds, or less than one.
    """
    written = given or os.environ.get(EPISODE_VARIABLE)
    return read_number(written, EPISODE) if written else EPISODE_S


def read_number(written: str, meant: Meant) -> float:
    """A limit that was given.

    Raises:
        InvalidValue: it is no number, or less than makes sense.
    """
    try:
        limit = float(written)
    except ValueError:
        limit = math.nan
    if not meant.least <= limit < math.inf:
        raise InvalidValue(
            meant.option,
            f"'{written}' is no number of {meant.unit}, {meant.least:g} or more.",
            f"Give the option or {meant.variable} what a planner needs, {meant.spare} to spare.",
        )
    return limit
