"""FMUs of which one entry is changed."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path


def with_description(good: Path, bad: Path, change: Callable[[bytes], bytes]) -> Path:
    """Copy an FMU with another ``modelDescription.xml``, which has to differ."""
    with zipfile.ZipFile(good) as read, zipfile.ZipFile(bad, "w") as write:
        for name in read.namelist():
            content = read.read(name)
            if name == "modelDescription.xml":
                assert change(content) != content
                content = change(content)
            write.writestr(name, content)
    return bad
