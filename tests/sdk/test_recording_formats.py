"""Formats of single episodes: plug-ins bring them, and the core finds them by name."""

import sys
from pathlib import Path

import pytest
from distributions import write_record
from plugin_absence import forget_entry_points
from tiny_formats import FORMATS

from eigenfail.client.episodes import choose_recording_format
from eigenfail.contracts.recording import (
    KNOWN,
    PACKAGE,
    EgoControl,
    check_format,
    find_format,
    list_formats,
)
from eigenfail.errors import InvalidValue, UnknownName

MODULE = """
from eigenfail.contracts.recording import RecordingFormat

FORMAT = RecordingFormat(
    title="Sheep", suffix=".sheep", media_type="text/plain", write=lambda recording, ego: b"baa"
)
"""


@pytest.fixture
def bring(tmp_path, monkeypatch):
    """Installs a distribution that brings the format `sheep`."""

    def install(text=MODULE, distribution="eigenfail-sheep", attribute="FORMAT"):
        package = distribution.replace("-", "_")
        folder = tmp_path / distribution
        points = f"[eigenfail.exports]\nsheep = {package}:{attribute}\n"
        write_record(folder, distribution, points)
        (folder / f"{package}.py").write_text(text)
        monkeypatch.syspath_prepend(folder)
        forget_entry_points()

    yield install
    forget_entry_points()
    sys.modules.pop("eigenfail_sheep", None)
    sys.modules.pop("eigenfail_goats", None)


def test_another_distribution_brings_a_format(bring):
    bring()
    assert [*list_formats()][-1] == "sheep"
    found = find_format("sheep")
    assert (found.title, found.suffix) == ("Sheep", ".sheep")
    assert found.write(None, EgoControl.RECORDED) == b"baa"
    assert not found.has_controller
    assert found.overlay is None


@pytest.mark.parametrize(
    ("text", "attribute", "words"),
    [
        ("import no_such_module", "FORMAT", "'sheep' cannot be loaded: No module named"),
        (
            MODULE,
            "RecordingFormat",
            "'sheep' is of the type StructMeta, and must be a RecordingFormat",
        ),
    ],
)
def test_a_format_that_cannot_be_loaded_is_not_listed_and_the_error_says_why(
    bring, text, attribute, words
):
    bring(text, attribute=attribute)
    assert "sheep" not in list_formats()
    with pytest.raises(InvalidValue, match=words):
        find_format("sheep")


def test_a_name_that_two_distributions_claim_is_refused(bring):
    bring()
    bring(distribution="eigenfail-goats")
    assert "sheep" not in list_formats()
    with pytest.raises(InvalidValue, match="packages: eigenfail-goats, eigenfail-sheep"):
        find_format("sheep")


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_format_that_is_not_installed_says_which_package_brings_it(tiny_formats, name):
    del tiny_formats["gif"]
    with pytest.raises(InvalidValue) as refused:
        find_format(name)
    assert f"'{name}' is in the package {PACKAGE}, which is not installed" in str(refused.value)
    assert refused.value.remedy.startswith("Installed formats: poses.")
    assert refused.value.remedy.endswith(f"pip install plugins/{PACKAGE}")
    assert (refused.value.http_status, refused.value.exit_code) == (422, 2)


def test_an_unknown_format_is_refused_with_those_that_are_installed(tiny_formats):
    with pytest.raises(UnknownName) as refused:
        find_format("mp4")
    assert str(refused.value) == (
        f"format: 'mp4' is not known. The package {PACKAGE}, which is not installed where the "
        "service runs, brings openscenario, mcap. Known: gif, poses."
    )
    tiny_formats.update(dict.fromkeys(KNOWN, FORMATS["gif"]))
    with pytest.raises(UnknownName) as refused:
        find_format("mp4")
    known = "gif, mcap, openscenario, poses"
    assert str(refused.value) == f"format: 'mp4' is not known. Known: {known}."


def test_known_formats_are_listed_before_others(tiny_formats):
    tiny_formats.update(another=FORMATS["gif"], openscenario=FORMATS["gif"])
    assert [*list_formats()] == ["openscenario", "gif", "another", "poses"]


def test_a_format_without_a_controller_names_those_that_have_one(tiny_formats):
    assert check_format("poses", EgoControl.CONTROLLER) is FORMATS["poses"]
    with pytest.raises(InvalidValue, match=r"no controller\. Use the format poses\."):
        check_format("gif", EgoControl.CONTROLLER)
    del tiny_formats["poses"]
    with pytest.raises(InvalidValue, match=r"has no controller\.$"):
        check_format("gif", EgoControl.CONTROLLER)


@pytest.mark.parametrize(
    ("name", "form", "chosen"),
    [
        ("a.zip", None, "openscenario"),
        ("a.ZIP", "openscenario", "openscenario"),
        ("a.mcap", None, "mcap"),
        ("a.gif", None, "gif"),
        ("a.POSES", None, "poses"),
        ("a.bin", "mcap", "mcap"),
    ],
)
def test_the_name_of_a_file_chooses_its_format(name, form, chosen):
    assert choose_recording_format(Path(name), form) == chosen


@pytest.mark.parametrize(("name", "form"), [("a.xosc", None), ("a.xml", "openscenario")])
def test_a_scenario_is_not_written_to_a_file_with_another_name(name, form):
    with pytest.raises(InvalidValue, match=r"a\.zip"):
        choose_recording_format(Path(name), form)
