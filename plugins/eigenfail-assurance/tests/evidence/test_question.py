"""The file of claims: what it may hold, and how files of other commands come in."""

import os
from pathlib import Path

import msgspec
import pytest

from eigenfail.errors import InvalidValue
from eigenfail_assurance.evidence.question import DEEPEST_CLAIM, RiskSolution, read_evidence_file
from eigenfail_assurance.evidence.storage import read_bundle

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_example_is_read():
    question = read_evidence_file(EXAMPLES / "evidence.toml")
    kinds = [type(each).__struct_config__.tag for each in question.claim.list_solutions()]
    assert kinds == ["p_failure", "replay", "search"]


def test_a_file_of_another_command_is_read_from_the_folder_of_the_claims(tmp_path):
    (tmp_path / "road.toml").write_bytes((EXAMPLES / "risk.toml").read_bytes())
    file = tmp_path / "claims.toml"
    file.write_text(
        '[claim]\ntext = "Rare."\n[[claim.solutions]]\nkind = "risk"\nfile = "road.toml"\n'
    )
    question = read_evidence_file(file)
    (solution,) = question.claim.solutions
    assert isinstance(solution, RiskSolution)
    assert solution.question.name == "Motorway"
    assert question.name == "claims"
    stored = msgspec.json.decode(msgspec.json.encode(question), type=type(question))
    assert stored == question


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "claim"),
        ("claim = 3", "claim"),
        ('[claim]\ntext = ""', "claim.text"),
        ('[claim]\ntext = "a"\nclaims = [3]', "claim.claims"),
        ('[claim]\ntext = "a"\nsolutions = [3]', "claim.solutions"),
        ('[claim]\ntext = "a"\nsolutions = [{kind = "risk", file = 3}]', "solutions[0].file"),
        ('[claim]\ntext = "a"\nsolutions = [{kind = "search", file = "x"}]', "solutions[0].file"),
        ('[claim]\ntext = "a"\nsolutions = [{kind = "gate", file = "."}]', "solutions[0].file"),
        ('[claim]\ntext = "a"\nsolutions = [{kind = [1], file = "."}]', "solutions[0].file"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, field):
    file = tmp_path / "claims.toml"
    file.write_text(text)
    with pytest.raises(InvalidValue) as refused:
        read_evidence_file(file)
    assert field in str(refused.value)


@pytest.mark.parametrize("kind", ["gate", "requirement", "risk"])
def test_outputs_are_read_from_regular_files_alone(tmp_path, kind):
    os.mkfifo(tmp_path / "pipe")
    file = tmp_path / "claims.toml"
    for name in ("pipe", "/dev/zero"):
        file.write_text(f'[claim]\ntext = "a"\nsolutions = [{{kind = "{kind}", file = "{name}"}}]')
        with pytest.raises(InvalidValue, match="not a regular file"):
            read_evidence_file(file)
        with pytest.raises(InvalidValue, match="not a regular file"):
            read_bundle(tmp_path / name)


@pytest.mark.parametrize("depth", [DEEPEST_CLAIM + 1, 1_000])
def test_claims_that_are_too_deep_are_refused(tmp_path, depth):
    file = tmp_path / "claims.toml"
    tables = (f"[[claim{'.claims' * level}]]\ntext = 'a'\n" for level in range(1, depth))
    file.write_text("[claim]\ntext = 'a'\n" + "".join(tables))
    with pytest.raises(InvalidValue, match="deep"):
        read_evidence_file(file)


def test_json_of_a_gate_that_is_none_is_refused(tmp_path):
    (tmp_path / "gate.json").write_text('{"open": true}')
    file = tmp_path / "claims.toml"
    file.write_text('[claim]\ntext = "a"\n[[claim.solutions]]\nkind = "gate"\nfile = "gate.json"\n')
    with pytest.raises(InvalidValue, match=r"solutions\[0\].file"):
        read_evidence_file(file)
