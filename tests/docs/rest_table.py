"""Write api/openapi.json and the routes of docs/rest.md: `python tests/docs/rest_table.py`.

Both are of the core: a plug-in documents its routes itself.
"""

import json
from pathlib import Path

from eigenfail_api.access.authentication import required_scope
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "rest.md"
BEGIN, END = "<!-- routes -->", "<!-- /routes -->"


def table(paths):
    """The rows, by path."""
    rows = [
        f"| `{path}` | {', '.join(map(str.upper, item))} | {format_scopes(path, item)} "
        f"| {words(item)} |"
        for path, item in sorted(paths.items())
    ]
    return "\n".join(["| address | verbs | least scope | what it is |", "|---|---|---|---|", *rows])


def words(item):
    """What the verbs of an address do, each by its name where there are several."""
    if len(item) == 1:
        return next(iter(item.values()))["description"]
    return " ".join(f"{verb.upper()}: {told['description']}" for verb, told in item.items())


def format_scopes(path, item):
    """Format the least scope of each verb: `GET: viewer, POST: runner`."""
    verbs = [verb.upper() for verb in item]
    return ", ".join(f"{verb}: {required_scope(verb, path) or 'no key'}" for verb in verbs)


def main():
    """Write the document and the table."""
    store = open_store("memory://")
    document = create_app(store, ApiSettings(), extensions=()).openapi()
    store.close()
    text = json.dumps(document, indent=1, ensure_ascii=False)
    (DOCS.parent / "api" / "openapi.json").write_text(f"{text}\n")
    before, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(document['paths'])}\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main()
