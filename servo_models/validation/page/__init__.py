"""Reports: one file = one section, one self-contained HTML page each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servo_models.validation.rows import Validation


def write_report(validation: Validation, path: str | Path, date: str = "") -> None:
    """Write a validation as one HTML file that needs nothing else, with pictures inside.

    Args:
        validation: from ``servo_models.validation.runner``.
        path: of the file; written whole or not at all.
        date: shown among the conditions; the same validation and date give the same bytes.

    Raises:
        UserError: the folder cannot be made or written.
    """
    from servo_models.files import write_whole
    from servo_models.validation.page.page import validation_page

    write_whole(Path(path), validation_page(validation, date).encode())
