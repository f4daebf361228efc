"""`eigenfail db`: a database of one's own, made and checked."""

import json
import re

import pytest

SAYS = {
    "upgrade": r"The database's schema is at revision \d{4}, which is this program's\.\n",
    "check": r"The database's schema is this program's: revision \d{4}\.\n",
    "current": r"\d{4}\n",
}


@pytest.mark.service
def test_a_database_is_made_and_found_to_be_this_programs(eigenfail, tmp_path):
    for action, words in SAYS.items():
        told = eigenfail("db", action, "--data", tmp_path)
        assert told.exit_code == 0, told.output
        assert re.fullmatch(words, told.stdout)
    said = json.loads(eigenfail("db", "current", "--data", tmp_path, "--json").stdout)
    assert re.fullmatch(r"\d{4}", said["said"])


@pytest.mark.service
def test_one_that_is_not_there_is_trouble_with_a_way_out(eigenfail, tmp_path):
    told = eigenfail("db", "check", "--data", tmp_path)
    assert told.exit_code == 3
    assert "Make it: eigenfail db upgrade" in told.stderr
