"""What makes a log doubtful: one sentence each, with its cure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from servo_models.data.audit.sampling import Sampling
from servo_models.data.audit.signals import Command, Reading

JITTERY, STALE, CLIPPED, COARSE = 0.2, 0.2, 0.01, 10.0
"""From where on a log is doubtful: jitter over the step, shares of the samples, and range over
the reading step."""


def doubts(
    sampling: Sampling, commands: Iterable[Command], readings: Iterable[Reading]
) -> tuple[str, ...]:
    """Return what makes a log doubtful."""
    said = [*_about_time(sampling), *_about_commands(list(commands))]
    for reading in readings:
        said += _about_reading(reading)
    return tuple(said)


def _about_commands(commands: Sequence[Command]) -> list[str]:
    said: list[str] = []
    if not any(command.changes for command in commands):
        said.append("no input ever changes: nothing can be determined; log a moving command")
    for command in commands:
        if command.at_limit > CLIPPED:
            said.append(
                f"'{command.name}' is at the actuator's limit in {command.at_limit:.1%} of the"
                " samples: the real command may have gone on; log what was sent, or less of it"
            )
    return said


def _about_time(sampling: Sampling) -> list[str]:
    said: list[str] = []
    if sampling.gaps:
        first = sampling.gaps[0]
        many = f"{len(sampling.gaps)} gaps, the first" if len(sampling.gaps) > 1 else "a gap"
        said.append(
            f"{many} of {first.length:.3g} s after row {first.row}: what happened there is unknown;"
            " cut the log with 'window' or log again"
        )
    if sampling.jitter > max(JITTERY * sampling.step, sampling.stamp):
        said.append(
            f"the sampling step jitters by {sampling.jitter / sampling.step:.0%}: time stamps must"
            " come from where the signals are read"
        )
    return said


def _about_reading(reading: Reading) -> list[str]:
    name, said = reading.name, []
    if reading.clipped > CLIPPED:
        said.append(
            f"'{name}' stays at an extreme in {reading.clipped:.1%} of the samples while the"
            " command moves on: clipped reading or end stop; log smaller moves"
        )
    if reading.stale > STALE:
        said.append(
            f"'{name}' repeats the value before in {reading.stale:.0%} of the moving samples: it is"
            " read less often than logged; keep one row per reading"
        )
    if reading.between > CLIPPED and reading.step > reading.floor.residual:  # else: few digits
        said.append(
            f"'{name}' lies between its steps in {reading.between:.0%} of the samples: the file was"
            " resampled, so its time stamps and noise are not those of the sensor"
        )
    if reading.high - reading.low < COARSE * reading.step:
        said.append(
            f"'{name}' moves by only {(reading.high - reading.low) / reading.step:.0f} reading"
            " steps: log larger moves or a finer sensor"
        )
    return said
