"""Columns of a vehicle's track, in order of time, and the values that they may have."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.files import TableColumns
from eigenfail.values.disturbance import Doubles

REQUIRED = ("id", "time_s", "x_m", "y_m")

OPTIONAL = ("heading_rad", "speed_mps", "length_m", "width_m")

USUAL_SIZE_M = {"length_m": 5.0, "width_m": 2.0}
"""Size of a vehicle whose track has none."""


LARGEST_SIZE_M = {"length_m": 100.0, "width_m": 20.0}
"""Larger vehicles are in another unit. The longest road trains have 54 m."""


WIDEST_M = 3.0
"""What moves on a road and is wider has its length and width exchanged, if it is shorter."""


FARTHEST_M = 1e8
"""Coordinates beyond this are no places on Earth: northings reach 10⁷ m. [m]"""


LATEST = 1e19
"""Times beyond this are none in any unit: there have been 1.8 · 10¹⁸ ns since 1970."""


STANDING_MPS = 0.1
"""Below this speed a direction does not follow from two positions. [m/s]"""


MOST_NAMED = 20
"""Names that an error or a note lists."""


REMEDY = f"A track has the columns {', '.join(REQUIRED)}, and perhaps {', '.join(OPTIONAL)}."

COLUMNS = TableColumns("id", REQUIRED[1:], OPTIONAL, REMEDY)

Track = Mapping[str, Doubles]
"""Columns of a vehicle in order of time, each of shape (rows,)."""


class RecordedFile(NamedTuple):
    """Vehicles of a file.

    Attributes:
        tracks: the columns of each vehicle, by name.
        left_out: vehicles in a form that is not read, with the reason.
        notes: what else of the file is not read, in sentences.
    """

    tracks: Mapping[str, Track]
    left_out: Mapping[str, str]
    notes: tuple[str, ...] = ()


def list_names(names: Iterable[str]) -> str:
    """Return names with commas between them, and how many more there are of a long list."""
    listed = list(names)
    more = f" and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else ""
    return ", ".join(listed[:MOST_NAMED]) + more


def refuse_impossible(name: str, track: Track) -> None:
    """Refuse a vehicle with two rows of one time, and places or sizes that no vehicle has.

    Args:
        name: name of the vehicle.
        track: its columns, in order of time.

    Raises:
        InvalidValue: the vehicle has such rows or values.
    """
    if (latest := float(np.abs(track["time_s"]).max())) > LATEST:
        problem = f"time_s of vehicle '{name}' reaches {latest:g}."
        raise InvalidValue("tracks", problem, "Give it in seconds.")
    if (np.diff(track["time_s"]) <= 0.0).any():
        place = int(np.argmax(np.diff(track["time_s"]) <= 0.0))
        problem = f"Vehicle '{name}' has two rows of one time, {track['time_s'][place]:g} s."
        remedy = "Remove one of them, or give each vehicle an id of its own."
        raise InvalidValue("tracks", problem, remedy)
    for column in ("x_m", "y_m"):
        if (far := np.abs(track[column]) > FARTHEST_M).any():
            value = track[column][int(np.argmax(far))]
            problem = f"{column} of vehicle '{name}' is {value:g}, which is not a place on Earth."
            raise InvalidValue("tracks", problem, "Give positions in metres.")
    _refuse_sizes(name, track)


def _refuse_sizes(name: str, track: Track) -> None:
    """Refuse sizes that no vehicle has.

    Raises:
        InvalidValue: the vehicle has one.
    """
    for column, largest_m in LARGEST_SIZE_M.items():
        for value in track.get(column, ()):
            if not 0.0 < value <= largest_m:
                problem = (
                    f"{column} of vehicle '{name}' is {value:g}. It must be above 0 and at most "
                    f"{largest_m:g} m."
                )
                remedy = "Correct it, or remove the column if the size is not known."
                raise InvalidValue("tracks", problem, remedy)
    length_m, width_m = (float(np.max(track.get(each, [0.0]))) for each in LARGEST_SIZE_M)
    moved_m = float(np.hypot(np.ptp(track["x_m"]), np.ptp(track["y_m"])))
    if width_m > max(length_m, WIDEST_M) and length_m and moved_m > length_m:
        problem = f"Vehicle '{name}' is {width_m:g} m wide, {length_m:g} m long, and moves."
        remedy = "Exchange length_m and width_m, or correct them."
        raise InvalidValue("tracks", problem, remedy)
