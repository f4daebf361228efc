"""The tags of what a notebook shows: well formed, and of the few kinds that need no trust."""

from html.parser import HTMLParser

NASTY = "<script>alert('[b]x[/b]')</script>"
ALLOWED = {"table", "thead", "tbody", "tr", "th", "td", "p"}


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.names, self.open = set(), []

    def handle_starttag(self, tag, attrs):
        assert not attrs
        self.names.add(tag)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def tags(text):
    seen = Tags()
    seen.feed(text)
    assert seen.open == []
    return seen.names
