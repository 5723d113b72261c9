"""Several diagnoses or parameter sets on the same logs, side by side."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from servo_models.analysis.statistics import rms
from servo_models.core.plant import unknown
from servo_models.core.simulate import Model
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log, hashes
from servo_models.data.parameters import read_parameters
from servo_models.errors import UserError
from servo_models.files import read_regular
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import with_starts
from servo_models.report.numbers import listed
from servo_models.report.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Sets of values on the same logs.

    Attributes:
        model: nominal.
        logs: as described, each with its start.
        sets: values [SI] of all parameters that a file gives, by the name of the file.
        errors: RMS error [SI] by log, output and set, the nominal one first.
        remarks: what has changed since a file was written, in words.
    """

    model: Model
    logs: tuple[Log, ...]
    sets: Mapping[str, Mapping[str, float]]
    errors: Mapping[tuple[str, str], Sequence[float]]
    remarks: tuple[str, ...]

    @property
    def changed(self) -> list[str]:
        """Parameters that are other in any set than in the nominal model."""
        nominal = self.model.values
        return [
            name
            for name in nominal
            if any(
                values.get(name, nominal[name]) != nominal[name] for values in self.sets.values()
            )
        ]


@dataclass(frozen=True)
class _Told:
    """What a file says: whose values, and what they were found from; a parameter file has all of
    them, whatever its variant."""

    path: Path
    actuator: str
    variant: str
    values: dict[str, float]
    logs: Mapping[str, str]
    description: tuple[str, str] = ("", "")


def compare(
    files: Sequence[str | Path], on: str | Path | None = None, trust: bool = False
) -> Comparison:
    """Return diagnoses (.json) and parameter sets (.toml) beside the logs of a description.

    Args:
        files: two or more; one is compared with the nominal model.
        on: the description; None takes the one that a diagnosis names, beside its file.
        trust: a description may name a Python file anywhere.

    Raises:
        UserError: a file that is neither, or of another actuator; no description; see also
            ``read_description``.
    """
    told = [_told(Path(file), trust) for file in files]
    if not told:
        raise UserError("nothing to compare: name diagnoses (.json) or parameter files (.toml)")
    path = Path(on) if on else _description_of(told)
    described = read_description(path, trust)
    for source in told:
        _check_alike(source, described, path)
    logs = with_starts(described.model, described.logs)
    sets = _named(told)
    remarks = tuple(_remarks(told, described, path))
    return Comparison(described.model, logs, sets, _errors(described.model, logs, sets), remarks)


def _check_alike(source: _Told, described: Description, path: Path) -> None:
    """Refuse values that are not of the model that a description names: others would mix."""
    model, here = described.model, f"'{path}' of"
    if source.actuator not in (model.actuator.name, model.actuator.key):
        raise UserError(
            f"'{source.path}' is of '{source.actuator}', but {here} '{model.actuator.name}':"
            " compare files of one actuator"
        )
    if source.variant not in ("", model.variant):
        raise UserError(
            f"'{source.path}' begins with variant '{source.variant}', but {here} '{model.variant}':"
            " give --on the description that it was made with"
        )
    for name in source.values:
        if name not in model.values:
            raise UserError(f"'{source.path}': {unknown('parameter', name, model.values)}")


def _told(path: Path, trust: bool) -> _Told:
    if path.suffix.lower() == ".toml":
        fitted = read_parameters(path, trust)
        return _Told(path, fitted.actuator, "", fitted.model().values, fitted.logs)
    try:
        document: Any = json.loads(read_regular(path))
        values = {entry["name"]: float(entry["value"]) for entry in document["parameters"]}
        logs = {entry["file"]: f"sha256:{entry['sha256']}" for entry in document["logs"]}
        known = document.get("description") or {"file": "", "sha256": ""}
        variant, named = document["variant"], (known["file"], known["sha256"])
        return _Told(path, document["actuator"], variant, values, logs, named)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"'{path}' is no diagnosis: give what 'diagnose --json' wrote, or a parameter file"
            " (.toml)"
        ) from error


def _description_of(told: Sequence[_Told]) -> Path:
    for source in told:
        name, _ = source.description
        if name and (source.path.parent / name).exists():
            return source.path.parent / name
    names = ", ".join(
        dict.fromkeys(f"'{name}'" for name, _ in (it.description for it in told) if name)
    )
    missing = f"{names} is not beside the file that names it" if names else "no file names its logs"
    raise UserError(f"{missing}: give --on DESCRIPTION")


def _named(told: Sequence[_Told]) -> dict[str, dict[str, float]]:
    """Values by the name of their file, with its folders where names repeat."""
    names = [source.path.stem for source in told]
    return {
        source.path.stem
        if names.count(source.path.stem) == 1
        else source.path.as_posix(): source.values
        for source in told
    }


def _remarks(told: Sequence[_Told], described: Description, path: Path) -> Iterator[str]:
    """What the files were made of that is not what is here."""
    now = {name: f"sha256:{digest}" for name, digest in hashes(described.logs).items()}
    for source in told:
        name, before = source.description
        if name and before != described.document.sha256:
            yield f"'{source.path.name}' was made with another '{name}' than '{path.name}' is now."
        apart = [f"{file!r}, which is not here" for file in source.logs if file not in now]
        other = [file for file, digest in source.logs.items() if now.get(file, digest) != digest]
        # a log has changed where all were made from the same one, in the folder of this description
        known = {(file, it.logs[file]) for it in told for file in other if file in it.logs}
        here = source.path.parent.resolve() == path.parent.resolve()
        if other and here and len(known) == len(other):
            yield f"{listed(map(repr, other))} has changed since '{source.path.name}' was made."
        else:
            apart += [f"another {file!r}" for file in other]
        if apart:
            differ = f"'{source.path}' is of different logs than '{path}': {listed(apart)}"
            yield f"{differ}. Errors are on those of '{path}'."


def _errors(
    model: Model, logs: Sequence[Log], sets: Mapping[str, Mapping[str, float]]
) -> dict[tuple[str, str], list[float]]:
    errors: dict[tuple[str, str], list[float]] = {}
    for log in logs:
        counted = log.fitted | log.checked
        for values in ({}, *sets.values()):
            simulated = prepared(replace(model, values={**model.values, **values}), log)
            out = simulated.outputs_or_nan({})
            for k, (name, measured) in enumerate(log.outputs.items()):
                error = (out[:, k] - measured)[counted]
                errors.setdefault((log.name, name), []).append(rms(error))
    return errors
