"""A folder is its README.md: links to it lead there, and it lists the pages of its folder."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

LINK = re.compile(r"(?<=\]\()([^)\s#:]+)(?=\))")


def complete(app: Sphinx, document: str, source: list[str]) -> None:
    page = Path(app.env.doc2path(document))

    def target(link: re.Match[str]) -> str:
        inside = page.parent / link[1] / "README.md"
        return f"{link[1].rstrip('/')}/README.md" if inside.is_file() else link[1]

    source[0] = LINK.sub(target, source[0])
    if page.name != "README.md":
        return
    below = (it.relative_to(page.parent) for it in page.parent.rglob("*.md") if it != page)
    if names := "\n".join(sorted(it.with_suffix("").as_posix() for it in below)):
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", complete)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
