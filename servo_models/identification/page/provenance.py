"""Section: what the estimates come from."""

from __future__ import annotations

from collections.abc import Mapping

from servo_models.data.log import Log
from servo_models.data.parameters import installed_version
from servo_models.identification.result import Identification
from servo_models.report.parts import Section, number

TITLE = "Provenance"


def section(found: Identification, conditions: Mapping[str, str]) -> Section:
    """Return model, method, logs with their hashes, and versions."""
    model = found.nominal
    facts = [
        ("actuator", f"{model.actuator.name}, variant {model.variant}"),
        ("method", found.method),
        ("search", _ending(found)),
        *((f"log {log.name}", log_text(log)) for log in found.logs),
        *{"servo-models": installed_version(), **conditions}.items(),
    ]
    return Section("provenance", TITLE, facts=tuple((name, text) for name, text in facts if text))


def _ending(found: Identification) -> str:
    ending = "converged" if found.converged else "did not converge"
    if found.interrupted:
        ending = "stopped by the user"
    ends = ", ".join(number(cost, 5) for cost in found.costs)
    return f"{ending}; {found.evaluations} simulations of all logs; cost of each start: {ends}"


def log_text(log: Log) -> str:
    """Return file, hash, length, held-out share and constants of a log."""
    parts = [
        f"{log.path.name}, sha256 {log.sha256}",
        f"{len(log.times)} samples over {number(log.duration)} s",
        f"{number(100.0 * float(log.held_out.mean()), 3)} % held out",
    ]
    parts += [f"{name} = {number(value, 6)} (SI)" for name, value in log.constants.items()]
    return "; ".join(parts)
