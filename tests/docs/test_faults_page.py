"""docs/faults.md names tests and modules that are there, and every fault that tests inject."""

import re
import sys
from pathlib import Path

import msgspec
import pytest

sys.path.append(str(Path(__file__).parent))

from fault_table import GROUPS, LEAST_KINDS, MarkError, read_faults, render_page

UPDATE = "Run `make docs`."


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs" / "faults.md").read_text()


@pytest.fixture(scope="module")
def faults():
    return read_faults()


def test_every_test_that_it_names_is_there(page, root):
    named = set(re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", page))
    assert len(named) > 40
    for path, test in named:
        text = (root / path).read_text()
        assert not test or re.search(rf"^(async )?def {test}\b", text, re.MULTILINE), (path, test)


def test_reliability_is_one_page_of_promises_that_faults_explain_and_test(page, root):
    promises = (root / "docs" / "reliability.md").read_text()
    assert len(promises.splitlines()) <= 150
    assert "tests/" not in promises
    kept = re.findall(r"^### (\d)\. .*?(?=^### |^## )", page, re.MULTILINE | re.DOTALL)
    numbers = re.findall(r"^\| (\d) \| \*\*", promises, re.MULTILINE)
    assert kept == numbers == list("123456789")
    sections = re.split(r"^##+ ", page, flags=re.MULTILINE)
    promised = [section for section in sections if section[:1].isdigit()]
    assert all("**Tested by**" in section for section in promised)


def test_every_file_that_it_names_is_there(page, root):
    named = set(re.findall(r"`((?:sdk|services|workers|api|tests)/[\w/]+\.py)`", page))
    assert named
    assert [path for path in named if not (root / path).is_file()] == []


def test_the_tables_of_faults_are_those_of_the_marks(page, faults):
    assert render_page(page, faults) == page, UPDATE


def test_the_claim_counts_the_kinds_that_tests_inject(root, faults):
    claims = msgspec.json.decode((root / "benchmarks" / "results" / "claims.json").read_bytes())
    assert len({fault.kind for fault in faults}) >= LEAST_KINDS
    assert claims["faults.kinds"]["value"] == len(faults), UPDATE
    assert {fault.group for fault in faults} == {*GROUPS}


COMPLETE = '@pytest.mark.fault("a", group="time", outcome="It ends.")'
MISTAKES = {
    f"{COMPLETE}\nclass TestIt:\n    def test_it(self): ...": "must be a decorator",
    f"pytestmark = {COMPLETE[1:]}": "must be a decorator of a test function",
    "from pytest import mark\nfault = mark.fault": "must be a decorator of a test function",
    f"{COMPLETE}\ndef helper(): ...": "must be a decorator of a test function",
    "@pytest.mark.fault\ndef test_it(): ...": "must be a decorator of a test function",
    "@pytest.mark.fault(*KINDS)\ndef test_it(): ...": "must be literal strings",
    '@pytest.mark.fault("a", group="time", outcome=f"{it}")\ndef test_it(): ...': "literal strings",
    "@pytest.mark.fault()\ndef test_it(): ...": "has a kind, and either",
    '@pytest.mark.fault("a", group="time")\ndef test_it(): ...': "has a kind, and either",
    COMPLETE.replace('"time"', '"times"') + "\ndef test_it(): ...": "'times' is none of processes",
    COMPLETE.replace('"a"', '"a."') + "\ndef test_it(): ...": "without a full stop",
    COMPLETE.replace("ends.", "ends") + "\ndef test_it(): ...": "one or more sentences",
    COMPLETE.replace("It ends.", "It | ends.") + "\ndef test_it(): ...": "must not contain '|'",
    '@pytest.mark.fault("a")\ndef test_it(): ...': "'a' has no group and outcome",
    f"{COMPLETE}\ndef test_it(): ...\n"
    f"{COMPLETE.replace('ends', 'goes on')}\ndef test_too(): ...": "several groups or outcomes",
    f"{COMPLETE}\ndef test_it(): ...\n"
    f"{COMPLETE.replace('time', 'api')}\ndef test_too(): ...": "several groups or outcomes",
}


@pytest.mark.parametrize("source", MISTAKES)
def test_marks_that_make_no_table_are_refused(tmp_path, source):
    (tmp_path / "test_marked.py").write_text(source)
    with pytest.raises(MarkError) as refused:
        read_faults(tmp_path, tmp_path)
    (problem,) = refused.value.problems
    assert MISTAKES[source] in problem
    assert "test_marked.py:" in problem


def test_marks_outside_of_test_files_are_refused(tmp_path):
    (tmp_path / "helpers.py").write_text(f"{COMPLETE}\ndef test_it(): ...")
    with pytest.raises(MarkError, match=r"helpers\.py:1: a fault mark must be a decorator"):
        read_faults(tmp_path, tmp_path)


def test_the_tests_of_a_kind_stand_in_its_row_wherever_the_outcome_is_given(tmp_path):
    (tmp_path / "test_a.py").write_text('@pytest.mark.fault("a")\nasync def test_it(): ...')
    (tmp_path / "test_b.py").write_text(f"{COMPLETE}\n{COMPLETE}\ndef test_it(): ...")
    (fault,) = read_faults(tmp_path, tmp_path)
    assert fault == ("a", "time", "It ends.", ("test_a.py::test_it", "test_b.py::test_it"))


def test_a_page_needs_markers_forty_kinds_and_every_kind_of_the_soak(page, faults):
    with pytest.raises(MarkError, match="has no '<!-- faults: api -->'"):
        render_page(page.replace("<!-- faults: api -->", ""), faults)
    with pytest.raises(MarkError, match="mark 39 kinds of faults, 40 at least"):
        render_page(page, faults[:39])
    left = [fault for fault in faults if fault.kind != "SIGKILL of a worker"]
    with pytest.raises(MarkError, match="'SIGKILL of a worker' is injected by the soak"):
        render_page(page, left)
