"""Measures of an episode, each declared once.

The declarations define the columns of the store, filters and exports, the tables of the user
interfaces, the REST document, and the tables in docs/measures.md and docs/episodes.md. To add a
measure, declare it in `LaterMeasures`, compute it in
`eigenfail_workers.measures.recorder.Recorder.measures`, and store it by a migration.
"""

import struct
from collections.abc import Mapping
from math import nan
from types import MappingProxyType
from typing import Annotated, get_args

import msgspec
from msgspec.structs import replace

FIRST_MEASURES = 4
"""Number of measures in the first release."""

DIGESTED_MEASURES = 12
"""Number of measures that a digest covers.

Later measures follow from the same course, except for two: `cause` also uses the planner's report
of lost tracks (`TrackingPlanner`), and `peak_braking_mps2` is stated by the simulator.
"""


# 1e15² × 1e7 = 1e37, far from the largest double.
MAX_MAGNITUDE = 1e15
"""Largest measure or log-probability: sums and squares over ten million episodes stay finite."""


class Measure(msgspec.Struct, frozen=True, kw_only=True):
    """Description of a measure of an episode.

    Attributes:
        label: name in tables and on pages, without its unit.
        unit: unit of the values; empty for counts.
        words: description for columns of lists and files, without the unit.
        formula: definition for docs/measures.md.
        source: source of the definition or of its threshold; may be empty.
        event: event at this time, for measures that are points in time; else empty.
        digits: number of significant digits to show.
        is_count: whether values are whole numbers; read from the type of the field.
        is_text: whether values are texts; read from the type of the field.
    """

    label: str
    unit: str = ""
    words: str
    formula: str
    source: str = ""
    event: str = ""
    digits: int = 3
    is_count: bool = False
    is_text: bool = False

    @property
    def heading(self) -> str:
        """Label with its unit, as in `robustness [m]`."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def description(self) -> str:
        """Words with their unit, as in `smallest time to collision [s]`."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


class LaterMeasures(msgspec.Struct, frozen=True, kw_only=True):
    """The measures that follow the fields of `Measures`; None if a measure does not apply.

    Times are in seconds from the start. Violations refer to the vehicle that was struck. Without a
    collision, they are the earliest violations of any vehicle.
    """

    # `Measures` and the rows of lists inherit from this class. Its fields are keyword-only because
    # msgspec puts these behind positional fields: the order of fields in messages, answers and
    # digests is the order in which measures were added, in both. New measures go at the end.
    ttc_violated_s: Annotated[
        float | None,
        Measure(
            label="TTC < 1.5 s at",
            unit="s",
            words="when the time to collision first fell below 1.5 s",
            formula="when TTC was first below 1.5 s; empty if never",
            source="threshold: paper",
            event="TTC below 1.5 s",
        ),
    ] = None
    drac_violated_s: Annotated[
        float | None,
        Measure(
            label="DRAC > 7 m/s² at",
            unit="s",
            words="when DRAC first exceeded 7 m/s²",
            formula="when DRAC was first above 7.0 m/s²; empty if never",
            source="threshold: paper; the same for all brakes",
            event="DRAC above 7 m/s²",
        ),
    ] = None
    drac_at_warning_mps2: Annotated[
        float | None,
        Measure(
            label="DRAC at the first TTC < 1.5 s",
            unit="m/s²",
            words="DRAC at ttc_violated_s",
            formula="DRAC at `ttc_violated_s`, the fixed moment at which a collision is classified",
            source="own choice",
        ),
    ] = None
    collided_s: Annotated[
        float | None,
        Measure(
            label="collision at",
            unit="s",
            words="when the collision was seen",
            formula="when the collision was seen: at the end of a step; empty without one",
            event="collision",
        ),
    ] = None
    left_road_s: Annotated[
        float | None,
        Measure(
            label="left the road at",
            unit="s",
            words="when the ego was first off its road",
            formula=(
                "when the ego's centre was first beside the outer lanes, or beyond the end of a "
                "lane 0 that ends; empty if never"
            ),
            event="left the road",
        ),
    ] = None
    max_jerk_mps3: Annotated[
        float | None,
        Measure(
            label="largest jerk",
            unit="m/s³",
            words="largest jerk",
            formula="largest |a_t − a_{t−1}| ÷ dt of the applied acceleration, with a_0 = 0",
        ),
    ] = None
    hard_brakings: Annotated[
        int | None,
        Measure(
            label="hard brakings",
            words="how often hard braking began",
            formula="how often an applied deceleration above 3.0 m/s² began while moving",
            source="about the 10 ft/s² that ITE's yellow-time formula calls comfortable",
        ),
    ] = None
    clipped_steps: Annotated[
        int | None,
        Measure(
            label="clipped steps",
            words="steps in which more was asked for than the truck can do",
            formula="in how many steps the planner asked for more than the truck can do",
        ),
    ] = None
    final_drac_mps2: Annotated[
        float | None,
        Measure(
            label="DRAC at the last step",
            unit="m/s²",
            words="DRAC at the last step, 0 without a conflict then",
            formula="largest DRAC at the last step; 0 without a conflict, empty after contact",
            source="FHWA",
        ),
    ] = None
    nearest_m: Annotated[
        float | None,
        Measure(
            label="smallest distance",
            unit="m",
            words="smallest distance to another vehicle, where requirements are named",
            formula=(
                "smallest distance between the footprints of the ego and any other vehicle, 0 on a "
                "collision; empty where the campaign names no requirements, as it is the "
                "robustness then"
            ),
        ),
    ] = None
    violated: Annotated[
        int | None,
        Measure(
            label="violated requirement",
            words="number of the first requirement that is violated, from 1",
            formula=(
                "number of the first requirement of the campaign that the episode violates, from "
                "1; empty without one, and where the campaign names no requirements"
            ),
        ),
    ] = None
    cause: Annotated[
        str | None,
        Measure(
            label="cause",
            words="cause of the collision, where the scenario names one",
            formula=(
                "challenge of the vehicle struck and, where the planner reports it, whether it "
                "lost the track of that vehicle before, as in `reveal, track lost`; the vehicle "
                "struck need not be the one that the planner reacted to; empty without a "
                "collision, and in scenarios that name no challenges"
            ),
            source="own choice",
        ),
    ] = None
    peak_braking_mps2: Annotated[
        float | None,
        Measure(
            label="peak braking of the ego",
            unit="m/s²",
            words="deceleration that the ego's brakes can do",
            formula="what the ego's brakes can do; empty if it is not stated: 7 m/s² then",
        ),
    ] = None


class Measures(LaterMeasures, frozen=True, gc=False):
    """Measures of one episode; formulas and sources are in docs/measures.md.

    Times are in seconds from the start. Violations refer to the vehicle that was struck. Without a
    collision, they are the earliest violations of any vehicle.
    """

    robustness_m: Annotated[
        float,
        Measure(
            label="robustness",
            unit="m",
            words="smallest distance to another vehicle, or robustness of the requirements",
            formula=(
                "smallest distance between the footprints of the ego and any other vehicle, 0 on a "
                "collision; where the campaign names requirements, the smallest of robustness ÷ "
                "`scale`, 0 where one is violated"
            ),
            source="paper",
        ),
    ]
    severity: Annotated[
        float | None,
        Measure(
            label="severity",
            unit="m²/s²",
            words="squared relative speed at the collision",
            formula=(
                "‖v_ego − v_actor‖² at the collision, with the vehicle struck; empty without one"
            ),
            source="paper",
        ),
    ] = None
    min_ttc_s: Annotated[
        float | None,
        Measure(
            label="min TTC",
            unit="s",
            words="smallest time to collision",
            formula="smallest TTC = gap ÷ closing speed; empty if the ego never closed in",
            source="FHWA, paper",
        ),
    ] = None
    max_drac_mps2: Annotated[
        float | None,
        Measure(
            label="max DRAC",
            unit="m/s²",
            words="largest deceleration required to avoid the crash",
            formula="largest DRAC = closing speed² ÷ (2 · gap); empty if the ego never closed in",
            source="FHWA, paper",
        ),
    ] = None

    @property
    def distance_m(self) -> float:
        """Smallest distance to another vehicle, even if robustness refers to requirements. [m]"""
        return self.robustness_m if self.nearest_m is None else self.nearest_m

    def packed(self) -> bytes:
        """Return the first twelve measures as little-endian doubles, NaN for None, for a digest.

        Trailing values of None after the fourth measure are left out: results that were stored when
        there were only four measures keep their digests.
        """
        numbers = list(msgspec.structs.astuple(self)[:DIGESTED_MEASURES])
        while len(numbers) > FIRST_MEASURES and numbers[-1] is None:
            numbers.pop()
        return struct.pack(f"<{len(numbers)}d", *[nan if n is None else n for n in numbers])


def read_declarations(kind: type[msgspec.Struct]) -> Mapping[str, Measure]:
    """Return the declarations of a struct's measures by field name, in the order of the fields."""
    declared: dict[str, Measure] = {}
    for field in msgspec.structs.fields(kind):
        match get_args(field.type):
            case values, Measure() as measure:
                kinds = get_args(values)
                declared[field.name] = replace(measure, is_count=int in kinds, is_text=str in kinds)
    return MappingProxyType(declared)


MEASURES = read_declarations(Measures)
