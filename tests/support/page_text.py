"""HTML as text that a reviewer can read: headings, tables as columns, links, and form fields."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta", "source", "wbr"}
SILENT = {"script", "style", "head", "svg", "template"}
INLINE = {
    *("a", "abbr", "b", "br", "button", "code", "data", "em", "i", "input", "kbd", "label"),
    *("mark", "meter", "output", "progress", "q", "s", "select", "small", "span", "strong"),
    *("sub", "sup", "textarea", "time", "title", "u", "var", "wbr"),
}
TONE = re.compile(r"\b(?:tone|is)-(bad|good|warn|doubtful|missing)\b")
"""Classes that give a text its colour, which says whether something is wrong."""
SIGNS = {"hidden": "hidden", "aria-current": "current", "aria-invalid": "invalid"}
WIDEST = 40
"""Characters of a table's cell that may widen its column."""


@dataclass
class Element:
    """An element of a page with its attributes, and elements and texts within it."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    children: list["Element | str"] = field(default_factory=list)

    def walk(self) -> Iterator["Element"]:
        """Yield this element and all below, in the order of the page."""
        yield self
        for child in self.children:
            if isinstance(child, Element):
                yield from child.walk()

    def find_all(self, *tags: str) -> list["Element"]:
        """Return the elements below that have one of the tags."""
        return [each for each in self.walk() if each.tag in tags and each is not self]

    def get_text(self) -> str:
        """Return the text without markup, with single spaces."""
        parts = (c if isinstance(c, str) else c.get_text() for c in self.children)
        return " ".join("".join(parts).split())


class _TreeBuilder(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.root = Element("page")
        self._open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs})
        self._open[-1].children.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_endtag(self, tag: str) -> None:
        tags = [element.tag for element in self._open]
        if tag in tags[1:]:
            del self._open[len(tags) - 1 - tags[::-1].index(tag) :]

    def handle_data(self, data: str) -> None:
        self._open[-1].children.append(data)


def parse_page(html: str) -> Element:
    """Return the tree of a page or of a part of one."""
    builder = _TreeBuilder()
    builder.feed(html)
    builder.close()
    return builder.root


def render_page(html: str, part: str | None = None) -> str:
    """Return a page as text, or the part of it that has an id.

    A whole page is its title and what stands in its main element: head and foot are alike on all.

    Raises:
        LookupError: If no element has the id.
    """
    root = parse_page(html)
    if part is not None:
        found = [each for each in root.walk() if each.attributes.get("id") == part]
        if not found:
            raise LookupError(f"No element of the page has the id {part!r}.")
        return _Renderer().render(found[0])
    main = root.find_all("main")
    if not main:
        return _Renderer().render(root)
    (title,) = root.find_all("title")
    return f"title: {title.get_text()}\n{_Renderer().render(main[0])}"


class _Renderer:
    """Lines of text, of which the last one grows until a block ends it."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._line = ""

    def render(self, element: Element) -> str:
        self._render(element)
        self._end_line()
        text = re.sub(r"\n{3,}", "\n\n", "\n".join(self._lines)).strip("\n")
        return f"{text}\n"

    def _end_line(self, prefix: str = "") -> None:
        line = " ".join(self._line.split())
        if line:
            self._lines.append(prefix + line)
        self._line = ""

    def _render_children(self, element: Element) -> None:
        for child in element.children:
            if isinstance(child, str):
                self._line += child
            else:
                self._render(child)

    def _render(self, element: Element) -> None:
        if element.tag in SILENT:
            return
        draw = getattr(self, f"_draw_{element.tag}", None)
        if element.tag in INLINE:
            self._line += describe_signs(element)
            (draw or self._render_children)(element)
            self._line += describe_tone(element)
            return
        self._end_line()
        self._line += describe_signs(element)
        (draw or self._draw_block)(element)

    def _draw_block(self, element: Element) -> None:
        self._render_children(element)
        self._line += describe_tone(element)
        self._end_line()

    def _draw_heading(self, element: Element) -> None:
        self._lines.append("")
        self._line = f"{'#' * int(element.tag[1])} {self._line}"
        self._draw_block(element)

    _draw_h1 = _draw_h2 = _draw_h3 = _draw_h4 = _draw_heading

    def _draw_label(self, element: Element) -> None:
        # A label around its control is a line of its own, but for a box to tick.
        controls = element.find_all("input", "select", "textarea")
        holds = any(each.attributes.get("type") not in {"checkbox", "radio"} for each in controls)
        if holds:
            self._end_line()
        self._render_children(element)
        if holds:
            self._end_line()

    def _draw_a(self, element: Element) -> None:
        given = element.attributes
        address = given.get("href", "")
        label = f' "{given["aria-label"]}"' if "aria-label" in given else ""
        self._line += "["
        self._render_children(element)
        download = ", download" if "download" in given else ""
        self._line += f"]({address}{label}{download})"

    def _draw_li(self, element: Element) -> None:
        self._line = f"- {self._line}"
        self._draw_block(element)

    def _draw_dl(self, element: Element) -> None:
        for item in element.find_all("dt", "dd"):
            if item.tag == "dt":
                self._end_line()
            self._render_children(item)
            self._line += ": " if item.tag == "dt" else f"{describe_tone(item)} "
        self._end_line()

    def _draw_summary(self, element: Element) -> None:
        self._line = f"▸ {self._line}"
        self._draw_block(element)

    def _draw_legend(self, element: Element) -> None:
        self._lines.append("")
        self._draw_block(element)

    def _draw_pre(self, element: Element) -> None:
        self._end_line()
        text = "".join(c if isinstance(c, str) else "".join(c.children) for c in element.children)
        self._lines += [f"    {line}" for line in text.splitlines()]

    def _draw_form(self, element: Element) -> None:
        given = element.attributes
        method = given.get("method", "get").upper()
        self._line += f"form {method} {given.get('action', '')}"
        if "data-ask" in given:
            self._line += f' asking "{given["data-ask"]}"'
        self._end_line()
        self._render_children(element)
        self._end_line()

    def _draw_figure(self, element: Element) -> None:
        if "data-chart" in element.attributes:
            self._lines += ["", f"chart {element.attributes['data-chart']}"]
        self._draw_block(element)

    def _draw_canvas(self, element: Element) -> None:
        self._line += f"picture: {element.attributes.get('aria-label', '')}"
        self._end_line()

    def _draw_br(self, _: Element) -> None:
        self._end_line()

    def _draw_progress(self, element: Element) -> None:
        self._line += "[progress {value} of {max}] ".format_map({"value": "?"} | element.attributes)

    def _draw_button(self, element: Element) -> None:
        given = element.attributes
        if "data-term" in given:
            return
        label = given.get("aria-label") or element.get_text()
        name = f" {given['name']}={given.get('value', '')}" if "name" in given else ""
        more = "".join(f" {given[key]}" for key in ("data-export", "formaction") if key in given)
        self._line += f" <{label}{name}{more}{' disabled' * ('disabled' in given)}> "

    def _draw_input(self, element: Element) -> None:
        given = element.attributes
        kind = given.get("type", "text")
        if kind in {"checkbox", "radio"}:
            mark = "x" if "checked" in given else " "
            self._line += f" [{mark}] {given.get('name', '')}={given.get('value', '')} "
            return
        bounds = [given.get("min", ""), given.get("max", "")]
        words = [
            *([kind] if kind != "text" else []),
            *(["…".join(bounds)] if any(bounds) else []),
            *(key for key in ("required", "readonly", "disabled") if key in given),
            *([f"empty: {given['placeholder']}"] if given.get("placeholder") else []),
        ]
        label = f"{given['aria-label']}: " if "aria-label" in given else ""
        about = f" ({', '.join(words)})" if words else ""
        self._line += f" [{label}{given.get('name', '')} = {given.get('value', '')}{about}] "

    def _draw_textarea(self, element: Element) -> None:
        self._line += f" [{element.attributes.get('name', '')} = {element.get_text()}] "

    def _draw_select(self, element: Element) -> None:
        options = []
        for option in element.find_all("option"):
            label = option.get_text()
            value = option.attributes.get("value", label)
            chosen = "*" if "selected" in option.attributes else ""
            options.append(f"{chosen}{label}" + (f" ({value})" if value != label else ""))
        self._line += f" [{element.attributes.get('name', '')} = {' | '.join(options)}] "

    def _draw_table(self, element: Element) -> None:
        self._end_line()
        rows = [self._draw_row(row) for row in element.find_all("tr")]
        count = max(map(len, rows), default=0)
        rows = [row + [""] * (count - len(row)) for row in rows]
        widths = [
            max((len(row[place]) for row in rows if len(row[place]) <= WIDEST), default=0)
            for place in range(count)
        ]
        lines = [
            " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        if element.find_all("thead"):
            lines.insert(1, "-+-".join("-" * width for width in widths))
        for caption in element.find_all("caption"):
            self._lines.append(caption.get_text())
        self._lines += lines

    def _draw_row(self, row: Element) -> list[str]:
        cells = []
        for cell in row.find_all("th", "td"):
            inside = _Renderer()
            inside._render_children(cell)
            inside._line += describe_tone(cell)
            inside._end_line()
            order = cell.attributes.get("aria-sort", "")
            cells.append(" / ".join(inside._lines) + f" ({order})" * bool(order))
        return cells


def describe_signs(element: Element) -> str:
    """Return what a page tells by attributes of an element alone, in brackets before its text."""
    given = element.attributes
    words = [word for name, word in SIGNS.items() if name in given]
    words += [given["role"]] if given.get("role") in {"status", "alert"} else []
    words += [f"loads {given['hx-get']}"] if "hx-get" in given else []
    words += [f"open: {given['data-open']}"] if "data-open" in given else []
    return "".join(f"({word}) " for word in words)


def describe_tone(element: Element) -> str:
    """Return the tone of an element in braces, or nothing."""
    found = TONE.search(element.attributes.get("class", ""))
    return f" {{{found[1]}}}" if found else ""
