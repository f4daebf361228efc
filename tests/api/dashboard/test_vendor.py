"""What is not ours is what it says it is, and nothing is fetched from elsewhere."""

import hashlib
import json
import re

import pytest

from eigenfail_api.dashboard.rendering import FOLDER, STATIC

VENDOR = STATIC / "vendor"
MANIFEST = json.loads((VENDOR / "manifest.json").read_text())
OURS = [
    path
    for path in sorted(FOLDER.rglob("*"))
    if path.suffix in {".html", ".css", ".js", ".svg"} and VENDOR not in path.parents
]
XML_NAMESPACE = "http://www.w3.org/2000/svg"


def test_the_manifest_names_every_file():
    named = {name for library in MANIFEST for name in library["files"]}
    assert {path.name for path in VENDOR.iterdir()} == named | {"manifest.json"}


@pytest.mark.parametrize("library", MANIFEST, ids=lambda library: library["name"])
def test_vendored_files_have_the_hashes_of_the_manifest(library):
    assert library["version"]
    assert library["licence"]
    assert any("LICENSE" in name for name in library["files"])
    for name, expected in library["files"].items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == expected, name


def test_every_series_that_our_charts_draw_was_built_in():
    entry = (VENDOR / "echarts.entry.js").read_text().lower()
    scripts = [path.read_text() for path in (STATIC / "js").iterdir()]
    axes = {"value", "category", "log", "plain"}
    drawn = {kind for text in scripts for kind in re.findall(r'\btype: "(\w+)"', text)} - axes
    series = {kind for kind in drawn if kind.islower()}
    assert series >= {"line", "scatter", "bar", "parallel"}
    assert all(f"{kind}chart" in entry for kind in series)


def test_browsers_are_told_to_compile_echarts_while_it_arrives():
    text = (VENDOR / "echarts.min.js").read_text()
    assert text.startswith("//# allFunctionsCalledOnLoad\n")


def test_our_files_name_no_other_host():
    for path in OURS:
        text = path.read_text().replace(XML_NAMESPACE, "")
        assert not re.search(r"(https?:)?//[a-z0-9-]+\.[a-z]", text), path


def test_our_files_need_no_inline_script_or_style():
    for path in OURS:
        if path.suffix == ".html":
            text = path.read_text()
            assert not re.search(r"<style|\sstyle=|\son[a-z]+=|hx-on|javascript:", text), path
            assert not re.search(r"<script(?![^>]*\ssrc=)", text), path
