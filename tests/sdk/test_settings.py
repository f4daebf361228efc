"""Settings of plug-ins: their defaults, and how a value that is refused is described."""

from typing import Annotated

import msgspec
import pytest
from msgspec import Meta

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import convert, defaults_of, read_settings
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign_spec import CampaignSpec


class Inner(msgspec.Struct, frozen=True):
    gain: float = 0.5


class Outer(msgspec.Struct, frozen=True):
    seed: int
    inner: Inner = Inner()
    names: tuple[str, ...] = ("a",)
    made: dict[str, int] = {}


def test_defaults_are_plain_and_leave_out_what_is_required() -> None:
    assert defaults_of(Outer) == {"inner": {"gain": 0.5}, "names": ("a",), "made": {}}


def test_defaults_written_down_change_nothing() -> None:
    assert read_settings(Outer, {"seed": 1, **defaults_of(Outer)}, "settings") == Outer(1)


class Raising(msgspec.Struct, frozen=True):
    gain: float = 0.5

    def __post_init__(self) -> None:
        raise ZeroDivisionError("1 / gain \udc80")


def test_settings_at_which_a_plug_in_raises_are_refused_by_their_field() -> None:
    with pytest.raises(
        InvalidValue, match=r"settings: .* ZeroDivisionError: 1 / gain \\udc80\."
    ) as e:
        read_settings(Raising, {"gain": 0.0}, "settings")
    assert e.value.field == "settings"


class Inside(msgspec.Struct, frozen=True):
    needed: Annotated[float, Meta(gt=0.0)]


class Bounded(msgspec.Struct, frozen=True):
    distance_m: Annotated[float, Meta(ge=52.0, le=70.0, description="A gap.")] = 58.0
    most: Annotated[int, Meta(ge=1)] | None = None
    word: Annotated[str, Meta(min_length=1)] = "a"
    values: tuple[Annotated[float, Meta(gt=0.0)], ...] = ()
    by_name: dict[str, Annotated[float, Meta(lt=0.5)]] = {}
    inside: Inside | None = None
    large: Annotated[int, Meta(ge=0, le=1_000_000_000)] = 1
    plain: int | float | str | None = None


@pytest.mark.parametrize(
    ("given", "refusal"),
    [
        ({"distance_m": 588}, "spec.distance_m: 588 is not a number from 52 to 70."),
        ({"distance_m": "x"}, 'spec.distance_m: "x" is not a number.'),
        ({"distance_m": None}, "spec.distance_m: null is not a number."),
        ({"most": 0}, "spec.most: 0 is not an integer of at least 1."),
        ({"most": "0"}, 'spec.most: "0" is not an integer.'),
        ({"word": ""}, 'spec.word: "" is not text of a length of at least 1.'),
        ({"word": 3}, "spec.word: 3 is not text."),
        ({"values": [1.0, -1.0]}, "spec.values[1]: -1.0 is not a number above 0.0."),
        ({"values": [1.0, "x" * 99]}, "spec.values[1]: a number is expected."),
        ({"values": 5}, "spec.values: 5 is not a list."),
        # msgspec does not say which entry of a table it refuses.
        ({"by_name": {"a": 0.1, "b": 1.0}}, "spec.by_name[...]: a number below 0.5 is expected."),
        ({"inside": {"needed": 0}}, "spec.inside.needed: 0 is not a number above 0.0."),
        ({"inside": {}}, "spec.inside.needed: is required."),
        ({"large": -1}, "spec.large: -1 is not an integer from 0 to 1000000000."),
        ({"plain": [1.0]}, "spec.plain: [1.0] is not an integer, a number or text."),
        ([], "spec: [] is not an object."),
    ],
)
def test_a_refusal_says_what_was_given_and_what_is_wanted(given, refusal) -> None:
    with pytest.raises(InvalidValue) as raised:
        convert(given, Bounded, "spec")
    assert str(raised.value).startswith(refusal)


@pytest.mark.parametrize(
    ("kind", "given", "words"),
    [
        (
            CampaignSpec,
            {"name": "n", "method": "m", "episodes": 1, "priority": "urgent"},
            "priority: 'urgent' is none of low, normal, high.",
        ),
        (AnalysisSettings, {"centre": "middle"}, "centre: 'middle' is none of mean, median."),
    ],
)
def test_a_value_that_is_no_choice_is_shown_with_the_choices(
    kind: type, given: dict[str, object], words: str
) -> None:
    with pytest.raises(InvalidValue) as refusal:
        convert(given, kind)
    assert str(refusal.value).startswith(words)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"stop": {"failuers": 3}}, "spec.stop: 'failuers' is not known. Did you mean 'failures'?"),
        ({"na'm": 1}, "spec: 'na'm' is not known. Did you mean 'name'?"),
        (
            {"requirements": [{"kind": "headway"}]},
            "spec.requirements[0].kind: 'headway' is not known. Did you mean 'time_headway'?",
        ),
        (
            {"disturbance": {"channels": [{"name": "speed", "sgima": 1.0}]}},
            "spec.disturbance.channels[0]: 'sgima' is not known. Did you mean 'sigma'?",
        ),
    ],
)
def test_an_unknown_name_is_refused_with_those_that_may_be_meant(
    given: dict[str, object], words: str
) -> None:
    with pytest.raises(UnknownName) as refusal:
        convert({"name": "n", "method": "m", "episodes": 1, **given}, CampaignSpec, "spec")
    assert str(refusal.value).startswith(words)
