"""What verification finds: changed bytes, strange files, and numbers that episodes do not give."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail import __version__, plugins
from eigenfail.cli.specs import read_spec
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.values.campaign_spec import StopRules
from eigenfail_assurance.evidence import storage
from eigenfail_assurance.evidence.bundle import MANIFEST, make_bundle, make_manifest
from eigenfail_assurance.evidence.question import Claim, EvidenceQuestion, ProbabilitySolution
from eigenfail_assurance.evidence.recomputation import check_campaign
from eigenfail_assurance.evidence.records import (
    EvidenceRecords,
    NoiseLine,
    SolutionInput,
    encode_canonical,
    hash_episodes,
    read_episodes,
)
from eigenfail_assurance.evidence.storage import pack_bundle, write_bundle
from eigenfail_assurance.evidence.verification import verify_bundle

EXAMPLES = Path(__file__).parents[4] / "examples"


@pytest.fixture
def bundle(small):
    """A bundle in memory."""
    return make_bundle(*small, __version__)


@pytest.fixture
def verify(tmp_path):
    """Writes files to a folder and verifies it."""

    def verify_files(files, **options):
        write_bundle(files, tmp_path / "bundle")
        return verify_bundle(tmp_path / "bundle", **options)

    return verify_files


def list_places(checked):
    return [each.where for each in checked.defects]


def rehash(bundle, **changed):
    """Return the files with other contents, and a manifest that fits them."""
    files = {name: content for name, content in bundle.files.items() if name != MANIFEST} | changed
    manifest = make_manifest(bundle.graph, files, __version__)
    return {MANIFEST: encode_canonical(manifest)} | files


def test_a_bundle_is_verified(bundle, verify):
    checked = verify(bundle.files, root_hash=bundle.manifest.sha256.upper())
    assert checked.is_verified
    assert (checked.solutions, checked.episodes, checked.verdict) == (1, 4, "supported")


def test_it_needs_no_plugin(bundle, verify, monkeypatch):
    monkeypatch.setattr(plugins, "load", lambda *_: pytest.fail("a plug-in was loaded"))
    assert verify(bundle.files).is_verified


@pytest.mark.parametrize("name", ["ast", "correlated", "highway_drive", "any_function", "subset"])
def test_a_campaign_is_read_back_byte_for_byte(name, small, verify, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    question, records = small
    record = records.campaigns[1]
    kept = {field: getattr(record.campaign.spec, field) for field in ("seed", "episodes")}
    spec = replace(read_spec(EXAMPLES / f"{name}.toml"), **kept)
    facts = replace(record.facts, campaign=replace(record.campaign, spec=spec))
    other = records._replace(campaigns={1: replace(record, facts=facts)})
    assert verify(make_bundle(question, other, __version__).files).is_verified


def test_the_same_records_have_the_same_bytes(bundle, small):
    again = make_bundle(*small, __version__)
    assert again.files == bundle.files
    assert pack_bundle(again.files) == pack_bundle(bundle.files)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_every_changed_byte_is_found(bundle, tmp_path, data):
    files = dict(bundle.files)
    name = data.draw(st.sampled_from(sorted(files)))
    place = data.draw(st.integers(0, len(files[name]) - 1))
    content = bytearray(files[name])
    content[place] ^= data.draw(st.integers(1, 255))
    files[name] = bytes(content)
    file = tmp_path / "bundle.zip"
    file.write_bytes(pack_bundle(files))
    assert any(each.startswith(name) for each in list_places(verify_bundle(file)))


def test_a_missing_and_a_further_file_are_found(bundle, verify):
    files = dict(bundle.files)
    del files["report.html"]
    files["campaigns/7.json"] = b"{}"
    assert list_places(verify(files)) == ["campaigns/7.json", "report.html"]


def test_another_root_hash_is_found(bundle, verify):
    assert list_places(verify(rehash(bundle), root_hash="0" * 64)) == ["evidence.json: sha256"]


def test_a_number_that_the_episodes_do_not_give_is_found(bundle, verify):
    name = "solutions/Sn1.json"
    forged = bundle.files[name].replace(b'"episodes":4', b'"episodes":9')
    places = list_places(verify(rehash(bundle, **{name: forged})))
    assert f"{name}: finding.figures.episodes" in places


def test_another_verdict_is_found(bundle, verify):
    name = "solutions/Sn1.json"
    forged = bundle.files[name].replace(b'"verdict":"supported"', b'"verdict":"refuted"')
    assert f"{name}: finding.verdict" in list_places(verify(rehash(bundle, **{name: forged})))


def test_another_picture_is_found(bundle, verify):
    forged = bundle.files["argument.svg"].replace(b"supported", b"undecided")
    assert list_places(verify(rehash(bundle, **{"argument.svg": forged}))) == ["argument.svg"]


def test_another_graph_is_found(bundle, verify):
    forged = bundle.files["argument.json"].replace(b"By a search", b"By a proof")
    assert list_places(verify(rehash(bundle, **{"argument.json": forged}))) == ["argument.json"]


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        (b",safe,", b",collision,", "counts.failures"),
        (b",prior,safe,9,1.5,,", b",prior,safe,9,1.5,,0", "digest"),
    ],
)
def test_an_episode_that_contradicts_its_campaign_is_found(bundle, verify, old, new, field):
    name = "campaigns/1.episodes.csv"
    forged = bundle.files[name].replace(old, new, 1)
    places = list_places(verify(rehash(bundle, **{name: forged})))
    assert f"campaigns/1.json: campaign.{field}" in places


def forge(record, keep=lambda line: True, **counts):
    """Return a record with some lines of its table alone, whose counts and digest fit them."""
    head, *lines = record.table.decode().splitlines()
    table = ("\r\n".join([head, *filter(keep, lines)]) + "\r\n").encode()
    episodes = read_episodes(table, "forged")
    failures = sum(each.outcome.is_failure for each in episodes)
    counts = {"completed": len(episodes), "failures": failures, **counts}
    campaign = record.campaign
    changed = replace(
        campaign,
        counts=replace(campaign.counts, **counts),
        digest=campaign.digest and hash_episodes(episodes),
    )
    return replace(record, facts=replace(record.facts, campaign=changed), table=table)


@pytest.fixture
def verify_rare(verify):
    """Makes and verifies a bundle of a P(failure) of at most 1 % from the record of a campaign."""

    def verify_record(record):
        claim = Claim(text="Rare.", solutions=(ProbabilitySolution(campaigns=(1,), at_most=0.01),))
        question = EvidenceQuestion(name="Rare", claim=claim)
        records = EvidenceRecords({1: record}, (SolutionInput(campaigns=((1,),)),))
        return verify(make_bundle(question, records, __version__).files)

    return verify_record


def is_no_collision(line):
    return ",collision," not in line


def with_spec(record, **fields):
    campaign = record.campaign
    changed = replace(campaign, spec=replace(campaign.spec, **fields))
    return replace(record, facts=replace(record.facts, campaign=changed))


def test_failures_that_were_removed_are_found(make, verify_rare):
    record = forge(make("sssssssssssssc" * 30), is_no_collision)
    assert {"campaigns/1.episodes.csv", "campaigns/1.json: campaign.counts.cancelled"} <= {
        *list_places(verify_rare(record))
    }


@pytest.mark.parametrize("counts", [{"cancelled": 30}, {"planned": 390}])
def test_other_counts_do_not_hide_failures_that_were_removed(make, counts, verify_rare):
    record = forge(make("sssssssssssssc" * 30), is_no_collision, **counts)
    record = with_spec(record, episodes=record.campaign.counts.planned)
    assert "campaigns/1.episodes.csv" in list_places(verify_rare(record))


def test_without_a_digest_counts_are_compared_all_the_same(make, verify_rare):
    record = make("sssssssssssssc" * 30)
    bare = replace(
        record, facts=replace(record.facts, campaign=replace(record.campaign, digest=None))
    )
    assert list_places(verify_rare(bare)) == ["campaigns/1.json: campaign.digest"]
    places = list_places(verify_rare(forge(bare, is_no_collision, completed=420)))
    assert "campaigns/1.json: campaign.counts.completed" in places


def test_a_rule_on_time_does_not_hide_failures_that_were_removed(make, verify_rare):
    record = forge(make("sssssssssssssc" * 30), is_no_collision, cancelled=30)
    checked = verify_rare(with_spec(record, stop=StopRules(wall_s=60.0)))
    assert (checked.is_verified, checked.verdict) == (True, "undecided")


def test_last_episodes_that_were_removed_are_found(make, verify_rare):
    record = forge(make("s" * 400 + "c" * 30), is_no_collision, cancelled=30)
    place = "campaigns/1.json: campaign.counts.cancelled"
    assert list_places(verify_rare(record)) == [place]


def test_a_campaign_that_its_rule_ended_is_verified(make, verify_rare):
    record = make("s" * 18 + "c" * 2 + "s" * 20, stop=StopRules(failures=2))
    ended = forge(record, lambda line: int(line.split(",")[0]) < 20, cancelled=20)
    assert verify_rare(ended).is_verified


def test_a_specification_of_other_episodes_is_found(make, verify_rare):
    record = with_spec(make("s" * 400), episodes=401)
    assert list_places(verify_rare(record)) == ["campaigns/1.json: campaign.counts.planned"]


def test_more_unresolved_episodes_than_safe_ones_are_found(bundle, verify):
    name = "campaigns/1.json"
    forged = bundle.files[name].replace(b'"unresolved":0', b'"unresolved":9')
    assert forged != bundle.files[name]
    places = list_places(verify(rehash(bundle, **{name: forged})))
    assert "campaigns/1.json: unresolved" in places


def test_a_field_that_is_not_read_is_found_by_the_chain_of_hashes(bundle, verify):
    name = "campaigns/1.json"
    forged = bundle.files[name].replace(b'"trained_episodes"', b'"trained_episodez"')
    assert list_places(verify(rehash(bundle, **{name: forged}))) == [name]


def test_a_seed_of_another_campaign_is_found(bundle, verify):
    name = "campaigns/1.episodes.csv"
    lines = bundle.files[name].split(b"\r\n")
    lines[1] = b"0,5," + lines[1].split(b",", 2)[2]
    assert name in list_places(verify(rehash(bundle, **{name: b"\r\n".join(lines)})))


@pytest.mark.parametrize(
    ("method", "found"), [("ast", 1), ("cem", 1), ("replay", 0), ("nearest", 0), ("minimal", 0)]
)
def test_replays_alone_may_have_seeds_of_other_campaigns(make, method, found):
    record = with_spec(make("sc", seed=3), seed=4, method=method)
    assert sum("The seed" in each.problem for each in check_campaign(record)) == found


@pytest.mark.parametrize(
    "case",
    [
        ("question.json", b"{}", "question.json"),
        ("inputs.json", b"[]", "inputs.json"),
        ("inputs.json", b'[{"campaigns":[[2]]}]', "Sn1"),
        ("inputs.json", b'[{"campaigns":[]}]', "Sn1: campaigns"),
        ("solutions/Sn1.json", b"null", "solutions/Sn1.json"),
        ("campaigns/1.json", b"[" * 5_000, "campaigns/1.json"),
        ("campaigns/1.episodes.csv", b"\xff", "campaigns/1.episodes.csv"),
        ("campaigns/1.episodes.csv", b"index\r\n", "campaigns/1.episodes.csv"),
        (
            "campaigns/1.noise.json",
            b'[{"index":0,"shape":[1,2],"z":"?"}]',
            "campaigns/1.noise.json",
        ),
    ],
)
def test_what_cannot_be_read_is_a_defect_and_no_traceback(bundle, verify, case):
    name, content, place = case
    checked = verify(rehash(bundle, **{name: content}))
    assert place in list_places(checked)
    assert all(each.problem[:1].isupper() for each in checked.defects)


def test_a_name_that_leads_out_of_an_archive_is_refused(bundle, tmp_path):
    file = tmp_path / "bundle.zip"
    for name in ("../outside.json", "/etc/outside.json", "campaigns/../outside.json"):
        packed = io.BytesIO(pack_bundle(bundle.files))
        with zipfile.ZipFile(packed, "a") as archive:
            archive.writestr(name, b"{}")
        file.write_bytes(packed.getvalue())
        assert list_places(verify_bundle(file)) == [name]
    assert not (tmp_path.parent / "outside.json").exists()


def test_a_file_that_unpacks_to_too_much_is_not_unpacked(bundle, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "LARGEST_FILE", 100_000)
    file = tmp_path / "bundle.zip"
    file.write_bytes(pack_bundle(dict(bundle.files) | {"report.html": b"0" * 200_000}))
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: pytest.fail("was read"))
    assert list_places(verify_bundle(file)) == ["report.html"]


def test_a_file_twice_in_an_archive_is_refused(bundle, tmp_path):
    file = tmp_path / "bundle.zip"
    packed = io.BytesIO(pack_bundle(bundle.files))
    with zipfile.ZipFile(packed, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("report.html", b"other")
    file.write_bytes(packed.getvalue())
    assert list_places(verify_bundle(file)) == ["bundle.zip"]


def test_a_damaged_archive_is_a_defect(bundle, tmp_path):
    file = tmp_path / "bundle.zip"
    packed = bytearray(pack_bundle(bundle.files))
    packed[200] ^= 255
    file.write_bytes(packed)
    assert not verify_bundle(file).is_verified


def test_a_link_is_refused(bundle, tmp_path):
    folder = tmp_path / "bundle"
    write_bundle(bundle.files, folder)
    (tmp_path / "report.html").write_bytes((folder / "report.html").read_bytes())
    (folder / "report.html").unlink()
    (folder / "report.html").symlink_to(tmp_path / "report.html")
    assert list_places(verify_bundle(folder)) == ["report.html"]


def test_another_format_is_no_tampering(bundle, verify):
    manifest = replace(bundle.manifest, format="eigenfail evidence 9", sha256="")
    manifest = replace(manifest, sha256=manifest.find_hash())
    with pytest.raises(InvalidValue, match="eigenfail evidence 9"):
        verify(dict(bundle.files) | {MANIFEST: encode_canonical(manifest)})


def test_a_bundle_of_another_release_is_compared_by_its_numbers(small, verify):
    old = make_bundle(*small, "0.0.1")
    checked = verify(old.files)
    assert checked.is_verified
    assert any("0.0.1" in each for each in checked.notes)


def test_a_file_that_a_solution_does_not_name_is_found(bundle, verify):
    name = "solutions/Sn1.json"
    solution = json.loads(bundle.files[name])
    del solution["campaigns"][0]["files"]["campaigns/1.episodes.csv"]
    places = list_places(verify(rehash(bundle, **{name: encode_canonical(solution)})))
    assert f"{name}: campaigns[0].files.campaigns/1.episodes.csv" in places


def test_a_planner_that_is_not_installed_is_no_defect(small, verify):
    question, records = small
    facts = records.campaigns[1].facts
    spec = replace(facts.campaign.spec, planner="absent")
    facts = replace(facts, campaign=replace(facts.campaign, spec=spec))
    absent = records._replace(campaigns={1: replace(records.campaigns[1], facts=facts)})
    files = make_bundle(question, absent, __version__).files
    assert verify(files).is_verified
    with pytest.raises(ServiceError, match="'absent' is not known"):
        verify(files, replay=2)


def test_a_bundle_is_written_whole_or_not_at_all(bundle, tmp_path, monkeypatch):
    folder = tmp_path / "bundle"
    write_bundle(bundle.files, folder)
    before = sorted(tmp_path.rglob("*"))

    def full_disk(self, content):
        raise OSError("full")

    monkeypatch.setattr(storage.Path, "write_bytes", full_disk)
    with pytest.raises(Exception, match="full"):
        write_bundle(bundle.files, folder)
    assert sorted(tmp_path.rglob("*")) == before


def test_noise_comes_back_bit_for_bit():
    z = np.array([[1.5, -0.1], [np.float32(1e-30), 3.0]], np.float32)
    assert NoiseLine.of(3, z).read().tobytes() == z.tobytes()
