"""Writes the table of routes into docs/rest.md: `python tests/docs/rest_table.py`."""

from pathlib import Path

from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store import open_store

PAGE = Path(__file__).parents[2] / "docs" / "rest.md"
BEGIN, END = "<!-- routes -->", "<!-- /routes -->"


def table(paths):
    """The rows, by path."""
    rows = [
        f"| `{path}` | {', '.join(map(str.upper, item))} | {words(item)} |"
        for path, item in sorted(paths.items())
    ]
    return "\n".join(["| address | verbs | what it is |", "|---|---|---|", *rows])


def words(item):
    """What the verbs of an address do, each by its name where there are several."""
    if len(item) == 1:
        return next(iter(item.values()))["description"]
    return " ".join(f"{verb.upper()}: {told['description']}" for verb, told in item.items())


def main():
    """Replace what is between the marks."""
    store = open_store("memory://")
    paths = create_app(store, ApiSettings()).openapi()["paths"]
    store.close()
    before, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(paths)}\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main()
