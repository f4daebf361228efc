"""A hook of mkdocs: files outside docs/ to which pages link become part of the site.

On disk a page links `../examples/ast.toml`, which a reader of a clone can follow. In the site such
a file stands under source/: a page in Markdown as a page that is not in the navigation, any other
file as it is. A link to a folder, or to a plug-in that is not there, becomes plain text.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
SOURCE = "source/"
OUTSIDE = re.compile(r"\[(?P<text>[^\]]*)\]\(\.\./(?P<path>[^)\s#]+)(?P<anchor>#[^)\s]*)?\)")

# Links of a page outside docs/, which stands one folder deeper in the site than on disk.
INTO_DOCS = re.compile(r"\]\((?P<up>(?:\.\./)+)docs/")

# Links of such a page to files beside it, or elsewhere outside docs/.
BESIDE = re.compile(r"\]\((?!#|\w+:)(?P<path>[^)\s#]+)")

# Python-Markdown takes a table for text if the line above it is a comment.
COMMENT = re.compile(r"^<!--.*-->$", re.MULTILINE)


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the linked files; mkdocs reports links to files that do not exist."""
    pages = (Path(page.abs_src_path or "") for page in files.documentation_pages())
    linked = {
        found["path"] for page in pages for found in OUTSIDE.finditer(page.read_text("utf-8"))
    }
    for path in sorted(_follow_links(linked)):
        added = File.generated(
            config,
            f"{SOURCE}{path}",
            content=(ROOT / path).read_bytes(),
            inclusion=InclusionLevel.NOT_IN_NAV,
        )
        files.append(added)
    return files


def _follow_links(linked: set[str]) -> set[str]:
    """Return the files among linked paths, with those outside docs/ that their pages link to."""
    found = set[str]()
    new = {path for path in linked if (ROOT / path).is_file()}
    while new:
        found |= new
        pages = [ROOT / path for path in new if path.endswith(".md")]
        targets = {
            (page.parent / link["path"]).resolve()
            for page in pages
            for link in BESIDE.finditer(page.read_text("utf-8"))
        }
        outside = {each for each in targets if each.is_file() and DOCS not in each.parents}
        new = {each.relative_to(ROOT).as_posix() for each in outside} - found
    return found


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Let links outside docs/ lead to the added files, and links of added pages into docs/."""

    def replace(link: re.Match[str]) -> str:
        is_gone = link["path"].startswith("plugins/") and not (ROOT / link["path"]).exists()
        target = f"{SOURCE}{link['path']}{link['anchor'] or ''}"
        is_folder = (ROOT / link["path"]).is_dir()
        return link["text"] if is_folder or is_gone else f"[{link['text']}]({target})"

    if page.file.src_uri.startswith(SOURCE):
        return COMMENT.sub("", INTO_DOCS.sub(r"](../\g<up>", markdown))
    return COMMENT.sub("", OUTSIDE.sub(replace, markdown))
