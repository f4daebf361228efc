"""What the settings of plug-ins are unless they are given."""

import msgspec
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.settings import defaults_of, read_settings


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
