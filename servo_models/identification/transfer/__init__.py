"""Transfer functions from measured records: estimate, compare, choose."""

from __future__ import annotations

from servo_models.identification.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.identification.transfer.identify import (
    Candidate,
    TransferResult,
    identify_transfer,
)
from servo_models.identification.transfer.measurements import Record, Sweep
from servo_models.identification.transfer.sweeps import raw_records, read_sweeps, sweep_of_sines

__all__ = [
    "STRUCTURES",
    "Candidate",
    "Record",
    "Structure",
    "Sweep",
    "TransferFunction",
    "TransferResult",
    "identify_transfer",
    "raw_records",
    "read_sweeps",
    "sweep_of_sines",
]
