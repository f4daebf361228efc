"""Checks of `KeyStore` and `AuditLog`."""

from eigenfail.testing import expect
from eigenfail.values.access import AuditEntry, Change, Scope
from eigenfail.values.records import Page
from eigenfail_services.store.store import Store
from store_checks.examples import equal

DIGEST = "0123456789abcdef" * 4
LATER = 2_000_000_000_000
"""In the year 2033. [ms since 1970]"""


def keeps_keys(store: Store) -> None:
    """A key comes back as it was made, with the digest of its secret and no more of it."""
    equal(store.keys.exist(), False, "Whether there are keys before the first")
    made = store.keys.create("nightly ½ \x00", Scope.RUNNER, DIGEST, LATER)
    equal((made.id, made.scope, made.expires_ms), (1, Scope.RUNNER, LATER), "A new key")
    equal((made.revoked_ms, made.last_used_ms), (None, None), "A new key")
    expect(made.name.startswith("nightly ½"), f"The name came back as {made.name!r}.")
    expect(0 < made.created_ms < LATER, f"It was made at {made.created_ms}.")
    found = store.keys.find(made.id)
    equal((found.key.id, found.key.scope, found.digest), (1, Scope.RUNNER, DIGEST), "What is kept")
    equal(store.keys.exist(), True, "Whether there are keys")


def revokes_keys(store: Store) -> None:
    """Once revoked, for good: a second time leaves the first one's time."""
    one, other = (store.keys.create(name, Scope.VIEWER, DIGEST) for name in ("one", "other"))
    first = store.keys.revoke(one.id)
    expect(first.revoked_ms is not None, "A revoked key does not say when it was.")
    equal(store.keys.revoke(one.id), first, "A key that is revoked twice")
    equal(store.keys.find(one.id).key, first, "A revoked key")
    equal(store.keys.find(other.id).key, other, "Another key")
    equal(store.keys.exist(), True, "Whether a key was ever made")


def remembers_when_keys_were_used(store: Store) -> None:
    """The last time, each key its own."""
    one, other = (store.keys.create(name, Scope.VIEWER, DIGEST) for name in ("one", "other"))
    for at_ms in (LATER, LATER + 60_000):
        store.keys.used(one.id, at_ms)
        equal(store.keys.find(one.id).key.last_used_ms, at_ms, "When it was last used")
    equal(store.keys.find(other.id).key.last_used_ms, None, "When another was")
    store.keys.used(other.id + 1, LATER)


def counts_administrators(store: Store) -> None:
    """Those whose keys are for administrators and valid at the moment."""
    equal(store.keys.admins(LATER), 0, "Administrators before the first key")
    store.keys.create("viewer", Scope.VIEWER, DIGEST)
    store.keys.create("ends", Scope.ADMIN, DIGEST, LATER)
    gone = store.keys.create("stays", Scope.ADMIN, DIGEST)
    counts = [store.keys.admins(at_ms) for at_ms in (LATER - 1, LATER)]
    equal(counts, [2, 1], "Administrators before and after one of the keys ends")
    store.keys.revoke(gone.id)
    equal(store.keys.admins(LATER), 0, "Administrators once the other is revoked")


def pages_keys(store: Store) -> None:
    """Newest first, the revoked ones, too."""
    made = [store.keys.create(f"key {n}", Scope.VIEWER, DIGEST) for n in range(3)]
    gone = store.keys.revoke(made[0].id)
    first = store.keys.page(2)
    equal(first, Page((made[2], made[1]), made[1].id), "The first page of keys")
    equal(store.keys.page(2, first.next), Page((gone,)), "The last page of keys")
    equal(store.keys.page(2, made[0].id), Page(()), "What comes behind the last")


def change(subject: str, status: int = 201, key: int | None = None) -> Change:
    """Somebody created a campaign."""
    route = "/api/v1/campaigns"
    return Change("loopback", key, "POST", route, subject, "127.0.0.1", status)


def writes_down_changes(store: Store) -> None:
    """Every one, as it was told, with a rising number and the time."""
    equal(store.audit.page(10), Page(()), "An empty audit log")
    told = [change("/api/v1/campaigns/1"), change("odd ½", 503, 7)]
    kept = [store.audit.append(each) for each in told]
    equal([entry.id for entry in kept], [1, 2], "The numbers of the lines")
    for each, entry in zip(told, kept, strict=True):
        expect(0 < entry.at_ms < LATER, f"It happened at {entry.at_ms}.")
        equal(entry, entry_of(each, entry), "A line of the audit log")
    equal(store.audit.page(10), Page(tuple(kept[::-1])), "The audit log")


def entry_of(told: Change, like: AuditEntry) -> AuditEntry:
    """The line that a change should be, under the number and time of another."""
    fields = {name: getattr(told, name) for name in Change.__struct_fields__}
    return AuditEntry(**fields, id=like.id, at_ms=like.at_ms)


def pages_changes(store: Store) -> None:
    """Newest first, page by page, whatever comes in between."""
    kept = [store.audit.append(change(str(n))) for n in range(3)]
    first = store.audit.page(2)
    equal(first, Page((kept[2], kept[1]), kept[1].id), "The first page of changes")
    store.audit.append(change("later"))
    equal(store.audit.page(2, first.next), Page((kept[0],)), "The last page of changes")
