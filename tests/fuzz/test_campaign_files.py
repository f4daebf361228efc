"""Campaign files that were bent: each is taken, or refused in words with exit code 2."""

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from benchmarks.faults.invalid_messages import cut_short, flip_bits
from typer.testing import CliRunner

from eigenfail.cli.connection import Environment
from eigenfail.cli.main import app
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.client import Client
from eigenfail.errors import EigenfailError, InvalidValue, ServiceUnreachable
from eigenfail_services.campaigns.validation import check_spec

SEED = 20261122
FILES = 3_000
THROUGH_THE_COMMAND = 200
WRONG_USAGE, NO_SERVICE = 2, 3
TRUE = [path.read_bytes() for path in sorted(Path("examples").glob("*.toml"))]

ODD = (
    *("nan", "inf", "-inf", "-1", "0", "1e400", "9" * 400, "0x7fffffffffffffffffff", "true"),
    *('""', '"\\u0000"', '"' + "x" * 5_000 + '"', "'''\n'''", "[]", "{}", "[[[]]]", '[1, "a"]'),
    *("[nan]", "{ low = 1, high = 0 }", "{ a = { b = { c = 1 } } }"),
    *("1979-05-27T07:32:00Z", "07:32:00", "1979-05-27"),
)
LINES = (
    *("[disturbance]", "[stop]", "[[stop]]", "[settings]", "[scenario_parameters]"),
    *("[planner_settings]", "[disturbance.shape]", 'kind = "ar1"', "a.b.c = 1", "\ufeff", "\x00"),
    *("x = [[[[[[[[", "name = 1", 'simulator = "function"', 'planner = "os:system"'),
)

TOO_DEEP = "x = " + "[" * 5_000
TOO_LONG = "x = " + "9" * 5_000


def bent_files(seed: int, n: int) -> Iterator[bytes]:
    """The bytes of n files, each made from an example."""
    random = Random(seed)
    for _ in range(n):
        yield random.choice(BENDS)(random, random.choice(TRUE))


def bend_lines(random: Random, data: bytes) -> bytes:
    lines = data.decode().split("\n")
    for _ in range(random.choice((1, 1, 2, 4))):
        at = random.randrange(len(lines))
        field, is_value, _ = lines[at].partition("=")
        odd = f"{field}= {random.choice(ODD)}" if is_value else random.choice(LINES)
        swapped = random.choice(lines)
        lines[at : at + 1] = random.choice(([odd], [odd], [odd], [lines[at], swapped], []))
        lines = lines or [""]
    return "\n".join(lines).encode()


BENDS = (cut_short, flip_bits, bend_lines, bend_lines, bend_lines)


@pytest.mark.fault(
    "malformed campaign file",
    group="api",
    outcome="`eigenfail run` refuses it in words with exit code 2, never with a traceback.",
)
def test_a_bent_file_is_taken_or_refused_as_wrong_usage(tmp_path: Path) -> None:
    file = tmp_path / "bent.toml"
    taken, refused = 0, set()
    for data in bent_files(SEED, FILES):
        file.write_bytes(data)
        try:
            spec = read_spec(file)
            check_plugins(spec)
            check_spec(spec)
            taken += 1
        except EigenfailError as error:
            refused.add(error.exit_code)
    assert refused == {WRONG_USAGE}
    assert 0 < taken < FILES


def nobody(url: str) -> Client:
    """Where a file is sent that is good so far."""
    raise ServiceUnreachable(f"No service is at {url}.")


@pytest.mark.fault("malformed campaign file")
@pytest.mark.parametrize("command", ["check", "create"])
def test_the_command_never_ends_in_a_traceback(tmp_path: Path, command: str) -> None:
    file = tmp_path / "bent.toml"
    codes = set()
    for data in bent_files(SEED + 1, THROUGH_THE_COMMAND):
        file.write_bytes(data)
        words = ["campaign", command, str(file), "--url", "http://nowhere"]
        done = CliRunner().invoke(app, words, obj=Environment(nobody))
        assert isinstance(done.exception, SystemExit), data
        assert done.output.startswith("eigenfail: ")
        codes.add(done.exit_code)
    assert codes == {WRONG_USAGE, NO_SERVICE}


@pytest.mark.fault("malformed campaign file")
@pytest.mark.parametrize("text", [TOO_DEEP, TOO_LONG])
def test_what_tomllib_gives_up_on_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "bent.toml"
    file.write_text(text)
    with pytest.raises(InvalidValue, match="is not TOML"):
        read_spec(file)
