"""What an FMU may take while it is validated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What one FMU may take.

    Attributes:
        seconds: for one comparison, wall-clock time.
        megabytes: of address space; not kept on Windows and macOS.
        unpacked_megabytes: of all its files.
    """

    seconds: float = 120.0
    megabytes: float = 1024.0
    unpacked_megabytes: float = 256.0


LIMITS = Limits()
"""Ours take a tenth of each."""
