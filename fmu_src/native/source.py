"""The C sources of a native FMU: the shell of this folder, and one model."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from fmu_src.variables import Variable, variables
from servo_models.core.c_text import c_text
from servo_models.core.flat import neutral_effects
from servo_models.core.simulate import Model
from servo_models.errors import UserError

SHELL = Path(__file__).parent
SHARED = ("arithmetic.h", "model.h", "instance.c")
"""Files of the shell that every version of FMI has; ``fmi2.c`` and ``fmi3.c`` are those of one."""

IDENTITY_HEADER = "identity.h"


def native_sources(
    model: Model, main: str, others: Mapping[str, bytes] | None = None
) -> tuple[str, dict[str, bytes]]:
    """Return the identity of the sources, and the sources by name, without ``IDENTITY_HEADER``.

    Args:
        model: what the FMU simulates.
        main: the file to compile, which takes in the others: ``fmi2.c`` or ``fmi3.c``.
        others: files to stand beside them.

    Raises:
        UserError: a block uses what has no form in C.
    """
    sources = {name: (SHELL / name).read_bytes() for name in (*SHARED, main)} | {**(others or {})}
    sources["model.c"] = _model(model).encode()
    return identity_of(sources), sources


def identity_of(sources: Mapping[str, bytes]) -> str:
    """Return the hash of sources by name, but for the header that holds it."""
    digest = hashlib.sha256()
    for name in sorted(sources.keys() - {IDENTITY_HEADER}):
        digest.update(b"%s\0%d\0" % (name.encode(), len(sources[name])) + sources[name])
    return digest.hexdigest()


def identity_header(identity: str, guid: str) -> bytes:
    """Return ``IDENTITY_HEADER``: whose states a library understands, and which description is
    its own."""
    return (
        f"/* Generated. */\n#define IDENTITY {_string(identity)}\n#define GUID {_string(guid)}\n"
    ).encode()


def _model(model: Model) -> str:
    flat = model.flat
    effects = list(flat.switches)
    every = variables(model)
    index = {name: i for i, name in enumerate(flat.params)}
    checked = model.actuator.checked(model.variant)
    sizes = {
        "INPUTS": len(flat.inputs),
        "OUTPUTS": len(flat.outputs),
        "PARAMETERS": len(flat.params),
        "VARIABLES": len(every),
        "STATES": len(flat.states),
        "KEPT": len(flat.start),
        "SIZE": flat.size,
        "EFFECTS": len(effects),
        "SWITCHES": sum(map(len, flat.switches.values())),
        "NOTICES": len(flat.notices),
        "CHECKED": len(checked),
        "TOO_FAST": flat.too_fast,
        "ARITHMETIC": flat.too_fast + 1,
    }
    owners = [effects.index(owner) if owner else -1 for _, owner in flat.start]
    switches = [
        f"{{{i}, {index[name]}}}"
        for i, names in enumerate(flat.switches.values())
        for name in names
    ]
    states = [_string(name) for name, *_ in flat.states]
    faults = [_string(f"{owner}: {text}") for _, owner, text in flat.faults]
    notices = [f"{{{place}, {_string(text)}}}" for place, text in flat.notices]
    ranges = [f"{{{one.low!r}, {one.high!r}, {_string(one.beyond)}}}" for one in checked]
    title = f"{model.actuator.title}, variant {model.variant}".replace("*/", "* /")
    parts = [
        f"/* {title}: generated, do not edit. */",
        '#include <string.h>\n\n#include "arithmetic.h"\n#include "model.h"\n',
        f"#define MODEL {_string(model.actuator.name)}\n",
        "enum {\n" + "".join(f"    {name} = {n},\n" for name, n in sizes.items()) + "};\n",
        _table("const Variable", "variables", map(_variable, every)),
        _table("const char *const", "states", states or ["0"]),
        _table("const int", "owners", map(str, owners)),
        _table("const Switch", "switches", switches or ["{0, 0}"]),
        _table("const char *const", "faults", faults or ["0"]),
        _table("const Notice", "notices", notices or ["{0, 0}"]),
        _table("const Checked", "checked", ranges or ["{0, 0, 0}"]),
        _text(model),
    ]
    return "\n".join(parts)


def _text(model: Model) -> str:
    flat = model.flat
    try:
        return c_text(flat, neutral_effects(flat, list(model.values.values())))
    except ValueError as error:
        raise UserError(
            f"'{flat.name}' as C: {error}; write it otherwise, or build the Python FMU alone, as"
            " one file .fmu"
        ) from error


def _table(kind: str, name: str, rows: Iterable[str]) -> str:
    """C has no empty array, so one without rows is given a zero that nobody reads."""
    lines = "".join(f"    {row},\n" for row in rows)
    return f"static {kind} {name}[] = {{\n{lines}}};\n"


def _variable(variable: Variable) -> str:
    largest = sys.float_info.max
    low = -largest if variable.low is None else variable.low
    high = largest if variable.high is None else variable.high
    numbers = [variable.start or 0.0, low, high, variable.nominal]
    texts: Sequence[str] = [
        _string(variable.name),
        _string(variable.unit),
        *(repr(float(number)) for number in numbers),
        *(str(int(it)) for it in (variable.fixed, variable.flag)),
    ]
    return f"{{{', '.join(texts)}}}"


def _string(text: str) -> str:
    """A C string literal, in ASCII for every compiler; a question mark could begin a trigraph."""
    plain = (
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in text.encode()
    )
    return f'"{"".join(plain)}"'
