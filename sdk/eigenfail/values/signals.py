"""Signals: named scalars of every step of a drive, for the evaluation of requirements.

A course has a value of each signal for the start and after every step. Values are always finite, so
that robustness is finite, too. If a quantity is undefined, such as the time to collision of
vehicles that do not close in, the signal has its `absent` value.
"""

from collections.abc import Mapping, Sequence
from numbers import Real
from types import MappingProxyType
from typing import Final, NamedTuple, TypeGuard

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, read_text
from eigenfail.values.arrays import fits_float32
from eigenfail.values.measures import Measures

Samples = NDArray[np.float64]
"""The values of a signal, shape (steps + 1,)."""

NEVER_S: Final = 60.0
"""Time to an event that does not come; longer times are cut to it. [s]"""

NOBODY_M: Final = 1_000.0
"""Gap without a vehicle ahead; longer gaps are cut to it. [m]"""

ERROR: Final = "error"
"""First part of the names of the signals of channels: `error.longitudinal`."""

BRIDGE: Final = "bridge"
"""First part of the names of the signals that a bridge reports: `bridge.planned_gap_m`."""


PLANNER: Final = "planner"
"""First part of the names of the signals that a planner reports: `planner.lost_tracks`."""


class SignalDescription(msgspec.Struct, frozen=True, kw_only=True):
    """Description of a signal.

    Attributes:
        unit: unit of the signal; empty for none.
        words: description without the unit.
        absent: value if the quantity is undefined; None if it is always defined.
        needs_lane: whether it needs the lane of the ego, which not every simulator reports.
    """

    unit: str
    words: str
    absent: float | None = None
    needs_lane: bool = False


SIGNALS: Mapping[str, SignalDescription] = MappingProxyType(
    {
        "distance_m": SignalDescription(
            unit="m", words="smallest distance between the footprints of ego and another vehicle"
        ),
        "preventable_distance_m": SignalDescription(
            unit="m",
            words=(
                "the same without vehicles whose cut-in UN R157 does not hold to be preventable"
            ),
            absent=NOBODY_M,
            needs_lane=True,
        ),
        "ttc_s": SignalDescription(
            unit="s", words="smallest time to collision with another vehicle", absent=NEVER_S
        ),
        "ttc_ahead_s": SignalDescription(
            unit="s",
            words="the same with vehicles whose centre is ahead of the ego's",
            absent=NEVER_S,
        ),
        "drac_mps2": SignalDescription(
            unit="m/s²", words="largest deceleration required to avoid a crash", absent=0.0
        ),
        "gap_m": SignalDescription(
            unit="m",
            words="distance along the road to the next vehicle ahead in the path of the ego",
            absent=NOBODY_M,
        ),
        "leader_speed_mps": SignalDescription(
            unit="m/s", words="speed along the road of that vehicle; of the ego where there is none"
        ),
        "headway_s": SignalDescription(unit="s", words="gap_m ÷ speed of the ego", absent=NEVER_S),
        "speed_mps": SignalDescription(unit="m/s", words="speed of the ego"),
        "acceleration_mps2": SignalDescription(
            unit="m/s²", words="acceleration of the ego in the step just taken; 0 at the start"
        ),
        "jerk_mps3": SignalDescription(
            unit="m/s³", words="change of the acceleration ÷ duration of a step; 0 at the start"
        ),
        "lane_offset_m": SignalDescription(
            unit="m",
            words="offset of the ego from the centre of the nearest lane, to the left above 0",
            needs_lane=True,
        ),
        "lane_margin_m": SignalDescription(
            unit="m",
            words="distance of the ego's footprint from the nearer border of that lane; below 0 "
            "beyond it",
            needs_lane=True,
        ),
    }
)
"""Signals of every drive by name. Each channel of its noise has a further signal, `error.CHANNEL`:
the perceived minus the true value, in the unit of the channel."""


def list_signals(channels: Sequence[str], *, tells_lane: bool) -> tuple[str, ...]:
    """Return the names of the signals of a campaign on a road.

    Args:
        channels: names of the channels of its noise.
        tells_lane: whether the simulator reports the lane of the ego.
    """
    drive = [name for name, each in SIGNALS.items() if tells_lane or not each.needs_lane]
    return *drive, *[f"{ERROR}.{channel}" for channel in channels]


def read_signal_names(planner: object) -> tuple[str, ...]:
    """Return the names of the signals of a planner or its class; none if it reports none.

    Raises:
        InvalidValue: its `signal_names` is not a tuple of names.
    """
    names = getattr(planner, "signal_names", ())
    if not (isinstance(names, tuple) and all(isinstance(name, str) for name in names)):
        problem = f"its `signal_names` is {read_text(names)}, not a tuple of names."
        raise InvalidValue("planner", problem, 'Write it as signal_names = ("lost_tracks",).')
    return names


def is_signal_value(value: object) -> TypeGuard[float]:
    """Return whether a planner may report the value: a finite number, not a boolean.

    Numbers of numpy are allowed. A number beyond the range of float32 is not: it would not be
    finite once stored.
    """
    return not isinstance(value, bool) and isinstance(value, Real) and fits_float32(value)


class ExpectedCourse(NamedTuple):
    """The signals that all episodes of a campaign will have.

    Attributes:
        signals: names of the signals.
        dt_s: time between two steps.
        duration_s: duration of a full episode.
    """

    signals: tuple[str, ...]
    dt_s: float
    duration_s: float


class DrivenCourse(NamedTuple):
    """Signals and measures of an episode, for its requirements.

    Attributes:
        dt_s: time between two steps.
        signals: values of the signals that the requirements need, by name.
        measures: measures of the whole episode.
    """

    dt_s: float
    signals: Mapping[str, Samples]
    measures: Measures
