"""The text of any error is fit for messages, JSON and databases."""

import unicodedata

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail import errors
from eigenfail.values.episode import EpisodeFault, EpisodeTask, PriorSource, unrunnable
from eigenfail.wire.http import make_error, make_problem
from eigenfail.wire.messages import Results, encode, read_worker_message
from eigenfail_workers.faults import make_fault, wrap_errors

ANY_TEXT = st.text(st.characters(), max_size=50) | st.text(
    st.sampled_from("\x00\x1b\ud800\udc80\udfff\n\t\r\x7f\x9b\u2028é🚚"), max_size=20
)
"""Any code points, lone surrogates and controls among them."""

TASK = EpisodeTask(0, 0, PriorSource())


def is_safe(text: str) -> bool:
    unsafe = (
        (letter < " " and letter not in "\n\t")
        or "\x7f" <= letter < "\xa0"
        or "\ud800" <= letter <= "\udfff"
        or (unicodedata.category(letter) == "Cf" and letter not in "\u200c\u200d")
        for letter in text
    )
    return type(text) is str and not any(unsafe)


class Failing(Exception):
    """Has no text: `__str__` does what the test says."""

    def __str__(self) -> str:
        return self.args[0]()


class Text(str):
    """A str that lies about itself."""

    __slots__ = ()

    def __len__(self) -> int:
        return 0

    def __str__(self) -> str:
        raise ValueError

    def isprintable(self) -> bool:
        return True


def quit_program() -> str:
    raise SystemExit(3)


def recurse() -> str:
    return recurse()


@given(ANY_TEXT)
def test_any_text_is_made_safe_and_safe_text_stays(text) -> None:
    cleaned = errors.clean_text(text)
    assert is_safe(cleaned)
    assert errors.clean_text(cleaned) == cleaned
    if is_safe(text):
        assert cleaned == text


@given(ANY_TEXT, st.integers(20, 60))
def test_the_text_is_bounded(text, longest) -> None:
    assert len(errors.clean_text(text * 50, longest)) <= longest


@given(ANY_TEXT)
@pytest.mark.fault("plug-in error whose text cannot be kept")
def test_a_fault_of_any_error_crosses_the_wire_as_it_is(text) -> None:
    for error in (ValueError(text), errors.PlannerError(text, text), Failing(lambda: text)):
        with (
            pytest.raises((errors.PlannerError, Exception)) as caught,
            wrap_errors(errors.PlannerError, "It", ""),
        ):
            raise error
        result = unrunnable(TASK, make_fault(caught.value))
        (read,) = read_worker_message(encode(Results(1, (result,)))).results
        assert read.fault == result.fault
        assert read.fault.kind == "planner"
        assert is_safe(read.fault.message)
        assert msgspec.json.decode(msgspec.json.encode(read.fault), type=EpisodeFault) == read.fault


@given(ANY_TEXT)
def test_what_another_peer_sends_as_a_fault_is_made_safe_where_it_is_read(text) -> None:
    text = text.encode("utf-8", "replace").decode()
    sent = msgspec.msgpack.encode({"kind": "planner", "message": text * 500})
    read = msgspec.msgpack.decode(sent, type=EpisodeFault)
    assert is_safe(read.message)
    assert len(read.message) <= errors.LONGEST_TEXT


@given(ANY_TEXT)
def test_an_error_of_ours_is_a_problem_that_json_takes(text) -> None:
    problem = make_problem(errors.InvalidValue("planner", text, text))
    assert is_safe(problem.detail)
    read = msgspec.json.decode(msgspec.json.encode(problem), type=type(problem))
    assert str(make_error(read)).split() == str(make_error(problem)).split()


@pytest.mark.parametrize("behaviour", [quit_program, recurse, lambda: 7, lambda: b"", lambda: None])
@pytest.mark.fault("plug-in error whose text cannot be kept")
def test_an_error_without_a_text_is_told_by_its_type(behaviour) -> None:
    told = "Failing: <the text of this Failing cannot be read>"
    assert errors.describe_error(Failing(behaviour)) == told


def test_an_error_with_an_empty_text_is_its_type_alone() -> None:
    assert errors.describe_error(ZeroDivisionError()) == "ZeroDivisionError"


def test_a_text_that_is_no_plain_string_becomes_one() -> None:
    assert errors.clean_text(Text("half \udc80")) == "half \\udc80"
    assert type(errors.read_text(Failing(lambda: Text("whole")))) is str


def test_a_type_without_a_name_is_told_all_the_same() -> None:
    class Nameless(type):
        @property
        def __name__(cls) -> str:
            raise RuntimeError

    class Error(Exception, metaclass=Nameless):
        def __str__(self) -> str:
            raise RuntimeError

    assert "unnamed" in errors.describe_error(Error())


def test_megabytes_are_cut_off() -> None:
    told = errors.describe_error(ValueError("x" * 5_000_000))
    assert len(told) < errors.LONGEST_TEXT + 50
    assert told.endswith("(cut off)")


def test_a_plug_ins_own_error_cannot_name_a_kind_that_there_is_not() -> None:
    class Own(errors.SolverError):
        kind = "\udc80"

    assert make_fault(Own("no solution")).kind == "solver"
