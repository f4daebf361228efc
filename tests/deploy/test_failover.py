"""An address of two servers, as `docs/deployment.md` writes it for one that fails over."""

from urllib.parse import quote, urlsplit

from eigenfail_services.store.store import open_store


def test_of_two_hosts_the_one_that_can_be_written_is_taken(postgres_url):
    parts = urlsplit(postgres_url)
    user, database = parts.username, parts.path.removeprefix("/")
    there = dict(pair.split("=") for pair in parts.query.split("&"))["host"]
    hosts = f"host={quote('/nowhere,')}{there}&target_session_attrs=read-write"
    store = open_store(f"postgresql+psycopg://{user}@/{database}?{hosts}")
    try:
        assert store.campaigns.page(1).items == ()
    finally:
        store.close()
