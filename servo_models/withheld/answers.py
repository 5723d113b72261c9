"""Opening the answers of withheld cases, after it has been shown that nobody changed them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from servo_models.errors import UserError


def unlock(folder: Path, seal: str) -> list[dict[str, Any]]:
    """Return the answers, one per case; see ``generator.files`` for what is in them.

    Args:
        folder: what the generator wrote.
        seal: what it printed, before any diagnosis began.

    Raises:
        UserError: no answers there, answers that the seal is not of, or another file than the
            generator wrote.
    """
    path = folder / "answers.json"
    try:
        text = path.read_bytes()
    except OSError as error:
        raise UserError(f"'{path}' cannot be read: {error.strerror}") from error
    if hashlib.sha256(text).hexdigest() != seal:
        raise UserError(f"'{path}' is not what was sealed: generate the cases again")
    answers: list[dict[str, Any]] = json.loads(text)["cases"]
    for answer in answers:
        for name, digest in answer["files"].items():
            file = folder / name
            if not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != digest:
                raise UserError(f"'{file}' is not what was generated: generate the cases again")
    return answers
