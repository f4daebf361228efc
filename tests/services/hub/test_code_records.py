"""The code of workers is recorded with the campaigns whose episodes they get."""

from store_checks.examples import running

from eigenfail.testing.examples import spec
from eigenfail.versions import CODE, fingerprint_plugins, select_code
from eigenfail_services.hub.commits import CodeRecorder

OURS = {f"{CODE}eigenfail_workers": "a1", "numpy": "2.0", f"{CODE}other_package": "b1"}


def test_each_code_is_recorded_once_and_only_that_of_the_campaign(store):
    campaign, other = running(store).id, running(store).id
    recorder = CodeRecorder(store.campaigns)
    for versions in (OURS, OURS, {**OURS, f"{CODE}eigenfail_workers": "a2"}, {"numpy": "2.0"}):
        recorder.note(campaign, versions)
    recorder.note(999, OURS)
    recorder.write()
    recorder.note(campaign, OURS)
    recorder.write()
    found = store.campaigns.get(campaign).code
    assert found == ({"eigenfail_workers": "a1"}, {"eigenfail_workers": "a2"})
    assert store.campaigns.get(other).code == ()
    CodeRecorder(store.campaigns).note(campaign, OURS)
    assert store.campaigns.add_code(campaign, found[0]).code == found


def test_a_function_and_a_bridge_have_no_code_that_is_known():
    bridge = spec(simulator="bridge", planner="theirs", scenario="theirs")
    assert select_code(OURS, bridge) == {}
    function = spec(simulator="function", scenario="function", planner="math:sin")
    assert select_code(OURS, function) == {}


def test_where_a_plug_in_is_not_installed_all_packages_count():
    found = select_code(OURS, spec(planner="of_another_machine"))
    assert found == {"eigenfail_workers": "a1", "other_package": "b1"}


def test_a_worker_knows_the_fingerprints_of_its_plug_ins():
    found = fingerprint_plugins()
    assert found[f"{CODE}eigenfail_workers"]
    assert all(len(digest) == 12 for digest in found.values())
