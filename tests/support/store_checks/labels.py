"""Checks of what `CampaignStore` knows of versions of planners, projects and tags."""

from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.testing.examples import spec
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_services.store.codec import spec_hash
from eigenfail_services.store.store import Store
from store_checks.examples import equal

LABELS = {"planner_version": "v1.2", "project": "Stau ✓ 'one'", "tags": ("a", "nightly")}


def keeps_labels_as_they_were_given(store: Store) -> None:
    """They come back, and are absent where they were absent."""
    for given in ({}, LABELS, {"tags": ("b",)}):
        made = store.campaigns.create(accept_spec(spec(**given)))
        found = store.campaigns.get(made.id).spec
        equal(found, made.spec, "The campaign that was read")
        for name in LABELS:
            equal(getattr(found, name), getattr(spec(**given), name), f"Its {name}")


def finds_campaigns_by_their_labels(store: Store) -> None:
    """To the letter; a part of a tag is no tag."""
    first = store.campaigns.create(accept_spec(spec(**LABELS))).id
    store.campaigns.create(accept_spec(spec()))
    store.campaigns.create(
        accept_spec(spec(planner_version="V1.2", project="stau", tags=("A", "nightly-2")))
    )
    cases = (
        (CampaignFilter(planner_version="v1.2"), [first]),
        (CampaignFilter(project="Stau ✓ 'one'"), [first]),
        (CampaignFilter(tag="a"), [first]),
        (CampaignFilter(tag="nightly"), [first]),
        (CampaignFilter(tag="nightly", project="stau"), []),
        *((CampaignFilter(tag=word), []) for word in ("night", '"', 'a","nightly', "%", "\x00")),
        (CampaignFilter(project="\x00"), []),
        (CampaignFilter(planner_version="\x00"), []),
    )
    for where, wanted in cases:
        items = store.campaigns.page(9, where=where).items
        equal([each.id for each in items], wanted, f"Campaigns of {where}")


def a_key_knows_the_version_and_neither_project_nor_tags(store: Store) -> None:
    """A repeated request with other tags is the same request; one of another version is not."""
    plain: CampaignSpec = spec()
    tagged = replace(plain, project="x", tags=("y",))
    equal(spec_hash(tagged), spec_hash(plain), "The hash with a project")
    made = store.campaigns.create(accept_spec(plain), "key")
    equal(store.campaigns.create(accept_spec(tagged), "key").id, made.id, "The campaign of the key")
    hashes = {spec_hash(replace(plain, planner_version=each)) for each in ("v1", "v2")}
    equal(len({*hashes, spec_hash(plain)}), 3, "Hashes of two versions and none")
