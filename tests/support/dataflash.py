"""DataFlash logs of ArduPilot with positions of CAN servos.

Source: ArduPilot, libraries/AP_Logger/LogStructure.h: FMT, FMTU with # for the field of an
instance, CSRV and RCOU, shortened.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

from servo_models.core.types import Array

HEAD = b"\xa3\x95"
FMT, FMTU, CSRV, RCOU = 128, 129, 130, 131
BEGIN_US = 5_000_000  # time of the first row after power-on


def flight_log(path: Path, times: Array, servos: Mapping[int, tuple[Array, Array]]) -> Path:
    """Write measured and commanded positions [deg] of each servo, and pulses of RCOU."""
    content = _described(FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    content += _described(FMTU, 44, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    content += _described(CSRV, 20, "CSRV", "QBff", "TimeUS,Id,Pos,PosCmd")
    content += _described(RCOU, 15, "RCOU", "QHH", "TimeUS,C1,C2")
    units = struct.pack("<QB16s16s", 0, CSRV, b"s#--", b"F---")
    content += HEAD + bytes([FMTU]) + units
    for k, time in enumerate(times):
        stamp = BEGIN_US + round(1e6 * time)
        for servo, (measured, commanded) in servos.items():
            row = struct.pack("<QBff", stamp, servo, measured[k], commanded[k])
            content += HEAD + bytes([CSRV]) + row
        content += HEAD + bytes([RCOU]) + struct.pack("<QHH", stamp, 1500, 1500 + k)
    path.write_bytes(content)
    return path


def _described(kind: int, size: int, name: str, form: str, fields: str) -> bytes:
    body = struct.pack("<BB4s16s64s", kind, size, name.encode(), form.encode(), fields.encode())
    return HEAD + bytes([FMT]) + body
