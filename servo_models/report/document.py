"""JSON documents that are declared, and the schemas that they give.

Apart from ``interchange``, so that the command line starts without msgspec.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from msgspec import Meta, Struct
from msgspec.json import schema_components

if TYPE_CHECKING:
    from typing import Self

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Figure = float | None  # None is a figure that does not exist
if TYPE_CHECKING:
    Unbounded = float  # it may be infinite or NaN,
else:
    Unbounded = float | None  # for which JSON has null
Magnitude = Annotated[float, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0, le=1)]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]  # SHA-256


class Document(Struct, frozen=True, forbid_unknown_fields=True):
    """A JSON document or a part of one: the fields are its keys, in this order, and its schema.

    A field may hold what JSON lists as well, such as a tuple or an array of NumPy.  Nothing is
    checked when it is made, since every result has to be reported; tests hold documents to
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
