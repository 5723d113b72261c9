"""A strict reading of an HTML page, for tests of reports."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from html.parser import HTMLParser

from servo_models.report.result import Report

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Page(HTMLParser):
    """A strict reading of a page: tags that close, ids, what it points to, its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.rows: list[list[str]] = []
        self.source = text
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in {"td", "th"}:
            self.rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.tags)

    def values(self, attribute: str) -> list[str]:
        return [str(attrs[attribute]) for _, attrs in self.tags if attribute in attrs]

    def assert_stands_alone(self) -> None:
        """Every id is there once, and everything pointed to is in the page itself."""
        ids = self.values("id")
        assert len(ids) == len(set(ids))
        scripts = re.findall(r"<script>(.*?)</script>", self.source, re.S)
        rest = re.sub(r"<script.*?</script>", "", self.source, flags=re.S)
        targets = self.values("href") + re.findall(r"url\((.*?)\)", rest)
        assert {target.removeprefix("#") for target in targets} <= set(ids)
        assert all(target.startswith("#") for target in targets)
        assert not {"link", "img", "iframe"} & {tag for tag, _ in self.tags}
        assert not re.search("https?:", rest)
        (policy,) = (attrs["content"] for _, attrs in self.tags if "http-equiv" in attrs)
        allowed = re.search("script-src (.*?);", str(policy))
        digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
        assert allowed
        assert allowed[1].split() == [
            f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests
        ] or (allowed[1] == "'none'" and not scripts)


def unpictured(report: Report) -> Report:
    """A report without its pictures, which take most of the time of a page."""
    bare = tuple(replace(section, pictures=()) for section in report.sections)
    return replace(report, sections=bare)
