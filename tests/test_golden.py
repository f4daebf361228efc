"""The golden files themselves: how pages become text, and that no file is forgotten."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from golden import FOLDER, REMEDY, Golden, find_unused, normalise, pytest_configure
from page_text import render_page

PAGE = """<!doctype html><title>A &amp; B</title><header>everywhere</header><main>
<h1>Keys</h1><p class="problem tone-bad">Two
   lines.</p>
<div id="list"><table><thead><tr><th>Name</th><th aria-sort="ascending">n</th></tr></thead>
<tr><td><a href="/k?a=1&amp;b=2">one</a></td><td>1</td></tr></table></div>
<dl><div><dt>Age</dt><dd>7 s</dd></div></dl>
<form method="post" action="/k" data-ask="Sure?"><label>Scale <input name="s" type="number" min="0"
 value="3" required></label><select name="c"><option value="a" selected>A</option></select>
<input type="checkbox" name="x" value="1" checked><button name="w" value="v">Go</button></form>
<pre><code>a  b
  c</code></pre><p hidden>later</p><ul><li>item</li></ul><script>no()</script></main>"""

TEXT = """title: A & B
# Keys
Two lines. {bad}
Name              | n (ascending)
------------------+--------------
[one](/k?a=1&b=2) | 1
Age: 7 s
form POST /k asking "Sure?"
Scale [s = 3 (number, 0…, required)]
[c = *A (a)] [x] x=1 <Go w=v>
    a  b
      c
(hidden) later
- item
"""


def test_a_page_becomes_text() -> None:
    assert render_page(PAGE) == TEXT
    assert render_page(PAGE, "list") == "\n".join(TEXT.splitlines()[3:6]) + "\n"
    with pytest.raises(LookupError, match="nowhere"):
        render_page(PAGE, "nowhere")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("at 2026-11-25 18:52:24 UTC", "at {time}"),
        ("at 2026-11-25T18:52:24.123Z.", "at {time}."),
        ("eigenfail 1.12.0 and numpy 2.4.6", "eigenfail {version} and numpy 2.4.6"),
        ("127.0.0.1:8440 and 127.0.0.1:40123", "127.0.0.1:8440 and 127.0.0.1:{port}"),
        ("in /tmp/pytest-of-me/pytest-3/popen-gw1/test_a0/x.toml.", "in {folder}/x.toml."),
        ("0123456789abcdef" * 4, "{digest}"),
        ("\n\na  \nb\n\n", "a\nb"),
    ],
)
def test_what_varies_is_left_out(text: str, found: str) -> None:
    assert normalise(text) == f"{found}\n"


def test_a_difference_is_shown_and_accepted_by_an_update(tmp_path: Path) -> None:
    kept, update = Golden(False, tmp_path), Golden(True, tmp_path)
    with pytest.raises(pytest.fail.Exception, match=r"no golden file a/b\.txt"):
        kept.check("a/b", "one\ntwo")
    update.check("a/b", "one\ntwo")
    kept.check("a/b", "one \ntwo\n")
    with pytest.raises(pytest.fail.Exception) as failed:
        kept.check("a/b", "one\nthree")
    assert REMEDY in str(failed.value)
    assert str(failed.value).endswith("@@ -1,2 +1,2 @@\n one\n-two\n+three")
    update.check("a/b", "one\nthree")
    kept.check("a/b", "one\nthree")


def test_an_update_is_refused_in_ci(monkeypatch: pytest.MonkeyPatch) -> None:
    config = SimpleNamespace(getoption=lambda _: True)
    monkeypatch.delenv("CI", raising=False)
    pytest_configure(config)
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.UsageError, match="--update is refused"):
        pytest_configure(config)


def test_names_are_found_in_the_sources_of_tests() -> None:
    sources = ['check("a/b", 1); check(f"c/{word}", 2)', 'check("plain")']
    assert find_unused(["a/b", "c/any-word", "a/c", "c/d/e", "plain"], sources) == [
        "a/c",
        "c/d/e",
        "plain",
    ]


def test_each_golden_file_is_used_by_a_test() -> None:
    files = (file.relative_to(FOLDER).with_suffix("").as_posix() for file in FOLDER.rglob("*.*"))
    sources = (file.read_text("utf-8") for file in FOLDER.parent.rglob("test_*.py"))
    assert find_unused(files, sources) == []
