"""Results for other programs: JSON and its schema, GitHub's workflow commands, and what figures
depend on."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from msgspec import Meta, Struct
from msgspec.json import schema_components
from msgspec.structs import asdict

if TYPE_CHECKING:
    from typing import Self

PACKAGES = ("servo-models", "pythonfmu", "fmpy", "numba", "numpy", "scipy", "control")
DIALECT = "https://json-schema.org/draft/2020-12/schema"

Figure = float | None
"""None is a figure that does not exist."""
Magnitude = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
"""SHA-256."""


class Document(Struct, frozen=True, forbid_unknown_fields=True):
    """A JSON document or a part of one: the fields are its keys, in this order, and its schema.

    A field may hold what JSON lists as well, such as a tuple or an array of NumPy.  Nothing is
    checked when it is made, since a result has to be told whatever it is; tests hold documents to
    their schemas.
    """

    title: ClassVar[str]
    """Of a whole document: the command that writes it."""

    @classmethod
    def made_from(cls, source: object, **given: object) -> Self:
        """Return it with the fields that are not given from attributes of the same names."""
        others = [name for name in cls.__struct_fields__ if name not in given]
        return cls(**given, **{name: getattr(source, name) for name in others})


def about(text: str, **limits: Any) -> Meta:
    """Return what the schema says of a field, and how ``Meta`` limits it."""
    return Meta(description=text, **limits)


def constant(value: object) -> Meta:
    """Return what says that a field has one value."""
    return Meta(extra_json_schema={"const": value})


def choice(*texts: str) -> Meta:
    """Return what says that a field is one of some texts."""
    return Meta(extra_json_schema={"enum": list(texts)})


def schema_of(kind: type[Document]) -> dict[str, Any]:
    """Return the JSON Schema of a document.  Every key is required, since every one is written."""
    (whole,), parts = schema_components([kind], ref_template="#/$defs/{name}")
    for part in parts.values():
        part["required"] = list(part["properties"])
        if "description" in part:  # the lines of a docstring
            part["description"] = " ".join(part["description"].split())
    return {"$schema": DIALECT, "title": kind.title, **whole, "$defs": parts}


def plain(document: object) -> Any:
    """Return a document as lists and dictionaries; figures that are not finite stay as they are."""
    return json.loads(json.dumps(document, default=_listed))


def _listed(value: Any) -> object:
    """Parts of documents, other tables, arrays and numbers of NumPy, as JSON lists them."""
    if isinstance(value, Struct):
        return asdict(value)
    return dict(value) if isinstance(value, Mapping) else value.tolist()


def finite_json(document: object) -> str:
    """Return a document as JSON; a figure that is not finite becomes null.

    Of ``##`` one sign is escaped, as CI runners obey ``##[error]`` anywhere in a line.
    """
    return json.dumps(finite(plain(document)), indent=2).replace("##", r"#\u0023")


def command(kind: str, title: str, message: str) -> str:
    """Return a workflow command: ``kind`` is ``"error"``, ``"warning"`` or ``"notice"``.

    Source: GitHub Docs, Workflow commands for GitHub Actions.
    """
    escaped = _escaped(title).replace(":", "%3A").replace(",", "%2C")
    return f"::{kind} title={escaped}::{_escaped(message)}"


def _escaped(words: str) -> str:
    return words.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def finite(value: object) -> object:
    """Return lists, dictionaries or a figure with None in place of what is not finite."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def conditions() -> dict[str, str]:
    """Return the versions and the machine that figures depend on beside their inputs, by name."""
    machine = {
        "Python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
    }
    return machine | {name: version(name) for name in PACKAGES}
