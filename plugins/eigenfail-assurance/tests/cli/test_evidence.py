"""`eigenfail evidence` against the real API: verdicts, bundles, and what verification finds."""

import json
import shlex
import shutil

import msgspec
import pytest

from eigenfail import __version__
from eigenfail_assurance.evidence.bundle import MANIFEST, Manifest, make_bundle
from eigenfail_assurance.evidence.recomputation import read_records
from eigenfail_assurance.evidence.records import encode_canonical, hash_bytes
from eigenfail_assurance.evidence.storage import read_bundle, write_bundle

HEAD = """name = "Point mass"

[claim]
text = "The planner is safe enough."
argument = "Argument over what was measured."
assumptions = ["The road is dry."]
"""

PROBABILITY = """
[[claim.claims]]
text = "A failure is rare."

[[claim.claims.solutions]]
kind = "p_failure"
campaigns = {campaigns}
at_most = {at_most}
"""

SEARCH = """
[[claim.claims]]
text = "A search finds few failures."

[[claim.claims.solutions]]
kind = "search"
campaigns = {campaigns}
failures_at_most = {failures}
"""


@pytest.fixture
def write(tmp_path):
    """Writes a file with a top claim and parts below it."""

    def write_file(*parts):
        file = tmp_path / "claims.toml"
        file.write_text(HEAD + "".join(parts))
        return file

    return write_file


@pytest.fixture
def search(eigenfail, spec_file):
    """The id of a search."""
    other = spec_file.with_name("search.toml")
    other.write_text(spec_file.read_text().replace("monte_carlo", "cem"))
    return json.loads(eigenfail("run", other, "--json").stdout)["campaign"]


@pytest.fixture
def bundle(eigenfail, write, done, tmp_path):
    """A bundle with a supported and a refuted claim."""
    parts = (
        PROBABILITY.format(campaigns=[done], at_most=0.99),
        SEARCH.format(campaigns=[done], failures=0),
    )
    made = eigenfail("evidence", write(*parts), "--output", tmp_path / "bundle")
    assert made.exit_code == 1, made.output
    return tmp_path / "bundle"


def verify(eigenfail, bundle, *options):
    done = eigenfail("evidence", "verify", bundle, *options, "--json")
    return done.exit_code, json.loads(done.stdout)


def test_the_argument_is_printed(check_session, write, done, tmp_path):
    parts = (
        PROBABILITY.format(campaigns=[done], at_most=0.99),
        SEARCH.format(campaigns=[done], failures=0),
        '\n[[claim.claims]]\ntext = "Nothing supports this."\n',
    )
    out = tmp_path / "bundle"
    check_session(
        "cli/evidence/refuted",
        ("evidence", write(*parts), "--output", out),
        ("evidence", "verify", out),
    )


def test_the_command_that_is_printed_verifies_the_bundle(eigenfail, write, tmp_path):
    out = tmp_path / "a bundle"
    printed = eigenfail("evidence", write(), "--output", out).stdout
    (line,) = [line for line in printed.splitlines() if line.startswith("Check it: ")]
    program, *command = shlex.split(line.removeprefix("Check it: "))
    root = Manifest(**json.loads((out / MANIFEST).read_text())).sha256
    assert (program, command[-1]) == ("eigenfail", root)
    assert str(out) in command
    command[command.index("--replay") + 1] = "0"
    assert eigenfail(*command).exit_code == 0


def test_a_bundle_is_verified_with_replays(eigenfail, bundle):
    root = Manifest(**json.loads((bundle / MANIFEST).read_text())).sha256
    code, found = verify(eigenfail, bundle, "--replay", 5, "--root-hash", root)
    assert (code, found["defects"], found["notes"]) == (0, [], [])
    assert (found["replayed"], found["solutions"], found["episodes"]) == (5, 2, 24)


CASES = (
    ([(PROBABILITY, {"at_most": 0.99})], 0, "supported"),
    ([(PROBABILITY, {"at_most": 0.99}), (SEARCH, {"failures": 24})], 0, "supported"),
    ([(PROBABILITY, {"at_most": 0.4})], 3, "undecided"),
    ([(PROBABILITY, {"at_most": 1e-6})], 1, "refuted"),
    ([(PROBABILITY, {"at_most": 0.4}), (SEARCH, {"failures": 0})], 1, "refuted"),
    ([], 3, "undeveloped"),
)


def test_the_exit_code_is_that_of_the_top_claim(eigenfail, write, done, tmp_path):
    for parts, code, verdict in CASES:
        file = write(*(part.format(campaigns=[done], **given) for part, given in parts))
        made = eigenfail("evidence", file, "-o", tmp_path / "out", "--force", "--json")
        assert made.exit_code == code, made.output
        said = json.loads(made.stdout)
        assert said["argument"]["verdict"] == verdict
        assert said["root_hash"] == json.loads((tmp_path / "out" / MANIFEST).read_text())["sha256"]


def test_a_search_states_no_probability(eigenfail, write, search, tmp_path):
    file = write(PROBABILITY.format(campaigns=[search], at_most=0.99))
    made = eigenfail("evidence", file, "--output", tmp_path / "out")
    assert made.exit_code == 3
    assert "which chose its episodes" in made.stdout


def test_folder_and_archive_have_one_root_hash(eigenfail, write, done, bundle, tmp_path):
    file = write(
        PROBABILITY.format(campaigns=[done], at_most=0.99),
        SEARCH.format(campaigns=[done], failures=0),
    )
    archive = tmp_path / "bundle.zip"
    assert eigenfail("evidence", file, "--output", archive).exit_code == 1
    one, other = verify(eigenfail, archive), verify(eigenfail, bundle)
    assert one == other
    assert one[0] == 0


def test_the_risk_is_that_of_the_service(eigenfail, write, spec_file, tmp_path):
    runs = [eigenfail("run", spec_file, "--seed", seed, "--json") for seed in (1, 2)]
    one, other = (json.loads(run.stdout)["campaign"] for run in runs)
    risk = tmp_path / "road.toml"
    risk.write_text(
        "[target]\nper_hour = 0.5\n[exposure]\nhours = 200.0\nkilometres = 9_000.0\n"
        f'[[scenarios]]\nname = "a"\nencounters = 40\ncampaigns = [{one}]\n'
        f'[[scenarios]]\nname = "b"\nencounters = 9\ncampaigns = [{other}]\n'
    )
    text = '[[claim.solutions]]\nkind = "risk"\nfile = "road.toml"\n'
    out = tmp_path / "out"
    assert eigenfail("evidence", write(text), "--output", out).exit_code == 0
    figures = json.loads((out / "solutions/Sn1.json").read_text())["finding"]["figures"]
    asked = json.loads(eigenfail("risk", risk, "--json").stdout)
    assert figures["per_hour"] == pytest.approx(asked["per_hour"]["value"])
    assert figures["at_most_per_hour"] == asked["per_hour"]["at_most"]
    assert figures["at_least_per_million_km"] == asked["per_million_km"]["at_least"]
    assert verify(eigenfail, out)[0] == 0


def test_modes_are_proved_by_their_replays(eigenfail, write, done, tmp_path):
    text = f'[[claim.solutions]]\nkind = "replay"\ncampaign = {done}\n'
    out = tmp_path / "out"
    assert eigenfail("evidence", write(text), "--output", out).exit_code == 3
    assert eigenfail("analyze", done, "--clusters", 2, "--prove").exit_code == 0
    made = eigenfail("evidence", write(text), "--output", out, "--force", "--json")
    assert made.exit_code in {0, 1}
    figures = json.loads((out / "solutions/Sn1.json").read_text())["finding"]["figures"]
    assert figures["tried"] == figures["eigenfailures"] > 0
    assert (figures["reproduced"] == figures["tried"]) == (made.exit_code == 0)
    code, found = verify(eigenfail, out, "--replay", 100)
    assert (code, found["defects"]) == (0, [])
    assert found["replayed"] == found["episodes"]


def test_a_sensor_requirement_is_computed_again_from_its_campaigns(
    eigenfail, write, spec_file, tmp_path
):
    words = ("--target", 0.3, "--low", 0.05, "--high", 2, "--tolerance", 1, "--budget", 24)
    asked = eigenfail("requirement", spec_file, *words, "--json")
    assert asked.exit_code == 0, asked.output
    (tmp_path / "sensor.json").write_text(asked.stdout)
    (limit,) = json.loads(asked.stdout)["answer"]["limits"]
    text = '[[claim.solutions]]\nkind = "requirement"\nfile = "sensor.json"\nchannel = "scale"\n'
    for multiple, code in ((limit["largest"], 0), (2.0, 1)):
        file = write(f"{text}multiple = {multiple}\n")
        made = eigenfail("evidence", file, "-o", tmp_path / "out", "--force")
        assert made.exit_code == code, made.output
        assert verify(eigenfail, tmp_path / "out")[0] == 0
    unknown = write(text.replace('"scale"', '"nearest.speed"'))
    assert eigenfail("evidence", unknown, "-o", tmp_path / "out", "--force").exit_code == 3


def test_force_replaces_a_bundle_and_nothing_else(eigenfail, write, bundle):
    file = write()
    assert eigenfail("evidence", file, "--output", bundle, "--force").exit_code == 3
    (bundle / "notes.txt").write_text("mine")
    refused = eigenfail("evidence", file, "--output", bundle, "--force")
    assert refused.exit_code == 2
    assert "notes.txt" in refused.stderr
    assert (bundle / "notes.txt").read_text() == "mine"


def forge(bundle, name, old, new):
    """Change a file and all hashes, as anybody can who may write to the bundle."""
    file = bundle / name
    content = file.read_bytes()
    assert old in content
    file.write_bytes(content.replace(old, new))
    manifest = msgspec.json.decode((bundle / MANIFEST).read_bytes(), type=Manifest)
    entries = tuple(
        msgspec.structs.replace(
            each,
            sha256=hash_bytes((bundle / each.path).read_bytes()),
            size=(bundle / each.path).stat().st_size,
        )
        for each in manifest.files
    )
    manifest = msgspec.structs.replace(manifest, files=entries, sha256="")
    manifest = msgspec.structs.replace(manifest, sha256=manifest.find_hash())
    (bundle / MANIFEST).write_bytes(encode_canonical(manifest))


def test_forged_hashes_need_the_root_hash_or_replays(eigenfail, bundle):
    """The noise model is made milder throughout: hashes and counts agree, replays do not."""
    root = json.loads((bundle / MANIFEST).read_text())["sha256"]
    milder = (b'"scale":1.0', b'"scale":0.5')
    forge(bundle, "campaigns/1.json", *milder)
    code, found = verify(eigenfail, bundle)
    assert code == 1
    assert any("campaigns/1.json" in each["where"] for each in found["defects"])
    assert {each["where"] for each in found["defects"]} & {"solutions/Sn1.json: context[2]"}
    code, found = verify(eigenfail, bundle, "--root-hash", root)
    assert code == 1
    assert found["defects"][0]["where"] == "evidence.json: sha256"


def test_a_replay_finds_another_outcome(eigenfail, write, done, tmp_path):
    """A bundle that was made whole from false records is consistent: only a replay shows it."""
    out = tmp_path / "out"
    file = write(PROBABILITY.format(campaigns=[done], at_most=0.99))
    assert eigenfail("evidence", file, "--output", out).exit_code == 0
    stored = read_records(read_bundle(out).files)
    record = stored.records.campaigns[done]
    facts = record.facts
    spec = msgspec.structs.replace(facts.campaign.spec, planner="rulebook")
    campaign = msgspec.structs.replace(facts.campaign, spec=spec)
    false = msgspec.structs.replace(record, facts=msgspec.structs.replace(facts, campaign=campaign))
    records = stored.records._replace(campaigns={done: false})
    shutil.rmtree(out)
    write_bundle(make_bundle(stored.question, records, __version__).files, out)
    assert verify(eigenfail, out)[0] == 0
    code, found = verify(eigenfail, out, "--replay", 24, "--seed", 4)
    assert code == 1
    assert "of episode" in found["defects"][0]["where"]


def test_wrong_usage_exits_with_2_and_names_the_field(eigenfail, write, done, bundle, tmp_path):
    good = PROBABILITY.format(campaigns=[done], at_most=0.99)
    for change, field in (
        (("p_failure", "p_failur"), "claim.claims[0].solutions[0].kind"),
        (("at_most", "at_moist"), "at_moist"),
        (("[1]", "[]"), "campaigns"),
        (("0.99", "1.5"), "at_most"),
        (("campaigns = [1]", 'file = "x.json"'), "claim.claims[0].solutions[0].file"),
        (('kind = "p_failure"', 'kind = "gate"\nfile = "x.json"'), "x.json"),
        (('kind = "p_failure"', 'kind = "risk"\nfile = "x.toml"'), "x.toml"),
    ):
        refused = eigenfail("evidence", write(good.replace(*change)), "-o", tmp_path / "out")
        assert (refused.exit_code, field in refused.stderr) == (2, True), refused.stderr
        assert not (tmp_path / "out").exists()
    for words in (
        (tmp_path / "none.toml",),
        (write(good), "--output", bundle),
        (write(good), "--output", tmp_path),
        ("verify", tmp_path),
        ("verify", tmp_path / "none"),
        ("verify", write(good)),
        ("verify", bundle, "--root-hash", "abc"),
    ):
        refused = eigenfail("evidence", *words)
        assert refused.exit_code == 2, words
        assert "Traceback" not in refused.output
    missing = eigenfail("evidence", write(good.replace("[1]", "[99]")), "-o", tmp_path / "out")
    assert missing.exit_code != 0
    assert "99" in missing.stderr
