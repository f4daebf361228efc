"""Colours can be told apart from what they lie on (WCAG 2.2, AA)."""

import re

import pytest
from contrast import contrast

from eigenfail_api.dashboard.rendering import STATIC

TOKEN = re.compile(r"--([\w-]+): light-dark\((#[0-9a-f]{6}), (#[0-9a-f]{6})\);")
TOKENS = TOKEN.findall((STATIC / "css" / "tokens.css").read_text())
LIGHT, DARK = ({name: themes[place] for name, *themes in TOKENS} for place in (0, 1))
TEXT = ("ink", "muted", "accent", "good", "bad", "waiting", "active")
MARKS = ("safe", *(f"mark-{n}" for n in range(8)))


def test_black_on_white_is_21():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize("ground", ["ground", "surface", "sunken"])
def test_text_can_be_read(scheme, ground):
    for name in TEXT:
        assert contrast(scheme[name], scheme[ground]) >= 4.5, name
    assert contrast(scheme["on-accent"], scheme["accent"]) >= 4.5


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_marks_can_be_seen(scheme):
    for name in MARKS:
        assert contrast(scheme[name], scheme["surface"]) >= 3.0, name
