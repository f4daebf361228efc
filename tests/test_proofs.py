"""No test is skipped quietly."""

from pathlib import Path

import proofs
import pytest

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.fixture
def tool():
    pytest.skip("no such tool")

def test_proved():
    pass

def test_with_a_tool(tool):
    pass

@pytest.mark.skipif(True, reason="another kernel")
def test_marked():
    pass

@pytest.mark.xfail(reason="not yet")
def test_known():
    assert False
"""


@pytest.fixture
def run(pytester, monkeypatch):
    monkeypatch.delenv(proofs.VARIABLE, raising=False)
    pytester.makeconftest(Path(proofs.__file__).read_text())
    pytester.makepyfile(TESTS)
    return lambda *words: pytester.runpytest_inprocess("-p", "no:cacheprovider", *words)


@pytest.mark.parametrize("spread", [(), ("--numprocesses", "1")])
def test_what_is_skipped_is_told_under_one_heading(run, spread) -> None:
    told = run(*spread)
    told.assert_outcomes(passed=1, skipped=2, xfailed=1)
    assert told.ret == 0
    told.stdout.fnmatch_lines(
        [
            "=* NOT PROVED HERE: 2 skipped =*",
            "*::test_marked: another kernel",
            "*::test_with_a_tool: no such tool",
        ],
        consecutive=True,
    )


def test_it_is_a_failure_where_proofs_are_required(run, monkeypatch) -> None:
    monkeypatch.setenv(proofs.VARIABLE, "1")
    told = run()
    assert told.ret == 1
    told.assert_outcomes(passed=1, errors=2, xfailed=1)
    told.stdout.fnmatch_lines(["*EIGENFAIL_REQUIRE_PROOFS is set: no such tool*"])
    told.stdout.fnmatch_lines(["*EIGENFAIL_REQUIRE_PROOFS is set: another kernel*"])


def test_a_module_that_is_skipped_as_a_whole_is_told_or_a_failure(
    run, pytester, monkeypatch
) -> None:
    pytester.makepyfile(test_whole="import pytest\npytest.importorskip('no_such_module')\n")
    told = run("test_whole.py")
    told.stdout.fnmatch_lines(
        ["=* NOT PROVED HERE: 1 skipped =*", "test_whole.py: could not import 'no_such_module'*"]
    )
    monkeypatch.setenv(proofs.VARIABLE, "1")
    told = run("test_whole.py")
    assert told.ret != 0
    told.stdout.fnmatch_lines(["*EIGENFAIL_REQUIRE_PROOFS is set: could not import*"])


def test_nothing_is_told_where_all_was_proved(run) -> None:
    told = run("-k", "test_proved")
    told.assert_outcomes(passed=1, deselected=3)
    assert "NOT PROVED HERE" not in told.stdout.str()
